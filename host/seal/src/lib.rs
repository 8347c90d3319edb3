//! Seals an image of the firmware: writes its length and checksum ([`edm_hal_shim::seal`]) into section `.seal`, so that the
//! head refuses to be enabled when the flash differs. It serves every command that flashes a board or runs the modelled
//! chip: docs/bring-up.md, step 4.

pub mod image;

use crc::{CRC_32_MPEG_2, Crc};
use edm_hal_shim::seal::{FLASH_END, PROGRAM, Seal, VECTORS};
use object::read::elf::{FileHeader, ProgramHeader};
use object::{Endianness, Object, ObjectSection, elf};
use std::path::Path;

/// Seals an ELF file. One that was sealed before is sealed anew.
///
/// # Errors
/// Why it cannot be sealed: it is no ELF of this firmware, or a part would be flashed outside the sealed range.
pub fn seal(mut file: Vec<u8>) -> Result<Vec<u8>, String> {
    let (offset, address, segments) = parts(&file)?;
    let (table, program) = contents(address, &segments)?;
    let seal = Seal { length: program.len() as u32, crc: checksum(&[&table, &program]) };
    let place = file.get_mut(offset..offset + SIZE).ok_or("section .seal lies outside of the file")?;
    for (to, word) in place.chunks_exact_mut(4).zip([seal.length, seal.crc]) {
        to.copy_from_slice(&word.to_le_bytes());
    }
    Ok(file)
}

/// Writes a sealed copy of an ELF file.
///
/// # Errors
/// Which file, and why.
pub fn seal_file(elf: &Path, copy: &Path) -> Result<(), String> {
    let file = std::fs::read(elf).map_err(|e| format!("{}: {e}", elf.display()))?;
    let file = seal(file).map_err(|e| format!("{}: {e}", elf.display()))?;
    std::fs::write(copy, file).map_err(|e| format!("{}: {e}", copy.display()))
}

/// Bytes of a seal.
const SIZE: usize = size_of::<Seal>();
/// Content of erased flash.
const ERASED: u8 = 0xFF;

/// What is flashed from where on.
type Segment = (u32, Vec<u8>);

/// Place of the seal in the file and in the flash, and everything that is loaded.
fn parts(file: &[u8]) -> Result<(usize, u32, Vec<Segment>), String> {
    let named = |error: object::Error| error.to_string();
    let header = elf::FileHeader32::<Endianness>::parse(file).map_err(named)?;
    let endian = header.endian().map_err(named)?;
    let mut segments = Vec::new();
    for segment in header.program_headers(endian, file).map_err(named)? {
        let data = segment.data(endian, file).map_err(|()| "a segment lies outside of the file")?;
        if segment.p_type(endian) == elf::PT_LOAD && !data.is_empty() {
            segments.push((segment.p_paddr(endian), data.to_vec()));
        }
    }
    let object = object::File::parse(file).map_err(named)?;
    let section = object.section_by_name(".seal").ok_or("no section .seal: is it this firmware?")?;
    let (offset, size) = section.file_range().ok_or("section .seal is empty")?;
    if size != SIZE as u64 {
        return Err(format!("section .seal has {size} bytes instead of {SIZE}"));
    }
    Ok((offset as usize, section.address() as u32, segments))
}

/// The two stretches that the seal is about: before the seal, and from the beginning of the program on, whole words.
fn contents(seal: u32, segments: &[Segment]) -> Result<(Vec<u8>, Vec<u8>), String> {
    let mut table = vec![ERASED; seal.saturating_sub(VECTORS) as usize];
    let mut program = Vec::new();
    for (start, data) in segments {
        for (address, byte) in (*start..).zip(data) {
            if (seal..seal + SIZE as u32).contains(&address) {
                continue;
            }
            let (room, begin) = if address < seal { (&mut table, VECTORS) } else { (&mut program, PROGRAM) };
            let place = address.checked_sub(begin).filter(|_| address < FLASH_END);
            let place = place.ok_or_else(|| format!("a byte at {address:#010x} would be flashed and not sealed"))?;
            if room.len() <= place as usize {
                room.resize(place as usize + 1, ERASED);
            }
            room[place as usize] = *byte;
        }
    }
    program.resize(program.len().next_multiple_of(4), ERASED);
    if table.is_empty() || !table.len().is_multiple_of(4) || program.is_empty() {
        return Err("vector table or program is missing".into());
    }
    Ok((table, program))
}

/// What the chip's own unit makes of the words (RM0090 section 4): the most significant bit first.
fn checksum(parts: &[&[u8]]) -> u32 {
    const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_MPEG_2);
    let mut digest = CRC.digest();
    for word in parts.iter().flat_map(|part| part.chunks_exact(4)) {
        let mut word = [word[0], word[1], word[2], word[3]];
        word.reverse();
        digest.update(&word);
    }
    digest.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEAL: u32 = VECTORS + 8;

    fn segments() -> Vec<Segment> {
        vec![(VECTORS, vec![1; 8]), (SEAL, vec![ERASED; SIZE]), (PROGRAM, vec![2; 5]), (PROGRAM + 7, vec![3])]
    }

    #[test]
    fn what_no_programmer_writes_counts_as_erased() {
        let (table, program) = contents(SEAL, &segments()).unwrap();
        assert_eq!((table, program), (vec![1; 8], vec![2, 2, 2, 2, 2, ERASED, ERASED, 3]));
        let mut longer = segments();
        longer.push((PROGRAM + 8, vec![4]));
        assert_eq!(contents(SEAL, &longer).unwrap().1[8..], [4, ERASED, ERASED, ERASED]);
    }

    #[test]
    fn what_would_be_flashed_beside_the_seal_is_refused() {
        for address in [SEAL + SIZE as u32, PROGRAM - 1, FLASH_END, 0x2000_0000, VECTORS - 1] {
            let mut segments = segments();
            segments.push((address, vec![0]));
            assert!(contents(SEAL, &segments).is_err(), "{address:#x}");
        }
        assert!(contents(SEAL, &segments()[..2]).is_err() && contents(VECTORS, &segments()[2..]).is_err());
    }

    /// The value after a reset, one word of zeros, and bytes in the order in which the unit takes those of a word.
    #[test]
    fn it_is_the_sum_of_the_chips_unit() {
        assert_eq!((checksum(&[]), checksum(&[&[0; 4]])), (0xFFFF_FFFF, 0xC704_DD7B));
        assert_eq!(checksum(&[b"4321", b"8765"]), Crc::<u32>::new(&CRC_32_MPEG_2).checksum(b"12345678"));
    }

    #[test]
    fn a_file_of_something_else_is_named() {
        assert!(seal(b"no ELF".to_vec()).is_err());
    }
}

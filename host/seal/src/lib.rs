//! Seals an image of the firmware: puts the boot loader into section `.boot`, and length and checksum of the program
//! ([`edm_hal_shim::seal`]) into section `.seal`, so that the head refuses to be enabled when the flash differs. It serves every
//! command that flashes a board or runs the modelled chip: docs/bring-up.md, step 4. [`update`] makes of a sealed image what
//! a head is updated with over CAN.

pub mod image;
pub mod update;

use crc::{CRC_32_MPEG_2, Crc};
use edm_hal_shim::seal::{BOOT, BOOT_LENGTH, PROGRAM, STAGE, Seal};
use object::read::elf::{FileHeader, ProgramHeader};
use object::{Endianness, Object, ObjectSection, elf};
use std::path::Path;

/// Seals an ELF file. One that was sealed before is sealed anew, with the boot loader that it has.
///
/// # Errors
/// Why it cannot be sealed: it is no ELF of this firmware, or a part would be flashed outside the sealed range.
pub fn seal(mut file: Vec<u8>) -> Result<Vec<u8>, String> {
    let Parts { seal: place, address, segments, .. } = parts(&file)?;
    let [before, behind] = contents(address, &segments)?;
    let seal = Seal { length: (before.len() + SIZE + behind.len()) as u32, crc: checksum(&[&before, &behind]) };
    let place = file.get_mut(place..place + SIZE).ok_or("section .seal lies outside of the file")?;
    for (to, word) in place.chunks_exact_mut(4).zip([seal.length, seal.crc]) {
        to.copy_from_slice(&word.to_le_bytes());
    }
    Ok(file)
}

/// Puts a boot loader into an ELF file: its bytes from the begin of the flash on.
///
/// # Errors
/// There is no room for it.
pub fn load(mut file: Vec<u8>, loader: &[u8]) -> Result<Vec<u8>, String> {
    let place = parts(&file)?.boot;
    let mut filled = loader.to_vec();
    let room = BOOT_LENGTH as usize - 4;
    if loader.is_empty() || loader.len() > room {
        return Err(format!("the boot loader has {} bytes, of {room}", loader.len()));
    }
    filled.resize(room, ERASED);
    filled.extend(checksum(&[&filled]).to_le_bytes());
    file.get_mut(place..place + filled.len()).ok_or("section .boot lies outside of the file")?.copy_from_slice(&filled);
    Ok(file)
}

/// Writes a sealed copy of an ELF file, with a boot loader, of which `loader` is the ELF file.
///
/// # Errors
/// Which file, and why.
pub fn seal_file(elf: &Path, loader: &Path, copy: &Path) -> Result<(), String> {
    let read = |path: &Path| std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()));
    let boot = read(loader)?;
    let file = elf::FileHeader32::<Endianness>::parse(&*boot)
        .map_err(|e| e.to_string())
        .and_then(|_| Ok(stretch(BOOT, &loaded(&boot)?)?.1))
        .map_err(|e| format!("{}: {e}", loader.display()))?;
    let sealed = load(read(elf)?, &file).and_then(seal).map_err(|e| format!("{}: {e}", elf.display()))?;
    replace(copy, &sealed)
}

/// Writes a file in one step: who reads it meanwhile, as commands that run side by side do, has the one before or this one, whole.
fn replace(path: &Path, content: &[u8]) -> Result<(), String> {
    let part = path.with_extension(format!("{}.part", std::process::id()));
    let written = std::fs::write(&part, content).and_then(|()| std::fs::rename(&part, path));
    written.map_err(|e| format!("{}: {e}", path.display()))
}

/// Bytes of a seal.
const SIZE: usize = size_of::<Seal>();
/// Content of erased flash.
const ERASED: u8 = 0xFF;

/// What is flashed from where on.
type Segment = (u32, Vec<u8>);

/// What is known of an ELF file.
struct Parts {
    /// Where the seal stands in the file.
    seal: usize,
    /// And in the flash.
    address: u32,
    /// Where the boot loader stands in the file.
    boot: usize,
    /// Everything of the program that is loaded.
    segments: Vec<Segment>,
}

/// Everything that is loaded.
fn loaded(file: &[u8]) -> Result<Vec<Segment>, String> {
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
    Ok(segments)
}

fn parts(file: &[u8]) -> Result<Parts, String> {
    let mut segments = loaded(file)?;
    let object = object::File::parse(file).map_err(|error| error.to_string())?;
    let place = |name: &str, bytes: u64| {
        let section = object.section_by_name(name).ok_or(format!("no section {name}: is it this firmware?"))?;
        let (offset, size) = section.file_range().ok_or(format!("section {name} is empty"))?;
        if size != bytes {
            return Err(format!("section {name} has {size} bytes instead of {bytes}"));
        }
        Ok((offset as usize, section.address() as u32))
    };
    let (seal, address) = place(".seal", SIZE as u64)?;
    let (boot, at) = place(".boot", BOOT_LENGTH.into())?;
    // A linker may have put both into one segment.
    for (begin, data) in &mut segments {
        if *begin == at && data.len() >= BOOT_LENGTH as usize {
            data.drain(..BOOT_LENGTH as usize);
            *begin += BOOT_LENGTH;
        }
    }
    segments.retain(|(_, data)| !data.is_empty());
    Ok(Parts { seal, address, boot, segments })
}

/// The bytes from an address on, and that address, as whole words; what no segment has is erased.
fn stretch(begin: u32, segments: &[Segment]) -> Result<(u32, Vec<u8>), String> {
    let mut bytes = Vec::new();
    for (start, data) in segments {
        for (address, byte) in (*start..).zip(data) {
            let place = address.checked_sub(begin).filter(|_| address < STAGE);
            let place = place.ok_or_else(|| format!("a byte at {address:#010x} would be flashed and not sealed"))?;
            if bytes.len() <= place as usize {
                bytes.resize(place as usize + 1, ERASED);
            }
            bytes[place as usize] = *byte;
        }
    }
    bytes.resize(bytes.len().next_multiple_of(4), ERASED);
    Ok((begin, bytes))
}

/// The program in front of the seal and behind it, whole words.
fn contents(seal: u32, segments: &[Segment]) -> Result<[Vec<u8>; 2], String> {
    let (_, mut before) = stretch(PROGRAM, segments)?;
    let place = seal.checked_sub(PROGRAM).filter(|place| *place > 0 && place.is_multiple_of(4));
    let place = place.ok_or("the vector table is missing")? as usize;
    if before.len() <= place + SIZE {
        return Err("vector table or program is missing".into());
    }
    let behind = before.split_off(place + SIZE);
    before.truncate(place);
    Ok([before, behind])
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

    const SEAL: u32 = PROGRAM + 8;

    fn segments() -> Vec<Segment> {
        let code = SEAL + SIZE as u32;
        vec![(PROGRAM, vec![1; 8]), (SEAL, vec![ERASED; SIZE]), (code, vec![2; 5]), (code + 7, vec![3])]
    }

    #[test]
    fn what_no_programmer_writes_counts_as_erased() {
        let [before, behind] = contents(SEAL, &segments()).unwrap();
        assert_eq!((before, behind), (vec![1; 8], vec![2, 2, 2, 2, 2, ERASED, ERASED, 3]));
        let mut longer = segments();
        longer.push((SEAL + SIZE as u32 + 8, vec![4]));
        assert_eq!(contents(SEAL, &longer).unwrap()[1][8..], [4, ERASED, ERASED, ERASED]);
    }

    #[test]
    fn what_would_be_flashed_beside_the_program_is_refused() {
        for address in [BOOT, PROGRAM - 1, STAGE, 0x2000_0000] {
            let mut segments = segments();
            segments.push((address, vec![0]));
            assert!(contents(SEAL, &segments).is_err(), "{address:#x}");
        }
        assert!(contents(SEAL, &segments()[..2]).is_err() && contents(PROGRAM, &segments()).is_err());
    }

    /// The value after a reset, one word of zeros, and bytes in the order in which the unit takes those of a word.
    #[test]
    fn it_is_the_sum_of_the_chips_unit() {
        assert_eq!((checksum(&[]), checksum(&[&[0; 4]])), (0xFFFF_FFFF, 0xC704_DD7B));
        assert_eq!(checksum(&[b"4321", b"8765"]), Crc::<u32>::new(&CRC_32_MPEG_2).checksum(b"12345678"));
        // By which the head checks its boot loader.
        let sum = checksum(&[b"4321", b"8765"]).to_le_bytes();
        assert_eq!(checksum(&[b"4321", b"8765", &sum]), 0);
    }

    #[test]
    fn a_file_of_something_else_is_named() {
        assert!(seal(b"no ELF".to_vec()).is_err() && load(b"no ELF".to_vec(), &[0; 4]).is_err());
    }
}

//! The file that a head is updated with over CAN: what the stage of the flash is to hold ([`edm_boot`]).

use crate::{SIZE, checksum, contents, parts};
use edm_boot::{Header, LONGEST, PREFIX, PRODUCT};

/// Makes the update of a sealed image.
///
/// # Errors
/// It is no sealed image of this firmware.
pub fn make(elf: &[u8], board: u32, version: u32, build: u32) -> Result<Vec<u8>, String> {
    let parts = parts(elf)?;
    let [before, behind] = contents(parts.address, &parts.segments)?;
    let seal = elf.get(parts.seal..parts.seal + SIZE).ok_or("section .seal lies outside of the file")?;
    let id = u32::from_le_bytes([seal[4], seal[5], seal[6], seal[7]]);
    let program = [&before, seal, &behind].concat();
    if program.len() > LONGEST as usize {
        return Err(format!("the program has {} bytes, of {LONGEST}", program.len()));
    }
    let header = Header {
        product: PRODUCT,
        board,
        length: program.len() as u32,
        sum: checksum(&[&program]),
        id,
        version,
        build,
    };
    Ok(with(&header, &program))
}

/// An update of this header, right or not, and this program.
pub fn with(header: &Header, program: &[u8]) -> Vec<u8> {
    let mut bytes: Vec<u8> = header.words().iter().flat_map(|word| word.to_le_bytes()).collect();
    bytes.extend(checksum(&[&bytes]).to_le_bytes());
    bytes.resize(PREFIX as usize, 0xFF);
    bytes.extend(program);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_boot::Wrong;
    use edm_boot::file::read;

    #[test]
    fn what_is_wrong_with_a_file_is_named() {
        let program = [7; 64];
        let right = Header {
            product: PRODUCT,
            board: 405,
            length: 64,
            sum: checksum(&[&program]),
            id: 1,
            version: 2 << 16,
            build: 3,
        };
        assert_eq!(read(&with(&right, &program)), Ok(right));
        assert_eq!(read(&with(&Header { product: 9, ..right }, &program)), Err(Wrong::Product));
        assert_eq!(read(&with(&Header { sum: 9, ..right }, &program)), Err(Wrong::Sum));
        assert_eq!(read(&with(&right, &program[4..])), Err(Wrong::Length));
        assert_eq!(read(&with(&Header { length: 6, ..right }, &program)), Err(Wrong::Length));
        let mut file = with(&right, &program);
        file[20] ^= 1;
        assert_eq!(read(&file), Err(Wrong::Format));
        assert_eq!(read(b"EDMU"), Err(Wrong::Format));
    }
}

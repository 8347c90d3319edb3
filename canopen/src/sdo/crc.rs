//! Checksum of block transfers: x^16 + x^12 + x^5 + 1, starting at 0 (CiA 301 7.2.4.3.16).

/// Continues a checksum over more bytes.
#[inline(never)]
pub(super) fn crc(start: u16, data: &[u8]) -> u16 {
    data.iter().fold(start, |crc, byte| step(crc, *byte))
}

/// Eight steps of the polynomial at once, without a table.
#[inline(never)]
fn step(crc: u16, byte: u8) -> u16 {
    let x = crc >> 8 ^ u16::from(byte);
    let x = x ^ x >> 4;
    crc << 8 ^ x << 12 ^ x << 5 ^ x
}

#[cfg(test)]
mod tests {
    use super::crc;

    #[test]
    fn the_check_value_is_that_of_the_standard() {
        assert_eq!(crc(0, b"123456789"), 0x31C3);
        assert_eq!(crc(crc(0, b"1234"), b"56789"), 0x31C3);
    }
}

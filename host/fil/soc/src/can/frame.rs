//! A classical CAN frame and the time it takes on the bus.

/// One frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Frame {
    /// Identifier, 11 or 29 bits.
    pub id: u32,
    /// 29-bit identifier.
    pub extended: bool,
    /// Remote request: no data.
    pub remote: bool,
    /// Data length code, 0..=15 as on the wire: 9 to 15 mean eight bytes (ISO 11898-1), and the controller hands them on.
    pub length: u8,
    /// Data; bytes beyond are zero.
    pub data: [u8; 8],
}

impl Frame {
    /// Data frame with an 11-bit identifier; at most eight bytes are taken.
    pub fn new(id: u16, data: &[u8]) -> Self {
        let mut f = Self { id: u32::from(id) & 0x7ff, length: data.len().min(8) as u8, ..Self::default() };
        for (to, from) in f.data.iter_mut().zip(data) {
            *to = *from;
        }
        f
    }

    /// Bits on the bus, from start of frame to the end of the intermission, stuff bits included (ISO 11898-1).
    pub fn bits(&self) -> u64 {
        let mut s = Stuffed { crc: 0, last: None, run: 0, bits: 0 };
        s.push(0, 1);
        if self.extended {
            s.push(self.id >> 18, 11);
            s.push(0b11, 2);
            s.push(self.id & 0x3_ffff, 18);
            s.push(u32::from(self.remote) << 2, 3);
        } else {
            s.push(self.id, 11);
            s.push(u32::from(self.remote) << 2, 3);
        }
        s.push(self.length.into(), 4);
        if !self.remote {
            for byte in &self.data[..usize::from(self.length.min(8))] {
                s.push((*byte).into(), 8);
            }
        }
        s.push(s.crc, 15);
        // CRC delimiter, acknowledge slot and delimiter, end of frame, intermission: not stuffed.
        s.bits + 1 + 2 + 7 + 3
    }
}

struct Stuffed {
    crc: u32,
    last: Option<u32>,
    run: u32,
    bits: u64,
}

impl Stuffed {
    fn push(&mut self, value: u32, count: u32) {
        for i in (0..count).rev() {
            let bit = value >> i & 1;
            let feedback = bit ^ self.crc >> 14 & 1;
            self.crc = (self.crc << 1 & 0x7fff) ^ if feedback == 1 { 0x4599 } else { 0 };
            self.bits += 1;
            self.run = if self.last == Some(bit) { self.run + 1 } else { 1 };
            self.last = Some(bit);
            if self.run == 5 {
                // The stuff bit is the opposite one and starts a new run.
                self.bits += 1;
                self.last = Some(1 - bit);
                self.run = 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_has_between_its_unstuffed_and_its_fully_stuffed_bits() {
        for length in 0..=8usize {
            for fill in [0x00, 0x55, 0xff, 0x0f] {
                let bits = Frame::new(0x2aa, &[fill; 8][..length]).bits();
                let (least, stuffable) = (47 + 8 * length as u64, 34 + 8 * length as u64);
                assert!((least..=least + (stuffable - 1) / 4).contains(&bits), "{length} {fill:#x} {bits}");
            }
        }
    }

    #[test]
    fn eighteen_more_identifier_bits_and_two_more_control_bits_make_an_extended_frame() {
        // Alternating identifiers need no stuffing.
        let standard = Frame { id: 0x555, length: 1, data: [0x55; 8], ..Frame::default() }.bits();
        let extended = Frame { id: 0x1555_5555, extended: true, length: 1, data: [0x55; 8], ..Frame::default() }.bits();
        assert!((18..=24).contains(&(extended - standard)), "{standard} {extended}");
    }
}

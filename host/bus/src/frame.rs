//! A classic CAN frame, and the bits that it takes on a wire.

use embedded_can::{ExtendedId, Id, StandardId};

/// A classic CAN frame: an identifier of 11 or 29 bits, up to 8 bytes of data or a request for them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    id: Id,
    remote: bool,
    length: u8,
    data: [u8; 8],
}

impl embedded_can::Frame for Frame {
    fn new(id: impl Into<Id>, data: &[u8]) -> Option<Self> {
        let mut bytes = [0; 8];
        bytes.get_mut(..data.len())?.copy_from_slice(data);
        Some(Frame { id: id.into(), remote: false, length: data.len() as u8, data: bytes })
    }
    fn new_remote(id: impl Into<Id>, length: usize) -> Option<Self> {
        (length <= 8).then(|| Frame { id: id.into(), remote: true, length: length as u8, data: [0; 8] })
    }
    fn is_extended(&self) -> bool {
        matches!(self.id, Id::Extended(_))
    }
    fn is_remote_frame(&self) -> bool {
        self.remote
    }
    fn id(&self) -> Id {
        self.id
    }
    fn dlc(&self) -> usize {
        self.length.into()
    }
    fn data(&self) -> &[u8] {
        if self.remote { &[] } else { &self.data[..usize::from(self.length)] }
    }
}

/// An identifier from its number; `None` when it has too many bits.
pub(crate) fn identifier(number: u32, extended: bool) -> Option<Id> {
    if extended {
        ExtendedId::new(number).map(Id::Extended)
    } else {
        u16::try_from(number).ok().and_then(StandardId::new).map(Id::Standard)
    }
}

/// Bits after the CRC, which are never stuffed: delimiter, acknowledgement and its delimiter, end of frame, pause.
const TAIL: u32 = 1 + 2 + 7 + 3;

impl Frame {
    /// Bits on the wire from the start of the frame to the start of the next: stuff bits as this content needs them, and
    /// the pause of 3 bits (ISO 11898-1).
    pub fn bits(&self) -> u32 {
        let mut wire = Wire::default();
        wire.put(0, 1);
        match self.id {
            Id::Standard(id) => {
                wire.put(id.as_raw().into(), 11);
                wire.put(self.remote.into(), 1);
                wire.put(0, 2);
            }
            Id::Extended(id) => {
                wire.put(id.as_raw() >> 18, 11);
                wire.put(0b11, 2);
                wire.put(id.as_raw() & 0x3_FFFF, 18);
                wire.put(self.remote.into(), 1);
                wire.put(0, 2);
            }
        }
        wire.put(self.length.into(), 4);
        if !self.remote {
            self.data[..usize::from(self.length)].iter().for_each(|byte| wire.put((*byte).into(), 8));
        }
        wire.put(wire.crc.into(), 15);
        wire.bits + TAIL
    }
}

/// Counts bits as they go out: after five equal ones, one of the other level.
#[derive(Clone, Copy, Debug, Default)]
struct Wire {
    bits: u32,
    crc: u16,
    level: bool,
    run: u32,
}

impl Wire {
    /// The lowest `count` bits of a value, the highest first.
    fn put(&mut self, value: u32, count: u32) {
        for shift in (0..count).rev() {
            let bit = value >> shift & 1 == 1;
            let feedback = bit != (self.crc & 0x4000 != 0);
            self.crc = (self.crc << 1 & 0x7FFF) ^ if feedback { 0x4599 } else { 0 };
            self.run = if bit == self.level { self.run + 1 } else { 1 };
            self.level = bit;
            self.bits += 1;
            if self.run == 5 {
                self.level = !bit;
                self.run = 1;
                self.bits += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_can::Frame as _;

    fn standard(id: u16, data: &[u8]) -> Frame {
        Frame::new(StandardId::new(id).unwrap(), data).unwrap()
    }

    #[test]
    fn a_frame_holds_what_a_wire_can_carry() {
        assert!(Frame::new(StandardId::MAX, &[0; 9]).is_none());
        assert!(Frame::new_remote(ExtendedId::MAX, 9).is_none());
        let remote = Frame::new_remote(ExtendedId::MAX, 8).unwrap();
        assert_eq!((remote.dlc(), remote.data(), remote.is_extended()), (8, &[][..], true));
        assert_eq!(identifier(0x800, false), None);
        assert_eq!(identifier(0x2000_0000, true), None);
    }

    #[test]
    fn a_frame_takes_44_bits_its_data_3_of_pause_and_stuff_bits_within_the_bound() {
        // 44 and 64 fixed bits about 8 n of data; 34 or 54 and 8 n of them can be stuffed, every fourth at worst.
        for length in 0..=8 {
            for fill in [0x00, 0xFF, 0x55, 0xA7] {
                let data = vec![fill; length];
                let bits = standard(0x2AA, &data).bits();
                let fixed = 47 + 8 * length as u32;
                assert!(
                    (fixed..=fixed + (34 + 8 * length as u32 - 1) / 4).contains(&bits),
                    "{length} {fill:x}: {bits}"
                );
                let bits = Frame::new(ExtendedId::new(0x0AAA_AAAA).unwrap(), &data).unwrap().bits();
                let fixed = 67 + 8 * length as u32;
                assert!(
                    (fixed..=fixed + (54 + 8 * length as u32 - 1) / 4).contains(&bits),
                    "{length} {fill:x}: {bits}"
                );
            }
        }
    }

    #[test]
    fn zeros_are_stuffed_and_a_checkerboard_is_not() {
        // Start, identifier 0, RTR, IDE, r0, DLC 0 and the CRC of nothing but zeros: 34 zeros, and a one after every fifth.
        assert_eq!(standard(0, &[]).bits(), 47 + 6);
        assert_eq!(standard(0x2AA, &[0x55; 2]).bits(), 47 + 16 + 1, "DLC 2 follows three zeros");
    }

    #[test]
    fn a_request_for_data_carries_none() {
        let id = StandardId::new(0x2AA).unwrap();
        assert!(Frame::new_remote(id, 8).unwrap().bits() < 47 + 10);
    }
}

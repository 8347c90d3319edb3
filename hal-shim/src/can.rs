//! CAN: the frames of the embedded-can project, as they stand, and a controller with an inbox of its own for SYNC.

pub use embedded_can::{ExtendedId, Frame, Id, StandardId};

/// Where the controller keeps a frame that has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inbox {
    /// SYNC.
    Sync,
    /// Everything else.
    Others,
}

/// The controller had to drop frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overrun;

/// How the controller is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Trouble {
    /// It is error passive.
    pub passive: bool,
    /// It is off the bus.
    pub bus_off: bool,
}

/// What a receive FIFO of the bxCAN controller shows of its oldest frame: the registers RIR, RDTR, RDLR, RDHR (RM0090 32.9.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FifoWords {
    /// RIR: identifier, identifier extension, remote request.
    pub identifier: u32,
    /// RDTR: the data length code in its lowest four bits.
    pub control: u32,
    /// RDLR and RDHR: the data, little end first.
    pub data: [u32; 2],
}

/// A frame that has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    id: Id,
    remote: bool,
    length: u8,
    data: [u8; 8],
}

/// RIR: the identifier has 29 bits.
const EXTENDED: u32 = 1 << 2;
/// RIR: a frame that asks for data.
const REMOTE: u32 = 1 << 1;

impl FifoWords {
    /// The frame that they stand for. A data length code of 9 to 15 is legal on the wire and means 8 bytes (ISO 11898-1), and
    /// the controller hands it on as it came.
    #[inline]
    pub fn frame(self) -> Received {
        let id = if self.identifier & EXTENDED != 0 {
            Id::Extended(ExtendedId::new(self.identifier >> 3).unwrap_or(ExtendedId::ZERO))
        } else {
            Id::Standard(StandardId::new((self.identifier >> 21) as u16).unwrap_or(StandardId::ZERO))
        };
        let [low, high] = self.data.map(u32::to_le_bytes);
        let ([a, b, c, d], [e, f, g, h]) = (low, high);
        Received {
            id,
            remote: self.identifier & REMOTE != 0,
            length: data_bytes(self.control),
            data: [a, b, c, d, e, f, g, h],
        }
    }
}

/// Bytes of data that the data length code in RDTR stands for.
#[inline]
pub const fn data_bytes(control: u32) -> u8 {
    let code = control as u8 & 0xF;
    if code > 8 { 8 } else { code }
}

impl Frame for Received {
    fn new(id: impl Into<Id>, data: &[u8]) -> Option<Self> {
        let mut bytes = [0; 8];
        bytes.get_mut(..data.len())?.copy_from_slice(data);
        Some(Received { id: id.into(), remote: false, length: data.len() as u8, data: bytes })
    }
    fn new_remote(id: impl Into<Id>, length: usize) -> Option<Self> {
        (length <= 8).then(|| Received { id: id.into(), remote: true, length: length as u8, data: [0; 8] })
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
        let length = if self.remote { 0 } else { self.length.into() };
        self.data.get(..length).unwrap_or(&self.data)
    }
}

/// Frames that have come.
pub trait Inboxes {
    /// A frame.
    type Frame: Frame;
    /// The next frame of an inbox; [`Overrun`] once when the controller had to drop some.
    fn next(&mut self, from: Inbox) -> Option<Result<Self::Frame, Overrun>>;
}

/// The inbox of SYNC, seen from the servo task.
pub trait SyncInbox: Clone {
    /// Length of the SYNC that has come and that nobody has taken yet.
    fn waits(&self) -> Option<u8>;
}

/// Frames that go.
pub trait Mailboxes {
    /// A frame.
    type Frame: Frame;
    /// Hands a frame to a free mailbox. `false` when none is free or a frame of the same identifier still waits; the interrupt
    /// of an empty mailbox says when to try again. Nothing that waits is ever displaced.
    fn send(&mut self, frame: &Self::Frame) -> bool;
    /// Acknowledges the interrupt of an empty mailbox.
    fn acknowledge(&mut self);
}

/// What the controller listens to, and how fast.
pub trait Filters {
    /// Listens to data frames of these identifiers from now on, and to nothing else. No frame is lost over the change.
    fn listen(&mut self, sync: u16, others: &[u16]);
    /// Puts the controller on a bus of this bit rate, bit/s; asked again and again, because a change waits for the end of a frame.
    /// Until the first call it is on none. What waits to be sent is dropped over a change.
    fn join(&mut self, bit_rate: u32);
    /// How the controller is.
    fn trouble(&self) -> Trouble;
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn words(identifier: u32, control: u32, data: [u32; 2]) -> FifoWords {
        FifoWords { identifier, control, data }
    }

    #[test]
    fn a_frame_by_hand() {
        let frame = words(0x601 << 21, 0x0001_0008, [0x4433_2211, 0x8877_6655]).frame();
        assert_eq!(frame.id(), StandardId::new(0x601).unwrap().into());
        assert_eq!(frame.data(), [0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88]);
        let extended = words(0x1234_5678 << 3 | EXTENDED | REMOTE, 3, [0; 2]).frame();
        assert_eq!(extended.id(), ExtendedId::new(0x1234_5678).unwrap().into());
        assert!(extended.is_remote_frame() && extended.data().is_empty());
        assert_eq!(extended.dlc(), 3);
    }

    #[test]
    fn every_length_code_above_eight_means_eight_bytes() {
        for code in 0..16 {
            let frame = words(1 << 21, code, [u32::MAX; 2]).frame();
            assert_eq!(frame.data().len(), code.min(8) as usize, "code {code}");
        }
    }

    proptest! {
        #[test]
        fn any_register_values_are_a_frame(identifier: u32, control: u32, data: [u32; 2]) {
            let frame = words(identifier, control, data).frame();
            prop_assert!(frame.dlc() <= 8 && frame.data().len() <= frame.dlc());
            prop_assert_eq!(frame.is_extended(), identifier & EXTENDED != 0);
            let raw = match frame.id() {
                Id::Standard(id) => u32::from(id.as_raw()) << 21,
                Id::Extended(id) => id.as_raw() << 3,
            };
            let mask = if frame.is_extended() { u32::MAX << 3 } else { u32::MAX << 21 };
            prop_assert_eq!(raw, identifier & mask);
        }
    }
}

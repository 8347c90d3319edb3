//! What surrounds the chip: voltages, pin levels and the CAN bus, seen through one trait.

use crate::can::Frame;

/// A pin: port (0 = A) and number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Pin {
    /// Port, 0 = A.
    pub port: u8,
    /// Number, 0..=15.
    pub number: u8,
}

impl Pin {
    /// Pin of port `port` (a letter A..I), e.g. `Pin::new('A', 8)`.
    ///
    /// # Panics
    /// When there is no such pin.
    pub const fn new(port: char, number: u8) -> Self {
        assert!(port >= 'A' && port <= 'I' && number < 16, "no such pin");
        Self { port: port as u8 - b'A', number }
    }
}

/// What the chip drives a pin with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drive {
    /// Not driven: input, analogue, or an open drain that is off.
    #[default]
    Released,
    /// A steady level.
    Level(bool),
    /// A repeated pulse: high for `high` of every `period` ticks, in force from the time it is reported (which is the
    /// start of a period, unless the waveform was changed inside one).
    Pwm {
        /// Ticks high in each period.
        high: u32,
        /// Ticks of a period.
        period: u32,
    },
}

/// A change at the chip's inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// A pin is now at this level, driven from outside; `None`: left to the chip's own pull resistors.
    Level(Pin, Option<bool>),
    /// A frame of another node has just ended on the bus.
    Can(Frame),
}

/// What the bus made of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CanReply {
    /// Received by at least one node.
    Acknowledged,
    /// No node acknowledged it.
    NoAcknowledge,
    /// A bit read back wrong.
    BitError,
}

/// The outside of the chip. Times are ticks; they never go back.
pub trait World {
    /// Code, 0..=4095, that a 12-bit conversion of analogue input `channel` (0..=18 of converter `adc`, 1..=3) gives when
    /// sampling ends at `at`.
    fn sample(&mut self, adc: u8, channel: u8, at: u64) -> u16;
    /// Tick of the next change, [`crate::NEVER`] if none is known. Asked again after each change and each output.
    fn next_change(&self) -> u64;
    /// Takes the change due at or before `at`, oldest first; `None` when there is no more.
    fn take_change(&mut self, at: u64) -> Option<Change>;
    /// The chip drives `pin` with `drive` from now on.
    fn drive(&mut self, at: u64, pin: Pin, drive: Drive);
    /// The chip has sent `frame`, whose last bit ends at `at`.
    fn can_sent(&mut self, at: u64, frame: Frame) -> CanReply;
    /// Converter channel 1 or 2 puts out `code`, 0..=4095.
    fn dac(&mut self, at: u64, channel: u8, code: u16);
}

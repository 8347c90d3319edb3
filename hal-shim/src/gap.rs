//! Gap-voltage front end at fixed rate.

/// Conversions in one block: 500 kS/s against the 20 kHz servo tick.
pub const BLOCK: usize = 25;

/// One block of gap-voltage conversions, oldest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GapBlock {
    /// Converter codes, 12 bits.
    pub codes: [u16; BLOCK],
    /// Bit i is set when conversion i was taken inside the generator's on-time. The front end clears the bit of a
    /// conversion that straddles an edge, so a held value never contains off-time.
    pub gate: u32,
}

impl GapBlock {
    /// Every conversion of a block gated.
    pub const ALL: u32 = (1 << BLOCK) - 1;
    /// A block of zeros.
    pub const EMPTY: GapBlock = GapBlock { codes: [0; BLOCK], gate: 0 };
}

/// The converter that fills [`GapBlock`]s.
pub trait GapFrontEnd {
    /// Puts the newest complete block into `block`, or `None` when none was completed since the last call.
    fn block(&mut self, block: &mut Option<GapBlock>);
}

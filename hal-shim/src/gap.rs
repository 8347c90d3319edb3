//! Gap front end: conversions at a fixed rate, and the edges that generator and comparators made meanwhile.

/// Conversions in one block: 500 kS/s against the 20 kHz servo tick.
pub const BLOCK: usize = 25;

/// Most edges of a line that a block holds: 320 000 pulses a second.
pub const EDGES: usize = 32;

/// Edges of a line, the oldest first.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Edges {
    /// Times; of those behind the count nothing is to be read.
    pub at: [u16; EDGES],
    /// How many there are.
    pub count: u8,
}

impl Edges {
    /// No edge.
    pub const NONE: Edges = Edges { at: [0; EDGES], count: 0 };

    /// Adds an edge; false when there is no room for it.
    #[inline(always)]
    pub fn push(&mut self, at: u16) -> bool {
        let Some(place) = self.at.get_mut(usize::from(self.count)) else { return false };
        *place = at;
        self.count += 1;
        true
    }

    /// Their times, core cycles since the block began.
    #[inline(always)]
    pub fn times(&self) -> &[u16] {
        self.at.get(..usize::from(self.count)).unwrap_or(&[])
    }
}

impl PartialEq for Edges {
    fn eq(&self, other: &Self) -> bool {
        self.times() == other.times()
    }
}

impl Eq for Edges {}

/// One block of gap-voltage conversions, oldest first, and the edges of the same 50 us.
///
/// Times are core cycles (168 MHz) since the block began. Conversion k samples from 336 k + 216 to 336 k + 336.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GapBlock {
    /// Converter codes, 12 bits.
    pub codes: [u16; BLOCK],
    /// Bit i is set when conversion i was taken inside the generator's on-time. The front end clears the bit of a
    /// conversion that straddles an edge, so a held value never contains off-time.
    pub gate: u32,
    /// Every edge of the gate. Edges of a line are handed over exactly once, and in order.
    pub gate_edges: Edges,
    /// Every edge of the comparator for 70 % of the open-circuit voltage.
    pub high_edges: Edges,
    /// The gate was open when the block began.
    pub gate_was_open: bool,
    /// The voltage was above 70 % when the block began.
    pub was_high: bool,
    /// Rises of the comparator for 20 % of the open-circuit voltage since the block before.
    pub low_rises: u8,
    /// The voltage was above 20 % when the block had ended.
    pub above_low: bool,
}

impl GapBlock {
    /// Every conversion of a block gated.
    pub const ALL: u32 = (1 << BLOCK) - 1;
    /// Cycles of a block.
    pub const CYCLES: u32 = 8400;
    /// Cycles from one conversion to the next.
    pub const SPACING: u32 = Self::CYCLES / BLOCK as u32;
    /// Cycles that a conversion samples.
    pub const APERTURE: u32 = 120;
    /// A block of zeros without an edge.
    pub const EMPTY: GapBlock = GapBlock {
        codes: [0; BLOCK],
        gate: 0,
        gate_edges: Edges::NONE,
        high_edges: Edges::NONE,
        gate_was_open: false,
        was_high: false,
        low_rises: 0,
        above_low: false,
    };
}

/// The converter that fills [`GapBlock`]s.
pub trait GapFrontEnd {
    /// Puts the newest complete block into `block`, or `None` when none was completed since the last call.
    fn block(&mut self, block: &mut Option<GapBlock>);
}

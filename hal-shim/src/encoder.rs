//! Position encoder: two ways to count the same edges, one contract.

/// Levels of the encoder lines, sampled together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Levels {
    /// Channel A.
    pub a: bool,
    /// Channel B, a quarter period behind A when moving toward the work.
    pub b: bool,
    /// Index mark.
    pub index: bool,
}

/// Lines of an incremental encoder, as an edge interrupt reads them.
pub trait QuadratureLines {
    /// Levels now, all three from one read of the port.
    fn levels(&self) -> Levels;
}

/// One reading of an edge counter.
///
/// Both numbers wrap; the reader takes differences. A reading must be taken at least once per 2^31 counts and per 2^31
/// clock ticks (12.7 s at 168 MHz).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RawCount {
    /// Edges counted since power-up, four per encoder line, positive toward the work, wrapping.
    pub count: u32,
    /// Clock time of the newest counted edge; no two edges have the same. A counter that cannot time its edges reports the
    /// time of the first reading that saw the change.
    pub last_edge: u32,
    /// The newest counted edge went toward the work. A line crossed forth and back is no distance: with the direction the
    /// reader knows which line it was, and an axis that trembles over one line has no velocity.
    pub toward_work: bool,
    /// Clock time of this reading.
    pub now: u32,
}

/// Counter of a timer in encoder mode, four counts per encoder line, up toward the work.
pub trait EncoderTimer {
    /// Width of the counter: 16 or 32 bits. It wraps at its full width.
    const BITS: u32;
    /// Counter now.
    fn counter(&self) -> u32;
}

/// Something that counts encoder edges: the edge-interrupt decoder, or a timer in encoder mode.
pub trait EdgeCounter {
    /// Count and times, consistent with each other.
    fn read(&mut self) -> RawCount;
}

/// One of the encoder's interrupt lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Line {
    /// Channel A.
    A,
    /// Channel B.
    B,
    /// Index mark.
    Index,
}

/// An edge that does not simply follow the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// The last one that is served in this tick. It follows the one before.
    Last,
    /// It follows edges that were not served.
    AfterStorm,
}

/// The interrupt lines of an encoder, for the task that serves its edges. Above a rate that leaves no time for the loops they
/// mask themselves: a *storm*.
pub trait EdgeLines: QuadratureLines {
    /// Acknowledges an edge of one line; call before reading the levels, so that an edge in between comes back.
    fn acknowledge(&mut self, line: Line);
    /// Counts an edge. `true` when it simply follows the one before; otherwise [`EdgeLines::unusual`] says what it is.
    fn follows(&mut self) -> bool;
    /// What an edge is that does not simply follow the one before. The last one of a tick masks the lines.
    fn unusual(&mut self) -> Edge;
}

/// The same lines, for slower tasks.
pub trait EdgeGuard: Clone {
    /// Serves edges from now on, once a tick: for the servo task. `true` when the lines had been masked.
    fn serve(&mut self) -> bool;
    /// Edges may have been missed because the core stood still: the next tick takes the count of the second counter.
    fn missed(&mut self);
}

//! The live signal: by its edges the outside knows that the program runs.
//!
//! Outside, a monostable runs for 0.3 to 0.8 ms after each rising edge of *live*. A latch takes over, at each rising edge of
//! *arm*, whether it runs, and lets go as soon as it does not. Pulses and bridge need the latch as well as their own lines,
//! so a program that has stopped, for whatever reason, has switched both off within a millisecond, and one that goes on
//! later does not switch them on again by itself.

/// The three lines.
pub trait Live {
    /// The other level, while it runs: the last thing that a servo tick does. No timer and no DMA makes an edge.
    fn toggle(&mut self);
    /// Whether [`toggle`](Live::toggle) makes edges; the level stays where it is otherwise. None at the start.
    fn run(&mut self, runs: bool);
    /// The level that arms with its rising edge.
    fn arm(&mut self, high: bool);
    /// The latch holds: pulses and bridge may be switched on.
    fn armed(&self) -> bool;
}

//! Free-running time.

/// A free-running counter of constant rate.
pub trait Clock {
    /// Rate, Hz.
    const HZ: u32;
    /// Ticks since an arbitrary start, wrapping.
    fn now(&self) -> u32;
    /// Restarts it where something outside the program has stopped it.
    fn restart(&self) {}
}

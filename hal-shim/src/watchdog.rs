//! The watchdog, which resets a program that has stopped to feed it.

/// It did not take a new time-out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stuck;

/// A watchdog that runs.
pub trait Watchdog {
    /// Another time-out.
    fn feed(&mut self);
    /// Makes room for an erase of flash, during which nothing can feed it. Only while disabled and inhibited.
    ///
    /// # Errors
    /// [`Stuck`]; the time-out before is in force.
    fn erase(&mut self) -> Result<(), Stuck>;
    /// Watches closely again.
    ///
    /// # Errors
    /// [`Stuck`]; the time-out before is in force.
    fn normal(&mut self) -> Result<(), Stuck>;
    /// A task has fallen silent: everything off, and not fed any more.
    fn silent(&mut self, task: usize);
}

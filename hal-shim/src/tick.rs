//! Timers that call a task at a fixed rate.

/// The timer of the servo tick, which is that of the PWM.
pub trait ServoTimer {
    /// Acknowledges the tick.
    fn acknowledge(&mut self);
    /// Clock ticks since the tick was due.
    fn since_due(&self) -> u32;
    /// Connects the output of the PWM; the hardware refuses while the bridge reports a fault.
    fn arm(&mut self);
}

/// A timer of a slower task, which others may call as well.
pub trait Period {
    /// Acknowledges; whether a period has begun since the last call.
    fn begins(&mut self) -> bool;
}

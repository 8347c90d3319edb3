//! What can go wrong before the head runs, each with its name.

/// Why the head did not start. It stays disabled and inhibited.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub enum StartError {
    /// The crystal does not oscillate.
    Crystal,
    /// The PLL does not lock.
    Pll,
    /// The core does not switch to the PLL.
    ClockSwitch,
    /// A DMA stream does not stop to be configured.
    DmaStream,
    /// No block of conversions within two ticks: converter, its trigger or its DMA.
    NoConversions,
    /// The gated converter does not answer.
    NoGatedConversions,
    /// The CAN controller does not enter initialisation.
    CanInitialisation,
    /// The watchdog does not take its time-out.
    Watchdog,
    /// The settings do not build into something that can run.
    Settings,
    /// The bridge's outputs cannot be set.
    Bridge,
    /// Core-coupled memory was taken already.
    Memory,
}

/// Polls until `ready`, at most `polls` times.
pub fn within(polls: u32, mut ready: impl FnMut() -> bool, error: StartError) -> Result<(), StartError> {
    for _ in 0..polls {
        if ready() {
            return Ok(());
        }
    }
    Err(error)
}

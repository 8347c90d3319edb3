//! What a head does that did not start.

use super::lines;
use super::start::StartError;
use super::watchdog::Watchdog;
use crate::watchdog::Watchdog as _;

/// Pins off, the LED blinks, the log says why, for as long as there is power.
pub fn halt(error: StartError, mut watchdog: Option<Watchdog>) -> ! {
    lines::kill();
    defmt::error!("start: {}", error);
    let mut lit = false;
    loop {
        lit = !lit;
        lines::led(lit);
        for _ in 0..100 {
            if let Some(watchdog) = &mut watchdog {
                watchdog.feed();
            }
            // Some milliseconds, at any clock.
            cortex_m::asm::delay(200_000);
        }
    }
}

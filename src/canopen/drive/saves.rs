//! How often a host may have the flash written.
//!
//! A sector of the STM32F405 lasts 10 000 erasures (its data sheet), and nine images fit it today: two sectors take
//! 180 000. A host that saves in a loop writes 260 a second, and would wear them out in twelve minutes; at one a minute they last
//! four months of saving without a pause. Who sets a head up saves a few times in a row, which is let pass.

use crate::canopen::Time;

/// Saves in a row.
const MOST: u8 = 16;
/// Time after which there is one more, us.
const EACH_US: u64 = 60_000_000;

/// Saves and restores that are left.
#[derive(Debug)]
pub(super) struct Saves {
    left: u8,
    /// When there was one more, or might have been.
    since: Time,
}

impl Saves {
    pub const fn new() -> Saves {
        Saves { left: MOST, since: Time(0) }
    }

    /// Counts the time.
    pub fn poll(&mut self, now: Time) {
        if self.left == MOST {
            self.since = now;
        } else if now.0.saturating_sub(self.since.0) >= EACH_US {
            self.since = now;
            self.left = self.left.saturating_add(1);
        }
    }

    /// Takes one; false when there is none.
    pub fn take(&mut self) -> bool {
        let any = self.left > 0;
        self.left = self.left.saturating_sub(1);
        any
    }
}

//! Independent watchdog at the nominal 32 kHz of its oscillator (RM0090 §21).

use crate::error::Fault;
use crate::{NEVER, TICK_HZ};

/// Ticks of one LSI period.
const LSI: u64 = TICK_HZ / 32_000;

#[derive(Clone)]
pub struct Iwdg {
    prescaler: u32,
    reload: u32,
    unlocked: bool,
    /// Tick of the reset it will cause.
    pub due: u64,
}

impl Iwdg {
    pub fn new() -> Self {
        Self { prescaler: 0, reload: 0xfff, unlocked: false, due: NEVER }
    }

    fn period(&self) -> u64 {
        // Divider 4 << PR, 256 at most (§21.4.2).
        (LSI * (4 << self.prescaler.min(6))) * u64::from(self.reload + 1)
    }

    pub fn read(&self, offset: u32) -> Result<u32, Fault> {
        Ok(match offset {
            0x00 => 0,
            0x04 => self.prescaler,
            0x08 => self.reload,
            // PVU and RVU: an update is taken as done at once.
            0x0c => 0,
            _ => return Err(Fault::Unmodelled),
        })
    }

    /// Returns whether the watchdog was started.
    pub fn write(&mut self, offset: u32, value: u32, now: u64) -> Result<bool, Fault> {
        match offset {
            0x00 => {
                self.unlocked = value & 0xffff == 0x5555;
                match value & 0xffff {
                    0xcccc => {
                        self.due = now + self.period();
                        return Ok(true);
                    }
                    0xaaaa if self.due != NEVER => self.due = now + self.period(),
                    _ => (),
                }
            }
            // Protected until 0x5555 is written (§21.3.3).
            0x04 if self.unlocked => self.prescaler = value & 7,
            0x08 if self.unlocked => self.reload = value & 0xfff,
            0x04 | 0x08 => (),
            _ => return Err(Fault::Unmodelled),
        }
        Ok(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_period_is_about_32_8_seconds() {
        let mut w = Iwdg::new();
        w.write(0, 0x5555, 0).unwrap();
        w.write(4, 6, 0).unwrap();
        w.write(8, 0xfff, 0).unwrap();
        w.write(0, 0xcccc, 0).unwrap();
        assert_eq!(w.due, TICK_HZ * 32_768 / 1000);
    }

    #[test]
    fn a_reload_starts_the_period_anew_and_settings_are_protected() {
        let mut w = Iwdg::new();
        w.write(8, 1, 0).unwrap();
        assert_eq!(w.read(8), Ok(0xfff));
        w.write(0, 0xcccc, 0).unwrap();
        let first = w.due;
        w.write(0, 0xaaaa, 1000).unwrap();
        assert_eq!(w.due, first + 1000);
    }

    #[test]
    fn feeding_does_not_start_it() {
        let mut w = Iwdg::new();
        w.write(0, 0xaaaa, 0).unwrap();
        assert_eq!(w.due, NEVER);
    }
}

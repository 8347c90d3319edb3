//! Outputs: reference levels and the waveform in force at a pin (RM0090 §18.3.7..10, §17.3.13).

use super::{Event, Timer, cr1};
use crate::world::Drive;

impl Timer {
    /// Recomputes the references of the modes that follow the counter or are forced.
    pub(super) fn references(&mut self, out: &mut Vec<Event>) {
        for c in 0..self.kind.channels {
            if !self.is_output(c) {
                continue;
            }
            let level = match self.channel_mode(c) >> 4 & 7 {
                4 => false,
                5 => true,
                6 => self.cnt < self.ccr_now[c],
                7 => self.cnt >= self.ccr_now[c],
                _ => continue,
            };
            self.set_reference(c, level, out);
        }
    }

    pub(super) fn set_reference(&mut self, c: usize, level: bool, out: &mut Vec<Event>) {
        if self.reference[c] == level {
            return;
        }
        self.reference[c] = level;
        if level {
            self.trgo_if(4 + c as u32, out);
        }
        if self.channel_enabled(c) {
            out.push(Event::Output(c as u8, level));
        }
        if self.channel_mode(c) >> 4 & 7 < 6 {
            out.push(Event::Waveform);
        }
    }

    /// What channel `c` (index) drives its pin with.
    pub fn drive(&self, c: usize) -> Drive {
        if !self.is_output(c) || !self.channel_enabled(c) {
            return Drive::Released;
        }
        if self.kind.advanced && self.bdtr & 1 << 15 == 0 {
            // Main output off: idle level when OSSI holds it, else let go (§17.4.9, table of output control bits).
            let idle = self.cr2 >> (8 + 2 * c) & 1 == 1;
            return if self.bdtr & 1 << 10 != 0 { Drive::Level(idle) } else { Drive::Released };
        }
        let inverted = self.ccer >> (4 * c) & 2 != 0;
        let counts = u64::from(self.arr_now) + 1;
        let below = u64::from(self.ccr_now[c]).min(counts);
        let active = match self.channel_mode(c) >> 4 & 7 {
            6 if self.cr1 & cr1::CEN != 0 => below,
            7 if self.cr1 & cr1::CEN != 0 => counts - below,
            _ => return Drive::Level(self.reference[c] ^ inverted),
        };
        let high = if inverted { counts - active } else { active };
        match high {
            0 => Drive::Level(false),
            h if h == counts => Drive::Level(true),
            h => Drive::Pwm { high: (h * self.step()) as u32, period: (counts * self.step()) as u32 },
        }
    }
}

//! The counter: prescaler, wrap, update event, compare matches (RM0090 §18.3.1..2, §18.3.8).

use super::{Event, Timer, cr1, sr};
use crate::NEVER;

impl Timer {
    /// Whether the counter runs from the internal clock. A reload value of zero blocks it (§18.3.1).
    fn ticking(&self) -> bool {
        let external = self.encoder() || self.sms() == 7 || self.smcr & 1 << 14 != 0;
        self.cr1 & cr1::CEN != 0 && !external && self.arr_now != 0 && self.clock != 0
    }

    /// Ticks of one count.
    pub(super) fn step(&self) -> u64 {
        self.clock * (u64::from(self.psc_now) + 1)
    }

    /// Value after which the counter returns to zero; a counter already past its reload value runs to the end.
    fn top(&self) -> u32 {
        if self.cnt > self.arr_now { self.mask() } else { self.arr_now }
    }

    /// Tick of the next wrap, or of the next match that is waited for.
    pub(super) fn next_count(&self) -> u64 {
        if !self.ticking() {
            return NEVER;
        }
        let mut counts = u64::from(self.top() - self.cnt) + 1;
        for c in 0..self.kind.channels {
            let waited = self.dier & sr::cc(c) != 0 || self.channel_enabled(c) || self.cr2 & 0x70 >= 0x30;
            if waited && self.is_output(c) && self.ccr_now[c] > self.cnt {
                counts = counts.min(u64::from(self.ccr_now[c] - self.cnt));
            }
        }
        self.base + counts * self.step()
    }

    /// Ticks between two update events, if it does nothing but trigger with each from now on: no interrupt, no DMA, no output, no
    /// value that comes into force, no input on its way.
    pub fn routine(&self) -> Option<u64> {
        let triggers = self.cr2 & 0x70 == 0x20 && self.cr1 & (cr1::UDIS | cr1::OPM) == 0;
        let silent = self.dier == 0 && self.ccer == 0 && self.ccmr == [0; 2] && self.due() == self.next_count();
        let steady = (self.psc, self.arr, self.ccr) == (self.psc_now, self.arr_now, self.ccr_now);
        let each = (self.rcr, self.repeat) == (0, 0) && self.cnt <= self.arr_now;
        (self.ticking() && triggers && silent && steady && each).then(|| (u64::from(self.arr_now) + 1) * self.step())
    }

    /// It has done so a number of times.
    pub fn done_routine(&mut self, times: u64, period: u64, out: &mut Vec<Event>) {
        if let Some(more) = times.checked_sub(1) {
            // One time is like the other.
            self.settle(self.next_count(), out);
            self.base += more * period;
        }
    }

    /// Brings counter and flags up to `now`.
    pub(super) fn settle(&mut self, now: u64, out: &mut Vec<Event>) {
        while self.ticking() {
            let step = self.step();
            let counts = now.saturating_sub(self.base) / step;
            if counts == 0 {
                return;
            }
            let to_wrap = u64::from(self.top() - self.cnt) + 1;
            if counts < to_wrap {
                self.base += counts * step;
                self.advance(self.cnt + counts as u32, out);
                return;
            }
            self.base += to_wrap * step;
            self.advance(self.top(), out);
            self.overflow(out);
        }
    }

    /// Counts from `cnt` up to `to` without wrapping.
    fn advance(&mut self, to: u32, out: &mut Vec<Event>) {
        let from = self.cnt;
        self.cnt = to;
        for c in 0..self.kind.channels {
            if from < self.ccr_now[c] && self.ccr_now[c] <= to {
                self.matched(c, out);
            }
        }
        self.references(out);
    }

    fn matched(&mut self, c: usize, out: &mut Vec<Event>) {
        if !self.is_output(c) {
            return;
        }
        self.sr |= sr::cc(c);
        self.dma_if(c as u8 + 1, out);
        if c == 0 {
            self.trgo_if(3, out);
        }
        match self.channel_mode(c) >> 4 & 7 {
            1 => self.set_reference(c, true, out),
            2 => self.set_reference(c, false, out),
            3 => self.set_reference(c, !self.reference[c], out),
            _ => (),
        }
    }

    fn overflow(&mut self, out: &mut Vec<Event>) {
        self.cnt = 0;
        // A compare value beyond the reload value matches at the overflow (§18.4.5, CC1IF).
        for c in 0..self.kind.channels {
            if self.ccr_now[c] > self.arr_now {
                self.matched(c, out);
            }
        }
        if self.cr1 & cr1::OPM != 0 {
            self.cr1 &= !cr1::CEN;
        }
        if self.repeat > 0 {
            self.repeat -= 1;
        } else {
            self.update(true, out);
        }
        for c in 0..self.kind.channels {
            if self.ccr_now[c] == 0 {
                self.matched(c, out);
            }
        }
        self.references(out);
    }

    /// Update event: preloaded values come into force (§18.3.2).
    fn update(&mut self, overflow: bool, out: &mut Vec<Event>) {
        if self.cr1 & cr1::UDIS != 0 {
            return;
        }
        let before = (self.psc_now, self.arr_now, self.ccr_now);
        self.repeat = self.rcr;
        self.psc_now = self.psc;
        self.arr_now = self.arr;
        for c in 0..self.kind.channels {
            if self.is_output(c) {
                self.ccr_now[c] = self.ccr[c];
            }
        }
        if overflow || self.cr1 & cr1::URS == 0 {
            self.sr |= sr::UIF;
        }
        self.dma_if(0, out);
        self.trgo_if(2, out);
        if before != (self.psc_now, self.arr_now, self.ccr_now) {
            out.push(Event::Waveform);
        }
    }

    /// Counter and prescaler to zero with an update event, as UG and the slave reset mode do (§18.3.14).
    pub(super) fn reinitialise(&mut self, now: u64, out: &mut Vec<Event>) {
        self.cnt = 0;
        self.sub = 0;
        self.base = now;
        self.update(false, out);
        self.references(out);
        out.push(Event::Waveform);
    }

    /// One count of an external clock or of the encoder interface.
    pub(super) fn count_external(&mut self, up: bool, out: &mut Vec<Event>) {
        if self.cr1 & cr1::CEN == 0 || self.arr_now == 0 {
            return;
        }
        if self.sub < self.psc_now {
            self.sub += 1;
            return;
        }
        self.sub = 0;
        match (up, self.cnt) {
            (true, c) if c == self.top() => self.overflow(out),
            (true, c) => self.advance(c + 1, out),
            (false, 0) => {
                self.cnt = self.arr_now;
                self.update(true, out);
            }
            (false, c) => self.cnt = c - 1,
        }
        self.references(out);
    }
}

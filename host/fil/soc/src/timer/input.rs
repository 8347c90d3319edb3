//! Inputs: digital filter, capture, encoder interface, slave mode controller, external trigger, break
//! (RM0090 §18.3.5, §18.3.12, §18.3.14, §17.3.12).

use super::{Event, Timer, cr1, sr};
use crate::NEVER;

/// A level that has to stay for a while before it counts.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Filtered {
    level: bool,
    pending: Option<u64>,
}

impl Filtered {
    pub(super) fn due(&self) -> u64 {
        self.pending.unwrap_or(NEVER)
    }

    /// The pin is now at `level`; returns whether the filtered level changes at once.
    fn set(&mut self, level: bool, delay: u64, now: u64) -> bool {
        self.pending = None;
        if level == self.level {
            return false;
        }
        if delay > 0 {
            self.pending = Some(now + delay);
            return false;
        }
        self.level = level;
        true
    }

    fn settle(&mut self, now: u64) -> bool {
        let change = self.due() <= now;
        if change {
            (self.level, self.pending) = (!self.level, None);
        }
        change
    }
}

/// Sampling divider and number of equal samples of a filter setting (§18.4.7, IC1F).
const FILTER: [(u64, u64); 16] = [
    (1, 0),
    (1, 2),
    (1, 4),
    (1, 8),
    (2, 6),
    (2, 8),
    (4, 6),
    (4, 8),
    (8, 6),
    (8, 8),
    (16, 5),
    (16, 6),
    (16, 8),
    (32, 5),
    (32, 6),
    (32, 8),
];

impl Timer {
    fn filter_delay(&self, setting: u32) -> u64 {
        let (divider, samples) = FILTER[(setting & 15) as usize];
        // Settings 1..=3 sample at the timer clock, the others at DTS (CKD divides by 1, 2, 4).
        let dts = if setting > 3 { 1 << (self.cr1 >> 8 & 3) } else { 1 };
        self.clock * divider * samples * dts
    }

    /// Channel input `ti` (index 0..=3) changes to `level`.
    pub fn set_input(&mut self, ti: usize, level: bool, now: u64, out: &mut Vec<Event>) {
        self.settle(now, out);
        let setting = if self.is_output(ti) { 0 } else { self.channel_mode(ti) >> 4 };
        let delay = self.filter_delay(setting);
        if self.inputs[ti].set(level, delay, now) {
            self.input_edge(ti, now, out);
        }
    }

    /// External trigger input changes to `level`.
    pub fn set_etr(&mut self, level: bool, now: u64, out: &mut Vec<Event>) {
        self.settle(now, out);
        let delay = self.filter_delay(self.smcr >> 8);
        if self.etr.set(level, delay, now) {
            self.etr_edge(now, out);
        }
    }

    /// Break input: `level` of the pin, `None` when no pin leads here.
    pub fn set_break(&mut self, level: Option<bool>, out: &mut Vec<Event>) {
        let polarity = self.bdtr & 1 << 13 != 0;
        self.break_active = level == Some(polarity);
        if self.break_active && self.bdtr & 1 << 12 != 0 {
            self.trip();
            out.push(Event::Waveform);
        }
    }

    /// Break event: outputs to their idle state by hardware.
    pub(super) fn trip(&mut self) {
        self.bdtr &= 0x7fff;
        self.sr |= sr::BIF;
    }

    pub(super) fn settle_inputs(&mut self, now: u64, out: &mut Vec<Event>) {
        for ti in 0..self.kind.channels {
            if self.inputs[ti].settle(now) {
                self.input_edge(ti, now, out);
            }
        }
        if self.etr.settle(now) {
            self.etr_edge(now, out);
        }
    }

    fn input_edge(&mut self, ti: usize, now: u64, out: &mut Vec<Event>) {
        let level = self.inputs[ti].level;
        for c in 0..self.kind.channels {
            // CCxS: 1 its own input, 2 the other of the pair.
            let source = match self.channel_mode(c) & 3 {
                1 => c,
                2 => c ^ 1,
                _ => continue,
            };
            if source == ti && self.channel_enabled(c) && self.active_edge(c, level) {
                self.capture(c, out);
            }
        }
        if self.encoder() {
            self.encoder_edge(ti, out);
            return;
        }
        let triggered = match self.smcr >> 4 & 7 {
            4 => ti == 0,
            5 => ti == 0 && self.active_edge(0, level),
            6 => ti == 1 && self.active_edge(1, level),
            _ => false,
        };
        if triggered && self.sms() != 0 {
            self.trigger(now, out);
        }
    }

    /// Whether a change to `level` is the edge that CCxP and CCxNP select (§18.4.9).
    fn active_edge(&self, c: usize, level: bool) -> bool {
        match self.ccer >> (4 * c) & 0xa {
            0 => level,
            2 => !level,
            _ => true,
        }
    }

    pub(super) fn capture(&mut self, c: usize, out: &mut Vec<Event>) {
        if self.sr & sr::cc(c) != 0 {
            self.sr |= 1 << (9 + c);
        }
        self.sr |= sr::cc(c);
        self.ccr[c] = self.cnt;
        self.ccr_now[c] = self.cnt;
        self.dma_if(c as u8 + 1, out);
    }

    /// Table of counting direction against encoder signals (§18.3.12).
    fn encoder_edge(&mut self, ti: usize, out: &mut Vec<Event>) {
        let counted = match self.sms() {
            1 => ti == 1,
            2 => ti == 0,
            _ => ti < 2,
        };
        if !counted {
            return;
        }
        let level = |i: usize| self.inputs[i].level ^ (self.ccer >> (4 * i) & 2 != 0);
        // On an edge of TI1 the levels are equal when counting down, on an edge of TI2 when counting up.
        let up = (level(0) == level(1)) == (ti == 1);
        self.cr1 = self.cr1 & !cr1::DIR | if up { 0 } else { cr1::DIR };
        self.count_external(up, out);
    }

    fn etr_edge(&mut self, now: u64, out: &mut Vec<Event>) {
        let rising = self.etr.level ^ (self.smcr & 1 << 15 != 0);
        if !rising {
            return;
        }
        self.etr_edges = (self.etr_edges + 1) & ((1 << (self.smcr >> 12 & 3)) - 1);
        if self.etr_edges != 0 {
            return;
        }
        if self.smcr & 1 << 14 != 0 {
            self.count_external(true, out);
        } else if self.smcr >> 4 & 7 == 7 {
            self.trigger(now, out);
        }
    }

    /// Whether internal trigger `itr` (0..=3) is the selected trigger input and something waits for it.
    pub fn listens(&self, itr: u32) -> bool {
        self.kind.slave && self.sms() != 0 && self.smcr >> 4 & 7 == itr
    }

    /// The selected trigger input is active.
    pub fn trigger(&mut self, now: u64, out: &mut Vec<Event>) {
        self.settle(now, out);
        match self.sms() {
            4 => {
                self.reinitialise(now, out);
                self.trgo_if(0, out);
            }
            6 if self.cr1 & cr1::CEN == 0 && self.clock != 0 => {
                self.cr1 |= cr1::CEN;
                self.base = now;
                self.trgo_if(1, out);
                out.push(Event::Waveform);
            }
            7 => self.count_external(true, out),
            _ => (),
        }
        self.sr |= sr::TIF;
        self.dma_if(6, out);
    }
}

//! Analogue-to-digital converters 1..3 (RM0090 §13): regular and injected sequences, triggers, watchdog, overrun.
//!
//! A conversion samples at the end of its sampling time and is done 12 converter clocks later (10, 8, 6 at less
//! resolution). Not modelled: discontinuous, dual and triple modes, automatic injection, and the 3 us after power-up.

use crate::error::Fault;
use crate::{NEVER, World};

mod sr {
    pub const AWD: u32 = 1;
    pub const EOC: u32 = 2;
    pub const JEOC: u32 = 4;
    pub const JSTRT: u32 = 8;
    pub const STRT: u32 = 16;
    pub const OVR: u32 = 32;
}

/// Sampling times, converter clocks (§13.13.4).
const SAMPLING: [u64; 8] = [3, 15, 28, 56, 84, 112, 144, 480];

/// Source of a trigger, as a converter selects it (§13.6, tables of EXTSEL and JEXTSEL).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trigger {
    /// Trigger output of a timer.
    Trgo(u8),
    /// Compare output of a timer: timer, channel 1..=4.
    Output(u8, u8),
    /// EXTI line.
    Exti(u8),
}

const REGULAR: [Trigger; 16] = [
    Trigger::Output(1, 1),
    Trigger::Output(1, 2),
    Trigger::Output(1, 3),
    Trigger::Output(2, 2),
    Trigger::Output(2, 3),
    Trigger::Output(2, 4),
    Trigger::Trgo(2),
    Trigger::Output(3, 1),
    Trigger::Trgo(3),
    Trigger::Output(4, 4),
    Trigger::Output(5, 1),
    Trigger::Output(5, 2),
    Trigger::Output(5, 3),
    Trigger::Output(8, 1),
    Trigger::Trgo(8),
    Trigger::Exti(11),
];

const INJECTED: [Trigger; 16] = [
    Trigger::Output(1, 4),
    Trigger::Trgo(1),
    Trigger::Output(2, 1),
    Trigger::Trgo(2),
    Trigger::Output(3, 2),
    Trigger::Output(3, 4),
    Trigger::Output(4, 1),
    Trigger::Output(4, 2),
    Trigger::Output(4, 3),
    Trigger::Trgo(4),
    Trigger::Output(5, 4),
    Trigger::Trgo(5),
    Trigger::Output(8, 2),
    Trigger::Output(8, 3),
    Trigger::Output(8, 4),
    Trigger::Exti(15),
];

/// What a converter does each time it is triggered, where that is one conversion which its stream takes away.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Routine {
    /// What triggers it.
    pub source: Trigger,
    /// What it converts.
    pub channel: u8,
    /// Ticks from the trigger until sampling ends, and until the conversion is done.
    pub sampled: u64,
    /// See `sampled`.
    pub done: u64,
}

#[derive(Clone, Copy, Debug)]
struct Conversion {
    channel: u8,
    injected: bool,
    sampled: u64,
    done: u64,
}

#[derive(Clone)]
pub struct Adc {
    number: u8,
    sr: u32,
    cr1: u32,
    cr2: u32,
    smpr: [u32; 2],
    jofr: [u32; 4],
    high: u32,
    low: u32,
    sqr: [u32; 3],
    jsqr: u32,
    jdr: [u32; 4],
    dr: u32,
    /// Ticks of a converter clock.
    pub clock: u64,
    running: Option<Conversion>,
    position: usize,
    injected_position: usize,
    /// A regular sequence was interrupted by an injected one.
    resume: bool,
    unread: bool,
    /// DMA requests are stopped until the DMA bit is set anew (§13.8.1).
    dma_stopped: bool,
    /// It converts no more.
    stopped: bool,
}

impl Adc {
    pub fn new(number: u8) -> Self {
        Self {
            number,
            sr: 0,
            cr1: 0,
            cr2: 0,
            smpr: [0; 2],
            jofr: [0; 4],
            high: 0xfff,
            low: 0,
            sqr: [0; 3],
            jsqr: 0,
            jdr: [0; 4],
            dr: 0,
            clock: 0,
            running: None,
            position: 0,
            injected_position: 0,
            resume: false,
            unread: false,
            dma_stopped: false,
            stopped: false,
        }
    }

    /// Stops it for good.
    pub fn stop(&mut self) {
        self.stopped = true;
        self.running = None;
    }

    pub fn due(&self) -> u64 {
        self.running.map_or(NEVER, |c| c.done)
    }

    pub fn request(&self) -> bool {
        let enabled = |enable: u32, flag: u32| self.cr1 >> enable & 1 == 1 && self.sr & flag != 0;
        enabled(5, sr::EOC) || enabled(6, sr::AWD) || enabled(7, sr::JEOC) || enabled(26, sr::OVR)
    }

    /// Flags, as the common status register shows them (§13.13.15).
    pub fn flags(&self) -> u32 {
        self.sr
    }

    pub fn read(&mut self, offset: u32) -> Result<u32, Fault> {
        Ok(match offset {
            0x00 => self.sr,
            0x04 => self.cr1,
            0x08 => self.cr2,
            0x0c | 0x10 => self.smpr[(offset as usize - 0x0c) / 4],
            0x14..=0x20 => self.jofr[(offset as usize - 0x14) / 4],
            0x24 => self.high,
            0x28 => self.low,
            0x2c..=0x34 => self.sqr[(offset as usize - 0x2c) / 4],
            0x38 => self.jsqr,
            0x3c..=0x48 => self.jdr[(offset as usize - 0x3c) / 4],
            0x4c => {
                self.sr &= !sr::EOC;
                self.unread = false;
                self.dr
            }
            _ => return Err(Fault::Unmodelled),
        })
    }

    pub fn write(&mut self, offset: u32, value: u32, now: u64) -> Result<(), Fault> {
        match offset {
            0x00 => self.sr &= value,
            0x04 if value & 0x1c00 != 0 => {
                return Err(Fault::Unsupported("discontinuous mode and automatic injection are not modelled"));
            }
            0x04 => self.cr1 = value & 0x07c0_fbff,
            0x08 => self.write_cr2(value, now)?,
            0x0c | 0x10 => self.smpr[(offset as usize - 0x0c) / 4] = value,
            0x14..=0x20 => self.jofr[(offset as usize - 0x14) / 4] = value & 0xfff,
            0x24 => self.high = value & 0xfff,
            0x28 => self.low = value & 0xfff,
            0x2c..=0x34 => self.sqr[(offset as usize - 0x2c) / 4] = value,
            0x38 => self.jsqr = value & 0x3f_ffff,
            _ => return Err(Fault::Unmodelled),
        }
        Ok(())
    }

    fn write_cr2(&mut self, value: u32, now: u64) -> Result<(), Fault> {
        if value & 1 << 11 != 0 {
            return Err(Fault::Unsupported("left alignment is not modelled"));
        }
        if value & 1 != 0 && self.clock == 0 {
            return Err(Fault::Unsupported("converter clock above 36 MHz, or not a divisor of 168 MHz"));
        }
        if value & 1 << 8 != 0 && self.cr2 & 1 << 8 == 0 {
            self.dma_stopped = false;
        }
        self.cr2 = value & 0x3f7f_0703;
        if value & 1 == 0 {
            self.running = None;
            self.resume = false;
            return Ok(());
        }
        if value & 1 << 30 != 0 {
            self.start(now);
        }
        if value & 1 << 22 != 0 {
            self.start_injected(now);
        }
        Ok(())
    }

    /// `source` is active with a rising (or falling) edge. Returns whether this converter listens to it.
    pub fn trigger(&mut self, source: Trigger, rising: bool, now: u64) -> bool {
        let edge = if rising { 1 } else { 2 };
        let regular = self.cr2 >> 28 & edge != 0 && REGULAR[(self.cr2 >> 24 & 15) as usize] == source;
        let injected = self.cr2 >> 20 & edge != 0 && INJECTED[(self.cr2 >> 16 & 15) as usize] == source;
        if regular {
            self.start(now);
        }
        if injected {
            self.start_injected(now);
        }
        regular || injected
    }

    /// Whether `source` triggers anything here.
    pub fn listens(&self, source: Trigger) -> bool {
        let regular = self.cr2 >> 28 & 3 != 0 && REGULAR[(self.cr2 >> 24 & 15) as usize] == source;
        regular || self.cr2 >> 20 & 3 != 0 && INJECTED[(self.cr2 >> 16 & 15) as usize] == source
    }

    fn start(&mut self, now: u64) {
        // An overrun stops the converter until it is cleared (§13.8.2); a trigger inside a sequence is not seen.
        if self.cr2 & 1 == 0 || self.sr & sr::OVR != 0 || self.running.is_some() || self.stopped {
            return;
        }
        self.position = 0;
        self.sr |= sr::STRT;
        self.begin(false, now);
    }

    fn start_injected(&mut self, now: u64) {
        match self.running {
            _ if self.cr2 & 1 == 0 || self.stopped => return,
            Some(Conversion { injected: true, .. }) => return,
            // The regular conversion is reset and done again afterwards (§13.3.9).
            Some(_) => self.resume = true,
            None => (),
        }
        self.injected_position = 3 - (self.jsqr >> 20 & 3) as usize;
        self.sr |= sr::JSTRT;
        self.begin(true, now);
    }

    /// Length of the regular sequence; without SCAN only its first channel is converted.
    fn length(&self) -> usize {
        if self.cr1 & 1 << 8 == 0 { 1 } else { (self.sqr[0] >> 20 & 15) as usize + 1 }
    }

    fn begin(&mut self, injected: bool, now: u64) {
        let channel = if injected {
            self.jsqr >> (5 * self.injected_position) & 31
        } else {
            let p = self.position;
            self.sqr[2 - p / 6] >> (5 * (p % 6)) & 31
        };
        let sampled = now + self.sampling(channel);
        let bits = 12 - 2 * u64::from(self.cr1 >> 24 & 3);
        self.running =
            Some(Conversion { channel: channel as u8, injected, sampled, done: sampled + self.clock * bits });
    }

    /// Ticks for which a channel is sampled.
    fn sampling(&self, channel: u32) -> u64 {
        let setting = if channel < 10 { self.smpr[1] >> (3 * channel) } else { self.smpr[0] >> (3 * (channel - 10)) };
        self.clock * SAMPLING[(setting & 7) as usize]
    }

    /// What it does from now on, if that is the same each time, with no interrupt and nothing injected.
    pub fn routine(&self) -> Option<Routine> {
        let at_rest = self.running.is_none() && !self.stopped && !self.unread && !self.dma_stopped;
        // One channel at full resolution, no watchdog, no interrupts; DMA, not continuous, rising edge alone, nothing injected.
        let plain = self.cr1 == 0 && self.cr2 & 0x3030_0503 == 0x1000_0101;
        if !at_rest || !plain || self.sr & sr::OVR != 0 {
            return None;
        }
        let channel = self.sqr[2] & 31;
        let sampled = self.sampling(channel);
        let source = REGULAR[(self.cr2 >> 24 & 15) as usize];
        Some(Routine { source, channel: channel as u8, sampled, done: sampled + 12 * self.clock })
    }

    /// It has done so, and gave `code` the last time.
    pub fn done_routine(&mut self, code: u32) {
        (self.position, self.dr) = (1, code);
        self.sr = self.sr & !sr::EOC | sr::STRT;
    }

    /// A conversion is done. Returns whether it requests a DMA transfer of DR.
    pub fn fire(&mut self, now: u64, world: &mut impl World) -> bool {
        let Some(c) = self.running.take_if(|c| c.done <= now) else { return false };
        let code = u32::from(world.sample(self.number, c.channel, c.sampled)).min(0xfff);
        self.watch(c, code);
        // Less resolution keeps the upper bits, aligned right (§13.7).
        let code = code >> (2 * (self.cr1 >> 24 & 3));
        if c.injected { self.finish_injected(c, code) } else { self.finish(c, code) }
    }

    fn watch(&mut self, c: Conversion, code: u32) {
        let enable = if c.injected { 22 } else { 23 };
        let single = self.cr1 & 1 << 9 != 0 && self.cr1 & 31 != u32::from(c.channel);
        if self.cr1 >> enable & 1 == 1 && !single && (code > self.high || code < self.low) {
            self.sr |= sr::AWD;
        }
    }

    fn finish_injected(&mut self, c: Conversion, code: u32) -> bool {
        let first = 3 - (self.jsqr >> 20 & 3) as usize;
        let rank = self.injected_position - first;
        // Offset subtracted, sign extended to 16 bits (§13.13.6, §13.13.12).
        self.jdr[rank] = code.wrapping_sub(self.jofr[rank]) & 0xffff;
        if self.injected_position < 3 {
            self.injected_position += 1;
            self.begin(true, c.done);
        } else {
            self.sr |= sr::JEOC;
            if core::mem::take(&mut self.resume) {
                self.begin(false, c.done);
            }
        }
        false
    }

    fn finish(&mut self, c: Conversion, code: u32) -> bool {
        let (dma, each) = (self.cr2 & 1 << 8 != 0, self.cr2 & 1 << 10 != 0);
        if self.unread && (dma || each) {
            self.sr |= sr::OVR;
            return false;
        }
        self.dr = code;
        self.unread = true;
        self.position += 1;
        let last = self.position >= self.length();
        if last || each {
            self.sr |= sr::EOC;
        }
        if !last {
            self.begin(false, c.done);
        } else if self.cr2 & 2 != 0 {
            self.position = 0;
            self.begin(false, c.done);
        }
        dma && !self.dma_stopped
    }

    /// The DMA stream has done its last transfer: without DDS no more are requested.
    pub fn dma_complete(&mut self) {
        self.dma_stopped = self.cr2 & 1 << 9 == 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soc::tests::Bench;

    /// 21 MHz: 8 ticks a clock.
    fn adc() -> (Adc, Bench) {
        let mut a = Adc::new(1);
        a.clock = 8;
        (a, Bench::default())
    }

    #[test]
    fn a_conversion_takes_sampling_plus_twelve_clocks() {
        for (setting, clocks) in [(0, 15), (1, 27), (7, 492)] {
            let (mut a, mut w) = adc();
            w.codes[10] = 0x123;
            a.write(0x0c, setting, 0).unwrap();
            a.write(0x34, 10, 0).unwrap();
            a.write(0x08, 1 | 1 << 30, 100).unwrap();
            assert_eq!(a.due(), 100 + 8 * clocks);
            assert!(!a.fire(a.due(), &mut w));
            assert_eq!((a.read(0x00), a.read(0x4c), a.read(0x00)), (Ok(0x12), Ok(0x123), Ok(0x10)));
            assert_eq!(w.sampled, [100 + 8 * (clocks - 12)]);
        }
    }

    #[test]
    fn only_the_selected_trigger_and_edge_start_a_conversion() {
        let (mut a, _) = adc();
        a.write(0x08, 1 | 8 << 24 | 1 << 28, 0).unwrap();
        a.trigger(Trigger::Trgo(2), true, 0);
        a.trigger(Trigger::Trgo(3), false, 0);
        assert_eq!(a.due(), NEVER);
        a.trigger(Trigger::Trgo(3), true, 0);
        assert_ne!(a.due(), NEVER);
    }

    #[test]
    fn a_scan_walks_the_sequence_and_asks_for_dma_each_time() {
        let (mut a, mut w) = adc();
        (w.codes[3], w.codes[4]) = (333, 444);
        a.write(0x04, 1 << 8, 0).unwrap();
        a.write(0x2c, 1 << 20, 0).unwrap();
        a.write(0x34, 3 | 4 << 5, 0).unwrap();
        a.write(0x08, 1 | 1 << 8 | 1 << 9 | 1 << 30, 0).unwrap();
        for expected in [333, 444] {
            let t = a.due();
            assert!(a.fire(t, &mut w));
            assert_eq!(a.read(0x4c), Ok(expected));
        }
        assert_eq!(a.due(), NEVER);
    }

    #[test]
    fn an_unread_result_is_an_overrun_that_stops_the_converter() {
        let (mut a, mut w) = adc();
        a.write(0x08, 1 | 2 | 1 << 8 | 1 << 30, 0).unwrap();
        a.fire(a.due(), &mut w);
        a.fire(a.due(), &mut w);
        assert_eq!(a.flags() & sr::OVR, sr::OVR);
        assert_eq!(a.due(), NEVER);
        a.write(0x08, 1 | 2 | 1 << 8 | 1 << 30, 0).unwrap();
        assert_eq!(a.due(), NEVER);
    }

    #[test]
    fn the_watchdog_fires_outside_its_window_only() {
        for (code, fires) in [(99, true), (100, false), (200, false), (201, true)] {
            let (mut a, mut w) = adc();
            w.codes[5] = code;
            a.write(0x04, 1 << 23 | 1 << 6, 0).unwrap();
            a.write(0x24, 200, 0).unwrap();
            a.write(0x28, 100, 0).unwrap();
            a.write(0x34, 5, 0).unwrap();
            a.write(0x08, 1 | 1 << 30, 0).unwrap();
            a.fire(a.due(), &mut w);
            assert_eq!(a.request(), fires);
        }
    }

    #[test]
    fn an_injected_sequence_interrupts_the_regular_one_which_starts_over() {
        let (mut a, mut w) = adc();
        (w.codes[1], w.codes[2]) = (1000, 2000);
        a.write(0x34, 1, 0).unwrap();
        a.write(0x38, 2 << 15, 0).unwrap();
        a.write(0x14, 500, 0).unwrap();
        a.write(0x08, 1 | 1 << 30, 0).unwrap();
        a.write(0x08, 1 | 1 << 22, 10).unwrap();
        assert_eq!(a.due(), 10 + 120);
        a.fire(130, &mut w);
        assert_eq!(a.read(0x3c), Ok(1500));
        assert_eq!(a.due(), 130 + 120);
        a.fire(250, &mut w);
        assert_eq!(a.read(0x4c), Ok(1000));
    }
}

//! Timers TIM1..TIM14: registers with their preload (RM0090 §17 advanced, §18 general purpose, §19 one and two channels,
//! §20 basic). Counting is in [`count`], inputs in [`input`], outputs in [`output`].
//!
//! Counting up, edge-aligned; encoder modes count both ways. Centre-aligned and down counting, complementary outputs, DMA
//! requests of others than TIM1, TIM2 and TIM8, and gated mode are refused.

mod count;
mod input;
mod output;
#[cfg(test)]
mod tests;

use crate::error::Fault;
use input::Filtered;

/// What one timer has (§17..20, first section of each).
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// 1..=14.
    pub number: u8,
    /// Counter of 32 bits.
    pub wide: bool,
    pub channels: usize,
    /// Slave mode controller.
    pub slave: bool,
    /// Repetition counter and break.
    pub advanced: bool,
}

/// The fourteen timers, TIM1 first.
pub const KINDS: [Kind; 14] = {
    const fn kind(number: u8, channels: usize, slave: bool) -> Kind {
        let (wide, advanced) = (matches!(number, 2 | 5), matches!(number, 1 | 8));
        Kind { number, wide, channels, slave, advanced }
    }
    [
        kind(1, 4, true),
        kind(2, 4, true),
        kind(3, 4, true),
        kind(4, 4, true),
        kind(5, 4, true),
        kind(6, 0, false),
        kind(7, 0, false),
        kind(8, 4, true),
        kind(9, 2, true),
        kind(10, 1, false),
        kind(11, 1, false),
        kind(12, 2, true),
        kind(13, 1, false),
        kind(14, 1, false),
    ]
};

/// Events of a timer for the rest of the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// Rising edge of the trigger output (§18.4.2, MMS).
    Trgo,
    /// The reference of an output channel (0..=3) that is enabled has risen or fallen.
    Output(u8, bool),
    /// A DMA request: of the update (0), of channel 1..=4, or of the trigger (6), as DIER numbers them from bit 8.
    Dma(u8),
    /// What the outputs drive their pins with may have changed.
    Waveform,
}

/// Flags of SR and, at the same places, enables of DIER.
pub mod sr {
    pub const UIF: u32 = 1;
    pub const TIF: u32 = 1 << 6;
    pub const BIF: u32 = 1 << 7;
    /// CCxIF of channel index `c`.
    pub const fn cc(c: usize) -> u32 {
        2 << c
    }
}

mod cr1 {
    pub const CEN: u32 = 1;
    pub const UDIS: u32 = 2;
    pub const URS: u32 = 4;
    pub const OPM: u32 = 8;
    pub const DIR: u32 = 16;
    pub const ARPE: u32 = 128;
}

#[derive(Clone)]
pub struct Timer {
    pub kind: Kind,
    /// Ticks of one clock into the prescaler; zero until the clock tree is known to divide evenly.
    clock: u64,
    cr1: u32,
    cr2: u32,
    smcr: u32,
    dier: u32,
    sr: u32,
    ccmr: [u32; 2],
    ccer: u32,
    psc: u32,
    arr: u32,
    rcr: u32,
    bdtr: u32,
    ccr: [u32; 4],
    /// Shadow registers: what the counter works with.
    psc_now: u32,
    arr_now: u32,
    ccr_now: [u32; 4],
    repeat: u32,
    cnt: u32,
    /// Tick at which `cnt` and the prescaler's phase zero are valid.
    base: u64,
    /// Input edges counted toward the prescaler in external clock mode.
    sub: u32,
    reference: [bool; 4],
    inputs: [Filtered; 4],
    etr: Filtered,
    etr_edges: u32,
    break_active: bool,
    /// BDTR has been written: its LOCK is as it is until a reset.
    lock_written: bool,
}

impl Timer {
    pub fn new(kind: Kind) -> Self {
        let top = if kind.wide { u32::MAX } else { 0xffff };
        Self {
            kind,
            clock: 0,
            cr1: 0,
            cr2: 0,
            smcr: 0,
            dier: 0,
            sr: 0,
            ccmr: [0; 2],
            ccer: 0,
            psc: 0,
            arr: top,
            rcr: 0,
            bdtr: 0,
            ccr: [0; 4],
            psc_now: 0,
            arr_now: top,
            ccr_now: [0; 4],
            repeat: 0,
            cnt: 0,
            base: 0,
            sub: 0,
            reference: [false; 4],
            inputs: [Filtered::default(); 4],
            etr: Filtered::default(),
            etr_edges: 0,
            break_active: false,
            lock_written: false,
        }
    }

    fn mask(&self) -> u32 {
        if self.kind.wide { u32::MAX } else { 0xffff }
    }

    fn sms(&self) -> u32 {
        self.smcr & 7
    }

    fn encoder(&self) -> bool {
        matches!(self.sms(), 1..=3)
    }

    /// Byte of CCMR for a channel index.
    fn channel_mode(&self, c: usize) -> u32 {
        self.ccmr[c / 2] >> (8 * (c % 2)) & 0xff
    }

    fn is_output(&self, c: usize) -> bool {
        self.channel_mode(c) & 3 == 0
    }

    fn channel_enabled(&self, c: usize) -> bool {
        self.ccer >> (4 * c) & 1 == 1
    }

    /// Ticks of one prescaler clock, from the clock tree: 168 MHz must be a multiple of it. Takes effect at once.
    pub fn set_clock(&mut self, ticks: Option<u64>, now: u64, out: &mut Vec<Event>) {
        self.settle(now, out);
        self.base = now;
        self.clock = ticks.unwrap_or(0);
    }

    /// Clock from [`Timer::set_clock`].
    pub fn clock(&self) -> Option<u64> {
        (self.clock != 0).then_some(self.clock)
    }

    /// Interrupt requests, as bits of SR.
    pub fn requests(&self) -> u32 {
        self.sr & self.dier & 0xdf
    }

    pub fn read(&mut self, offset: u32, now: u64, out: &mut Vec<Event>) -> Result<u32, Fault> {
        self.check(offset)?;
        self.settle(now, out);
        Ok(match offset {
            0x00 => self.cr1,
            0x04 => self.cr2,
            0x08 => self.smcr,
            0x0c => self.dier,
            0x10 => self.sr,
            0x14 => 0,
            0x18 | 0x1c => self.ccmr[(offset as usize - 0x18) / 4],
            0x20 => self.ccer,
            0x24 => self.cnt,
            0x28 => self.psc,
            0x2c => self.arr,
            0x30 => self.rcr,
            0x34..=0x40 => {
                let c = (offset as usize - 0x34) / 4;
                if !self.is_output(c) {
                    self.sr &= !sr::cc(c); // reading a captured value clears its flag (§18.4.5)
                }
                self.ccr[c]
            }
            0x44 => self.bdtr,
            _ => 0,
        })
    }

    pub fn write(&mut self, offset: u32, value: u32, now: u64, out: &mut Vec<Event>) -> Result<(), Fault> {
        self.check(offset)?;
        self.settle(now, out);
        match offset {
            0x00 => self.write_cr1(value, now, out)?,
            0x04 => {
                if value & 0x8d != 0 {
                    return Err(Fault::Unsupported(
                        "TI1 XOR, preloaded control bits and DMA selection are not modelled",
                    ));
                }
                self.cr2 = kept(self.cr2, value & 0x7ff2, if self.lock() >= 1 { 0x7f00 } else { 0 });
            }
            0x08 => {
                if value & 7 == 5 {
                    return Err(Fault::Unsupported("gated slave mode is not modelled"));
                }
                if matches!(value & 7, 1..=3) && self.psc_now != 0 {
                    return Err(Fault::Unsupported("encoder mode with a prescaler"));
                }
                self.base = now;
                self.smcr = value & 0xfff7;
            }
            0x0c if value & 0x2000 != 0 || value & 0x5f00 != 0 && !self.kind.advanced && self.kind.number != 2 => {
                return Err(Fault::Unsupported("timer DMA requests are modelled for TIM1, TIM2 and TIM8 only"));
            }
            0x0c => self.dier = value & 0x5fff,
            0x10 => self.sr &= value,
            0x14 => self.generate(value, now, out)?,
            0x18 | 0x1c => {
                for byte in [value & 0xff, value >> 8 & 0xff] {
                    if byte & 3 != 0 && byte & 0xc != 0 {
                        return Err(Fault::Unsupported("input capture prescaler is not modelled"));
                    }
                }
                let register = (offset as usize - 0x18) / 4;
                let value = kept(self.ccmr[register], value & 0xffff, self.locked_modes(register));
                self.ccmr[register] = value;
            }
            0x20 if value & 0x4444 != 0 => return Err(Fault::Unsupported("complementary outputs are not modelled")),
            0x20 => self.ccer = kept(self.ccer, value & 0xbbbb, self.locked_polarities()),
            0x24 => (self.cnt, self.base) = (value & self.mask(), now),
            0x28 => self.psc = value & 0xffff,
            0x2c => {
                self.arr = value & self.mask();
                if self.cr1 & cr1::ARPE == 0 {
                    self.arr_now = self.arr;
                }
            }
            0x30 => self.rcr = value & 0xff,
            0x34..=0x40 => {
                let c = (offset as usize - 0x34) / 4;
                self.ccr[c] = value & self.mask();
                if self.channel_mode(c) & 8 == 0 {
                    self.ccr_now[c] = self.ccr[c];
                }
            }
            0x44 => self.write_bdtr(value),
            0x50 if value != 0 => return Err(Fault::Unsupported("timer remap is not modelled")),
            _ => (),
        }
        self.references(out);
        if !matches!(offset, 0x08 | 0x0c | 0x10 | 0x24 | 0x28 | 0x30) {
            out.push(Event::Waveform);
        }
        Ok(())
    }

    fn write_cr1(&mut self, value: u32, now: u64, out: &mut Vec<Event>) -> Result<(), Fault> {
        // DIR is read-only in encoder mode (§18.4.1).
        let dir = if self.encoder() { self.cr1 & cr1::DIR } else { value & cr1::DIR };
        if value & 0x60 != 0 || (dir != 0 && !self.encoder()) {
            return Err(Fault::Unsupported("centre-aligned and down counting are not modelled"));
        }
        if value & cr1::CEN != 0 && self.clock == 0 {
            return Err(Fault::Unsupported("timer started from a clock that does not divide 168 MHz"));
        }
        let started = value & cr1::CEN != 0 && self.cr1 & cr1::CEN == 0;
        self.cr1 = value & 0x38f & !cr1::DIR | dir;
        if started {
            self.base = now;
            self.trgo_if(1, out);
        }
        Ok(())
    }

    fn write_bdtr(&mut self, value: u32) {
        // MOE cannot be set while the break input is active (§17.4.18).
        let hold = self.break_active && value & 1 << 12 != 0;
        let value = if hold { value & 0x7fff } else { value & 0xffff };
        // DTG, BKE, BKP and AOE from level 1 on, OSSI and OSSR from level 2 on; LOCK itself is written once.
        let by_level = [0, 0x70ff, 0x7cff, 0x7cff][self.lock() as usize];
        self.bdtr = kept(self.bdtr, value, by_level | if self.lock_written { 0x0300 } else { 0 });
        self.lock_written = true;
    }

    /// LOCK of BDTR (§17.4.18).
    fn lock(&self) -> u32 {
        self.bdtr >> 8 & 3
    }

    /// Polarities of output channels, which level 2 locks.
    fn locked_polarities(&self) -> u32 {
        let outputs = (0..4).filter(|c| self.lock() >= 2 && self.is_output(*c));
        outputs.fold(0, |mask, c| mask | 0xa << (4 * c))
    }

    /// OCxM and OCxPE of output channels, which level 3 locks.
    fn locked_modes(&self, register: usize) -> u32 {
        let outputs = (0..2).filter(|c| self.lock() == 3 && self.is_output(2 * register + c));
        outputs.fold(0, |mask, c| mask | 0x78 << (8 * c))
    }

    fn generate(&mut self, value: u32, now: u64, out: &mut Vec<Event>) -> Result<(), Fault> {
        if value & 0x20 != 0 {
            return Err(Fault::Unsupported("commutation events are not modelled"));
        }
        for c in 0..self.kind.channels {
            if value & sr::cc(c) != 0 {
                if !self.is_output(c) {
                    self.capture(c, out);
                }
                self.sr |= sr::cc(c);
            }
        }
        if value & sr::BIF != 0 {
            self.trip();
        }
        if value & sr::TIF != 0 {
            self.trigger(now, out);
        }
        if value & 1 != 0 {
            self.reinitialise(now, out);
            self.trgo_if(0, out);
        }
        Ok(())
    }

    /// Refuses registers this timer does not have.
    fn check(&self, offset: u32) -> Result<(), Fault> {
        let Kind { channels, slave, advanced, number, wide, .. } = self.kind;
        let exists = match offset {
            0x00 | 0x0c | 0x10 | 0x14 | 0x24 | 0x28 | 0x2c => true,
            0x04 => channels == 4 || channels == 0,
            0x08 => slave,
            0x18 | 0x20 => channels > 0,
            0x1c => channels == 4,
            0x30 | 0x44 => advanced,
            0x34..=0x40 => (offset as usize - 0x34) / 4 < channels,
            0x50 => wide || number == 11,
            _ => false,
        };
        if exists { Ok(()) } else { Err(Fault::Unmodelled) }
    }

    /// Tick of the next event.
    pub fn due(&self) -> u64 {
        let mut due = self.next_count();
        for input in self.inputs.iter().chain([&self.etr]) {
            due = due.min(input.due());
        }
        due
    }

    /// Lets time pass until `now`, at most [`Timer::due`].
    pub fn fire(&mut self, now: u64, out: &mut Vec<Event>) {
        self.settle(now, out);
        self.settle_inputs(now, out);
        self.references(out);
    }

    /// DMA request `source`, if DIER enables it.
    fn dma_if(&self, source: u8, out: &mut Vec<Event>) {
        if self.dier >> (8 + source) & 1 == 1 {
            out.push(Event::Dma(source));
        }
    }

    fn trgo_if(&self, mms: u32, out: &mut Vec<Event>) {
        if self.cr2 >> 4 & 7 == mms {
            out.push(Event::Trgo);
        }
    }
}

/// A register after a write of which some bits are locked.
fn kept(old: u32, new: u32, locked: u32) -> u32 {
    old & locked | new & !locked
}

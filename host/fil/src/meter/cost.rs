//! Instructions and cycles, and the rules for instructions in sequence.

use super::accelerator::WAIT_STATES;
use super::timing::{Kind, Timing};
use std::ops::AddAssign;

/// Refill after a taken branch: low, estimate, high.
const REFILL: [u64; 3] = [1, 2, 3];

/// What a stretch of code costs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Instructions, exact; those skipped in IT blocks included.
    pub instructions: u64,
    /// Fewest cycles, from flash that does not wait.
    pub low: u64,
    /// Estimated cycles from flash and peripherals that do not wait.
    pub warm: u64,
    /// Most cycles from flash that does not wait.
    pub high: u64,
    /// Cycles that flash and peripherals let the processor wait, with what the accelerator held just then.
    pub waits: u64,
    /// Lines of flash, 128 bits each, of code and of data, met for the first time in a run.
    pub lines: u64,
}

impl Cost {
    /// `cycles` of the processor itself, such as an exception entry.
    pub fn fixed(cycles: u64) -> Self {
        Self { low: cycles, warm: cycles, high: cycles, ..Self::default() }
    }

    /// `cycles` that flash or a peripheral takes.
    pub fn wait(cycles: u64) -> Self {
        Self { waits: cycles, ..Self::default() }
    }

    /// The estimate.
    pub fn estimate(&self) -> u64 {
        self.warm + self.waits
    }

    /// Bound when the accelerator holds nothing: each line is waited for once.
    pub fn cold(&self) -> u64 {
        self.high + WAIT_STATES * self.lines
    }
}

impl AddAssign for Cost {
    fn add_assign(&mut self, o: Self) {
        self.instructions += o.instructions;
        self.low += o.low;
        self.warm += o.warm;
        self.high += o.high;
        self.waits += o.waits;
        self.lines += o.lines;
    }
}

/// Instructions one after another at one level of preemption.
#[derive(Clone, Debug, Default)]
pub struct Sequence {
    previous: Option<(u32, Timing)>,
    /// Estimated time, and the time at which the FPU's divider is free.
    now: u64,
    divider: u64,
}

impl Sequence {
    /// Address of the last instruction.
    pub fn last(&self) -> Option<u32> {
        self.previous.map(|p| p.0)
    }

    /// End of the last instruction.
    pub fn end(&self) -> Option<u32> {
        self.previous.map(|(at, t)| at + u32::from(t.size))
    }

    /// Penalty of the last instruction now that execution continues at `address`.
    pub fn close(&mut self, address: u32) -> Cost {
        let taken = self.previous.is_some_and(|p| p.1.branch) && self.end() != Some(address);
        let [low, warm, high] = if taken { REFILL } else { [0; 3] };
        self.now += warm;
        Cost { low, warm, high, ..Cost::default() }
    }

    /// An instruction that an IT block skips.
    pub fn skip(&mut self, address: u32, t: &Timing) -> Cost {
        self.now += 1;
        let nothing = Timing { size: t.size, ..Timing::default() };
        self.previous = Some((address, nothing));
        Cost { instructions: 1, ..Cost::fixed(1) }
    }

    /// The instruction at `address`; `quotient` is the bit length of a division's quotient.
    pub fn step(&mut self, address: u32, t: &Timing, quotient: u32) -> Cost {
        let before = self.previous.map(|p| p.1).unwrap_or_default();
        let base = i64::from(t.base);
        let (mut low, mut warm, mut high) = (base, base, base);
        let feeds_address = t.address & before.writes != 0;
        match t.kind {
            Kind::If => low = 0,
            Kind::Short => low = 1,
            Kind::Divide => {
                (low, high) = (2, 12);
                warm = (2 + i64::from(quotient.div_ceil(4)) + i64::from(quotient > 0)).min(12);
            }
            Kind::Load | Kind::Store if t.base > 1 && !feeds_address => {
                low -= i64::from(matches!(before.kind, Kind::Load | Kind::FloatLoad));
                let behind = i64::from(before.kind == Kind::Load);
                (warm, high) = (warm - behind, high - behind);
            }
            Kind::FloatLoad if matches!(before.kind, Kind::Load | Kind::FloatLoad) && !feeds_address => low -= 1,
            Kind::FloatStore => low -= 1,
            _ => {}
        }
        // Between the result of data processing and the address of the next instruction there is no short cut.
        let produced = matches!(before.kind, Kind::Plain | Kind::Divide) && before.base == 1;
        if feeds_address && produced {
            (warm, high) = (warm + 1, high + 1);
        }
        if before.late && before.writes & t.reads != 0 {
            (low, warm, high) = (low + 1, warm + 1, high + 1);
        }
        if t.float && self.divider > self.now {
            let wait = (self.divider - self.now) as i64;
            (low, warm) = (low + wait, warm + wait);
        }
        if t.kind == Kind::FloatDivide {
            // The rest of the division runs beside what follows, until the FPU is needed.
            let start = self.now + (warm - base) as u64;
            self.divider = start + base as u64;
            (low, warm) = (low - base + 1, warm - base + 1);
        }
        self.now += warm as u64;
        self.previous = Some((address, *t));
        let cycles = |c: i64| c.max(0) as u64;
        Cost { instructions: 1, low: cycles(low), warm: cycles(warm), high: cycles(high.max(warm)), ..Cost::default() }
    }
}

/// Bit length of a quotient.
pub fn quotient_bits(t: &Timing, dividend: u32, divisor: u32) -> u32 {
    let length = |v: u32| 32 - if t.signed { (v as i32).unsigned_abs() } else { v }.leading_zeros();
    (length(dividend) + 1).saturating_sub(length(divisor)) * u32::from(divisor != 0)
}

//! Charges every instruction that runs to its address and to the exception that runs it.
//!
//! The estimate is that of `timing` with what flash (`accelerator`) and peripherals (`buses`) let the processor wait.
//! *Warm* is without these waits, *cold* as if the flash accelerator held nothing when the run began.
//!
//! Code in SRAM1, where it appears at address 0, does not wait (RM0090 2.3.1), but each access of such code to data in
//! SRAM1 is charged a cycle (`SHARED`): fetches and data come over two buses into one memory, and the bus matrix lets one
//! of them wait (2.1.9). That is an upper bound: the processor reads ahead, and has often no need of the bus just then.
//!
//! Limits. It is a model, not silicon: no contention between processor and DMA for RAM, no alignment of 32-bit instructions,
//! and what the three modules say they assume. The vector of an exception is fetched while its frame is stored, and the cache
//! does not see that.

mod accelerator;
mod buses;
mod cost;
mod timing;

pub use accelerator::WAIT_STATES;
pub use buses::Buses;
pub use cost::Cost;

use accelerator::{Accelerator, LINE};
use anyhow::Result;
use cost::{Sequence, quotient_bits};
use edm_soc::Exception;
use std::collections::BTreeMap;
use timing::{Decoder, Kind, Timing};

/// Cycles that an access to data in SRAM1 takes longer while code is fetched from there.
const SHARED: u64 = 1;
/// Bytes at address 0 that may be SRAM1.
const SRAM1: u32 = 0x1_c000;
/// Start and size of flash; code elsewhere but at address 0 is not metered.
const FLASH: u32 = 0x0800_0000;
const FLASH_SIZE: u32 = 0x10_0000;
/// Lines of 128 bits; those of code first, then those read as data: the accelerator holds them apart (RM0090 3.5.2).
const LINES: usize = (FLASH_SIZE / LINE) as usize;
/// Entry and return of an exception by themselves; a return that chains to the next exception is cheaper.
const ENTRY: u64 = 12;
const RETURN: u64 = 10;

/// Says of an address which marks a run bears that comes by: a bit each.
pub type Marks = Box<dyn Fn(u32) -> u8>;
/// Mark of the addresses whose cost is counted by itself, with what they call.
pub const PART: u8 = 0x80;
/// Link register.
const LR: u8 = 14;

/// One run of an exception.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Run {
    /// Entry and return included, interrupting exceptions not.
    pub cost: Cost,
    /// Spent at addresses with the mark [`PART`], and in what was called from there.
    pub part: Cost,
    /// Marks of the places that it came by.
    pub marks: u8,
}

/// What one exception has cost.
#[derive(Clone, Debug, Default)]
pub struct Task {
    /// Each run.
    pub runs: Vec<Run>,
    /// What was spent at each address, all runs together.
    pub places: BTreeMap<u32, Cost>,
}

/// An exception that is running.
#[derive(Debug)]
struct Level {
    exception: Exception,
    run: u32,
    cost: Cost,
    part: Cost,
    /// Whether the last instruction belongs to the part, and where what it has called returns to.
    inside: bool,
    returns: Option<u32>,
    marks: u8,
    sequence: Sequence,
}

impl Level {
    /// The instruction at `address`, `marked` as one of the part or not, runs next.
    fn follow(&mut self, address: u32, marked: bool, register: impl Fn(u8) -> u32) {
        if self.returns == Some(address) {
            self.returns = None;
        }
        // A call is what leaves the address behind it in the link register.
        if self.inside && !marked && self.returns.is_none() {
            self.returns = self.sequence.end().filter(|end| register(LR) & !1 == *end);
        }
        self.inside = marked || self.returns.is_some();
    }
}

/// Meter of one chip.
pub struct Meter {
    decoder: Decoder,
    marks: Marks,
    code: Vec<Option<(Timing, u8)>>,
    accelerator: Accelerator,
    buses: Buses,
    /// Estimated time, cycles.
    now: u64,
    levels: Vec<Level>,
    /// Run in which a line was last met.
    met: Vec<u32>,
    runs: u32,
    tasks: BTreeMap<Exception, Task>,
    error: Option<anyhow::Error>,
}

impl Meter {
    /// A meter that has seen nothing, for a chip whose buses have these clocks; thread mode is exception 0.
    ///
    /// # Errors
    /// When the disassembler cannot be set up.
    pub fn new(buses: Buses, marks: Marks) -> Result<Self> {
        let mut meter = Self {
            decoder: Decoder::new()?,
            marks,
            accelerator: Accelerator::new(),
            buses,
            now: 0,
            code: vec![None; (FLASH_SIZE + SRAM1) as usize / 2],
            levels: Vec::new(),
            met: vec![0; 2 * LINES],
            runs: 0,
            tasks: BTreeMap::new(),
            error: None,
        };
        meter.begin(0, Cost::default());
        Ok(meter)
    }

    fn begin(&mut self, exception: Exception, cost: Cost) {
        self.runs += 1;
        self.levels.push(Level {
            exception,
            run: self.runs,
            cost,
            part: Cost::default(),
            inside: false,
            returns: None,
            marks: 0,
            sequence: Sequence::default(),
        });
    }

    /// Forgets what was counted; what is running is not counted any more.
    pub fn clear(&mut self) {
        self.tasks.clear();
        for level in &mut self.levels {
            // Run 0 is no run.
            level.run = 0;
        }
    }

    /// Exception `e` is entered.
    pub fn enter(&mut self, e: Exception) {
        self.now += ENTRY;
        self.begin(e, Cost::fixed(ENTRY + RETURN));
    }

    /// The running exception returns.
    pub fn leave(&mut self) {
        if self.levels.len() < 2 {
            return;
        }
        let Some(mut level) = self.levels.pop() else { return };
        let end = level.sequence.close(u32::MAX);
        level.cost += end;
        level.part += if level.inside { end } else { Cost::default() };
        self.now += end.warm + RETURN;
        if level.run == 0 {
            return;
        }
        let task = self.tasks.entry(level.exception).or_default();
        if let Some(last) = level.sequence.last() {
            *task.places.entry(last).or_default() += end;
        }
        task.runs.push(Run { cost: level.cost, part: level.part, marks: level.marks });
    }

    /// The processor itself takes `cycles` in the running exception: FPU registers saved or restored.
    pub fn spend(&mut self, cycles: u64) {
        self.now += cycles;
        if let Some(level) = self.levels.last_mut() {
            level.cost += Cost::fixed(cycles);
        }
    }

    /// The last instruction costs more than it did by itself.
    fn add(&mut self, cost: Cost) {
        self.now += cost.estimate();
        let Some(level) = self.levels.last_mut() else { return };
        level.cost += cost;
        level.part += if level.inside { cost } else { Cost::default() };
        if let (Some(last), true) = (level.sequence.last(), level.run != 0) {
            *self.tasks.entry(level.exception).or_default().places.entry(last).or_default() += cost;
        }
    }

    /// The instruction at `address` runs next; `register` gives the content of a core register.
    /// `code` is the byte at an address.
    pub fn step(&mut self, address: u32, code: impl Fn(u32) -> Option<u32>, register: impl Fn(u8) -> u32) {
        if (address >= SRAM1 && address.wrapping_sub(FLASH) >= FLASH_SIZE) || self.error.is_some() {
            return;
        }
        let end = self.levels.last().and_then(|l| l.sequence.end());
        // Skipped members of an IT block, for which the engine calls no hook: at most four.
        if let Some(mut at) = end.filter(|e| (1..=16).contains(&address.wrapping_sub(*e))) {
            let last = self.levels.last().and_then(|l| l.sequence.last()).unwrap_or(0);
            let branched = self.timing(last, &code).is_none_or(|t| t.0.branch);
            while !branched && at < address {
                let Some((t, _)) = self.timing(at, &code) else { return };
                self.charge(at, &t, |s| s.skip(at, &t));
                at += u32::from(t.size);
            }
        }
        let Some((t, marks)) = self.timing(address, &code) else { return };
        let quotient = match t.kind {
            Kind::Divide => quotient_bits(&t, register(t.operands.0), register(t.operands.1)),
            _ => 0,
        };
        if let Some(level) = self.levels.last_mut() {
            level.marks |= marks;
            let penalty = level.sequence.close(address);
            if penalty != Cost::default() {
                self.add(penalty);
            }
        }
        if let Some(level) = self.levels.last_mut() {
            level.follow(address, marks & PART != 0, &register);
        }
        self.charge(address, &t, |s| s.step(address, &t, quotient));
    }

    /// The last instruction loads from a register of a peripheral.
    pub fn load_register(&mut self, address: u32) {
        let wait = self.buses.read(address, self.now);
        self.add(Cost::wait(wait));
    }

    /// The last instruction stores to a register of a peripheral.
    pub fn store_register(&mut self, address: u32) {
        self.buses.write(address, self.now);
    }

    /// Flash is read as data at `address` by the last instruction.
    pub fn read(&mut self, address: u32) {
        let line = LINES + (address.wrapping_sub(FLASH) / LINE) as usize % LINES;
        let run = self.levels.last().map_or(0, |l| l.run);
        let new = std::mem::replace(&mut self.met[line], run) != run;
        let waits = self.accelerator.load(address, self.now);
        self.add(Cost { lines: new.into(), waits, ..Cost::default() });
    }

    /// Data in SRAM1 is read or written by the last instruction.
    pub fn share(&mut self) {
        let last = self.levels.last().and_then(|level| level.sequence.last());
        if last.is_some_and(|at| at < SRAM1) {
            self.add(Cost::wait(SHARED));
        }
    }

    fn charge(&mut self, address: u32, t: &Timing, cost: impl FnOnce(&mut Sequence) -> Cost) {
        let Some(level) = self.levels.last_mut() else { return };
        let mut cost = cost(&mut level.sequence);
        let last = address + u32::from(t.size) - 1;
        // RAM does not wait.
        for at in [address, last].into_iter().filter(|at| *at >= FLASH) {
            cost.waits += self.accelerator.fetch(at, self.now + cost.waits);
            if let Some(met) = self.met.get_mut((at.wrapping_sub(FLASH) / LINE) as usize) {
                cost.lines += u64::from(std::mem::replace(met, level.run) != level.run);
            }
        }
        if t.uses_bus() {
            cost.waits += self.buses.want(self.now + cost.waits);
        }
        self.add(cost);
    }

    fn timing(&mut self, address: u32, code: &impl Fn(u32) -> Option<u32>) -> Option<(Timing, u8)> {
        let place = if address < SRAM1 { FLASH_SIZE + address } else { address.wrapping_sub(FLASH) };
        let slot = (place / 2) as usize;
        if let Some(t) = self.code.get(slot).copied().flatten() {
            return Some(t);
        }
        let bytes: Vec<u8> = (0..4).map_while(|i| code(address + i)).map(|b| b as u8).collect();
        match self.decoder.decode(address, &bytes) {
            Ok(t) => {
                let known = Some((t, (self.marks)(address)));
                *self.code.get_mut(slot)? = known;
                known
            }
            Err(e) => {
                self.error = Some(e);
                None
            }
        }
    }

    /// What each exception has cost so far, by number; 0 is thread mode, which has no runs.
    ///
    /// # Errors
    /// When an instruction was met that cannot be decoded.
    pub fn tasks(&self) -> Result<&BTreeMap<Exception, Task>, &anyhow::Error> {
        self.error.as_ref().map_or(Ok(&self.tasks), Err)
    }
}

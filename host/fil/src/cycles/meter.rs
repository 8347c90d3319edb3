//! Charges every instruction that runs to its address and to the exception that runs it.

use super::cost::{Cost, Sequence, quotient_bits};
use super::timing::{Decoder, Kind, Timing};
use anyhow::Result;
use edm_soc::{Exception, Region};
use std::collections::BTreeMap;

/// Start and size of flash; code outside of it is not metered.
const FLASH: u32 = 0x0800_0000;
const FLASH_SIZE: u32 = 0x10_0000;
/// Lines of 128 bits; those of code first, then those read as data: the accelerator holds them apart (RM0090 3.5.2).
const LINES: usize = FLASH_SIZE as usize / 16;
/// Entry and return of an exception by themselves; a return that chains to the next exception is cheaper.
const ENTRY: u64 = 12;
const RETURN: u64 = 10;

/// What one exception has cost.
#[derive(Clone, Debug, Default)]
pub struct Task {
    /// Each run, entry and return included, interrupting exceptions not.
    pub runs: Vec<Cost>,
    /// What was spent at each address, all runs together.
    pub places: BTreeMap<u32, Cost>,
}

/// An exception that is running.
#[derive(Debug)]
struct Level {
    exception: Exception,
    run: u32,
    cost: Cost,
    sequence: Sequence,
}

/// Meter of one chip.
pub struct Meter {
    decoder: Decoder,
    code: Vec<Option<Timing>>,
    levels: Vec<Level>,
    /// Run in which a line was last met.
    met: Vec<u32>,
    runs: u32,
    tasks: BTreeMap<Exception, Task>,
    error: Option<anyhow::Error>,
}

impl Meter {
    /// A meter that has seen nothing; thread mode is exception 0.
    ///
    /// # Errors
    /// When the disassembler cannot be set up.
    pub fn new() -> Result<Self> {
        let mut meter = Self {
            decoder: Decoder::new()?,
            code: vec![None; FLASH_SIZE as usize / 2],
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
        self.levels.push(Level { exception, run: self.runs, cost, sequence: Sequence::default() });
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
        if level.run == 0 {
            return;
        }
        let task = self.tasks.entry(level.exception).or_default();
        if let Some(last) = level.sequence.last() {
            *task.places.entry(last).or_default() += end;
        }
        task.runs.push(level.cost);
    }

    /// The processor itself takes `cycles` in the running exception: FPU registers saved or restored.
    pub fn spend(&mut self, cycles: u64) {
        if let Some(level) = self.levels.last_mut() {
            level.cost += Cost::fixed(cycles);
        }
    }

    /// The instruction at `address` runs next; `register` gives the content of a core register.
    pub fn step(&mut self, address: u32, flash: &Region, register: impl Fn(u8) -> u32) {
        if address.wrapping_sub(FLASH) >= FLASH_SIZE || self.error.is_some() {
            return;
        }
        let end = self.levels.last().and_then(|l| l.sequence.end());
        // Skipped members of an IT block, for which the engine calls no hook: at most four.
        if let Some(mut at) = end.filter(|e| (1..=16).contains(&address.wrapping_sub(*e))) {
            let last = self.levels.last().and_then(|l| l.sequence.last()).unwrap_or(0);
            let branched = self.timing(last, flash).is_none_or(|t| t.branch);
            while !branched && at < address {
                let Some(t) = self.timing(at, flash) else { return };
                self.charge(at, t.size, |s| s.skip(at, &t));
                at += u32::from(t.size);
            }
        }
        let Some(t) = self.timing(address, flash) else { return };
        let quotient = match t.kind {
            Kind::Divide => quotient_bits(&t, register(t.operands.0), register(t.operands.1)),
            _ => 0,
        };
        if let Some(level) = self.levels.last_mut()
            && let Some(last) = level.sequence.last()
        {
            let penalty = level.sequence.close(address);
            level.cost += penalty;
            if penalty != Cost::default() && level.run != 0 {
                *self.tasks.entry(level.exception).or_default().places.entry(last).or_default() += penalty;
            }
        }
        self.charge(address, t.size, |s| s.step(address, &t, quotient));
    }

    /// Flash is read as data at `address` by the last instruction.
    pub fn read(&mut self, address: u32) {
        let line = LINES + (address.wrapping_sub(FLASH) / 16) as usize % LINES;
        let Some(level) = self.levels.last_mut() else { return };
        if self.met[line] == level.run {
            return;
        }
        self.met[line] = level.run;
        let miss = Cost { lines: 1, ..Cost::default() };
        level.cost += miss;
        if let (Some(last), true) = (level.sequence.last(), level.run != 0) {
            *self.tasks.entry(level.exception).or_default().places.entry(last).or_default() += miss;
        }
    }

    fn charge(&mut self, address: u32, size: u8, cost: impl FnOnce(&mut Sequence) -> Cost) {
        let Some(level) = self.levels.last_mut() else { return };
        let mut cost = cost(&mut level.sequence);
        let first = (address - FLASH) as usize / 16;
        let last = ((address - FLASH) as usize + usize::from(size) - 1) / 16;
        for line in first..=last {
            if self.met.get(line).is_some_and(|run| *run != level.run) {
                self.met[line] = level.run;
                cost.lines += 1;
            }
        }
        level.cost += cost;
        if level.run != 0 {
            *self.tasks.entry(level.exception).or_default().places.entry(address).or_default() += cost;
        }
    }

    fn timing(&mut self, address: u32, flash: &Region) -> Option<Timing> {
        let slot = (address.wrapping_sub(FLASH) / 2) as usize;
        if let Some(t) = self.code.get(slot).copied().flatten() {
            return Some(t);
        }
        let bytes: Vec<u8> = (0..4).map_while(|i| flash.load(address + i, 1)).map(|b| b as u8).collect();
        match self.decoder.decode(address, &bytes) {
            Ok(t) => {
                *self.code.get_mut(slot)? = Some(t);
                Some(t)
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

//! The flash interface with its accelerator, as RM0090 section 3.5 describes it for the STM32F405.
//!
//! | what | here | source |
//! | --- | --- | --- |
//! | a read of the flash gives a line of 128 bits | [`LINE`] | 3.5.2, instruction prefetch |
//! | it takes a cycle and five wait states at 168 MHz and 3.3 V | [`WAIT_STATES`] | 3.5.1, table 10 |
//! | 64 lines of instructions are kept, 8 of data; the least recently used goes | [`INSTRUCTION_LINES`], [`DATA_LINES`] | 3.5.2 |
//! | an instruction that is in the current line, in the prefetched line or in the cache does not wait | [`Accelerator::fetch`] | 3.5.2 |
//! | only a line that was in none of them is copied into the cache | as above | 3.5.2 |
//! | the line behind the current one is read ahead while that is used | as above | 3.5.2 |
//! | data stalls the processor until it is there | [`Accelerator::load`] | 3.5.2, data management |
//!
//! Assumed, because the manual does not say: a read that has begun is finished before the next, also one ahead of a branch
//! that leaves it unused; nothing is read ahead that the cache holds; a line that was used from the prefetch is not kept. A
//! line is requested when its first instruction runs: the processor itself requests up to three words ahead, which hides some of
//! the cycles counted here.

/// Bytes of a line.
pub const LINE: u32 = 16;
/// Wait states of a read.
pub const WAIT_STATES: u64 = 5;
/// Lines that the caches hold.
pub const INSTRUCTION_LINES: usize = 64;
/// As [`INSTRUCTION_LINES`].
pub const DATA_LINES: usize = 8;

/// Lines that were used lately, the least recent first.
#[derive(Clone, Debug)]
struct Cache<const N: usize> {
    /// Line and when it was used; zero: none.
    lines: [(u32, u64); N],
    uses: u64,
}

impl<const N: usize> Cache<N> {
    fn new() -> Self {
        Self { lines: [(0, 0); N], uses: 0 }
    }

    fn holds(&self, line: u32) -> bool {
        self.lines.iter().any(|l| l.0 == line && l.1 != 0)
    }

    /// Whether the line is held; it is the most recent from now on.
    fn find(&mut self, line: u32) -> bool {
        self.uses += 1;
        let uses = self.uses;
        let found = self.lines.iter_mut().find(|l| l.0 == line && l.1 != 0);
        found.map(|l| l.1 = uses).is_some()
    }

    fn keep(&mut self, line: u32) {
        self.uses += 1;
        if let Some(oldest) = self.lines.iter_mut().min_by_key(|l| l.1) {
            *oldest = (line, self.uses);
        }
    }
}

/// Flash and accelerator.
#[derive(Clone, Debug)]
pub struct Accelerator {
    instructions: Cache<INSTRUCTION_LINES>,
    data: Cache<DATA_LINES>,
    current: u32,
    /// The line read ahead, and when it is there.
    ahead: Option<(u32, u64)>,
    /// When the flash can begin its next read.
    free: u64,
}

impl Accelerator {
    /// Caches that hold nothing.
    pub fn new() -> Self {
        Self { instructions: Cache::new(), data: Cache::new(), current: 0, ahead: None, free: 0 }
    }

    /// Cycles that the processor waits for the instruction at `address` at time `now`.
    pub fn fetch(&mut self, address: u32, now: u64) -> u64 {
        let line = address / LINE;
        if line == self.current {
            return 0;
        }
        self.current = line;
        let wait = match self.ahead.filter(|a| a.0 == line) {
            Some((_, there)) => there.saturating_sub(now),
            None if self.instructions.find(line) => 0,
            None => {
                self.instructions.keep(line);
                self.read(now)
            }
        };
        let next = line + 1;
        if self.ahead.is_none_or(|a| a.0 != next) {
            self.ahead = (!self.instructions.holds(next)).then(|| {
                let begin = self.free.max(now + wait + 1);
                self.free = begin + 1 + WAIT_STATES;
                (next, begin + WAIT_STATES)
            });
        }
        wait
    }

    /// Cycles that the processor waits for data at `address` at time `now`.
    pub fn load(&mut self, address: u32, now: u64) -> u64 {
        let line = address / LINE;
        if self.data.find(line) {
            return 0;
        }
        self.data.keep(line);
        self.read(now)
    }

    /// Wait for a read that is requested at `now`.
    fn read(&mut self, now: u64) -> u64 {
        let begin = self.free.max(now);
        self.free = begin + 1 + WAIT_STATES;
        begin - now + WAIT_STATES
    }
}

impl Default for Accelerator {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Waits of instructions of four bytes that take a cycle each.
    fn run(accelerator: &mut Accelerator, now: &mut u64, from: u32, instructions: u32) -> u64 {
        let mut waits = 0;
        for i in 0..instructions {
            let wait = accelerator.fetch(from + 4 * i, *now);
            waits += wait;
            *now += wait + 1;
        }
        waits
    }

    #[test]
    fn a_line_that_is_nowhere_costs_the_wait_states_and_is_kept() {
        let (mut a, mut now) = (Accelerator::new(), 100);
        assert_eq!(run(&mut a, &mut now, 0x0800_0000, 4), 5);
        now += 100;
        assert_eq!(run(&mut a, &mut now, 0x0800_1000, 4), 5);
        now += 100;
        assert_eq!(run(&mut a, &mut now, 0x0800_0000, 4), 0);
    }

    #[test]
    fn code_in_a_row_waits_for_what_reading_ahead_does_not_hide() {
        // Four instructions of a cycle each hide four of the six cycles that the next line takes.
        let (mut a, mut now) = (Accelerator::new(), 100);
        assert_eq!(run(&mut a, &mut now, 0x0800_0000, 4 * 4), 5 + 3 * 2);
        // Slower code hides all of them.
        let (mut a, mut now, mut waits) = (Accelerator::new(), 100, 0);
        for i in 0..16 {
            let wait = a.fetch(0x0800_0000 + 4 * i, now);
            waits += wait;
            now += wait + 2;
        }
        assert_eq!(waits, 5);
    }

    #[test]
    fn what_was_read_ahead_is_not_kept() {
        let (mut a, mut now) = (Accelerator::new(), 100);
        run(&mut a, &mut now, 0x0800_0000, 8);
        run(&mut a, &mut now, 0x0800_1000, 4);
        now += 100;
        // The first line is held, the second has to be read again: ahead, while the first is used.
        assert_eq!(run(&mut a, &mut now, 0x0800_0000, 8), 2);
        run(&mut a, &mut now, 0x0800_1000, 4);
        now += 100;
        assert_eq!(run(&mut a, &mut now, 0x0800_0010, 4), 5);
    }

    #[test]
    fn a_branch_waits_for_the_read_ahead_that_it_leaves_unused() {
        let mut a = Accelerator::new();
        // The line comes at 105, the read ahead begins at 106 and is over at 112.
        assert_eq!(a.fetch(0x0800_0000, 100), 5);
        assert_eq!(a.fetch(0x0800_1000, 107), (112 - 107) + 5);
    }

    #[test]
    fn the_least_recently_used_line_goes() {
        let mut a = Accelerator::new();
        let mut now = 0;
        let mut fetch = |line: u32| {
            now += 1000;
            a.fetch(0x0800_0000 + 0x100 * line, now)
        };
        let lines = INSTRUCTION_LINES as u32;
        (0..lines).for_each(|n| assert_eq!(fetch(n), 5));
        assert_eq!((fetch(0), fetch(lines)), (0, 5));
        assert_eq!((fetch(0), fetch(1), fetch(3)), (0, 5, 0));
    }

    #[test]
    fn data_has_eight_lines_of_its_own() {
        let mut a = Accelerator::new();
        a.fetch(0x0800_0000, 0);
        let mut now = 100;
        let mut load = |line: u32| {
            now += 100;
            a.load(0x0800_0000 + 16 * line, now)
        };
        (0..8).for_each(|n| assert_eq!(load(n), 5));
        assert_eq!((load(0), load(8), load(0), load(1)), (0, 5, 0, 5));
    }
}

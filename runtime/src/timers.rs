//! How long the tasks take, for the host (200Ah): newest and longest run, and the share of the processor.
//!
//! A run lasts from its beginning to its end, with all interruptions; that of the servo task begins when it was due, with the
//! period of the PWM.

use edm_crossing::atomic::Word;
use edm_hal_shim::board::CORE_HZ;
use edm_servo_head::canopen::drive::{TASKS, TaskTimer};

/// Times of one task, clock cycles; only the task itself writes.
pub struct Times {
    last: Word,
    most: Word,
    /// Over all runs, wrapping.
    sum: Word,
}

impl Times {
    /// Nothing has run.
    pub const fn new() -> Self {
        Times { last: Word::new(0), most: Word::new(0), sum: Word::new(0) }
    }

    /// The task has run for so many cycles.
    #[inline]
    pub fn ran(&self, cycles: u32) {
        self.sum.store(self.sum.load().wrapping_add(cycles));
        self.last.store(cycles);
        if cycles > self.most.load() {
            self.most.store(cycles);
        }
    }
}

impl Default for Times {
    fn default() -> Self {
        Times::new()
    }
}

/// Reads the times, and computes the loads once a second.
pub struct Timers {
    since: u32,
    sums: [u32; TASKS],
    loads: [u16; TASKS],
}

impl Timers {
    /// Nothing has run before `now`.
    pub const fn new(now: u32) -> Self {
        Timers { since: now, sums: [0; TASKS], loads: [0; TASKS] }
    }

    /// The times of now.
    pub fn read(&mut self, all: &[Times; TASKS], now: u32) -> [TaskTimer; TASKS] {
        let elapsed = now.wrapping_sub(self.since);
        if elapsed >= CORE_HZ {
            self.since = now;
            for ((load, before), times) in self.loads.iter_mut().zip(&mut self.sums).zip(all) {
                let sum = times.sum.load();
                let share = sum.wrapping_sub(*before) as f32 / elapsed as f32;
                *before = sum;
                *load = (share * 10_000.0) as u16;
            }
        }
        let mut timers = [TaskTimer::default(); TASKS];
        for ((timer, times), load) in timers.iter_mut().zip(all).zip(&self.loads) {
            *timer = TaskTimer { last: ns(times.last.load()), most: ns(times.most.load()), load: *load };
        }
        timers
    }
}

/// Cycles as nanoseconds; saturates after 25 ms.
fn ns(cycles: u32) -> u32 {
    const NS: f32 = 1e9 / CORE_HZ as f32;
    (cycles as f32 * NS) as u32
}

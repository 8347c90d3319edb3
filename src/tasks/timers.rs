//! How long the tasks take, for the host (200Ah): newest and longest run, and the share of the processor.
//!
//! A run lasts from its beginning to its end, whoever interrupts it; that of the servo task begins when it was due, with the
//! period of the PWM. The ticks of the servo task that do no more than their loop, fifteen of twenty, are not timed: a
//! measurement is a fiftieth of such a tick. In its load each of them counts as [`LOOP`].

use super::{GAP, PROTOCOL, SERVO, SUPERVISE};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use edm_hal_shim::board::CORE_HZ;
use edm_servo_head::canopen::drive::{TASKS, TaskTimer};

/// Times of one task, cycles; only the task itself writes.
struct Times {
    last: AtomicU32,
    most: AtomicU32,
    /// Over all runs, wrapping.
    sum: AtomicU32,
}

static TIMES: [Times; TASKS] =
    [const { Times { last: AtomicU32::new(0), most: AtomicU32::new(0), sum: AtomicU32::new(0) } }; TASKS];
const _: () = assert!(GAP == 0 && SERVO == 1 && SUPERVISE == 2 && PROTOCOL == 3);

/// Cycles of a servo tick that does no more than its loop: its budget, of which it uses nearly all (docs/performance.md).
pub const LOOP: u32 = 450;

/// A task has run for so many cycles.
#[inline]
pub fn ran(task: usize, cycles: u32) {
    add(task, cycles);
    if let Some(times) = TIMES.get(task) {
        times.last.store(cycles, Relaxed);
        if cycles > times.most.load(Relaxed) {
            times.most.store(cycles, Relaxed);
        }
    }
}

/// Runs of a task that were not timed have taken so many cycles.
#[inline]
pub fn add(task: usize, cycles: u32) {
    if let Some(times) = TIMES.get(task) {
        times.sum.store(times.sum.load(Relaxed).wrapping_add(cycles), Relaxed);
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
    pub fn read(&mut self, now: u32) -> [TaskTimer; TASKS] {
        let elapsed = now.wrapping_sub(self.since);
        if elapsed >= CORE_HZ {
            self.since = now;
            for ((load, before), times) in self.loads.iter_mut().zip(&mut self.sums).zip(&TIMES) {
                let sum = times.sum.load(Relaxed);
                let share = sum.wrapping_sub(*before) as f32 / elapsed as f32;
                *before = sum;
                *load = (share * 10_000.0) as u16;
            }
        }
        let mut timers = [TaskTimer::default(); TASKS];
        for ((timer, times), load) in timers.iter_mut().zip(&TIMES).zip(&self.loads) {
            *timer = TaskTimer { last: ns(times.last.load(Relaxed)), most: ns(times.most.load(Relaxed)), load: *load };
        }
        timers
    }
}

/// Cycles as nanoseconds; saturates after 25 ms.
fn ns(cycles: u32) -> u32 {
    const NS: f32 = 1e9 / CORE_HZ as f32;
    (cycles as f32 * NS) as u32
}

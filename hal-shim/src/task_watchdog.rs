//! TaskWatchdog call: the watchdog is fed only while every task keeps reporting.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Tasks, each with the longest silence allowed to it.
pub struct TaskWatchdog<const N: usize> {
    windows: [u32; N],
    last: [AtomicU32; N],
}

impl<const N: usize> TaskWatchdog<N> {
    /// `windows` in clock ticks, below 2^31.
    pub const fn new(windows: [u32; N]) -> Self {
        TaskWatchdog { windows, last: [const { AtomicU32::new(0) }; N] }
    }

    /// Everybody is taken to have reported now: the task watchdog starts.
    pub fn start(&self, now: u32) {
        self.last.iter().for_each(|last| last.store(now, Relaxed));
    }

    /// The task at `index` reports; beyond the last one nothing happens.
    pub fn report(&self, index: usize, now: u32) {
        if let Some(last) = self.last.get(index) {
            last.store(now, Relaxed);
        }
    }

    /// The first task that has been silent for longer than its window.
    pub fn missing(&self, now: u32) -> Option<usize> {
        self.windows.iter().zip(&self.last).position(|(window, last)| {
            // A report that came in after `now` was read has a negative age.
            let age = now.wrapping_sub(last.load(Relaxed)) as i32;
            age > 0 && age as u32 > *window
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_silent_task_is_named_and_both_sides_of_its_window_hold() {
        let watchdog = TaskWatchdog::new([100, 1000]);
        watchdog.start(0);
        assert_eq!(watchdog.missing(100), None);
        assert_eq!(watchdog.missing(101), Some(0));
        watchdog.report(0, 1000);
        assert_eq!(watchdog.missing(1000), None);
        watchdog.report(0, 1001);
        assert_eq!(watchdog.missing(1001), Some(1));
    }

    #[test]
    fn the_clock_may_wrap_and_a_report_may_be_newer_than_the_check() {
        let watchdog = TaskWatchdog::new([100]);
        watchdog.start(u32::MAX - 49);
        assert_eq!(watchdog.missing(50), None);
        assert_eq!(watchdog.missing(51), Some(0));
        watchdog.report(0, 60);
        assert_eq!(watchdog.missing(55), None);
    }

    #[test]
    fn a_report_of_nobody_changes_nothing() {
        let watchdog = TaskWatchdog::new([100]);
        watchdog.start(0);
        watchdog.report(1, 500);
        assert_eq!(watchdog.missing(500), Some(0));
    }
}

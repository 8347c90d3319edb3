//! Supervision, and what the light and the log show.

use crate::Board;
use crate::board::Caller;
use crate::crossings::{SUPERVISE, Signals};
use edm_crossing::latest::{Reader, Writer};
use edm_crossing::ring::Sender;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::tick::Period;
use edm_servo_head::head::{Fault, Status, SupervisionLimits, Supervisor};

/// Milliseconds between two reports to the log.
const LOG: u32 = 1000;
/// Milliseconds of light and of dark while a fault is shown.
const BLINK: u32 = 200;

/// The supervisor and what it feeds.
pub struct Supervise<B: Board> {
    pub(crate) millisecond: B::Millisecond,
    pub(crate) supervisor: Supervisor,
    pub(crate) clock: B::Clock,
    pub(crate) caller: B::Caller,
    pub(crate) signals: &'static Signals,
    pub(crate) count: u32,
    pub(crate) statuses: Reader<'static, Status>,
    pub(crate) limits: Reader<'static, SupervisionLimits>,
    pub(crate) faults: Sender<'static, Fault, 8>,
    pub(crate) report: Writer<'static, Status>,
}

impl<B: Board> Supervise<B> {
    /// One millisecond, or other limits to take at once.
    pub fn tick(&mut self) {
        let begin = self.clock.now();
        if self.limits.refresh() {
            self.limits.accept();
            self.caller.protocol();
        }
        if !self.millisecond.begins() {
            return;
        }
        self.count = self.count.wrapping_add(1);
        if self.statuses.refresh() {
            self.judge();
        }
        let end = self.clock.now();
        self.signals.times[SUPERVISE].ran(end.wrapping_sub(begin));
        self.signals.task_watchdog.report(SUPERVISE, end);
    }

    /// What it judges by.
    pub fn limits(&self) -> &SupervisionLimits {
        self.limits.get()
    }

    fn judge(&mut self) {
        let status = self.statuses.get();
        if let Some(fault) = self.supervisor.tick(self.limits.get(), status, self.signals.host.take()) {
            self.faults.send(fault);
            self.signals.waiting.set();
        }
        // Lit while all is well, blinking with a fault.
        self.caller.light(status.fault.is_none() || (self.count / BLINK).is_multiple_of(2));
        if self.count.is_multiple_of(LOG) {
            self.report.write(|slot| *slot = *status);
        }
    }
}

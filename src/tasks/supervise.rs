//! Supervision, and what the light and the log show.

use super::{ROLL, Report, SUPERVISE, WAITING, timers};
use core::sync::atomic::{AtomicBool, Ordering::Relaxed};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_hal_shim::stm32f4::timebase::Millisecond;
use edm_hal_shim::stm32f4::{gate, gated, lines};
use edm_servo_head::head::{Fault, Status, SupervisionLimits, Supervisor};
use heapless::spsc::{Consumer, Producer};

/// A frame came in since the last supervision.
static HOST: AtomicBool = AtomicBool::new(false);

/// A life sign of the host.
pub fn host_is_alive() {
    HOST.store(true, Relaxed);
}

/// Milliseconds between two reports to the log.
const LOG: u32 = 1000;
/// Milliseconds of light and of dark while a fault is shown.
const BLINK: u32 = 200;

/// The supervisor and what it feeds.
pub struct Supervise {
    pub(super) millisecond: Millisecond,
    pub(super) supervisor: Supervisor,
    pub(super) limits: SupervisionLimits,
    pub(super) clock: Cycles,
    pub(super) count: u32,
    pub(super) statuses: Consumer<'static, Status>,
    pub(super) settings: Consumer<'static, SupervisionLimits>,
    pub(super) faults: Producer<'static, Fault>,
    pub(super) reports: Producer<'static, Report>,
}

impl Supervise {
    /// One millisecond.
    pub fn tick(&mut self) {
        let begin = self.clock.now();
        self.millisecond.clear();
        self.count = self.count.wrapping_add(1);
        if let Some(limits) = self.settings.dequeue() {
            self.limits = limits;
        }
        while let Some(status) = self.statuses.dequeue() {
            if let Some(fault) = self.supervisor.tick(&self.limits, &status, HOST.swap(false, Relaxed)) {
                let _ = self.faults.enqueue(fault);
                WAITING.store(true, Relaxed);
            }
            // Lit while all is well, blinking with a fault.
            lines::led(status.fault.is_none() || (self.count / BLINK).is_multiple_of(2));
            if self.count.is_multiple_of(LOG) {
                let shorts = gated::shorts();
                let report = Report { status, shorts, pulse: gated::newest(), captures: gate::captures() };
                let _ = self.reports.enqueue(report);
            }
        }
        let end = self.clock.now();
        timers::ran(SUPERVISE, end.wrapping_sub(begin));
        ROLL.report(SUPERVISE, end);
    }
}

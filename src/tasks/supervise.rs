//! Supervision, and the pace of everything slower.

use super::{ROLL, Report, SUPERVISE, WAITING};
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

/// Milliseconds between two reports to the host, and between two to the log.
const PUBLISH: u32 = 10;
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
    pub(super) faults: Producer<'static, Fault>,
    pub(super) published: Producer<'static, Status>,
    pub(super) reports: Producer<'static, Report>,
}

impl Supervise {
    /// One millisecond; `true` when the protocol is due.
    pub fn tick(&mut self) -> bool {
        self.millisecond.clear();
        self.count = self.count.wrapping_add(1);
        while let Some(status) = self.statuses.dequeue() {
            if let Some(fault) = self.supervisor.tick(&self.limits, &status, HOST.swap(false, Relaxed)) {
                let _ = self.faults.enqueue(fault);
                WAITING.store(true, Relaxed);
            }
            // Lit while all is well, blinking with a fault.
            lines::led(status.fault.is_none() || (self.count / BLINK).is_multiple_of(2));
            if self.count.is_multiple_of(PUBLISH) {
                let _ = self.published.enqueue(status);
            }
            if self.count.is_multiple_of(LOG) {
                let shorts = gated::shorts();
                let report = Report { status, shorts, pulse: gated::newest(), captures: gate::captures() };
                let _ = self.reports.enqueue(report);
            }
        }
        ROLL.report(SUPERVISE, self.clock.now());
        self.count.is_multiple_of(PUBLISH)
    }
}

//! Supervision, and what the light and the log show.

use crate::Board;
use crate::board::Caller;
use crate::crossings::{SUPERVISE, Signals};
use edm_crossing::latest::{Reader, Writer};
use edm_crossing::ring::Sender;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::self_test::Registers;
use edm_hal_shim::tick::Period;
use edm_servo_head::head::{Counters, Fault, Measured, Monitored, State, SupervisionConfig, Supervisor};
use edm_servo_head::kept::Kept;

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
    /// Tick of the newest measurement that the supervision has monitored, for a debugger.
    pub(crate) monitored_tick: u32,
    pub(crate) measured: Reader<'static, (Measured, Counters)>,
    pub(crate) config: Reader<'static, SupervisionConfig>,
    pub(crate) kept: Kept<SupervisionConfig>,
    pub(crate) registers: B::Registers,
    pub(crate) faults: Sender<'static, Fault, 8>,
    pub(crate) monitored: Writer<'static, Monitored>,
}

impl<B: Board> Supervise<B> {
    /// One millisecond, or other limits to take at once.
    pub fn tick(&mut self) {
        let begin = self.clock.now();
        if self.config.refresh() {
            self.kept = Kept::NEW;
            self.config.accept();
            self.caller.protocol();
        }
        if !self.millisecond.begins() {
            return;
        }
        self.count = self.count.wrapping_add(1);
        if self.measured.refresh() {
            self.judge();
        }
        if !self.kept.agrees(self.config.get()) || !self.registers.is_intact() {
            self.signals.settings_damaged.set();
        }
        let end = self.clock.now();
        self.signals.times[SUPERVISE].ran(end.wrapping_sub(begin));
        self.signals.task_watchdog.report(SUPERVISE, end);
    }

    /// What it looks at and judges by.
    pub fn config(&self) -> &SupervisionConfig {
        self.config.get()
    }

    /// What it has looked at.
    pub fn measured(&self) -> &(Measured, Counters) {
        self.measured.get()
    }

    fn judge(&mut self) {
        let (measured, counters) = self.measured.get();
        let alive = self.signals.host.take();
        let fault = self.supervisor.tick(self.config.get(), measured, counters, alive);
        for (unseen, of) in self.signals.unseen.iter().zip(self.supervisor.unseen()) {
            unseen.store(of);
        }
        for (looks, of) in self.signals.looks.iter().zip(self.supervisor.shares().half_percents()) {
            looks.store(of.into());
        }
        if let Some(fault) = fault {
            self.faults.send(fault);
            self.signals.waiting.set();
        }
        // Lit without a fault, blinking with one.
        self.caller.light(measured.state != State::Fault || (self.count / BLINK).is_multiple_of(2));
        if self.count.is_multiple_of(LOG) {
            self.signals.second.set();
        }
        let supervisor = &self.supervisor;
        self.monitored.write(|monitored| *monitored = *supervisor.monitored());
        self.monitored_tick = self.measured.get().0.tick;
    }
}

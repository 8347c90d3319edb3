//! The head as a CANopen device: frames in and out, orders to the other tasks, and what they have done.

use super::timers::{self, Timers};
use super::{
    Answer, Arrival, BACKLOG, Checked, Chore, Configuration, LOST, PROTOCOL, REFLEX, ROLL, Request, Reset, SYNC_LENGTH,
    WAITING,
};
use core::sync::atomic::Ordering::Relaxed;
use edm_hal_shim::board::CORE_HZ;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::stm32f4::can::{self, Filters};
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_hal_shim::stm32f4::gated::Thresholds;
use edm_servo_head::canopen::drive::{Drive, Order};
use edm_servo_head::canopen::{Abort, BootError, Controller, Frame, IDENTIFIERS, Node, Time};
use edm_servo_head::gap::voltage;
use edm_servo_head::head::{Change, Status, SupervisionLimits};
use edm_servo_head::settings::Settings;
use edm_servo_head::stored::{Full, LoadReport, StoredImage};
use heapless::spsc::{Consumer, Producer};

/// Cycles of a microsecond.
const US: u32 = CORE_HZ / 1_000_000;

/// Node and drive, with the queues to everybody else.
pub struct Protocol {
    pub(super) clock: Cycles,
    pub(super) uptime: Uptime,
    pub(super) node: &'static mut Node,
    pub(super) drive: &'static mut Drive,
    /// `None` when the controller did not start.
    pub(super) filters: Option<Filters>,
    pub(super) thresholds: Thresholds,
    pub(super) timers: Timers,
    /// The tick that knew of the newest command first: an older status is not news.
    pub(super) known: u32,
    /// SYNCs until the newest frame that was dealt with.
    pub(super) syncs: u32,
    pub(super) received: Consumer<'static, Arrival>,
    pub(super) sending: Producer<'static, Frame>,
    pub(super) published: Consumer<'static, Status>,
    pub(super) changes: Consumer<'static, Change>,
    pub(super) checked: Consumer<'static, Checked>,
    pub(super) requests: Producer<'static, Request>,
    pub(super) answers: Consumer<'static, Answer>,
    pub(super) configurations: Producer<'static, Configuration>,
    pub(super) gaps: Producer<'static, voltage::Active>,
    pub(super) limits: Producer<'static, SupervisionLimits>,
    pub(super) resets: Producer<'static, Reset>,
}

impl Protocol {
    /// Everything that has come since the last run; the servo task begins one every millisecond, a frame one at once.
    pub fn run(&mut self) {
        let begin = self.clock.now();
        let now = self.uptime.advance(begin);
        self.frames();
        let whole = self.news(begin);
        if whole {
            // A SYNC does not wait until all of this is done.
            self.frames();
            self.node.poll(now, self.drive);
            self.frames();
            self.drive.poll(now, self.node);
        }
        self.orders();
        self.send();
        if whole {
            self.controller();
        }
        let end = self.clock.now();
        timers::ran(PROTOCOL, end.wrapping_sub(begin));
        ROLL.report(PROTOCOL, end);
    }

    /// What the controller is to listen to, and how it is.
    fn controller(&mut self) {
        let Some(filters) = &mut self.filters else { return };
        let mut identifiers = [0; can::IDENTIFIERS];
        for (slot, identifier) in identifiers.iter_mut().zip(self.node.identifiers()) {
            *slot = identifier;
        }
        filters.listen(identifiers);
        let overrun = LOST.swap(false, Relaxed);
        if overrun {
            defmt::warn!("CAN: frames lost");
        }
        let (passive, bus_off) = can::trouble();
        self.node.controller(Controller { overrun, passive, bus_off });
    }

    /// Frames that have come. What they order goes on at once.
    #[inline(never)]
    fn frames(&mut self) {
        while let Some(Arrival { frame, stamp, syncs }) = self.received.dequeue() {
            self.syncs = syncs;
            let at = self.uptime.at(stamp);
            self.node.receive(&frame, at, self.drive);
            if self.node.synchronised(at, self.drive).is_some() {
                self.drive.synchronised();
            }
            self.orders();
        }
    }

    /// What the servo task tells; whether it has told of a millisecond.
    fn news(&mut self, now: u32) -> bool {
        while let Some(answer) = self.answers.dequeue() {
            match answer {
                Answer::Command(command, result, tick) => {
                    self.known = tick;
                    self.drive.answered(command, result);
                }
                Answer::Configured(true) => self.configure_the_others(),
                Answer::Configured(false) => self.drive.configure_again(),
                Answer::NoLeave => self.node.answer(Err(Abort::DeviceState), self.drive),
            }
        }
        let mut whole = false;
        while let Some(status) = self.published.dequeue() {
            whole = true;
            if status.tick.wrapping_sub(self.known) as i32 >= 0 {
                self.drive.observe(&status);
            }
        }
        while let Some(change) = self.changes.dequeue() {
            defmt::info!("{}", change);
            self.drive.changed(change);
        }
        while let Some(result) = self.checked.dequeue() {
            match &result {
                Ok(report) => defmt::info!("guided check passed: {}", report),
                Err(finding) => defmt::warn!("guided check: {}", finding),
            }
            self.drive.checked(result);
        }
        if whole {
            self.drive.set_timers(self.timers.read(now));
        }
        whole
    }

    /// What runs with the head's configuration beside the head.
    fn configure_the_others(&mut self) {
        let active = self.drive.active();
        // A queue that is full holds a configuration that nobody has taken up yet: told again with the next one.
        let _ = self.gaps.enqueue(active.gap);
        let _ = self.limits.enqueue(active.head.supervise);
        REFLEX.set(&active.reflex);
        if self.thresholds.set(&active.reflex).is_err() {
            defmt::error!("reflex: thresholds refused");
        }
    }

    /// Hands the drive's orders on, as long as there is room for any, and then what it will order at the next SYNC.
    #[inline(never)]
    fn orders(&mut self) {
        while self.requests.ready() && self.configurations.ready() && self.resets.ready() {
            let Some(order) = self.drive.take() else {
                SYNC_LENGTH.store(self.node.sync_length(), Relaxed);
                if self.drive.foresee(self.node) {
                    self.request(Request::AtSync(self.drive.foreseen(), self.syncs));
                }
                return;
            };
            let request = match order {
                Order::Configure => {
                    let active = self.drive.active();
                    let _ = self
                        .configurations
                        .enqueue(Configuration { head: active.head, off_time_ns: active.off_time_ns });
                    WAITING.store(true, Relaxed);
                    continue;
                }
                Order::ResetNode => {
                    let _ = self.resets.enqueue(Reset::Node);
                    continue;
                }
                Order::ResetCommunication => {
                    let _ = self.resets.enqueue(Reset::Communication);
                    continue;
                }
                Order::Command(command) => Request::Command(command),
                Order::Raise(fault) => Request::Raise(fault),
                Order::Store(group) => Request::Leave(Chore::Store(group)),
                Order::Restore(group) => Request::Leave(Chore::Restore(group)),
            };
            self.request(request);
        }
    }

    fn request(&mut self, request: Request) {
        let _ = self.requests.enqueue(request);
        WAITING.store(true, Relaxed);
    }

    fn send(&mut self) {
        while self.sending.ready() {
            let Some(frame) = self.node.take() else { return };
            let _ = self.sending.enqueue(frame);
        }
        BACKLOG.store(true, Relaxed);
    }

    /// Changes what is kept as the host wants it.
    pub fn keep(&self, chore: Chore, image: &mut StoredImage) -> Result<(), Full> {
        match chore {
            Chore::Store(group) => image.keep(group, self.drive, self.node),
            Chore::Restore(group) => {
                image.forget(group);
                Ok(())
            }
        }
    }

    /// A chore is done.
    pub fn done(&mut self, result: Result<(), Abort>) {
        self.drive.kept(self.node, result);
    }

    /// The drive begins anew with what is kept.
    pub fn restart(&mut self, image: &StoredImage) -> LoadReport {
        self.drive.restart(Settings::default(), image)
    }

    /// The node begins anew with what is kept.
    pub fn boot(&mut self, image: &StoredImage) -> Result<LoadReport, BootError> {
        self.drive.boot(self.node, image)
    }
}

/// Logs what of the stored image is not in force.
#[inline(never)]
pub fn log_report(report: &LoadReport) {
    if !report.is_whole() {
        defmt::error!("settings: {}", report);
    }
}

/// Logs what of the stored communication parameters is not in force.
#[inline(never)]
pub fn log_boot(result: Result<LoadReport, BootError>) {
    match result {
        Ok(report) => log_report(&report),
        Err(error) => defmt::error!("communication: {}", error),
    }
}

const _: () = assert!(IDENTIFIERS <= can::IDENTIFIERS);

/// The cycle counter, which wraps after 25 s, as a time that does not.
pub struct Uptime {
    /// Newest count taken in, and its time.
    count: u32,
    us: u64,
}

impl Uptime {
    /// Time begins at this count.
    pub const fn new(count: u32) -> Self {
        Uptime { count, us: 0 }
    }

    /// Goes on to a count that is newer by less than 25 s.
    fn advance(&mut self, count: u32) -> Time {
        let us = count.wrapping_sub(self.count) / US;
        self.count = self.count.wrapping_add(us.wrapping_mul(US));
        self.us = self.us.wrapping_add(u64::from(us));
        Time(self.us)
    }

    /// The time of a count within 12 s of the newest one.
    fn at(&self, count: u32) -> Time {
        let us = count.wrapping_sub(self.count) as i32 / US as i32;
        Time(self.us.saturating_add_signed(us.into()))
    }
}

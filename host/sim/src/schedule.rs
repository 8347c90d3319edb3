//! A virtual head whose tasks preempt each other: by priority, at their times, and otherwise by a random seed.
//!
//! The tasks are those of [`Head`], which calls them one after the other. Here a task runs as an
//! interrupt does: after the request it may come *late*, by a time that the seed draws, and at each crossing point of
//! the task that runs (`edm_crossing::preempt`) whatever has a higher priority in `edm_hal_shim::board::TASKS` may come in
//! as a nested call. Below the servo task that includes whole periods of the PWM, so that time passes during a task of low
//! priority and its inputs change meanwhile. Two tasks of one priority never nest: each is in a `RefCell`, which would
//! panic.
//!
//! Not modelled:
//!
//! - The process cannot be split within a period, because what the servo task sets acts on the whole of the next one. Of the
//!   period to come no edge can therefore reach the gap or servo task; instead the newest edge of the period that has just
//!   ended may be served at one of their points rather than before them.
//! - Reflex, stop and bridge fault, which share nothing but atomics with the others; a PC has none of them.
//! - Time within a task: the clock is constant between two periods.
//! - The two directions of the bus do not wait for each other.

use crate::board::{PLAN, PROTOCOL, Pc, Ports, SUPERVISE, TRANSMIT};
use crate::machine::{Core, SUPERVISED, go_on, show};
use crate::process::Process;
use crate::serve::head::Head;
use edm_bus::Frame;
use edm_crossing::preempt;
use edm_hal_shim::board::priority;
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::can::Inbox;
use edm_hal_shim::double::live::TestLive;
use edm_hal_shim::encoder::Line;
use edm_hal_shim::reflex;
use edm_runtime::Signals;
use edm_runtime::can::{Receive, Transmit};
use edm_runtime::crossings;
use edm_runtime::encoder::Decoder;
use edm_runtime::gap::Gap;
use edm_runtime::idle::Idle;
use edm_runtime::plan::Plans;
use edm_runtime::protocol::Protocol;
use edm_runtime::servo::Servo;
use edm_runtime::supervise::Supervise;
use edm_servo_head::gap::voltage;
use edm_servo_head::head::{Config, LEAD, Status, SupervisionConfig};
use edm_servo_head::units::TICKS_PER_MS;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rtic_core::Mutex;
use std::cell::{Cell, RefCell, RefMut};
use std::collections::VecDeque;
use std::rc::Rc;

/// Length of a period of the PWM, us: as many bits on the bus.
const PERIOD_US: i64 = 50;
/// Frames that the controller holds on their way out.
const MAILBOXES: usize = 3;

/// Frames in the controller with which another one still fits.
const CROWDED: usize = 2;

/// Priorities, of the one table.
const ENCODER: u8 = priority("encoder_a");
const GAP: u8 = priority("gap");
const SERVO: u8 = priority("servo");
const PLANS: u8 = priority("plan");
const CAN: u8 = priority("can_receive");
const IDLE: u8 = priority("idle");

/// A task below the servo task: it runs on request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Task {
    Plan,
    Supervise,
    Receive,
    Sync,
    Transmit,
    Protocol,
}

/// Those tasks with their priorities, highest first.
const TASKS: [(Task, u8); 6] = [
    (Task::Receive, CAN),
    (Task::Sync, priority("can_sync")),
    (Task::Transmit, priority("can_transmit")),
    (Task::Plan, PLANS),
    (Task::Supervise, priority("supervise")),
    (Task::Protocol, priority("protocol")),
];

/// How late tasks come, and how often they interrupt each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Habits {
    /// Periods by which the plan comes late at the most; it is in time all the same unless `late_plans`.
    pub plan: u32,
    /// The plan may miss its tick.
    pub late_plans: bool,
    /// Periods by which the supervision comes late at the most.
    pub supervise: u32,
    /// The same for the three tasks of the controller.
    pub can: u32,
    /// The same for the protocol.
    pub protocol: u32,
    /// Periods between two rounds of idle at the most.
    pub idle: u32,
    /// Of 256 points, those at which something may come in.
    pub points: u8,
    /// Of 256 of these, those at which a whole period passes if it can.
    pub periods: u8,
}

impl Habits {
    /// No task comes late, and none interrupts: for what is not under test.
    pub const PROMPT: Habits =
        Habits { plan: 0, late_plans: false, supervise: 0, can: 0, protocol: 0, idle: 0, points: 0, periods: 0 };
    /// Within what the chip can be asked: the controller's three places are emptied in time, the protocol runs within a
    /// millisecond.
    pub const BUSY: Habits =
        Habits { plan: 1, late_plans: false, supervise: 10, can: 3, protocol: 12, idle: 40, points: 96, periods: 24 };
}

/// What the tasks run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Running {
    /// The planner.
    pub head: Config,
    /// The generator: off-time requested, ns.
    pub off_time_ns: Option<u32>,
    /// The gap task.
    pub gap: voltage::Active,
    /// The supervision.
    pub supervision: SupervisionConfig,
    /// The reflex.
    pub reflex: reflex::Config,
}

/// A virtual head under a seeded scheduler.
pub struct Scheduler(Rc<Inner>);

struct Inner {
    ports: &'static Ports,
    signals: &'static Signals,
    process: RefCell<Process>,
    decoder: RefCell<Decoder<Pc>>,
    gap: RefCell<Gap<Pc>>,
    servo: RefCell<Servo<Pc>>,
    plan: RefCell<&'static mut Plans<Pc>>,
    supervise: RefCell<&'static mut Supervise<Pc>>,
    receive: RefCell<Receive<Pc>>,
    transmit: RefCell<Transmit<Pc>>,
    protocol: RefCell<&'static mut Protocol<Pc>>,
    idle: RefCell<Idle<Pc>>,
    random: RefCell<Xoshiro256PlusPlus>,
    habits: Cell<Habits>,
    /// Priority of what runs.
    running: Cell<u8>,
    /// Period in which the requested plan comes into force, and that of the one in progress.
    due: Cell<Option<u64>>,
    planning: Cell<Option<u64>>,
    /// Periods so far.
    periods: Cell<u64>,
    /// For each requested one of [`TASKS`]: the period in which it may run.
    release: [Cell<Option<u64>>; TASKS.len()],
    /// The newest edge of the period was not served yet.
    edge: Cell<bool>,
    /// Servo ticks and blocks of conversions that will not come.
    missing: Cell<[u32; 2]>,
    /// The next round of idle.
    round: Cell<u64>,
    /// Frames on their way to the head, and what is left of the first, us.
    coming: RefCell<VecDeque<Frame>>,
    coming_us: Cell<i64>,
    /// What is left of the first frame in the mailboxes, us; `None` when it has not begun.
    going_us: Cell<Option<i64>>,
    /// Frames that the head has sent, with the period in which they ended.
    sent: RefCell<Vec<(u64, Frame)>>,
}

impl Scheduler {
    /// The tasks of a head, from now on under this seed.
    pub fn of(head: Head, seed: u64) -> Scheduler {
        let Head { process, core, receive, transmit, protocol, idle, .. } = head;
        let Core { ports, signals, decoder, gap, servo, plan, supervise, ticks, .. } = core;
        ports.mailboxes.set(Some(MAILBOXES));
        Scheduler(Rc::new(Inner {
            ports,
            signals,
            process: RefCell::new(process),
            decoder: RefCell::new(decoder),
            gap: RefCell::new(gap),
            servo: RefCell::new(servo),
            plan: RefCell::new(plan),
            due: Cell::new(None),
            planning: Cell::new(None),
            supervise: RefCell::new(supervise),
            receive: RefCell::new(receive),
            transmit: RefCell::new(transmit),
            protocol: RefCell::new(protocol.0),
            idle: RefCell::new(idle),
            random: RefCell::new(Xoshiro256PlusPlus::seed_from_u64(seed)),
            habits: Cell::new(Habits::BUSY),
            running: Cell::new(IDLE),
            periods: Cell::new(ticks.into()),
            release: Default::default(),
            edge: Cell::new(false),
            missing: Cell::new([0; 2]),
            round: Cell::new(0),
            coming: RefCell::default(),
            coming_us: Cell::new(0),
            going_us: Cell::new(None),
            sent: RefCell::default(),
        }))
    }

    /// From now on tasks have these habits.
    pub fn set_habits(&self, habits: Habits) {
        self.0.habits.set(habits);
    }

    /// Runs for so many periods of the PWM.
    pub fn run(&self, periods: u64) {
        let end = self.0.periods.get() + periods;
        self.until(end, || false);
    }

    /// Runs until the head has sent a frame that was not taken yet, or the period `end` is over; whether it has.
    pub fn until_sent(&self, end: u64) -> bool {
        self.until(end, || !self.0.sent.borrow().is_empty());
        !self.0.sent.borrow().is_empty()
    }

    fn until(&self, end: u64, done: impl Fn() -> bool) {
        let (hook, inner) = (self.0.clone(), &self.0);
        preempt::with(Rc::new(move || hook.point()), || {
            while inner.periods.get() < end && !done() {
                inner.period();
                while let Some(task) = inner.next() {
                    inner.run(task);
                }
                inner.idle();
            }
        });
        // For a console, which a test has not.
        inner.ports.notes.borrow_mut().clear();
    }

    /// Periods so far.
    pub fn periods(&self) -> u64 {
        self.0.periods.get()
    }

    /// Puts a frame on the bus, behind those that have not reached the head yet; 1 Mbit/s.
    pub fn send(&self, frame: &Frame) {
        let mut coming = self.0.coming.borrow_mut();
        if coming.is_empty() {
            self.0.coming_us.set(frame.bits().into());
        }
        coming.push_back(*frame);
    }

    /// Frames that have not reached the head yet.
    pub fn coming(&self) -> usize {
        self.0.coming.borrow().len()
    }

    /// Takes what the head has sent, each frame with the period in which it ended.
    pub fn take(&self) -> Vec<(u64, Frame)> {
        self.0.sent.take()
    }

    /// The machine and the process.
    pub fn process(&self) -> RefMut<'_, Process> {
        self.0.process.borrow_mut()
    }

    /// What the head knows after its newest tick.
    pub fn status(&self) -> Status {
        let mut status = *self.0.plan.borrow().planner().status();
        self.0.servo.borrow().follower().report(&mut status);
        status
    }

    /// Output of the bridge.
    pub fn drive(&self) -> Drive {
        self.0.ports.drive.get()
    }

    /// Reports for a protocol that is kept from running.
    pub fn protocol_reports(&self) {
        self.0.signals.task_watchdog.report(crossings::PROTOCOL, self.0.ports.now.get());
    }

    /// Stops the head's clock.
    pub fn stop_clock(&self) {
        self.0.ports.stands_at.set(Some(self.0.ports.now.get()));
    }

    /// The settings of the gap task are no longer what they were.
    pub fn damage_gap_settings(&self) {
        self.0.ports.gap_damaged.set(true);
    }

    /// A register of the chip is no longer what it was.
    pub fn change_register(&self) {
        self.0.ports.register_changed.set(true);
    }

    /// So many servo ticks, and blocks of conversions, do not come from now on.
    pub fn lose(&self, ticks: u32, blocks: u32) {
        self.0.missing.set([ticks, blocks]);
    }

    /// The live signal, and the circuit behind it.
    pub fn live(&self) -> RefMut<'_, TestLive> {
        self.0.ports.live.borrow_mut()
    }

    /// Reads the protocol.
    pub fn protocol<R>(&self, look: impl FnOnce(&Protocol<Pc>) -> R) -> R {
        look(&self.0.protocol.borrow())
    }

    /// Settings that each task runs.
    pub fn running(&self) -> Running {
        let ports = self.0.ports;
        Running {
            head: *self.0.plan.borrow().planner().config(),
            off_time_ns: ports.off_time_ns.get(),
            gap: *self.0.gap.borrow().source().voltage.active(),
            supervision: *self.0.supervise.borrow().config(),
            reflex: ports.thresholds.get().expect("the reflex has thresholds from the start"),
        }
    }

    /// Times that the controller had to drop frames because its places were full, as far as it can distinguish them, and the
    /// frames. Counts of its own, not the head's.
    pub fn overruns(&self) -> (u64, u64) {
        (self.0.ports.overruns.get(), self.0.ports.dropped.get())
    }
}

impl Inner {
    /// A number below `bound`.
    fn below(&self, bound: u64) -> u64 {
        self.random.borrow_mut().random_range(0..bound.max(1))
    }

    /// What runs next at this priority, which nothing of a lower one may interrupt.
    fn at<R>(&self, priority: u8, task: impl FnOnce() -> R) -> R {
        let before = self.running.replace(priority);
        let result = task();
        self.running.set(before);
        result
    }

    /// A crossing point of what runs: something of a higher priority comes in, or not.
    fn point(&self) {
        let running = self.running.get();
        let habits = self.habits.get();
        if running >= ENCODER || habits.points == 0 {
            return;
        }
        let [come, whole, ..] = self.random.borrow_mut().random::<u64>().to_le_bytes();
        if come >= habits.points {
            return;
        }
        if running >= SERVO {
            self.late_edge();
        } else if whole < habits.periods
            && !(running >= PLANS && self.is_due())
            && !(running >= CAN && self.is_crowded())
        {
            self.period();
        } else if let Some(task) = self.next() {
            self.run(task);
        }
    }

    /// Whether the next period needs a plan that is not there.
    fn is_due(&self) -> bool {
        let next = self.periods.get() + 1;
        let due = [&self.due, &self.planning].iter().any(|due| due.get().is_some_and(|due| next >= due));
        due && !self.habits.get().late_plans
    }

    /// Whether another frame might not fit the controller, which is to be emptied in time.
    fn is_crowded(&self) -> bool {
        let full = self.ports.inboxes.iter().any(|inbox| inbox.borrow().len() >= CROWDED);
        full && self.habits.get().can <= Habits::BUSY.can
    }

    /// One period of the PWM: the process, the edges of the encoder, the block, the tick.
    fn period(&self) {
        if self.running.get() < PLANS
            && self.is_due()
            && let Some(plan) = TASKS.iter().position(|(task, _)| *task == Task::Plan)
        {
            self.run(plan);
        }
        if self.running.get() < CAN && self.is_crowded() {
            for (number, (task, _)) in TASKS.iter().enumerate() {
                if matches!(task, Task::Receive | Task::Sync) && self.asked(*task) {
                    self.run(number);
                }
            }
        }
        let ports = self.ports;
        self.bus();
        let periods = self.periods.get() + 1;
        self.periods.set(periods);
        self.at(ENCODER, || {
            let mut process = self.process.borrow_mut();
            let late = self.habits.get().points > 0 && self.below(4) == 0;
            let sensors = go_on(ports, &mut process);
            let held = usize::from(late && !sensors.edges.is_empty());
            for &(time, levels) in sensors.edges.iter().rev().skip(held).rev() {
                ports.now.set(time);
                ports.levels.set(levels);
                self.decoder.borrow_mut().edge(Line::A);
            }
            self.edge.set(held > 0);
            show(ports, &process);
        });
        let [ticks, blocks] = self.missing.get();
        self.missing.set([ticks.saturating_sub(1), blocks.saturating_sub(1)]);
        if blocks > 0 {
            ports.block.set(None);
        }
        self.at(GAP, || self.gap.borrow_mut().block());
        if ticks == 0 {
            self.at(SERVO, || self.servo.borrow_mut().tick());
        }
        self.late_edge();
        ports.position.set(self.servo.borrow().follower().position());
        if ports.wants[PLAN].get() && self.due.get().is_none() {
            self.due.set(Some(periods + u64::from(LEAD)));
        }
        if periods % u64::from(TICKS_PER_MS) == u64::from(SUPERVISED) {
            ports.period.set(true);
            ports.wants[SUPERVISE].set(true);
        }
    }

    /// Serves the edge that was held back.
    fn late_edge(&self) {
        if self.edge.take() {
            self.at(ENCODER, || self.decoder.borrow_mut().edge(Line::A));
        }
    }

    /// What the bus carries in a period.
    fn bus(&self) {
        let mut coming = self.coming.borrow_mut();
        self.coming_us.set(self.coming_us.get() - PERIOD_US);
        while let Some(frame) = coming.front()
            && self.coming_us.get() <= 0
        {
            self.ports.arrives(frame);
            coming.pop_front();
            let next = coming.front().map_or(0, |frame| frame.bits().into());
            self.coming_us.set(self.coming_us.get() + next);
        }
        let mut outbox = self.ports.outbox.borrow_mut();
        let Some(frame) = outbox.front() else { return };
        let left = self.going_us.get().unwrap_or_else(|| frame.bits().into()) - PERIOD_US;
        self.going_us.set(Some(left));
        if left <= 0 {
            self.sent.borrow_mut().push((self.periods.get(), *frame));
            outbox.pop_front();
            self.going_us.set(outbox.front().map(|frame| left + i64::from(frame.bits())));
            self.ports.mailboxes.set(Some(MAILBOXES - outbox.len()));
            self.ports.wants[TRANSMIT].set(true);
        }
    }

    /// Whether a task was requested.
    fn asked(&self, task: Task) -> bool {
        let waits = |inbox: Inbox| !self.ports.inboxes[inbox as usize].borrow().is_empty();
        match task {
            Task::Plan => self.ports.wants[PLAN].get(),
            Task::Supervise => self.ports.wants[SUPERVISE].get(),
            Task::Receive => waits(Inbox::Others),
            Task::Sync => waits(Inbox::Sync),
            Task::Transmit => self.ports.wants[TRANSMIT].get(),
            Task::Protocol => self.ports.wants[PROTOCOL].get(),
        }
    }

    /// The first requested task whose time has come and that may interrupt the running one.
    fn next(&self) -> Option<usize> {
        let (now, habits) = (self.periods.get(), self.habits.get());
        let mut tasks = TASKS.iter().enumerate().take_while(|(_, (_, priority))| *priority > self.running.get());
        tasks.find_map(|(number, (task, _))| {
            if !self.asked(*task) {
                return None;
            }
            let release = self.release[number].get().unwrap_or_else(|| {
                let most = match task {
                    Task::Plan => habits.plan,
                    Task::Supervise => habits.supervise,
                    Task::Receive | Task::Sync | Task::Transmit => habits.can,
                    Task::Protocol => habits.protocol,
                };
                // Soon more often than late: otherwise hardly anything would ever come in time.
                let most = u64::from(most) + 1;
                let late = self.below(most).min(self.below(most));
                self.release[number].set(Some(now + late));
                now + late
            });
            (release <= now).then_some(number)
        })
    }

    /// Runs a requested task.
    fn run(&self, number: usize) {
        let Some((task, priority)) = TASKS.get(number).copied() else { return };
        self.release[number].set(None);
        // Whoever asks from here on asks for one run more.
        self.at(priority, || match task {
            Task::Plan => {
                self.ports.wants[PLAN].set(false);
                self.planning.set(self.due.take());
                self.plan.borrow_mut().run();
                self.planning.set(None);
            }
            Task::Supervise => {
                self.ports.wants[SUPERVISE].set(false);
                self.supervise.borrow_mut().tick();
            }
            Task::Receive => self.receive.borrow_mut().frames(Inbox::Others),
            Task::Sync => self.receive.borrow_mut().frames(Inbox::Sync),
            Task::Transmit => {
                self.ports.wants[TRANSMIT].set(false);
                self.transmit.borrow_mut().frames();
            }
            Task::Protocol => {
                self.ports.wants[PROTOCOL].set(false);
                self.protocol.borrow_mut().run();
            }
        });
    }

    fn idle(&self) {
        if self.round.get() > self.periods.get() {
            return;
        }
        self.idle.borrow_mut().round(&mut Ceiling(self));
        self.round.set(self.periods.get() + 1 + self.below(u64::from(self.habits.get().idle) + 1));
    }
}

/// The protocol as idle sees it: while idle has it, nothing of its priority comes in.
struct Ceiling<'a>(&'a Inner);

impl Mutex for Ceiling<'_> {
    type T = &'static mut Protocol<Pc>;
    fn lock<R>(&mut self, f: impl FnOnce(&mut &'static mut Protocol<Pc>) -> R) -> R {
        self.0.at(priority("protocol"), || f(&mut self.0.protocol.borrow_mut()))
    }
}

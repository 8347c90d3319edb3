//! The head as a CANopen device: frames in and out, orders to the other tasks, and what they have done.
//!
//! A host's write to a setting is answered when every task runs it: the planner first, because it may refuse it, then
//! gap task, supervision and reflex. Until then the host waits, some 0.1 ms, and a further configuration waits with it.

use crate::Board;
use crate::Note;
use crate::board::Caller;
use crate::crossings::{
    ANSWERS, Answer, Arrival, Commissioned, HeadConfig, PROTOCOL, Preview, REQUESTS, Request, Reset, Signals,
    StorageJob,
};
use crate::timers::Timers;
use edm_crossing::atomic::Word;
use edm_crossing::latest::{Reader, Writer};
use edm_crossing::ring::{Receiver, Sender};
use edm_hal_shim::can::{Filters, Trouble};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::reflex::Thresholds;
use edm_servo_head::canopen::drive::{Drive, Generations, Lost, Order};
use edm_servo_head::canopen::{Abort, BootError, Controller, Frame, Group, Node, Time};
use edm_servo_head::gap::voltage::{self, SLOW};
use edm_servo_head::head::{Change, Evidence, Inch, SetPoint, Status, SupervisionConfig};
use edm_servo_head::scope::Setup;
use edm_servo_head::settings::Settings;
use edm_servo_head::stored::{Full, LoadReport, StoredImage};

/// How far the newest configuration has got.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Configuring {
    /// It runs everywhere, or was refused.
    Done,
    /// The planner has been asked.
    Head,
    /// The head runs it; gap task and supervision are to take it.
    Others,
}

/// Of those words, so many are taken in a millisecond: all of them in nine.
const SLOW_A_MS: usize = 4;

/// Node and drive, with the crossings to everybody else.
pub struct Protocol<B: Board> {
    pub(crate) clock: B::Clock,
    pub(crate) caller: B::Caller,
    pub(crate) signals: &'static Signals,
    pub(crate) uptime: Uptime,
    pub(crate) node: &'static mut Node,
    pub(crate) drive: &'static mut Drive,
    /// Settings of a head that has nothing stored.
    pub(crate) defaults: Settings,
    /// `None` when the controller did not start.
    pub(crate) filters: Option<B::Filters>,
    pub(crate) thresholds: B::Thresholds,
    pub(crate) timers: Timers,
    /// Which of the words that the gap source says in turns is taken next.
    pub(crate) slow: usize,
    pub(crate) configuring: Configuring,
    /// Requests sent and not answered.
    pub(crate) outstanding: usize,
    /// The storage job under way, and one that waits for its end: 1010h and layer setting ask independently of each other.
    pub(crate) jobs: [Option<StorageJob>; 2],
    /// What was lost, as reported last.
    pub(crate) lost: Lost,
    /// The tick that knew of the newest command first: an older status is not news.
    pub(crate) known: u32,
    /// SYNCs until the newest frame that was dealt with.
    pub(crate) syncs: u32,
    pub(crate) ends: HostEnds,
    pub(crate) received: Receiver<'static, Arrival, 32>,
    pub(crate) sending: Sender<'static, Frame, 8>,
    pub(crate) resets: Sender<'static, Reset, 4>,
}

/// The ends of the crossings by which a head is commanded: the protocol's, or those of a test instead of it.
pub struct HostEnds {
    /// Requests to the planner.
    pub requests: Sender<'static, Request, REQUESTS>,
    /// What came of them.
    pub answers: Receiver<'static, Answer, ANSWERS>,
    /// What the planner is to run.
    pub head: Writer<'static, HeadConfig>,
    /// What the next SYNC releases.
    pub previews: Writer<'static, Preview>,
    /// What the servo task is to record.
    pub setups: Writer<'static, Setup>,
    /// What the gap task is to run.
    pub gap: Writer<'static, voltage::Active>,
    /// What the supervision is to judge by.
    pub supervision: Writer<'static, SupervisionConfig>,
    /// How the head is, after every plan.
    pub published: Reader<'static, Status>,
    /// Changes of its state.
    pub changes: Receiver<'static, Change, 16>,
    /// Results of commissionings.
    pub commissioned: Receiver<'static, Commissioned, 2>,
    /// What a head shows that measures itself.
    pub evidence: Receiver<'static, Evidence, 2>,
}

impl<B: Board> Protocol<B> {
    /// Everything that has come since the last run; the servo task begins one every millisecond, a frame or an answer one at
    /// once.
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
        self.signals.times[PROTOCOL].ran(end.wrapping_sub(begin));
        self.signals.task_watchdog.report(PROTOCOL, end);
    }

    /// The node.
    pub fn node(&self) -> &Node {
        self.node
    }

    /// How the head is.
    pub fn status(&self) -> &Status {
        self.ends.published.get()
    }

    /// The drive.
    pub fn drive(&self) -> &Drive {
        self.drive
    }

    /// What the controller is to listen to, and how fast, and how it is.
    fn controller(&mut self) {
        let Some(filters) = &mut self.filters else { return };
        let [sync, others @ ..] = self.node.identifiers();
        filters.listen(sync, &others);
        filters.join(self.node.bus().bit_rate.hz());
        let frames = self.signals.overruns.read().wrapping_add(self.received.lost());
        let ends = &self.ends;
        let rings = [ends.changes.lost(), ends.commissioned.lost(), ends.evidence.lost(), ends.answers.lost()];
        let before_them = [self.signals.lost_faults.load(), self.signals.lost_changes.load()];
        let [high, low] = &self.signals.unseen;
        let lost = Lost {
            frames,
            events: rings.into_iter().chain(before_them).fold(0, u32::wrapping_add),
            ticks: self.signals.lost_ticks.load(),
            blocks: self.signals.lost_blocks.load(),
            unseen: [high.load(), low.load()],
            rings: self.thresholds.gate_rung(),
        };
        let before = core::mem::replace(&mut self.lost, lost);
        let (overrun, events) = (lost.frames != before.frames, Lost { frames: before.frames, ..lost } != before);
        let Trouble { passive, bus_off } = filters.trouble();
        self.node.controller(Controller { overrun, events, passive, bus_off });
        if lost != before {
            self.drive.set_lost(lost);
            self.caller.note(&Note::Lost(lost));
        }
    }

    /// Received frames. Their orders are passed on at once.
    fn frames(&mut self) {
        while let Some(Arrival { frame, stamp, syncs }) = self.received.receive() {
            self.syncs = syncs;
            let at = self.uptime.at(stamp);
            self.node.receive(&frame, at, self.drive);
            if self.node.synchronised(at, self.drive).is_some() {
                self.drive.synchronised();
            }
            self.orders();
        }
    }

    /// Answers of planner and servo task; whether a millisecond has begun.
    fn news(&mut self, now: u32) -> bool {
        while let Some(answer) = self.ends.answers.receive() {
            if !matches!(answer, Answer::SyncPreview(..)) {
                self.outstanding = self.outstanding.saturating_sub(1);
            }
            match answer {
                Answer::Command(command, result, tick) | Answer::SyncPreview(command, result, tick) => {
                    self.known = tick;
                    self.drive.answered(command, result);
                }
                Answer::Configured => self.configured(),
                Answer::NoPermit(job) => {
                    self.jobs[0] = None;
                    self.node.answer(job.group(), Err(Abort::DeviceState), self.drive);
                }
                Answer::Done => {}
            }
        }
        if self.configuring == Configuring::Others {
            self.taken();
        }
        let whole = self.signals.millisecond.take();
        if self.ends.published.refresh() {
            let status = self.ends.published.get();
            if status.tick.wrapping_sub(self.known) as i32 >= 0 {
                self.drive.observe(status);
                self.caller.ask(status.inch == Inch::Asks);
                self.caller.takes_steps(status.takes_steps);
            }
        }
        while let Some(change) = self.ends.changes.receive() {
            self.caller.note(&Note::Changed(change));
            self.drive.changed(change);
        }
        while let Some(result) = self.ends.commissioned.receive() {
            self.caller.note(&Note::Checked(result));
            self.drive.checked(result);
        }
        while let Some(evidence) = self.ends.evidence.receive() {
            self.drive.evidence(&evidence);
        }
        if whole {
            self.drive.set_timers(self.timers.read(&self.signals.times, now));
            self.drive.set_looks(self.signals.looks.each_ref().map(Word::load));
            self.drive.set_pauses(self.thresholds.pauses_begun());
            self.drive.set_steps(self.signals.steps.each_ref().map(Word::load));
            self.drive.set_recorded(self.signals.record.load(), self.signals.snapshot.load());
            self.slow();
            self.teach();
        }
        whole
    }

    /// Some of what the gap source says in turns goes to the drive.
    fn slow(&mut self) {
        for _ in 0..SLOW_A_MS {
            if let Some(word) = self.signals.slow.get(self.slow) {
                self.drive.set_slow(self.slow, word.load());
            }
            self.slow = if self.slow + 1 < SLOW { self.slow + 1 } else { 0 };
        }
    }

    /// What was seen of the pulses goes to the drive, and what it wants to see to the gap task.
    fn teach(&mut self) {
        let teaching = &self.signals.teaching;
        self.drive.set_looks_at_levels(teaching.levels.load(), teaching.burned());
        teaching.want(self.drive.teaching());
        if self.drive.learns() {
            self.drive.taught(&teaching.gathered());
        }
    }

    /// Asks the planner to run what the drive says now.
    fn configure(&mut self) {
        let active = self.drive.active();
        self.ends.head.write(|slot| *slot = HeadConfig { head: active.head, off_time_ns: active.off_time_ns });
        self.configuring = Configuring::Head;
        self.generations();
        self.request(Request::Configure);
    }

    /// The planner has accepted or refused the newest configuration. There is never a second one: the drive orders none before it
    /// knows what became of the last, and [`Protocol::restart`] waits for that, too.
    fn configured(&mut self) {
        let verdict = self.ends.head.verdict();
        debug_assert_eq!(verdict.generation, self.ends.head.generation(), "two configurations on their way");
        if !verdict.accepted {
            self.configuring = Configuring::Done;
            self.drive.refused_configuration();
            self.node.written(Err(Abort::DeviceState), self.drive);
            self.generations();
            return;
        }
        self.configuring = Configuring::Others;
        let active = self.drive.active();
        self.ends.gap.write(|slot| *slot = active.gap);
        self.ends.supervision.write(|slot| *slot = active.head.supervision());
        self.signals.reflex.set(&active.reflex);
        if self.thresholds.set(&active.reflex).is_err() {
            self.caller.note(&Note::ThresholdsRefused);
        }
        self.signals.pauses.set(&active.pause);
        self.thresholds.watch_ends(&active.pause);
        self.caller.supervise();
    }

    /// Whether gap task and supervision run the newest configuration, too.
    fn taken(&mut self) {
        let gap = self.ends.gap.verdict().generation == self.ends.gap.generation();
        let supervision = self.ends.supervision.verdict().generation == self.ends.supervision.generation();
        if gap && supervision {
            self.configuring = Configuring::Done;
            self.drive.runs_configuration();
            self.node.written(Ok(()), self.drive);
        }
        self.generations();
    }

    /// Which configuration each task runs, for the host. Those that the planner has refused do not count: gap task and
    /// supervision never receive them.
    fn generations(&mut self) {
        let servo = self.ends.gap.generation();
        let waits = self.configuring == Configuring::Head || self.drive.is_stale();
        self.drive.set_generations(Generations {
            newest: servo.wrapping_add(waits.into()),
            servo,
            gap: self.ends.gap.verdict().generation,
            supervision: self.ends.supervision.verdict().generation,
        });
    }

    /// Hands the drive's orders on, as long as there is room for any, and then what it will order at the next SYNC.
    fn orders(&mut self) {
        if let Some(setup) = self.drive.recording() {
            self.ends.setups.write(|slot| *slot = setup);
            self.signals.waiting.set();
        }
        while self.outstanding < REQUESTS && self.resets.room() > 0 {
            if let [None, next @ Some(_)] = &mut self.jobs
                && let Some(job) = next.take()
            {
                self.store(job);
                continue;
            }
            let Some(order) = self.drive.take() else {
                self.signals.sync_length.store(self.node.sync_length().into());
                if self.drive.preview_sync(self.node) {
                    self.preview();
                }
                return;
            };
            match order {
                Order::Configure => self.configure(),
                Order::ResetNode => self.resets.send(Reset::Node),
                Order::ResetCommunication => self.resets.send(Reset::Communication),
                Order::Command(command) => self.request(Request::Command(command)),
                Order::Raise(fault) => self.request(Request::Raise(fault)),
                Order::Store(group) => self.store(StorageJob::Store(group)),
                Order::Restore(group) => self.store(StorageJob::Restore(group)),
                Order::Update(update) => self.store(StorageJob::Update(update)),
            }
        }
    }

    /// Begins a storage job, or has it wait for the end of another.
    fn store(&mut self, job: StorageJob) {
        match &mut self.jobs {
            [under_way @ None, _] => {
                *under_way = Some(job);
                self.request(Request::PermitWrite(job));
            }
            [_, next @ None] => *next = Some(job),
            // Neither SDO server nor layer setting asks again before it is answered.
            _ => self.node.answer(job.group(), Err(Abort::DeviceState), self.drive),
        }
    }

    fn request(&mut self, request: Request) {
        self.outstanding = self.outstanding.saturating_add(1);
        self.ends.requests.send(request);
        self.signals.waiting.set();
    }

    /// What the next SYNC releases now.
    fn preview(&mut self) {
        let axis = &self.drive.active().head.axis;
        let point = self.drive.sync_preview().map(|point| SetPoint {
            to: point.to,
            counts: axis.counts(point.to),
            ticks: point.ticks,
        });
        self.ends.previews.write(|preview| *preview = (point, self.syncs));
        self.signals.waiting.set();
    }

    fn send(&mut self) {
        while self.sending.room() > 0 {
            let Some(frame) = self.node.take() else {
                self.caller.transmit();
                return;
            };
            self.sending.send(frame);
        }
        self.signals.backlog.set();
        self.caller.transmit();
    }

    /// Changes what is stored as the host wants it.
    ///
    /// # Errors
    /// There is no room for it.
    pub fn keep(&self, job: StorageJob, image: &mut StoredImage) -> Result<(), Full> {
        match job {
            StorageJob::Store(group) => image.keep(group, self.drive, self.node),
            StorageJob::Restore(group) => {
                image.forget(group);
                Ok(())
            }
            StorageJob::Update(_) => Ok(()),
        }
    }

    /// A storage job is done.
    pub fn done(&mut self, job: StorageJob, result: Result<(), Abort>) {
        self.jobs[0] = None;
        self.drive.stored(self.node, job.group(), result);
    }

    /// A part of an update of the program is done, and how the stage is.
    pub(crate) fn updated(&mut self, result: Result<(), Abort>, status: u32) {
        self.jobs[0] = None;
        self.staged(status);
        self.node.answer(Group::All, result, self.drive);
        self.caller.protocol();
    }

    /// How the stage of the next program is.
    pub(crate) fn staged(&mut self, status: u32) {
        self.node.set_flash(status);
    }

    /// The program, known by this, begins anew.
    pub(crate) fn begin_anew(&mut self, id: u32) {
        self.node.set_program(id);
        self.node.begin_anew(self.drive);
        self.caller.protocol();
    }

    /// The drive begins anew with what is stored; `None` while a configuration is on its way to the tasks, which takes less
    /// than a millisecond: what comes back then would be taken for the new one.
    pub fn restart(&mut self, image: &StoredImage) -> Option<LoadReport> {
        let settled = self.configuring == Configuring::Done;
        settled.then(|| self.drive.restart(self.defaults, image))
    }

    /// The node begins anew with what is stored.
    ///
    /// # Errors
    /// As [`Node::boot`].
    pub fn boot(&mut self, image: &StoredImage) -> Result<LoadReport, BootError> {
        self.drive.boot(self.node, image)
    }
}

/// The clock, which wraps after 25 s, as a time that does not.
pub struct Uptime {
    /// Newest count taken in, and its time.
    count: u32,
    us: u64,
    /// Counts of a microsecond.
    per_us: u32,
}

impl Uptime {
    /// Time begins at this count of a clock of `hz`, whole MHz.
    pub const fn new(count: u32, hz: u32) -> Self {
        let per_us = hz / 1_000_000;
        Uptime { count, us: 0, per_us: if per_us == 0 { 1 } else { per_us } }
    }

    /// Goes on to a count that is newer by less than 25 s.
    fn advance(&mut self, count: u32) -> Time {
        let us = count.wrapping_sub(self.count).checked_div(self.per_us).unwrap_or(0);
        self.count = self.count.wrapping_add(us.wrapping_mul(self.per_us));
        self.us = self.us.wrapping_add(u64::from(us));
        Time(self.us)
    }

    /// The time of a count within 12 s of the newest one.
    fn at(&self, count: u32) -> Time {
        let us = (count.wrapping_sub(self.count) as i32).checked_div(self.per_us as i32).unwrap_or(0);
        Time(self.us.saturating_add_signed(us.into()))
    }
}

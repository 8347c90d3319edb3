//! The plan task: below the servo tick, which asks for it with an estimate.

use crate::Board;
use crate::board::Caller;
use crate::crossings::{
    ANSWERS, Answer, Commissioned, HeadConfig, PLAN, REQUESTS, Request, ServoConfig, Signals, StorageJob,
};
use edm_crossing::latest::{Reader, Writer};
use edm_crossing::ring::{Receiver, Sender};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::steps::{Found, StepInput};
use edm_servo_head::head::{
    Change, Command, Estimate, Evidence, Fault, Monitored, Plan, Planner, Reason, Refused, Status, WritePermit,
};
use edm_servo_head::path::Path;
use edm_servo_head::scope::Scales;
use edm_servo_head::units::CLOCK_HZ;

/// The newest commands, and the tick whose estimate they were carried out on: a debugger, or the emulated chip, may look at it.
pub struct Executed {
    commands: [Command; REQUESTS],
    count: usize,
    tick: u32,
}

impl Executed {
    /// None yet.
    pub const NONE: Executed = Executed { commands: [Command::Enable; REQUESTS], count: 0, tick: 0 };

    fn push(&mut self, command: Command, tick: u32) {
        if self.tick != tick {
            (self.tick, self.count) = (tick, 0);
        }
        if let Some(slot) = self.commands.get_mut(self.count) {
            *slot = command;
            self.count = self.count.wrapping_add(1);
        }
    }
}

/// The planner with its requests and its answers.
pub struct Plans<B: Board> {
    pub(crate) planner: Planner<&'static mut Path>,
    pub(crate) steps: B::Steps,
    pub(crate) clock: B::Clock,
    pub(crate) caller: B::Caller,
    pub(crate) signals: &'static Signals,
    pub(crate) executed: Executed,
    /// The newest fault that the protocol has raised, and the tick of the estimate; for a debugger, as those below.
    pub(crate) raised: (Fault, u32),
    /// Ticks of the estimates that the newest plan was begun and that it was made on.
    pub(crate) begun: u32,
    pub(crate) made: u32,
    /// Tick of the supervision's newest values then.
    pub(crate) monitored_tick: u32,
    pub(crate) estimates: Reader<'static, Estimate>,
    pub(crate) monitored: Reader<'static, Monitored>,
    pub(crate) plans: Writer<'static, Plan>,
    pub(crate) requests: Receiver<'static, Request, REQUESTS>,
    pub(crate) answers: Sender<'static, Answer, ANSWERS>,
    pub(crate) config: Reader<'static, HeadConfig>,
    pub(crate) servo: Writer<'static, ServoConfig>,
    pub(crate) granted: Sender<'static, (StorageJob, WritePermit), 1>,
    pub(crate) returned: Receiver<'static, WritePermit, 1>,
    pub(crate) published: Writer<'static, Status>,
    pub(crate) changes: Sender<'static, Change, 16>,
    pub(crate) commissioned: Sender<'static, Commissioned, 2>,
    pub(crate) evidence: Sender<'static, Evidence, 2>,
}

impl<B: Board> Plans<B> {
    /// Plans, if there is an estimate to plan on.
    pub fn run(&mut self) {
        let begin = self.clock.now();
        if !self.estimates.refresh() {
            return;
        }
        self.begun = self.tick();
        if self.monitored.refresh() {
            let monitored = self.monitored.get();
            self.monitored_tick = monitored.tick;
            self.planner.watch(monitored);
            if !self.planner.is_intact() {
                self.signals.settings_damaged.set();
            }
        }
        self.planner.begin(self.estimates.get());
        self.count_steps();
        let mut answered = self.set_point();
        while let Some(permit) = self.returned.receive() {
            self.planner.end_write(permit);
        }
        while let Some(request) = self.requests.receive() {
            let answer = self.carry_out(request);
            self.answers.send(answer);
            answered = true;
        }
        let planner = &mut self.planner;
        self.plans.write(|plan| planner.plan(plan));
        self.signals.pauses.set_least((planner.generator().off_time.0 * CLOCK_HZ as f32) as u32);
        self.published.write(|status| *status = *planner.status());
        while let Some(change) = planner.next_change() {
            self.changes.send(change);
            if let (Reason::CommissioningEnded, Some(result)) = (change.reason, planner.commissioning_result()) {
                self.commissioned.send(result);
            }
        }
        if let Some(evidence) = planner.evidence() {
            self.evidence.send(evidence);
        }
        self.signals.lost_changes.store(planner.lost_changes());
        if answered {
            self.caller.protocol();
        }
        self.made = self.begun;
        let end = self.clock.now();
        self.signals.times[PLAN].ran(end.wrapping_sub(begin));
        self.signals.task_watchdog.report(PLAN, end);
    }

    /// The planner, as it is after the newest plan.
    pub fn planner(&self) -> &Planner<&'static mut Path> {
        &self.planner
    }

    /// What the newest plan was made of.
    pub fn estimate(&self) -> &Estimate {
        self.estimates.get()
    }

    /// What a host has stepped since the plan before.
    fn count_steps(&mut self) {
        let [counted, within, lost] = &self.signals.steps;
        let mut sum = 0i32;
        let Plans { planner, steps, .. } = self;
        let polarity = planner.config().step.polarity;
        let found = steps.read(polarity, |run| {
            sum = sum.wrapping_add(run);
            planner.step(run);
        });
        if sum != 0 {
            counted.store(counted.load().wrapping_add_signed(sum));
        }
        if found != Found::default() {
            if found.lost {
                self.planner.lose_steps();
            }
            within.store(within.load().wrapping_add(found.within));
            lost.store(lost.load().wrapping_add(found.lost.into()));
        }
    }

    /// A SYNC has released a set point, which the servo task follows since.
    fn set_point(&mut self) -> bool {
        let Some(point) = self.estimates.get().set_point else { return false };
        let command = Command::Follow(point.to, point.ticks);
        let result = self.planner.command(command);
        self.answers.send(Answer::SyncPreview(command, result, self.tick()));
        true
    }

    fn tick(&self) -> u32 {
        self.estimates.get().tick
    }

    fn command(&mut self, command: Command) -> Result<(), Refused> {
        self.executed.push(command, self.estimates.get().tick);
        self.planner.command(command)
    }

    fn carry_out(&mut self, request: Request) -> Answer {
        match request {
            Request::Command(command) => Answer::Command(command, self.command(command), self.tick()),
            Request::Configure => self.configure(),
            Request::Raise(fault) => {
                self.raised = (fault, self.tick());
                self.planner.raise(fault);
                Answer::Done
            }
            Request::PermitWrite(job) => match self.planner.permit_write() {
                // Idle goes on. There is one permit, and room for it.
                Ok(permit) => {
                    self.granted.send((job, permit));
                    Answer::Done
                }
                Err(_) => Answer::NoPermit(job),
            },
        }
    }

    /// The newest configuration runs from this plan on, or is refused.
    fn configure(&mut self) -> Answer {
        if self.config.refresh() {
            let HeadConfig { head, off_time_ns } = *self.config.get();
            if self.planner.configure(head).is_ok() {
                let follow = self.planner.follow_config();
                let scales = Scales::of(&head.axis);
                self.servo.write(|slot| *slot = ServoConfig { follow, off_time_ns, scales });
                self.signals.waiting.set();
                self.config.accept();
            } else {
                self.config.refuse();
            }
        }
        Answer::Configured
    }
}

//! From the parts of a board to the tasks of a head: every end of every crossing goes to its task.

use crate::Board;
use crate::can::{Receive, Transmit};
use crate::crossings::{Arrival, Crossings, HeadConfig, Reset, ServoConfig, Signals, StorageJob, TickCrossings};
use crate::encoder::Decoder;
use crate::gap::Gap;
use crate::idle::Idle;
use crate::image_store::ImageStore;
use crate::live::{self, ClockCheck};
use crate::plan::{Executed, Plans};
use crate::protocol::{Configuring, Protocol, Uptime};
use crate::servo::{Chore, FIRST_CHORE, Servo};
use crate::staging::Staging;
use crate::supervise::Supervise;
use crate::timers::Timers;
use core::mem::MaybeUninit;
use edm_crossing::ring::{Receiver, Sender};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::QuadratureLines;
use edm_hal_shim::generator::Generator;
use edm_hal_shim::reflex::{ForcedLines, Thresholds};
use edm_hal_shim::self_test::SelfTest;
use edm_servo_head::backup::Keeper;
use edm_servo_head::canopen::drive::{Drive, Lost};
use edm_servo_head::canopen::{Frame, Node};
use edm_servo_head::encoder::{DecoderCount, Handover, Quadrature, Shared as Published, TimerCount};
use edm_servo_head::gap::{GapReading, Quality};
use edm_servo_head::head::{
    Counters, Estimate, Fault, Follower, Measured, Monitored, Plan, Planner, State, Status, Supervisor, TickInput,
    WritePermit,
};
use edm_servo_head::kept::Kept;
use edm_servo_head::path::Path;
use edm_servo_head::scope::{Memory, Recorder, Scales, Setup, Snapshots};
use edm_servo_head::settings::{Active, Settings};

pub use crate::protocol::HostEnds;

/// The parts of a board that runs; each goes to one task.
#[allow(missing_docs, reason = "each is the part of its type")]
pub struct Parts<B: Board> {
    pub clock: B::Clock,
    pub caller: B::Caller,
    /// What the board has found of itself.
    pub self_test: SelfTest,
    pub registers: B::Registers,
    /// Where the decoder publishes, twice: as its task knows it and as its readers do.
    pub published: (B::Published, &'static Published),
    pub lines: B::Lines,
    pub guard: B::Guard,
    pub timer: B::Timer,
    pub blocks: B::FrontEnd,
    pub source: B::Source,
    pub bridge: B::Bridge,
    pub generator: B::Generator,
    pub inputs: B::Inputs,
    pub drive: B::Drive,
    pub forced: B::Forced,
    pub live: B::Live,
    pub tick: B::Tick,
    pub millisecond: B::Millisecond,
    pub steps: B::Steps,
    pub thresholds: B::Thresholds,
    /// `None` when the controller did not start.
    pub can: Option<(B::Inboxes, B::Mailboxes, B::Filters)>,
    pub sync: B::Sync,
    /// What the scope records into.
    pub scope: Memory,
}

/// Room for what is too large to be moved about, or used in every tick: each is built where it stays. Gap and servo task are not among it:
/// of a static that only one function knows, the compiler leaves out what none reads, and the modelled chip reads what they have seen.
#[allow(missing_docs, reason = "each is that of the task of its name")]
pub struct Room<B: Board> {
    pub plan: &'static mut MaybeUninit<Plans<B>>,
    pub supervise: &'static mut MaybeUninit<Supervise<B>>,
    pub crossings: &'static mut MaybeUninit<TickCrossings>,
}

/// Builds a value where it stays. Not in line: no frame but this one ever holds it, whatever is built in line elsewhere.
#[inline(never)]
fn place<T>(room: &'static mut MaybeUninit<T>, make: impl FnOnce() -> T) -> &'static mut T {
    room.write(make())
}

/// Every task with what it owns, but for protocol and idle: those need what is stored, [`Host::protocol`] and
/// [`IdleEnds::idle`].
#[allow(missing_docs, reason = "each is the task of its name")]
pub struct Tasks<B: Board> {
    pub decoder: Decoder<B>,
    pub gap: Gap<B>,
    pub servo: Servo<B>,
    pub plan: &'static mut Plans<B>,
    pub supervise: &'static mut Supervise<B>,
    pub receive: Receive<B>,
    pub transmit: Transmit<B>,
    pub host: Host<B>,
    pub idle: IdleEnds<B>,
}

/// What the protocol is made of, or a test instead of it.
pub struct Host<B: Board> {
    clock: B::Clock,
    caller: B::Caller,
    signals: &'static Signals,
    filters: Option<B::Filters>,
    thresholds: B::Thresholds,
    received: Receiver<'static, Arrival, 32>,
    sending: Sender<'static, Frame, 8>,
    resets: Sender<'static, Reset, 4>,
    scope: Memory,
    /// By which the head is commanded.
    pub ends: HostEnds,
}

/// What idle is made of.
pub struct IdleEnds<B: Board> {
    clock: B::Clock,
    caller: B::Caller,
    guard: B::Guard,
    signals: &'static Signals,
    granted: Receiver<'static, (StorageJob, WritePermit), 1>,
    returned: Sender<'static, WritePermit, 1>,
    resets: Receiver<'static, Reset, 4>,
}

/// Tasks over the parts of a board: a disabled head that runs `active` on an empty path. Reflex and generator are set at once.
///
/// # Errors
/// When the thresholds of the reflex are refused.
pub fn assemble<B: Board>(
    parts: Parts<B>,
    room: Room<B>,
    crossings: &'static mut Crossings,
    signals: &'static Signals,
    active: &Active,
    path: &'static mut Path,
) -> Result<Tasks<B>, <B::Thresholds as Thresholds>::Error> {
    let Parts { clock, caller, mut thresholds, mut generator, .. } = parts;
    thresholds.set(&active.reflex)?;
    signals.reflex.set(&active.reflex);
    signals.pauses.set(&active.pause);
    thresholds.watch_ends(&active.pause);
    generator.request_off_time(active.off_time_ns);

    let fast = place(room.crossings, TickCrossings::default);
    let (reading_in, reading) = fast.reading.split(GapReading::default());
    let (estimates_in, estimates) = fast.estimates.split(Estimate::default());
    let (plans_in, plans) = fast.plans.split(Plan::DISABLED);
    let (measured_in, measured) = fast.measured.split((Measured::default(), Counters::default()));
    let (monitored_in, monitored) = crossings.monitored.split(Monitored::default());
    let (published_in, published) = crossings.published.split(Status::default());
    let off_time_ns = active.off_time_ns;
    let (head_in, head) = crossings.head.split(HeadConfig { head: active.head, off_time_ns });
    let scales = Scales::of(&active.head.axis);
    let (servo_in, servo) = crossings.servo.split(ServoConfig { follow: active.head.follow(), off_time_ns, scales });
    let (setups_in, setups) = crossings.setups.split(Setup::default());
    let (previews_in, previews) = crossings.previews.split((None, 0));
    let (gap_in, gap) = crossings.gap.split(active.gap);
    let (supervision_in, supervision) = crossings.supervision.split(active.head.supervision());
    let (faults_in, faults) = crossings.faults.split();
    let (requests_in, requests) = crossings.requests.split();
    let (answers_in, answers) = crossings.answers.split();
    let (granted_in, granted) = crossings.granted.split();
    let (returned_in, returned) = crossings.returned.split();
    let (resets_in, resets) = crossings.resets.split();
    let (changes_in, changes) = crossings.changes.split();
    let (commissioned_in, commissioned) = crossings.commissioned.split();
    let (evidence_in, evidence) = crossings.evidence.split();
    let (received_in, received) = crossings.received.split();
    let (sending_in, sending) = crossings.sending.split();

    let (inboxes, mailboxes, filters) = match parts.can {
        Some((inboxes, mailboxes, filters)) => (Some(inboxes), Some(mailboxes), Some(filters)),
        None => (None, None, None),
    };
    let (decoder, count) = parts.published;
    let quadrature = Quadrature::on(decoder, parts.lines.levels(), clock.now());
    let forced = parts.forced.forced();
    let retreats = parts.forced.retreats();
    let (recorder, snapshots) = (Recorder::new(parts.scope.record, 1), Snapshots::new(parts.scope));
    signals.record.store(recorder.phase().0 as u32);
    signals.snapshot.store(snapshots.kept().word());
    signals.task_watchdog.start(clock.now());
    Ok(Tasks {
        decoder: Decoder { lines: parts.lines, clock, quadrature },
        gap: Gap {
            blocks: parts.blocks,
            source: parts.source,
            clock,
            caller,
            signals,
            block: None,
            begun: false,
            reading: reading_in,
            settings: gap,
            run: 0,
        },
        servo: Servo {
            follower: Follower::new(active.head.follow()),
            bridge: parts.bridge,
            generator,
            inputs: parts.inputs,
            drive: parts.drive,
            lines: parts.forced,
            live: live::Watch::new(parts.live),
            pace: ClockCheck::new(),
            found: None,
            guard: parts.guard.clone(),
            tick: parts.tick,
            sync: parts.sync.clone(),
            decoder: DecoderCount::new(count, clock),
            timer: TimerCount::new(parts.timer, clock),
            handover: Handover::new(),
            clock,
            caller,
            signals,
            forced,
            retreats,
            state: State::Disabled,
            input: TickInput::default(),
            counters: Counters::default(),
            fresh: false,
            sighted: false,
            quality: Quality::Missing,
            once: false,
            millisecond: FIRST_CHORE,
            chore: Chore::Announce,
            preview: None,
            recorder,
            snapshots,
            scales,
            setups,
            reading,
            faults,
            config: servo,
            previews,
            plans,
            estimates: estimates_in,
            measured: measured_in,
        },
        plan: place(room.plan, || Plans {
            planner: Planner::new(active.head, path, parts.self_test),
            steps: parts.steps,
            clock,
            caller,
            signals,
            executed: Executed::NONE,
            raised: (Fault::HostSilent, 0),
            begun: 0,
            made: 0,
            monitored_tick: 0,
            estimates,
            monitored,
            plans: plans_in,
            requests,
            answers: answers_in,
            config: head,
            servo: servo_in,
            granted: granted_in,
            returned,
            published: published_in,
            changes: changes_in,
            commissioned: commissioned_in,
            evidence: evidence_in,
        }),
        supervise: place(room.supervise, || Supervise {
            millisecond: parts.millisecond,
            supervisor: Supervisor::default(),
            clock,
            caller,
            signals,
            count: 0,
            monitored_tick: 0,
            measured,
            kept: Kept::NEW,
            registers: parts.registers,
            config: supervision,
            faults: faults_in,
            monitored: monitored_in,
        }),
        receive: Receive { inboxes, sync: parts.sync, clock, caller, signals, received: received_in },
        transmit: Transmit { mailboxes, caller, signals, sending },
        host: Host {
            clock,
            caller,
            signals,
            filters,
            thresholds,
            received,
            sending: sending_in,
            resets: resets_in,
            scope: parts.scope,
            ends: HostEnds {
                requests: requests_in,
                answers,
                head: head_in,
                previews: previews_in,
                setups: setups_in,
                gap: gap_in,
                supervision: supervision_in,
                published,
                changes,
                commissioned,
                evidence,
            },
        },
        idle: IdleEnds { clock, caller, guard: parts.guard, signals, granted, returned: returned_in, resets },
    })
}

impl<B: Board> Host<B> {
    /// The protocol of a node and a drive that have begun with what is stored. `defaults` are the settings of a head that has
    /// nothing stored.
    pub fn protocol(
        self,
        room: &'static mut MaybeUninit<Protocol<B>>,
        node: &'static mut Node,
        drive: &'static mut Drive,
        defaults: &Settings,
    ) -> &'static mut Protocol<B> {
        let now = self.clock.now();
        drive.set_scope(self.scope);
        place(room, || Protocol {
            clock: self.clock,
            caller: self.caller,
            signals: self.signals,
            uptime: Uptime::new(now, B::Clock::HZ),
            node,
            drive,
            slow: 0,
            defaults: *defaults,
            filters: self.filters,
            thresholds: self.thresholds,
            timers: Timers::new(now),
            configuring: Configuring::Done,
            outstanding: 0,
            jobs: [None; 2],
            lost: Lost::default(),
            known: 0,
            syncs: 0,
            ends: self.ends,
            received: self.received,
            sending: self.sending,
            resets: self.resets,
        })
    }
}

impl<B: Board> IdleEnds<B> {
    /// Idle, with the watchdog running closely.
    pub fn idle(
        self,
        watchdog: B::Watchdog,
        image_store: ImageStore<B>,
        keeper: Keeper<B::Backup>,
        stage: B::Stage,
    ) -> Idle<B> {
        Idle {
            watchdog,
            image_store,
            keeper,
            kept: self.clock.now(),
            staging: Staging::new(stage),
            guard: self.guard,
            clock: self.clock,
            caller: self.caller,
            signals: self.signals,
            reset: None,
            granted: self.granted,
            returned: self.returned,
            resets: self.resets,
        }
    }
}

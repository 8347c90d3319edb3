//! All data that pass from one task to another.
//!
//! [`Signals`] are the atomics, [`TickCrossings`] and [`Crossings`] the rest; [`assemble`](crate::assemble()) gives each end to its task. Nothing
//! else is shared: what is not here belongs to one task.

use edm_crossing::atomic::{Counter, Flag, Word};
use edm_crossing::latest::Latest;
use edm_crossing::ring::Ring;
use edm_hal_shim::board;
use edm_hal_shim::pause::Pauses;
use edm_hal_shim::reflex::Limits;
use edm_hal_shim::task_watchdog::TaskWatchdog;
use edm_servo_head::canopen::drive::TASKS;
use edm_servo_head::canopen::{Frame, Group, Update};
use edm_servo_head::gap::pulses::CLASSES;
use edm_servo_head::gap::teach::{BURNS, Gathered, Shown, Sum};
use edm_servo_head::gap::{GapReading, voltage};
use edm_servo_head::head::{
    Change, Command, Config, Counters, Estimate, Evidence, Fault, Finding, FollowConfig, Measured, Monitored, Plan,
    Refused, Report, SetPoint, Status, SupervisionConfig, WritePermit,
};
use edm_servo_head::scope::{Scales, Setup};
use edm_servo_head::units;

// The rates of the hardware are those that the core was made for.
const _: () = assert!(board::TICK_HZ == units::TICK_HZ && board::ADC_HZ == units::ADC_HZ);
const _: () = assert!(board::CORE_HZ == units::CLOCK_HZ);

/// Clock cycles of a millisecond.
pub const MS: u32 = board::CORE_HZ / 1000;

/// Numbers of the tasks that report and are timed.
pub const GAP: usize = 0;
/// See [`GAP`].
pub const SERVO: usize = 1;
/// See [`GAP`].
pub const SUPERVISE: usize = 2;
/// See [`GAP`].
pub const PROTOCOL: usize = 3;
/// See [`GAP`].
pub const PLAN: usize = 4;
/// How long each may be silent.
const SILENCE: [u32; TASKS] = [MS, 3 * MS / 2, 5 * MS, 50 * MS, 3 * MS];

/// Requests to the planner that may be under way: sent, and not answered.
pub const REQUESTS: usize = 8;
/// Answers that can wait: one to each request, and as many to set points that SYNCs have released.
pub const ANSWERS: usize = 2 * REQUESTS;

/// What crosses as a flag, a count or a word.
pub struct Signals {
    /// Something waits for the servo task or the planner; the servo task looks into none of its crossings otherwise, and asks
    /// for a plan then. Set after the crossing was filled.
    pub waiting: Flag,
    /// A millisecond has begun: the protocol does what it does in each.
    pub millisecond: Flag,
    /// A second has begun: the state of the head goes to the log.
    pub second: Flag,
    /// Servo ticks of uninterrupted short: of the gap reading, what every tick looks at.
    pub short_ticks: Word,
    /// Electrode and work touch, with pulses off: 1, else 0.
    pub touches: Word,
    /// The servo task permits pulses: 1, else 0.
    pub permitted: Word,
    /// SYNCs that have come.
    pub syncs: Counter,
    /// Bytes of a SYNC as the node is configured: any other is none.
    pub sync_length: Word,
    /// Frames that the controller had to drop.
    pub overruns: Counter,
    /// Faults of the supervision that did not fit their ring, and changes of state that did not fit the head's own log.
    pub lost_faults: Word,
    /// See [`lost_faults`](Signals::lost_faults).
    pub lost_changes: Word,
    /// Servo ticks that did not come while the head was enabled.
    pub lost_ticks: Word,
    /// Blocks of conversions that did not come.
    pub lost_blocks: Word,
    /// Pulses that the high comparator has not shown, and the low one, thousands.
    pub unseen: [Word; 2],
    /// Looks at pulses of each class, of the last 200 ms. One may be a millisecond newer than another.
    pub looks: [Word; CLASSES],
    /// Steps of a host, changes of their direction within one, and times that it changed too fast.
    pub steps: [Word; 3],
    /// What the gap source says in turns.
    pub slow: [Word; voltage::SLOW],
    /// What is collected of the pulses for a teach-in.
    pub teaching: Teaching,
    /// How the record of the scope stands: its phase, and above it the number of the newest order that was taken.
    pub record: Word,
    /// The last snapshot.
    pub snapshot: Word,
    /// Frames did not fit the ring to the controller: the protocol wants to run when it is empty.
    pub backlog: Flag,
    /// A frame came in since the last supervision.
    pub host: Flag,
    /// A task has found that the settings that it runs, or a register, have changed by themselves. Set until another start.
    pub settings_damaged: Flag,
    /// What the reflex acts on.
    pub reflex: Limits,
    /// Pauses between pulses: whoever may write them, a feed law for instance, changes them from the next pulse on.
    pub pauses: Pauses,
    /// The clock has not gone as the ticks have: idle starts it again.
    pub clock_lost: Flag,
    /// Whether every task still runs.
    pub task_watchdog: TaskWatchdog<TASKS>,
    /// How long the tasks take.
    pub times: [crate::timers::Times; TASKS],
}

impl Signals {
    /// Of a head that has not started.
    pub const fn new() -> Self {
        Signals {
            waiting: Flag::new(),
            millisecond: Flag::new(),
            second: Flag::new(),
            short_ticks: Word::new(0),
            touches: Word::new(0),
            permitted: Word::new(0),
            syncs: Counter::new(),
            sync_length: Word::new(0),
            overruns: Counter::new(),
            lost_faults: Word::new(0),
            lost_changes: Word::new(0),
            lost_ticks: Word::new(0),
            lost_blocks: Word::new(0),
            unseen: [const { Word::new(0) }; 2],
            looks: [const { Word::new(0) }; CLASSES],
            steps: [const { Word::new(0) }; 3],
            slow: [const { Word::new(0) }; voltage::SLOW],
            teaching: Teaching::new(),
            record: Word::new(0),
            snapshot: Word::new(0),
            backlog: Flag::new(),
            host: Flag::new(),
            settings_damaged: Flag::new(),
            reflex: Limits::new(),
            pauses: Pauses::new(),
            clock_lost: Flag::new(),
            task_watchdog: TaskWatchdog::new(SILENCE),
            times: [const { crate::timers::Times::new() }; TASKS],
        }
    }
}

/// What the gap task collects for a teach-in of the protocol. It is read while nothing is added, but for a pulse at most.
pub struct Teaching {
    /// The run that the protocol wants to collect for; 0: none.
    wanted: Word,
    /// What is known of the levels of pulses, whatever is collected.
    pub levels: Word,
    /// The run that was collected for, and pulses that burned in it.
    run: Word,
    burned: Word,
    burns: [Word; BURNS],
    /// Count and sum, its bits those of an `f32`, of open-circuit voltages and of squares.
    open: [Word; 2],
    steps: [Word; 2],
}

impl Teaching {
    const fn new() -> Teaching {
        Teaching {
            wanted: Word::new(0),
            levels: Word::new(0),
            run: Word::new(0),
            burned: Word::new(0),
            burns: [const { Word::new(0) }; BURNS],
            open: [const { Word::new(0) }; 2],
            steps: [const { Word::new(0) }; 2],
        }
    }

    /// Collects for a run, or for none.
    pub fn want(&self, run: u32) {
        self.wanted.store(run);
    }

    /// The run to collect for.
    #[inline(always)]
    pub fn run(&self) -> u32 {
        self.wanted.load()
    }

    /// Forgets what was collected before: of the gap task.
    pub fn begin(&self, run: u32) {
        let sums = self.open.iter().chain(&self.steps);
        self.burns.iter().chain(sums).chain([&self.burned]).for_each(|word| word.store(0));
        self.run.store(run);
    }

    /// Adds a pulse: of the gap task.
    pub fn add(&self, shown: &Shown) {
        match shown {
            Shown::Open(volts) => add(&self.open, volts.0),
            Shown::Burned(volts, step) => {
                if let Some(count) = self.burns.get(Shown::bin(*volts)) {
                    count.store(count.load().saturating_add(1));
                }
                self.burned.store(self.burned.load().saturating_add(1));
                if let Some(step) = step {
                    add(&self.steps, step.0 * step.0);
                }
            }
        }
    }

    /// The run, and how many pulses have burned in it.
    pub fn burned(&self) -> (u32, u32) {
        (self.run.load(), self.burned.load())
    }

    /// What was collected.
    pub fn gathered(&self) -> Gathered {
        let sum = |[count, sum]: &[Word; 2]| Sum { count: count.load(), sum: f32::from_bits(sum.load()) };
        Gathered { burns: self.burns.each_ref().map(Word::load), open: sum(&self.open), steps: sum(&self.steps) }
    }
}

fn add([count, sum]: &[Word; 2], value: f32) {
    let before = count.load();
    if before < Sum::MOST {
        count.store(before.saturating_add(1));
        sum.store((f32::from_bits(sum.load()) + value).to_bits());
    }
}

impl Default for Signals {
    fn default() -> Self {
        Signals::new()
    }
}

/// From the protocol to the planner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Request {
    /// A command to the head.
    Command(Command),
    /// The newest configuration is to run.
    Configure,
    /// Raise a fault.
    Raise(Fault),
    /// A permit to write flash, for a storage job.
    PermitWrite(StorageJob),
}

/// What came of a request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// A command, and the tick that knew of it first.
    Command(Command, Result<(), Refused>, u32),
    /// The same for what a SYNC has released.
    SyncPreview(Command, Result<(), Refused>, u32),
    /// The planner has accepted or refused the newest configuration; its crossing says which.
    Configured,
    /// No permit for this job: the drive is not disabled.
    NoPermit(StorageJob),
    /// The request is done.
    Done,
}

/// A frame that has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// The frame.
    pub frame: Frame,
    /// Count of the clock at its interrupt.
    pub stamp: u32,
    /// SYNCs until then, itself included.
    pub syncs: u32,
}

/// What idle does with what is stored, under a permit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StorageJob {
    /// Stores a group of objects.
    Store(Group),
    /// Forgets a group of objects.
    Restore(Group),
    /// A part of an update of the program.
    Update(Update),
}

impl StorageJob {
    /// What it is about.
    pub fn group(self) -> Group {
        match self {
            StorageJob::Store(group) | StorageJob::Restore(group) => group,
            // Asked for, and answered, by SDO.
            StorageJob::Update(_) => Group::All,
        }
    }
}

/// What a host resets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// Everything.
    Node,
    /// Communication.
    Communication,
}

/// What the planner is to run, and through it the servo task.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadConfig {
    /// The head.
    pub head: Config,
    /// Off-time requested of the generator, ns.
    pub off_time_ns: Option<u32>,
}

/// What the next SYNC releases, and how many had come before this was decided.
pub type Preview = (Option<SetPoint>, u32);

/// What the servo task runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoConfig {
    /// The follower.
    pub follow: FollowConfig,
    /// Off-time requested of the generator, ns.
    pub off_time_ns: Option<u32>,
    /// Units of what is recorded.
    pub scales: Scales,
}

/// What commissioning found.
pub type Commissioned = Result<Report, Finding>;

/// The crossings of each tick and plan that are more than a word.
#[derive(Default)]
pub struct TickCrossings {
    /// Gap task to servo task.
    pub(crate) reading: Latest<GapReading>,
    /// Servo task to planner.
    pub(crate) estimates: Latest<Estimate>,
    /// Planner to servo task.
    pub(crate) plans: Latest<Plan>,
    /// Servo task to supervision.
    pub(crate) measured: Latest<(Measured, Counters)>,
}

/// The other crossings that are more than a word.
pub struct Crossings {
    /// Supervision to planner.
    pub(crate) monitored: Latest<Monitored>,
    /// Planner to protocol.
    pub(crate) published: Latest<Status>,
    /// Protocol to planner.
    pub(crate) head: Latest<HeadConfig>,
    /// Planner to servo task.
    pub(crate) servo: Latest<ServoConfig>,
    /// Protocol to servo task.
    pub(crate) previews: Latest<Preview>,
    /// Protocol to gap task.
    pub(crate) gap: Latest<voltage::Active>,
    /// Protocol to servo task.
    pub(crate) setups: Latest<Setup>,
    /// Protocol to supervision.
    pub(crate) supervision: Latest<SupervisionConfig>,
    /// Supervision to servo task.
    pub(crate) faults: Ring<Fault, 8>,
    /// Protocol to planner.
    pub(crate) requests: Ring<Request, REQUESTS>,
    /// Planner to protocol.
    pub(crate) answers: Ring<Answer, ANSWERS>,
    /// Planner to idle: there is one permit.
    pub(crate) granted: Ring<(StorageJob, WritePermit), 1>,
    /// Idle to planner.
    pub(crate) returned: Ring<WritePermit, 1>,
    /// Protocol to idle.
    pub(crate) resets: Ring<Reset, 4>,
    /// Planner to protocol.
    pub(crate) changes: Ring<Change, 16>,
    /// Planner to protocol.
    pub(crate) commissioned: Ring<Commissioned, 2>,
    /// Planner to protocol.
    pub(crate) evidence: Ring<Evidence, 2>,
    /// Receive interrupts to protocol.
    pub(crate) received: Ring<Arrival, 32>,
    /// Protocol to transmit interrupt.
    pub(crate) sending: Ring<Frame, 8>,
}

impl Crossings {
    /// Nothing has crossed.
    pub const fn new() -> Self {
        Crossings {
            monitored: Latest::new(),
            published: Latest::new(),
            head: Latest::new(),
            servo: Latest::new(),
            previews: Latest::new(),
            gap: Latest::new(),
            setups: Latest::new(),
            supervision: Latest::new(),
            faults: Ring::new(),
            requests: Ring::new(),
            answers: Ring::new(),
            granted: Ring::new(),
            returned: Ring::new(),
            resets: Ring::new(),
            changes: Ring::new(),
            commissioned: Ring::new(),
            evidence: Ring::new(),
            received: Ring::new(),
            sending: Ring::new(),
        }
    }
}

impl Default for Crossings {
    fn default() -> Self {
        Crossings::new()
    }
}

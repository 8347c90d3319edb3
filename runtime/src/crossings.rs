//! Everything that crosses from one task to another.
//!
//! [`Signals`] are the atomics, [`Crossings`] the rest; [`assemble`](crate::assemble()) gives each end to its task. Nothing
//! else is shared: what is not here belongs to one task.

use edm_crossing::atomic::{Counter, Flag, Word};
use edm_crossing::latest::Latest;
use edm_crossing::ring::Ring;
use edm_hal_shim::board;
use edm_hal_shim::reflex::Limits;
use edm_hal_shim::task_watchdog::TaskWatchdog;
use edm_servo_head::canopen::drive::{SetPoint, TASKS};
use edm_servo_head::canopen::{Frame, Group};
use edm_servo_head::gap::{GapReading, voltage};
use edm_servo_head::head::{
    Change, Command, Config, Fault, Finding, Refused, Report, Status, SupervisionLimits, WritePermit,
};
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
/// How long each may be silent.
const SILENCE: [u32; TASKS] = [MS, 3 * MS / 2, 5 * MS, 50 * MS];

/// Requests to the servo task that may be under way: sent, and not answered.
pub const REQUESTS: usize = 8;
/// Answers that can wait: one to each request, one to each set point that a request left for a SYNC, and one to the set point
/// that an earlier request left.
pub const ANSWERS: usize = 2 * REQUESTS + 1;

/// What crosses as a flag, a count or a word.
pub struct Signals {
    /// Something waits for the servo task, which looks into none of its rings otherwise. Set after the ring was filled.
    pub waiting: Flag,
    /// Servo ticks of uninterrupted short: of the gap reading, what every tick looks at.
    pub short_ticks: Word,
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
    /// Frames did not fit the ring to the controller: the protocol wants to run when it is empty.
    pub backlog: Flag,
    /// A frame came in since the last supervision.
    pub host: Flag,
    /// What the reflex acts on.
    pub reflex: Limits,
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
            short_ticks: Word::new(0),
            syncs: Counter::new(),
            sync_length: Word::new(0),
            overruns: Counter::new(),
            lost_faults: Word::new(0),
            lost_changes: Word::new(0),
            backlog: Flag::new(),
            host: Flag::new(),
            reflex: Limits::new(),
            task_watchdog: TaskWatchdog::new(SILENCE),
            times: [const { crate::timers::Times::new() }; TASKS],
        }
    }
}

impl Default for Signals {
    fn default() -> Self {
        Signals::new()
    }
}

/// From the protocol to the servo task.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Request {
    /// A command to the head.
    Command(Command),
    /// The newest configuration is to run.
    Configure,
    /// What the next SYNC releases, and how many had come before this was decided.
    SyncPreview(Option<SetPoint>, u32),
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
    /// The same for what a SYNC has released. Beside the answer to the request that left it there.
    SyncPreview(Command, Result<(), Refused>, u32),
    /// The servo task has judged the newest configuration: its crossing says how.
    Configured,
    /// No permit: the drive is not disabled.
    NoPermit,
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
}

/// What a host resets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// Everything.
    Node,
    /// Communication.
    Communication,
}

/// What the servo task runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoConfig {
    /// The head.
    pub head: Config,
    /// Off-time requested of the generator, ns.
    pub off_time_ns: Option<u32>,
}

/// What commissioning found.
pub type Checked = Result<Report, Finding>;

/// The crossings that are more than a word.
pub struct Crossings {
    /// Gap task to servo task.
    pub(crate) reading: Latest<GapReading>,
    /// Servo task to supervision.
    pub(crate) judged: Latest<Status>,
    /// Servo task to protocol.
    pub(crate) published: Latest<Status>,
    /// Protocol to servo task.
    pub(crate) servo: Latest<ServoConfig>,
    /// Protocol to gap task.
    pub(crate) gap: Latest<voltage::Active>,
    /// Protocol to supervision.
    pub(crate) limits: Latest<SupervisionLimits>,
    /// Supervision to idle, once a second.
    pub(crate) report: Latest<Status>,
    /// Supervision to servo task.
    pub(crate) faults: Ring<Fault, 8>,
    /// Protocol to servo task.
    pub(crate) requests: Ring<Request, REQUESTS>,
    /// Servo task to protocol.
    pub(crate) answers: Ring<Answer, ANSWERS>,
    /// Servo task to idle: there is one permit.
    pub(crate) granted: Ring<(StorageJob, WritePermit), 1>,
    /// Idle to servo task.
    pub(crate) returned: Ring<WritePermit, 1>,
    /// Protocol to idle.
    pub(crate) resets: Ring<Reset, 4>,
    /// Servo task to protocol.
    pub(crate) changes: Ring<Change, 16>,
    /// Servo task to protocol.
    pub(crate) checked: Ring<Checked, 2>,
    /// Receive interrupts to protocol.
    pub(crate) received: Ring<Arrival, 32>,
    /// Protocol to transmit interrupt.
    pub(crate) sending: Ring<Frame, 8>,
}

impl Crossings {
    /// Nothing has crossed.
    pub const fn new() -> Self {
        Crossings {
            reading: Latest::new(),
            judged: Latest::new(),
            published: Latest::new(),
            servo: Latest::new(),
            gap: Latest::new(),
            limits: Latest::new(),
            report: Latest::new(),
            faults: Ring::new(),
            requests: Ring::new(),
            answers: Ring::new(),
            granted: Ring::new(),
            returned: Ring::new(),
            resets: Ring::new(),
            changes: Ring::new(),
            checked: Ring::new(),
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

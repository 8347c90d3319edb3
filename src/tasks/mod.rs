//! What each task of the firmware does; `main.rs` says at which priority and by when.
//!
//! A file is a task with everything it owns. What crosses a priority is declared here: queues of one writer and one reader,
//! and atomics.

pub mod can;
pub mod encoder;
pub mod gap;
pub mod idle;
pub mod keeper;
pub mod protocol;
pub mod servo;
pub mod start;
pub mod supervise;
pub mod timers;

use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32};
use edm_hal_shim::board;
use edm_hal_shim::reflex::Limits;
use edm_hal_shim::roll::Roll;
use edm_hal_shim::stm32f4::pac::Interrupt;
use edm_servo_head::canopen::drive::SetPoint;
use edm_servo_head::canopen::{Frame, Group, NodeId};
use edm_servo_head::encoder::Shared as Published;
use edm_servo_head::gap::{Latest, voltage};
use edm_servo_head::head::{self, Change, Command, Config, Fault, Finding, Leave, Refused, Status, SupervisionLimits};
use edm_servo_head::units;
use heapless::spsc::Queue;

// The rates of the hardware are those that the core was made for.
const _: () = assert!(board::TICK_HZ == units::TICK_HZ && board::ADC_HZ == units::ADC_HZ);
const _: () = assert!(board::CORE_HZ == units::CLOCK_HZ);

/// Number of this head on the bus.
const NODE: NodeId = NodeId::new(1).unwrap();
/// Commit of this build, eight hexadecimal digits.
const BUILD: &str = env!("EDM_BUILD");
/// The same as a number.
const BUILD_NUMBER: u32 = match u32::from_str_radix(BUILD, 16) {
    Ok(build) => build,
    Err(_) => 0,
};

/// Core clock cycles of a millisecond.
const MS: u32 = board::CORE_HZ / 1000;
/// Who must report, and how long each may be silent.
const GAP: usize = 0;
const SERVO: usize = 1;
const SUPERVISE: usize = 2;
const PROTOCOL: usize = 3;
static ROLL: Roll<4> = Roll::new([MS, 3 * MS / 2, 5 * MS, 50 * MS]);
/// What the reflex acts on.
static REFLEX: Limits = Limits::new();
/// What the encoder interrupts count; slower tasks read it.
static ENCODER: Published = Published::new();
/// What the gap task found; the servo task reads it.
static READING: Latest = Latest::new();
/// Something waits in a queue of the servo task, which looks into none of them otherwise. Set after the queue was filled.
static WAITING: AtomicBool = AtomicBool::new(false);
/// SYNCs that have come, wrapping.
static SYNCS: AtomicU32 = AtomicU32::new(0);
/// Bytes of a SYNC as the node is configured: any other is none.
static SYNC_LENGTH: AtomicU8 = AtomicU8::new(0);
/// Frames that came were lost.
static LOST: AtomicBool = AtomicBool::new(false);
/// Frames did not fit the queue to the controller: the protocol wants to run when it is empty.
static BACKLOG: AtomicBool = AtomicBool::new(false);

/// The vector that runs the protocol task; its peripheral is not in use.
pub const PROTOCOL_VECTOR: Interrupt = Interrupt::SPI3;

/// On its way from the protocol to the servo task.
enum Request {
    Command(Command),
    /// What the next SYNC releases, and how many had come before this was decided.
    AtSync(Option<SetPoint>, u32),
    Raise(Fault),
    /// Leave to change what is kept.
    Leave(Chore),
}

/// A frame that has come.
struct Arrival {
    frame: Frame,
    /// Count of the clock at its interrupt.
    stamp: u32,
    /// SYNCs until then, itself included.
    syncs: u32,
}

/// What came of a request.
enum Answer {
    /// A command, and the tick that knew of it first.
    Command(Command, Result<(), Refused>, u32),
    /// The servo runs the newest configuration, or may not.
    Configured(bool),
    /// No leave: the drive is not disabled.
    NoLeave,
}

/// What idle does with what is kept, under leave.
#[derive(Clone, Copy)]
pub enum Chore {
    Store(Group),
    Restore(Group),
}

/// What a host resets.
#[derive(Clone, Copy)]
pub enum Reset {
    Node,
    Communication,
}

/// What the servo task runs.
struct Configuration {
    head: Config,
    off_time_ns: Option<u32>,
}

/// What the guided check found.
type Checked = Result<head::Report, Finding>;

/// What idle logs once a second.
#[derive(Clone, Copy)]
pub struct Report {
    status: Status,
    shorts: u32,
    pulse: [u16; 2],
    captures: edm_hal_shim::stm32f4::gate::Captures,
}

/// The queues; [`start::start`] gives each end to its task.
pub struct Queues {
    statuses: Queue<Status, 4>,
    published: Queue<Status, 4>,
    faults: Queue<Fault, 8>,
    requests: Queue<Request, 8>,
    answers: Queue<Answer, 16>,
    configurations: Queue<Configuration, 2>,
    gaps: Queue<voltage::Active, 2>,
    limits: Queue<SupervisionLimits, 2>,
    granted: Queue<(Chore, Leave), 2>,
    returned: Queue<Leave, 2>,
    resets: Queue<Reset, 4>,
    changes: Queue<Change, 16>,
    checked: Queue<Checked, 2>,
    reports: Queue<Report, 2>,
    received: Queue<Arrival, 32>,
    sending: Queue<Frame, 8>,
}

impl Queues {
    /// Empty queues.
    pub const fn new() -> Self {
        Queues {
            statuses: Queue::new(),
            published: Queue::new(),
            faults: Queue::new(),
            requests: Queue::new(),
            answers: Queue::new(),
            configurations: Queue::new(),
            gaps: Queue::new(),
            limits: Queue::new(),
            granted: Queue::new(),
            returned: Queue::new(),
            resets: Queue::new(),
            changes: Queue::new(),
            checked: Queue::new(),
            reports: Queue::new(),
            received: Queue::new(),
            sending: Queue::new(),
        }
    }
}

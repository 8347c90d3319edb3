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

use core::sync::atomic::AtomicBool;
use edm_hal_shim::board;
use edm_hal_shim::reflex::Limits;
use edm_hal_shim::roll::Roll;
use edm_hal_shim::stm32f4::bxcan::Frame;
use edm_servo_head::encoder::Shared as Published;
use edm_servo_head::gap::Latest;
use edm_servo_head::head::{self, Change, Fault, Finding, Leave, Refused, Status};
use edm_servo_head::{remote, units};
use heapless::spsc::Queue;

// The rates of the hardware are those that the core was made for.
const _: () = assert!(board::TICK_HZ == units::TICK_HZ && board::ADC_HZ == units::ADC_HZ);
const _: () = assert!(board::CORE_HZ == units::CLOCK_HZ);

/// Number of this head on the bus.
const NODE: u8 = 1;
/// Commit of this build.
const BUILD: u32 = match u32::from_str_radix(env!("EDM_BUILD"), 16) {
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
static ROLL: Roll<4> = Roll::new([MS, MS, 5 * MS, 50 * MS]);
/// What the reflex acts on.
static REFLEX: Limits = Limits::new();
/// What the encoder interrupts count; slower tasks read it.
static ENCODER: Published = Published::new();
/// What the gap task found; the servo task reads it.
static READING: Latest = Latest::new();
/// Something waits in a queue of the servo task, which looks into none of them otherwise. Set after the queue was filled.
static WAITING: AtomicBool = AtomicBool::new(false);

/// A request on its way to the servo task, with its number for the answer.
type Request = (u8, remote::Request);
type Answer = (u8, Result<(), Refused>);
/// Leave to store settings on its way to idle, and back with what came of it.
type Granted = (u8, Leave);
type Returned = (Leave, Answer);
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
    faults: Queue<Fault, 8>,
    requests: Queue<Request, 8>,
    answers: Queue<Answer, 8>,
    granted: Queue<Granted, 2>,
    returned: Queue<Returned, 2>,
    changes: Queue<Change, 16>,
    checked: Queue<Checked, 2>,
    reports: Queue<Report, 2>,
    published: Queue<Status, 2>,
    received: Queue<Frame, 32>,
    sending: Queue<Frame, 32>,
}

impl Queues {
    /// Empty queues.
    pub const fn new() -> Self {
        Queues {
            statuses: Queue::new(),
            faults: Queue::new(),
            requests: Queue::new(),
            answers: Queue::new(),
            granted: Queue::new(),
            returned: Queue::new(),
            changes: Queue::new(),
            checked: Queue::new(),
            reports: Queue::new(),
            published: Queue::new(),
            received: Queue::new(),
            sending: Queue::new(),
        }
    }
}

//! A head that is commanded over its bus, as a rig to bore with: for what the drive does by itself, such as a table of technology.
//!
//! The head is that of `edm-sim serve`, with all its tasks; the host is a master that speaks expedited SDO.

use crate::bore;
use crate::machine::Rig;
use crate::process::Process;
use crate::run::{Job, Observer, Outcome, Progress, Setup};
use crate::serve::head::Head;
use crate::store::Store;
use edm_bus::Frame;
use edm_servo_head::canopen::NodeId;
use edm_servo_head::canopen::drive::TechnologyPhase;
use edm_servo_head::canopen::objects::setting_address;
use edm_servo_head::head::{Change, Command, Reason, State, Status};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{Nanometres, TICKS_PER_MS};
use edm_technology::File;
use embedded_can::{Frame as _, Id, StandardId};
use std::collections::VecDeque;

/// Its node-ID.
const NODE: u8 = 1;
/// Time until a node that was switched on listens, and for an answer, ms.
const BOOT_MS: u32 = 100;
const PATIENCE_MS: u32 = 200;

/// See the [module](self).
pub struct Commanded {
    head: Head,
    sent: Vec<Frame>,
    state: State,
    changes: VecDeque<Change>,
}

/// Makes a hole as [`bore::bore`] does; by a technology table on a head that is commanded over its bus.
///
/// # Errors
/// When the run cannot be made.
pub fn bore(job: &Job, observer: &mut impl Observer, progress: &mut dyn FnMut(&Progress)) -> Result<Outcome, String> {
    match job.table {
        None => bore::bore(job, observer, progress),
        Some(_) => bore::run(job, &mut Commanded::new(&job.setup, job.seed)?, observer, progress),
    }
}

impl Commanded {
    /// A commissioned head at rest at its upper stop, switched on, operational.
    ///
    /// # Errors
    /// When the values do not fit together.
    pub fn new(setup: &Setup, seed: u64) -> Result<Commanded, String> {
        let head = Head::new(setup, (NodeId::new(NODE), 1), seed, Store::memory(None))?;
        let mut rig = Commanded { head, sent: Vec::new(), state: State::Disabled, changes: VecDeque::new() };
        rig.wait(BOOT_MS)?;
        rig.send(0, &[1, NODE])?;
        Ok(rig)
    }

    fn wait(&mut self, ms: u32) -> Result<(), String> {
        (0..ms * TICKS_PER_MS).try_for_each(|_| self.tick())
    }

    fn send(&mut self, id: u16, data: &[u8]) -> Result<(), String> {
        let frame = StandardId::new(id).and_then(|id| Frame::new(id, data));
        self.head.receive(&frame.ok_or("no such frame")?);
        self.tick()
    }

    /// An expedited transfer.
    fn ask(&mut self, request: [u8; 8]) -> Result<u32, String> {
        self.sent.clear();
        self.send(0x600 + u16::from(NODE), &request)?;
        let answers = Id::from(StandardId::new(0x580 + u16::from(NODE)).ok_or("no such node")?);
        for _ in 0..PATIENCE_MS {
            self.wait(1)?;
            let Some(frame) = self.sent.iter().find(|frame| frame.id() == answers) else { continue };
            let &[command, low, high, sub, a, b, c, d] = frame.data() else { continue };
            let (index, number) = (u16::from_le_bytes([low, high]), u32::from_le_bytes([a, b, c, d]));
            let refused = command == 0x80;
            return if refused { Err(format!("{index:04X}h:{sub} is refused with {number:08X}h")) } else { Ok(number) };
        }
        Err(format!("no answer to {request:02X?}"))
    }

    /// Waits until the statusword is so under a mask.
    fn until(&mut self, mask: u16, word: u16) -> Result<(), String> {
        for _ in 0..PATIENCE_MS {
            if self.read(0x6041, 0)? as u16 & mask == word {
                return Ok(());
            }
        }
        Err(format!("the statusword is not {word:04X}h under {mask:04X}h"))
    }

    fn enable(&mut self) -> Result<(), String> {
        for (word, status) in [(6, 0x21), (7, 0x23), (0xF, 0x27)] {
            self.write(0x6040, 0, word, 2)?;
            self.until(0x6F, status)?;
        }
        Ok(())
    }
}

/// Expedited transfers with a head.
pub trait Sdo {
    /// Writes an object of so many bytes.
    ///
    /// # Errors
    /// When the head refuses or does not answer.
    fn write(&mut self, index: u16, sub: u8, value: u32, size: u8) -> Result<(), String>;
    /// Reads an object of up to four bytes.
    ///
    /// # Errors
    /// When the head refuses or does not answer.
    fn read(&mut self, index: u16, sub: u8) -> Result<u32, String>;
}

/// Has an enabled head in profile position take a table, and erode row after row to a depth, counts.
///
/// # Errors
/// What the head refuses.
pub fn erode_by(head: &mut impl Sdo, table: &File, to: i64) -> Result<(), String> {
    for write in table.writes() {
        head.write(0x201C, write.sub, write.value, write.size)?;
    }
    head.write(0x201C, 2, 1, 1)?;
    while head.read(0x201C, 6)? == TechnologyPhase::Checks as u32 {}
    if head.read(0x201C, 6)? != TechnologyPhase::Ready as u32 {
        let (why, row) = (head.read(0x201C, 3)?, head.read(0x201C, 4)?);
        return Err(format!("the head refuses row {row} of the table with code {why} of 201Ch:3"));
    }
    head.write(0x6060, 0, 1, 1)?;
    head.write(0x2001, 1, 1, 1)?;
    head.write(0x607A, 0, to as i32 as u32, 4)?;
    head.write(0x6040, 0, 0xF, 2)?;
    head.write(0x6040, 0, 0x1F, 2)
}

/// The row under way, of the state of a table and its row; none where none is.
pub fn row_of(phase: u32, row: u32) -> Option<u8> {
    let busy = [TechnologyPhase::Changes, TechnologyPhase::Waits, TechnologyPhase::Runs];
    busy.iter().any(|busy| *busy as u32 == phase).then_some(row as u8)
}

impl Sdo for Commanded {
    fn write(&mut self, index: u16, sub: u8, value: u32, size: u8) -> Result<(), String> {
        let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), value.to_le_bytes());
        self.ask([0x23 | (4 - size) << 2, low, high, sub, a, b, c, d]).map(|_| ())
    }

    fn read(&mut self, index: u16, sub: u8) -> Result<u32, String> {
        let [low, high] = index.to_le_bytes();
        self.ask([0x40, low, high, sub, 0, 0, 0, 0])
    }
}

impl Rig for Commanded {
    fn process(&self) -> &Process {
        &self.head.process
    }

    fn status(&self) -> &Status {
        self.head.status()
    }

    fn next_change(&mut self) -> Option<Change> {
        self.changes.pop_front()
    }

    fn tick(&mut self) -> Result<(), String> {
        if self.state.works() {
            // Nobody reads what a head that bores sends by itself.
            self.sent.clear();
        }
        self.head.tick(std::iter::empty(), &mut self.sent);
        let (status, from) = (*self.head.status(), self.state);
        if status.state != from {
            self.state = status.state;
            // What a drive says of it comes later; who bores wants to know of faults, jumps and the end.
            let reason = match (status.state, status.fault) {
                (State::Fault, Some(fault)) => Reason::Fault(fault),
                (State::Jumping, _) => Reason::Jumped,
                _ => Reason::PathEnd,
            };
            self.changes.push_back(Change { tick: status.tick, from, to: status.state, reason });
        }
        Ok(())
    }

    fn command(&mut self, command: Command) -> Result<(), String> {
        match command {
            Command::SetHome(Nanometres(0)) => {
                self.enable()?;
                self.write(0x6098, 0, 35, 1)?;
                self.write(0x6060, 0, 6, 1)?;
                self.write(0x6040, 0, 0x1F, 2)?;
                self.until(0x3400, 0x1400)?;
                self.write(0x6040, 0, 0xF, 2)?;
                self.write(0x6060, 0, 1, 1)
            }
            Command::Enable if self.status().state.follows() => Ok(()),
            Command::Enable => self.enable(),
            other => Err(format!("{other:?} is not a command of this host")),
        }
    }

    fn limit_feed(&mut self, settings: &Settings) -> Result<(), String> {
        let (index, sub) = setting_address("feed.max_um_s").unwrap_or_default();
        self.write(index, sub, settings.feed_max.to_bits(), 4)
    }

    fn erode_by(&mut self, table: &File, to: Nanometres) -> Result<(), String> {
        let to = self.head.protocol().drive().active().head.axis.counts(to).round();
        erode_by(self, table, to)
    }

    fn row(&mut self) -> Result<Option<u8>, String> {
        let (phase, row) = self.head.protocol().drive().technology();
        Ok(row_of(phase as u32, row.into()))
    }

    fn carry(&mut self, mm: f64) {
        self.head.process.fault_inputs.carried_mm = mm;
    }
}

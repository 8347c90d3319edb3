//! The next program, as it is staged: the part of idle in an update (CiA 302-3).
//!
//! Each part is a storage job under a permit of the head, which is disabled meanwhile, with bridge and pulses low. While the stage
//! is erased, and from the order to start on, the permit is kept.

use crate::crossings::MS;
use edm_hal_shim::stage::{DONE, FLASH_END, READY, STAGE, STAGE_SECTORS, Stage, Wrong, clear, mark, staged};
use edm_servo_head::canopen::{Abort, LONGEST, Update};
use edm_servo_head::head::WritePermit;

/// Cycles before each sector is erased, in which answers leave and a host may ask how it is going.
const PAUSE: u32 = 20 * MS;
/// Cycles from the order to start to the reset: the answer to it leaves.
const FAREWELL: u32 = 50 * MS;
/// Words that come at once, at most.
const WORDS: usize = LONGEST / 4;

/// What 1F57h:1 reads (CiA 302-3).
mod status {
    pub const FINE: u32 = 0;
    pub const IN_PROGRESS: u32 = 1;
    pub const NO_PROGRAM: u32 = 1 << 1;
    pub const FORMAT: u32 = 2 << 1;
    pub const SUM: u32 = 3 << 1;
    pub const NOT_CLEARED: u32 = 4 << 1;
    pub const FLASH: u32 = 5 << 1;
    pub const OTHER: u32 = 63 << 1;
}

/// Words of an update, and where in it they belong.
pub struct Piece {
    offset: u32,
    words: [u32; WORDS],
    count: usize,
}

impl Piece {
    /// That of the node. `None`: it is none, or not of whole words.
    pub fn of((offset, bytes): (u32, &[u8])) -> Option<Piece> {
        let (chunks, []) = bytes.as_chunks::<4>() else { return None };
        let mut words = [0; WORDS];
        for (word, chunk) in words.iter_mut().zip(chunks) {
            *word = u32::from_le_bytes(*chunk);
        }
        Some(Piece { offset, words, count: chunks.len() })
    }

    fn words(&self) -> &[u32] {
        self.words.get(..self.count).unwrap_or(&[])
    }
}

/// What goes on for longer than a job: since when, with the permit.
enum Work {
    /// This sector of the stage is erased next.
    Clearing(u32, u32, WritePermit),
    /// The chip is about to start anew.
    Starting(u32, WritePermit),
}

/// What idle is to do before anything else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Due {
    /// Nothing.
    Nothing,
    /// Erase a sector, which may take 2 s.
    Sector,
    /// Start anew.
    Restart,
}

/// The stage and what is known of it.
pub struct Staging<S> {
    stage: S,
    /// Where the next piece belongs; `None` unless it was cleared.
    next: Option<u32>,
    work: Option<Work>,
    status: u32,
}

impl<S: Stage> Staging<S> {
    /// Nothing has been done with it since the start.
    pub fn new(stage: S) -> Self {
        Staging { stage, next: None, work: None, status: status::FINE }
    }

    /// What 1F57h:1 is to read.
    pub fn status(&self) -> u32 {
        self.status
    }

    /// By which the program that runs is known.
    pub fn id(&self) -> u32 {
        self.stage.id()
    }

    /// Whether a job takes so long that the watchdog has to be patient: the sum over a whole program.
    pub fn takes_long(update: Update) -> bool {
        matches!(update, Update::Last | Update::Start)
    }

    /// Does a job. The permit comes back, unless it is needed further.
    pub fn run(
        &mut self,
        update: Update,
        piece: Option<Piece>,
        permit: WritePermit,
        now: u32,
    ) -> (Result<(), Abort>, Option<WritePermit>) {
        let result = match update {
            Update::Stop => Ok(()),
            Update::Clear => {
                self.status = status::IN_PROGRESS;
                Ok(())
            }
            Update::Piece => self.take(piece),
            Update::Last => self.take(piece).and_then(|()| self.check()),
            Update::Start => self.check().and_then(|()| self.flashed(|stage| mark(stage))),
        };
        if !matches!(update, Update::Stop | Update::Piece) || result.is_err() {
            self.next = None;
        }
        match (result, update) {
            (Ok(()), Update::Clear) => self.work = Some(Work::Clearing(0, now, permit)),
            (Ok(()), Update::Start) => self.work = Some(Work::Starting(now, permit)),
            _ => return (result, Some(permit)),
        }
        (result, None)
    }

    /// Takes the next piece.
    fn take(&mut self, piece: Option<Piece>) -> Result<(), Abort> {
        // Whoever sent it has given up.
        let piece = piece.ok_or(Abort::General)?;
        if self.next != Some(piece.offset) {
            self.status = status::NOT_CLEARED;
            return Err(Abort::NotStored);
        }
        let address = STAGE.saturating_add(piece.offset);
        let end = address.saturating_add(4 * piece.count as u32);
        if end > FLASH_END {
            self.status = status::OTHER;
            return Err(Abort::OutOfMemory);
        }
        // The marks are not the host's to make.
        let words = (address..end).step_by(4).zip(piece.words());
        if words.into_iter().any(|(at, word)| (READY..=DONE).contains(&at) && *word != u32::MAX) {
            self.status = status::FORMAT;
            return Err(Abort::InvalidValue);
        }
        self.flashed(|stage| stage.write(address, piece.words()))?;
        self.next = Some(end.saturating_sub(STAGE));
        Ok(())
    }

    fn flashed(&mut self, run: impl FnOnce(&mut S) -> bool) -> Result<(), Abort> {
        if run(&mut self.stage) {
            return Ok(());
        }
        self.status = status::FLASH;
        Err(Abort::Hardware)
    }

    /// Looks whether what is staged is whole, right, and for this board.
    fn check(&mut self) -> Result<(), Abort> {
        let board = self.stage.board();
        let found = staged(&mut self.stage).and_then(|header| match header.board == board {
            true => Ok(()),
            false => Err(Wrong::Product),
        });
        let (abort, status) = match found {
            Ok(()) => {
                self.status = status::FINE;
                return Ok(());
            }
            // An empty stage has no header.
            Err(Wrong::Format) if self.stage.word(STAGE) == u32::MAX => (Abort::NoData, status::NO_PROGRAM),
            Err(Wrong::Format) => (Abort::InvalidValue, status::FORMAT),
            Err(Wrong::Length) => (Abort::Length, status::FORMAT),
            Err(Wrong::Product) => (Abort::Incompatible, status::FORMAT),
            Err(Wrong::Sum) => (Abort::Crc, status::SUM),
        };
        self.status = status;
        Err(abort)
    }

    /// What is to be done now.
    pub fn due(&self, now: u32) -> Due {
        match self.work {
            Some(Work::Clearing(_, since, _)) if now.wrapping_sub(since) >= PAUSE => Due::Sector,
            Some(Work::Starting(since, _)) if now.wrapping_sub(since) >= FAREWELL => Due::Restart,
            _ => Due::Nothing,
        }
    }

    /// Erases the next sector of the stage. The permit comes back with the last.
    pub fn erase(&mut self, now: impl FnOnce() -> u32) -> Option<WritePermit> {
        let Some(Work::Clearing(sector, _, permit)) = self.work.take() else { return None };
        let done = clear(&mut self.stage, sector);
        let next = sector.saturating_add(1);
        match done {
            false => self.status = status::FLASH,
            true if next < STAGE_SECTORS => {
                self.work = Some(Work::Clearing(next, now(), permit));
                return None;
            }
            true => (self.status, self.next) = (status::FINE, Some(0)),
        }
        Some(permit)
    }

    /// Starts anew. Where that returns, the permit comes back.
    pub fn restart(&mut self) -> Option<WritePermit> {
        let Some(Work::Starting(_, permit)) = self.work.take() else { return None };
        self.stage.restart();
        Some(permit)
    }
}

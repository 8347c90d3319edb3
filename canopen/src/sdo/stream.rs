//! A domain on its way to the device: its bytes go on as soon as there are enough of them, and the client waits meanwhile.

use super::{Buffer, Outcome, Step};
use crate::space::Space;
use crate::{Abort, Request, Update};

/// Bytes that the device wants at once.
const WORD: usize = 4;

/// What of a value is in the buffer. All of it, unless it is a domain.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Stream {
    /// Whether it is a domain.
    pub streams: bool,
    /// Bytes that the device has, whole words.
    base: usize,
    /// Bytes that it is about to take.
    piece: usize,
}

impl Stream {
    pub fn new(streams: bool) -> Stream {
        Stream { streams, ..Stream::default() }
    }

    /// Puts bytes behind the first `received`.
    pub fn put(&self, received: usize, data: &[u8], buffer: &mut Buffer) -> Result<(), Abort> {
        buffer.put(received.saturating_sub(self.base), data)
    }

    /// The bytes of the buffer up to the `received`th of all.
    pub fn rest<'b>(&self, received: usize, buffer: &'b Buffer) -> Result<&'b [u8], Abort> {
        buffer.get(received.checked_sub(self.base).ok_or(Abort::Length)?)
    }

    /// Has the device take what is there of the first `received` bytes, and then the answer sent.
    pub fn hand_on(&mut self, received: usize, answer: [u8; 8], space: &mut Space<'_>) -> Outcome {
        self.piece = received.saturating_sub(self.base) / WORD * WORD;
        if self.piece == 0 {
            return Ok(Step::Answer(answer));
        }
        space.dictionary.request(Request::Update(Update::Piece))?;
        Ok(Step::Piece(answer, false))
    }

    /// The same with the last bytes of all.
    pub fn end(&mut self, received: usize, answer: [u8; 8], space: &mut Space<'_>) -> Outcome {
        self.piece = received.saturating_sub(self.base);
        if !self.piece.is_multiple_of(WORD) {
            return Err(Abort::Length);
        }
        space.dictionary.request(Request::Update(Update::Last))?;
        Ok(Step::Piece(answer, true))
    }

    /// What the device is about to take, and where it belongs.
    pub fn piece<'b>(&self, buffer: &'b Buffer) -> Option<(u32, &'b [u8])> {
        Some((self.base as u32, buffer.get(self.piece).ok()?))
    }

    /// The device has it.
    pub fn taken(&mut self, buffer: &mut Buffer) {
        buffer.drop_first(self.piece);
        self.base = self.base.saturating_add(self.piece);
        self.piece = 0;
    }
}

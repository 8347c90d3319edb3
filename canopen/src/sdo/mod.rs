//! SDO server (CiA 301 7.2.4): one channel, expedited, segmented and block transfers in both directions.
//!
//! A value to be written is *staged*: it collects in a buffer and reaches its object when all of it is there and its
//! length and checksum are right. Until then, and after any abort, the object is as it was. A value to be read is copied at
//! the start, so that its segments belong together; a domain is read piece by piece instead. One that is written goes to the
//! device in pieces as well, which sees to it itself that half of one does nothing.
//!
//! A new initiate ends whatever transfer was under way. To distinguish it from the segments of a block download,
//! blocks are at most [`BLOCK`] segments long: the numbers of these are no initiate's command byte.

mod block_download;
mod block_upload;
mod crc;
mod download;
mod stream;
mod upload;

use super::dictionary::LONGEST;
use super::space::{Address, Object, Space};
use super::{Abort, Frame, Time, Written};
use block_download::BlockDownload;
use block_upload::BlockUpload;
use download::Download;
use heapless::Deque;
use stream::Stream;
use upload::Upload;

/// Base of the identifiers of requests.
pub(super) const REQUEST: u16 = 0x600;
/// Base of the identifiers of answers.
pub(super) const ANSWER: u16 = 0x580;
/// The client's longest silence within a transfer, us.
const TIMEOUT_US: u64 = 1_000_000;
/// Segments in a block that we receive; see the module.
const BLOCK: u8 = 31;
/// Room that segments of a block upload leave in the outbox for everything else.
const RESERVE: usize = 6;
/// Command byte of an abort.
const ABORT: u8 = 0x80;
/// Requests that can wait while a value is brought into force. A client sends the next when the last was answered; one that
/// does not wait loses nothing either.
const WAITING: usize = 8;

/// What is under way.
#[derive(Clone, Debug, Default)]
enum Transfer {
    #[default]
    Idle,
    Download(Download),
    Upload(Upload),
    BlockDownload(BlockDownload),
    BlockUpload(BlockUpload),
    /// The device works on a request, which may take long; the answer if it succeeds.
    Device([u8; 8]),
    /// The device takes a piece of a download; the answer if it can, and whether that was all.
    Piece(Pieces, [u8; 8], bool),
    /// The device brings a value into force, which takes a moment; the answer if it succeeds, unless nobody waits for it any
    /// more.
    Write(Option<[u8; 8]>),
}

/// A download while the device takes a piece of it.
#[derive(Clone, Copy, Debug)]
enum Pieces {
    Segments(Download),
    Block(BlockDownload),
}

impl Pieces {
    fn stream(&mut self) -> &mut Stream {
        match self {
            Pieces::Segments(transfer) => &mut transfer.stream,
            Pieces::Block(transfer) => &mut transfer.stream,
        }
    }
}

/// What to do next, unless the transfer is to be aborted.
enum Step {
    /// Go on, with an answer.
    Answer([u8; 8]),
    /// Go on in silence.
    Silent,
    /// The transfer is over, with an answer.
    Last([u8; 8]),
    /// The transfer is over.
    Over,
    /// The device will say how its request ends; the answer if it ends well.
    Device([u8; 8]),
    /// The device will say whether it has taken a piece; the answer if it has, and whether that is all.
    Piece([u8; 8], bool),
    /// The device will say whether the value is in force; the answer if it is.
    Write([u8; 8]),
}

type Outcome = Result<Step, Abort>;

/// Bytes of the value under way.
#[derive(Clone, Debug)]
struct Buffer([u8; LONGEST]);

impl Buffer {
    fn get(&self, length: usize) -> Result<&[u8], Abort> {
        self.0.get(..length).ok_or(Abort::OutOfMemory)
    }

    fn drop_first(&mut self, length: usize) {
        if length <= LONGEST {
            self.0.copy_within(length.., 0);
        }
    }

    fn put(&mut self, offset: usize, data: &[u8]) -> Result<(), Abort> {
        let place = self.0.get_mut(offset..).and_then(|rest| rest.get_mut(..data.len()));
        place.ok_or(Abort::OutOfMemory)?.copy_from_slice(data);
        Ok(())
    }
}

/// The server.
#[derive(Clone, Debug)]
pub(super) struct Server {
    transfer: Transfer,
    address: Address,
    buffer: Buffer,
    heard: Time,
    waiting: Deque<[u8; 8], WAITING>,
    /// Requests to the device whose client has given up, or has asked for something else: their ends concern nobody.
    given_up: u8,
}

impl Default for Server {
    fn default() -> Self {
        let (transfer, address, heard, waiting, given_up) = Default::default();
        Self { transfer, address, buffer: Buffer([0; LONGEST]), heard, waiting, given_up }
    }
}

/// The address in a request.
fn address([_, low, high, sub, ..]: [u8; 8]) -> Address {
    Address { index: u16::from_le_bytes([low, high]), sub }
}

/// The four bytes behind the address.
fn word([_, _, _, _, a, b, c, d]: [u8; 8]) -> u32 {
    u32::from_le_bytes([a, b, c, d])
}

/// An answer with an address.
fn addressed(command: u8, address: Address, [a, b, c, d]: [u8; 4]) -> [u8; 8] {
    let [low, high] = address.index.to_le_bytes();
    [command, low, high, address.sub, a, b, c, d]
}

/// An answer with up to seven bytes.
fn segment(command: u8, data: &[u8]) -> [u8; 8] {
    let mut answer = [command, 0, 0, 0, 0, 0, 0, 0];
    for (to, from) in answer.iter_mut().skip(1).zip(data) {
        *to = *from;
    }
    answer
}

/// Whether a command byte begins a transfer.
fn initiates(command: u8) -> bool {
    match command >> 5 {
        1 | 2 => true,
        5 => command & 0x03 == 0,
        6 => command & 0x01 == 0,
        _ => false,
    }
}

impl Server {
    /// Takes a request. One that is not 8 bytes long is none (CiA 301 7.2.4.3).
    pub fn receive(&mut self, data: &[u8], now: Time, space: &mut Space<'_>) {
        let Ok(request) = <[u8; 8]>::try_from(data) else { return };
        if matches!(self.transfer, Transfer::Write(_)) && request[0] != ABORT {
            if self.waiting.push_back(request).is_err() {
                let refused = addressed(ABORT, address(request), Abort::OutOfMemory.code().to_le_bytes());
                space.objects.out.put(Frame::full(space.objects.id.cob(ANSWER), refused));
            }
            return;
        }
        self.take(request, now, space);
    }

    fn take(&mut self, request: [u8; 8], now: Time, space: &mut Space<'_>) {
        let command = request[0];
        // Bits 4 to 0 mean nothing in an abort; within a block they are the number of a last segment.
        let in_block = matches!(self.transfer, Transfer::BlockDownload(_));
        if command == ABORT || (command >> 5 == ABORT >> 5 && !in_block) {
            self.stop(space);
            return;
        }
        let outcome = if initiates(command) {
            self.leave(space);
            self.address = address(request);
            self.initiate(request, space)
        } else {
            self.go_on(request, space)
        };
        self.heard = now;
        self.finish(outcome, space);
        self.pump(now, space);
    }

    fn initiate(&mut self, request: [u8; 8], space: &mut Space<'_>) -> Outcome {
        let Self { transfer, address, buffer, .. } = self;
        match request[0] >> 5 {
            1 => Download::initiate(request, *address, transfer, space),
            2 => Upload::initiate(*address, transfer, buffer, space),
            5 => BlockUpload::initiate(request, *address, transfer, buffer, space),
            _ => BlockDownload::initiate(request, *address, transfer, space),
        }
    }

    fn go_on(&mut self, request: [u8; 8], space: &mut Space<'_>) -> Outcome {
        let Self { transfer, address, buffer, .. } = self;
        match transfer {
            Transfer::Download(transfer) => transfer.go_on(request, *address, buffer, space),
            Transfer::Upload(transfer) => transfer.go_on(request, buffer, space),
            Transfer::BlockDownload(transfer) => transfer.go_on(request, *address, buffer, space),
            Transfer::BlockUpload(transfer) => transfer.go_on(request),
            Transfer::Device(_) | Transfer::Piece(..) | Transfer::Write(_) => Err(Abort::Command),
            Transfer::Idle => {
                *address = Address::default();
                Err(Abort::Command)
            }
        }
    }

    fn finish(&mut self, outcome: Outcome, space: &mut Space<'_>) {
        let (answer, over) = match outcome {
            Ok(Step::Answer(answer)) => (answer, false),
            Ok(Step::Last(answer)) => (answer, true),
            Ok(Step::Silent) => return,
            Ok(Step::Over) => {
                self.transfer = Transfer::Idle;
                return;
            }
            Ok(Step::Device(answer)) => {
                self.transfer = Transfer::Device(answer);
                return;
            }
            Ok(Step::Piece(answer, all)) => {
                let pieces = match self.transfer {
                    Transfer::Download(transfer) => Pieces::Segments(transfer),
                    Transfer::BlockDownload(transfer) => Pieces::Block(transfer),
                    _ => return,
                };
                self.transfer = Transfer::Piece(pieces, answer, all);
                return;
            }
            Ok(Step::Write(answer)) => {
                self.transfer = Transfer::Write(Some(answer));
                return;
            }
            Err(abort) => (addressed(ABORT, self.address, abort.code().to_le_bytes()), true),
        };
        if over {
            self.transfer = Transfer::Idle;
        }
        space.objects.out.put(Frame::full(space.objects.id.cob(ANSWER), answer));
    }

    /// Ends the transfer under way without a word, and forgets the requests that wait.
    pub fn stop(&mut self, space: &mut Space<'_>) {
        self.waiting.clear();
        self.leave(space);
    }

    /// Ends the transfer without an answer. The device finishes its write; nobody receives the result.
    fn leave(&mut self, space: &mut Space<'_>) {
        match core::mem::take(&mut self.transfer) {
            Transfer::BlockUpload(_) => space.objects.out.discard(space.objects.id.cob(ANSWER)),
            Transfer::Device(_) | Transfer::Piece(..) => self.given_up = self.given_up.saturating_add(1),
            Transfer::Write(_) => self.transfer = Transfer::Write(None),
            _ => {}
        }
    }

    /// A device that has begun anew works on nothing.
    pub fn restart(&mut self, space: &mut Space<'_>) {
        self.stop(space);
        (self.transfer, self.given_up) = (Transfer::Idle, 0);
    }

    /// Sends segments of a block upload while there is room, and gives up a client that has fallen silent.
    pub fn poll(&mut self, now: Time, space: &mut Space<'_>) {
        let waits =
            !matches!(self.transfer, Transfer::Idle | Transfer::Device(_) | Transfer::Piece(..) | Transfer::Write(_));
        if waits && now > self.heard.after(TIMEOUT_US) {
            self.stop(space);
            self.finish(Err(Abort::TimedOut), space);
        }
        self.pump(now, space);
    }

    fn pump(&mut self, now: Time, space: &mut Space<'_>) {
        while let Transfer::BlockUpload(transfer) = &mut self.transfer
            && transfer.has_segments()
            && space.objects.out.room() > RESERVE
        {
            // While segments leave it is not the client that is silent.
            self.heard = now;
            if let Err(abort) = transfer.send(&self.buffer, space) {
                self.leave(space);
                self.finish(Err(abort), space);
            }
        }
    }

    /// The device has done what it was asked, or has not.
    pub fn answer(&mut self, result: Result<(), Abort>, space: &mut Space<'_>) {
        if self.given_up > 0 {
            self.given_up = self.given_up.saturating_sub(1);
        } else if let Transfer::Device(answer) = self.transfer {
            self.finish(result.map(|()| Step::Last(answer)), space);
        } else if let Transfer::Piece(mut pieces, answer, all) = self.transfer {
            pieces.stream().taken(&mut self.buffer);
            self.transfer = match pieces {
                Pieces::Segments(transfer) => Transfer::Download(transfer),
                Pieces::Block(transfer) => Transfer::BlockDownload(transfer),
            };
            self.finish(result.map(|()| if all { Step::Last(answer) } else { Step::Answer(answer) }), space);
        }
    }

    /// What the device is about to take of a download, and where it belongs.
    pub fn piece(&self) -> Option<(u32, &[u8])> {
        match &self.transfer {
            Transfer::Piece(Pieces::Segments(transfer), ..) => transfer.stream.piece(&self.buffer),
            Transfer::Piece(Pieces::Block(transfer), ..) => transfer.stream.piece(&self.buffer),
            _ => None,
        }
    }

    /// The value written last is in force, or was refused. What came meanwhile is dealt with.
    pub fn written(&mut self, result: Result<(), Abort>, space: &mut Space<'_>) {
        let Transfer::Write(answer) = self.transfer else { return };
        self.transfer = Transfer::Idle;
        if let Some(answer) = answer {
            self.finish(result.map(|()| Step::Last(answer)), space);
        }
        let now = self.heard;
        while !matches!(self.transfer, Transfer::Write(_))
            && let Some(request) = self.waiting.pop_front()
        {
            self.take(request, now, space);
        }
    }
}

/// Hands a complete value to its object; `answer` says so.
fn commit(address: Address, data: &[u8], answer: [u8; 8], space: &mut Space<'_>) -> Outcome {
    // Length again: it may have been unknown at the start.
    let object = space.writable(address, Some(data.len() as u32))?;
    Ok(match space.write(object, data)? {
        Written::Now => Step::Last(answer),
        Written::Later => Step::Write(answer),
        Written::Requested => Step::Device(answer),
    })
}

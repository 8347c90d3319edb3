//! Block upload: a value from the device, acknowledged once a block (CiA 301 7.2.4.3.12 to 7.2.4.3.15).

use super::crc::crc;
use super::upload::{Source, Upload};
use super::{ANSWER, Address, Buffer, Outcome, Step, Transfer, addressed, segment};
use crate::space::Space;
use crate::{Abort, Frame};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// The client has to say "start".
    Start,
    /// Segments leave.
    Segments,
    /// The client has to acknowledge the block.
    Acknowledge,
    /// The client has to confirm the end.
    End,
}

/// A block upload under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockUpload {
    source: Source,
    phase: Phase,
    /// Bytes that the client has acknowledged.
    offset: u32,
    /// Segments in a block, as the client wants it, and how many of this one have left.
    block: u8,
    sent: u8,
    /// The last segment of all is among them.
    last: bool,
    /// Checksum of the bytes up to `checked`: a segment that is sent again does not count twice.
    crc: u16,
    checked: u32,
}

fn block_size(size: u8) -> Result<u8, Abort> {
    if matches!(size, 1..=127) { Ok(size) } else { Err(Abort::BlockSize) }
}

impl BlockUpload {
    /// Command byte `101x xc00`, then segments per block and protocol switch threshold: a value of at most that length
    /// goes the ordinary way. Answer `110x xcs0` with the length.
    pub fn initiate(
        request: [u8; 8],
        address: Address,
        transfer: &mut Transfer,
        buffer: &mut Buffer,
        space: &mut Space<'_>,
    ) -> Outcome {
        let [_, _, _, _, block, threshold, ..] = request;
        let block = block_size(block)?;
        let source = Source::open(address, buffer, space)?;
        if threshold != 0 && source.length <= threshold.into() {
            return Upload::from_source(source, address, transfer, buffer, space);
        }
        let new = Self { source, phase: Phase::Start, offset: 0, block, sent: 0, last: false, crc: 0, checked: 0 };
        *transfer = Transfer::BlockUpload(new);
        Ok(Step::Answer(addressed(0xC6, address, source.length.to_le_bytes())))
    }

    /// The client's side: `1010 0011` start, `1010 0010` acknowledge, `1010 0001` end.
    pub fn go_on(&mut self, [command, acknowledged, block, ..]: [u8; 8]) -> Outcome {
        match (self.phase, command & 0xE3) {
            (Phase::Start, 0xA3) => self.phase = Phase::Segments,
            (Phase::Acknowledge, 0xA2) => {
                if acknowledged > self.sent {
                    return Err(Abort::SequenceNumber);
                }
                if self.last && acknowledged == self.sent {
                    self.phase = Phase::End;
                    // The last segment carries 7 bytes less these; an empty value is one segment without any.
                    let used = self.source.length.wrapping_sub(1) % 7 + 1;
                    let unused = if self.source.length == 0 { 7 } else { 7u8.saturating_sub(used as u8) };
                    let answer = segment(0xC1 | unused << 2, &self.crc.to_le_bytes());
                    return Ok(Step::Answer(answer));
                }
                self.offset = self.offset.saturating_add(u32::from(acknowledged) * 7);
                (self.block, self.sent, self.last) = (block_size(block)?, 0, false);
                self.phase = Phase::Segments;
            }
            (Phase::End, 0xA1) => return Ok(Step::Over),
            _ => return Err(Abort::Command),
        }
        Ok(Step::Silent)
    }

    /// Whether segments are to be sent.
    pub fn has_segments(&self) -> bool {
        self.phase == Phase::Segments
    }

    /// Sends the next segment.
    pub fn send(&mut self, buffer: &Buffer, space: &mut Space<'_>) -> Result<(), Abort> {
        let offset = self.offset.saturating_add(u32::from(self.sent) * 7);
        let (piece, length) = self.source.piece(offset, buffer, space)?;
        let end = offset.saturating_add(length as u32);
        if end > self.checked {
            self.crc = crc(self.crc, piece.get(..length).unwrap_or(&[]));
            self.checked = end;
        }
        self.sent = self.sent.saturating_add(1);
        self.last = end >= self.source.length;
        let command = if self.last { 0x80 | self.sent } else { self.sent };
        space.objects.out.put(Frame::full(space.objects.id.cob(ANSWER), segment(command, &piece)));
        if self.last || self.sent >= self.block {
            self.phase = Phase::Acknowledge;
        }
        Ok(())
    }
}

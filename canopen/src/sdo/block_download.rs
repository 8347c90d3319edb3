//! Block download: a value to the device, answered once a block (CiA 301 7.2.4.3.9 to 7.2.4.3.11).

use super::crc::crc;
use super::stream::Stream;
use super::{Address, BLOCK, Buffer, Outcome, Step, Transfer, addressed, commit, segment, word};
use crate::Abort;
use crate::space::Space;

/// A block download under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockDownload {
    announced: Option<u32>,
    checked: bool,
    /// Bytes received, the padding of the last segment among them.
    received: usize,
    /// Last good segment of this block.
    segment: u8,
    /// The last segment of all is here.
    complete: bool,
    pub stream: Stream,
    /// Checksum of what has left the buffer.
    crc: u16,
}

/// Bytes of a segment; as many of the last one may be padding.
const SEGMENT: usize = 7;

impl BlockDownload {
    /// Command byte `110x xcs0`: c checksum, s size given. Answer `101x xc00`.
    pub fn initiate(request: [u8; 8], address: Address, transfer: &mut Transfer, space: &Space<'_>) -> Outcome {
        let [command, ..] = request;
        let announced = (command & 0x02 != 0).then_some(word(request));
        let stream = Stream::new(space.target(address, announced)?);
        let checked = command & 0x04 != 0;
        *transfer = Transfer::BlockDownload(Self {
            announced,
            checked,
            received: 0,
            segment: 0,
            complete: false,
            stream,
            crc: 0,
        });
        Ok(Step::Answer(addressed(0xA4, address, [BLOCK, 0, 0, 0])))
    }

    /// Segments, `cnnn nnnn`: c last, n number in the block. Then the end, `110n nn01`: n bytes without data.
    pub fn go_on(&mut self, request: [u8; 8], address: Address, buffer: &mut Buffer, space: &mut Space<'_>) -> Outcome {
        if self.complete { self.end(request, address, buffer, space) } else { self.segment(request, buffer, space) }
    }

    fn segment(&mut self, [command, data @ ..]: [u8; 8], buffer: &mut Buffer, space: &mut Space<'_>) -> Outcome {
        let (last, number) = (command & 0x80 != 0, command & 0x7F);
        if !(1..=BLOCK).contains(&number) {
            return Err(Abort::SequenceNumber);
        }
        // One that is not the next was lost before, or is a copy: the answer to the block says where to go on.
        if number == self.segment.saturating_add(1) {
            if self.announced.is_some_and(|announced| self.received >= (announced as usize).max(1)) {
                return Err(Abort::LengthTooHigh);
            }
            self.stream.put(self.received, &data, buffer)?;
            self.received = self.received.saturating_add(data.len());
            self.segment = number;
            self.complete = last;
        }
        if !last && number < BLOCK {
            return Ok(Step::Silent);
        }
        let answer = segment(0xA2, &[self.segment, BLOCK]);
        self.segment = 0;
        if !self.stream.streams {
            return Ok(Step::Answer(answer));
        }
        let sure = if self.complete { self.received.saturating_sub(SEGMENT) } else { self.received };
        let step = self.stream.hand_on(sure, answer, space);
        if let Some((_, piece)) = self.stream.piece(buffer) {
            self.crc = crc(self.crc, piece);
        }
        step
    }

    fn end(
        &mut self,
        [command, low, high, ..]: [u8; 8],
        address: Address,
        buffer: &Buffer,
        space: &mut Space<'_>,
    ) -> Outcome {
        if command & 0xE1 != 0xC1 {
            return Err(Abort::Command);
        }
        let length = self.received.checked_sub(usize::from(command >> 2 & 7)).ok_or(Abort::Length)?;
        let data = self.stream.rest(length, buffer)?;
        if self.checked && crc(self.crc, data) != u16::from_le_bytes([low, high]) {
            return Err(Abort::Crc);
        }
        match self.announced {
            Some(announced) if length > announced as usize => Err(Abort::LengthTooHigh),
            Some(announced) if length < announced as usize => Err(Abort::LengthTooLow),
            _ if self.stream.streams => self.stream.end(length, segment(0xA1, &[]), space),
            _ => commit(address, data, segment(0xA1, &[]), space),
        }
    }
}

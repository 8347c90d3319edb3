//! Expedited and segmented download: a value to the device (CiA 301 7.2.4.3.3, 7.2.4.3.4).

use super::stream::Stream;
use super::{Address, Buffer, Outcome, Step, Transfer, addressed, commit, segment, word};
use crate::Abort;
use crate::space::Space;

/// A segmented download under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Download {
    announced: Option<u32>,
    received: usize,
    toggle: bool,
    pub stream: Stream,
}

/// Bytes of a domain that are handed on at once: eight segments' worth of words.
const PIECE: usize = 224;

impl Download {
    /// Command byte `001x nnes`: e expedited, s size given, n bytes without data.
    pub fn initiate(request: [u8; 8], address: Address, transfer: &mut Transfer, space: &mut Space<'_>) -> Outcome {
        let [command, _, _, _, value @ ..] = request;
        let (expedited, sized) = (command & 0x02 != 0, command & 0x01 != 0);
        let answer = addressed(0x60, address, [0; 4]);
        if expedited {
            let object = space.writable(address, None)?;
            let unsized_length = object.kind.size().unwrap_or(value.len());
            let length = if sized { 4 - usize::from(command >> 2 & 3) } else { unsized_length };
            let data = value.get(..length).ok_or(Abort::LengthTooLow)?;
            return commit(address, data, answer, space);
        }
        let announced = sized.then_some(word(request));
        let stream = Stream::new(space.target(address, announced)?);
        *transfer = Transfer::Download(Self { announced, received: 0, toggle: false, stream });
        Ok(Step::Answer(answer))
    }

    /// Command byte `000t nnnc`: t toggle, n bytes without data, c last.
    pub fn go_on(&mut self, request: [u8; 8], address: Address, buffer: &mut Buffer, space: &mut Space<'_>) -> Outcome {
        let [command, data @ ..] = request;
        if command >> 5 != 0 {
            return Err(Abort::Command);
        }
        if (command & 0x10 != 0) != self.toggle {
            return Err(Abort::Toggle);
        }
        let data = data.get(..7 - usize::from(command >> 1 & 7)).unwrap_or(&[]);
        let end = self.received.saturating_add(data.len());
        if self.announced.is_some_and(|announced| end > announced as usize) {
            return Err(Abort::LengthTooHigh);
        }
        self.stream.put(self.received, data, buffer)?;
        self.received = end;
        let answer = segment(0x20 | command & 0x10, &[]);
        if command & 0x01 == 0 {
            self.toggle = !self.toggle;
            let enough = self.stream.streams && self.stream.rest(end, buffer)?.len() >= PIECE;
            return if enough { self.stream.hand_on(end, answer, space) } else { Ok(Step::Answer(answer)) };
        }
        if self.announced.is_some_and(|announced| end < announced as usize) {
            return Err(Abort::LengthTooLow);
        }
        if self.stream.streams {
            return self.stream.end(end, answer, space);
        }
        commit(address, buffer.get(end)?, answer, space)
    }
}

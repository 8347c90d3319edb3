//! Expedited and segmented upload: a value from the device (CiA 301 7.2.4.3.6, 7.2.4.3.7).

use super::{Address, Buffer, Object, Outcome, Step, Transfer, addressed, segment};
use crate::space::Space;
use crate::{Abort, DataType};

/// A value on its way out, from the buffer or, a domain, from its object.
#[derive(Clone, Copy, Debug)]
pub(super) struct Source {
    object: Object,
    pub length: u32,
}

impl Source {
    /// Copies a value into the buffer, unless it is a domain.
    #[inline(never)]
    pub fn open(address: Address, buffer: &mut Buffer, space: &mut Space<'_>) -> Result<Self, Abort> {
        let object = space.readable(address)?;
        let length = match object.kind {
            DataType::Domain => space.stream_length(object)?,
            _ => space.read(object, &mut buffer.0)? as u32,
        };
        Ok(Self { object, length })
    }

    /// Up to seven bytes from an offset on, and how many they are.
    #[inline(never)]
    pub fn piece(&self, offset: u32, buffer: &Buffer, space: &Space<'_>) -> Result<([u8; 7], usize), Abort> {
        let length = self.length.saturating_sub(offset).min(7) as usize;
        let mut piece = [0; 7];
        let out = piece.get_mut(..length).ok_or(Abort::General)?;
        if self.object.kind == DataType::Domain {
            if length > 0 {
                space.stream(self.object, offset, out)?;
            }
        } else {
            let value = buffer.0.get(offset as usize..).and_then(|rest| rest.get(..length));
            out.copy_from_slice(value.ok_or(Abort::General)?);
        }
        Ok((piece, length))
    }
}

/// A segmented upload under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Upload {
    source: Source,
    offset: u32,
    toggle: bool,
}

impl Upload {
    /// Answers with the value when it has 1 to 4 bytes, else with its length. Command byte `010x nnes`.
    pub fn initiate(address: Address, transfer: &mut Transfer, buffer: &mut Buffer, space: &mut Space<'_>) -> Outcome {
        let source = Source::open(address, buffer, space)?;
        Self::from_source(source, address, transfer, buffer, space)
    }

    /// The same for a value that is open already.
    #[inline(never)]
    pub fn from_source(
        source: Source,
        address: Address,
        transfer: &mut Transfer,
        buffer: &Buffer,
        space: &Space<'_>,
    ) -> Outcome {
        if matches!(source.length, 1..=4) {
            let ([a, b, c, d, ..], length) = source.piece(0, buffer, space)?;
            let unused = 4u8.saturating_sub(length as u8);
            return Ok(Step::Last(addressed(0x43 | unused << 2, address, [a, b, c, d])));
        }
        *transfer = Transfer::Upload(Self { source, offset: 0, toggle: false });
        Ok(Step::Answer(addressed(0x41, address, source.length.to_le_bytes())))
    }

    /// Request `011t xxxx`, answer `000t nnnc`: t toggle, n bytes without data, c last.
    #[inline(never)]
    pub fn go_on(&mut self, [command, ..]: [u8; 8], buffer: &Buffer, space: &Space<'_>) -> Outcome {
        if command >> 5 != 3 {
            return Err(Abort::Command);
        }
        if (command & 0x10 != 0) != self.toggle {
            return Err(Abort::Toggle);
        }
        let (piece, length) = self.source.piece(self.offset, buffer, space)?;
        self.offset = self.offset.saturating_add(length as u32);
        let last = self.offset >= self.source.length;
        let unused = 7u8.saturating_sub(length as u8);
        let answer = segment(command & 0x10 | unused << 1 | u8::from(last), &piece);
        self.toggle = !self.toggle;
        Ok(if last { Step::Last(answer) } else { Step::Answer(answer) })
    }
}

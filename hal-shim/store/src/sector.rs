//! One sector as a log of sequential-storage: the record, the view of the sector, and its futures run at once.
//!
//! None of it is generic: it is compiled once, here, and for size.

use super::{Cells, Permit, SECTOR, WORD};
use core::pin::pin;
use core::task::{Context, Poll, Waker};
use embedded_storage_async::nor_flash::{self, NorFlashError, NorFlashErrorKind};
use sequential_storage::Error as LogError;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage, SerializationError, Value};

/// What the log holds. Every format begins with the sequence.
pub(super) struct Record<'a> {
    pub sequence: u32,
    pub format: u8,
    pub image: &'a [u8],
}

impl Record<'_> {
    /// Bytes before the image.
    pub const HEADER: usize = 5;
}

impl<'a> Value<'a> for Record<'a> {
    fn serialize_into(&self, buffer: &mut [u8]) -> Result<usize, SerializationError> {
        let len = Self::HEADER + self.image.len();
        let (header, image) = buffer
            .get_mut(..len)
            .and_then(|b| b.split_first_chunk_mut::<5>())
            .ok_or(SerializationError::BufferTooSmall)?;
        let [a, b, c, d] = self.sequence.to_le_bytes();
        *header = [a, b, c, d, self.format];
        image.copy_from_slice(self.image);
        Ok(len)
    }

    fn deserialize_from(buffer: &'a [u8]) -> Result<(Self, usize), SerializationError> {
        let (&[a, b, c, d, format], image) =
            buffer.split_first_chunk::<5>().ok_or(SerializationError::InvalidFormat)?;
        Ok((Record { sequence: u32::from_le_bytes([a, b, c, d]), format, image }, buffer.len()))
    }
}

/// The log of the sector that `view` shows.
pub(super) fn log<'v, 'f>(view: &'v mut OneSector<'f>) -> Log<'v, 'f> {
    MapStorage::new(view, const { MapConfig::new(0..2 * SECTOR) }, Cache::new_uncached())
}

pub(super) type Log<'v, 'f> = MapStorage<(), &'v mut OneSector<'f>, Cache<Uncached, Uncached, Uncached>>;

/// Runs a future that never waits: the flash beneath it answers at once. A single poll, so nothing can hang here.
pub(super) fn at_once<T, E>(future: impl Future<Output = Result<T, LogError<E>>>) -> Result<T, LogError<E>> {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => Err(LogError::LogicBug {}),
    }
}

/// One sector as sequential-storage sees it: page 0 of two, the other one blank and closed to it.
pub(super) struct OneSector<'f> {
    pub cells: &'f mut dyn Cells,
    /// Where the sector begins in the flash.
    pub base: u32,
    /// Reads from here on give blank cells.
    pub end: u32,
    /// Where the last read began.
    pub last: u32,
    /// `None` to read only.
    pub permit: Option<&'f dyn Permit>,
}

/// Why a view has failed.
#[derive(Debug)]
pub(super) enum Denied {
    Flash,
    NotPermitted,
    /// Outside the sector, or an erase.
    NotHere,
}

impl NorFlashError for Denied {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl nor_flash::ErrorType for OneSector<'_> {
    type Error = Denied;
}

impl nor_flash::ReadNorFlash for OneSector<'_> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Denied> {
        self.last = offset;
        if offset < self.end {
            self.cells.read(self.base + offset, bytes).map_err(|_| Denied::Flash)
        } else {
            bytes.fill(0xFF);
            Ok(())
        }
    }

    fn capacity(&self) -> usize {
        2 * SECTOR as usize
    }
}

impl nor_flash::NorFlash for OneSector<'_> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR as usize;

    async fn erase(&mut self, _from: u32, _to: u32) -> Result<(), Denied> {
        Err(Denied::NotHere)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Denied> {
        let permit = self.permit.ok_or(Denied::NotHere)?;
        if offset >= SECTOR {
            return Err(Denied::NotHere);
        }
        if !permit.holds() {
            return Err(Denied::NotPermitted);
        }
        self.cells.write(self.base + offset, bytes).map_err(|_| Denied::Flash)
    }
}

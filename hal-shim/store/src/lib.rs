//! Settings kept in two reserved flash sectors, through power cuts.
//!
//! An *image* is the stored form of the settings, opaque here. sequential-storage appends each image to a log in one sector,
//! with checksums of length and content; a *sequence* number in front of it says which of two images is newer. When the
//! sector is full, the other one is erased and the log goes on there. Erases alternate, so both sectors wear alike: one
//! erase for every 16 KiB of images.
//!
//! What is newer than the image that can be read, because its cells are damaged or because the power went while it was
//! written, is noticed, and [`Loaded`] says so: behind the newest image a sector is blank, and a sector that was begun after
//! it was erased before.
//!
//! The crate's own move between sectors is not used: it takes sector states from two marker words, and a sector whose erase
//! was interrupted can show any markers. With the torn erases of the flash double it returned images older than the last
//! one and, on the next save, lost all of them. Here the crate sees one sector at a time beside a blank one, may not
//! erase, and every image is read back before it counts.
//!
//! On a single-bank flash an erase stalls the processor for up to half a second. Writing therefore needs a [`Permit`].

#![no_std]
#![forbid(unsafe_code)]

mod sector;

use core::fmt;
use core::marker::PhantomData;
use embedded_storage::nor_flash::NorFlash;
use sector::{Denied, OneSector, Record, at_once, log};
use sequential_storage::Error as LogError;

/// Longest image, bytes; a sector holds two of them. Part of the stored format: a longer record is taken for damage, so it
/// may grow but not shrink.
pub const MAX_IMAGE: usize = 6144;
/// Bytes a load or save works in.
pub const BUFFER: usize = MAX_IMAGE + 8;
/// Bytes of a sector, the least that is erased.
const SECTOR: u32 = 16 * 1024;
/// Bytes that are programmed at once.
const WORD: usize = 4;
/// Layout of a record: sequence, this number, image.
const FORMAT: u8 = 1;
/// Bytes of the mark with which a log begins, and of the one with which it ends.
const MARK: u32 = WORD as u32;
/// Bytes that are looked at together.
const PIECE: usize = 64;

/// What there is to load.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Loaded<'b> {
    /// Nothing was ever saved.
    Nothing,
    /// The image that was saved last.
    Newest(&'b [u8]),
    /// An older image: what was written after it is damaged, or was not finished.
    Older(&'b [u8]),
    /// Something was saved, and none of it can be read.
    Damaged,
}

impl<'b> Loaded<'b> {
    /// The image, if there is one.
    pub fn image(self) -> Option<&'b [u8]> {
        match self {
            Loaded::Newest(image) | Loaded::Older(image) => Some(image),
            Loaded::Nothing | Loaded::Damaged => None,
        }
    }
}

/// WritePermit to write flash: the drive is disabled and pulses are inhibited.
///
/// The head implements this on a type that only its own state can make, and the firmware names that type in
/// [`Store<F, P>`](Store): nothing else can then start a write.
pub trait Permit {
    /// Still disabled and inhibited. Asked before every operation on the flash; leave withdrawn in the middle of a save
    /// ends it as a power cut would.
    fn holds(&self) -> bool;
}

/// Why an image could not be loaded or saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StoreError<E> {
    /// Not permitted, or no longer: the drive must be disabled and pulses inhibited.
    Refused,
    /// The image is longer than [`MAX_IMAGE`].
    TooLong,
    /// The newest image was stored in this unknown format.
    Format(u8),
    /// The sectors do not lie within the flash, or do not begin at an erase boundary.
    Region,
    /// The flash accepted the image but does not read it back: worn out. The image before is still there.
    NotVerified,
    /// The log did what it never should; nothing was erased.
    Defect,
    /// The flash failed.
    Flash(E),
}

impl StoreError<Failed> {
    /// The same, with what the flash said.
    fn with<E>(self, said: Option<E>) -> StoreError<E> {
        match self {
            StoreError::Refused => StoreError::Refused,
            StoreError::TooLong => StoreError::TooLong,
            StoreError::Format(format) => StoreError::Format(format),
            StoreError::Region => StoreError::Region,
            StoreError::NotVerified => StoreError::NotVerified,
            StoreError::Defect => StoreError::Defect,
            StoreError::Flash(Failed) => said.map_or(StoreError::Defect, StoreError::Flash),
        }
    }
}

impl<E: fmt::Debug> fmt::Display for StoreError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StoreError::Refused => f.write_str("settings are stored only while disabled with pulses inhibited"),
            StoreError::TooLong => write!(f, "image of settings is longer than {MAX_IMAGE} bytes"),
            StoreError::Format(format) => {
                write!(f, "stored settings have format {format}, this firmware reads {FORMAT}")
            }
            StoreError::Region => f.write_str("settings sectors do not fit the flash"),
            StoreError::NotVerified => f.write_str("settings do not read back as written: flash worn out"),
            StoreError::Defect => f.write_str("settings log is defective"),
            StoreError::Flash(e) => write!(f, "flash failed: {e:?}"),
        }
    }
}

impl<E: fmt::Debug> core::error::Error for StoreError<E> {}

/// Two sectors of `F` that hold settings, written only under a permit of type `P`.
///
/// `F` erases in sectors of 16 KiB, programs words of 4 bytes, reads any, and bounds every wait of its own.
pub struct Store<F, P> {
    flash: F,
    start: u32,
    permit: PhantomData<fn(&P)>,
}

/// A flash has failed; [`Heard`] keeps what it said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Failed;

/// What the log needs of a flash.
trait Cells {
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Failed>;
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Failed>;
    fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed>;
}

/// A flash whose last error is kept.
struct Heard<'f, F: NorFlash> {
    flash: &'f mut F,
    said: Option<F::Error>,
}

impl<F: NorFlash> Heard<'_, F> {
    fn keep(&mut self, result: Result<(), F::Error>) -> Result<(), Failed> {
        result.map_err(|error| {
            self.said = Some(error);
            Failed
        })
    }
}

impl<F: NorFlash> Cells for Heard<'_, F> {
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Failed> {
        let result = self.flash.read(offset, bytes);
        self.keep(result)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Failed> {
        let result = self.flash.write(offset, bytes);
        self.keep(result)
    }

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed> {
        let result = self.flash.erase(from, to);
        self.keep(result)
    }
}

/// The newest image of one sector.
#[derive(Clone, Copy)]
struct Found {
    sector: u32,
    sequence: u32,
    format: u8,
    /// ObjectHandle of the image in the buffer.
    len: usize,
}

impl<F: NorFlash, P: Permit> Store<F, P> {
    /// Takes the two sectors that begin at offset `start` of the flash.
    pub fn new(flash: F, start: u32) -> Result<Self, StoreError<F::Error>> {
        const { assert!(F::ERASE_SIZE == SECTOR as usize && F::WRITE_SIZE == WORD && F::READ_SIZE == 1) };
        const { assert!(F::ERASE_SIZE >= 2 * BUFFER) };
        let start_at = start as usize;
        let fits = start_at.checked_add(2 * F::ERASE_SIZE).is_some_and(|end| end <= flash.capacity());
        if !fits || !start_at.is_multiple_of(F::ERASE_SIZE) {
            return Err(StoreError::Region);
        }
        Ok(Store { flash, start, permit: PhantomData })
    }

    /// The image saved last, or what is left of it. Reads only, at any time.
    ///
    /// # Errors
    /// [`StoreError::Format`], [`StoreError::Flash`].
    pub fn load<'b>(&mut self, buffer: &'b mut [u8; BUFFER]) -> Result<Loaded<'b>, StoreError<F::Error>> {
        let mut heard = Heard { flash: &mut self.flash, said: None };
        let result = Sectors { cells: &mut heard, start: self.start }.load(buffer);
        result.map_err(|error| error.with(heard.said))
    }

    /// Saves an image. When this returns, `load` gives it back; cut short at any point, `load` gives it or the one before.
    ///
    /// An image that is the newest already, with nothing damaged behind it, is not written again.
    pub fn save(&mut self, image: &[u8], buffer: &mut [u8; BUFFER], permit: &P) -> Result<(), StoreError<F::Error>> {
        let mut heard = Heard { flash: &mut self.flash, said: None };
        let result = Sectors { cells: &mut heard, start: self.start }.save(image, buffer, permit);
        result.map_err(|error| error.with(heard.said))
    }
}

/// Where one image is kept.
pub trait Storage<P> {
    /// Why it could not be loaded or saved.
    type Error;
    /// The image saved last, or what is left of it. Reads only, at any time.
    ///
    /// # Errors
    /// When it cannot be read.
    fn load<'b>(&mut self, buffer: &'b mut [u8; BUFFER]) -> Result<Loaded<'b>, Self::Error>;
    /// Saves an image instead of the one before. Cut short at any point, `load` gives it or the one before.
    ///
    /// # Errors
    /// When it was not saved; the one before is still there.
    fn save(&mut self, image: &[u8], buffer: &mut [u8; BUFFER], permit: &P) -> Result<(), Self::Error>;
}

impl<F: NorFlash, P: Permit> Storage<P> for Store<F, P> {
    type Error = StoreError<F::Error>;

    fn load<'b>(&mut self, buffer: &'b mut [u8; BUFFER]) -> Result<Loaded<'b>, Self::Error> {
        Store::load(self, buffer)
    }

    fn save(&mut self, image: &[u8], buffer: &mut [u8; BUFFER], permit: &P) -> Result<(), Self::Error> {
        Store::save(self, image, buffer, permit)
    }
}

/// The two sectors of a flash of any kind.
struct Sectors<'f> {
    cells: &'f mut dyn Cells,
    start: u32,
}

impl Sectors<'_> {
    fn load<'b>(&mut self, buffer: &'b mut [u8; BUFFER]) -> Result<Loaded<'b>, StoreError<Failed>> {
        let (found, more) = self.newest(buffer)?;
        if let Some(found) = found.filter(|found| found.format != FORMAT) {
            return Err(StoreError::Format(found.format));
        }
        Ok(match (found.and_then(|found| found.image(buffer)), more) {
            (Some(image), false) => Loaded::Newest(image),
            (Some(image), true) => Loaded::Older(image),
            (None, false) => Loaded::Nothing,
            (None, true) => Loaded::Damaged,
        })
    }

    fn save(&mut self, image: &[u8], buffer: &mut [u8; BUFFER], permit: &dyn Permit) -> Result<(), StoreError<Failed>> {
        if image.len() > MAX_IMAGE {
            return Err(StoreError::TooLong);
        }
        if !permit.holds() {
            return Err(StoreError::Refused);
        }
        let (newest, more) = self.newest(buffer)?;
        let (mut sector, mut sequence) = (0, 0);
        if let Some(found) = newest {
            if found.format == FORMAT && !more && found.image(buffer) == Some(image) {
                return Ok(());
            }
            sequence = found.sequence.wrapping_add(1);
            let record = Record { sequence, format: FORMAT, image };
            if self.append(found.sector, &record, buffer, permit)? {
                return Ok(());
            }
            sector = 1 - found.sector;
        }
        // The other sector holds nothing newer. Erased even if it looks blank: an interrupted erase can look so, too.
        if !permit.holds() {
            return Err(StoreError::Refused);
        }
        let from = self.base(sector);
        self.cells.erase(from, from + SECTOR).map_err(StoreError::Flash)?;
        let record = Record { sequence, format: FORMAT, image };
        if self.append(sector, &record, buffer, permit)? { Ok(()) } else { Err(StoreError::NotVerified) }
    }

    fn base(&self, sector: u32) -> u32 {
        self.start + sector * SECTOR
    }

    /// The newer of the two sectors' newest images, left in the buffer, and whether something was written after it.
    fn newest(&mut self, buffer: &mut [u8; BUFFER]) -> Result<(Option<Found>, bool), StoreError<Failed>> {
        let (a, b) = (self.look(0, buffer)?, self.look(1, buffer)?);
        let found = match (a, b) {
            // The buffer holds what was looked at last.
            (Some(a), b) if b.is_none_or(|b| a.sequence > b.sequence) => self.look(0, buffer)?,
            (_, b) => b,
        };
        let more = match found {
            Some(found) => {
                // Older images in the other sector were there first; without any, what is there came later.
                let alone = a.is_none() || b.is_none();
                !self.ends_with(&found, buffer)? || alone && self.written(1 - found.sector)?.is_some()
            }
            None => self.written(0)?.is_some() || self.written(1)?.is_some(),
        };
        Ok((found, more))
    }

    /// Offset of the last byte in the log of a sector that is not blank.
    fn written(&mut self, sector: u32) -> Result<Option<u32>, StoreError<Failed>> {
        let mut end = SECTOR - MARK;
        while end > MARK {
            let from = end.saturating_sub(PIECE as u32).max(MARK);
            let mut piece = [0xFF; PIECE];
            let piece = piece.get_mut(..(end - from) as usize).unwrap_or_default();
            self.cells.read(self.base(sector) + from, piece).map_err(StoreError::Flash)?;
            if let Some(last) = piece.iter().rposition(|byte| *byte != 0xFF) {
                return Ok(Some(from + last as u32));
            }
            end = from;
        }
        Ok(None)
    }

    /// Whether the log of a sector ends with an image that was found there.
    fn ends_with(&mut self, found: &Found, buffer: &[u8; BUFFER]) -> Result<bool, StoreError<Failed>> {
        let Some(last) = self.written(found.sector)? else { return Ok(false) };
        let record = buffer.get(..Record::HEADER + found.len).unwrap_or_default();
        // A record begins with a word, and ends with zeros up to the next one. Bytes like blank cells do not show at its end.
        let shows = match record.len().is_multiple_of(WORD) {
            true => record.iter().rposition(|byte| *byte != 0xFF).unwrap_or(0),
            false => record.len(),
        };
        let begin = (last / MARK).checked_sub((shows / WORD) as u32).map(|word| word * MARK);
        let Some(mut at) = begin.filter(|at| at + record.len() as u32 <= SECTOR - MARK) else { return Ok(false) };
        for expected in record.chunks(PIECE) {
            let mut piece = [0; PIECE];
            let piece = piece.get_mut(..expected.len()).unwrap_or_default();
            self.cells.read(self.base(found.sector) + at, piece).map_err(StoreError::Flash)?;
            if piece != expected {
                return Ok(false);
            }
            at += PIECE as u32;
        }
        Ok(true)
    }

    /// The newest image of one sector, left in the buffer.
    fn look(&mut self, sector: u32, buffer: &mut [u8; BUFFER]) -> Result<Option<Found>, StoreError<Failed>> {
        let base = self.base(sector);
        let mut end = SECTOR;
        loop {
            let mut view = OneSector { cells: self.cells, base, end, last: 0, permit: None };
            let fetched = at_once(log(&mut view).fetch_item::<Record>(buffer, &()));
            return match fetched {
                Ok(record) => {
                    Ok(record.map(|r| Found { sector, sequence: r.sequence, format: r.format, len: r.image.len() }))
                }
                // A header cut short that happens to promise more than was ever written. What lies before it is whole.
                Err(LogError::BufferTooSmall(_)) if view.last < end => {
                    end = view.last;
                    continue;
                }
                Err(LogError::Storage { value: Denied::Flash }) => Err(StoreError::Flash(Failed)),
                Err(LogError::LogicBug { .. }) => Err(StoreError::Defect),
                // The crate wanted to repair, or found nothing it understands.
                Err(_) => Ok(None),
            };
        }
    }

    /// Appends a record to the log of a sector and reads it back; `false` when it is not there afterwards, as in a sector
    /// that is full.
    fn append(
        &mut self,
        sector: u32,
        record: &Record,
        buffer: &mut [u8; BUFFER],
        permit: &dyn Permit,
    ) -> Result<bool, StoreError<Failed>> {
        let (base, end) = (self.base(sector), SECTOR);
        let mut view = OneSector { cells: self.cells, base, end, last: 0, permit: Some(permit) };
        match at_once(log(&mut view).store_item(buffer, &(), record)) {
            Err(LogError::Storage { value: Denied::Flash }) => return Err(StoreError::Flash(Failed)),
            Err(LogError::Storage { value: Denied::NotPermitted }) => return Err(StoreError::Refused),
            Err(LogError::LogicBug { .. }) => return Err(StoreError::Defect),
            Err(_) => return Ok(false),
            Ok(()) => {}
        }
        let found = self.look(sector, buffer)?;
        Ok(found.is_some_and(|f| f.sequence == record.sequence && f.image(buffer) == Some(record.image)))
    }
}

impl Found {
    fn image<'b>(&self, buffer: &'b [u8; BUFFER]) -> Option<&'b [u8]> {
        buffer.get(Record::HEADER..Record::HEADER + self.len)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_hal_shim::double::flash::TestFlash;

    struct WritePermit;

    impl Permit for WritePermit {
        fn holds(&self) -> bool {
            true
        }
    }

    #[test]
    fn a_newer_format_is_named_not_decoded_and_can_be_replaced() {
        let mut buffer = [0; BUFFER];
        let mut store = Store::new(TestFlash::<2>::default(), 0).unwrap();
        let record = Record { sequence: 9, format: FORMAT + 1, image: b"?" };
        let mut heard = Heard { flash: &mut store.flash, said: None };
        let mut sectors = Sectors { cells: &mut heard, start: 0 };
        assert_eq!(sectors.append(0, &record, &mut buffer, &WritePermit), Ok(true));
        assert_eq!(store.load(&mut buffer), Err(StoreError::Format(2)));
        store.save(b"?", &mut buffer, &WritePermit).unwrap();
        assert_eq!(store.load(&mut buffer), Ok(Loaded::Newest(b"?")));
    }
}

//! What outlives the power: one image, a list of objects with their values, the same bytes in the flash of a chip and in the
//! file of a PC.
//!
//! | bytes | content |
//! | --- | --- |
//! | 1 | version of this layout, 15h |
//! | 1 | node-ID that the communication parameters belong to; 0 without any |
//! | 1 | node-ID of the head; 255: it is to wait for one; 0: none was ever stored |
//! | 1 | bit rate, by its index in the table of CiA 301; counts with a node-ID other than 0 |
//! | 1 | what was lost before this was stored, and has not been stored anew: an [`Outcome`]; 0: nothing |
//! | 2 | number of records |
//! | 8 each | index (2), sub-index (1), type (1: index of the CiA 301 data type), value (4, shorter ones filled up with zeros) |
//! | 4 | CRC-32 (that of Ethernet) over all before it |
//!
//! Numbers are little-endian. Records stand in any order. Settings, stored values of the profile and communication parameters
//! are records alike: an *application* record has an index from 2000h on, a *communication* record one below. What an address
//! means is the affair of drive and node: which values they pass over or replace by defaults, their [`LoadReport`] says.
//!
//! Every version has its checksum at the end, so that a future version is not taken for damage.

use crc::{CRC_32_ISO_HDLC, Crc};
use edm_canopen::{BitRate, BusSettings, Listed, NodeId, Record};
use edm_hal_shim::store::{Loaded, MAX_IMAGE};

/// Version of the layout.
const VERSION: u8 = 0x15;
/// Node-ID of a head that is to wait for one.
const WAITS: u8 = 255;
/// Bytes before the records.
const HEAD: usize = 7;
/// Bytes of a record.
const RECORD: usize = 8;
/// Bytes of the checksum.
const CHECK: usize = 4;
/// Records that fit.
pub const ROOM: usize = (MAX_IMAGE - HEAD - CHECK) / RECORD;

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Lowest index of an application record.
const APPLICATION: u16 = 0x2000;

/// What became of the image that was stored last: object 200Bh:1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// There never was one.
    #[default]
    Nothing = 0,
    /// It is in force.
    Newest = 1,
    /// An older one is in force: it is damaged, or was not finished.
    Older = 2,
    /// The defaults are in force: it is damaged, and no older one can be read.
    Damaged = 3,
    /// The defaults are in force: it is of a version that is not known here.
    Unknown = 4,
}

impl Outcome {
    /// Whether something that was stored is not in force.
    pub fn is_loss(self) -> bool {
        Self::LOSSES.contains(&self)
    }

    const LOSSES: [Outcome; 3] = [Outcome::Older, Outcome::Damaged, Outcome::Unknown];
}

/// Result of loading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LoadReport {
    /// Of the image.
    pub outcome: Outcome,
    /// Records of objects that are not there or not stored: passed over.
    pub skipped: Listed,
    /// Values that were missing, out of range or at odds with others: the default is in force.
    pub defaulted: Listed,
}

impl LoadReport {
    /// Whether all that was stored is in force, and nothing else.
    pub fn is_whole(&self) -> bool {
        !self.outcome.is_loss() && self.skipped.is_empty() && self.defaulted.is_empty()
    }
}

#[cfg(not(target_os = "none"))]
impl core::fmt::Display for LoadReport {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self.outcome {
            Outcome::Nothing => "nothing was stored",
            Outcome::Newest => "what was stored last is in force",
            Outcome::Older => "an older image is in force, what was stored last is damaged or was not finished",
            Outcome::Damaged => "the defaults are in force, what was stored is damaged",
            Outcome::Unknown => "the defaults are in force, what was stored is of an unknown version",
        })?;
        let lists = [(self.skipped, "unknown and passed over"), (self.defaulted, "replaced by their defaults")];
        for (listed, what) in lists {
            if let Some((index, sub)) = listed.first {
                write!(f, "; {} values {what}, the first {index:04X}h:{sub}", listed.count)?;
            }
        }
        Ok(())
    }
}

/// There is no room for a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Full;

/// What is stored, maybe nothing. Large: it lives in one place and is loaded there.
#[derive(Clone, Debug)]
pub struct StoredImage {
    outcome: Outcome,
    /// The image, valid up to its checksum.
    bytes: [u8; MAX_IMAGE],
    /// Records in it.
    count: usize,
}

impl Default for StoredImage {
    fn default() -> Self {
        Self::NOTHING
    }
}

impl PartialEq for StoredImage {
    fn eq(&self, other: &Self) -> bool {
        self.outcome == other.outcome
            && self.node() == other.node()
            && self.bus() == other.bus()
            && self.records().eq(other.records())
    }
}

impl Eq for StoredImage {}

impl StoredImage {
    /// Nothing was ever stored.
    pub const NOTHING: StoredImage = StoredImage { outcome: Outcome::Nothing, bytes: [0; MAX_IMAGE], count: 0 };

    /// Takes what a store has found instead of what is here.
    pub fn load(&mut self, found: Loaded<'_>) -> Outcome {
        self.clear();
        self.outcome = match (found, found.image()) {
            (Loaded::Nothing, _) => Outcome::Nothing,
            (_, None) => Outcome::Damaged,
            (found, Some(image)) => match self.read(image) {
                Ok(()) if matches!(found, Loaded::Newest(_)) => self.lost().unwrap_or(Outcome::Newest),
                Ok(()) => Outcome::Older,
                Err(outcome) => {
                    self.clear();
                    outcome
                }
            },
        };
        self.outcome
    }

    /// What loading it came to.
    pub fn outcome(&self) -> Outcome {
        self.outcome
    }

    /// The image as it is stored. Longest: [`MAX_IMAGE`].
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..HEAD + RECORD * self.count + CHECK).unwrap_or_default()
    }

    /// Its records.
    pub fn records(&self) -> impl Iterator<Item = Record> + '_ {
        let records = self.bytes.get(HEAD..HEAD + RECORD * self.count).unwrap_or_default();
        records.as_chunks::<RECORD>().0.iter().map(|bytes| from_bytes(*bytes))
    }

    /// Records of the application: settings, and values of the profile.
    pub fn application(&self) -> impl Iterator<Item = Record> + '_ {
        self.records().filter(|record| record.index >= APPLICATION)
    }

    /// Records of the communication area.
    pub fn communication(&self) -> impl Iterator<Item = Record> + '_ {
        self.records().filter(|record| record.index < APPLICATION)
    }

    /// The node that the records of the communication area belong to.
    pub fn node(&self) -> Option<NodeId> {
        let [_, node, ..] = self.bytes;
        NodeId::new(node)
    }

    /// How the head is reached, if that was stored.
    pub fn bus(&self) -> Option<BusSettings> {
        let [_, _, node, rate, ..] = self.bytes;
        let bit_rate = BitRate::from_index(rate)?;
        let id = NodeId::new(node);
        (id.is_some() || node == WAITS).then_some(BusSettings { node: id, bit_rate })
    }

    /// Takes out the records of the application, of the communication area, or both. What remains is to be
    /// [sealed](Self::seal).
    pub(crate) fn remove(&mut self, application: bool, communication: bool) {
        let (mut from, before) = (0, core::mem::take(&mut self.count));
        while from < before {
            if let Some(record) = self.record(from) {
                let goes = if record.index >= APPLICATION { application } else { communication };
                // Never full: it goes to where it was, or in front of that.
                if !goes && self.put(record).is_err() {
                    return;
                }
            }
            from += 1;
        }
        if let (true, [_, node, ..]) = (communication, &mut self.bytes) {
            *node = 0;
        }
    }

    /// Appends a record. What there is then is to be [sealed](Self::seal).
    ///
    /// # Errors
    /// There is no room; nothing has changed.
    pub(crate) fn put(&mut self, record: Record) -> Result<(), Full> {
        let place = HEAD + RECORD * self.count;
        if self.count >= ROOM {
            return Err(Full);
        }
        self.bytes.get_mut(place..place + RECORD).ok_or(Full)?.copy_from_slice(&to_bytes(record));
        self.count += 1;
        Ok(())
    }

    /// Gives records of an address another value. What there is then is to be [sealed](Self::seal).
    pub(crate) fn change(&mut self, (index, sub): (u16, u8), value: u32) {
        let end = HEAD + RECORD * self.count;
        let records = self.bytes.get_mut(HEAD..end).unwrap_or_default().as_chunks_mut::<RECORD>().0;
        for bytes in records {
            let record = from_bytes(*bytes);
            if (record.index, record.sub) == (index, sub) {
                *bytes = to_bytes(Record { value, ..record });
            }
        }
    }

    /// Whose the records of the communication area are.
    pub(crate) fn belongs_to(&mut self, id: NodeId) {
        let [_, node, ..] = &mut self.bytes;
        *node = id.get();
    }

    /// How the head is reached from its next start on. What there is then is to be [sealed](Self::seal).
    pub(crate) fn set_bus(&mut self, BusSettings { node, bit_rate }: BusSettings) {
        let [_, _, id, rate, ..] = &mut self.bytes;
        (*id, *rate) = (node.map_or(WAITS, NodeId::get), bit_rate as u8);
    }

    /// What was lost before, and is still to be reported. What there is then is to be [sealed](Self::seal).
    pub(crate) fn set_lost(&mut self, outcome: Option<Outcome>) {
        let [_, _, _, _, lost, ..] = &mut self.bytes;
        *lost = outcome.map_or(0, |outcome| outcome as u8);
    }

    fn lost(&self) -> Option<Outcome> {
        let [_, _, _, _, lost, ..] = self.bytes;
        Outcome::LOSSES.into_iter().find(|outcome| *outcome as u8 == lost)
    }

    /// Version, count and checksum. It is what will have been stored last.
    pub(crate) fn seal(&mut self) {
        self.outcome = self.lost().unwrap_or(Outcome::Newest);
        let [low, high] = (self.count as u16).to_le_bytes();
        let [version, _, _, _, _, a, b, ..] = &mut self.bytes;
        (*version, *a, *b) = (VERSION, low, high);
        if let Some((content, check)) = self.bytes.split_at_mut_checked(HEAD + RECORD * self.count)
            && let Some(check) = check.first_chunk_mut::<CHECK>()
        {
            *check = CRC.checksum(content).to_le_bytes();
        }
    }

    fn clear(&mut self) {
        let [_, node, id, rate, lost, ..] = &mut self.bytes;
        (*node, *id, *rate, *lost, self.count) = (0, 0, 0, 0, 0);
    }

    fn record(&self, nth: usize) -> Option<Record> {
        self.bytes.get(HEAD + RECORD * nth..)?.first_chunk().map(|bytes| from_bytes(*bytes))
    }

    /// Takes an image over.
    fn read(&mut self, image: &[u8]) -> Result<(), Outcome> {
        let (content, check) = image.split_last_chunk::<CHECK>().ok_or(Outcome::Damaged)?;
        if CRC.checksum(content) != u32::from_le_bytes(*check) {
            return Err(Outcome::Damaged);
        }
        let (&[version, _, _, _, _, a, b], records) = content.split_first_chunk::<HEAD>().ok_or(Outcome::Damaged)?;
        if version != VERSION {
            return Err(Outcome::Unknown);
        }
        let count = usize::from(u16::from_le_bytes([a, b]));
        if records.len() != RECORD * count {
            return Err(Outcome::Damaged);
        }
        self.bytes.get_mut(..image.len()).ok_or(Outcome::Unknown)?.copy_from_slice(image);
        self.count = count;
        Ok(())
    }
}

fn to_bytes(record: Record) -> [u8; RECORD] {
    let ([a, b], [w, x, y, z]) = (record.index.to_le_bytes(), record.value.to_le_bytes());
    [a, b, record.sub, record.kind, w, x, y, z]
}

fn from_bytes([a, b, sub, kind, w, x, y, z]: [u8; RECORD]) -> Record {
    Record { index: u16::from_le_bytes([a, b]), sub, kind, value: u32::from_le_bytes([w, x, y, z]) }
}

/// Puts records that a visitor brings, until there is no room.
pub(crate) struct Putting<'a> {
    image: &'a mut StoredImage,
    result: Result<(), Full>,
}

impl<'a> Putting<'a> {
    /// Into this image.
    pub fn into(image: &'a mut StoredImage) -> Self {
        Putting { image, result: Ok(()) }
    }

    /// One more.
    pub fn put(&mut self, record: Record) {
        if self.result.is_ok() {
            self.result = self.image.put(record);
        }
    }

    /// Whether there was room for all.
    pub fn end(self) -> Result<(), Full> {
        self.result
    }
}

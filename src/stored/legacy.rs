//! Images of 0.1.0, which were values without addresses: translated to records. Nothing here changes any more.
//!
//! | bytes | content |
//! | --- | --- |
//! | 1 | bit 0: the application is there; bit 1: the communication parameters |
//! | 5 | version 1 and fingerprint of the list of settings |
//! | 309 | the settings in their order: numbers 4 bytes, flags and choices 1 |
//! | 1 | version 1 of the values of the profile |
//! | 256 | 64 places for values of the profile, 4 bytes each |
//! | 2 | version 1 of the communication parameters, node-ID |
//! | 370 | the communication parameters in their order |
//!
//! A checksum was the affair of the flash; a file had none.

use super::{Putting, StoredImage};
use edm_canopen::{BusSettings, DataType, NodeId, Record};

/// Length of every image, bytes.
const LENGTH: usize = 944;
const APPLICATION: u8 = 1;
const COMMUNICATION: u8 = 2;
/// Version and fingerprint of the settings of 0.1.0.
const SETTINGS_HEAD: [u8; 5] = [1, 0xB8, 0x9D, 0x4A, 0x0D];

/// Groups of settings in their order, with the types of sub-indices from 1 on: f REAL32, u UNSIGNED32, b BOOLEAN, c a choice,
/// UNSIGNED8.
const SETTINGS: [(u16, &[u8]); 13] = [
    (0x2100, b"cufbffbfufffffcfff"),
    (0x2101, b"f"),
    (0x2102, b"ccfffffffff"),
    (0x2103, b"ffff"),
    (0x2104, b"fff"),
    (0x2105, b"ufffffff"),
    (0x2106, b"ffffffff"),
    (0x2107, b"bffffff"),
    (0x2108, b"fbfuuu"),
    (0x2109, b"fff"),
    (0x210A, b"fufffuuu"),
    (0x210B, b"fff"),
    (0x210C, b"bfff"),
];
const SETTINGS_LENGTH: usize = 309;

const U8: DataType = DataType::Unsigned8;
const U16: DataType = DataType::Unsigned16;
const U32: DataType = DataType::Unsigned32;
const I8: DataType = DataType::Integer8;
const I16: DataType = DataType::Integer16;
const I32: DataType = DataType::Integer32;

/// Values of the profile in their order.
const PROFILE: [(u16, u8, DataType); 24] = [
    (0x2003, 1, U32),
    (0x2003, 2, U16),
    (0x605A, 0, I16),
    (0x605B, 0, I16),
    (0x605C, 0, I16),
    (0x605D, 0, I16),
    (0x6067, 0, U32),
    (0x6068, 0, U16),
    (0x606D, 0, U16),
    (0x606E, 0, U16),
    (0x606F, 0, U16),
    (0x607C, 0, I32),
    (0x607D, 1, I32),
    (0x607D, 2, I32),
    (0x6081, 0, U32),
    (0x6083, 0, U32),
    (0x6084, 0, U32),
    (0x6085, 0, U32),
    (0x6098, 0, I8),
    (0x6099, 1, U32),
    (0x6099, 2, U32),
    (0x609A, 0, U32),
    (0x60C2, 1, U8),
    (0x60C2, 2, I8),
];
const PROFILE_LENGTH: usize = 256;

/// Communication parameters in their order: first index and how many follow on each other, first sub-index and how many, type.
const PARAMETERS: [(u16, u16, u8, u8, DataType); 21] = [
    (0x1005, 1, 0, 1, U32),
    (0x1006, 1, 0, 1, U32),
    (0x1007, 1, 0, 1, U32),
    (0x1014, 1, 0, 1, U32),
    (0x1015, 1, 0, 1, U16),
    (0x1016, 1, 1, 4, U32),
    (0x1017, 1, 0, 1, U16),
    (0x1019, 1, 0, 1, U8),
    (0x1029, 1, 1, 1, U8),
    (0x1400, 4, 1, 1, U32),
    (0x1400, 4, 2, 1, U8),
    (0x1400, 4, 5, 1, U16),
    (0x1600, 4, 0, 1, U8),
    (0x1600, 4, 1, 8, U32),
    (0x1800, 4, 1, 1, U32),
    (0x1800, 4, 2, 1, U8),
    (0x1800, 4, 3, 1, U16),
    (0x1800, 4, 5, 1, U16),
    (0x1800, 4, 6, 1, U8),
    (0x1A00, 4, 0, 1, U8),
    (0x1A00, 4, 1, 8, U32),
];
const PARAMETERS_LENGTH: usize = 370;

const _: () = assert!(1 + 5 + SETTINGS_LENGTH + 1 + PROFILE_LENGTH + 2 + PARAMETERS_LENGTH == LENGTH);

/// Whether an image is of 0.1.0.
pub(super) fn is_it(image: &[u8]) -> bool {
    image.len() == LENGTH && image.first().is_some_and(|parts| parts & !(APPLICATION | COMMUNICATION) == 0)
}

/// Translates an image; `None` when it is none.
pub(super) fn read(image: &[u8], into: &mut StoredImage) -> Option<()> {
    let (&parts, image) = image.split_first()?;
    let (head, image) = image.split_first_chunk::<5>()?;
    let (settings, image) = image.split_at_checked(SETTINGS_LENGTH)?;
    let (&version, image) = image.split_first()?;
    let (profile, image) = image.split_at_checked(PROFILE_LENGTH)?;
    let (&[parameters_version, node], parameters) = image.split_first_chunk::<2>()?;
    if parts & APPLICATION != 0 {
        if *head != SETTINGS_HEAD || version != 1 {
            return None;
        }
        application(settings, profile, into)?;
    }
    if parts & COMMUNICATION != 0 {
        if parameters_version != 1 {
            return None;
        }
        into.belongs_to(NodeId::new(node)?);
        communication(parameters, into)?;
    }
    match into.node() {
        Some(node) => into.set_bus(BusSettings::at_1_mbit(Some(node))),
        None => into.set_from_0_1_0(),
    }
    into.seal();
    Some(())
}

fn application(settings: &[u8], profile: &[u8], into: &mut StoredImage) -> Option<()> {
    let mut putting = Putting::into(into);
    let mut rest = settings;
    for (index, types) in SETTINGS {
        for (sub, kind) in (1..).zip(types) {
            let kind = match kind {
                b'f' => DataType::Real32,
                b'u' => U32,
                b'b' => DataType::Boolean,
                _ => U8,
            };
            putting.put(Record::new(index, sub, kind, next(&mut rest, kind)?));
        }
    }
    for (bytes, (index, sub, kind)) in profile.as_chunks::<4>().0.iter().zip(PROFILE) {
        // Kept in 32 bits; the type's own come first.
        let mut bytes = &bytes[..];
        putting.put(Record::new(index, sub, kind, next(&mut bytes, kind)?));
    }
    putting.end().ok()
}

fn communication(parameters: &[u8], into: &mut StoredImage) -> Option<()> {
    let mut putting = Putting::into(into);
    let mut rest = parameters;
    for (first, indices, sub, subs, kind) in PARAMETERS {
        for index in first..first + indices {
            for sub in sub..sub + subs {
                putting.put(Record::new(index, sub, kind, next(&mut rest, kind)?));
            }
        }
    }
    putting.end().ok()
}

/// Takes a value of a type off the front.
fn next(rest: &mut &[u8], kind: DataType) -> Option<u32> {
    let (bytes, behind) = rest.split_at_checked(kind.size()?)?;
    *rest = behind;
    Some(bytes.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte)))
}

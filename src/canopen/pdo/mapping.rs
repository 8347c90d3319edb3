//! What a PDO carries: the entries of 1600h or 1A00h, resolved once into places.

use super::Direction;
use crate::canopen::device::ENTRIES;
use crate::canopen::{Abort, DataType, Dictionary, Mapping, Place};

/// Bytes in a PDO.
const LENGTH: usize = 8;

/// One mapped object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    /// A dummy entry: bytes without meaning for us (CiA 301 7.4.7.1).
    Dummy,
    /// 1001h.
    ErrorRegister,
    /// An object of the device.
    Object(Place),
}

/// Mapped objects in their order, with their lengths in bytes.
#[derive(Clone, Debug, Default)]
pub(in crate::canopen) struct Map {
    targets: [Option<(Target, u8)>; ENTRIES],
    length: u8,
}

/// Looks up one entry.
fn resolve(entry: u32, direction: Direction, dictionary: &dyn Dictionary) -> Result<(Target, u8), Abort> {
    let (index, sub, bits) = ((entry >> 16) as u16, (entry >> 8) as u8, entry as u8);
    let (kind, mappable, target) = match (index, sub) {
        (0x1001, 0) => (DataType::Unsigned8, direction == Direction::Transmit, Target::ErrorRegister),
        (0x1000..=0x1FFF, _) => return Err(Abort::NotMappable),
        (1..=0x1F, _) => (dummy(index, sub)?, direction == Direction::Receive, Target::Dummy),
        _ => {
            let entry = dictionary.entry(index, sub)?;
            let mappable = match (entry.mapping, direction) {
                (Mapping::No, _) => false,
                (Mapping::Receive | Mapping::Both, Direction::Receive) => entry.access.writable(),
                (Mapping::Transmit | Mapping::Both, Direction::Transmit) => entry.access.readable(),
                _ => false,
            };
            (entry.kind, mappable && kind_fits(entry.kind), Target::Object(entry.place))
        }
    };
    match kind.size() {
        Some(size) if mappable && usize::from(bits) == size * 8 => Ok((target, size as u8)),
        _ => Err(Abort::NotMappable),
    }
}

/// A Boolean would be one bit, and what follows it no longer bytes.
fn kind_fits(kind: DataType) -> bool {
    kind != DataType::Boolean
}

/// Static data types that can be mapped as dummy entries.
pub(in crate::canopen) fn dummy(index: u16, sub: u8) -> Result<DataType, Abort> {
    let kind = match index {
        0x02 => DataType::Integer8,
        0x03 => DataType::Integer16,
        0x04 => DataType::Integer32,
        0x05 => DataType::Unsigned8,
        0x06 => DataType::Unsigned16,
        0x07 => DataType::Unsigned32,
        _ => return Err(Abort::NoObject),
    };
    if sub == 0 { Ok(kind) } else { Err(Abort::NoSubIndex) }
}

impl Map {
    /// Whether an object may be written into an entry of the mapping.
    pub fn accepts(entry: u32, direction: Direction, dictionary: &dyn Dictionary) -> Result<(), Abort> {
        resolve(entry, direction, dictionary).map(drop)
    }

    /// Resolves entries.
    ///
    /// # Errors
    /// An object that does not exist or cannot be mapped in this direction; [`Abort::PdoLength`] beyond 8 bytes.
    pub fn new(entries: &[u32], direction: Direction, dictionary: &dyn Dictionary) -> Result<Self, Abort> {
        let mut map = Self::default();
        let mut targets = map.targets.iter_mut();
        for entry in entries {
            let (target, size) = resolve(*entry, direction, dictionary)?;
            map.length = map.length.saturating_add(size);
            *targets.next().ok_or(Abort::PdoLength)? = Some((target, size));
        }
        if usize::from(map.length) > LENGTH { Err(Abort::PdoLength) } else { Ok(map) }
    }

    /// Bytes of the PDO.
    pub fn length(&self) -> usize {
        self.length.into()
    }

    /// Hands the bytes of a received PDO to their objects. What an object refuses is not taken; the others are.
    pub fn deliver(&self, data: &[u8; LENGTH], dictionary: &mut dyn Dictionary) {
        let mut rest = &data[..];
        for (target, size) in self.targets.iter().flatten() {
            let Some((value, behind)) = rest.split_at_checked(usize::from(*size)) else { return };
            if let Target::Object(place) = target {
                let _ = dictionary.write(*place, value);
            }
            rest = behind;
        }
    }

    /// Collects the values of the mapped objects; `None` when one of them cannot be read.
    pub fn collect(&self, register: u8, dictionary: &dyn Dictionary) -> Option<[u8; LENGTH]> {
        let mut data = [0; LENGTH];
        let mut rest = &mut data[..];
        for (target, size) in self.targets.iter().flatten() {
            let (out, behind) = rest.split_at_mut_checked(usize::from(*size))?;
            let mut value = [register, 0, 0, 0, 0, 0, 0, 0];
            if let Target::Object(place) = target {
                dictionary.read(*place, &mut value).ok()?;
            }
            out.copy_from_slice(value.get(..out.len())?);
            rest = behind;
        }
        Some(data)
    }
}

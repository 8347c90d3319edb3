//! What a PDO carries: the entries of 1600h or 1A00h, resolved once into places.

use crate::device::{Direction, ENTRIES};
use crate::{Abort, DataType, Dictionary, Mapping, ObjectHandle};

/// Bytes in a PDO.
const LENGTH: usize = 8;

/// What a mapped object is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Target {
    /// A dummy entry: bytes without meaning for us (CiA 301 7.4.7.1).
    #[default]
    Dummy,
    /// 1001h.
    ErrorRegister,
    /// An object of the device.
    Object,
}

/// A mapped object; of no size: none.
#[derive(Clone, Copy, Debug, Default)]
struct Mapped {
    place: ObjectHandle,
    target: Target,
    size: u8,
}

/// Mapped objects in their order.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Map {
    mapped: [Mapped; ENTRIES],
    length: u8,
}

/// Looks up one entry.
fn resolve(entry: u32, direction: Direction, dictionary: &dyn Dictionary) -> Result<Mapped, Abort> {
    let (index, sub, bits) = ((entry >> 16) as u16, (entry >> 8) as u8, entry as u8);
    let mut place = ObjectHandle::default();
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
            place = entry.place;
            // A Boolean would be one bit, and what follows it no longer bytes.
            (entry.kind, mappable && entry.kind != DataType::Boolean, Target::Object)
        }
    };
    match kind.size() {
        Some(size) if mappable && usize::from(bits) == size * 8 => Ok(Mapped { place, target, size: size as u8 }),
        _ => Err(Abort::NotMappable),
    }
}

/// Static data types that can be mapped as dummy entries.
pub(crate) fn dummy(index: u16, sub: u8) -> Result<DataType, Abort> {
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
    /// An object that does not exist or cannot be mapped in this direction; [`Abort::PdoLength`] beyond 8 bytes. Nothing
    /// has changed.
    pub fn resolve(&mut self, entries: &[u32], direction: Direction, dictionary: &dyn Dictionary) -> Result<(), Abort> {
        let mut map = Self::default();
        if entries.len() > ENTRIES {
            return Err(Abort::PdoLength);
        }
        for (place, entry) in map.mapped.iter_mut().zip(entries) {
            *place = resolve(*entry, direction, dictionary)?;
            map.length = map.length.saturating_add(place.size);
        }
        if usize::from(map.length) > LENGTH {
            return Err(Abort::PdoLength);
        }
        *self = map;
        Ok(())
    }

    /// Bytes of the PDO.
    pub fn length(&self) -> usize {
        self.length.into()
    }

    /// Hands the bytes of a received PDO to their objects. What an object refuses is not taken; the others are.
    pub fn deliver(&self, data: &[u8; LENGTH], dictionary: &mut dyn Dictionary) {
        let mut rest = &data[..];
        for mapped in self.mapped.iter().take_while(|mapped| mapped.size != 0) {
            let Some((value, behind)) = rest.split_at_checked(mapped.size.into()) else { return };
            if mapped.target == Target::Object {
                let _ = dictionary.write(mapped.place, value);
            }
            rest = behind;
        }
    }

    /// Finds the bytes for `place`; `None` when those for another object are not its value already.
    pub fn ahead(
        &self,
        data: &[u8; LENGTH],
        place: ObjectHandle,
        dictionary: &dyn Dictionary,
        value: &mut Option<[u8; 4]>,
    ) -> Option<()> {
        let mut rest = &data[..];
        for mapped in self.mapped.iter().take_while(|mapped| mapped.size != 0) {
            let (bytes, behind) = rest.split_at_checked(mapped.size.into())?;
            if mapped.target == Target::Object && mapped.place == place {
                value.insert([0; 4]).get_mut(..bytes.len())?.copy_from_slice(bytes);
            } else if mapped.target == Target::Object {
                let mut present = [0; LENGTH];
                let length = dictionary.read(mapped.place, &mut present).ok()?;
                if present.get(..length)? != bytes {
                    return None;
                }
            }
            rest = behind;
        }
        Some(())
    }

    /// Collects the values of the mapped objects; `None` when one of them cannot be read.
    pub fn collect(&self, register: u8, dictionary: &dyn Dictionary) -> Option<[u8; LENGTH]> {
        let mut data = [0; LENGTH];
        let mut rest = &mut data[..];
        for mapped in self.mapped.iter().take_while(|mapped| mapped.size != 0) {
            let (out, behind) = rest.split_at_mut_checked(mapped.size.into())?;
            let mut value = [register, 0, 0, 0, 0, 0, 0, 0];
            if mapped.target == Target::Object {
                dictionary.read(mapped.place, &mut value).ok()?;
            }
            out.copy_from_slice(value.get(..out.len())?);
            rest = behind;
        }
        Some(data)
    }
}

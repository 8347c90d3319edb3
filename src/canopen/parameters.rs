//! The values of the communication area that a host can write: defaults, checks that need nothing else, stored form.

use super::area::Item;
use super::device::{Device, ENTRIES, PDOS, PdoDefault};
use super::pdo::Direction;
use super::{Abort, NodeId};

/// Bit 31 of a COB-ID: not in use.
pub(super) const INVALID: u32 = 1 << 31;
/// Bit 30 of a TPDO's COB-ID: not to be asked for by a remote frame. Bit 30 of 1005h: produces SYNC.
pub(super) const BIT_30: u32 = 1 << 30;
/// Bit 29 of a COB-ID: 29-bit identifier; bits 28 to 11 belong to it alone.
const EXTENDED: u32 = 0x3FFF_F800;
/// Heartbeats that can be watched: entries of 1016h.
pub(super) const CONSUMERS: usize = 4;

/// Parameters of one PDO.
#[derive(Clone, Debug)]
pub(super) struct Pdo {
    pub id: u32,
    pub transmission: u8,
    pub inhibit: u16,
    pub timer: u16,
    pub start: u8,
    pub count: u8,
    pub entries: [u32; ENTRIES],
}

impl Pdo {
    fn new(default: &PdoDefault, id: u32) -> Self {
        let mut entries = [0; ENTRIES];
        for (entry, default) in entries.iter_mut().zip(default.entries) {
            *entry = *default;
        }
        Self {
            id: if default.valid { id } else { id | INVALID },
            transmission: default.transmission,
            inhibit: default.inhibit,
            timer: default.timer,
            start: 0,
            count: default.entries.len().min(ENTRIES) as u8,
            entries,
        }
    }

    pub fn valid(&self) -> bool {
        self.id & INVALID == 0
    }
}

/// Every value of the communication area that can be stored.
#[derive(Clone, Debug)]
pub(super) struct Parameters {
    pub sync_id: u32,
    pub period: u32,
    pub window: u32,
    pub emergency_id: u32,
    pub emergency_inhibit: u16,
    pub consumers: [u32; CONSUMERS],
    pub heartbeat: u16,
    pub overflow: u8,
    pub behaviour: u8,
    pub receive: [Pdo; PDOS],
    pub transmit: [Pdo; PDOS],
}

/// A value of the stored form.
enum Field<'a> {
    Byte(&'a mut u8),
    Half(&'a mut u16),
    Word(&'a mut u32),
}

impl Parameters {
    /// The defaults of a device as node `id`; as node 0 identifiers lack the node-ID, as in an EDS.
    pub fn new(device: &Device, id: u8) -> Self {
        let id = u32::from(id);
        let [r0, r1, r2, r3] = &device.receive;
        let [t0, t1, t2, t3] = &device.transmit;
        Self {
            sync_id: 0x80,
            period: 0,
            window: 0,
            emergency_id: 0x80 + id,
            emergency_inhibit: 0,
            consumers: [0; CONSUMERS],
            heartbeat: device.heartbeat,
            overflow: 0,
            behaviour: 0,
            receive: [
                Pdo::new(r0, 0x200 + id),
                Pdo::new(r1, 0x300 + id),
                Pdo::new(r2, 0x400 + id),
                Pdo::new(r3, 0x500 + id),
            ],
            transmit: [
                Pdo::new(t0, BIT_30 | (0x180 + id)),
                Pdo::new(t1, BIT_30 | (0x280 + id)),
                Pdo::new(t2, BIT_30 | (0x380 + id)),
                Pdo::new(t3, BIT_30 | (0x480 + id)),
            ],
        }
    }

    /// A value by what it is; `None` for what is no parameter.
    pub fn get(&self, item: Item, pdo: u16, sub: u8) -> Option<u32> {
        let pdo = |direction| self.pdo(direction, pdo);
        Some(match item {
            Item::SyncId => self.sync_id,
            Item::Period => self.period,
            Item::Window => self.window,
            Item::EmergencyId => self.emergency_id,
            Item::EmergencyInhibit => self.emergency_inhibit.into(),
            Item::Watched => *self.consumers.get(usize::from(sub).checked_sub(1)?)?,
            Item::Heartbeat => self.heartbeat.into(),
            Item::Overflow => self.overflow.into(),
            Item::Behaviour => self.behaviour.into(),
            Item::PdoId(direction) => pdo(direction)?.id,
            Item::Transmission(direction) => pdo(direction)?.transmission.into(),
            Item::Inhibit => pdo(Direction::Transmit)?.inhibit.into(),
            Item::Timer(direction) => pdo(direction)?.timer.into(),
            Item::Start => pdo(Direction::Transmit)?.start.into(),
            Item::MapCount(direction) => pdo(direction)?.count.into(),
            Item::MapEntry(direction) => *pdo(direction)?.entries.get(usize::from(sub).checked_sub(1)?)?,
            _ => return None,
        })
    }

    /// The parameters of a PDO, numbered from 0.
    pub fn pdo(&self, direction: Direction, pdo: u16) -> Option<&Pdo> {
        match direction {
            Direction::Receive => self.receive.get(usize::from(pdo)),
            Direction::Transmit => self.transmit.get(usize::from(pdo)),
        }
    }

    /// The same, to be changed.
    pub fn pdo_mut(&mut self, direction: Direction, pdo: u16) -> Option<&mut Pdo> {
        match direction {
            Direction::Receive => self.receive.get_mut(usize::from(pdo)),
            Direction::Transmit => self.transmit.get_mut(usize::from(pdo)),
        }
    }

    fn fields(&mut self, visit: &mut dyn FnMut(Field<'_>)) {
        for word in [&mut self.sync_id, &mut self.period, &mut self.window, &mut self.emergency_id] {
            visit(Field::Word(word));
        }
        visit(Field::Half(&mut self.emergency_inhibit));
        self.consumers.iter_mut().for_each(|word| visit(Field::Word(word)));
        visit(Field::Half(&mut self.heartbeat));
        visit(Field::Byte(&mut self.overflow));
        visit(Field::Byte(&mut self.behaviour));
        for pdo in self.receive.iter_mut().chain(&mut self.transmit) {
            visit(Field::Word(&mut pdo.id));
            visit(Field::Byte(&mut pdo.transmission));
            visit(Field::Half(&mut pdo.inhibit));
            visit(Field::Half(&mut pdo.timer));
            visit(Field::Byte(&mut pdo.start));
            visit(Field::Byte(&mut pdo.count));
            pdo.entries.iter_mut().for_each(|word| visit(Field::Word(word)));
        }
    }

    /// The values in the order of their indices, little-endian, behind a version and the node-ID.
    pub fn image(&self, id: NodeId) -> [u8; IMAGE] {
        let mut image = [0; IMAGE];
        let mut out = image.iter_mut();
        let mut put = |bytes: &[u8]| out.by_ref().zip(bytes).for_each(|(out, byte)| *out = *byte);
        put(&[VERSION, id.get()]);
        self.clone().fields(&mut |field| match field {
            Field::Byte(value) => put(&[*value]),
            Field::Half(value) => put(&value.to_le_bytes()),
            Field::Word(value) => put(&value.to_le_bytes()),
        });
        image
    }

    /// Reads a stored form of the same version, length and node-ID whose values could have been written one by one, as
    /// far as that can be told without the device's objects.
    pub fn load(&self, image: &[u8], id: NodeId) -> Option<Self> {
        let image: &[u8; IMAGE] = image.try_into().ok()?;
        let ([version, node], values) = image.split_first_chunk()?;
        let mut bytes = values.iter().copied();
        let mut next = || bytes.next().unwrap_or(0);
        let mut loaded = self.clone();
        loaded.fields(&mut |field| match field {
            Field::Byte(value) => *value = next(),
            Field::Half(value) => *value = u16::from_le_bytes([next(), next()]),
            Field::Word(value) => *value = u32::from_le_bytes([next(), next(), next(), next()]),
        });
        (*version == VERSION && *node == id.get() && loaded.check().is_ok()).then_some(loaded)
    }

    fn check(&self) -> Result<(), Abort> {
        identifier(self.sync_id)?;
        identifier(self.emergency_id)?;
        overflow(self.overflow.into())?;
        behaviour(self.behaviour.into())?;
        self.consumers.iter().try_for_each(|value| consumer(*value))?;
        for pdo in self.receive.iter().chain(&self.transmit) {
            identifier(pdo.id)?;
            transmission(pdo.transmission.into())?;
            start(pdo.start.into())?;
        }
        Ok(())
    }
}

/// Version of the stored form.
const VERSION: u8 = 1;
/// Length of the stored form, bytes.
pub const IMAGE: usize = 2 + 4 * 4 + 2 + 4 * CONSUMERS + 2 + 1 + 1 + 2 * PDOS * (4 + 1 + 2 + 2 + 1 + 1 + 4 * ENTRIES);

fn permitted(ok: bool) -> Result<(), Abort> {
    if ok { Ok(()) } else { Err(Abort::InvalidValue) }
}

/// Identifiers that nobody may choose (CiA 301 7.3.5, table 41), and 29-bit ones, which this node does not have.
pub(super) fn identifier(value: u32) -> Result<(), Abort> {
    let reserved = matches!(value & 0x7FF, 0..=0x7F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..=0x6FF | 0x701..=0x7FF);
    permitted(value & EXTENDED == 0 && !reserved)
}

/// Transmission types without remote frames (CiA 301 7.5.2.35 and 7.5.2.37).
pub(super) fn transmission(value: u32) -> Result<(), Abort> {
    permitted(matches!(value, 0..=240 | 254 | 255))
}

/// SYNC start value (CiA 301 7.5.2.37).
pub(super) fn start(value: u32) -> Result<(), Abort> {
    permitted(value <= 240)
}

/// Synchronous counter overflow (CiA 301 7.5.2.22).
pub(super) fn overflow(value: u32) -> Result<(), Abort> {
    permitted(matches!(value, 0 | 2..=240))
}

/// Error behaviour: pre-operational, no change, stopped (CiA 301 7.5.2.32).
pub(super) fn behaviour(value: u32) -> Result<(), Abort> {
    permitted(value <= 2)
}

/// Consumer heartbeat time: ms below a node-ID (CiA 301 7.5.2.19).
pub(super) fn consumer(value: u32) -> Result<(), Abort> {
    permitted(value >> 16 <= 127)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_41_is_not_to_be_chosen_from() {
        for range in [0..=0x7F, 0x101..=0x180, 0x581..=0x5FF, 0x601..=0x67F, 0x6E0..=0x6FF, 0x701..=0x7FF] {
            for id in range {
                assert_eq!(identifier(id), Err(Abort::InvalidValue), "{id:#x}");
            }
        }
        for id in [0x80, 0x100, 0x181, 0x580, 0x600, 0x680, 0x6DF, 0x700, 0x181 | INVALID, 0x181 | BIT_30] {
            assert_eq!(identifier(id), Ok(()), "{id:#x}");
        }
        assert_eq!(identifier(1 << 29 | 0x181), Err(Abort::InvalidValue));
        assert_eq!(identifier(1 << 11 | 0x181), Err(Abort::InvalidValue));
    }

    #[test]
    fn transmission_types_that_need_remote_frames_or_are_reserved_are_refused() {
        let allowed: Vec<_> = (0..=256).filter(|value| transmission(*value).is_ok()).collect();
        assert_eq!(allowed.len(), 243);
        assert!((241..=253).all(|value| transmission(value).is_err()));
        assert_eq!([0, 1, 2, 240, 241].map(|v| overflow(v).is_ok()), [true, false, true, true, false]);
    }
}

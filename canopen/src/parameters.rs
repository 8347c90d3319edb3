//! The values of the communication objects that a host can write: defaults, checks that need nothing else, storing.

use super::device::{BIT_30, CONSUMERS, Device, Direction, ENTRIES, INVALID, PDOS, PdoDefault};
use super::objects::{CommunicationObject, Item, STORED, stored, stored_at};
use super::{Abort, Record, Restored};

/// Bit 29 of a COB-ID: 29-bit identifier; bits 28 to 11 belong to it alone.
const EXTENDED: u32 = 0x3FFF_F800;

/// Parameters of one PDO.
#[derive(Clone, Copy, Debug)]
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
    const UNUSED: Self =
        Self { id: 0, transmission: 0, inhibit: 0, timer: 0, start: 0, count: 0, entries: [0; ENTRIES] };

    fn new(default: &PdoDefault, id: u32) -> Self {
        let mut entries = [0; ENTRIES];
        let count = default.entries.len().min(ENTRIES);
        if let (Some(to), Some(from)) = (entries.get_mut(..count), default.entries.get(..count)) {
            to.copy_from_slice(from);
        }
        Self {
            id: if default.valid { id } else { id | INVALID },
            transmission: default.transmission,
            inhibit: default.inhibit,
            timer: default.timer,
            start: 0,
            count: count as u8,
            entries,
        }
    }

    /// The entries that count.
    pub fn mapped(&self) -> Result<&[u32], Abort> {
        self.entries.get(..self.count.into()).ok_or(Abort::PdoLength)
    }

    pub fn valid(&self) -> bool {
        self.id & INVALID == 0
    }
}

/// The PDOs of a direction: the pre-defined connection set spaces their identifiers by 100h.
fn pdos(defaults: &[PdoDefault; PDOS], first: u32) -> [Pdo; PDOS] {
    let mut pdos = [Pdo::UNUSED; PDOS];
    let identifiers = (first..).step_by(0x100);
    for ((pdo, default), id) in pdos.iter_mut().zip(defaults).zip(identifiers) {
        *pdo = Pdo::new(default, id);
    }
    pdos
}

/// Every value of the communication objects that can be stored.
#[derive(Clone, Copy, Debug)]
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

/// A value in its place.
enum Slot<'a> {
    Byte(&'a mut u8),
    Half(&'a mut u16),
    Word(&'a mut u32),
}

impl Parameters {
    /// The defaults of a device as node `id`; as node 0 identifiers lack the node-ID, as in an EDS.
    pub fn new(device: &Device, id: u8) -> Self {
        let id = u32::from(id);
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
            receive: pdos(&device.receive, 0x200 + id),
            transmit: pdos(&device.transmit, BIT_30 | (0x180 + id)),
        }
    }

    fn slot(&mut self, object: CommunicationObject) -> Option<Slot<'_>> {
        let nth = usize::from(object.sub).checked_sub(1);
        Some(match object.item {
            Item::SyncId => Slot::Word(&mut self.sync_id),
            Item::Period => Slot::Word(&mut self.period),
            Item::Window => Slot::Word(&mut self.window),
            Item::EmergencyId => Slot::Word(&mut self.emergency_id),
            Item::EmergencyInhibit => Slot::Half(&mut self.emergency_inhibit),
            Item::Watched => Slot::Word(self.consumers.get_mut(nth?)?),
            Item::Heartbeat => Slot::Half(&mut self.heartbeat),
            Item::Overflow => Slot::Byte(&mut self.overflow),
            Item::Behaviour => Slot::Byte(&mut self.behaviour),
            item => {
                let pdo = self.pdo_mut(item.direction()?, object.pdo)?;
                match item {
                    Item::PdoId(_) => Slot::Word(&mut pdo.id),
                    Item::Transmission(_) => Slot::Byte(&mut pdo.transmission),
                    Item::Inhibit => Slot::Half(&mut pdo.inhibit),
                    Item::Timer(_) => Slot::Half(&mut pdo.timer),
                    Item::Start => Slot::Byte(&mut pdo.start),
                    Item::MapCount(_) => Slot::Byte(&mut pdo.count),
                    _ => Slot::Word(pdo.entries.get_mut(nth?)?),
                }
            }
        })
    }

    /// A value; 0 for what is no parameter.
    pub fn get(&mut self, object: CommunicationObject) -> u32 {
        match self.slot(object) {
            Some(Slot::Byte(value)) => (*value).into(),
            Some(Slot::Half(value)) => (*value).into(),
            Some(Slot::Word(value)) => *value,
            None => 0,
        }
    }

    /// Takes over a value that was object good.
    pub fn set(&mut self, object: CommunicationObject, new: u32) {
        match self.slot(object) {
            Some(Slot::Byte(value)) => *value = new as u8,
            Some(Slot::Half(value)) => *value = new as u16,
            Some(Slot::Word(value)) => *value = new,
            None => {}
        }
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

    /// Visits every value that is stored.
    pub fn store(mut self, visit: &mut dyn FnMut(Record)) {
        stored(&mut |index, object| {
            visit(Record::new(index, object.sub, object.kind, self.get(object)));
        });
    }

    /// Takes stored values that could have been written one by one, as far as that is known without the device's
    /// objects. The rest is in what is returned; `spoiled` says which PDOs, in the order of [`ALL`](super::device::ALL), have
    /// lost a value.
    pub fn load(&mut self, values: &mut dyn Iterator<Item = Record>, spoiled: &mut [bool; 2 * PDOS]) -> Restored {
        let mut restored = Restored::default();
        let mut seen = [false; STORED];
        for record in values {
            let Record { index, sub, .. } = record;
            let Some((nth, object)) = stored_at(index, sub) else {
                restored.skipped.add(index, sub);
                continue;
            };
            let good = |value: &u32| validate(object.item, *value).is_ok() && !self.watches_twice(object, *value);
            match record.value(object.kind).filter(good) {
                Some(value) => self.set(object, value),
                None => {
                    restored.defaulted.add(index, sub);
                    let first = if object.item.direction() == Some(Direction::Transmit) { PDOS } else { 0 };
                    let slot = object.item.direction().and_then(|_| spoiled.get_mut(first + usize::from(object.pdo)));
                    slot.into_iter().for_each(|lost| *lost = true);
                }
            }
            seen.get_mut(nth).into_iter().for_each(|seen| *seen = true);
        }
        let mut seen = seen.iter();
        stored(&mut |index, object| {
            if seen.next() == Some(&false) {
                restored.defaulted.add(index, object.sub);
            }
        });
        restored
    }

    /// Whether a value of 1016h watches a node that another entry watches already (CiA 301 7.5.2.19).
    pub fn watches_twice(&self, object: CommunicationObject, value: u32) -> bool {
        let same = |(sub, other): (u8, &u32)| {
            sub != object.sub && entry(*other).zip(entry(value)).is_some_and(|(a, b)| a.0 == b.0)
        };
        object.item == Item::Watched && (1..).zip(&self.consumers).any(same)
    }
}

/// Node and time, ms, of an entry of 1016h that is in use.
pub(super) fn entry(value: u32) -> Option<(u8, u16)> {
    let (node, time) = ((value >> 16) as u8, value as u16);
    (node != 0 && time != 0).then_some((node, time))
}

/// Whether a value can be, whatever the others are.
pub(super) fn validate(item: Item, value: u32) -> Result<(), Abort> {
    match item {
        // This node does not produce SYNC.
        Item::SyncId if value & BIT_30 != 0 => Err(Abort::InvalidValue),
        Item::SyncId | Item::EmergencyId | Item::PdoId(_) => identifier(value),
        Item::Transmission(_) => transmission(value),
        Item::Start => permitted(value <= 240),
        Item::Overflow => overflow(value),
        // Pre-operational, no change, stopped (CiA 301 7.5.2.32).
        Item::Behaviour => permitted(value <= 2),
        // Node-ID above the time (CiA 301 7.5.2.19).
        Item::Watched => permitted(value >> 16 <= 127),
        Item::MapCount(_) if value as usize > ENTRIES => Err(Abort::PdoLength),
        _ => Ok(()),
    }
}

fn permitted(ok: bool) -> Result<(), Abort> {
    if ok { Ok(()) } else { Err(Abort::InvalidValue) }
}

/// Identifiers that nobody may choose (CiA 301 7.3.5, table 41), and 29-bit ones, which this node does not have.
fn identifier(value: u32) -> Result<(), Abort> {
    let reserved = matches!(value & 0x7FF, 0..=0x7F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..=0x6FF | 0x701..=0x7FF);
    permitted(value & EXTENDED == 0 && !reserved)
}

/// Transmission types without remote frames (CiA 301 7.5.2.35 and 7.5.2.37).
fn transmission(value: u32) -> Result<(), Abort> {
    permitted(matches!(value, 0..=240 | 254 | 255))
}

/// Synchronous counter overflow (CiA 301 7.5.2.22).
fn overflow(value: u32) -> Result<(), Abort> {
    permitted(matches!(value, 0 | 2..=240))
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

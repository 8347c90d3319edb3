//! What a host may write into the communication area, and when.

use super::{Area, Found, Item};
use crate::canopen::emergency::Cause;
use crate::canopen::heartbeat::entry;
use crate::canopen::parameters::{self, BIT_30, INVALID};
use crate::canopen::pdo::{Direction, Map};
use crate::canopen::{Abort, Dictionary, Group, Request};

/// A write that was not refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::canopen) enum Written {
    /// Done.
    Now,
    /// The device is on it; the answer comes through [`Node::answer`](crate::canopen::Node::answer).
    Later,
}

/// "save", first letter first on the bus (CiA 301 7.5.2.13).
const SAVE: u32 = u32::from_le_bytes(*b"save");
/// "load" (CiA 301 7.5.2.14).
const LOAD: u32 = u32::from_le_bytes(*b"load");

fn group(sub: u8) -> Group {
    match sub {
        1 => Group::All,
        2 => Group::Communication,
        _ => Group::Application,
    }
}

impl Area {
    /// Writes a value of the right length.
    ///
    /// # Errors
    /// Nothing has changed.
    pub fn write(&mut self, found: Found, data: &[u8], dictionary: &mut dyn Dictionary) -> Result<Written, Abort> {
        let mut bytes = [0; 4];
        bytes.get_mut(..data.len()).ok_or(Abort::LengthTooHigh)?.copy_from_slice(data);
        let value = u32::from_le_bytes(bytes);
        let Found { item, sub, .. } = found;
        match item {
            Item::Store | Item::Restore => return request(item, sub, value, dictionary),
            Item::PdoId(direction)
            | Item::Transmission(direction)
            | Item::Timer(direction)
            | Item::MapCount(direction)
            | Item::MapEntry(direction) => self.write_pdo(found, direction, value, dictionary)?,
            Item::Inhibit | Item::Start => self.write_pdo(found, Direction::Transmit, value, dictionary)?,
            _ => self.write_service(item, sub, value)?,
        }
        Ok(Written::Now)
    }

    fn write_service(&mut self, item: Item, sub: u8, value: u32) -> Result<(), Abort> {
        let own = &mut self.parameters;
        match item {
            Item::ErrorCount if value == 0 => self.emergency.forget(),
            Item::ErrorCount => return Err(Abort::InvalidValue),
            // This node does not produce SYNC.
            Item::SyncId if value & BIT_30 != 0 => return Err(Abort::InvalidValue),
            Item::SyncId => {
                parameters::identifier(value)?;
                own.sync_id = value;
                self.sync.restart();
            }
            Item::Period => {
                own.period = value;
                self.sync.restart();
                self.emergency.clear(Cause::SyncLost);
            }
            Item::Window => own.window = value,
            Item::EmergencyId => own.emergency_id = exchange(own.emergency_id, value)?,
            Item::EmergencyInhibit => own.emergency_inhibit = value as u16,
            Item::Watched => {
                let at = usize::from(sub.saturating_sub(1));
                parameters::consumer(value)?;
                let twice = |(other, existing): (usize, &u32)| {
                    other != at && entry(*existing).zip(entry(value)).is_some_and(|(a, b)| a.0 == b.0)
                };
                if own.consumers.iter().enumerate().any(twice) {
                    return Err(Abort::Incompatible);
                }
                *own.consumers.get_mut(at).ok_or(Abort::NoSubIndex)? = value;
                self.consumer.restart(at);
                self.emergency.clear(Cause::Heartbeat(at as u8));
            }
            Item::Heartbeat => {
                own.heartbeat = value as u16;
                self.producer.now();
            }
            Item::Overflow => {
                parameters::overflow(value)?;
                // CiA 301 7.5.2.22.
                if own.period != 0 {
                    return Err(Abort::DeviceState);
                }
                own.overflow = value as u8;
                self.emergency.clear(Cause::SyncLength);
            }
            Item::Behaviour => {
                parameters::behaviour(value)?;
                own.behaviour = value as u8;
            }
            _ => return Err(Abort::ReadOnly),
        }
        Ok(())
    }

    fn write_pdo(
        &mut self,
        Found { item, pdo: number, sub, .. }: Found,
        direction: Direction,
        value: u32,
        dictionary: &dyn Dictionary,
    ) -> Result<(), Abort> {
        let pdo = self.parameters.pdo_mut(direction, number).ok_or(Abort::NoObject)?;
        let idle = if pdo.valid() { Err(Abort::DeviceState) } else { Ok(()) };
        let mut map = None;
        match item {
            Item::PdoId(_) => pdo.id = exchange(pdo.id, value)?,
            Item::Transmission(_) => {
                parameters::transmission(value)?;
                pdo.transmission = value as u8;
            }
            Item::Timer(_) => pdo.timer = value as u16,
            Item::Inhibit => {
                idle?;
                pdo.inhibit = value as u16;
            }
            Item::Start => {
                idle?;
                parameters::start(value)?;
                pdo.start = value as u8;
            }
            Item::MapCount(_) => {
                idle?;
                let entries = pdo.entries.get(..value as usize).ok_or(Abort::PdoLength)?;
                map = Some(Map::new(entries, direction, dictionary)?);
                pdo.count = value as u8;
            }
            Item::MapEntry(_) => {
                idle?;
                if pdo.count != 0 {
                    return Err(Abort::DeviceState);
                }
                if value != 0 {
                    Map::accepts(value, direction, dictionary)?;
                }
                *pdo.entries.get_mut(usize::from(sub.saturating_sub(1))).ok_or(Abort::NoSubIndex)? = value;
            }
            _ => return Err(Abort::ReadOnly),
        }
        self.restart_pdo(direction, number, map);
        Ok(())
    }

    /// What was under way by the old parameters of a PDO is not.
    fn restart_pdo(&mut self, direction: Direction, number: u16, map: Option<Map>) {
        let which = usize::from(number);
        let place = match direction {
            Direction::Receive => self.receive.get_mut(which).map(|pdo| {
                pdo.restart();
                &mut pdo.map
            }),
            Direction::Transmit => self.transmit.get_mut(which).map(|pdo| {
                pdo.restart();
                &mut pdo.map
            }),
        };
        if let (Some(place), Some(map)) = (place, map) {
            *place = map;
        }
        if direction == Direction::Receive {
            for cause in [Cause::Short, Cause::Long, Cause::Late] {
                self.emergency.clear(cause(number as u8));
            }
        }
    }
}

/// A COB-ID for another: an identifier in use may only be put out of use (CiA 301 7.5.2.17, 7.5.2.35).
fn exchange(old: u32, new: u32) -> Result<u32, Abort> {
    parameters::identifier(new)?;
    let in_use = (old | new) & INVALID == 0;
    if in_use && (old ^ new) & 0x7FF != 0 { Err(Abort::DeviceState) } else { Ok(new) }
}

fn request(item: Item, sub: u8, value: u32, dictionary: &mut dyn Dictionary) -> Result<Written, Abort> {
    let request = match (item, value) {
        (Item::Store, SAVE) => Request::Store(group(sub)),
        (Item::Restore, LOAD) => Request::Restore(group(sub)),
        _ => return Err(Abort::NotStored),
    };
    dictionary.request(request)?;
    Ok(Written::Later)
}

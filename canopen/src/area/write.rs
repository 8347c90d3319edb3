//! What a host may write into the communication area, and when.

use super::{Area, Found, Item};
use crate::emergency::Cause;
use crate::heartbeat::entry;
use crate::parameters::{INVALID, Pdo, validate};
use crate::pdo::{Direction, Map};
use crate::rolled::rolled;
use crate::{Abort, Dictionary, Group, Request};

/// A write that was not refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Written {
    /// Done.
    Now,
    /// The device is on it; the answer comes through [`Node::answer`](crate::Node::answer).
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
    #[inline(never)]
    pub fn write(&mut self, found: Found, data: &[u8], dictionary: &mut dyn Dictionary) -> Result<Written, Abort> {
        let mut bytes = [0; 4];
        bytes.get_mut(..data.len()).ok_or(Abort::LengthTooHigh)?.copy_from_slice(data);
        let value = u32::from_le_bytes(bytes);
        match found.item {
            Item::Store | Item::Restore => return request(found, value, dictionary),
            Item::ErrorCount if value == 0 => self.emergency.forget(),
            Item::ErrorCount => return Err(Abort::InvalidValue),
            item => {
                validate(item, value)?;
                self.permit(found, value, dictionary)?;
                self.parameters.set(found, value);
                self.changed(found);
            }
        }
        Ok(Written::Now)
    }

    /// Whether a value can be together with the others, now. A mapping is resolved when it is.
    #[inline(never)]
    fn permit(&mut self, found: Found, value: u32, dictionary: &dyn Dictionary) -> Result<(), Abort> {
        let old = self.parameters.get(found);
        let own = &mut self.parameters;
        let (item, number) = (found.item, found.pdo);
        let pdo = item.direction().and_then(|direction| Some((direction, own.pdo(direction, number)?)));
        match (item, pdo) {
            // An identifier in use may only be put out of use (CiA 301 7.5.2.17, 7.5.2.35).
            (Item::EmergencyId | Item::PdoId(_), _) if (old | value) & INVALID == 0 && (old ^ value) & 0x7FF != 0 => {
                Err(Abort::DeviceState)
            }
            // CiA 301 7.5.2.22.
            (Item::Overflow, _) if own.period != 0 => Err(Abort::DeviceState),
            (Item::Watched, _) => {
                let twice = |(sub, other): (u8, &u32)| {
                    sub != found.sub && entry(*other).zip(entry(value)).is_some_and(|(a, b)| a.0 == b.0)
                };
                if (1..).zip(rolled(&own.consumers)).any(twice) { Err(Abort::Incompatible) } else { Ok(()) }
            }
            (Item::Inhibit | Item::Start | Item::MapCount(_) | Item::MapEntry(_), Some((_, pdo))) if pdo.valid() => {
                Err(Abort::DeviceState)
            }
            (Item::MapEntry(_), Some((_, pdo))) if pdo.count != 0 => Err(Abort::DeviceState),
            (Item::MapEntry(_), Some((direction, _))) if value != 0 => Map::accepts(value, direction, dictionary),
            (Item::MapCount(_), Some((direction, pdo))) => {
                let pdo = Pdo { count: value as u8, ..*pdo };
                let map = self.map(direction, number).ok_or(Abort::NoObject)?;
                map.resolve(pdo.mapped()?, direction, dictionary)
            }
            _ => Ok(()),
        }
    }

    /// What was under way by an old parameter is not.
    #[inline(never)]
    fn changed(&mut self, found: Found) {
        let which = usize::from(found.pdo);
        match (found.item, found.item.direction()) {
            (Item::SyncId | Item::Period, _) => {
                self.sync.restart();
                self.emergency.clear(Cause::SyncLost);
            }
            (Item::Watched, _) => {
                let at = found.sub.saturating_sub(1);
                self.consumer.restart(at.into());
                self.emergency.clear(Cause::Heartbeat(at));
            }
            (Item::Heartbeat, _) => self.producer.now(),
            (Item::Overflow, _) => self.emergency.clear(Cause::SyncLength),
            (_, Some(Direction::Transmit)) => {
                self.transmit.get_mut(which).into_iter().for_each(|pdo| pdo.restart());
            }
            (_, Some(Direction::Receive)) => {
                self.receive.get_mut(which).into_iter().for_each(|pdo| pdo.restart());
                for cause in [Cause::Short, Cause::Long, Cause::Late] {
                    self.emergency.clear(cause(found.pdo as u8));
                }
            }
            _ => {}
        }
    }
}

#[inline(never)]
fn request(found: Found, value: u32, dictionary: &mut dyn Dictionary) -> Result<Written, Abort> {
    let request = match (found.item, value) {
        (Item::Store, SAVE) => Request::Store(group(found.sub)),
        (Item::Restore, LOAD) => Request::Restore(group(found.sub)),
        _ => return Err(Abort::NotStored),
    };
    dictionary.request(request)?;
    Ok(Written::Later)
}

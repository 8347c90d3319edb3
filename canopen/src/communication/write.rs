//! What a host may write into the communication objects, and when.

use super::CommunicationObjects;
use crate::device::{Direction, INVALID};
use crate::emergency::Cause;
use crate::objects::{CommunicationObject, Item};
use crate::parameters::{Pdo, validate};
use crate::pdo::Map;
use crate::{Abort, Dictionary, Group, Request, Update, Written};

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

impl CommunicationObjects {
    /// Writes a value of the right length.
    ///
    /// # Errors
    /// Nothing has changed.
    pub fn write(
        &mut self,
        object: CommunicationObject,
        data: &[u8],
        dictionary: &mut dyn Dictionary,
    ) -> Result<Written, Abort> {
        let mut bytes = [0; 4];
        bytes.get_mut(..data.len()).ok_or(Abort::LengthTooHigh)?.copy_from_slice(data);
        let value = u32::from_le_bytes(bytes);
        match object.item {
            Item::Store | Item::Restore | Item::Control => return request(object, value, dictionary),
            // Only a transfer in pieces has one.
            Item::Program => return Err(Abort::LengthTooLow),
            Item::ErrorCount if value == 0 => self.emergency.forget(),
            Item::ErrorCount => return Err(Abort::InvalidValue),
            item => {
                validate(item, value)?;
                self.permit(object, value, dictionary)?;
                self.parameters.set(object, value);
                self.changed(object);
            }
        }
        Ok(Written::Now)
    }

    /// Whether a value can be together with the others, now. A mapping is resolved when it is.
    fn permit(&mut self, object: CommunicationObject, value: u32, dictionary: &dyn Dictionary) -> Result<(), Abort> {
        let old = self.parameters.get(object);
        let own = &mut self.parameters;
        let (item, number) = (object.item, object.pdo);
        let pdo = item.direction().and_then(|direction| Some((direction, own.pdo(direction, number)?)));
        match (item, pdo) {
            // An identifier in use may only be put out of use (CiA 301 7.5.2.17, 7.5.2.35).
            (Item::EmergencyId | Item::PdoId(_), _) if (old | value) & INVALID == 0 && (old ^ value) & 0x7FF != 0 => {
                Err(Abort::DeviceState)
            }
            // CiA 301 7.5.2.22.
            (Item::Overflow, _) if own.period != 0 => Err(Abort::DeviceState),
            (Item::Watched, _) if own.watches_twice(object, value) => Err(Abort::Incompatible),
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
    fn changed(&mut self, object: CommunicationObject) {
        let which = usize::from(object.pdo);
        match (object.item, object.item.direction()) {
            (Item::SyncId | Item::Period, _) => {
                self.sync.restart();
                self.emergency.clear(Cause::SyncLost);
            }
            (Item::Watched, _) => {
                let at = object.sub.saturating_sub(1);
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
                    self.emergency.clear(cause(object.pdo as u8));
                }
            }
            _ => {}
        }
    }
}

fn request(object: CommunicationObject, value: u32, dictionary: &mut dyn Dictionary) -> Result<Written, Abort> {
    let request = match (object.item, value) {
        (Item::Store, SAVE) => Request::Store(group(object.sub)),
        (Item::Restore, LOAD) => Request::Restore(group(object.sub)),
        (Item::Control, 0) => Request::Update(Update::Stop),
        (Item::Control, 1) => Request::Update(Update::Start),
        (Item::Control, 3) => Request::Update(Update::Clear),
        (Item::Control, _) => return Err(Abort::InvalidValue),
        _ => return Err(Abort::NotStored),
    };
    dictionary.request(request)?;
    Ok(Written::Requested)
}

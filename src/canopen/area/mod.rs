//! The communication area, 1000h to 1FFFh: the node's own objects, and the state behind them.

mod objects;
mod write;

pub use objects::descriptions;
pub(super) use objects::{Found, Item, find};
pub(super) use write::Written;

use super::device::{Device, PDOS};
use super::emergency::Emergency;
use super::heartbeat::{Consumer, Producer};
use super::outbox::Outbox;
use super::parameters::{Parameters, Pdo};
use super::pdo::{Direction, Map, Receive, Transmit};
use super::sync::Sync;
use super::{Abort, Dictionary, NmtState, NodeId};

/// Everything of a node but its SDO server.
#[derive(Clone, Debug)]
pub(super) struct Area {
    pub device: &'static Device,
    pub serial: u32,
    pub id: NodeId,
    pub state: NmtState,
    pub parameters: Parameters,
    pub emergency: Emergency,
    pub producer: Producer,
    pub consumer: Consumer,
    pub sync: Sync,
    pub receive: [Receive; PDOS],
    pub transmit: [Transmit; PDOS],
    pub out: Outbox,
}

impl Area {
    pub fn new(device: &'static Device, id: NodeId, serial: u32) -> Self {
        Self {
            device,
            serial,
            id,
            state: NmtState::Initialising,
            parameters: Parameters::new(device, id.get()),
            emergency: Emergency::default(),
            producer: Producer::default(),
            consumer: Consumer::default(),
            sync: Sync::default(),
            receive: Default::default(),
            transmit: Default::default(),
            out: Outbox::default(),
        }
    }

    /// Takes parameters over, with what they map.
    ///
    /// # Errors
    /// A mapping that the dictionary does not have; nothing has changed.
    pub fn adopt(&mut self, parameters: Parameters, dictionary: &dyn Dictionary) -> Result<(), Abort> {
        let map = |pdo: &Pdo, direction| {
            Map::new(pdo.entries.get(..pdo.count.into()).ok_or(Abort::PdoLength)?, direction, dictionary)
        };
        let mut receive: [Receive; PDOS] = Default::default();
        for (pdo, parameters) in receive.iter_mut().zip(&parameters.receive) {
            pdo.map = map(parameters, Direction::Receive)?;
        }
        let mut transmit: [Transmit; PDOS] = Default::default();
        for (pdo, parameters) in transmit.iter_mut().zip(&parameters.transmit) {
            pdo.map = map(parameters, Direction::Transmit)?;
        }
        (self.parameters, self.receive, self.transmit) = (parameters, receive, transmit);
        Ok(())
    }

    /// Copies a value to the front of `out` and returns its length, bytes.
    ///
    /// # Errors
    /// [`Abort::NoData`] for an error that has not happened.
    pub fn read(&self, found: Found, out: &mut [u8]) -> Result<usize, Abort> {
        let Found { item, kind, pdo, sub, .. } = found;
        let text = match item {
            Item::Name => self.device.name,
            Item::Hardware => self.device.hardware,
            Item::Software => self.device.software,
            _ => "",
        };
        let number = match item {
            Item::Fixed(value) => value.into(),
            Item::DeviceType => self.device.device_type,
            Item::ErrorRegister => self.emergency.register().into(),
            Item::ErrorCount => self.emergency.remembered().into(),
            Item::PastError => self.emergency.past(sub).ok_or(Abort::NoData)?,
            // Stores on command, not by itself.
            Item::Store | Item::Restore => 1,
            Item::Vendor => self.device.vendor,
            Item::Product => self.device.product,
            Item::Revision => self.device.revision,
            Item::Serial => self.serial,
            Item::Service(base) => self.id.cob(base).into(),
            _ => self.parameters.get(item, pdo, sub).unwrap_or(0),
        };
        let number = number.to_le_bytes();
        let value = kind.size().map_or(Some(text.as_bytes()), |size| number.get(..size)).ok_or(Abort::General)?;
        out.get_mut(..value.len()).ok_or(Abort::OutOfMemory)?.copy_from_slice(value);
        Ok(value.len())
    }
}

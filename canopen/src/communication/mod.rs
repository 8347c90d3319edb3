//! The communication objects, 1000h to 1FFFh: the node's own objects, and the state behind them.

mod own;
mod write;

pub use own::{DefaultValue, OwnObject, own_objects};

use super::device::{ALL, Device, Direction, PDOS};
use super::emergency::Emergency;
use super::heartbeat::{Consumer, Producer};
use super::objects::{CommunicationObject, Item};
use super::outbox::Outbox;
use super::parameters::Parameters;
use super::pdo::{Map, Receive, Transmit};
use super::sync::Sync;
use super::{Abort, Dictionary, NmtState, NodeId};

/// Everything of a node but its SDO server.
#[derive(Clone, Debug)]
pub(super) struct CommunicationObjects {
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
    /// 1F56h:1 and 1F57h:1.
    pub program: u32,
    pub flash: u32,
}

fn resolve(
    parameters: &Parameters,
    direction: Direction,
    number: u16,
    dictionary: &dyn Dictionary,
    map: &mut Map,
) -> Result<(), Abort> {
    let pdo = parameters.pdo(direction, number).ok_or(Abort::NoObject)?;
    map.resolve(pdo.mapped()?, direction, dictionary)
}

/// Copies the first bytes of a value.
fn copy(value: &[u8], length: usize, out: &mut [u8]) -> Result<usize, Abort> {
    let (Some(from), Some(to)) = (value.get(..length), out.get_mut(..length)) else { return Err(Abort::OutOfMemory) };
    to.copy_from_slice(from);
    Ok(length)
}

impl CommunicationObjects {
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
            program: 0,
            flash: 0,
        }
    }

    /// Whether the mapping of a PDO, as parameters have it, is in the dictionary.
    pub fn maps(&self, parameters: &Parameters, direction: Direction, pdo: u16, dictionary: &dyn Dictionary) -> bool {
        resolve(parameters, direction, pdo, dictionary, &mut Map::default()).is_ok()
    }

    /// Takes parameters over, with what they map.
    ///
    /// # Errors
    /// A mapping that the dictionary does not have; nothing has changed.
    pub fn adopt(&mut self, parameters: &Parameters, dictionary: &dyn Dictionary) -> Result<(), Abort> {
        let mut scratch = Map::default();
        for (direction, number) in &ALL {
            resolve(parameters, *direction, *number, dictionary, &mut scratch)?;
        }
        for (direction, number) in &ALL {
            if let Some(map) = self.map(*direction, *number) {
                resolve(parameters, *direction, *number, dictionary, map)?;
            }
        }
        self.parameters = *parameters;
        Ok(())
    }

    /// The resolved mapping of a PDO.
    pub fn map(&mut self, direction: Direction, number: u16) -> Option<&mut Map> {
        let number = usize::from(number);
        match direction {
            Direction::Receive => self.receive.get_mut(number).map(|pdo| &mut pdo.map),
            Direction::Transmit => self.transmit.get_mut(number).map(|pdo| &mut pdo.map),
        }
    }

    /// Reset: what was under way is not. Errors of the device remain; parameters wait for [`adopt`](Self::adopt).
    pub fn restart(&mut self) {
        self.state = NmtState::Initialising;
        self.emergency.restart();
        self.producer = Producer::default();
        self.consumer = Consumer::default();
        self.out.clear();
        self.restart_process_data();
    }

    /// What SYNC and PDOs have brought is forgotten.
    pub fn restart_process_data(&mut self) {
        self.sync.restart();
        self.receive.iter_mut().for_each(|pdo| pdo.restart());
        self.transmit.iter_mut().for_each(|pdo| pdo.restart());
    }

    /// Copies a value to the front of `out` and returns its length, bytes.
    ///
    /// # Errors
    /// [`Abort::NoData`] for an error that has not happened.
    pub fn read(&mut self, object: CommunicationObject, out: &mut [u8]) -> Result<usize, Abort> {
        let CommunicationObject { item, kind, sub, .. } = object;
        let text = match item {
            Item::Name => Some(self.device.name),
            Item::Hardware => Some(self.device.hardware),
            Item::Software => Some(self.device.software),
            _ => None,
        };
        if let Some(text) = text {
            return copy(text.as_bytes(), text.len(), out);
        }
        let number = match item {
            Item::Fixed(value) => value.into(),
            Item::DeviceType => self.device.device_type,
            Item::ErrorRegister => self.emergency.register().into(),
            Item::ErrorCount => self.emergency.remembered().into(),
            Item::PastError => self.emergency.past(sub).ok_or(Abort::NoData)?,
            // Stores on command, not by itself.
            Item::Store | Item::Restore => 1,
            // The program runs, also while another is staged.
            Item::Control => 1,
            Item::ProgramId => self.program,
            Item::FlashStatus => self.flash,
            Item::Vendor => self.device.vendor,
            Item::Product => self.device.product,
            Item::Revision => self.device.revision,
            Item::Serial => self.serial,
            Item::Service(base) => self.id.cob(base).into(),
            _ => self.parameters.get(object),
        };
        copy(&number.to_le_bytes(), kind.size().unwrap_or(0), out)
    }
}

//! The communication objects as description files list them: address, type, access and default.

use crate::device::Device;
use crate::objects::{CommunicationObject, Item, TABLE};
use crate::parameters::Parameters;
use crate::{Access, DataType, Mapping};

/// A default value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DefaultValue {
    /// A whole number.
    Number(i64),
    /// The node-ID and this.
    NodeId(u32),
    /// A float.
    Real(f32),
    /// A text.
    Text(&'static str),
    /// None that is known beforehand.
    Unknown,
}

/// One of the node's own values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnObject {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
    /// Type of the value.
    pub kind: DataType,
    /// What a host may do with it.
    pub access: Access,
    /// Which PDOs may carry it.
    pub mapping: Mapping,
    /// Its default.
    pub default: DefaultValue,
    /// Whether 1010h stores it.
    pub stored: bool,
}

/// Every value of the communication objects of a device, by rising index and sub-index.
pub fn own_objects(device: &Device) -> impl Iterator<Item = OwnObject> + '_ {
    // Node 0: identifiers lack the node-ID.
    let defaults = Parameters::new(device, 0);
    (0x1000..0x2000).flat_map(move |index| {
        let rows = TABLE.iter().filter(move |row| row.has(index));
        rows.flat_map(|row| (0..row.sub.1).map(move |nth| (row, row.sub.0.wrapping_add(nth)))).map(move |(row, sub)| {
            let pdo = index.wrapping_sub(row.index.0);
            let object = CommunicationObject { item: row.item, kind: row.kind, access: row.access, pdo, sub };
            OwnObject {
                index,
                sub,
                kind: row.kind,
                access: row.access,
                mapping: if row.item == Item::ErrorRegister { Mapping::Transmit } else { Mapping::No },
                default: default(device, defaults, object),
                stored: row.is_stored(),
            }
        })
    })
}

fn default(device: &Device, mut defaults: Parameters, object: CommunicationObject) -> DefaultValue {
    let number = |value: u32| DefaultValue::Number(value.into());
    match object.item {
        Item::Name => DefaultValue::Text(device.name),
        Item::Hardware => DefaultValue::Text(device.hardware),
        Item::Software => DefaultValue::Text(device.software),
        Item::DeviceType => number(device.device_type),
        Item::Vendor => number(device.vendor),
        Item::Product => number(device.product),
        Item::Revision => number(device.revision),
        Item::Serial | Item::PastError | Item::Program | Item::ProgramId => DefaultValue::Unknown,
        Item::Service(base) => DefaultValue::NodeId(base.into()),
        Item::EmergencyId => DefaultValue::NodeId(defaults.emergency_id),
        Item::PdoId(_) => DefaultValue::NodeId(defaults.get(object)),
        Item::Fixed(value) => number(value.into()),
        Item::ErrorRegister | Item::ErrorCount | Item::FlashStatus => number(0),
        Item::Store | Item::Restore | Item::Control => number(1),
        _ => number(defaults.get(object)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Abort;
    use crate::objects::find;
    use crate::tests::DEVICE;
    use std::collections::BTreeSet;

    #[test]
    fn each_address_is_listed_once_and_found_as_listed() {
        let all: Vec<_> = own_objects(&DEVICE).collect();
        let addresses: BTreeSet<_> = all.iter().map(|d| (d.index, d.sub)).collect();
        assert_eq!(addresses.len(), all.len());
        assert!(all.iter().map(|d| (d.index, d.sub)).is_sorted());
        for index in 0x1000..0x2000 {
            for sub in 0..=255 {
                let listed = all.iter().find(|d| (d.index, d.sub) == (index, sub));
                let object = find(index, sub).ok();
                assert_eq!(listed.map(|d| (d.kind, d.access)), object.map(|f| (f.kind, f.access)));
            }
        }
        assert_eq!(find(0x1404, 0), Err(Abort::NoObject));
        assert_eq!(find(0x1400, 3), Err(Abort::NoSubIndex));
    }

    #[test]
    fn identifiers_follow_the_pre_defined_connection_set() {
        let default = |index, sub| own_objects(&DEVICE).find(|d| (d.index, d.sub) == (index, sub)).unwrap().default;
        assert_eq!(default(0x1400, 1), DefaultValue::NodeId(0x200));
        assert_eq!(default(0x1403, 1), DefaultValue::NodeId(0x8000_0500));
        assert_eq!(default(0x1800, 1), DefaultValue::NodeId(0x4000_0180));
        assert_eq!(default(0x1014, 0), DefaultValue::NodeId(0x80));
        assert_eq!(default(0x1005, 0), DefaultValue::Number(0x80));
    }
}

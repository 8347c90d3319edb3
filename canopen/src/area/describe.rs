//! The communication area as description files have it.

use super::objects::{Found, Item, TABLE};
use crate::device::Device;
use crate::parameters::Parameters;
use crate::{DefaultValue, Description, Mapping};

/// Every value of the communication area of a device, by rising index and sub-index, with its default.
pub fn descriptions(device: &Device) -> impl Iterator<Item = Description> + '_ {
    // Node 0: identifiers lack the node-ID.
    let defaults = Parameters::new(device, 0);
    (0x1000..0x2000).flat_map(move |index| {
        let rows = TABLE.iter().filter(move |row| row.has(index));
        rows.flat_map(|row| (0..row.sub.1).map(move |nth| (row, row.sub.0.wrapping_add(nth)))).map(move |(row, sub)| {
            let (object, name) = row.names.get();
            let pdo = index.wrapping_sub(row.index.0);
            let found = Found { item: row.item, kind: row.kind, access: row.access, pdo, sub };
            Description {
                index,
                sub,
                shape: row.shape,
                object,
                name,
                kind: row.kind,
                access: row.access,
                mapping: if row.item == Item::ErrorRegister { Mapping::Transmit } else { Mapping::No },
                default: default(device, defaults, found),
            }
        })
    })
}

fn default(device: &Device, mut defaults: Parameters, found: Found) -> DefaultValue {
    let number = |value: u32| DefaultValue::Number(value.into());
    match found.item {
        Item::Name => DefaultValue::Text(device.name),
        Item::Hardware => DefaultValue::Text(device.hardware),
        Item::Software => DefaultValue::Text(device.software),
        Item::DeviceType => number(device.device_type),
        Item::Vendor => number(device.vendor),
        Item::Product => number(device.product),
        Item::Revision => number(device.revision),
        Item::Serial | Item::PastError => DefaultValue::Unknown,
        Item::Service(base) => DefaultValue::NodeId(base.into()),
        Item::EmergencyId => DefaultValue::NodeId(defaults.emergency_id),
        Item::PdoId(_) => DefaultValue::NodeId(defaults.get(found)),
        Item::Fixed(value) => number(value.into()),
        Item::ErrorRegister | Item::ErrorCount => number(0),
        Item::Store | Item::Restore => number(1),
        _ => number(defaults.get(found)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::objects::find;
    use super::*;
    use crate::Abort;
    use crate::tests::DEVICE;
    use std::collections::BTreeSet;

    #[test]
    fn each_address_is_described_once_and_found_as_described() {
        let all: Vec<_> = descriptions(&DEVICE).collect();
        let addresses: BTreeSet<_> = all.iter().map(|d| (d.index, d.sub)).collect();
        assert_eq!(addresses.len(), all.len());
        assert!(all.iter().map(|d| (d.index, d.sub)).is_sorted());
        for index in 0x1000..0x2000 {
            for sub in 0..=255 {
                let described = all.iter().find(|d| (d.index, d.sub) == (index, sub));
                let found = find(index, sub).ok();
                assert_eq!(described.map(|d| (d.kind, d.access)), found.map(|f| (f.kind, f.access)));
            }
        }
        assert_eq!(find(0x1404, 0), Err(Abort::NoObject));
        assert_eq!(find(0x1400, 3), Err(Abort::NoSubIndex));
    }

    #[test]
    fn the_highest_sub_index_is_the_highest() {
        for object in descriptions(&DEVICE).filter(|d| d.name == "Highest sub-index supported") {
            let highest = descriptions(&DEVICE).filter(|d| d.index == object.index).map(|d| d.sub).max().unwrap();
            assert_eq!(object.default, DefaultValue::Number(highest.into()), "{:x}", object.index);
        }
    }

    #[test]
    fn identifiers_follow_the_pre_defined_connection_set() {
        let default = |index, sub| descriptions(&DEVICE).find(|d| (d.index, d.sub) == (index, sub)).unwrap().default;
        assert_eq!(default(0x1400, 1), DefaultValue::NodeId(0x200));
        assert_eq!(default(0x1403, 1), DefaultValue::NodeId(0x8000_0500));
        assert_eq!(default(0x1800, 1), DefaultValue::NodeId(0x4000_0180));
        assert_eq!(default(0x1014, 0), DefaultValue::NodeId(0x80));
        assert_eq!(default(0x1005, 0), DefaultValue::Number(0x80));
    }
}

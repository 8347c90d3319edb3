//! Settings as objects: each group of src/settings/table.rs is a record, at the index and sub-indices that stand there.

use crate::canopen::{Access, DataType};
use crate::settings::{Declared, Field, Kind, Settings, place};

/// Lowest index of a group.
pub const FIRST: u16 = 0x2100;
/// Highest index of a group: where manufacturer-specific objects end (CiA 301 7.4.1).
pub(super) const LAST: u16 = 0x5FFF;

const FIELDS: &[Field] = Settings::FIELDS;
const KEYS: &[&str] = Settings::KEYS;
/// Commissioning alone says that it has passed.
const PASSED: u16 = place(KEYS, "commission.passed") as u16;

/// Index and sub-index of each setting, by its place.
const ADDRESSES: &[(u16, u8)] = Settings::ADDRESSES;
const COUNT: usize = ADDRESSES.len();

/// Places of the settings by rising address.
static ORDER: [u16; COUNT] = {
    let mut order = [0; COUNT];
    let mut place = 0;
    while place < COUNT {
        let mut at = place;
        while at > 0 && precedes(ADDRESSES[place], ADDRESSES[order[at - 1] as usize]) {
            order[at] = order[at - 1];
            at -= 1;
        }
        order[at] = place as u16;
        place += 1;
    }
    order
};

const fn precedes(a: (u16, u8), b: (u16, u8)) -> bool {
    a.0 < b.0 || a.0 == b.0 && a.1 < b.1
}

// That no address is there twice is checked by the declaration.
const _: () = {
    let mut at = 0;
    while at < COUNT {
        let (index, sub) = ADDRESSES[at];
        assert!(FIRST <= index && index <= LAST, "settings are objects from 2100h to 5FFFh");
        assert!(1 <= sub && sub <= 254, "a setting has a sub-index from 1 to 254");
        let mut before = 0;
        while before < at {
            assert!(
                ADDRESSES[before].0 != index || same_group(KEYS[before], KEYS[at]),
                "settings of one index have keys of one group"
            );
            before += 1;
        }
        at += 1;
    }
};

/// Whether two keys have the same prefix.
const fn same_group(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut at = 0;
    while at < a.len() && at < b.len() {
        if a[at] != b[at] {
            return false;
        }
        if a[at] == b'.' {
            return true;
        }
        at += 1;
    }
    false
}

/// The place of the setting at an address.
pub fn setting_at(index: u16, sub: u8) -> Option<u16> {
    let at = ORDER.binary_search_by_key(&Some((index, sub)), |place| address_at((*place).into())).ok()?;
    ORDER.get(at).copied()
}

/// The highest sub-index of a group of settings.
pub(super) fn highest(index: u16) -> Option<u8> {
    let of_group = |place: &u16| address_at((*place).into()).filter(|address| address.0 == index);
    ORDER.iter().rev().find_map(of_group).map(|(_, sub)| sub)
}

/// Type and access of a setting.
pub fn kind(field: u16) -> Option<(DataType, Access)> {
    let kind = match FIELDS.get(usize::from(field))?.kind {
        Kind::Number { .. } => DataType::Real32,
        Kind::Integer { .. } => DataType::Unsigned32,
        Kind::Flag => DataType::Boolean,
        Kind::Choice(_) => DataType::Unsigned8,
    };
    let access = if field == PASSED { Access::ReadOnly } else { Access::ReadWrite };
    Some((kind, access))
}

/// Index and sub-index of the setting at a place.
pub fn address_at(place: usize) -> Option<(u16, u8)> {
    ADDRESSES.get(place).copied()
}

/// Index and sub-index of the setting called `key`.
pub fn address(key: &str) -> Option<(u16, u8)> {
    address_at(FIELDS.iter().position(|field| field.key == key)?)
}

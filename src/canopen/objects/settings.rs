//! Settings as objects: each group of src/settings/table.rs is a record, its settings the sub-indices from 1 on.

use crate::canopen::{Access, DataType};
use crate::settings::{Declared, Field, Kind, Settings, place};

/// Index of the first group.
pub const FIRST: u16 = 0x2100;

const FIELDS: &[Field] = Settings::FIELDS;
const KEYS: &[&str] = Settings::KEYS;
/// The guided check alone says that it has passed.
const PASSED: u16 = place(KEYS, "commission.passed") as u16;

/// Settings with the same prefix.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group {
    /// Its place among the groups.
    pub number: u16,
    /// Place of its first setting among the settings.
    first: u16,
    /// Settings in it.
    pub count: u8,
}

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

/// Whether a group begins at a setting.
const fn begins(at: usize) -> bool {
    at == 0 || !same_group(KEYS[at - 1], KEYS[at])
}

const NUMBER: usize = {
    let (mut number, mut at) = (0, 0);
    while at < FIELDS.len() {
        number += begins(at) as usize;
        at += 1;
    }
    number
};

/// The groups in their order.
pub(super) static GROUPS: [Group; NUMBER] = {
    let mut groups = [Group { number: 0, first: 0, count: 0 }; NUMBER];
    let (mut next, mut at) = (0, 0);
    while at < FIELDS.len() {
        if begins(at) {
            groups[next] = Group { number: next as u16, first: at as u16, count: 0 };
            next += 1;
        }
        groups[next - 1].count += 1;
        at += 1;
    }
    groups
};

impl Group {
    /// The place among the settings of what is at a sub-index from 1 on.
    pub fn field(&self, sub: u8) -> Option<u16> {
        let nth = sub.checked_sub(1)?;
        (nth < self.count).then_some(self.first.wrapping_add(nth.into()))
    }
}

/// The group at an index.
pub(super) fn group(index: u16) -> Option<&'static Group> {
    GROUPS.get(usize::from(index.checked_sub(FIRST)?))
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
    let at = place as u16;
    let group = GROUPS.iter().rev().find(|group| group.first <= at)?;
    let sub = at.wrapping_sub(group.first).wrapping_add(1);
    Some((FIRST.wrapping_add(group.number), sub as u8))
}

/// Index and sub-index of the setting called `key`.
pub fn address(key: &str) -> Option<(u16, u8)> {
    address_at(FIELDS.iter().position(|field| field.key == key)?)
}

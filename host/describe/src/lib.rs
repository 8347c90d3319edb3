//! Every object of the head in words, and its description files: the EDS for masters ([`eds`]) and the DBC for loggers
//! ([`dbc`]). It serves hosts of any vendor, the desk, and the object pages in docs/.
//!
//! An object is declared where it is served, by address, type, access, range and default: those of the node in
//! canopen/src/area/objects.rs, those of the drive in src/canopen/objects, settings in src/settings/table.rs. What the chip
//! does not need is here: names and remarks of the node's objects and error codes in `node.rs`, and the structure of
//! CiA 306-1. Drive and settings have their texts in their declarations, which are compiled on a PC only.

pub mod dbc;
mod drive;
pub mod eds;
mod node;

pub use node::errors;

use edm_canopen::{Access, DataType, DefaultValue, Mapping};

/// Kind of object (CiA 301 7.4.3, table 42). The number is `ObjectType=` of an EDS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Shape {
    /// One value, at sub-index 0.
    Variable = 7,
    /// Values of one type from sub-index 1 on.
    Array = 8,
    /// Values of several types from sub-index 1 on.
    Record = 9,
}

/// One value of the dictionary with all that is said of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Declaration {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
    /// What the object is.
    pub shape: Shape,
    /// Name of the object: the same for all its values, and for all PDOs of a direction.
    pub object: &'static str,
    /// Name of this value: the object's own for a variable, the same for values that differ in their sub-index.
    pub name: &'static str,
    /// Type of the value.
    pub kind: DataType,
    /// What a host may do with it.
    pub access: Access,
    /// Which PDOs may carry it.
    pub mapping: Mapping,
    /// Its default.
    pub default: DefaultValue,
    /// Unit; empty for none.
    pub unit: &'static str,
    /// Smallest and largest value of a number; `None` for text, domain and flags, and for objects of the node.
    pub range: Option<(f64, f64)>,
    /// What it does, where the name does not say it.
    pub doc: &'static str,
    /// Names of a choice, from 0.
    pub choices: &'static [&'static str],
    /// Stored by 1010h.
    pub stored: bool,
}

/// Name of the number of values of an object.
const HIGHEST: &str = "Highest sub-index supported";

/// Every object, the node's first, by rising index and sub-index.
pub fn everything() -> impl Iterator<Item = Declaration> {
    node::declarations().chain(drive::declarations())
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_servo_head::canopen::objects::entry;

    #[test]
    fn each_address_is_there_once_by_rising_address() {
        let addresses: Vec<_> = everything().map(|d| (d.index, d.sub)).collect();
        assert!(addresses.windows(2).all(|pair| pair[0] < pair[1]), "{addresses:x?}");
    }

    #[test]
    fn every_object_has_a_name() {
        for d in everything() {
            assert!(!d.object.is_empty() && !d.name.is_empty(), "{:x}:{}", d.index, d.sub);
            assert_eq!(d.shape == Shape::Variable, d.object == d.name && d.sub == 0, "{:x}:{}", d.index, d.sub);
        }
    }

    #[test]
    fn the_highest_sub_index_is_the_highest() {
        for object in everything().filter(|d| d.name == HIGHEST) {
            let highest = everything().filter(|d| d.index == object.index).map(|d| d.sub).max().unwrap();
            assert_eq!(object.default, DefaultValue::Number(highest.into()), "{:x}", object.index);
        }
    }

    #[test]
    fn what_is_declared_of_the_drive_is_found_in_it() {
        for d in drive::declarations() {
            let found = entry(d.index, d.sub).unwrap();
            assert_eq!(
                (found.kind, found.access, found.mapping),
                (d.kind, d.access, d.mapping),
                "{:x}:{}",
                d.index,
                d.sub
            );
        }
    }
}

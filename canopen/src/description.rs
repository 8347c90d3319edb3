//! What description files and documents say of an object.

use super::{Access, DataType, Mapping};

/// A default value, as in an EDS.
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

/// One value of the dictionary, for description files.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Description {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
    /// What the object is.
    pub shape: Shape,
    /// Name of the object: the same for all its values, and for all PDOs of a direction. Empty on the chip.
    pub object: &'static str,
    /// Name of this value; the same for values that their sub-index tells apart. Empty on the chip.
    pub name: &'static str,
    /// Type of the value.
    pub kind: DataType,
    /// What a host may do with it.
    pub access: Access,
    /// Which PDOs may carry it.
    pub mapping: Mapping,
    /// Its default.
    pub default: DefaultValue,
}

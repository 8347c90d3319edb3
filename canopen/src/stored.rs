//! Stored values, one by one, and what became of them.

use super::DataType;

/// An object and its value, as they are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
    /// Type: [`DataType::code`].
    pub kind: u8,
    /// Value, little end first, filled up with zeros.
    pub value: u32,
}

impl Record {
    /// The value of an object of a type that takes 4 bytes at the most; what is more of it does not count.
    pub const fn new(index: u16, sub: u8, kind: DataType, value: u32) -> Record {
        Record { index, sub, kind: kind.code() as u8, value: value & used(kind) }
    }

    /// The value, if it is one of this type.
    pub const fn value(&self, kind: DataType) -> Option<u32> {
        if self.kind as u16 == kind.code() && self.value & !used(kind) == 0 { Some(self.value) } else { None }
    }
}

/// Bits that a value of a type uses.
const fn used(kind: DataType) -> u32 {
    match kind.size() {
        Some(1) => 0xFF,
        Some(2) => 0xFFFF,
        Some(4) => 0xFFFF_FFFF,
        _ => 0,
    }
}

/// Addresses of which something is said: how many, and the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Listed {
    /// How many; no more than 65535 are counted.
    pub count: u16,
    /// Index and sub-index of the first.
    pub first: Option<(u16, u8)>,
}

impl Listed {
    /// Adds an address.
    pub fn add(&mut self, index: u16, sub: u8) {
        self.count = self.count.saturating_add(1);
        self.first = self.first.or(Some((index, sub)));
    }

    /// These addresses, and then others.
    pub fn and(self, others: Listed) -> Listed {
        Listed { count: self.count.saturating_add(others.count), first: self.first.or(others.first) }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }
}

/// What became of stored values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Restored {
    /// Values of what is not there, or is not stored: passed over.
    pub skipped: Listed,
    /// Values that were missing, out of range or at odds with others: the default is in force.
    pub defaulted: Listed,
}

//! The object table: the communication objects, 1000h to 1FFFh, one row each (CiA 301 7.5.2).

use super::device::Direction::{self, Receive, Transmit};
use super::device::{CONSUMERS, ENTRIES, HISTORY, PDOS};
use super::{Abort, Access, DataType};
use Access::{Const, ReadOnly, ReadWrite, WriteOnly};
use DataType::{Domain, Unsigned8, Unsigned16, Unsigned32, VisibleString};

/// What a value is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Item {
    /// A constant: the highest sub-index, mostly.
    Fixed(u8),
    DeviceType,
    ErrorRegister,
    ErrorCount,
    PastError,
    SyncId,
    Period,
    Window,
    Name,
    Hardware,
    Software,
    Store,
    Restore,
    EmergencyId,
    EmergencyInhibit,
    Watched,
    Heartbeat,
    Vendor,
    Product,
    Revision,
    Serial,
    Overflow,
    Behaviour,
    /// Identifier of a service of this node.
    Service(u16),
    PdoId(Direction),
    Transmission(Direction),
    Inhibit,
    Timer(Direction),
    Start,
    MapCount(Direction),
    MapEntry(Direction),
    /// An update of the program (CiA 302-3).
    Program,
    Control,
    ProgramId,
    FlashStatus,
}

impl Item {
    /// Direction of the PDO that it belongs to.
    pub fn direction(self) -> Option<Direction> {
        match self {
            Self::PdoId(direction)
            | Self::Transmission(direction)
            | Self::Timer(direction)
            | Self::MapCount(direction)
            | Self::MapEntry(direction) => Some(direction),
            Self::Inhibit | Self::Start => Some(Transmit),
            _ => None,
        }
    }
}

/// Values that differ in index or sub-index alone.
pub(super) struct Row {
    /// First index, and how many follow on each other.
    pub index: (u16, u16),
    /// First sub-index, and how many.
    pub sub: (u8, u8),
    pub kind: DataType,
    pub access: Access,
    pub item: Item,
}

/// A value object by its address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CommunicationObject {
    pub item: Item,
    pub kind: DataType,
    pub access: Access,
    /// Which PDO, where the object belongs to one.
    pub pdo: u16,
    /// Sub-index.
    pub sub: u8,
}

const fn row(index: u16, sub: u8, kind: DataType, access: Access, item: Item) -> Row {
    rows((index, 1), (sub, 1), kind, access, item)
}

const fn variable(index: u16, kind: DataType, access: Access, item: Item) -> Row {
    row(index, 0, kind, access, item)
}

const fn rows(index: (u16, u16), sub: (u8, u8), kind: DataType, access: Access, item: Item) -> Row {
    Row { index, sub, kind, access, item }
}

/// Highest sub-index of an object, or of several that follow on each other.
const fn highest(index: u16, count: u16, value: u8) -> Row {
    rows((index, count), (0, 1), Unsigned8, Const, Item::Fixed(value))
}

const fn pdo(first: u16, sub: u8, kind: DataType, item: Item) -> Row {
    rows((first, PDOS as u16), (sub, 1), kind, ReadWrite, item)
}

const fn entries(first: u16, item: Item) -> Row {
    rows((first, PDOS as u16), (1, ENTRIES as u8), Unsigned32, ReadWrite, item)
}

/// Every value of the communication objects, by rising address within an object.
pub(super) const TABLE: &[Row] = &[
    variable(0x1000, Unsigned32, Const, Item::DeviceType),
    variable(0x1001, Unsigned8, ReadOnly, Item::ErrorRegister),
    row(0x1003, 0, Unsigned8, ReadWrite, Item::ErrorCount),
    rows((0x1003, 1), (1, HISTORY as u8), Unsigned32, ReadOnly, Item::PastError),
    variable(0x1005, Unsigned32, ReadWrite, Item::SyncId),
    variable(0x1006, Unsigned32, ReadWrite, Item::Period),
    variable(0x1007, Unsigned32, ReadWrite, Item::Window),
    variable(0x1008, VisibleString, Const, Item::Name),
    variable(0x1009, VisibleString, Const, Item::Hardware),
    variable(0x100A, VisibleString, Const, Item::Software),
    highest(0x1010, 1, 3),
    rows((0x1010, 1), (1, 3), Unsigned32, ReadWrite, Item::Store),
    highest(0x1011, 1, 3),
    rows((0x1011, 1), (1, 3), Unsigned32, ReadWrite, Item::Restore),
    variable(0x1014, Unsigned32, ReadWrite, Item::EmergencyId),
    variable(0x1015, Unsigned16, ReadWrite, Item::EmergencyInhibit),
    highest(0x1016, 1, CONSUMERS as u8),
    rows((0x1016, 1), (1, CONSUMERS as u8), Unsigned32, ReadWrite, Item::Watched),
    variable(0x1017, Unsigned16, ReadWrite, Item::Heartbeat),
    highest(0x1018, 1, 4),
    row(0x1018, 1, Unsigned32, ReadOnly, Item::Vendor),
    row(0x1018, 2, Unsigned32, ReadOnly, Item::Product),
    row(0x1018, 3, Unsigned32, ReadOnly, Item::Revision),
    row(0x1018, 4, Unsigned32, ReadOnly, Item::Serial),
    variable(0x1019, Unsigned8, ReadWrite, Item::Overflow),
    highest(0x1029, 1, 1),
    row(0x1029, 1, Unsigned8, ReadWrite, Item::Behaviour),
    highest(0x1200, 1, 2),
    row(0x1200, 1, Unsigned32, ReadOnly, Item::Service(0x600)),
    row(0x1200, 2, Unsigned32, ReadOnly, Item::Service(0x580)),
    highest(0x1400, PDOS as u16, 5),
    pdo(0x1400, 1, Unsigned32, Item::PdoId(Receive)),
    pdo(0x1400, 2, Unsigned8, Item::Transmission(Receive)),
    pdo(0x1400, 5, Unsigned16, Item::Timer(Receive)),
    pdo(0x1600, 0, Unsigned8, Item::MapCount(Receive)),
    entries(0x1600, Item::MapEntry(Receive)),
    highest(0x1800, PDOS as u16, 6),
    pdo(0x1800, 1, Unsigned32, Item::PdoId(Transmit)),
    pdo(0x1800, 2, Unsigned8, Item::Transmission(Transmit)),
    pdo(0x1800, 3, Unsigned16, Item::Inhibit),
    pdo(0x1800, 5, Unsigned16, Item::Timer(Transmit)),
    pdo(0x1800, 6, Unsigned8, Item::Start),
    pdo(0x1A00, 0, Unsigned8, Item::MapCount(Transmit)),
    entries(0x1A00, Item::MapEntry(Transmit)),
    highest(0x1F50, 2, 1),
    row(0x1F50, 1, Domain, WriteOnly, Item::Program),
    row(0x1F51, 1, Unsigned8, ReadWrite, Item::Control),
    highest(0x1F56, 2, 1),
    row(0x1F56, 1, Unsigned32, ReadOnly, Item::ProgramId),
    row(0x1F57, 1, Unsigned32, ReadOnly, Item::FlashStatus),
];

impl Row {
    /// Whether its values are stored.
    pub const fn is_stored(&self) -> bool {
        matches!(self.access, ReadWrite)
            && !matches!(self.item, Item::ErrorCount | Item::Store | Item::Restore | Item::Control)
    }

    /// Values in it.
    const fn values(&self) -> usize {
        self.index.1 as usize * self.sub.1 as usize
    }

    pub fn has(&self, index: u16) -> bool {
        index.wrapping_sub(self.index.0) < self.index.1
    }
}

/// Looks a value up.
pub(super) fn find(index: u16, sub: u8) -> Result<CommunicationObject, Abort> {
    let mut missing = Abort::NoObject;
    for row in TABLE.iter().filter(|row| row.has(index)) {
        if sub.wrapping_sub(row.sub.0) < row.sub.1 {
            let pdo = index.wrapping_sub(row.index.0);
            return Ok(CommunicationObject { item: row.item, kind: row.kind, access: row.access, pdo, sub });
        }
        missing = Abort::NoSubIndex;
    }
    Err(missing)
}

/// Values of the communication objects that are stored.
pub const STORED: usize = {
    let (mut total, mut n) = (0, 0);
    while n < TABLE.len() {
        if TABLE[n].is_stored() {
            // A stored value is a word at the most.
            assert!(matches!(TABLE[n].kind.size(), Some(1..=4)));
            total += TABLE[n].values();
        }
        n += 1;
    }
    total
};

/// Visits every value that is stored, with its index.
pub(super) fn stored(visit: &mut dyn FnMut(u16, CommunicationObject)) {
    for row in TABLE.iter().filter(|row| row.is_stored()) {
        for pdo in 0..row.index.1 {
            for nth in 0..row.sub.1 {
                let sub = row.sub.0.wrapping_add(nth);
                let object = CommunicationObject { item: row.item, kind: row.kind, access: row.access, pdo, sub };
                visit(row.index.0.wrapping_add(pdo), object);
            }
        }
    }
}

/// A value that is stored, and the how manieth it is to [`stored`].
pub(super) fn stored_at(index: u16, sub: u8) -> Option<(usize, CommunicationObject)> {
    let mut before = 0;
    for row in TABLE.iter().filter(|row| row.is_stored()) {
        let (pdo, nth) = (index.wrapping_sub(row.index.0), sub.wrapping_sub(row.sub.0));
        if pdo < row.index.1 && nth < row.sub.1 {
            let object = CommunicationObject { item: row.item, kind: row.kind, access: row.access, pdo, sub };
            return Some((before + usize::from(pdo) * usize::from(row.sub.1) + usize::from(nth), object));
        }
        before += row.values();
    }
    None
}

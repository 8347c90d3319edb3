//! The objects of the communication area, one row each (CiA 301 7.5.2).

use crate::device::{ENTRIES, PDOS};
use crate::emergency::HISTORY;
use crate::parameters::CONSUMERS;
use crate::pdo::Direction::{self, Receive, Transmit};
use crate::{Abort, Access, DataType, Shape};
use Access::{Const, ReadOnly, ReadWrite};
use DataType::{Unsigned8, Unsigned16, Unsigned32, VisibleString};
use Shape::{Array, Record, Variable};

/// What a value is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Item {
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
    pub shape: Shape,
    pub names: Names,
    pub kind: DataType,
    pub access: Access,
    pub item: Item,
}

/// A value found by its address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Found {
    pub item: Item,
    pub kind: DataType,
    pub access: Access,
    /// Which PDO, where the object belongs to one.
    pub pdo: u16,
    /// Sub-index.
    pub sub: u8,
}

/// Names of object and value. The chip has no use for them.
#[derive(Clone, Copy)]
pub(super) struct Names {
    #[cfg(not(target_os = "none"))]
    both: (&'static str, &'static str),
}

impl Names {
    #[cfg(not(target_os = "none"))]
    const fn new(both: (&'static str, &'static str)) -> Self {
        Self { both }
    }

    #[cfg(not(target_os = "none"))]
    pub const fn get(self) -> (&'static str, &'static str) {
        self.both
    }

    #[cfg(target_os = "none")]
    const fn new(_: (&'static str, &'static str)) -> Self {
        Self {}
    }

    #[cfg(target_os = "none")]
    pub const fn get(self) -> (&'static str, &'static str) {
        ("", "")
    }
}

const fn row(
    index: u16,
    sub: u8,
    names: (&'static str, &'static str),
    kind: DataType,
    access: Access,
    item: Item,
) -> Row {
    rows((index, 1), (sub, 1), Record, names, kind, access, item)
}

const fn variable(index: u16, name: &'static str, kind: DataType, access: Access, item: Item) -> Row {
    rows((index, 1), (0, 1), Variable, (name, name), kind, access, item)
}

const fn rows(
    index: (u16, u16),
    sub: (u8, u8),
    shape: Shape,
    names: (&'static str, &'static str),
    kind: DataType,
    access: Access,
    item: Item,
) -> Row {
    Row { index, sub, shape, names: Names::new(names), kind, access, item }
}

/// Highest sub-index of an object.
const fn highest(index: u16, count: u16, shape: Shape, object: &'static str, value: u8) -> Row {
    rows((index, count), (0, 1), shape, (object, "Highest sub-index supported"), Unsigned8, Const, Item::Fixed(value))
}

const fn pdo(first: u16, sub: u8, object: &'static str, name: &'static str, kind: DataType, item: Item) -> Row {
    rows((first, PDOS as u16), (sub, 1), Record, (object, name), kind, ReadWrite, item)
}

const fn entries(first: u16, object: &'static str, item: Item) -> Row {
    rows((first, PDOS as u16), (1, ENTRIES as u8), Record, (object, "Application object"), Unsigned32, ReadWrite, item)
}

const ERRORS: &str = "Pre-defined error field";
const STORE: &str = "Store parameters";
const RESTORE: &str = "Restore default parameters";
const WATCHED: &str = "Consumer heartbeat time";
const IDENTITY: &str = "Identity object";
const BEHAVIOUR: &str = "Error behaviour object";
const SERVER: &str = "SDO server parameter";
const RPDO: &str = "RPDO communication parameter";
const RPDO_MAP: &str = "RPDO mapping parameter";
const TPDO: &str = "TPDO communication parameter";
const TPDO_MAP: &str = "TPDO mapping parameter";
const COUNT: &str = "Number of mapped application objects in PDO";
const ID: &str = "COB-ID used by";
const TYPE: &str = "Transmission type";

/// Every value of the communication area, by rising address within an object.
pub(super) const TABLE: &[Row] = &[
    variable(0x1000, "Device type", Unsigned32, Const, Item::DeviceType),
    variable(0x1001, "Error register", Unsigned8, ReadOnly, Item::ErrorRegister),
    rows((0x1003, 1), (0, 1), Array, (ERRORS, "Number of errors"), Unsigned8, ReadWrite, Item::ErrorCount),
    rows(
        (0x1003, 1),
        (1, HISTORY as u8),
        Array,
        (ERRORS, "Standard error field"),
        Unsigned32,
        ReadOnly,
        Item::PastError,
    ),
    variable(0x1005, "COB-ID SYNC message", Unsigned32, ReadWrite, Item::SyncId),
    variable(0x1006, "Communication cycle period", Unsigned32, ReadWrite, Item::Period),
    variable(0x1007, "Synchronous window length", Unsigned32, ReadWrite, Item::Window),
    variable(0x1008, "Manufacturer device name", VisibleString, Const, Item::Name),
    variable(0x1009, "Manufacturer hardware version", VisibleString, Const, Item::Hardware),
    variable(0x100A, "Manufacturer software version", VisibleString, Const, Item::Software),
    highest(0x1010, 1, Array, STORE, 3),
    rows((0x1010, 1), (1, 1), Array, (STORE, "Save all parameters"), Unsigned32, ReadWrite, Item::Store),
    rows((0x1010, 1), (2, 1), Array, (STORE, "Save communication parameters"), Unsigned32, ReadWrite, Item::Store),
    rows((0x1010, 1), (3, 1), Array, (STORE, "Save application parameters"), Unsigned32, ReadWrite, Item::Store),
    highest(0x1011, 1, Array, RESTORE, 3),
    rows((0x1011, 1), (1, 1), Array, (RESTORE, "Restore all default parameters"), Unsigned32, ReadWrite, Item::Restore),
    rows((0x1011, 1), (2, 1), Array, (RESTORE, "Restore communication defaults"), Unsigned32, ReadWrite, Item::Restore),
    rows((0x1011, 1), (3, 1), Array, (RESTORE, "Restore application defaults"), Unsigned32, ReadWrite, Item::Restore),
    variable(0x1014, "COB-ID EMCY", Unsigned32, ReadWrite, Item::EmergencyId),
    variable(0x1015, "Inhibit time EMCY", Unsigned16, ReadWrite, Item::EmergencyInhibit),
    highest(0x1016, 1, Array, WATCHED, CONSUMERS as u8),
    rows((0x1016, 1), (1, CONSUMERS as u8), Array, (WATCHED, WATCHED), Unsigned32, ReadWrite, Item::Watched),
    variable(0x1017, "Producer heartbeat time", Unsigned16, ReadWrite, Item::Heartbeat),
    highest(0x1018, 1, Record, IDENTITY, 4),
    row(0x1018, 1, (IDENTITY, "Vendor-ID"), Unsigned32, ReadOnly, Item::Vendor),
    row(0x1018, 2, (IDENTITY, "Product code"), Unsigned32, ReadOnly, Item::Product),
    row(0x1018, 3, (IDENTITY, "Revision number"), Unsigned32, ReadOnly, Item::Revision),
    row(0x1018, 4, (IDENTITY, "Serial number"), Unsigned32, ReadOnly, Item::Serial),
    variable(0x1019, "Synchronous counter overflow value", Unsigned8, ReadWrite, Item::Overflow),
    highest(0x1029, 1, Array, BEHAVIOUR, 1),
    rows((0x1029, 1), (1, 1), Array, (BEHAVIOUR, "Communication error"), Unsigned8, ReadWrite, Item::Behaviour),
    highest(0x1200, 1, Record, SERVER, 2),
    row(0x1200, 1, (SERVER, "COB-ID client to server"), Unsigned32, ReadOnly, Item::Service(0x600)),
    row(0x1200, 2, (SERVER, "COB-ID server to client"), Unsigned32, ReadOnly, Item::Service(0x580)),
    highest(0x1400, PDOS as u16, Record, RPDO, 5),
    pdo(0x1400, 1, RPDO, ID, Unsigned32, Item::PdoId(Receive)),
    pdo(0x1400, 2, RPDO, TYPE, Unsigned8, Item::Transmission(Receive)),
    pdo(0x1400, 5, RPDO, "Event timer", Unsigned16, Item::Timer(Receive)),
    pdo(0x1600, 0, RPDO_MAP, COUNT, Unsigned8, Item::MapCount(Receive)),
    entries(0x1600, RPDO_MAP, Item::MapEntry(Receive)),
    highest(0x1800, PDOS as u16, Record, TPDO, 6),
    pdo(0x1800, 1, TPDO, ID, Unsigned32, Item::PdoId(Transmit)),
    pdo(0x1800, 2, TPDO, TYPE, Unsigned8, Item::Transmission(Transmit)),
    pdo(0x1800, 3, TPDO, "Inhibit time", Unsigned16, Item::Inhibit),
    pdo(0x1800, 5, TPDO, "Event timer", Unsigned16, Item::Timer(Transmit)),
    pdo(0x1800, 6, TPDO, "SYNC start value", Unsigned8, Item::Start),
    pdo(0x1A00, 0, TPDO_MAP, COUNT, Unsigned8, Item::MapCount(Transmit)),
    entries(0x1A00, TPDO_MAP, Item::MapEntry(Transmit)),
];

impl Row {
    /// Length of a value that is stored, bytes.
    const fn stored(&self) -> Option<usize> {
        match (self.access, self.item) {
            (_, Item::ErrorCount | Item::Store | Item::Restore) => None,
            (ReadWrite, _) => self.kind.size(),
            _ => None,
        }
    }

    pub fn has(&self, index: u16) -> bool {
        index.wrapping_sub(self.index.0) < self.index.1
    }
}

/// Looks a value up.
#[inline(never)]
pub(crate) fn find(index: u16, sub: u8) -> Result<Found, Abort> {
    let mut missing = Abort::NoObject;
    for row in TABLE.iter().filter(|row| row.has(index)) {
        if sub.wrapping_sub(row.sub.0) < row.sub.1 {
            let pdo = index.wrapping_sub(row.index.0);
            return Ok(Found { item: row.item, kind: row.kind, access: row.access, pdo, sub });
        }
        missing = Abort::NoSubIndex;
    }
    Err(missing)
}

/// Bytes of all values that are stored.
pub(crate) const STORED: usize = {
    let (mut total, mut n) = (0, 0);
    while n < TABLE.len() {
        if let Some(size) = TABLE[n].stored() {
            total += size * TABLE[n].index.1 as usize * TABLE[n].sub.1 as usize;
        }
        n += 1;
    }
    total
};

/// Visits every value that is stored, with its length in bytes, until one is refused.
#[inline(never)]
pub(crate) fn stored(visit: &mut dyn FnMut(Found, usize) -> Option<()>) -> Option<()> {
    for row in TABLE {
        let Some(size) = row.stored() else { continue };
        for pdo in 0..row.index.1 {
            for nth in 0..row.sub.1 {
                let sub = row.sub.0.wrapping_add(nth);
                visit(Found { item: row.item, kind: row.kind, access: row.access, pdo, sub }, size)?;
            }
        }
    }
    Some(())
}

/// Whether 1010h stores a value.
#[cfg(not(target_os = "none"))]
pub fn is_stored(index: u16, sub: u8) -> bool {
    let of = |row: &&Row| row.has(index) && sub.wrapping_sub(row.sub.0) < row.sub.1;
    TABLE.iter().find(of).is_some_and(|row| row.stored().is_some())
}

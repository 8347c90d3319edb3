//! The objects of the drive: one declaration each, from which the dictionary follows and, in host/describe, EDS, DBC
//! and docs/objects.md.
//!
//! Profile and EDM objects are declared in `table.rs`; settings are objects by their own declaration in
//! src/settings/table.rs: each group is a record from 2100h on. Addresses stand in the declarations and never move:
//! docs/released-objects.csv has all that were released, and a test compares.

mod settings;
mod table;

pub use settings::{address as setting_address, address_at as setting_address_at, kind as setting_kind, setting_at};
pub use table::Item;

use super::{Abort, Access, DataType, Entry, Mapping, ObjectHandle};
use table::TABLE;

/// One object of `table.rs`.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    index: u16,
    sub: u8,
    item: Item,
    kind: DataType,
    access: Access,
    mapping: Mapping,
    store: bool,
    /// Shared with the rows of the same range.
    range: &'static (i64, i64),
    default: i32,
    #[cfg(not(target_os = "none"))]
    texts: (&'static str, &'static str, &'static str),
}

impl Row {
    #[expect(clippy::too_many_arguments, reason = "one a column of the table")]
    const fn new(
        index: u16,
        sub: u8,
        item: Item,
        kind: DataType,
        access: Access,
        mapping: Mapping,
        range: &'static (i64, i64),
        default: i32,
        store: bool,
        texts: (&'static str, &'static str, &'static str),
    ) -> Row {
        #[cfg(target_os = "none")]
        let _ = texts;
        Row {
            index,
            sub,
            item,
            kind,
            access,
            mapping,
            store,
            range,
            default,
            #[cfg(not(target_os = "none"))]
            texts,
        }
    }

    /// Index and sub-index.
    pub fn address(&self) -> (u16, u8) {
        (self.index, self.sub)
    }

    /// Name of the object; name of the value, and behind a colon what it does; unit. The chip has no use for them.
    #[cfg(not(target_os = "none"))]
    pub fn texts(&self) -> (&'static str, &'static str, &'static str) {
        self.texts
    }

    /// What the object is.
    pub fn item(&self) -> Item {
        self.item
    }

    /// Type of its value.
    pub fn kind(&self) -> DataType {
        self.kind
    }

    /// What a host may do with it.
    pub fn access(&self) -> Access {
        self.access
    }

    /// Which PDOs may carry it.
    pub fn mapping(&self) -> Mapping {
        self.mapping
    }

    /// Whether 1010h stores it.
    pub fn is_stored(&self) -> bool {
        self.store
    }

    /// Value before anybody writes one.
    pub fn default(&self) -> i32 {
        self.default
    }

    /// Smallest and largest value, both included.
    pub fn range(&self) -> (i64, i64) {
        *self.range
    }

    /// Checks a value against the range.
    ///
    /// # Errors
    /// [`Abort::ValueTooHigh`], [`Abort::ValueTooLow`].
    pub fn check(&self, value: i64) -> Result<(), Abort> {
        let (min, max) = *self.range;
        if value > max {
            Err(Abort::ValueTooHigh)
        } else if value < min {
            Err(Abort::ValueTooLow)
        } else {
            Ok(())
        }
    }
}

/// Rows that 1010h stores.
pub const STORABLE: usize = {
    let (mut at, mut storable) = (0, 0);
    while at < COUNT {
        storable += TABLE[at].store as usize;
        at += 1;
    }
    storable
};

// Rows rise, so none is there twice, and none is where settings are.
const _: () = {
    let mut at = 0;
    while at < COUNT {
        let row = &TABLE[at];
        assert!(row.index < settings::FIRST || row.index > settings::LAST, "2100h to 5FFFh are for settings");
        if at > 0 {
            let before = &TABLE[at - 1];
            assert!(
                before.index < row.index || before.index == row.index && before.sub < row.sub,
                "objects are declared by rising index and sub-index, each once"
            );
        }
        at += 1;
    }
};

/// Objects of `table.rs`.
pub const COUNT: usize = TABLE.len();

/// The rows, in the order of [`Item`].
pub fn rows() -> &'static [Row] {
    TABLE
}

/// What a [`ObjectHandle`] of the drive holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decoded {
    /// A row of the table.
    Row(u16),
    /// A setting, by its place among the settings.
    Setting(u16),
    /// The highest sub-index of an object.
    Highest(u8),
}

const SETTING: u16 = 0x8000;
const HIGHEST: u16 = 0x4000;

impl Decoded {
    /// Where it is.
    pub fn place(self) -> ObjectHandle {
        ObjectHandle(match self {
            Decoded::Row(row) => row,
            Decoded::Setting(field) => SETTING | field,
            Decoded::Highest(sub) => HIGHEST | sub as u16,
        })
    }

    /// What is at a place.
    pub fn at(place: ObjectHandle) -> Decoded {
        match place.0 {
            place if place & SETTING != 0 => Decoded::Setting(place & !SETTING),
            place if place & HIGHEST != 0 => Decoded::Highest(place as u8),
            place => Decoded::Row(place),
        }
    }
}

/// Looks an object up.
///
/// # Errors
/// [`Abort::NoObject`], [`Abort::NoSubIndex`].
pub fn entry(index: u16, sub: u8) -> Result<Entry, Abort> {
    if (settings::FIRST..=settings::LAST).contains(&index) {
        let highest = settings::highest(index).ok_or(Abort::NoObject)?;
        let (kind, access, found) = match sub {
            0 => (DataType::Unsigned8, Access::Const, Decoded::Highest(highest)),
            sub => {
                let field = settings::setting_at(index, sub).ok_or(Abort::NoSubIndex)?;
                let (kind, access) = settings::kind(field).ok_or(Abort::NoSubIndex)?;
                (kind, access, Decoded::Setting(field))
            }
        };
        return Ok(Entry { kind, access, mapping: Mapping::No, place: found.place() });
    }
    // Rows rise by index and sub-index.
    let number = TABLE.partition_point(|row| row.address() < (index, sub));
    if let Some(row) = TABLE.get(number).filter(|row| row.address() == (index, sub)) {
        let place = Decoded::Row(number as u16).place();
        return Ok(Entry { kind: row.kind, access: row.access, mapping: row.mapping, place });
    }
    let behind = TABLE.partition_point(|row| row.index <= index);
    let last = behind.checked_sub(1).and_then(|number| TABLE.get(number));
    let highest = last.filter(|row| row.index == index).map(|row| row.sub);
    match (highest, sub) {
        (None, _) => Err(Abort::NoObject),
        (Some(highest), 0) if highest > 0 => Ok(Entry {
            kind: DataType::Unsigned8,
            access: Access::Const,
            mapping: Mapping::No,
            place: Decoded::Highest(highest).place(),
        }),
        _ => Err(Abort::NoSubIndex),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_rise_and_stand_where_their_item_says() {
        for (number, row) in TABLE.iter().enumerate() {
            assert_eq!(row.item as usize, number, "{row:?}");
        }
        assert!(TABLE.windows(2).all(|pair| pair[0].address() < pair[1].address()));
    }

    #[test]
    fn every_default_lies_in_its_range_and_every_range_in_its_type() {
        for row in TABLE {
            if row.access == Access::ReadWrite {
                assert_eq!(row.check(row.default.into()), Ok(()), "{row:?}");
            }
            let bits = row.kind.size().map_or(0, |size| size * 8);
            let signed = matches!(row.kind, DataType::Integer8 | DataType::Integer16 | DataType::Integer32);
            if bits > 0 {
                let (low, high) =
                    if signed { (-(1i64 << (bits - 1)), (1i64 << (bits - 1)) - 1) } else { (0, (1i64 << bits) - 1) };
                assert!(row.range.0 >= low && row.range.1 <= high && row.range.0 <= row.range.1, "{row:?}");
            }
        }
    }

    #[test]
    fn what_is_not_declared_is_not_there() {
        assert_eq!(entry(0x6040, 1), Err(Abort::NoSubIndex));
        assert_eq!(entry(0x607D, 3), Err(Abort::NoSubIndex));
        assert_eq!(entry(0x5FFF, 0), Err(Abort::NoObject));
        assert_eq!(entry(0x20FF, 0), Err(Abort::NoObject));
    }

    #[test]
    fn only_what_can_be_in_a_pdo_is_mapped() {
        for row in TABLE.iter().filter(|row| row.mapping != Mapping::No) {
            assert!(row.kind.size().is_some_and(|size| size <= 4), "{row:?}");
        }
    }
}

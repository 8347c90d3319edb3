//! A table of technology: rows from roughing to finishing, which a head runs one after the other in one hole.
//!
//! A row is what differs from the settings while it runs, what the generator is to be set to, and what it *leaves*: it ends so far
//! above the depth of the hole, for the rows behind it, whose gap and roughness are less. Only settings
//! that may change at any time while the head is enabled ([`Change::Live`]) can be part of a row: no row takes a protection
//! away, and none needs a disabled head.
//!
//! A table is checked as a whole before anything moves: each row with the settings as they are ([`Table::check`]).

use crate::settings::{Change, Declared, SettingError, Settings};
use heapless::Vec;

/// Rows of a table.
pub const ROWS: usize = 8;
/// Settings of a row.
pub const PER_ROW: usize = 12;

/// What a generator is to be set to; 0 where a row says nothing. The head tells it, and does not know whether it is so.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pulse {
    /// On-time, ns.
    pub on_ns: u32,
    /// Off-time, ns.
    pub off_ns: u32,
    /// Current of a discharge, mA.
    pub current_ma: u32,
    /// Polarity of the electrode: 1 negative, 2 positive.
    pub polarity: u8,
}

/// Settings by their place ([`Declared::FIELDS`]), and their words.
pub type Words = Vec<(u16, u32), PER_ROW>;

/// A row.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Row {
    /// Height above the depth of the hole at which it ends, nm.
    pub leaves_nm: u32,
    /// For the generator.
    pub pulse: Pulse,
    /// Settings that it runs with.
    pub words: Words,
}

/// Why a table is refused; the number is the one in 201Ch:3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Why {
    /// It is not.
    #[default]
    No = 0,
    /// It has no row.
    Empty = 1,
    /// The row would not end deeper than the one before.
    Leaves = 2,
    /// A setting that may not change at any time while the head is enabled.
    Guarded = 3,
    /// A value out of the range of its setting.
    Range = 4,
    /// Settings that contradict each other, or those that are not part of the row.
    Conflict = 5,
}

/// What is wrong with a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wrong {
    /// Row, from 1.
    pub row: u8,
    /// Why.
    pub why: Why,
    /// Place of the setting, if it is one.
    pub field: Option<u16>,
    /// Rule that it has to satisfy, for [`Why::Guarded`] and [`Why::Conflict`].
    pub rule: &'static str,
}

/// The rows, from roughing to finishing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    rows: Vec<Row, ROWS>,
}

impl Table {
    /// No row.
    pub const EMPTY: Table = Table { rows: Vec::new() };

    /// Rows.
    pub fn len(&self) -> u8 {
        self.rows.len() as u8
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The row of this number, from 1.
    pub fn row(&self, number: u8) -> Option<&Row> {
        self.rows.get(usize::from(number).checked_sub(1)?)
    }

    /// Begins a row of this number, from 1, without anything in it; those behind it are gone. False where one before it is missing, or
    /// there is no room.
    pub fn begin(&mut self, number: u8) -> bool {
        let Some(before) = usize::from(number).checked_sub(1).filter(|before| *before <= self.rows.len()) else {
            return false;
        };
        self.rows.truncate(before);
        self.rows.push(Row::default()).is_ok()
    }

    /// The row begun last.
    pub fn last_mut(&mut self) -> Option<&mut Row> {
        self.rows.last_mut()
    }

    /// Forgets all rows.
    pub fn clear(&mut self) {
        self.rows.clear();
    }

    /// Checks a row, from 1, with the settings that are not part of it.
    ///
    /// # Errors
    /// What is wrong with it.
    // In a frame of its own: settings, and what is built of them.
    #[inline(never)]
    pub fn check(&self, number: u8, settings: &Settings) -> Result<(), Wrong> {
        let wrong = |why, field, rule| Err(Wrong { row: number, why, field, rule });
        let Some(row) = self.row(number) else { return wrong(Why::Empty, None, "") };
        if number.checked_sub(1).and_then(|before| self.row(before)).is_some_and(|it| it.leaves_nm <= row.leaves_nm) {
            return wrong(Why::Leaves, None, "");
        }
        let mut pending = *settings;
        for &(field, word) in &row.words {
            let change = Settings::FIELDS.get(usize::from(field)).map(|field| field.change);
            match change {
                Some(Change::Live) => {}
                Some(change) => return wrong(Why::Guarded, Some(field), change.rule()),
                None => return wrong(Why::Guarded, Some(field), ""),
            }
            if pending.put_word(field.into(), word).is_err() {
                return wrong(Why::Range, Some(field), "");
            }
        }
        match pending.build() {
            Ok(_) => Ok(()),
            Err(SettingError::Conflict { field, rule }) => {
                let place = Settings::KEYS.iter().position(|key| *key == field);
                wrong(Why::Conflict, place.map(|place| place as u16), rule)
            }
            Err(_) => wrong(Why::Range, None, ""),
        }
    }
}

impl Row {
    /// Brings its settings into force, and gives what they replace.
    pub fn enter(&self, settings: &mut Settings) -> Words {
        let mut replaced = self.words.clone();
        for (field, word) in &mut replaced {
            let before = settings.word((*field).into());
            if settings.put_word((*field).into(), *word).is_ok() {
                *word = before.unwrap_or(*word);
            }
        }
        replaced
    }
}

/// Puts back what a row has replaced.
pub fn leave(settings: &mut Settings, replaced: &Words) {
    // Of a setting that is there twice the first has what was before.
    for &(field, word) in replaced.iter().rev() {
        // It was in force: it is in its range.
        settings.put_word(field.into(), word).unwrap_or_default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::place;

    const SETPOINT: u16 = place(Settings::KEYS, "gap.setpoint_v") as u16;
    const HEIGHT: u16 = place(Settings::KEYS, "jump.height_um") as u16;

    fn table(rows: &[(u32, &[(u16, u32)])]) -> Table {
        let mut table = Table::EMPTY;
        for (number, (leaves_nm, words)) in (1..).zip(rows) {
            assert!(table.begin(number));
            let row = table.last_mut().unwrap();
            (row.leaves_nm, row.words) = (*leaves_nm, Words::from_slice(words).unwrap());
        }
        table
    }

    fn wrong(table: &Table, row: u8) -> (Why, Option<&'static str>) {
        let wrong = table.check(row, &Settings::default()).unwrap_err();
        assert_eq!(wrong.row, row);
        (wrong.why, wrong.field.map(|field| Settings::KEYS[usize::from(field)]))
    }

    #[test]
    fn a_row_that_cannot_be_run_is_refused_with_the_setting_and_why() {
        let mass = place(Settings::KEYS, "axis.mass_kg") as u16;
        let clearance = place(Settings::KEYS, "retreat.clearance_um") as u16;
        let volts = f32::to_bits;
        let good = table(&[(60, &[(SETPOINT, volts(65.0))]), (20, &[]), (0, &[(SETPOINT, volts(50.0))])]);
        assert!((1..=3).all(|row| good.check(row, &Settings::default()) == Ok(())));
        assert_eq!(wrong(&Table::EMPTY, 1), (Why::Empty, None));
        assert_eq!(wrong(&table(&[(20, &[]), (20, &[])]), 2), (Why::Leaves, None));
        for field in [mass, clearance, u16::MAX] {
            let rows = table(&[(0, &[(field, volts(20.0))])]);
            assert_eq!(rows.check(1, &Settings::default()).unwrap_err().why, Why::Guarded);
        }
        let out = table(&[(9, &[]), (0, &[(SETPOINT, volts(301.0))])]);
        assert_eq!(wrong(&out, 2), (Why::Range, Some("gap.setpoint_v")));
        let high = table(&[(0, &[(HEIGHT, volts(900_000.0))])]);
        assert_eq!(wrong(&high, 1), (Why::Conflict, Some("jump.height_um")));
    }

    #[test]
    fn what_a_row_replaces_is_put_back_whatever_is_there_twice() {
        let rows =
            table(&[(0, &[(SETPOINT, 50f32.to_bits()), (HEIGHT, 300f32.to_bits()), (SETPOINT, 55f32.to_bits())])]);
        let mut settings = Settings::default();
        let replaced = rows.row(1).unwrap().enter(&mut settings);
        assert_eq!((settings.gap_setpoint, settings.jump_height), (55.0, 300.0));
        leave(&mut settings, &replaced);
        assert_eq!(settings, Settings::default());
    }

    #[test]
    fn rows_are_begun_in_order_and_one_that_is_begun_again_ends_the_table() {
        let mut rows = Table::EMPTY;
        assert!(!rows.begin(0) && !rows.begin(2));
        assert!((1..=ROWS as u8).all(|number| rows.begin(number)));
        assert!(!rows.begin(ROWS as u8 + 1));
        rows.last_mut().unwrap().leaves_nm = 7;
        assert!(rows.begin(3));
        assert_eq!((rows.len(), rows.row(3)), (3, Some(&Row::default())));
        assert_eq!((rows.row(0), rows.row(4)), (None, None));
    }
}

//! A technology table: rows from rough to fine, each with settings of the head and what the generator is to be set to.
//!
//! A row erodes to the depth of the hole less what it leaves for the next one. The head sets no generator: what a row says of it is for the
//! person, who is asked to set it before the row begins.

use crate::settings::{self, Setting};
use crate::sheet::Sheet;
use serde::Deserialize;
use std::collections::BTreeMap;

/// As a file has it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    electrode: String,
    work: String,
    row: Vec<WrittenRow>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenRow {
    name: String,
    #[serde(default)]
    leaves_um: f64,
    #[serde(default)]
    undersize_um: Option<f64>,
    #[serde(default)]
    generator: BTreeMap<String, toml::Value>,
    #[serde(default)]
    settings: toml::Table,
}

/// Rows for one pair of materials.
#[derive(Clone, Debug, PartialEq)]
pub struct Table<'a> {
    /// Material of the electrode.
    pub electrode: String,
    /// Material of the work.
    pub work: String,
    /// From rough to fine.
    pub rows: Vec<Row<'a>>,
}

/// One row.
#[derive(Clone, Debug, PartialEq)]
pub struct Row<'a> {
    /// Its name.
    pub name: String,
    /// It ends so far above the depth of the hole, um.
    pub leaves_um: f64,
    /// The electrode is so much smaller than the hole, a side, um: for the person, as the generator.
    pub undersize_um: Option<f64>,
    /// What the generator is to be set to, in words; empty for nothing.
    pub generator: String,
    /// Settings of the head.
    pub settings: Vec<Setting<'a>>,
}

impl<'a> Table<'a> {
    /// Reads a file.
    ///
    /// # Errors
    /// The first thing that is wrong with it, and what is allowed.
    pub fn parse(sheet: &'a Sheet, text: &str) -> Result<Table<'a>, String> {
        let written: Written = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(1, |span| text[..span.start.min(text.len())].matches('\n').count() + 1);
            format!("line {line}: {}", error.message().replace('\n', ", "))
        })?;
        let mut rows: Vec<Row<'a>> = Vec::new();
        for row in written.row {
            let named = |why: String| format!("row {:?}: {why}", row.name);
            if !(0.0..=1e6).contains(&row.leaves_um) {
                return Err(named(format!("leaves_um = {}: must be a number from 0 to 1000000 um", row.leaves_um)));
            }
            if let Some(before) = rows.last()
                && row.leaves_um >= before.leaves_um
            {
                let (name, leaves) = (&before.name, before.leaves_um);
                return Err(named(format!(
                    "leaves_um = {}: must be less than the {leaves} of {name:?}",
                    row.leaves_um
                )));
            }
            let settings = match row.settings.is_empty() {
                true => Vec::new(),
                false => settings::parse(sheet, &row.settings.to_string()).map_err(named)?,
            };
            let generator: Vec<String> =
                row.generator.iter().map(|(name, value)| format!("{name} {}", word(value))).collect();
            let WrittenRow { name, leaves_um, undersize_um, .. } = row;
            rows.push(Row { name, leaves_um, undersize_um, generator: generator.join(", "), settings });
        }
        match rows.last() {
            None => Err("no [[row]]".into()),
            Some(last) if last.leaves_um != 0.0 => {
                Err(format!("row {:?}: leaves_um = {}: the last row must leave 0", last.name, last.leaves_um))
            }
            Some(_) => Ok(Table { electrode: written.electrode, work: written.work, rows }),
        }
    }
}

fn word(value: &toml::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = include_str!("../../../examples/technology.toml");

    #[test]
    fn the_example_has_rows_from_rough_to_fine() {
        let sheet = Sheet::own().unwrap();
        let table = Table::parse(&sheet, FILE).unwrap();
        assert_eq!((table.electrode.as_str(), table.work.as_str()), ("copper", "steel"));
        let names: Vec<_> = table.rows.iter().map(|row| (row.name.as_str(), row.leaves_um)).collect();
        assert_eq!(names, [("rough", 60.0), ("medium", 20.0), ("fine", 0.0)]);
        assert!(table.rows[0].generator.contains("on_us 160") && table.rows.iter().all(|row| !row.settings.is_empty()));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_row() {
        let sheet = Sheet::own().unwrap();
        let head = "electrode = \"copper\"\nwork = \"steel\"\n";
        for (rows, part) in [
            ("", "missing field `row`"),
            ("row = []", "no [[row]]"),
            ("[[row]]\nname = \"a\"\nleaves_um = 5", "row \"a\": leaves_um = 5: the last row must leave 0"),
            ("[[row]]\nname = \"a\"\nleaves_um = -1", "row \"a\": leaves_um = -1: must be a number from 0"),
            (
                "[[row]]\nname = \"a\"\nleaves_um = 5\n[[row]]\nname = \"b\"\nleaves_um = 5",
                "row \"b\": leaves_um = 5: must be less than the 5 of \"a\"",
            ),
            (
                "[[row]]\nname = \"a\"\n[row.settings.gap]\nsetpoint_v = 500",
                "row \"a\": gap.setpoint_v = 500: must be a number from 1 to 300 V",
            ),
            ("[[row]]\nname = \"a\"\n[row.settings.gap]\nsetpiont_v = 50", "did you mean gap.setpoint_v?"),
            ("[[row]]\nname = \"a\"\ncolour = 1", "line 5: unknown field `colour`"),
        ] {
            let why = Table::parse(&sheet, &format!("{head}{rows}")).unwrap_err();
            assert!(why.contains(part), "{part}: {why}");
        }
    }
}

//! A technology table as a person writes it, in TOML: rows from rough to fine for a pair of materials (docs/technology.md).
//!
//! Each row says what it leaves for those behind it, what the generator is to be set to, and settings of the head. A head takes it
//! in writes to 201Ch ([`File::writes`]). Every refusal names line, row, key, value and what is allowed.

use edm_servo_head::canopen::objects::setting_address_at;
use edm_servo_head::settings::{Change, Declared, Field, Settings, Value, place};
use edm_servo_head::technology::{PER_ROW, Pulse, ROWS, Table, Why, Words, Wrong};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Most that a row may leave, um: of 201Ch:10.
const LEAVES: (f64, f64) = (0.0, 1e6);
/// What a head tells a generator: name, range, unit, and how many of the unit of 201Ch are in one.
const PULSE: [(&str, (f64, f64), &str, f64); 3] = [
    ("on_us", (0.1, 10_000.0), "us", 1000.0),
    ("off_us", (0.1, 10_000.0), "us", 1000.0),
    ("current_a", (0.01, 1000.0), "A", 1000.0),
];
/// Polarities, in the order of 201Ch:14, from 1.
const POLARITIES: [&str; 2] = ["electrode negative", "electrode positive"];
const ENTRIES: [&str; 3] = ["electrode", "work", "row"];
const ROW_ENTRIES: [&str; 5] = ["name", "leaves_um", "undersize_um", "generator", "settings"];

/// A setting by which a head waits for the generator at the beginning of a row.
const ANSWER: usize = place(Settings::KEYS, "technology.answer_s");

/// Rows for one pair of materials.
#[derive(Clone, Debug, PartialEq)]
pub struct File {
    /// Material of the electrode.
    pub electrode: String,
    /// Material of the work.
    pub work: String,
    /// From rough to fine.
    pub rows: Vec<Row>,
}

/// One row.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Its name.
    pub name: String,
    /// Line of the file at which it begins.
    pub line: usize,
    /// It ends so far above the depth of the hole, um.
    pub leaves_um: f64,
    /// The electrode is so much smaller than the hole, a side, um: for the person.
    pub undersize_um: Option<f64>,
    /// What the generator is to be set to.
    pub pulse: Pulse,
    /// The same in words, with what only a person can set; empty for nothing.
    pub generator: String,
    /// Settings of the head, by their place, and their words.
    pub settings: Vec<(u16, u32)>,
}

/// A write that a head takes a table by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Write {
    /// Sub-index of 201Ch.
    pub sub: u8,
    /// Value.
    pub value: u32,
    /// Its bytes.
    pub size: u8,
}

/// What is wrong, and where in the text.
type Wrongly = (usize, String);

impl File {
    /// Reads a table; settings that contradict each other show only with the others of a head ([`File::check`]).
    ///
    /// # Errors
    /// The first thing that is wrong, and what is allowed.
    pub fn parse(text: &str) -> Result<File, String> {
        let line = |offset: usize| text.get(..offset).unwrap_or(text).matches('\n').count() + 1;
        let root = DeTable::parse(text).map_err(|error| {
            let offset = error.span().map_or(0, |span| span.start);
            format!("line {}: not TOML: {}", line(offset), error.message().replace('\n', ", "))
        })?;
        let file =
            read(root.get_ref(), text, &line).map_err(|(offset, why)| format!("line {}: {why}", line(offset)))?;
        for (row, before) in file.rows.iter().skip(1).zip(&file.rows) {
            if row.leaves_um >= before.leaves_um {
                let Row { name, leaves_um, line, .. } = row;
                return Err(format!(
                    "line {line}: row {name:?}: leaves_um = {leaves_um}: must be less than the {} of {:?}",
                    before.leaves_um, before.name
                ));
            }
        }
        match file.rows.last() {
            None => Err("no [[row]]".into()),
            Some(Row { name, leaves_um, line, .. }) if *leaves_um != 0.0 => {
                Err(format!("line {line}: row {name:?}: leaves_um = {leaves_um}: the last row must leave 0"))
            }
            Some(_) => Ok(file),
        }
    }

    /// The rows as a head has them.
    pub fn table(&self) -> Table {
        let mut table = Table::EMPTY;
        for (number, row) in (1..).zip(&self.rows) {
            table.begin(number);
            if let Some(slot) = table.last_mut() {
                (slot.leaves_nm, slot.pulse) = (nanometres(row.leaves_um), row.pulse);
                // No more than fit in: that was checked.
                slot.words = row.settings.iter().copied().collect::<Words>();
            }
        }
        table
    }

    /// Checks the rows together with the settings of a head.
    ///
    /// # Errors
    /// The row, the setting and the rule.
    pub fn check(&self, settings: &Settings) -> Result<(), String> {
        let table = self.table();
        (1..=table.len()).try_for_each(|number| table.check(number, settings).map_err(|wrong| self.wrong(&wrong)))
    }

    /// What a head has found wrong, in words.
    pub fn wrong(&self, wrong: &Wrong) -> String {
        let row = self.rows.get(usize::from(wrong.row).saturating_sub(1));
        let (name, line) = row.map_or(("", 1), |row| (row.name.as_str(), row.line));
        let field = wrong.field.and_then(|field| Settings::FIELDS.get(usize::from(field)));
        let what = match (wrong.why, field) {
            (Why::Leaves, _) => "must leave less than the row before".into(),
            (Why::Range, Some(field)) => format!("{} must be {}", field.key, field.allowed()),
            (_, Some(field)) => format!("{} {}", field.key, wrong.rule),
            _ => "is refused by the head".into(),
        };
        format!("line {line}: row {name:?}: {what}")
    }

    /// Whether the generator has to be set differently for a row, from 0, than for the one before.
    pub fn sets_generator(&self, row: usize) -> bool {
        let words = |row: usize| self.rows.get(row).map_or("", |row| row.generator.as_str());
        !words(row).is_empty() && (row == 0 || words(row) != words(row - 1))
    }

    /// The same, whose head waits up to so many seconds for the generator wherever that has to be set differently.
    pub fn waiting(mut self, seconds: f32) -> File {
        for row in 0..self.rows.len() {
            let given = self.rows[row].settings.iter().any(|(field, _)| usize::from(*field) == ANSWER);
            if self.sets_generator(row) && !given {
                self.rows[row].settings.push((ANSWER as u16, seconds.to_bits()));
            }
        }
        self
    }

    /// The writes by which a head takes the rows, in their order; behind them 201Ch:2 = 1 has them checked.
    pub fn writes(&self) -> Vec<Write> {
        let mut writes = vec![Write { sub: 2, value: 0, size: 1 }];
        for (number, row) in (1..).zip(&self.rows) {
            let Pulse { on_ns, off_ns, current_ma, polarity } = row.pulse;
            let leaves = nanometres(row.leaves_um);
            let all = [(7, number, 1), (10, leaves, 4), (11, on_ns, 4), (12, off_ns, 4), (13, current_ma, 4)];
            let all = all.into_iter().chain([(14, polarity.into(), 1)]);
            let settings = row.settings.iter().flat_map(|&(field, word)| {
                let (index, sub) = setting_address_at(field.into()).unwrap_or_default();
                [(8, u32::from(index) << 8 | u32::from(sub), 4), (9, word, 4)]
            });
            writes.extend(all.chain(settings).map(|(sub, value, size)| Write { sub, value, size }));
        }
        writes
    }
}

fn nanometres(um: f64) -> u32 {
    (um * 1000.0).round() as u32
}

fn read(root: &DeTable<'_>, text: &str, line: &dyn Fn(usize) -> usize) -> Result<File, Wrongly> {
    let mut file = File { electrode: String::new(), work: String::new(), rows: Vec::new() };
    for (key, value) in root {
        match (key.get_ref().as_ref(), value.get_ref()) {
            ("electrode", DeValue::String(word)) => file.electrode = word.trim().into(),
            ("work", DeValue::String(word)) => file.work = word.trim().into(),
            ("row", DeValue::Array(rows)) => {
                for (number, value) in rows.iter().enumerate() {
                    let DeValue::Table(table) = value.get_ref() else {
                        return Err((value.span().start, "row must be tables: [[row]]".into()));
                    };
                    if number == ROWS {
                        return Err((value.span().start, format!("a head has {ROWS} rows at the most")));
                    }
                    file.rows.push(read_row(table, value.span().start, text, line)?);
                }
            }
            (known @ ("electrode" | "work"), _) => {
                return Err((value.span().start, format!("{known} must be a text in quotes")));
            }
            ("row", _) => return Err((value.span().start, "row must be tables: [[row]]".into())),
            (other, _) => return Err((key.span().start, no_entry(other, &ENTRIES))),
        }
    }
    for (name, words) in [("electrode", &file.electrode), ("work", &file.work)] {
        if words.is_empty() {
            return Err((0, format!("{name} is missing: the material, a text in quotes")));
        }
    }
    Ok(file)
}

fn read_row(table: &DeTable<'_>, start: usize, text: &str, line: &dyn Fn(usize) -> usize) -> Result<Row, Wrongly> {
    let name = table.iter().find(|(key, _)| key.get_ref() == "name").and_then(|(_, value)| value.get_ref().as_str());
    let Some(name) = name.map(str::trim).filter(|name| !name.is_empty()) else {
        return Err((start, "row: name is missing: a text in quotes".into()));
    };
    let named = |(offset, why): Wrongly| (offset, format!("row {name:?}: {why}"));
    let mut row = Row {
        name: name.into(),
        line: line(start),
        leaves_um: 0.0,
        undersize_um: None,
        pulse: Pulse::default(),
        generator: String::new(),
        settings: Vec::new(),
    };
    for (key, value) in table {
        match (key.get_ref().as_ref(), value.get_ref()) {
            ("name", _) => {}
            ("leaves_um", _) => row.leaves_um = number("leaves_um", value, LEAVES, "um", text).map_err(named)?,
            ("undersize_um", _) => {
                row.undersize_um = Some(number("undersize_um", value, LEAVES, "um", text).map_err(named)?);
            }
            ("generator", DeValue::Table(inner)) => read_generator(&mut row, inner, text).map_err(named)?,
            ("settings", DeValue::Table(inner)) => read_settings(&mut row, inner, "", text).map_err(named)?,
            (known @ ("generator" | "settings"), _) => {
                return Err(named((value.span().start, format!("{known} must be a table: [row.{known}]"))));
            }
            (other, _) => return Err(named((key.span().start, no_entry(other, &ROW_ENTRIES)))),
        }
    }
    Ok(row)
}

fn read_generator(row: &mut Row, table: &DeTable<'_>, text: &str) -> Result<(), Wrongly> {
    let mut words = Vec::new();
    for (key, value) in table {
        let name = key.get_ref().as_ref();
        if let Some((at, &(_, range, unit, per_unit))) =
            PULSE.iter().enumerate().find(|(_, (known, ..))| *known == name)
        {
            let Pulse { on_ns, off_ns, current_ma, .. } = &mut row.pulse;
            let slot = [on_ns, off_ns, current_ma].into_iter().nth(at);
            let number = number(&format!("generator.{name}"), value, range, unit, text)?;
            if let Some(slot) = slot {
                *slot = (number * per_unit).round() as u32;
            }
        }
        if name == "polarity" {
            let at = POLARITIES.iter().position(|word| value.get_ref().as_str() == Some(word));
            let at = at.ok_or_else(|| {
                let allowed = POLARITIES.map(|word| format!("{word:?}")).join(" or ");
                (value.span().start, format!("generator.polarity = {}: must be {allowed}", written(value, text)))
            })?;
            row.pulse.polarity = at as u8 + 1;
        }
        words.push(format!("{name} {}", value.get_ref().as_str().unwrap_or(written(value, text))));
    }
    row.generator = words.join(", ");
    Ok(())
}

fn read_settings(row: &mut Row, table: &DeTable<'_>, group: &str, text: &str) -> Result<(), Wrongly> {
    for (name, value) in table {
        let key = if group.is_empty() { name.get_ref().to_string() } else { format!("{group}.{}", name.get_ref()) };
        if let DeValue::Table(inner) = value.get_ref() {
            read_settings(row, inner, &key, text)?;
            continue;
        }
        let word = written(value, text);
        let wrong = |why: String| (name.span().start, format!("{key} = {word}: {why}"));
        let Some((at, field)) = Settings::FIELDS.iter().enumerate().find(|(_, field)| field.key == key) else {
            let keys: Vec<&str> = Settings::KEYS.to_vec();
            return Err(wrong(format!("no such setting{}", like(&key, &keys))));
        };
        if field.change != Change::Live {
            return Err(wrong(format!("cannot be part of a row: it {}", field.change.rule())));
        }
        let mut taken = Settings::default();
        let of_field = from_toml(value).and_then(|value| taken.put(at, value).ok()).and_then(|()| taken.word(at));
        let of_field = of_field.ok_or_else(|| wrong(format!("must be {}", field.allowed())))?;
        if row.settings.len() == PER_ROW {
            return Err(wrong(format!("a row has {PER_ROW} settings at the most")));
        }
        row.settings.push((at as u16, of_field));
    }
    Ok(())
}

/// What is written for a value, on its first line.
fn written<'a>(value: &Spanned<DeValue<'_>>, text: &'a str) -> &'a str {
    text.get(value.span()).and_then(|source| source.lines().next()).unwrap_or_default()
}

fn number(
    name: &str,
    value: &Spanned<DeValue<'_>>,
    (low, high): (f64, f64),
    unit: &str,
    text: &str,
) -> Result<f64, Wrongly> {
    match from_toml(value) {
        Some(Value::Number(number)) if (low..=high).contains(&number) => Ok(number),
        _ => Err((
            value.span().start,
            format!("{name} = {}: must be a number from {low} to {high} {unit}", written(value, text)),
        )),
    }
}

/// A value of a TOML file as one of a setting, where it can be one.
pub fn from_toml<'a>(value: &'a Spanned<DeValue<'_>>) -> Option<Value<'a>> {
    match value.get_ref() {
        DeValue::Integer(digits) => {
            i64::from_str_radix(digits.as_str(), digits.radix()).ok().map(|whole| Value::Number(whole as f64))
        }
        DeValue::Float(digits) => digits.as_str().parse().ok().map(Value::Number),
        DeValue::Boolean(flag) => Some(Value::Flag(*flag)),
        DeValue::String(word) => Some(Value::Word(word)),
        DeValue::Datetime(_) | DeValue::Array(_) | DeValue::Table(_) => None,
    }
}

fn no_entry(name: &str, known: &[&str]) -> String {
    format!("{name}: no such entry{}; there are {}", like(name, known), known.join(", "))
}

/// ", did you mean ...?" where something known is near.
fn like(name: &str, known: &[&str]) -> String {
    let near = |known: &&&str| strsim::normalized_damerau_levenshtein(name, known);
    let best = known.iter().max_by(|a, b| near(a).total_cmp(&near(b))).filter(|best| near(best) >= 0.6);
    best.map(|best| format!(", did you mean {best}?")).unwrap_or_default()
}

/// A setting of a row and its value, as a person writes them.
pub fn setting(&(field, word): &(u16, u32)) -> String {
    let mut taken = Settings::default();
    let at = usize::from(field);
    let value = taken.put_word(at, word).ok().and_then(|()| taken.get(at));
    let (Some(Field { key, unit, .. }), Some(value)) = (Settings::FIELDS.get(at), value) else { return String::new() };
    let value = match value {
        Value::Number(number) => (number as f32).to_string(),
        Value::Word(word) => word.into(),
        value => value.to_string(),
    };
    let space = if unit.is_empty() { "" } else { " " };
    format!("{key} {value}{space}{unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = include_str!("../../../examples/technology.toml");

    #[test]
    fn the_example_has_rows_from_rough_to_fine_that_a_head_takes() {
        let file = File::parse(FILE).unwrap();
        assert_eq!((file.electrode.as_str(), file.work.as_str()), ("copper", "steel"));
        let names: Vec<_> = file.rows.iter().map(|row| (row.name.as_str(), row.leaves_um)).collect();
        assert_eq!(names, [("rough", 60.0), ("medium", 20.0), ("fine", 0.0)]);
        assert!(file.rows.iter().all(|row| row.pulse.on_ns > 0 && row.pulse.polarity == 2 && !row.settings.is_empty()));
        file.check(&Settings::default()).unwrap();
        let [first, second, ..] = file.writes()[..] else { panic!() };
        assert_eq!((first, second), (Write { sub: 2, value: 0, size: 1 }, Write { sub: 7, value: 1, size: 1 }));
        assert_eq!(file.table().row(1).map(|row| row.leaves_nm), Some(60_000));
    }

    #[test]
    fn the_head_waits_where_the_generator_has_to_be_set() {
        let rows = "electrode = \"a\"\nwork = \"b\"\n\
            [[row]]\nname = \"r\"\nleaves_um = 9\ngenerator.on_us = 5\n\
            [[row]]\nname = \"s\"\nleaves_um = 4\ngenerator.on_us = 5\n\
            [[row]]\nname = \"t\"\ngenerator.on_us = 2";
        let file = File::parse(rows).unwrap();
        assert_eq!([0, 1, 2].map(|row| file.sets_generator(row)), [true, false, true]);
        let waiting = file.waiting(60.0);
        let waits: Vec<usize> = waiting.rows.iter().map(|row| row.settings.len()).collect();
        assert_eq!(waits, [1, 0, 1]);
        assert_eq!(setting(&waiting.rows[0].settings[0]), "technology.answer_s 60 s");
    }

    #[test]
    fn what_is_wrong_is_named_with_line_row_key_value_and_range() {
        let head = "electrode = \"copper\"\nwork = \"steel\"\n";
        for (rows, part) in [
            ("", "no [[row]]"),
            ("row = []", "no [[row]]"),
            ("[[row]]\nname = \"a\"\nleaves_um = 5", "line 3: row \"a\": leaves_um = 5: the last row must leave 0"),
            ("[[row]]\nname = \"a\"\nleaves_um = -1", "line 5: row \"a\": leaves_um = -1: must be a number from 0"),
            (
                "[[row]]\nname = \"a\"\nleaves_um = 5\n[[row]]\nname = \"b\"\nleaves_um = 5",
                "row \"b\": leaves_um = 5: must be less than the 5 of \"a\"",
            ),
            (
                "[[row]]\nname = \"a\"\n[row.settings.gap]\nsetpoint_v = 500",
                "line 6: row \"a\": gap.setpoint_v = 500: must be a number from 1 to 300 V",
            ),
            ("[[row]]\nname = \"a\"\n[row.settings.gap]\nsetpiont_v = 50", "did you mean gap.setpoint_v?"),
            (
                "[[row]]\nname = \"a\"\n[row.settings.axis]\nmass_kg = 1",
                "line 6: row \"a\": axis.mass_kg = 1: cannot be part of a row: it may not change while the head is enabled",
            ),
            ("[[row]]\nname = \"a\"\ncolour = 1", "line 5: row \"a\": colour: no such entry; there are name,"),
            (
                "[[row]]\nname = \"a\"\ngenerator.on_us = 0",
                "generator.on_us = 0: must be a number from 0.1 to 10000 us",
            ),
            ("[[row]]\nname = \"a\"\ngenerator.polarity = 1", "must be \"electrode negative\" or"),
            ("[[row]]\nleaves_um = 0", "line 3: row: name is missing"),
            ("[[row]]\nname = ", "not TOML"),
        ] {
            let why = File::parse(&format!("{head}{rows}")).unwrap_err();
            assert!(why.contains(part), "{part}: {why}");
        }
        assert!(File::parse("work = \"steel\"\n[[row]]\nname = \"a\"").unwrap_err().contains("electrode is missing"));
    }

    #[test]
    fn settings_that_contradict_those_of_the_head_are_named_with_their_row() {
        let rows = "electrode = \"a\"\nwork = \"b\"\n[[row]]\nname = \"r\"\nsettings.jump.height_um = 900000";
        let why = File::parse(rows).unwrap().check(&Settings::default()).unwrap_err();
        assert!(why.starts_with("line 3: row \"r\": jump.height_um takes longer"), "{why}");
    }
}

//! Lists of what can be chosen: `edm-sim scenarios`, `edm-sim settings`.

use crate::events::{AT, Wires};
use crate::process::Plant;
use crate::run::Setup;
use crate::scenario::{BUILT_IN, typed};
use crate::terminal::Failure;
use edm_servo_head::settings::{Declared, Field, Kind, Settings};

/// Names and one-line descriptions.
pub fn scenarios() -> Result<String, Failure> {
    let width = BUILT_IN.iter().map(|(name, _)| name.len()).max().unwrap_or_default();
    BUILT_IN
        .iter()
        .map(|(name, text)| {
            let scenario = Setup::parse(name, text).map_err(Failure::Failed)?;
            let description = scenario.description.split_whitespace().collect::<Vec<_>>().join(" ");
            Ok(format!("{name:<width$}  {}. {description}\n", scenario.title.trim_end_matches('.')))
        })
        .collect()
}

/// Every key with unit, default, range, meaning and source; one line each, so that `grep` finds it whole.
pub fn settings() -> String {
    let mut rows = vec![["KEY", "DEFAULT", "UNIT", "ALLOWED", "MEANING (SOURCE)"].map(String::from)];
    let mut events = rows_of::<Wires>();
    events.insert(0, row(&AT, String::new()));
    let tables = [("[process]", rows_of::<Plant>()), ("[head]", rows_of::<Settings>()), ("[[event]]", events)];
    for (table, fields) in tables {
        rows.push([table.into(), String::new(), String::new(), String::new(), String::new()]);
        rows.extend(fields);
    }
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or_default();
    let [key, default, unit, allowed] = [0, 1, 2, 3].map(width);
    rows.iter()
        .map(|[k, d, u, a, m]| {
            format!("{k:<key$}  {d:<default$}  {u:<unit$}  {a:<allowed$}  {m}").trim_end().to_owned() + "\n"
        })
        .collect()
}

fn rows_of<D: Declared + Default>() -> Vec<[String; 5]> {
    let defaults = D::default();
    let default = |(index, field)| (field, defaults.get(index).map(|value| typed(value, field)).unwrap_or_default());
    D::FIELDS.iter().enumerate().map(default).map(|(field, value)| row(field, value)).collect()
}

fn row(field: &Field, value: String) -> [String; 5] {
    let meaning = field.doc.split_whitespace().collect::<Vec<_>>().join(" ");
    [field.key.into(), value, field.unit.into(), allowed(field), format!("{meaning} ({})", field.source)]
}

fn allowed(field: &Field) -> String {
    match field.kind {
        Kind::Number { min, max } => format!("{min} to {max}"),
        Kind::Integer { min, max } => format!("{min} to {max}, whole"),
        Kind::Flag => "true, false".into(),
        Kind::Choice(names) => names.iter().copied().filter(|name| !name.is_empty()).collect::<Vec<_>>().join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn no_key_is_declared_twice() {
        let mut seen = BTreeSet::new();
        for field in Plant::FIELDS.iter().chain(Settings::FIELDS).chain(Wires::FIELDS) {
            assert!(seen.insert(field.key), "{}", field.key);
        }
    }

    #[test]
    fn every_default_lies_within_its_limits() {
        assert_eq!(Plant::default().check(), Ok(()));
        assert_eq!(Settings::default().check(), Ok(()));
    }

    #[test]
    fn every_setting_has_one_line_with_all_that_is_known_of_it() {
        let table = settings();
        for field in Plant::FIELDS.iter().chain(Settings::FIELDS).chain(Wires::FIELDS) {
            let lines: Vec<&str> = table.lines().filter(|line| line.split(' ').next() == Some(field.key)).collect();
            assert_eq!(lines.len(), 1, "{}", field.key);
            for part in [field.unit, &allowed(field), field.source] {
                assert!(lines[0].contains(part), "{part} in {}", lines[0]);
            }
        }
    }

    #[test]
    fn every_scenario_that_comes_along_can_be_run() {
        for (name, text) in BUILT_IN {
            let setup = Setup::parse(name, text).unwrap();
            assert_eq!(crate::bore::check(&setup), Ok(()), "{name}");
        }
        assert_eq!(scenarios().unwrap().lines().count(), BUILT_IN.len());
    }
}

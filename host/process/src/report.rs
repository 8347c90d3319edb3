//! The gates as tables, as JSON, in docs/process-model.md and, with all that was found, in docs/process-model-tables.md.

use crate::frozen;
use crate::gates::{FACTOR, FINDINGS, Figure, GROUPS, Gate, RESULTS, Row, SHORT, sensitivity};
use crate::parameters::{DECLARED, MACHINES, Machine, OF_VERSION_1};
use serde::Serialize;
use std::fmt::Write;
use std::{fs, io};

/// Results of the gates.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Version of the model.
    pub version: u32,
    /// Fingerprint of the model that ran; `None` when it could not be taken.
    pub fingerprint: Option<String>,
    /// Whether that is the one of the version.
    pub frozen: bool,
    /// Each of the gates.
    pub gates: Vec<Gate>,
    /// Diagrams of the groups that have some.
    #[serde(skip)]
    pub figures: Vec<Drawn>,
    #[serde(skip)]
    tables: Vec<Table>,
}

/// Diagrams of a group of gates.
#[derive(Debug)]
pub struct Drawn {
    /// Name of the group.
    pub name: &'static str,
    /// What it is about.
    pub about: &'static str,
    /// The diagrams.
    pub figures: Vec<Figure>,
}

/// A table for a page, by the name of its place there.
#[derive(Debug)]
pub struct Table {
    page: &'static str,
    name: String,
    text: String,
}

/// The page on the model: what was found of each gate.
const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/process-model.md");
/// Numbers, and all that belongs to what was found.
const TABLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/process-model-tables.md");

fn table(page: &'static str, name: impl Into<String>, text: String) -> Table {
    Table { page, name: name.into(), text }
}

/// Groups by their names; all without a name, the short ones for `short`.
///
/// # Errors
/// A name that no group has.
pub fn choose(version: u32, names: &[String], short: bool) -> Result<Vec<&'static str>, String> {
    let all: Vec<&'static str> = GROUPS.iter().map(|group| group.name).collect();
    if let Some(unknown) = names.iter().find(|name| !all.contains(&name.as_str())) {
        return Err(format!("{unknown}: no such group of gates; there are {}", all.join(", ")));
    }
    let wanted = |name: &&str| match (names.is_empty(), short) {
        (false, _) => names.iter().any(|other| other == name),
        (true, true) => SHORT.contains(name),
        // Version 1 is held to its own.
        (true, false) => version > 1 || !FINDINGS.contains(name),
    };
    Ok(all.into_iter().filter(wanted).collect())
}

/// Runs groups of gates and says what came of each.
pub fn run(version: u32, chosen: &[&str], mut say: impl FnMut(&str)) -> Report {
    let fingerprint = frozen::fingerprint(version).ok();
    let frozen = fingerprint.is_some_and(|hash| frozen::FINGERPRINTS.contains(&(version, hash)));
    let mut report = Report {
        version,
        fingerprint: fingerprint.map(|hash| format!("{hash:016x}")),
        frozen,
        gates: Vec::new(),
        figures: Vec::new(),
        tables: vec![table(TABLES, "parameters", parameters()), table(TABLES, "numbers of version 2", second())],
    };
    let is = if frozen { "unchanged" } else { "CHANGED: needs a new version, with its own gates" };
    say(&format!("model version {}, everything simulated: {is}\n", version));
    for group in GROUPS.iter().filter(|group| chosen.contains(&group.name)) {
        say(&format!("{}: {}\n", group.name, group.about));
        let found = (group.run)(version);
        // The page has those of the newest version.
        if version == 2 {
            report.tables.push(table(PAGE, format!("gates of {}", group.name), results(&found)));
            report.tables.push(table(TABLES, format!("runs of {}", group.name), notes(&found)));
        }
        let figures: Vec<Figure> = found.iter().flat_map(|gate| gate.figures.clone()).collect();
        if !figures.is_empty() {
            report.figures.push(Drawn { name: group.name, about: group.about, figures });
        }
        for gate in found {
            let met = match (gate.pass, gate.is_open(version)) {
                (true, _) => "met",
                (false, true) => "OPEN",
                (false, false) => "NOT MET",
            };
            say(&format!("  {met:7}  {} (wanted {})  {}\n", shown(gate.value), gate.wanted, gate.name));
            if !gate.note.is_empty() {
                say(&format!("           {}\n", gate.note));
            }
            report.gates.push(gate);
        }
    }
    report
}

/// Diagrams of a group of gates on a version of the model.
pub fn figures(version: u32, name: &str) -> Vec<Figure> {
    let groups = GROUPS.iter().filter(|group| group.name == name);
    groups.flat_map(|group| (group.run)(version)).flat_map(|gate| gate.figures).collect()
}

impl Report {
    /// Whether the model is unchanged and all required gates are met, except those known to be open, which must still be open.
    pub fn holds(&self) -> bool {
        self.frozen && self.gates.iter().filter(|gate| gate.must()).all(|gate| gate.pass != gate.is_open(self.version))
    }

    /// Writes the tables into their pages.
    ///
    /// # Errors
    /// When a page cannot be written, or has no place for one of them.
    pub fn write_pages(&self) -> Result<(), String> {
        self.tables.iter().try_for_each(Table::write)
    }
}

/// Multiplies and divides every assumed number by [`FACTOR`], one at a time, and gives the table.
pub fn run_sensitivity(version: u32) -> Table {
    table(TABLES, "sensitivity", sensitivities(&sensitivity(version)))
}

fn shown(value: f64) -> String {
    if value != 0.0 && value.abs() < 1e-3 { format!("{value:.1e}") } else { format!("{value:.3}") }
}

impl Table {
    /// The table.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Replaces the text between its marks in its page.
    ///
    /// # Errors
    /// When the page cannot be written, or has no place for it.
    pub fn write(&self) -> Result<(), String> {
        let Table { page: file, name, text } = self;
        let failed = |error: io::Error| format!("{file}: {error}");
        let mut page = fs::read_to_string(file).map_err(failed)?;
        let (begin, end) = (format!("<!-- {name}: written by model-report -->\n"), format!("<!-- end of {name} -->"));
        let (Some(from), Some(to)) = (page.find(&begin), page.find(&end)) else {
            return Err(format!("{file} has no place for the table of {name}"));
        };
        page.replace_range(from + begin.len()..to, text);
        fs::write(file, page).map_err(failed)
    }
}

fn results(gates: &[Gate]) -> String {
    let mut table = String::from("| gate | kind | found | wanted | met |\n| --- | --- | --- | --- | --- |\n");
    for Gate { name, kind, value, wanted, pass, .. } in gates {
        let (kind, met) = (format!("{kind:?}").to_lowercase(), if *pass { "yes" } else { "**no**" });
        let _ = writeln!(table, "| {name} | {kind} | {} | {wanted} | {met} |", shown(*value));
    }
    table
}

fn notes(gates: &[Gate]) -> String {
    let mut notes = String::new();
    for Gate { name, note, .. } in gates {
        if !note.is_empty() && !notes.contains(note.as_str()) {
            let _ = writeln!(notes, "- {name}: {note}.");
        }
    }
    notes
}

/// Head of a table of parameters, a column for each machine.
fn header() -> String {
    let mut table = String::from("| parameter | unit |");
    for Machine { name, .. } in MACHINES {
        let _ = write!(table, " {name} |");
    }
    table += " what it is | rests on |\n| --- | --- |";
    table += &" --- |".repeat(MACHINES.len());
    table += " --- | --- |\n";
    table
}

fn parameters() -> String {
    let mut table = header();
    for (k, declared) in DECLARED.iter().enumerate().take(OF_VERSION_1) {
        let value = |machine: &Machine| machine.parameters().values().nth(k).unwrap_or(f64::NAN);
        let _ = write!(table, "| `{}` | {} |", declared.key, declared.unit);
        for machine in &MACHINES {
            let _ = write!(table, " {} |", value(machine));
        }
        let mut bases = vec![declared.basis.to_string()];
        let mut last: Option<(&str, String)> = None;
        for machine in MACHINES.iter().skip(1) {
            let Some(own) = machine.differences.iter().find(|own| own.key == declared.key) else { continue };
            let basis = own.basis.to_string();
            match &mut last {
                // The settings of one machine mostly rest on the same.
                Some((of, said)) if *said == basis => bases.retain(|b| *b != format!("{of}: {said}")),
                _ => {}
            }
            let of = match &last {
                Some((of, said)) if *said == basis => format!("{of}, {}", machine.name),
                _ => machine.name.to_string(),
            };
            bases.push(format!("{of}: {basis}"));
            last = Some((machine.name, basis));
        }
        let _ = writeln!(table, " {} | {} |", declared.doc.trim(), bases.join("; "));
    }
    table
}

/// The numbers of which version 2 has others than version 1, or has alone.
fn second() -> String {
    let mut table = header();
    for (k, declared) in DECLARED.iter().enumerate() {
        let value = |machine: &Machine, version| machine.of(version).values().nth(k).unwrap_or(f64::NAN);
        let differs = |machine: &&Machine| value(machine, 1) != value(machine, 2);
        if k < OF_VERSION_1 && !MACHINES.iter().any(|machine| differs(&machine)) {
            continue;
        }
        let _ = write!(table, "| `{}` | {} |", declared.key, declared.unit);
        let mut bases: Vec<String> = Vec::new();
        for machine in &MACHINES {
            let _ = write!(table, " {} |", value(machine, 2));
            let basis = machine.basis(2, declared.key).map(|basis| basis.to_string());
            bases.extend(basis.filter(|basis| !bases.contains(basis)));
        }
        let _ = writeln!(table, " {} | {} |", declared.doc.trim(), bases.join("; "));
    }
    table
}

/// What each number moves, in percent of the result as it is; what moves by less than a twentieth is left out.
fn sensitivities(rows: &[Row]) -> String {
    const SHOWN: f64 = 5.0;
    let Some((as_is, rows)) = rows.split_first() else { return String::new() };
    let mut table = format!("| parameter | {} |\n|{}\n", RESULTS.join(" | "), " --- |".repeat(RESULTS.len() + 1));
    let _ = write!(table, "| as it is |");
    for result in as_is.results {
        let _ = write!(table, " {} |", shown(result));
    }
    table += "\n";
    let mut little = Vec::new();
    for pair in rows.chunks(2) {
        let [down, up] = pair else { continue };
        let percent = |row: &Row, k: usize| 100.0 * (row.results[k] / as_is.results[k] - 1.0);
        let moves = |k: usize| percent(down, k).abs().max(percent(up, k).abs()) >= SHOWN;
        if !(0..RESULTS.len()).any(moves) {
            little.push(format!("`{}`", down.key));
            continue;
        }
        let _ = write!(table, "| `{}` |", down.key);
        for k in 0..RESULTS.len() {
            let one = |percent: f64| if percent.is_nan() { "refused".to_string() } else { format!("{percent:+.0}") };
            let (down, up) = (percent(down, k), percent(up, k));
            let shows = moves(k) || down.is_nan() || up.is_nan();
            let cell = if shows { format!("{} / {}", one(down), one(up)) } else { String::new() };
            let _ = write!(table, " {cell} |");
        }
        table += "\n";
    }
    let _ = writeln!(
        table,
        "\nDivided / multiplied by {FACTOR}: change in %, where it is 5 or more. Nothing by 5 % or more: {}.",
        little.join(", ")
    );
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_show_the_parameters_as_they_are() {
        let page = fs::read_to_string(TABLES).unwrap();
        assert!(page.contains(&parameters()), "cargo sim model-report charging --docs");
        assert!(page.contains(&second()), "cargo sim model-report charging --docs");
    }

    #[test]
    fn groups_have_names_of_their_own() {
        for (k, group) in GROUPS.iter().enumerate() {
            assert!(GROUPS.iter().skip(k + 1).all(|other| other.name != group.name), "{}", group.name);
        }
    }
}

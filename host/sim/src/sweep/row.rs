//! A row: one run in a table, as CSV or as a line of JSON.
//!
//! Both have the same columns: [`FIRST`], the keys that the grid varies, [`FIGURES`] and [`LAST`]. What a run did not give is
//! an empty cell or `null`. Nothing in a row depends on the computer or on the order in which runs were made.

use super::bounds;
use super::figures::FIGURES;
use super::grid::{Grid, Run};
use crate::report::Report;
use serde_json::{Map, Value, json};

/// Columns that say which run it is: fingerprint of the grid, number of the run and of how many, and what was bored.
pub const FIRST: [&str; 6] = ["grid", "run", "runs", "scenario", "seed", "target_depth_mm"];
/// Columns behind the figures: bounds that are broken, and why there are no figures.
pub const LAST: [&str; 2] = ["broken", "error"];

/// How rows are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Comma-separated values with a line of column names.
    Csv,
    /// One JSON object a line.
    Json,
}

/// Names of the columns for a grid that varies these keys.
pub fn columns(keys: &[String]) -> Vec<String> {
    let figures = FIGURES.iter().map(|(name, _)| *name);
    let first = FIRST.into_iter().chain(keys.iter().map(String::as_str));
    first.chain(figures).chain(LAST).map(str::to_owned).collect()
}

/// The cells of a run by the names of their columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Row(Map<String, Value>);

impl Row {
    /// The row of a run that was made, or could not be.
    pub fn new(grid: &Grid, run: &Run<'_>, result: &Result<Report, String>) -> Row {
        let job = &run.job;
        let first = [
            json!(grid.fingerprint),
            json!(run.number),
            json!(grid.len()),
            json!(job.label()),
            json!(job.seed),
            json!(job.depth_mm),
        ];
        let mut cells: Map<String, Value> = FIRST.iter().map(|name| (*name).to_owned()).zip(first).collect();
        cells.extend(grid.keys.iter().cloned().zip(run.values.iter().map(|word| json!(word))));
        for (name, figure) in FIGURES {
            cells.insert((*name).into(), result.as_ref().map_or(Value::Null, figure));
        }
        let last = match result {
            Ok(report) => [json!(bounds::broken(report).join("; ")), Value::Null],
            Err(message) => [Value::Null, json!(message.lines().collect::<Vec<_>>().join(" "))],
        };
        cells.extend(LAST.iter().map(|name| (*name).to_owned()).zip(last));
        Row(cells)
    }

    /// A cell; `None` when it is empty.
    pub fn text(&self, column: &str) -> Option<String> {
        match self.0.get(column)? {
            Value::Null => None,
            Value::String(text) if text.is_empty() => None,
            Value::String(text) => Some(text.clone()),
            other => Some(other.to_string()),
        }
    }

    /// A cell with a number.
    pub fn number(&self, column: &str) -> Option<f64> {
        self.text(column)?.parse().ok()
    }

    /// Number of the run.
    pub fn run(&self) -> Option<usize> {
        self.text("run")?.parse().ok()
    }
}

impl Format {
    /// The line before the first row.
    pub fn heading(self, columns: &[String]) -> String {
        match self {
            Format::Csv => csv_line(columns.iter().map(String::as_str)),
            Format::Json => String::new(),
        }
    }

    /// A row as a line, its end included.
    pub fn line(self, columns: &[String], row: &Row) -> String {
        match self {
            Format::Csv => {
                let cells: Vec<String> = columns.iter().map(|name| row.text(name).unwrap_or_default()).collect();
                csv_line(cells.iter().map(String::as_str))
            }
            Format::Json => {
                let cell = |name: &String| format!("{}:{}", json!(name), row.0.get(name).unwrap_or(&Value::Null));
                format!("{{{}}}\n", columns.iter().map(cell).collect::<Vec<_>>().join(","))
            }
        }
    }

    /// The row in a line of a table with these columns; `None` when it is none.
    pub fn row(self, columns: &[String], line: &str) -> Option<Row> {
        let cells: Map<String, Value> = match self {
            Format::Csv => {
                let cells = csv_cells(line)?;
                (cells.len() == columns.len())
                    .then(|| columns.iter().cloned().zip(cells.into_iter().map(Value::String)).collect())?
            }
            Format::Json => serde_json::from_str(line).ok()?,
        };
        let whole = cells.len() == columns.len() && columns.iter().all(|name| cells.contains_key(name));
        whole.then_some(Row(cells))
    }
}

fn csv_line<'a>(cells: impl Iterator<Item = &'a str>) -> String {
    let mut line = csv::Writer::from_writer(Vec::new());
    // A vector takes everything.
    let _ = line.write_record(cells);
    String::from_utf8(line.into_inner().unwrap_or_default()).unwrap_or_default()
}

/// The cells of a line.
pub fn csv_cells(line: &str) -> Option<Vec<String>> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(line.as_bytes());
    let record = reader.records().next()?.ok()?;
    Some(record.iter().map(str::to_owned).collect())
}

//! `edm-sim sweep merge`: the files of shards become the table of the whole grid.

use super::row::{Format, Row, csv_cells};
use super::table;
use crate::output::Output;
use crate::terminal::{Failure, say};
use clap::Args;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Arguments of `edm-sim sweep merge`.
#[derive(Debug, Args)]
pub struct Merge {
    /// Tables of the shards, all CSV or all JSON lines
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<PathBuf>,
    /// Write the whole table to this file and check the bounds; default: standard output
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// What the files hold.
#[derive(Debug, Default)]
pub struct Whole {
    /// Format, columns and line of their names.
    table: Option<(Format, Vec<String>, String)>,
    /// Fingerprint and number of runs.
    grid: Option<(String, usize)>,
    rows: BTreeMap<usize, (String, Row)>,
}

impl Merge {
    /// Merges; true when every bound is kept.
    ///
    /// # Errors
    /// When a file is not a table of the same grid, or a run is missing.
    pub fn execute(&self) -> Result<bool, Failure> {
        let whole = Whole::read(&self.files).map_err(Failure::BadInput)?;
        let out = Output::claim_any("--out", self.out.as_deref()).map_err(Failure::BadInput)?;
        whole.missing().map_err(Failure::BadInput)?;
        let heading = whole.table.as_ref().map_or("", |(.., heading)| heading);
        let lines = whole.rows.values().map(|(line, _)| line.as_str());
        let text: String = std::iter::once(heading).chain(lines).collect();
        let rows: Vec<Row> = whole.rows();
        let (table, broken) = table::evaluate(&rows);
        match out {
            Some(out) => {
                out.write(|file| file.write_all(text.as_bytes())).map_err(Failure::Failed)?;
                say(&table);
            }
            None => say(&text),
        }
        Ok(broken == 0)
    }
}

impl Whole {
    /// Reads the tables of all shards.
    ///
    /// # Errors
    /// File and line of what is no row, or of another grid.
    pub fn read(files: &[PathBuf]) -> Result<Whole, String> {
        let mut whole = Whole::default();
        for path in files {
            let name = path.display();
            let text = std::fs::read_to_string(path).map_err(|error| format!("{name}: cannot be read: {error}"))?;
            whole.add(&text).map_err(|reason| format!("{name}: {reason}"))?;
        }
        Ok(whole)
    }

    /// The rows in their order.
    pub fn rows(&self) -> Vec<Row> {
        self.rows.values().map(|(_, row)| row.clone()).collect()
    }

    fn add(&mut self, text: &str) -> Result<(), String> {
        const OTHER: &str = "is not a table of the same grid as the files before it";
        let first = text.lines().next().unwrap_or_default();
        let json = first.starts_with('{');
        let (columns, heading) = if json {
            let cells: serde_json::Map<String, serde_json::Value> =
                serde_json::from_str(first).map_err(|_| "is not a table of a sweep")?;
            (cells.keys().cloned().collect(), "")
        } else {
            (csv_cells(first).unwrap_or_default(), text.split_inclusive('\n').next().unwrap_or_default())
        };
        let format = if json { Format::Json } else { Format::Csv };
        if !["grid", "run", "runs", "error"].iter().all(|name| columns.iter().any(|column| column == name)) {
            return Err("is not a table of a sweep".into());
        }
        let table = self.table.get_or_insert_with(|| (format, columns.clone(), heading.to_owned()));
        if (table.0, table.1.as_slice()) != (format, columns.as_slice()) {
            return Err(OTHER.into());
        }
        // What a killed program has left behind the last end of line is no row.
        let lines =
            text.get(heading.len()..).unwrap_or_default().split_inclusive('\n').filter(|line| line.ends_with('\n'));
        for (at, line) in lines.enumerate() {
            let number = at + 1 + usize::from(!json);
            let row = format.row(&columns, line).ok_or_else(|| format!("line {number} is not a row of a sweep"))?;
            let cells = (row.text("grid"), row.number("runs"), row.run());
            let (Some(grid), Some(runs), Some(run)) = cells else {
                return Err(format!("line {number} is not a row of a sweep"));
            };
            let grid = (grid, runs as usize);
            if *self.grid.get_or_insert_with(|| grid.clone()) != grid {
                return Err(OTHER.into());
            }
            match self.rows.get(&run) {
                Some((other, _)) if other != line => {
                    return Err(format!("line {number}: run {run} is twice in the files, with different content"));
                }
                _ => self.rows.insert(run, (line.to_owned(), row)),
            };
        }
        Ok(())
    }

    /// # Errors
    /// When a run of the grid is not there.
    pub fn missing(&self) -> Result<(), String> {
        let runs = self.grid.as_ref().map_or(0, |(_, runs)| *runs);
        let missing: Vec<usize> = (1..=runs).filter(|run| !self.rows.contains_key(run)).collect();
        match missing.first() {
            _ if runs == 0 => Err("the files have no rows".into()),
            Some(first) => {
                Err(format!("{} of {runs} runs are missing, the first of them is run {first}", missing.len()))
            }
            None => Ok(()),
        }
    }
}

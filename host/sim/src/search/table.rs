//! The table of a search: a row for each set of parameters.

use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::path::Path;

/// A set of parameters that was tried.
#[derive(Clone, Debug, Default)]
pub struct Tried {
    /// Values of the law's dimensions.
    pub values: Vec<f64>,
    /// Less is better; 0 is the reference.
    pub score: f64,
    /// Geometric mean of times over those of the reference.
    pub time_ratio: f64,
    /// Share of arcs, and that of the reference, %.
    pub arc_percent: f64,
    pub reference_arc_percent: f64,
    /// Mean of the wear over that of the reference.
    pub wear_ratio: f64,
    /// Holes that were not finished.
    pub unfinished: u32,
    /// As a command line takes them.
    pub settings: String,
}

/// A row of the file.
#[derive(Debug, Deserialize, Serialize)]
struct Line {
    search: String,
    values: String,
    score: f64,
    time_ratio: f64,
    arc_percent: f64,
    reference_arc_percent: f64,
    wear_ratio: f64,
    unfinished: u32,
    settings: String,
}

/// What was tried so far.
#[derive(Debug)]
pub struct Table {
    search: String,
    rows: Vec<Tried>,
    file: Option<csv::Writer<File>>,
}

fn key(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

impl Table {
    /// The rows of a file, to which further ones are added; a new one where there is none.
    ///
    /// # Errors
    /// When the file is of another search, or cannot be read or written.
    pub fn open(path: Option<&Path>, search: &str) -> Result<Table, String> {
        let Some(path) = path else { return Ok(Table { search: search.into(), rows: Vec::new(), file: None }) };
        let refused = |error: &dyn std::fmt::Display| format!("--csv {}: {error}", path.display());
        let exists = path.exists() && path.metadata().is_ok_and(|data| data.len() > 0);
        let rows = if exists {
            let before = Table::read(path)?;
            if !before.rows.is_empty() && before.search != search {
                return Err(refused(&format!("is of another search, {}; this one is {search}", before.search)));
            }
            before.rows
        } else {
            Vec::new()
        };
        let file = OpenOptions::new().create(true).append(true).open(path).map_err(|error| refused(&error))?;
        let writer = csv::WriterBuilder::new().has_headers(!exists).from_writer(file);
        Ok(Table { search: search.into(), rows, file: Some(writer) })
    }

    /// The rows of a file.
    ///
    /// # Errors
    /// When it cannot be read, or is no table of one search.
    pub fn read(path: &Path) -> Result<Table, String> {
        let refused = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
        let mut table = Table { search: String::new(), rows: Vec::new(), file: None };
        let mut reader = csv::Reader::from_path(path).map_err(|error| refused(&error))?;
        for line in reader.deserialize::<Line>() {
            let line = line.map_err(|error| refused(&error))?;
            if table.rows.is_empty() {
                table.search.clone_from(&line.search);
            } else if table.search != line.search {
                return Err(refused(&format!("has rows of {} and of {}", table.search, line.search)));
            }
            let values = line.values.split(' ').map(str::parse).collect::<Result<_, _>>();
            table.rows.push(Tried {
                values: values.map_err(|error| refused(&error))?,
                score: line.score,
                time_ratio: line.time_ratio,
                arc_percent: line.arc_percent,
                reference_arc_percent: line.reference_arc_percent,
                wear_ratio: line.wear_ratio,
                unfinished: line.unfinished,
                settings: line.settings,
            });
        }
        Ok(table)
    }

    /// Law, machine, shard and holes.
    pub fn search(&self) -> &str {
        &self.search
    }

    /// Score of values that were tried.
    pub fn score(&self, values: &[f64]) -> Option<f64> {
        self.rows.iter().find(|tried| tried.values == values).map(|tried| tried.score)
    }

    /// One more.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add(&mut self, tried: Tried) -> Result<(), String> {
        if let Some(file) = &mut self.file {
            let line = Line {
                search: self.search.clone(),
                values: key(&tried.values),
                score: tried.score,
                time_ratio: tried.time_ratio,
                arc_percent: tried.arc_percent,
                reference_arc_percent: tried.reference_arc_percent,
                wear_ratio: tried.wear_ratio,
                unfinished: tried.unfinished,
                settings: tried.settings.clone(),
            };
            let written = file.serialize(line).map_err(|error| error.to_string());
            written
                .and_then(|()| file.flush().map_err(|error| error.to_string()))
                .map_err(|error| format!("--csv: {error}"))?;
        }
        self.rows.push(tried);
        Ok(())
    }

    /// All rows.
    pub fn rows(&self) -> impl Iterator<Item = &Tried> {
        self.rows.iter()
    }
}

//! Rows in a file, as they finish: interrupted at any moment, the file can be continued.
//!
//! A row is appended in one write, its end of line last; what a killed program has left behind the last end of line is no
//! row and is cut off. When all is done the rows are put in the order of their numbers, in a new file that replaces
//! the old one, so that it does not matter in which order, or in how many attempts, they were made.

use super::grid::Grid;
use super::row::{Format, Row, columns};
use crate::output::Output;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

/// A table in the making.
#[derive(Debug)]
pub struct RowFile {
    output: Output,
    format: Format,
    columns: Vec<String>,
    /// Rows with their numbers, as lines.
    lines: BTreeMap<usize, String>,
    rows: BTreeMap<usize, Row>,
    /// Length of what is whole.
    length: u64,
    sorted: bool,
    file: Option<File>,
}

impl RowFile {
    /// Claims a file, and reads what is there of this grid. Nothing is written.
    ///
    /// # Errors
    /// When it cannot be written, or holds anything but rows of this grid.
    pub fn claim(option: &str, path: &Path, format: Format, grid: &Grid) -> Result<RowFile, String> {
        let output = Output::claim(option, path)?;
        let columns = columns(&grid.keys);
        let mut found = RowFile {
            output,
            format,
            columns,
            lines: BTreeMap::new(),
            rows: BTreeMap::new(),
            length: 0,
            sorted: true,
            file: None,
        };
        if path.exists() {
            let label = found.output.label().to_owned();
            let refused = |reason: &str| format!("{label}: {reason}");
            if !path.is_file() {
                return Err(refused("must be a file, so that it can be continued"));
            }
            let bytes = std::fs::read(path).map_err(|error| refused(&format!("cannot be read: {error}")))?;
            let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
            let other = "has other content than rows of this grid; the file is unchanged";
            let text = std::str::from_utf8(bytes.get(..whole).unwrap_or_default()).map_err(|_| refused(other))?;
            found.read(text, grid).ok_or_else(|| refused(other))?;
            let rest = bytes.get(whole..).unwrap_or_default();
            if whole == 0
                && !found.begins().as_bytes().starts_with(rest)
                && !rest.starts_with(found.begins().as_bytes())
            {
                return Err(refused(other));
            }
            found.length = whole as u64;
        }
        Ok(found)
    }

    /// What every file of this grid begins with.
    fn begins(&self) -> String {
        match self.format {
            Format::Csv => self.format.heading(&self.columns),
            Format::Json => "{\"grid\":\"".into(),
        }
    }

    fn read(&mut self, text: &str, grid: &Grid) -> Option<()> {
        let heading = self.format.heading(&self.columns);
        let body = if text.is_empty() { "" } else { text.strip_prefix(heading.as_str())? };
        let mut last = 0;
        for line in body.split_inclusive('\n') {
            let row = self.format.row(&self.columns, line)?;
            let run = row.run().filter(|run| (1..=grid.len()).contains(run))?;
            if row.text("grid").as_deref() != Some(grid.fingerprint.as_str()) {
                return None;
            }
            self.sorted &= run > last;
            last = run;
            self.lines.insert(run, line.to_owned());
            self.rows.insert(run, row);
        }
        Some(())
    }

    /// Option and path, as given.
    pub fn output(&self) -> &Output {
        &self.output
    }

    /// The row of a run that has been made.
    pub fn row(&self, run: usize) -> Option<&Row> {
        self.rows.get(&run)
    }

    /// Whether it has this row as it is now written.
    pub fn holds(&self, run: usize, row: &Row) -> bool {
        self.lines.get(&run).is_some_and(|line| *line == self.format.line(&self.columns, row))
    }

    /// Opens the file, cuts off what is not whole, and writes the names of the columns if they are not there.
    ///
    /// # Errors
    /// When it cannot be written, or another sweep is writing it.
    pub fn begin(&mut self) -> Result<(), String> {
        let failed = |error: &dyn std::fmt::Display| format!("{}: could not be written: {error}", self.output.label());
        let open = OpenOptions::new().create(true).truncate(false).write(true).open(self.output.target());
        let mut file = open.map_err(|error| failed(&error))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(failed(&"another sweep is writing it")),
            // A file system without locks.
            Err(TryLockError::Error(_)) => {}
        }
        let begun = file.set_len(self.length).and_then(|()| file.seek(SeekFrom::End(0)));
        begun.map_err(|error| failed(&error))?;
        if self.length == 0 {
            file.write_all(self.format.heading(&self.columns).as_bytes()).map_err(|error| failed(&error))?;
        }
        self.file = Some(file);
        Ok(())
    }

    /// Appends a row, unless it is there.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn append(&mut self, run: usize, row: &Row) -> Result<(), String> {
        if self.lines.contains_key(&run) {
            return Ok(());
        }
        let line = self.format.line(&self.columns, row);
        if let Some(file) = &mut self.file {
            let written = file.write_all(line.as_bytes());
            written.map_err(|error| format!("{}: could not be written: {error}", self.output.label()))?;
        }
        self.sorted &= self.lines.last_key_value().is_none_or(|(last, _)| *last < run);
        self.lines.insert(run, line);
        Ok(())
    }

    /// Puts the rows in order.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(self) -> Result<(), String> {
        if self.sorted {
            return Ok(());
        }
        let heading = self.format.heading(&self.columns);
        self.output.write(|file| {
            file.write_all(heading.as_bytes())?;
            self.lines.values().try_for_each(|line| file.write_all(line.as_bytes()))
        })
    }
}

//! `edm-sim path-report`: the accuracy of the path in both directions.

use crate::output::Output;
use crate::page::Page;
use crate::path_report::measure;
use crate::terminal::{Failure, say};
use clap::Args;
use std::path::PathBuf;

/// Page with the table.
pub const PAGE: &str = "docs/path.md";
/// The command, as the page names it.
pub const COMMAND: &str = "cargo sim path-report";

/// Arguments of `edm-sim path-report`.
#[derive(Debug, Args)]
pub struct PathReport {
    /// Reversals on the mixed path
    #[arg(long, default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1_000..=1_000_000_000))]
    reversals: u64,
    /// Write the figures as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the table into docs/path.md
    #[arg(long)]
    docs: bool,
}

impl PathReport {
    /// Measures and reports; true when everything is within its bound.
    ///
    /// # Errors
    /// When an output cannot be written.
    pub fn execute(&self) -> Result<bool, Failure> {
        let json = Output::claim_any("--json", self.json.as_deref()).map_err(Failure::BadInput)?;
        let page = self.docs.then(|| Page::of_project(PAGE, COMMAND)).transpose().map_err(Failure::BadInput)?;
        let report = measure(self.reversals).map_err(Failure::Failed)?;
        say(&report.table());
        if let Some(output) = json {
            output.write_json(&report).map_err(Failure::Failed)?;
        }
        if let Some((page, output)) = page {
            page.write(output, &format!("\n{}\n", report.table())).map_err(Failure::Failed)?;
        }
        Ok(report.holds())
    }
}

//! `edm-sim gap-report`: the accuracy of the gap estimators.

use crate::gap_report::{Size, measure};
use crate::output::Output;
use crate::page::Page;
use crate::terminal::{Failure, say};
use clap::Args;
use std::path::PathBuf;

/// Page with the tables.
pub const PAGE: &str = "docs/gap-sensing.md";
/// The command, as the page names it.
pub const COMMAND: &str = "cargo sim gap-report";

/// Arguments of `edm-sim gap-report`.
#[derive(Debug, Args)]
pub struct GapReport {
    /// Run a tenth of the pulses and of the seeds: 15 seconds
    #[arg(long, conflicts_with = "docs")]
    short: bool,
    /// Write the figures as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the tables into docs/gap-sensing.md
    #[arg(long)]
    docs: bool,
}

impl GapReport {
    /// Measures and reports; true when everything is within its bound.
    ///
    /// # Errors
    /// When an output cannot be written.
    pub fn execute(&self) -> Result<bool, Failure> {
        let json = Output::claim_any("--json", self.json.as_deref()).map_err(Failure::BadInput)?;
        let page = self.docs.then(|| Page::of_project(PAGE, COMMAND)).transpose().map_err(Failure::BadInput)?;
        let report = measure(if self.short { &Size::SHORT } else { &Size::FULL }).map_err(Failure::Failed)?;
        say(&report.tables);
        for failed in &report.failed {
            say(&format!("not met: {failed}\n"));
        }
        if let Some(output) = json {
            output.write_json(&report).map_err(Failure::Failed)?;
        }
        if let Some((page, output)) = page {
            page.write(output, &format!("\n{}\n", report.tables)).map_err(Failure::Failed)?;
        }
        Ok(report.holds())
    }
}

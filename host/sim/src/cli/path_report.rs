//! `edm-sim path-report`: how exactly a path is gone along and back.

use crate::output::Output;
use crate::page::{Page, in_project};
use crate::path_report::measure;
use crate::terminal::{Failure, say};
use clap::Args;
use std::path::{Path, PathBuf};

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
        let claim = |path: &Path| Output::claim("--json", path);
        let json = self.json.as_deref().map(claim).transpose().map_err(Failure::BadInput)?;
        let page = self.docs.then(|| Page::read(&in_project(Path::new(PAGE))?, COMMAND)).transpose();
        let page =
            page.and_then(|page| page.map(|page| Ok((page.claim()?, page))).transpose()).map_err(Failure::BadInput)?;
        let report = measure(self.reversals).map_err(Failure::Failed)?;
        say(&report.table());
        if let Some(output) = json {
            let write = output.write(|file| {
                serde_json::to_writer_pretty(&mut *file, &report)?;
                file.write_all(b"\n")
            });
            write.map_err(Failure::Failed)?;
        }
        if let Some((output, page)) = page {
            page.write(output, &format!("\n{}\n", report.table())).map_err(Failure::Failed)?;
        }
        Ok(report.holds())
    }
}

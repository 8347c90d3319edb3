//! `edm-sim model-report`: the gates of the process model, which `host/process` holds.

use crate::output::Output;
use crate::terminal::{Failure, say};
use clap::Args;
use edm_process::report;
use std::path::PathBuf;

/// Arguments of `edm-sim model-report`.
#[derive(Debug, Args)]
pub struct ModelReport {
    /// Groups of gates [default: all]
    #[arg(value_name = "GROUP")]
    groups: Vec<String>,
    /// Version of the model
    #[arg(long, value_name = "VERSION", default_value_t = edm_process::frozen::VERSION, value_parser = clap::value_parser!(u32).range(1..=2))]
    model: u32,
    /// Only the groups that take a few seconds
    #[arg(long, conflicts_with = "groups")]
    short: bool,
    /// Write version, fingerprint and gates as JSON
    #[arg(long, value_name = "FILE", conflicts_with = "sensitivity")]
    json: Option<PathBuf>,
    /// Write the tables of the groups that run into docs/process-model.md
    #[arg(long)]
    docs: bool,
    /// Multiply and divide every assumed number by 1.5, one at a time, instead of running the gates; takes minutes
    #[arg(long, conflicts_with_all = ["groups", "short"])]
    sensitivity: bool,
}

impl ModelReport {
    /// Runs and reports; true when the model is unchanged and all required gates are met.
    ///
    /// # Errors
    /// When a group is unknown, or an output cannot be written.
    pub fn execute(&self) -> Result<bool, Failure> {
        let chosen = report::choose(self.model, &self.groups, self.short).map_err(Failure::BadInput)?;
        let json = Output::claim_any("--json", self.json.as_deref()).map_err(Failure::BadInput)?;
        if self.sensitivity {
            let table = report::run_sensitivity(self.model);
            say(&table);
            let page = |table| report::into_page(&[("sensitivity".into(), table)]);
            return if self.docs { page(table).map(|()| true).map_err(Failure::Failed) } else { Ok(true) };
        }
        let report = report::run(self.model, &chosen, say);
        if let Some(output) = json {
            output.write_json(&report).map_err(Failure::Failed)?;
        }
        if self.docs {
            report.write_page().map_err(Failure::Failed)?;
        }
        Ok(report.holds())
    }
}

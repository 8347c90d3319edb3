//! `edm-sim model-report`: the gates of the process model, which `host/process` holds.

use crate::output::Output;
use crate::plot;
use crate::terminal::{Failure, say};
use clap::Args;
use edm_process::report;
use std::fs;
use std::path::{Path, PathBuf};

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
    /// Draw the groups that run into this folder, an SVG each
    #[arg(long, value_name = "DIR", conflicts_with = "sensitivity")]
    plot: Option<PathBuf>,
    /// With --plot: draw version 1 beside, dashed; takes twice the time
    #[arg(long, requires = "plot")]
    beside: bool,
    /// Write the tables of the groups that run into docs/process-model.md and docs/process-model-tables.md
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
            say(table.text());
            return if self.docs { table.write().map(|()| true).map_err(Failure::Failed) } else { Ok(true) };
        }
        let report = report::run(self.model, &chosen, say);
        if let Some(output) = json {
            output.write_json(&report).map_err(Failure::Failed)?;
        }
        if let Some(folder) = &self.plot {
            self.draw(&report, folder).map_err(Failure::Failed)?;
        }
        if self.docs {
            report.write_pages().map_err(Failure::Failed)?;
        }
        Ok(report.holds())
    }

    fn draw(&self, report: &report::Report, folder: &Path) -> Result<(), String> {
        fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        for group in &report.figures {
            let other = if self.beside && self.model != 1 { report::figures(1, group.name) } else { Vec::new() };
            let more = format!("simulated, version {}; bars: standard errors; black: published", self.model);
            let svg = plot::figures(&format!("{}: {}", group.name, group.about), &more, &group.figures, &other)?;
            let file = folder.join(format!("{}.svg", group.name));
            fs::write(&file, svg).map_err(|error| format!("{}: {error}", file.display()))?;
        }
        Ok(())
    }
}

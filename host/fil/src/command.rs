//! `cargo fil cycles`, and what the commands share: bad input, files of the project.

use crate::cycles::{bounds, laws, page, report};
use crate::image::Image;
use anyhow::{Result, anyhow, bail};
use clap::Args;
use edm_sim::output::Output;
use edm_sim::page::Page;
use std::path::{Path, PathBuf};

/// The page of measurements.
const PAGE: &str = "docs/performance.md";
/// Who writes a section there.
const COMMAND: &str = "cargo fil cycles";

/// The person has to change something.
#[derive(Debug)]
pub struct BadInput(pub String);

impl std::fmt::Display for BadInput {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for BadInput {}

/// A file of the project that the current directory is in.
///
/// # Errors
/// When neither that nor a directory above it has the file.
pub fn in_project(file: &Path) -> Result<PathBuf> {
    edm_sim::page::in_project(file).map_err(|message| BadInput(message).into())
}

/// Arguments of `cargo fil cycles`.
#[derive(Debug, Args)]
pub struct Cycles {
    /// Write the figures as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Page with the section [default: docs/performance.md of the project]
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// Write no page; fail if gap or servo take longer than half their period, or the load above its limit
    #[arg(long)]
    check: bool,
    /// Print where a task spends its cycles, or of "all" tasks each function of the image, and measure nothing else
    #[arg(long, value_name = "TASK")]
    profile: Option<String>,
    /// Print what each feed law costs, and measure nothing else; --json writes it
    #[arg(long, conflicts_with_all = ["profile", "page", "check", "bounds"])]
    laws: bool,
    /// Also fail when a bound of docs/performance.md is not met
    #[arg(long)]
    bounds: bool,
}

impl Cycles {
    /// Measures, reports and writes.
    ///
    /// # Errors
    /// Bad input, a figure beyond its limit, a requested bound that is not met.
    pub fn execute(&self, image: &Image) -> Result<()> {
        if let Some(task) = &self.profile {
            print!("{}", report::profile(image, task)?);
            return Ok(());
        }
        if self.laws {
            let json = Output::claim_any("--json", self.json.as_deref()).map_err(BadInput)?;
            let measured = laws::measure(image)?;
            print!("{}", laws::table(&measured));
            return json.map_or(Ok(()), |output| output.write_json(&measured).map_err(|e| anyhow!(e)));
        }
        let path = self.page.clone().map_or_else(|| in_project(Path::new(PAGE)), Ok)?;
        let committed = Page::read(&path, COMMAND).map_err(BadInput)?;
        let json = Output::claim_any("--json", self.json.as_deref()).map_err(BadInput)?;
        let target = if self.check { None } else { Some(committed.claim().map_err(BadInput)?) };

        let measured = report::measure(image)?;
        let section = page::markdown(&measured);
        println!("{section}");
        let findings = bounds::wanted(&measured);
        findings.iter().for_each(|finding| println!("{finding}"));
        if let Some(output) = json {
            output.write_json(&measured).map_err(|e| anyhow!(e))?;
        }
        if let Some(output) = target {
            committed.write(output, &section).map_err(|e| anyhow!(e))?;
        }
        let beyond: Vec<_> = bounds::limits(&measured).into_iter().filter(|f| !f.kept()).collect();
        if !beyond.is_empty() {
            let beyond: Vec<_> = beyond.iter().map(ToString::to_string).collect();
            bail!("beyond a limit:\n  {}", beyond.join("\n  "));
        }
        let broken = findings.iter().filter(|f| !f.kept()).count();
        if self.bounds && broken > 0 {
            bail!("{broken} of {} bounds are not met", findings.len());
        }
        Ok(())
    }
}

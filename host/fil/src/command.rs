//! `cargo fil cycles`, and what the commands share: bad input, files of the project.

use crate::cycles::{bounds, page, report};
use crate::image::Image;
use anyhow::{Result, anyhow, bail};
use clap::Args;
use edm_sim::output::Output;
use std::path::{Path, PathBuf};

/// The page of measurements.
const PAGE: &str = "docs/performance.md";
/// What encloses the section that is generated there.
const BEGIN: &str = "<!-- cargo fil cycles writes this section -->\n";
const END: &str = "<!-- end of what cargo fil cycles writes -->\n";

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
    let here = std::env::current_dir()?;
    let found = here.ancestors().map(|d| d.join(file)).find(|path| path.exists());
    found.ok_or_else(|| {
        BadInput(format!("no {} in {} or above it: say where it is", file.display(), here.display())).into()
    })
}

/// Arguments of `cargo fil cycles`.
#[derive(Debug, Args)]
pub struct Cycles {
    /// Write the figures here as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// The page with the section; without it docs/performance.md of the project around the current directory
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// Write no page; fail when a figure has grown by more than 5 % over the committed page, and say which bounds are met
    #[arg(long)]
    check: bool,
    /// Fail when a bound is not met
    #[arg(long)]
    bounds: bool,
    /// Print so many functions of each task, the most expensive first
    #[arg(long, value_name = "N", default_value_t = 0)]
    hot: usize,
}

impl Cycles {
    /// Measures, reports, writes or compares.
    ///
    /// # Errors
    /// Bad input, a figure that has grown, a bound that is asked for and not met.
    pub fn execute(&self, image: &Image) -> Result<()> {
        let path = self.page.clone().map_or_else(|| in_project(Path::new(PAGE)), Ok)?;
        let text = std::fs::read_to_string(&path)
            .map_err(|e| BadInput(format!("--page: cannot read {}: {e}", path.display())))?;
        let sections = text.split_once(BEGIN).and_then(|(before, rest)| Some((before, rest.split_once(END)?)));
        let Some((before, (committed, after))) = sections else {
            bail!(BadInput(format!("--page: {} has no section of `cargo fil cycles`", path.display())));
        };
        let claim = |option, path| Output::claim(option, path).map_err(BadInput);
        let json = self.json.as_deref().map(|path| claim("--json", path)).transpose()?;
        let target = if self.check { None } else { Some(claim("--page", &path)?) };

        let measured = report::measure(image)?;
        let section = page::markdown(&measured);
        println!("{section}");
        for (name, scene) in measured.scenes().into_iter().filter(|_| self.hot > 0) {
            for (task, functions) in &scene.hot {
                println!("{name}, {task}:");
                for (name, cycles) in functions.iter().take(self.hot) {
                    println!("  {cycles:8.1}  {name}");
                }
            }
        }
        let findings = bounds::check(&measured);
        findings.iter().for_each(|finding| println!("{finding}"));
        if let Some(output) = json {
            let text = serde_json::to_string_pretty(&measured)?;
            output.write(|to| to.write_all(text.as_bytes())).map_err(|e| anyhow!(e))?;
        }
        if let Some(output) = target {
            let text = format!("{before}{BEGIN}{section}{END}{after}");
            output.write(|to| to.write_all(text.as_bytes())).map_err(|e| anyhow!(e))?;
        } else {
            let regressions = page::regressions(&measured, committed);
            if !regressions.is_empty() {
                bail!("more than committed:\n  {}", regressions.join("\n  "));
            }
        }
        let broken = findings.iter().filter(|f| !f.kept()).count();
        if self.bounds && broken > 0 {
            bail!("{broken} of {} bounds are not met", findings.len());
        }
        Ok(())
    }
}

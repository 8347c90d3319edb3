//! The options of a run that commands share.

use crate::bore;
use crate::run::{Job, Setup};
use crate::terminal::Failure;
use clap::Args;

/// Options of the hole, the process and the head.
#[derive(Debug, Args)]
pub struct Inputs {
    /// Depth of the hole, mm [default: that of the scenario, mostly 0.5]
    #[arg(long, value_name = "MM", allow_hyphen_values = true)]
    pub depth_mm: Option<String>,
    /// Scenario by name (`edm-sim scenarios` lists them), or a scenario file
    #[arg(long, value_name = "FILE|NAME", default_value = "default")]
    pub scenario: String,
    /// Change a value after the scenario; may be repeated, the last one counts (`edm-sim settings` lists the keys)
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Random seed; the same seed gives the same run
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed, allow_hyphen_values = true)]
    pub seed: u64,
    /// Largest error of a move of the coarse axis that carries the head, um; it is there where inch.step_um is not 0
    #[arg(long, value_name = "UM", default_value_t = 5.0, value_parser = coarse_error)]
    pub coarse_error_um: f64,
    /// Run without sparks: the gap signal is calculated from position, noise and an assumed rate of erosion
    #[arg(long)]
    pub surrogate: bool,
}

impl Inputs {
    /// Loads and checks the inputs of a run.
    pub fn job(&self) -> Result<Job, Failure> {
        self.checked().map_err(Failure::BadInput)
    }

    fn checked(&self) -> Result<Job, String> {
        let setup = setup(&self.scenario, &self.set)?;
        bore::check(&setup).map_err(|error| setup.refusal(error))?;
        let range = bore::depth_range_mm(&setup);
        let asked = self.depth_mm.clone().unwrap_or_else(|| setup.depth_mm.to_string());
        let depth = asked.trim().parse().ok().filter(|depth: &f64| range.contains(depth));
        let depth_mm = depth.ok_or_else(|| {
            format!("--depth-mm {asked}: must be a number from {} to {} mm", range.start(), range.end())
        })?;
        Ok(Job {
            setup,
            depth_mm,
            path: None,
            table: None,
            seed: self.seed,
            surrogate: self.surrogate,
            coarse_error_um: self.coarse_error_um,
        })
    }
}

/// Loads a scenario and applies the changes of the command line.
///
/// # Errors
/// What is wrong with them, in one line.
pub fn setup(scenario: &str, assignments: &[String]) -> Result<Setup, String> {
    let mut setup = Setup::load(scenario)?;
    for assignment in assignments {
        setup.set(assignment).map_err(|message| format!("--set {message}"))?;
    }
    Ok(setup)
}

/// Reads an error of the coarse axis.
///
/// # Errors
/// What it has to be.
pub fn coarse_error(text: &str) -> Result<f64, String> {
    let error = text.parse().ok().filter(|error| (0.0..=1000.0).contains(error));
    error.ok_or_else(|| "must be a number from 0 to 1000 um".into())
}

/// Reads a seed.
///
/// # Errors
/// What it has to be.
pub fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("must be a whole number from 0 to {}", u64::MAX))
}

/// Reads which part of how many is requested: `I/N`.
///
/// # Errors
/// What it has to be.
pub fn shard(text: &str) -> Result<(usize, usize), String> {
    let parts = text.split_once('/').and_then(|(shard, of)| Some((shard.parse().ok()?, of.parse().ok()?)));
    parts.filter(|(shard, of)| (1..=*of).contains(shard)).ok_or_else(|| "must be I/N with I from 1 to N".into())
}

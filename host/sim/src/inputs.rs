//! What a run is made from: options that commands share.

use crate::bore;
use crate::run::{Job, Setup};
use crate::terminal::Failure;
use clap::Args;

/// Options that say what is bored, in what, and how.
#[derive(Debug, Args)]
pub struct Inputs {
    /// Depth of the hole, mm
    #[arg(long, value_name = "MM", default_value = "0.5", allow_hyphen_values = true)]
    pub depth_mm: String,
    /// Scenario by name (`edm-sim scenarios` lists them), or a scenario file
    #[arg(long, value_name = "FILE|NAME", default_value = "default")]
    pub scenario: String,
    /// Change one value after the scenario; may be repeated, the later holds (`edm-sim settings` lists the keys)
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Seed of everything random; the same seed gives the same run
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed, allow_hyphen_values = true)]
    pub seed: u64,
    /// Run without sparks: position, noise and imagined erosion stand in for the gap signal
    #[arg(long)]
    pub surrogate: bool,
}

impl Inputs {
    /// Loads and checks everything that a run depends on.
    pub fn job(&self) -> Result<Job, Failure> {
        self.checked().map_err(Failure::BadInput)
    }

    fn checked(&self) -> Result<Job, String> {
        let setup = setup(&self.scenario, &self.set)?;
        bore::check(&setup).map_err(|error| setup.refusal(error))?;
        let range = bore::depth_range_mm(&setup);
        let depth = self.depth_mm.trim().parse().ok().filter(|depth: &f64| range.contains(depth));
        let depth_mm = depth.ok_or_else(|| {
            format!("--depth-mm {}: must be a number from {} to {} mm", self.depth_mm, range.start(), range.end())
        })?;
        Ok(Job { setup, depth_mm, seed: self.seed, surrogate: self.surrogate })
    }
}

/// Loads a scenario and applies the assignments of the command line.
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

/// Reads a seed.
///
/// # Errors
/// What it has to be.
pub fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("must be a whole number from 0 to {}", u64::MAX))
}

/// Reads which part of how many is asked for: `I/N`.
///
/// # Errors
/// What it has to be.
pub fn shard(text: &str) -> Result<(usize, usize), String> {
    let parts = text.split_once('/').and_then(|(shard, of)| Some((shard.parse().ok()?, of.parse().ok()?)));
    parts.filter(|(shard, of)| (1..=*of).contains(shard)).ok_or_else(|| "must be I/N with I from 1 to N".into())
}

//! `edm-sim soak`: random legal commands and random events, with invariants checked in every tick.
//!
//! | file | responsible for |
//! | --- | --- |
//! | `case` | a life as text |
//! | `script` | the life of a seed |
//! | `rig` | a case on a virtual head, and the invariants |
//! | `shrink` | a case that breaks one, made short |

mod case;
mod rig;
mod script;
mod shrink;

use crate::inputs::shard;
use crate::output::Output;
use crate::pool;
use crate::progress::Runs;
use crate::run::Setup;
use crate::terminal::{Failure, say};
use case::Case;
use clap::Args;
use edm_servo_head::units::TICK_HZ;
use rig::{Broken, Observed};
use script::LIFE_S;
use std::path::PathBuf;

/// Arguments of `edm-sim soak`.
#[derive(Debug, Args)]
pub struct Soak {
    /// Simulated hours, in runs of one minute each
    #[arg(long, value_name = "H", default_value = "0.1", value_parser = hours, allow_hyphen_values = true)]
    pub hours: f64,
    /// Seed of the first run; the others follow
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Only part I of N: every Nth run, beginning with the Ith
    #[arg(long, value_name = "I/N", value_parser = shard, allow_hyphen_values = true)]
    pub shard: Option<(usize, usize)>,
    /// Replay a case file instead, and print what happens
    #[arg(long, value_name = "FILE", conflicts_with_all = ["hours", "seed", "shard", "out"])]
    pub case: Option<PathBuf>,
    /// Write the shortest case that breaks an invariant, if any, to this file
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Parallel runs [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
}

impl Soak {
    /// Makes the runs; true when no invariant was broken.
    ///
    /// # Errors
    /// When the input is refused, a head cannot be made or an output cannot be written.
    pub fn execute(&self) -> Result<bool, Failure> {
        let mut setup = Setup::load("default").map_err(Failure::Failed)?;
        setup.process.installation.couple();
        if let Some(path) = &self.case {
            let name = path.display().to_string();
            let text = std::fs::read_to_string(path)
                .map_err(|error| Failure::BadInput(format!("--case {name}: cannot be read: {error}")))?;
            let case = Case::parse(&name, &text).map_err(|message| Failure::BadInput(format!("--case {message}")))?;
            let (seen, broken) =
                rig::play(&setup, &case, &mut |line| say(&format!("{line}\n"))).map_err(Failure::Failed)?;
            say(&words(&seen));
            say(&broken.as_ref().map_or_else(|| "no invariant is broken\n".into(), |broken| reported(&case, broken)));
            return Ok(broken.is_none());
        }
        let out = Output::claim_any("--out", self.out.as_deref()).map_err(Failure::BadInput)?;
        let (shard, of) = self.shard.unwrap_or((1, 1));
        let runs = (self.hours * 3600.0 / LIFE_S as f64).ceil() as u64;
        let seeds: Vec<u64> = (0..runs).skip(shard - 1).step_by(of).map(|run| self.seed.wrapping_add(run)).collect();
        if seeds.is_empty() {
            return Err(Failure::BadInput(format!(
                "--shard {shard}/{of}: there are only {runs} runs; must be I/N with N up to that"
            )));
        }
        let bar = Runs::new(seeds.len(), 0);
        let mut all = Observed::default();
        let mut broken: Vec<(u64, Broken)> = Vec::new();
        let one = |seed: &u64| (*seed, rig::play(&setup, &script::life(*seed), &mut |_| {}));
        let made = pool::run_all(&seeds, pool::workers(self.jobs), one, |(seed, played)| {
            let (seen, found) = played?;
            all = Observed {
                ticks: all.ticks + seen.ticks,
                worked: all.worked + seen.worked,
                faults: all.faults + seen.faults,
                contacts: all.contacts + seen.contacts,
                contact_n: all.contact_n.max(seen.contact_n),
            };
            broken.extend(found.map(|found| (seed, found)));
            bar.finished(&format!("seed {seed}"));
            Ok(())
        });
        bar.finish();
        made.map_err(Failure::Failed)?;
        // Not in the order in which they ended.
        broken.sort_by_key(|(seed, _)| *seed);
        say(&format!("{} runs: {}", seeds.len(), words(&all)));
        for (seed, found) in &broken {
            say(&format!("seed {seed}, step {}: {}: {}\n", found.steps, found.what, found.how));
        }
        let Some((seed, first)) = broken.first() else { return Ok(true) };
        let (case, found) = shrink::shrink(&script::life(*seed), first, |case| {
            rig::play(&setup, case, &mut |_| {}).ok().and_then(|(_, broken)| broken)
        });
        say(&format!("\nthe first of them, shortened:\n{}", reported(&case, &found)));
        if let Some(out) = out {
            out.write(|file| file.write_all(reported(&case, &found).as_bytes())).map_err(Failure::Failed)?;
        }
        Ok(false)
    }
}

/// What was broken, and the case: a file for `--case`.
fn reported(case: &Case, broken: &Broken) -> String {
    format!("# {}: {}\n{case}", broken.what, broken.how)
}

fn words(seen: &Observed) -> String {
    let hours = |ticks: u64| ticks as f64 / f64::from(TICK_HZ) / 3600.0;
    format!(
        "{:.2} simulated hours, {:.2} of them in motion; {} faults, {} contacts, {:.1} N largest contact force\n",
        hours(seen.ticks),
        hours(seen.worked),
        seen.faults,
        seen.contacts,
        seen.contact_n
    )
}

fn hours(text: &str) -> Result<f64, String> {
    let hours = text.parse().ok().filter(|hours| (0.001..=100_000.0).contains(hours));
    hours.ok_or_else(|| "must be a number from 0.001 to 100000".into())
}

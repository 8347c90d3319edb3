//! Fault campaigns: faults injected, reactions of the head, and the page with the results. `edm-sim faults` breaks the wires
//! of a native head; `cargo fil faults` shares rows, counts and page.
//!
//! | file | responsible for |
//! | --- | --- |
//! | `row` | a fault and its result, as JSON and as a table; how rows are counted |
//! | `wires` | faults injected natively |
//! | `trial` | one case with one seed |
//! | `sets` | settings that are wrong, through the guided check and under faults |

pub mod row;
pub mod sets;
mod trial;
pub mod wires;

use crate::inputs::shard;
use crate::output::Output;
use crate::page::Page;
use crate::pool;
use crate::progress::Runs;
use crate::run::Setup;
use crate::terminal::{Failure, say};
use clap::Args;
use edm_servo_head::head::Fault;
use row::{Campaign, Row};
use sets::Sets;
use std::path::PathBuf;
use trial::Observed;
use wires::Case;

/// Who writes the section of the page.
const COMMAND: &str = "cargo sim faults";

/// Options that every fault campaign has.
#[derive(Debug, Args)]
pub struct Options {
    /// Only faults whose name contains this
    #[arg(long, value_name = "PATTERN", default_value = "")]
    pub rows: String,
    /// Only part I of N: every Nth fault, beginning with the Ith
    #[arg(long, value_name = "I/N", value_parser = shard, allow_hyphen_values = true)]
    pub shard: Option<(usize, usize)>,
    /// Write the rows and their counts as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write the table into its section of this page (docs/robustness.md)
    #[arg(long, value_name = "FILE")]
    pub page: Option<PathBuf>,
}

/// Outputs of a campaign.
pub struct Written {
    json: Option<Output>,
    page: Option<(Page, Output)>,
}

impl Options {
    /// The faults that are requested.
    ///
    /// # Errors
    /// When there are none.
    pub fn choose<T>(&self, all: Vec<T>, name: impl Fn(&T) -> String) -> Result<Vec<T>, String> {
        let (shard, of) = self.shard.unwrap_or((1, 1));
        let chosen: Vec<T> =
            all.into_iter().filter(|one| name(one).contains(&self.rows)).skip(shard - 1).step_by(of).collect();
        if chosen.is_empty() {
            let part = self.shard.map_or_else(String::new, |(shard, of)| format!(" in part {shard}/{of}"));
            return Err(format!("--rows {}: must be part of the name of a fault; no name matches{part}", self.rows));
        }
        Ok(chosen)
    }

    /// Claims the outputs of this command.
    ///
    /// # Errors
    /// When it cannot be.
    pub fn claim(&self, command: &str) -> Result<Written, String> {
        let json = Output::claim_any("--json", self.json.as_deref())?;
        let page = self.page.as_deref().map(|path| Page::claimed(path, command)).transpose()?;
        Ok(Written { json, page })
    }
}

impl Written {
    /// Prints and writes the result of a campaign; whether it passes. On the page `how` it was run comes first.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn finish(self, campaign: &Campaign, how: &str) -> Result<bool, String> {
        say(&campaign.summary());
        if let Some(output) = self.json {
            output.write_json(campaign)?;
        }
        if let Some((page, output)) = self.page {
            page.write(output, &format!("{how}\n\n{}", campaign.section()))?;
        }
        Ok(campaign.passes())
    }
}

/// Arguments of `edm-sim faults`.
#[derive(Debug, Args)]
pub struct Faults {
    /// Seeds 1 to N
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub seeds: u64,
    /// Wrong settings instead of broken wires: the guided check must refuse them, or no fault may press more than 5 N
    #[arg(long, value_enum)]
    pub settings: Option<Sets>,
    /// What every campaign has.
    #[command(flatten)]
    pub options: Options,
    /// Parallel runs [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
}

impl Faults {
    /// Breaks wires and evaluates the reactions; true when the campaign passes.
    ///
    /// # Errors
    /// When the input is refused, a run cannot be made or an output cannot be written.
    pub fn execute(&self) -> Result<bool, Failure> {
        if let Some(sets) = self.settings {
            return sets.execute(self);
        }
        let cases = self.options.choose(Case::all(), Case::name).map_err(Failure::BadInput)?;
        let written = self.options.claim(COMMAND).map_err(Failure::BadInput)?;
        let mut setup = Setup::load("default").map_err(Failure::Failed)?;
        setup.process.installation.couple();

        let work: Vec<(usize, u64)> =
            (0..cases.len()).flat_map(|case| (1..=self.seeds).map(move |seed| (case, seed))).collect();
        let mut seen: Vec<Vec<Run>> = cases.iter().map(|_| Vec::new()).collect();
        let bar = Runs::new(work.len(), 0);
        let one = |&(at, seed): &(usize, u64)| (at, seed, cases.get(at).map(|case| trial::run(&setup, case, seed)));
        let made = pool::run_all(&work, pool::workers(self.jobs), one, |(at, seed, runs)| {
            bar.finished(&cases.get(at).map_or_else(String::new, Case::name));
            let runs = runs.transpose()?.unwrap_or_default();
            let all = runs.into_iter().map(|(delay_s, seen)| Run { seed, delay_s, seen });
            seen.get_mut(at).into_iter().for_each(|of| of.extend(all.clone()));
            Ok(())
        });
        bar.finish();
        made.map_err(Failure::Failed)?;
        let rows = cases.iter().zip(&mut seen).map(|(case, runs)| {
            // As they were asked for, and not as they were done.
            runs.sort_by_key(|run| run.seed);
            worst(case, runs)
        });
        let campaign = Campaign::new(rows.collect());
        let how = format!("Seeds 1 to {}; each row has the worst of every seed and delay.", self.seeds);
        written.finish(&campaign, &how).map_err(Failure::Failed)
    }
}

/// A case at one delay with one seed.
#[derive(Clone, Debug)]
struct Run {
    seed: u64,
    delay_s: f64,
    seen: Observed,
}

/// The row of a case: the worst of its runs. Those that break a bound are printed.
fn worst(case: &Case, runs: &[Run]) -> Row {
    let mut broken = 0;
    for Run { seed, delay_s, seen } in runs {
        let what = seen.broken(case);
        if !what.is_empty() {
            broken += 1;
            say(&format!("{}, seed {seed}, {delay_s} s between: {}\n", case.name(), what.join("; ")));
        }
    }
    let most = |figure: &dyn Fn(&Observed) -> f64| runs.iter().map(|run| figure(&run.seen)).fold(0.0, f64::max);
    let times: Option<Vec<f64>> = runs.iter().map(|run| run.seen.time_us).collect();
    let nothing = runs.iter().any(|run| run.seen.named.is_empty());
    let named = together(runs.iter().flat_map(|run| run.seen.named.iter().copied().map(Fault::name)));
    Row {
        fault: case.name(),
        reaction: together(runs.iter().map(|run| run.seen.reaction.map_or("continues", |reaction| reaction.name()))),
        time_us: times.map(|times| times.into_iter().fold(0.0, f64::max)),
        reported: (!nothing).then_some(named),
        contact_n: most(&|seen| seen.contact_n),
        current_a: most(&|seen| seen.current_a),
        recovers: runs.iter().all(|run| run.seen.stuck.is_none()),
        pass: broken == 0,
    }
}

/// Each name once, in the order in which they come.
fn together<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let mut once: Vec<&str> = Vec::new();
    for name in names {
        if !once.contains(&name) {
            once.push(name);
        }
    }
    once.join(", ")
}

//! `edm-sim search`: parameters of a feed law, found the same way for every law.
//!
//! | file | responsible for |
//! | --- | --- |
//! | `space` | what may be varied of each law, and in which range |
//! | `training` | the holes that are bored for it, none of which is reported, and the score |
//! | `best` | what was found, for `edm-sim compare` |
//! | `table` | a row for each set of parameters, which a search goes on from |
//!
//! The optimiser is the particle swarm of the crate argmin, which needs no gradient and stands a rough objective; parameters are
//! coordinates of a cube, logarithmic where their range is wide. Every set of parameters bores the same holes with the same seeds, so
//! the objective has no noise. A search is repeatable: with the rows of the same command, what was tried is not tried again.

pub mod best;
mod space;
mod table;
mod training;

use crate::inputs::shard;
use crate::pool;
use crate::terminal::{Failure, say};
use argmin::core::{CostFunction, Error, Executor};
use argmin::solver::particleswarm::ParticleSwarm;
use clap::{Args, Subcommand};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use space::{LAWS, Law};
use std::path::PathBuf;
use std::sync::Mutex;
use table::{Table, Tried};
use training::{Machine, Training};

/// Sets of parameters in a generation.
const PARTICLES: usize = 12;

/// Arguments of `edm-sim search`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Search {
    #[command(subcommand)]
    action: Option<Action>,
    #[command(flatten)]
    options: Option<Options>,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// The best of the tables of several searches or shards
    Merge {
        /// Their tables
        #[arg(value_name = "FILE.csv", required = true)]
        files: Vec<PathBuf>,
    },
}

#[derive(Debug, Args)]
struct Options {
    /// Law whose parameters are searched
    #[arg(long, value_name = "NAME")]
    law: String,
    /// Machine whose holes are bored
    #[arg(long, value_enum)]
    machine: Machine,
    /// Sets of parameters to try, rounded up to generations of 12
    #[arg(long, value_name = "N", default_value_t = 144, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    evaluations: u32,
    /// Depth of the holes, mm [default: 0.03 for micro, 0.05 for sinker]
    #[arg(long, value_name = "MM", allow_hyphen_values = true)]
    depth_mm: Option<f64>,
    /// Part I of N: a swarm of its own, which begins elsewhere
    #[arg(long, value_name = "I/N", value_parser = shard, allow_hyphen_values = true)]
    shard: Option<(usize, usize)>,
    /// Parallel runs [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Write a row for every set of parameters as it is tried; the same command goes on from there
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
}

impl Search {
    /// Searches and prints the best; true when something was found.
    ///
    /// # Errors
    /// When the input is refused, or the table cannot be read or written.
    pub fn execute(&self) -> Result<bool, Failure> {
        match (&self.action, &self.options) {
            (Some(Action::Merge { files }), _) => merge(files),
            (None, Some(options)) => options.execute(),
            (None, None) => {
                Err(Failure::BadInput("--law and --machine are missing; see `edm-sim search --help`".into()))
            }
        }
    }
}

impl Options {
    fn execute(&self) -> Result<bool, Failure> {
        let law = law(&self.law).map_err(|message| Failure::BadInput(format!("--law {message}")))?;
        let training = Training::new(self.machine, self.depth_mm).map_err(Failure::BadInput)?;
        if !training.fits(law) {
            let message = format!("--law {}: is no law for the machine {}", law.name, self.machine.name());
            return Err(Failure::BadInput(message));
        }
        let (shard, _) = self.shard.unwrap_or((1, 1));
        let search = format!("{} {} {shard} {}", law.name, self.machine.name(), training.fingerprint());
        let table = Table::open(self.csv.as_deref(), &search).map_err(Failure::BadInput)?;
        let workers = pool::workers(self.jobs);
        let references = training.references(workers).map_err(Failure::Failed)?;
        let trial = Trial { law, training: &training, references: &references, workers, table: Mutex::new(table) };
        let dimensions = law.dimensions.len();
        let solver = ParticleSwarm::new((vec![0.0; dimensions], vec![1.0; dimensions]), PARTICLES)
            .with_rng_generator(ChaCha8Rng::seed_from_u64(shard as u64));
        // The first generation is made before the first iteration.
        let iterations = u64::from(self.evaluations).div_ceil(PARTICLES as u64).saturating_sub(1);
        let done = Executor::new(&trial, solver).configure(|state| state.max_iters(iterations)).ctrlc(false).run();
        done.map_err(|error| Failure::Failed(error.to_string()))?;
        let table = trial.table.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
        report(law, &table.rows().collect::<Vec<_>>());
        Ok(true)
    }
}

fn law(name: &str) -> Result<&'static Law, String> {
    LAWS.iter().find(|law| law.name == name).ok_or_else(|| {
        let all: Vec<_> = LAWS.iter().map(|law| law.name).collect();
        format!("{name}: no such law; the laws are {}", all.join(", "))
    })
}

/// A set of parameters on trial.
struct Trial<'a> {
    law: &'a Law,
    training: &'a Training,
    references: &'a [training::Figures],
    workers: usize,
    table: Mutex<Table>,
}

impl CostFunction for &Trial<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, point: &Vec<f64>) -> Result<f64, Error> {
        let values = self.law.values(point);
        let mut table = self.table.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let before = table.score(&values);
        let score = match before {
            Some(score) => score,
            None => {
                let tried = self.training.try_it(self.law, &values, self.references, self.workers);
                let tried = tried.map_err(Error::msg)?;
                let score = tried.score;
                table.add(Tried { values, ..tried }).map_err(Error::msg)?;
                score
            }
        };
        Ok(score)
    }
}

/// The best rows of each search.
fn report(law: &Law, rows: &[&Tried]) {
    let Some(best) = rows.iter().min_by(|a, b| a.score.total_cmp(&b.score)) else { return };
    say(&format!(
        "{} sets of parameters tried\nbest: score {:.4}, time {:.3} of the reference, arcs {:.2} % ({:.2} %), wear {:.3} of the reference, {} holes \
         not finished\n{}\n",
        rows.len(),
        best.score,
        best.time_ratio,
        best.arc_percent,
        best.reference_arc_percent,
        best.wear_ratio,
        best.unfinished,
        best.settings,
    ));
    for (dimension, value) in law.dimensions.iter().zip(&best.values) {
        let (from, to) = dimension.range;
        say(&format!("  {}: {value} of {from} to {to}\n", dimension.name));
    }
}

fn merge(files: &[PathBuf]) -> Result<bool, Failure> {
    let tables =
        files.iter().map(|path| Table::read(path)).collect::<Result<Vec<_>, _>>().map_err(Failure::BadInput)?;
    let kind = |table: &Table| table.search().split(' ').take(2).map(String::from).collect::<Vec<_>>();
    if let Some((_, path)) = tables.iter().zip(files).find(|(table, _)| kind(table) != kind(&tables[0])) {
        let message = format!("{}: is of another law or machine than {}", path.display(), files[0].display());
        return Err(Failure::BadInput(message));
    }
    let name = tables[0].search().split(' ').next().unwrap_or_default();
    let law = law(name).map_err(|message| Failure::BadInput(format!("{}: {message}", files[0].display())))?;
    report(law, &tables.iter().flat_map(Table::rows).collect::<Vec<_>>());
    Ok(true)
}

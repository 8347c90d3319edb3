//! `edm-sim sweep`: every combination of a grid, against the bounds of the head.
//!
//! | file | responsible for |
//! | --- | --- |
//! | `grid` | what is varied, and the order of the runs |
//! | `row` | a run as a line of CSV or JSON |
//! | `file` | lines in a file that can be continued |
//! | `merge` | the files of shards, put together |
//! | `figures` | the figures of a run |
//! | `bounds` | the bounds of a run |
//! | `table` | the worst run of each combination, and broken bounds |

mod bounds;
mod figures;
pub(crate) mod file;
pub(crate) mod grid;
pub(crate) mod merge;
pub(crate) mod row;
mod table;

use crate::bore;
use crate::inputs::shard;
use crate::observe::Recorder;
use crate::pool;
use crate::progress::Runs;
use crate::report::Report;
use crate::terminal::{Failure, say};
use clap::{Args, Subcommand};
use file::RowFile;
use grid::{Grid, Lists, Run};
use row::{Format, Row};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

/// Default seeds.
const SEEDS: &str = "20";

/// Arguments of `edm-sim sweep`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Sweep {
    #[command(subcommand)]
    action: Option<Action>,
    #[command(flatten)]
    options: Options,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Combine the tables of all shards: the same rows in the same order as one sweep would write
    Merge(merge::Merge),
}

/// Options of a sweep.
#[derive(Debug, Args)]
pub struct Options {
    /// TOML file with the grid: scenarios, seeds, depth_mm, and keys with their values in a table `set`
    #[arg(long, value_name = "FILE")]
    pub grid: Option<PathBuf>,
    /// Only these scenarios, by name or file
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub scenario: Vec<String>,
    /// Vary a key; may be repeated: all combinations are run (`edm-sim settings` lists the keys)
    #[arg(long, value_name = "KEY=VALUE,...")]
    pub set: Vec<String>,
    /// Seeds: N for 1 to N, A..B with both ends, or a list [default: 20]
    #[arg(long, value_name = "SEEDS", allow_hyphen_values = true)]
    pub seeds: Option<String>,
    /// Depths of the holes, mm [default: that of each scenario, mostly 0.5]
    #[arg(long, value_name = "MM,...", value_delimiter = ',', allow_hyphen_values = true)]
    pub depth_mm: Vec<f64>,
    #[command(flatten)]
    making: Making,
    /// The same as JSON, one object per line
    #[arg(long, value_name = "FILE.jsonl", alias = "json")]
    pub jsonl: Option<PathBuf>,
}

/// How the runs of a grid are made.
#[derive(Debug, Args)]
pub struct Making {
    /// Parallel runs [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Only part I of N: every Nth run, beginning with the Ith
    #[arg(long, value_name = "I/N", value_parser = shard, allow_hyphen_values = true)]
    pub shard: Option<(usize, usize)>,
    /// Write a row for every run as it finishes; the same command continues an interrupted sweep
    #[arg(long, value_name = "FILE.csv")]
    pub csv: Option<PathBuf>,
}

impl Sweep {
    /// Runs everything and prints a table; true when every bound is kept.
    ///
    /// # Errors
    /// When the input is refused, or an output cannot be written.
    pub fn execute(&self) -> Result<bool, Failure> {
        match &self.action {
            Some(Action::Merge(merge)) => merge.execute(),
            None => self.options.execute(),
        }
    }
}

impl Making {
    /// Makes the runs of a grid that no file has yet; the rows of all, in their order.
    ///
    /// # Errors
    /// When the grid has no such part, or a file cannot be written.
    pub(crate) fn rows(&self, grid: &Grid, mut files: Vec<RowFile>) -> Result<Vec<Row>, Failure> {
        let (shard, of) = self.shard.unwrap_or((1, 1));
        let mine: Vec<usize> = (shard..=grid.len()).step_by(of).collect();
        if mine.is_empty() {
            let message = format!("--shard {shard}/{of}: the grid has only {} runs", grid.len());
            return Err(Failure::BadInput(message));
        }
        // A run is done when every file has it.
        let done = |run: &usize| !files.is_empty() && files.iter().all(|file| file.row(*run).is_some());
        let (before, ahead): (Vec<usize>, Vec<usize>) = mine.into_iter().partition(done);
        let mut rows: Vec<Row> =
            before.iter().filter_map(|run| files.first().and_then(|file| file.row(*run)).cloned()).collect();
        files.iter_mut().try_for_each(RowFile::begin).map_err(Failure::Failed)?;

        let bar = Runs::new(before.len() + ahead.len(), before.len());
        let one = |number: &usize| grid.run(*number).map(|run| (make(&run), run));
        let made = pool::run_all(&ahead, pool::workers(self.jobs), one, |run| {
            let Some((done, run)) = run else { return Ok(()) };
            let row = Row::new(grid, &run, &done);
            files.iter_mut().try_for_each(|file| file.append(run.number, &row))?;
            bar.finished(&run.job.label());
            rows.push(row);
            Ok(())
        });
        bar.finish();
        made.and_then(|()| files.into_iter().try_for_each(RowFile::finish)).map_err(Failure::Failed)?;
        rows.sort_by_key(Row::run);
        Ok(rows)
    }
}

impl Options {
    fn execute(&self) -> Result<bool, Failure> {
        let grid = self.grid().map_err(Failure::BadInput)?;
        let files = self.files(&grid).map_err(Failure::BadInput)?;
        let rows = self.making.rows(&grid, files)?;
        let (table, broken) = table::evaluate(&rows);
        say(&table);
        Ok(broken == 0)
    }

    /// The grid: its file, options before it, and defaults.
    fn grid(&self) -> Result<Grid, String> {
        let mut lists = Lists::default();
        if let Some(path) = &self.grid {
            let name = path.display().to_string();
            let text =
                std::fs::read_to_string(path).map_err(|error| format!("--grid {name}: cannot be read: {error}"))?;
            lists = Lists::parse(&name, &text)?;
        }
        self.set.iter().try_for_each(|assignment| lists.vary(assignment))?;
        if !self.scenario.is_empty() {
            lists.scenarios.clone_from(&self.scenario);
        }
        if lists.scenarios.is_empty() {
            lists.scenarios = grid::built_in();
        }
        if !self.depth_mm.is_empty() {
            lists.depths_mm.clone_from(&self.depth_mm);
        }
        let seeds = self.seeds.as_deref().or(lists.seeds.is_empty().then_some(SEEDS));
        if let Some(text) = seeds {
            lists.seeds = grid::seeds(text).map_err(|message| format!("--seeds {message}"))?;
        }
        Grid::new(&lists)
    }

    fn files(&self, grid: &Grid) -> Result<Vec<RowFile>, String> {
        let asked = [("--csv", &self.making.csv, Format::Csv), ("--jsonl", &self.jsonl, Format::Json)];
        let mut files: Vec<RowFile> = Vec::new();
        for (option, path, format) in asked {
            let Some(path) = path else { continue };
            let file = RowFile::claim(option, path, format, grid)?;
            let output = file.output();
            if let Some(other) = files.iter().find(|other| other.output().collides(output)) {
                return Err(format!("{} and {}: must be different files", other.output().label(), output.label()));
            }
            let mut inputs = self.grid.iter().cloned().chain(self.scenario.iter().map(PathBuf::from));
            if let Some(input) = inputs.find(|input| output.replaces(input)) {
                return Err(format!("{}: must not be {} itself", output.label(), input.display()));
            }
            files.push(file);
        }
        Ok(files)
    }
}

/// The row of a run, made now.
pub(crate) fn again(grid: &Grid, run: usize) -> Option<Row> {
    let run = grid.run(run)?;
    Some(Row::new(grid, &run, &make(&run)))
}

/// One run; one that fails, however it does, is a row as well.
fn make(run: &Run<'_>) -> Result<Report, String> {
    if let Some(refusal) = run.refusal {
        return Err(refusal.into());
    }
    let made = catch_unwind(AssertUnwindSafe(|| {
        let mut recorder = Recorder::new(None, false)?;
        let outcome = bore::bore(&run.job, &mut recorder, &mut |_| {})?;
        // The time it took is that of a computer with other things to do, and no figure of the run.
        Ok(Report::new(&run.job, &outcome, &recorder.statistics.figures(), 0.0))
    }));
    made.unwrap_or_else(|_| Err("the simulation stopped; see the message on stderr".into()))
}

//! `edm-sim compare`: feed laws side by side, with paired seeds.
//!
//! | file | responsible for |
//! | --- | --- |
//! | `laws` | who takes part, with which parameters |
//! | `summary` | means with their confidence, differences, JSON |
//! | `bars` | the picture of a scenario |
//!
//! Runs, rows, files that are continued and shards are those of [`sweep`](crate::sweep).

mod bars;
mod laws;
mod summary;

use crate::output::Output;
use crate::page::Page;
use crate::pool;
use crate::sweep::file::RowFile;
use crate::sweep::grid::{self, Choice, Grid, Lists, SET_POINT_FACTOR};
use crate::sweep::merge::Whole;
use crate::sweep::row::{Format, Row};
use crate::sweep::{Making, again};
use crate::terminal::{Failure, say};
use clap::{Args, Subcommand};
use laws::{LAWS, VARIANTS};
use std::path::{Path, PathBuf};
use summary::Comparison;

/// Page with the tables, and the command as it names it.
const PAGE: &str = "docs/feed-laws.md";
const COMMAND: &str = "cargo sim compare";
const FRONTS: &str = "cargo sim compare --set-points";
/// Scenarios by default: both settings of \[G\]'s machine, and the sinker of \[R\].
const SCENARIOS: [&str; 3] = ["micro-blind", "micro-blind-clear", "sinker"];

/// Arguments of `edm-sim compare`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Compare {
    #[command(subcommand)]
    action: Option<Action>,
    #[command(flatten)]
    options: Options,
    #[command(flatten)]
    results: Results,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Compare the tables of all shards
    Merge(Merge),
}

#[derive(Debug, Args)]
struct Merge {
    /// Tables of the shards
    #[arg(value_name = "FILE.csv", required = true)]
    files: Vec<PathBuf>,
    #[command(flatten)]
    results: Results,
}

#[derive(Debug, Args)]
struct Options {
    /// Only these laws [default: all]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    laws: Vec<String>,
    /// Scenarios, by name or file [default: micro-blind, micro-blind-clear, sinker]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    scenarios: Vec<String>,
    /// What all laws have in common: reflex, late-reflex (100 ms), pauses (off-time by class) [default: reflex]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    variants: Vec<String>,
    /// Seeds, the same for every law: N for 1 to N, A..B with both ends, or a list
    #[arg(long, value_name = "SEEDS", default_value = "20", allow_hyphen_values = true)]
    seeds: String,
    /// Depth of the holes, mm [default: that of each scenario]
    #[arg(long, value_name = "MM", allow_hyphen_values = true)]
    depth_mm: Option<f64>,
    /// Change every unpublished number of the model at random by up to this percentage, the same for every law of a seed
    #[arg(long, value_name = "PCT", default_value_t = 0.0, allow_hyphen_values = true)]
    perturb: f64,
    /// Run every law at these multiples of its set point, and show the Pareto front
    #[arg(long, value_name = "FACTOR,...", value_delimiter = ',', allow_hyphen_values = true)]
    set_points: Vec<f64>,
    #[command(flatten)]
    making: Making,
    /// Repeat this many of the runs in --csv, spread over all, and fail unless every digit is the same
    #[arg(long, value_name = "N", requires = "csv", conflicts_with_all = ["shard", "json", "plot", "docs"],
          value_parser = clap::value_parser!(u16).range(1..))]
    recompute: Option<u16>,
}

#[derive(Debug, Args)]
struct Results {
    /// Write means and confidence as JSON
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
    /// Write a plot of each scenario into this folder
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
    /// Write the tables into docs/feed-laws.md
    #[arg(long)]
    docs: bool,
}

impl Compare {
    /// Runs everything and prints the tables; true when every run was made.
    ///
    /// # Errors
    /// When the input is refused, or an output cannot be written.
    pub fn execute(&self) -> Result<bool, Failure> {
        match &self.action {
            Some(Action::Merge(merge)) => merge.execute(),
            None => self.run(),
        }
    }

    fn run(&self) -> Result<bool, Failure> {
        let grid = self.options.grid().map_err(Failure::BadInput)?;
        let csv = self.options.making.csv.as_deref();
        let file = csv.map(|path| RowFile::claim("--csv", path, Format::Csv, &grid)).transpose();
        let file = file.map_err(Failure::BadInput)?;
        if let (Some(count), Some(file)) = (self.options.recompute, &file) {
            return self.options.recompute(&grid, file, count.into());
        }
        let outputs = self
            .results
            .claim(&self.options.inputs(), !self.options.set_points.is_empty())
            .map_err(Failure::BadInput)?;
        let rows = self.options.making.rows(&grid, file.into_iter().collect())?;
        outputs.write(&rows, rows.len() < grid.len())
    }
}

impl Merge {
    fn execute(&self) -> Result<bool, Failure> {
        let whole = Whole::read(&self.files).map_err(Failure::BadInput)?;
        whole.missing().map_err(Failure::BadInput)?;
        let rows = whole.rows();
        if rows.iter().any(|row| row.text("law").is_none() || row.text("variant").is_none()) {
            return Err(Failure::BadInput("the files are from a sweep, not from a comparison".into()));
        }
        let outputs = self
            .results
            .claim(&self.files, rows.iter().any(|row| row.text(SET_POINT_FACTOR).is_some()))
            .map_err(Failure::BadInput)?;
        outputs.write(&rows, false)
    }
}

impl Options {
    /// Whether so many of the rows of a table are what the runs give now.
    fn recompute(&self, grid: &Grid, file: &RowFile, count: usize) -> Result<bool, Failure> {
        let path = file.output().label();
        let runs: Vec<usize> = (0..count.min(grid.len())).map(|k| 1 + k * grid.len() / count.min(grid.len())).collect();
        if let Some(run) = runs.iter().find(|run| file.row(**run).is_none()) {
            return Err(Failure::BadInput(format!("{path}: has no run {run} of {}", grid.len())));
        }
        let mut others = Vec::new();
        let one = |run: &usize| (*run, again(grid, *run));
        pool::run_all(&runs, pool::workers(self.making.jobs), one, |(run, row)| {
            if row.is_none_or(|row| !file.holds(run, &row)) {
                others.push(run);
            }
            Ok(())
        })
        .map_err(Failure::Failed)?;
        others.sort_unstable();
        say(&format!(
            "{} of {} runs repeated: {} are the same as in the table\n",
            runs.len(),
            grid.len(),
            runs.len() - others.len()
        ));
        others.iter().for_each(|run| say(&format!("run {run} differs\n")));
        Ok(others.is_empty())
    }

    fn inputs(&self) -> Vec<PathBuf> {
        self.scenarios.iter().map(PathBuf::from).chain(self.making.csv.clone()).collect()
    }

    fn grid(&self) -> Result<Grid, String> {
        if !(0.0..=50.0).contains(&self.perturb) {
            return Err(format!("--perturb {}: must be a number from 0 to 50 %", self.perturb));
        }
        if let Some(factor) = self.set_points.iter().find(|factor| !(0.5..=1.5).contains(*factor)) {
            return Err(format!("--set-points {factor}: must be a number from 0.5 to 1.5"));
        }
        let all = || LAWS.iter().map(|law| law.name).collect::<Vec<_>>().join(", ");
        for name in &self.laws {
            if !LAWS.iter().any(|law| law.name == name) {
                return Err(format!("--laws {name}: no such law; the laws are {}", all()));
            }
        }
        let chosen = LAWS.iter().filter(|law| self.laws.is_empty() || self.laws.iter().any(|name| name == law.name));
        let seeds = grid::seeds(&self.seeds).map_err(|message| format!("--seeds {message}"))?;
        let scenarios =
            if self.scenarios.is_empty() { SCENARIOS.map(String::from).to_vec() } else { self.scenarios.clone() };
        if let Some(name) = self.variants.iter().find(|name| !VARIANTS.iter().any(|(known, ..)| known == name)) {
            let all = VARIANTS.map(|(known, ..)| known).join(", ");
            return Err(format!("--variants {name}: no such variant; the variants are {all}"));
        }
        let variant = |name: &str| match self.perturb {
            0.0 => name.to_owned(),
            share => format!("{name}, model +-{share} %"),
        };
        let common = VARIANTS.iter().enumerate().filter(|(i, (name, ..))| {
            if self.variants.is_empty() { *i == 0 } else { self.variants.iter().any(|wanted| wanted == name) }
        });
        let choices = vec![
            Choice {
                name: "variant".into(),
                options: common.map(|(_, (_, name, set))| (variant(name), *set)).collect(),
            },
            Choice { name: "law".into(), options: chosen.map(|e| (e.name.to_owned(), e.settings)).collect() },
        ];
        let depths_mm = self.depth_mm.into_iter().collect();
        let perturbed = self.perturb * 1e-2;
        let set_points = self.set_points.clone();
        Grid::new(&Lists { scenarios, seeds, depths_mm, values: Vec::new(), choices, set_points, perturbed })
    }
}

/// Where the results go.
struct Outputs<'a> {
    json: Option<Output>,
    plot: Option<&'a Path>,
    page: Option<(Page, Output)>,
    /// The page gets the Pareto fronts alone.
    fronts: bool,
}

impl Results {
    fn claim(&self, inputs: &[PathBuf], fronts: bool) -> Result<Outputs<'_>, String> {
        let json = Output::claim_any("--json", self.json.as_deref())?;
        if let Some((output, input)) =
            json.as_ref().and_then(|json| Some((json, inputs.iter().find(|input| json.replaces(input))?)))
        {
            return Err(format!("{}: must not be {} itself", output.label(), input.display()));
        }
        if let Some(folder) = self.plot.as_deref().filter(|folder| folder.exists() && !folder.is_dir()) {
            return Err(format!("--plot {}: must be a folder", folder.display()));
        }
        let command = if fronts { FRONTS } else { COMMAND };
        let page = self.docs.then(|| Page::of_project(PAGE, command)).transpose()?;
        Ok(Outputs { json, plot: self.plot.as_deref(), page, fronts })
    }
}

impl Outputs<'_> {
    fn write(self, rows: &[Row], partly: bool) -> Result<bool, Failure> {
        let failed = |error: String| Failure::Failed(error);
        let comparison = Comparison::of(rows);
        let table = comparison.table(partly);
        say(&table);
        if let Some(folder) = self.plot {
            let label = |error: &dyn std::fmt::Display| failed(format!("--plot {}: {error}", folder.display()));
            std::fs::create_dir_all(folder).map_err(|error| label(&error))?;
            for (name, picture) in bars::draw(&comparison).map_err(failed)? {
                std::fs::write(folder.join(name), picture).map_err(|error| label(&error))?;
            }
        }
        if let Some((page, output)) = self.page {
            let text = if self.fronts { comparison.fronts() } else { table };
            page.write(output, &format!("\n{text}\n")).map_err(failed)?;
        }
        if let Some(json) = self.json {
            json.write(|file| file.write_all(comparison.json().as_bytes())).map_err(failed)?;
        }
        Ok(comparison.failed == 0)
    }
}

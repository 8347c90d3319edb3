//! `edm-sim bore`: check, run, report.

use crate::bore;
use crate::inputs::Inputs;
use crate::observe::{Recorder, Run};
use crate::output::Output;
use crate::progress::Bar;
use crate::report::{Report, Summary};
use crate::run::{Job, Setup};
use crate::scenario::BUILT_IN;
use crate::terminal::{Failure, say};
use clap::Args;
use edm_gcode::Program;
use edm_technology::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Arguments of `edm-sim bore`.
#[derive(Debug, Args)]
pub struct Bore {
    /// The hole, the process and the head.
    #[command(flatten)]
    pub inputs: Inputs,
    /// Erode along a G-code program instead of straight down: G0 to G3, arcs with I, J, K or R, F limits the feed; begins at
    /// X0 Y0 and the surface of the work, Z0 (docs/path.md). X and Y are not simulated; the gap is the one below the electrode
    #[arg(long, value_name = "FILE", conflicts_with_all = ["depth_mm", "surrogate"])]
    pub path: Option<PathBuf>,
    /// Make the hole by a technology table, row after row, as examples/technology.toml (docs/technology.md); the head runs the rows by
    /// itself, and the generator follows them
    #[arg(long, value_name = "FILE", conflicts_with_all = ["path", "surrogate"])]
    pub table: Option<PathBuf>,
    /// Write the report as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write a table with one row per millisecond (t_s, position_um, setpoint_um, velocity_um_s, surface_um, gap_um, gap_v,
    /// filtered_v, duty, state, wear_um, debris, damage, contact_n, film_n; pulses since the start as the head takes them: open,
    /// spark, arc, short, uncertain; what it senses: hazard_per_s, hazard_deviation_per_s, distance_um, spark_per_s)
    #[arg(long, value_name = "FILE.csv")]
    pub trace: Option<PathBuf>,
    /// Write a plot of the run
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// Print only errors: no progress bar, no summary
    #[arg(long, short)]
    pub quiet: bool,
}

struct Outputs {
    json: Option<Output>,
    trace: Option<Output>,
    plot: Option<Output>,
}

impl Bore {
    /// Runs and reports; true when the hole was bored.
    pub fn execute(&self, run: impl Run) -> Result<bool, Failure> {
        let mut job = self.inputs.job()?;
        if let Some(path) = &self.path {
            take_path(&mut job, path)
                .map_err(|wrong| Failure::BadInput(format!("--path {}: {wrong}", path.display())))?;
        }
        if let Some(table) = &self.table {
            take_table(&mut job, table)
                .map_err(|wrong| Failure::BadInput(format!("--table {}: {wrong}", table.display())))?;
        }
        self.check(&job).map_err(Failure::BadInput)?;
        let outputs = self.claim().map_err(Failure::BadInput)?;
        let mut recorder = Recorder::new(outputs.trace.as_ref(), outputs.plot.is_some()).map_err(Failure::Failed)?;

        let bar = Bar::new(job.path.as_ref().map_or(job.depth_mm, |path| path.length_mm), self.quiet);
        let start = Instant::now();
        let outcome = run(&job, &mut recorder, &mut |progress| bar.show(progress));
        let wall_time_s = start.elapsed().as_secs_f64();
        bar.finish();
        let outcome = outcome.map_err(Failure::Failed)?;

        let figures = recorder.statistics.figures();
        let report = Report::new(&job, &outcome, &figures, wall_time_s);
        if !self.quiet {
            let title = &job.setup.title;
            say(&format!("Simulated bore: {title} (scenario {}, seed {})\n\n", report.scenario, report.seed));
            say(&Summary { report: &report }.to_string());
        }
        self.write(outputs, recorder, &report, &job).map_err(Failure::Failed)?;
        Ok(outcome.completed)
    }

    /// The guided check of values other than those of a scenario that comes with the program.
    fn check(&self, job: &Job) -> Result<(), String> {
        let Inputs { scenario, set, .. } = &self.inputs;
        match BUILT_IN.iter().find(|(name, _)| name == scenario) {
            Some(_) if set.is_empty() => Ok(()),
            Some((name, _)) => bore::guided_check(&job.setup, Some(&Setup::load(name)?), job.seed),
            None => bore::guided_check(&job.setup, None, job.seed),
        }
    }

    fn claim(&self) -> Result<Outputs, String> {
        let outputs = Outputs {
            json: Output::claim_any("--json", self.json.as_deref())?,
            trace: Output::claim_any("--trace", self.trace.as_deref())?,
            plot: Output::claim_any("--plot", self.plot.as_deref())?,
        };
        let all: Vec<&Output> = [&outputs.json, &outputs.trace, &outputs.plot].into_iter().flatten().collect();
        for (i, output) in all.iter().enumerate() {
            if self.path.as_deref().is_some_and(|path| output.replaces(path)) {
                return Err(format!("{}: must not be the G-code program itself", output.label()));
            }
            if self.table.as_deref().is_some_and(|table| output.replaces(table)) {
                return Err(format!("{}: must not be the technology table itself", output.label()));
            }
            if output.replaces(Path::new(&self.inputs.scenario)) {
                return Err(format!("{}: must not be the scenario file itself", output.label()));
            }
            if let Some(other) = all.iter().skip(i + 1).find(|other| output.collides(other)) {
                return Err(format!("{} and {}: must be different files", output.label(), other.label()));
            }
        }
        Ok(outputs)
    }

    fn write(&self, outputs: Outputs, recorder: Recorder, report: &Report, job: &Job) -> Result<(), String> {
        let mut written = Vec::new();
        if let Some(output) = outputs.json {
            written.push(output.label().to_owned());
            output.write_json(report)?;
        }
        if let (Some(output), Some(trace)) = (outputs.trace, recorder.trace) {
            written.push(output.label().to_owned());
            trace.finish(output)?;
        }
        if let (Some(output), Some(picture)) = (outputs.plot, recorder.picture) {
            written.push(output.label().to_owned());
            let svg = picture.draw(report, &job.setup.title, job.path.as_ref())?;
            output.write(|file| file.write_all(svg.as_bytes()))?;
        }
        if !self.quiet && !written.is_empty() {
            say(&format!("  {:<12} {}\n", "Written", written.join(", ")));
        }
        Ok(())
    }
}

/// Has a job erode along the program in a file.
fn take_path(job: &mut Job, path: &Path) -> Result<(), String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("cannot be read: {error}"))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let program = bore::program(&job.setup, Program::parse(&name, &text)?)?;
    job.depth_mm = program.depth_mm();
    job.path = Some(program);
    Ok(())
}

/// Has a job make its hole by the technology table in a file.
fn take_table(job: &mut Job, file: &Path) -> Result<(), String> {
    let text = std::fs::read_to_string(file).map_err(|error| format!("cannot be read: {error}"))?;
    job.table = Some(bore::table(&job.setup, job.depth_mm, File::parse(&text)?)?);
    Ok(())
}

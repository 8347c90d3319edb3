//! `edm-sim sweep`: every scenario with many seeds, against the bounds that the head has to keep.

use crate::bore;
use crate::observe::Recorder;
use crate::report::Report;
use crate::run::{Job, Setup};
use crate::scenario::BUILT_IN;
use crate::terminal::{Failure, say};
use clap::Args;
use std::fmt::Write;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// Arguments of `edm-sim sweep`.
#[derive(Debug, Args)]
pub struct Sweep {
    /// Seeds 1 to N
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: u64,
    /// Depth of each hole, mm
    #[arg(long, value_name = "MM", default_value_t = 0.5)]
    pub depth_mm: f64,
    /// Only this scenario
    #[arg(long, value_name = "NAME")]
    pub scenario: Option<String>,
}

/// One count of the encoder, mm: how exactly the depth has to be reached.
const COUNT_MM: f64 = 0.001;

impl Sweep {
    /// Runs everything and prints a table; true when every bound is kept.
    pub fn execute(&self) -> Result<bool, Failure> {
        let mut jobs = Vec::new();
        for (name, _) in BUILT_IN.iter().filter(|(name, _)| self.scenario.as_deref().is_none_or(|only| only == *name)) {
            let setup = Setup::load(name).map_err(Failure::BadInput)?;
            let range = bore::depth_range_mm(&setup);
            if !range.contains(&self.depth_mm) {
                let allowed = format!("must be a number from {} to {} mm", range.start(), range.end());
                return Err(Failure::BadInput(format!("--depth-mm {}: {allowed}", self.depth_mm)));
            }
            let job = |seed| Job { setup: setup.clone(), depth_mm: self.depth_mm, seed, surrogate: false };
            jobs.extend((1..=self.seeds).map(job));
        }
        if jobs.is_empty() {
            let names: Vec<&str> = BUILT_IN.iter().map(|(name, _)| *name).collect();
            return Err(Failure::BadInput(format!("--scenario: must be one of {}", names.join(", "))));
        }
        let reports = run_all(&jobs).map_err(Failure::Failed)?;
        let (table, broken) = judge(&reports);
        say(&table);
        Ok(broken == 0)
    }
}

/// Runs the jobs on every core; the order of the reports is that of the jobs.
fn run_all(jobs: &[Job]) -> Result<Vec<Report>, String> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::new());
    let workers = thread::available_parallelism().map_or(1, usize::from).min(jobs.len());
    thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                while let Some((index, job)) = {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    jobs.get(index).map(|job| (index, job))
                } {
                    let report = run(job);
                    if let Ok(mut done) = done.lock() {
                        done.push((index, report));
                    }
                }
            });
        }
    });
    let mut done = done.into_inner().map_err(|_| "a run ended abnormally")?;
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, report)| report).collect()
}

fn run(job: &Job) -> Result<Report, String> {
    let mut recorder = Recorder::new(None, false)?;
    let outcome = bore::bore(job, &mut recorder, &mut |_| {})?;
    Ok(Report::new(job, &outcome, &recorder.statistics.figures(), 0.0))
}

fn depth_error_mm(report: &Report) -> Option<f64> {
    Some((report.depth_mm? - report.target_depth_mm).abs())
}

/// What a run breaks, in a few words each.
fn broken(report: &Report) -> Vec<String> {
    let mut broken = Vec::new();
    let mut demand = |kept: bool, what: String| {
        if !kept {
            broken.push(what);
        }
    };
    demand(report.completed, format!("stopped: {}", report.stop_reason));
    demand(report.faults.is_empty(), format!("{} faults", report.faults.len()));
    demand(depth_error_mm(report).is_some_and(|error| error <= COUNT_MM), format!("{:?} mm deep", report.depth_mm));
    demand(report.lost_counts == 0, format!("{} counts lost", report.lost_counts));
    demand(report.illegal_transitions == 0, format!("{} illegal transitions", report.illegal_transitions));
    if report.scenario == "default" {
        let volts = &report.gap_voltage_v;
        demand(
            volts.rms_error_100ms.is_some_and(|rms| rms <= 3.0),
            format!("{:?} V rms of 100 ms means", volts.rms_error_100ms),
        );
        let ratio = volts.filtered_rms.zip(volts.shot_floor_rms).map(|(rms, floor)| rms / floor);
        demand(ratio.is_some_and(|ratio| ratio <= 1.3), format!("{ratio:?} times the shot floor"));
        let swing = report.position_pp_um_median;
        demand(swing.is_some_and(|um| um <= 15.0), format!("{swing:?} um swing"));
        let line = report.position_line_um.amplitude;
        demand(line.is_some_and(|um| um <= 3.0), format!("{line:?} um at one pitch"));
    }
    broken
}

/// A table with the worst of each scenario, and how many runs broke a bound.
fn judge(reports: &[Report]) -> (String, usize) {
    let mut text = String::from(
        "| scenario | runs | depth error um | 100 ms means V rms | filtered / floor | swing um | line um | long retreats | bounds |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let mut failures = String::new();
    let mut count = 0;
    for (name, _) in BUILT_IN {
        let runs: Vec<&Report> = reports.iter().filter(|report| report.scenario == *name).collect();
        if runs.is_empty() {
            continue;
        }
        let worst = |figure: &dyn Fn(&Report) -> Option<f64>| {
            runs.iter().filter_map(|report| figure(report)).fold(0.0f64, f64::max)
        };
        let mut kept = 0;
        for report in &runs {
            let broken = broken(report);
            if broken.is_empty() {
                kept += 1;
            } else {
                count += 1;
                let _ = writeln!(failures, "{name}, seed {}: {}", report.seed, broken.join(", "));
            }
        }
        let _ = writeln!(
            text,
            "| {name} | {} | {:.2} | {:.2} | {:.2} | {:.1} | {:.1} | {:.0} | {kept} of {} |",
            runs.len(),
            worst(&|r| Some(depth_error_mm(r)? * 1e3)),
            worst(&|r| r.gap_voltage_v.rms_error_100ms),
            worst(&|r| Some(r.gap_voltage_v.filtered_rms? / r.gap_voltage_v.shot_floor_rms?)),
            worst(&|r| r.position_pp_um_median),
            worst(&|r| r.position_line_um.amplitude),
            worst(&|r| Some(r.long_retreats as f64)),
            runs.len(),
        );
    }
    text.push_str("\nWorst of the runs in each column; simulated.\n");
    text.push_str(&failures);
    (text, count)
}

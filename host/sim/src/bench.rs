//! `edm-sim bench`: speed and memory of the native loop.
//!
//! Speed is measured in processor time of this process, not in wall-clock time: other programs on the computer then matter
//! little. (Little, not nothing: two threads of one core share its units, and both are slower.)
//!
//! Seconds on one machine say little about another. The calibration loop is fixed arithmetic of the kind the simulation
//! does (dependent f32 multiply-adds with a clamp, fed by an integer generator); each run is timed next to a pass of it.
//! The *relative speed* is the number of seconds simulated while one pass takes its time: it can be compared between
//! machines and between versions. Changing the loop makes older figures worthless: raise [`SCHEMA`] with it.

use crate::inputs::Inputs;
use crate::observe::{Recorder, Run};
use crate::output::Output;
use crate::terminal::{Failure, say};
use clap::Args;
use cpu_time::ProcessTime;
use serde::Serialize;
use std::fmt;
use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

/// Name and version of the JSON.
pub const SCHEMA: &str = "edm-sim.bench/2";
/// Steps in a pass of the calibration loop.
pub const CALIBRATION_STEPS: u32 = 20_000_000;
/// Simulated seconds per second of processor time that a slow and busy machine still reaches in the scenarios with a
/// bound; docs/performance.md says what was measured.
pub const BOUNDS: &[(&str, f64)] =
    &[("default", 40.0), ("sinker", 40.0), ("sinker-100khz", 8.0), ("micro-blind", 20.0)];

/// Arguments of `edm-sim bench`.
#[derive(Debug, Args)]
pub struct Bench {
    /// The hole, the process and the head.
    #[command(flatten)]
    pub inputs: Inputs,
    /// Runs to take the median of
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub runs: u32,
    /// Least simulated seconds per second of processor time [default: 40 in the scenarios default
    /// and sinker, 8 in sinker-100khz, 20 in micro-blind, if unchanged; otherwise none]
    #[arg(long, value_name = "RATIO", value_parser = ratio, allow_hyphen_values = true)]
    pub at_least: Option<f64>,
    /// Write the measurement as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// What was measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measurement {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// Scenario, and what was changed on the command line.
    pub scenario: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Simulated seconds per second of processor time, of the median run.
    pub realtime_cpu_ratio: f64,
    /// Least value required.
    pub bound: Option<f64>,
    /// Median of the runs.
    pub median: Speed,
    /// Each run.
    pub runs: Vec<Speed>,
    /// From the start of the command to the first progress, s; `None` if there was none.
    pub first_progress_s: Option<f64>,
    /// Largest memory the process held, MB (10^6 bytes); `None` where the system does not report it.
    pub peak_memory_mb: Option<f64>,
}

/// Speed of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Speed {
    /// Time simulated, s.
    pub sim_time_s: f64,
    /// Time of the processor that it took, s.
    pub cpu_time_s: f64,
    /// Time that went by, s.
    pub wall_time_s: f64,
    /// Time of the processor that a pass of the calibration loop took next to it, s.
    pub calibration_s: f64,
    /// Simulated seconds a second of the processor.
    pub realtime_cpu_ratio: f64,
    /// Simulated seconds a pass of the calibration loop.
    pub relative_speed: f64,
}

impl Speed {
    fn new(sim_time_s: f64, cpu_time_s: f64, wall_time_s: f64, calibration_s: f64) -> Speed {
        let realtime_cpu_ratio = sim_time_s / cpu_time_s;
        Speed {
            sim_time_s,
            cpu_time_s,
            wall_time_s,
            calibration_s,
            realtime_cpu_ratio,
            relative_speed: realtime_cpu_ratio * calibration_s,
        }
    }
}

fn ratio(text: &str) -> Result<f64, String> {
    let ratio = text.parse().ok().filter(|ratio| (0.0..=1e6).contains(ratio));
    ratio.ok_or_else(|| "must be a number from 0 to 1000000".into())
}

impl Bench {
    /// Measures and reports; true when the bound is reached.
    ///
    /// # Errors
    /// When the input is refused, the run cannot be made or the output cannot be written.
    pub fn execute(&self, run: impl Run) -> Result<bool, Failure> {
        let start = Instant::now();
        let job = self.inputs.job()?;
        let json = Output::claim_any("--json", self.json.as_deref()).map_err(Failure::BadInput)?;

        let mut first_progress_s = None;
        let mut runs = Vec::new();
        for _ in 0..self.runs {
            let mut recorder = Recorder::new(None, false).map_err(Failure::Failed)?;
            let (began, given) = (Instant::now(), ProcessTime::now());
            let outcome = run(&job, &mut recorder, &mut |_| {
                first_progress_s.get_or_insert_with(|| start.elapsed().as_secs_f64());
            })
            .map_err(Failure::Failed)?;
            let (cpu_time_s, wall_time_s) = (given.elapsed().as_secs_f64(), began.elapsed().as_secs_f64());
            black_box(recorder.statistics.figures());
            runs.push(Speed::new(outcome.sim_time_s, cpu_time_s, wall_time_s, calibrate(CALIBRATION_STEPS)));
        }
        let (median, scenario) = (median(&runs), job.label());
        let known = BOUNDS.iter().find(|(name, _)| *name == scenario).map(|(_, bound)| *bound);
        let bound = self.at_least.or(known);
        let measurement = Measurement {
            schema: SCHEMA,
            scenario,
            seed: job.seed,
            realtime_cpu_ratio: median.realtime_cpu_ratio,
            bound,
            median,
            runs,
            first_progress_s,
            peak_memory_mb: peak_memory_mb(),
        };
        say(&measurement.to_string());
        json.map_or(Ok(()), |output| output.write_json(&measurement)).map_err(Failure::Failed)?;
        Ok(bound.is_none_or(|bound| measurement.realtime_cpu_ratio >= bound))
    }
}

impl fmt::Display for Measurement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "Speed of the simulation: scenario {}, seed {}, {} runs\n",
            self.scenario,
            self.seed,
            self.runs.len()
        )?;
        let Speed { sim_time_s, cpu_time_s, wall_time_s, calibration_s, realtime_cpu_ratio, relative_speed } =
            self.median;
        let bound = match self.bound {
            Some(bound) if realtime_cpu_ratio < bound => format!("; below the bound of {bound}"),
            Some(bound) => format!("; bound {bound}"),
            None => String::new(),
        };
        writeln!(
            f,
            "  Real time      {realtime_cpu_ratio:.1} x ({sim_time_s:.1} s simulated in {cpu_time_s:.2} s of processor time, {wall_time_s:.2} s of wall-clock time){bound}"
        )?;
        writeln!(f, "  Relative       {relative_speed:.2} s simulated per calibration pass of {calibration_s:.3} s")?;
        let slowest = self.runs.iter().map(|run| run.relative_speed).fold(f64::INFINITY, f64::min);
        let fastest = self.runs.iter().map(|run| run.relative_speed).fold(0.0, f64::max);
        writeln!(f, "  Spread         {slowest:.2} to {fastest:.2}")?;
        let or_unknown = |value: Option<String>| value.unwrap_or_else(|| "not available on this system".into());
        writeln!(f, "  First progress {}", or_unknown(self.first_progress_s.map(|s| format!("after {s:.3} s"))))?;
        writeln!(f, "  Peak memory    {}", or_unknown(self.peak_memory_mb.map(|mb| format!("{mb:.1} MB"))))
    }
}

/// The run with the median relative speed; the slower of the middle two.
fn median(runs: &[Speed]) -> Speed {
    let mut sorted = runs.to_vec();
    sorted.sort_by(|a, b| a.relative_speed.total_cmp(&b.relative_speed));
    sorted[sorted.len().saturating_sub(1) / 2]
}

/// Time of one pass of the calibration loop, s.
fn calibrate(steps: u32) -> f64 {
    let start = ProcessTime::now();
    black_box(calibration_loop(black_box(steps)));
    start.elapsed().as_secs_f64()
}

/// Two poles after one another and a clamped integrator, driven by a congruential generator: four dependent multiply-adds
/// and a clamp a step.
fn calibration_loop(steps: u32) -> f32 {
    let (mut random, mut first, mut second, mut integral) = (1u32, 0f32, 0f32, 0f32);
    for _ in 0..steps {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let input = (random >> 8) as f32 * (1.0 / 16_777_216.0) - 0.5;
        first += 0.1 * (input - first);
        second += 0.1 * (first - second);
        integral = (integral + second - 0.001 * integral).clamp(-1.0, 1.0);
    }
    integral
}

/// VmHWM of this process; only Linux reports it.
fn peak_memory_mb() -> Option<f64> {
    peak_of(&std::fs::read_to_string("/proc/self/status").ok()?)
}

fn peak_of(status: &str) -> Option<f64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024.0 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_calibration_loop_is_the_one_the_figures_were_made_with() {
        // Exact: IEEE arithmetic in this order gives this on every machine.
        assert_eq!(calibration_loop(0), 0.0);
        assert_eq!(calibration_loop(100_000).to_bits(), 1_024_782_279);
    }

    #[test]
    fn the_median_is_a_run_that_took_place() {
        let run = |speed| Speed::new(speed, 1.0, 2.0, 1.0);
        assert_eq!(median(&[run(3.0), run(1.0), run(2.0)]), run(2.0));
        assert_eq!(median(&[run(4.0), run(1.0)]), run(1.0));
        assert_eq!(median(&[run(4.0)]), run(4.0));
    }

    #[test]
    fn relative_speed_does_not_depend_on_the_speed_of_the_machine() {
        assert_eq!(Speed::new(10.0, 0.1, 0.3, 0.2).relative_speed, Speed::new(10.0, 0.2, 0.3, 0.4).relative_speed);
    }

    #[test]
    fn peak_memory_is_read_where_the_system_tells_it() {
        assert_eq!(peak_of("VmPeak:\t  9999 kB\nVmHWM:\t   50000 kB\n"), Some(51.2));
        assert_eq!(peak_of("VmPeak:\t  9999 kB\n"), None);
    }
}

//! `edm-sim replay`: a recording of a gap through the head's filters and classifier.

use crate::output::Output;
use crate::replay::converter::Gate;
use crate::replay::recording::{Channels, Recording};
use crate::replay::{draw, run};
use crate::run::Setup;
use crate::terminal::{Failure, say};
use clap::Args;
use std::path::PathBuf;

/// Arguments of `edm-sim replay`.
#[derive(Debug, Args)]
pub struct Replay {
    /// Recording: CSV with the columns t_s, gap_v and optionally gap_i and gate, or an export of a Rigol, Siglent, Tektronix,
    /// Rohde & Schwarz, Hantek or Pico oscilloscope, of sigrok or Saleae; evenly sampled, 10 kS/s to 10 MS/s
    #[arg(value_name = "IN.csv")]
    pub input: PathBuf,
    /// Settings of the head: the table `head` of a scenario file [default: all defaults]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Change a setting after the file; may be repeated, the last one counts (`edm-sim settings` lists the keys)
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Channel of the gap voltage, in V [default: the first]
    #[arg(long, value_name = "CHANNEL")]
    pub gap_v: Option<String>,
    /// Channel of the gap current, in A
    #[arg(long, value_name = "CHANNEL")]
    pub gap_i: Option<String>,
    /// Channel of the generator's gate: open above 1.5 V
    #[arg(long, value_name = "CHANNEL")]
    pub gate: Option<String>,
    /// Derive the gate: open while the gap voltage has at least this magnitude, or the current is at least gap.short_a
    #[arg(long, value_name = "V", value_parser = volts, allow_hyphen_values = true, conflicts_with = "gate")]
    pub gate_above: Option<f32>,
    /// Write a table with one row per servo tick (t_s, decimated_v, lowpass_v, filtered_v, quality, classes of the pulses that
    /// ended, their shares, notch_hz, followed_v)
    #[arg(long, value_name = "OUT.csv")]
    pub out: PathBuf,
    /// Write a plot
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
}

fn volts(text: &str) -> Result<f32, String> {
    let volts = text.parse().ok().filter(|volts: &f32| (0.1..=300.0).contains(volts));
    volts.ok_or_else(|| "must be a number from 0.1 to 300 V".into())
}

impl Replay {
    /// Reads, runs, writes.
    ///
    /// # Errors
    /// When the input is not usable, or an output cannot be written.
    pub fn execute(&self) -> Result<(), Failure> {
        let (recording, replay, out, plot) = self.checked().map_err(Failure::BadInput)?;
        let name = self.input.file_name().unwrap_or_default().to_string_lossy();
        let svg = plot.as_ref().map(|_| draw(&replay, &recording, &name)).transpose().map_err(Failure::Failed)?;
        replay.write(out).map_err(Failure::Failed)?;
        if let (Some(output), Some(svg)) = (plot, svg) {
            output.write(|file| file.write_all(svg.as_bytes())).map_err(Failure::Failed)?;
        }
        say(&replay.summary(&recording));
        Ok(())
    }

    fn checked(&self) -> Result<(Recording, crate::replay::Replay, Output, Option<Output>), String> {
        let setup = self.setup()?;
        let (out, plot) = self.claim()?;
        let channels = Channels { gap_v: self.gap_v.clone(), gap_i: self.gap_i.clone(), gate: self.gate.clone() };
        let input = |wrong: String| format!("{}: {wrong}", self.input.display());
        let recording = Recording::read(&self.input, &channels).map_err(input)?;
        let settings = &setup.head;
        let gate = self.gate_above.map_or(Gate::AsRecorded, |volts| Gate::Above(volts, settings.gap_short_amps));
        let replay = run(&recording, settings, gate).map_err(input)?;
        Ok((recording, replay, out, plot))
    }

    fn setup(&self) -> Result<Setup, String> {
        let mut setup = match &self.config {
            None => Setup::load("default")?,
            Some(path) => {
                let name = format!("--config {}", path.display());
                let text = std::fs::read_to_string(path).map_err(|error| format!("{name}: cannot be read: {error}"))?;
                Setup::parse(&name, &text)?
            }
        };
        for assignment in &self.set {
            setup.set(assignment).map_err(|message| format!("--set {message}"))?;
        }
        setup.head.build().map_err(|error| setup.refusal(error))?;
        Ok(setup)
    }

    fn claim(&self) -> Result<(Output, Option<Output>), String> {
        let out = Output::claim("--out", &self.out)?;
        let plot = Output::claim_any("--plot", self.plot.as_deref())?;
        for output in [Some(&out), plot.as_ref()].into_iter().flatten() {
            for input in [Some(&self.input), self.config.as_ref()].into_iter().flatten() {
                if output.replaces(input) {
                    return Err(format!("{}: must not be {} itself", output.label(), input.display()));
                }
            }
        }
        if let Some(plot) = plot.as_ref().filter(|plot| plot.collides(&out)) {
            return Err(format!("{} and {}: must be different files", out.label(), plot.label()));
        }
        Ok((out, plot))
    }
}

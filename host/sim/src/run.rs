//! Data between the command line and the machine.
//!
//! The command line hands over a [`Job`] that has been checked; the machine hands back one [`Sample`] a servo tick, a
//! [`Progress`] now and then, and an [`Outcome`]. All values are the model's truth unless they say otherwise.

use crate::process::{Plant, Pulses};
use crate::scenario::Scenario;
use edm_gcode::Program;
use edm_servo_head::gap::pulses::Counts;
use edm_servo_head::gap::senses::Senses;
use edm_servo_head::settings::Settings;
use edm_technology::File;

/// Values for a run.
pub type Setup = Scenario<Plant, Settings>;

/// A run that was checked and may start.
#[derive(Clone, Debug)]
pub struct Job {
    /// Values of process and head.
    pub setup: Setup,
    /// Depth of the hole below the workpiece's first surface, mm; with a path, of its end.
    pub depth_mm: f64,
    /// Path to erode along, instead of straight down.
    pub path: Option<Program>,
    /// Technology table by which the head makes the hole row after row.
    pub table: Option<File>,
    /// Seed of everything random.
    pub seed: u64,
    /// Drive the head from position, noise and an assumed rate of erosion instead of a gap signal (Roberts, sections 6.3 and 6.8).
    pub surrogate: bool,
    /// Largest error of a move of the coarse axis, um, where `inch.step_um` asks for one.
    pub coarse_error_um: f64,
}

impl Job {
    /// Scenario and what was changed on the command line, for reports.
    pub fn label(&self) -> String {
        let path = self.path.as_ref().map(|path| format!(", {}", path.name)).unwrap_or_default();
        let table =
            self.table.as_ref().map(|table| format!(", {} on {}", table.electrode, table.work)).unwrap_or_default();
        format!("{}{path}{table}{}", self.setup.name, if self.surrogate { ", surrogate" } else { "" })
    }
}

/// The machine at one servo tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Simulated time since start, s.
    pub t_s: f64,
    /// Electrode face, positive toward the work, um.
    pub position_um: f64,
    /// Set points of the other axes, X and Y, um.
    pub beside_um: [f64; 2],
    /// Position the servo aims at, um.
    pub setpoint_um: f64,
    /// Velocity of the electrode, um/s.
    pub velocity_um_s: f64,
    /// Workpiece surface, positive down, um.
    pub surface_um: f64,
    /// Distance between both, um; negative while they are pressed together.
    pub gap_um: f64,
    /// Gap voltage of this tick's block, as the head measured it, V.
    pub gap_v: f32,
    /// Gap voltage after the head's filters, V.
    pub filtered_v: f32,
    /// Gap voltage the head tries to keep, V.
    pub setpoint_v: f32,
    /// Signed duty of the H-bridge, -1 to 1, positive toward the work.
    pub duty: f32,
    /// State of the head, by the name it has in reports.
    pub state: &'static str,
    /// Length the electrode has lost, um.
    pub wear_um: f64,
    /// Debris of the front gap, in 5 % by volume.
    pub debris: f64,
    /// Mean damage of the surfaces by arcs.
    pub damage: f64,
    /// Force between electrode and work, N.
    pub contact_n: f64,
    /// Force of the dielectric's film on the electrode, N, positive toward the work.
    pub film_n: f64,
    /// What became of the pulses so far.
    pub pulses: Pulses,
    /// What the head takes them for, so far.
    pub counts: Counts,
    /// What it takes the gap for.
    pub senses: Senses,
}

/// Observes a run, once per servo tick.
pub trait Observer {
    /// Takes the newest sample; its cost is paid 20 000 times in every simulated second.
    fn sample(&mut self, sample: &Sample);
}

/// How far a run has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Simulated time since start, s.
    pub sim_time_s: f64,
    /// Depth of the electrode so far, or length of path behind it, mm.
    pub done_mm: f64,
    /// State of the head.
    pub state: &'static str,
}

/// A fault, when it was raised.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FaultEvent {
    /// Simulated time, s.
    pub t_s: f64,
    /// Name of the fault.
    pub fault: String,
}

/// How a run ended.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Depth reached, and no fault.
    pub completed: bool,
    /// Why the run ended, in a few words that can follow "stopped: ".
    pub stop_reason: String,
    /// Where the electrode face ended up below the workpiece's first surface, mm.
    pub depth_mm: f64,
    /// Depth of the hole, mm: a gap more than the electrode's.
    pub hole_depth_mm: f64,
    /// Length the electrode has lost, mm.
    pub wear_mm: f64,
    /// Share of the face before which nothing is left.
    pub through: f64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Scatter of the filtered gap voltage that chance alone gives at a gap held still, V rms; `None` without pulses.
    pub shot_floor_rms_v: Option<f64>,
    /// What became of the pulses.
    pub pulses: Pulses,
    /// Mean size of the last craters, um.
    pub crater_um: f64,
    /// Deepest pit that arcs in one place have left, um.
    pub pit_um: f64,
    /// Volume of work removed, mm^3.
    pub removed_mm3: f64,
    /// Difference of the head's position and the truth, encoder counts.
    pub lost_counts: u64,
    /// Illegal encoder transitions the head saw.
    pub illegal_transitions: u64,
    /// Jumps made.
    pub jumps: u64,
    /// Some due jumps were lower than set, or left out, because there was no room above.
    pub cramped: bool,
    /// Moves of the coarse axis, and how far it has carried the head, mm.
    pub inches: u64,
    /// See [`inches`](Outcome::inches).
    pub carried_mm: f64,
    /// Rows of a technology table, in the order in which they ran.
    pub rows: Vec<RowOutcome>,
    /// Faults in the order they were raised.
    pub faults: Vec<FaultEvent>,
}

/// A row of a technology table, as it ran.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct RowOutcome {
    /// Its name.
    pub name: String,
    /// When it began, and when the next did, s.
    pub from_s: f64,
    /// See [`from_s`](RowOutcome::from_s).
    pub to_s: f64,
    /// Time in state *eroding*, s.
    pub eroding_s: f64,
    /// Depth of the electrode at its end, by the head, mm.
    pub depth_mm: f64,
    /// Counts by which that is deeper than the row is to end.
    pub off_counts: i64,
    /// Mean gap while eroding, um.
    pub gap_um: f64,
    /// Mean gap voltage while eroding, V.
    pub gap_v: f64,
    /// Shares of its pulses: sparks, arcs.
    pub spark_ratio: f64,
    /// See [`spark_ratio`](RowOutcome::spark_ratio).
    pub arc_ratio: f64,
    /// Mean size of the last craters, um.
    pub crater_um: f64,
}

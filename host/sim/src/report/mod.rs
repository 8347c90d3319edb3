//! The run in JSON, and in words ([`Summary`]).
//!
//! Depth, gap, pulses and losses are the model's truth, not the firmware's values. Control figures are those of
//! [`crate::statistics`]; a figure without monitored time is `null`.

mod summary;
mod verdict;

pub use summary::Summary;
pub use verdict::Finding;

use crate::run::{FaultEvent, Job, Outcome, RowOutcome};
use crate::statistics::Figures;
use edm_servo_head::gap::controlled::ControlledName;
use edm_servo_head::head::Structure;
use serde::Serialize;

/// Name and version of the JSON; a key that goes or changes its meaning raises the number.
pub const SCHEMA: &str = "edm-sim.bore/1";

/// Figures of a run, in the order of the JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// Scenario, and what was changed on the command line.
    pub scenario: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Depth reached, and no fault.
    pub completed: bool,
    /// Why the run ended.
    pub stop_reason: String,
    /// Depth of the electrode, mm.
    pub depth_mm: Option<f64>,
    /// Depth of the hole, mm: a gap more.
    pub hole_depth_mm: Option<f64>,
    /// Length the electrode has lost, mm.
    pub wear_mm: Option<f64>,
    /// Share of the face before which nothing is left.
    pub through_ratio: f64,
    /// Depth requested, mm.
    pub target_depth_mm: f64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Simulated time in which the feed law led, s: neither seek nor retreat nor fault.
    pub eroding_time_s: f64,
    /// Simulated time from the first pulse at the work to the depth, s: with retreats and jumps, without the seek.
    pub machining_time_s: f64,
    /// Depth of the hole over the eroding time, mm/min.
    pub rate_mm_min: Option<f64>,
    /// Time it took, s.
    pub wall_time_s: f64,
    /// Gap voltage.
    pub gap_voltage_v: GapVoltage,
    /// Gap.
    pub gap_um: Gap,
    /// Position ripple: median over 0.5 s windows of the electrode's peak-to-peak motion without feed, um.
    pub position_pp_um_median: Option<f64>,
    /// Strongest tone of the electrode's motion between 5 and 50 Hz.
    pub position_line_um: Line,
    /// Velocity of the electrode above 50 Hz, mm/s rms.
    pub vibration_mm_s: Option<f64>,
    /// Velocity of the electrode, mm/s rms.
    pub velocity_mm_s: Option<f64>,
    /// Share of the time with the duty at `axis.duty_limit`.
    pub duty_at_limit_ratio: Option<f64>,
    /// Share of pulses that never ignited; the four shares make 1.
    pub open_ratio: Option<f64>,
    /// Share of sparks.
    pub spark_ratio: Option<f64>,
    /// Share of arcs.
    pub arc_ratio: Option<f64>,
    /// Share of shorts.
    pub short_ratio: Option<f64>,
    /// Sparks and arcs.
    pub discharges: u64,
    /// Backward moves of the electrode by more than 5 um, whether the feed law or a retreat made them.
    pub long_retreats: u64,
    /// Share of cycles of 100 ms in which nine tenths of the pulses were shorts.
    pub short_cycle_ratio: Option<f64>,
    /// Shorts of whole milliseconds.
    pub shorts: u64,
    /// Those from which the electrode moved back by more than 5 um before they ended.
    pub long_retreats_shorted: u64,
    /// Volume removed over the eroding time, mm^3/min.
    pub removal_mm3_min: Option<f64>,
    /// Mean size of the last craters, um: what roughness goes with.
    pub crater_um: Option<f64>,
    /// Mean debris of the front gap while the feed law leads, in 5 % by volume.
    pub debris_mean: Option<f64>,
    /// Mean damage of the surfaces by arcs, likewise; 1 doubles a clean channel's recovery time.
    pub damage_mean: Option<f64>,
    /// Deepest pit that arcs in one place have left, um.
    pub pit_um: Option<f64>,
    /// Largest force between electrode and work, N.
    pub contact_n_max: f64,
    /// Largest force of the dielectric's film on the electrode, N.
    pub film_n_max: f64,
    /// Encoder counts lost.
    pub lost_counts: u64,
    /// Illegal encoder transitions.
    pub illegal_transitions: u64,
    /// Jumps out of the work.
    pub jumps: u64,
    /// Jumps that were due were lower than `jump.height_um`, or left out, because there was no room above.
    pub jumps_cramped: bool,
    /// Moves of the coarse axis.
    pub inches: u64,
    /// How far it has carried the head, mm.
    pub carried_mm: f64,
    /// Rows of a technology table, in the order in which they ran.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rows: Vec<RowOutcome>,
    /// Faults in the order they were raised.
    pub faults: Vec<FaultEvent>,
    /// What is beyond its limit; empty when nothing is.
    pub findings: Vec<Finding>,
}

/// Gap voltage, V.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GapVoltage {
    /// Mean.
    pub mean: Option<f64>,
    /// Mean of what the head tried to keep; `None` where its law goes by something else.
    pub setpoint: Option<f64>,
    /// Deviation of 100 ms means from the set point, rms; likewise.
    pub rms_error_100ms: Option<f64>,
    /// Scatter of the filtered voltage about its mean, rms.
    pub filtered_rms: Option<f64>,
    /// Scatter that chance alone gives at a gap held still, rms.
    pub shot_floor_rms: Option<f64>,
}

/// Gap, um.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Gap {
    /// Mean.
    pub mean: Option<f64>,
    /// Scatter about the mean, rms.
    pub rms_error: Option<f64>,
}

/// A tone in the electrode's motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Line {
    /// Amplitude (half of peak-to-peak), um.
    pub amplitude: Option<f64>,
    /// Frequency, Hz.
    pub hz: Option<f64>,
}

impl Report {
    /// Puts together what job, machine and figures know.
    pub fn new(job: &Job, outcome: &Outcome, figures: &Figures, wall_time_s: f64) -> Report {
        let pulses = &outcome.pulses;
        let total = pulses.open + pulses.spark + pulses.arc + pulses.short;
        let share = |pulses: u64| tidy(pulses as f64 / total as f64);
        // An electrode that stands above the work has made no hole.
        let depth = |mm: f64| tidy(mm).map(|depth| depth.max(0.0));
        let hole_depth_mm = depth(outcome.hole_depth_mm);
        let head = &job.setup.head;
        let by_error = head.structure == Structure::SingleLoop || head.law.by_error();
        // Rows have set points and laws of their own.
        let keeps_voltage = head.controlled == ControlledName::GapVoltage && by_error && job.table.is_none();
        let mut report = Report {
            schema: SCHEMA,
            scenario: job.label(),
            seed: job.seed,
            completed: outcome.completed,
            stop_reason: outcome.stop_reason.clone(),
            depth_mm: depth(outcome.depth_mm),
            hole_depth_mm,
            wear_mm: tidy(outcome.wear_mm),
            through_ratio: rounded(outcome.through),
            target_depth_mm: job.depth_mm,
            sim_time_s: rounded(outcome.sim_time_s),
            eroding_time_s: rounded(figures.eroding_s),
            machining_time_s: rounded(figures.machining_s),
            rate_mm_min: hole_depth_mm.and_then(|depth| tidy(depth / figures.eroding_s * 60.0)),
            wall_time_s: rounded(wall_time_s),
            gap_voltage_v: GapVoltage {
                mean: figures.gap_v_mean.and_then(tidy),
                setpoint: figures.setpoint_v.filter(|_| keeps_voltage).and_then(tidy),
                rms_error_100ms: figures.gap_v_rms_error.filter(|_| keeps_voltage).and_then(tidy),
                filtered_rms: figures.filtered_v_rms.and_then(tidy),
                shot_floor_rms: outcome.shot_floor_rms_v.and_then(tidy),
            },
            gap_um: Gap { mean: figures.gap_um_mean.and_then(tidy), rms_error: figures.gap_um_rms.and_then(tidy) },
            position_pp_um_median: figures.position_pp_um.and_then(tidy),
            position_line_um: Line {
                amplitude: figures.line.and_then(|line| tidy(line.amplitude_um)),
                hz: figures.line.and_then(|line| tidy(line.hz)),
            },
            vibration_mm_s: figures.vibration_mm_s.and_then(tidy),
            velocity_mm_s: figures.velocity_mm_s.and_then(tidy),
            duty_at_limit_ratio: figures.duty.at_limit(head.axis_duty_limit.into()).and_then(tidy),
            open_ratio: share(pulses.open),
            spark_ratio: share(pulses.spark),
            arc_ratio: share(pulses.arc),
            short_ratio: share(pulses.short),
            discharges: pulses.spark + pulses.arc,
            long_retreats: figures.long_retreats,
            short_cycle_ratio: figures.short_cycle_ratio.and_then(tidy),
            shorts: figures.shorts,
            long_retreats_shorted: figures.long_retreats_shorted,
            removal_mm3_min: tidy(outcome.removed_mm3.max(0.0) / figures.eroding_s * 60.0),
            crater_um: tidy(outcome.crater_um),
            debris_mean: figures.debris.and_then(tidy),
            damage_mean: figures.damage.and_then(tidy),
            pit_um: tidy(outcome.pit_um),
            contact_n_max: rounded(figures.contact_n),
            film_n_max: rounded(figures.film_n),
            lost_counts: outcome.lost_counts,
            illegal_transitions: outcome.illegal_transitions,
            jumps: outcome.jumps,
            jumps_cramped: outcome.cramped,
            inches: outcome.inches,
            carried_mm: rounded(outcome.carried_mm),
            rows: outcome.rows.clone(),
            faults: outcome.faults.clone(),
            findings: Vec::new(),
        };
        report.findings = verdict::findings(&report);
        report
    }
}

/// Six decimals, the last of them a nanometre of depth.
fn rounded(x: f64) -> f64 {
    (x * 1e6).round() / 1e6
}

/// Rounded; what is no number is left out.
fn tidy(x: f64) -> Option<f64> {
    x.is_finite().then(|| rounded(x))
}

#[cfg(test)]
mod tests;

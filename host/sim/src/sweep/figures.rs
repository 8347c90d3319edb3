//! The figures of a run, named as in the JSON of a bore.

use crate::report::Report;
use serde_json::{Value, json};

/// A figure of a report.
type Figure = fn(&Report) -> Value;

/// All of them.
pub const FIGURES: &[(&str, Figure)] = &[
    ("carried_mm", |r| json!(r.carried_mm)),
    ("inches", |r| json!(r.inches)),
    ("completed", |r| json!(r.completed)),
    ("stop_reason", |r| json!(r.stop_reason)),
    ("depth_mm", |r| json!(r.depth_mm)),
    ("hole_depth_mm", |r| json!(r.hole_depth_mm)),
    ("wear_mm", |r| json!(r.wear_mm)),
    ("through_ratio", |r| json!(r.through_ratio)),
    ("sim_time_s", |r| json!(r.sim_time_s)),
    ("eroding_time_s", |r| json!(r.eroding_time_s)),
    ("machining_time_s", |r| json!(r.machining_time_s)),
    ("rate_mm_min", |r| json!(r.rate_mm_min)),
    ("gap_voltage_v.mean", |r| json!(r.gap_voltage_v.mean)),
    ("gap_voltage_v.setpoint", |r| json!(r.gap_voltage_v.setpoint)),
    ("gap_voltage_v.rms_error_100ms", |r| json!(r.gap_voltage_v.rms_error_100ms)),
    ("gap_voltage_v.filtered_rms", |r| json!(r.gap_voltage_v.filtered_rms)),
    ("gap_voltage_v.shot_floor_rms", |r| json!(r.gap_voltage_v.shot_floor_rms)),
    ("gap_um.mean", |r| json!(r.gap_um.mean)),
    ("gap_um.rms_error", |r| json!(r.gap_um.rms_error)),
    ("position_pp_um_median", |r| json!(r.position_pp_um_median)),
    ("position_line_um.amplitude", |r| json!(r.position_line_um.amplitude)),
    ("position_line_um.hz", |r| json!(r.position_line_um.hz)),
    ("vibration_mm_s", |r| json!(r.vibration_mm_s)),
    ("velocity_mm_s", |r| json!(r.velocity_mm_s)),
    ("duty_at_limit_ratio", |r| json!(r.duty_at_limit_ratio)),
    ("open_ratio", |r| json!(r.open_ratio)),
    ("spark_ratio", |r| json!(r.spark_ratio)),
    ("arc_ratio", |r| json!(r.arc_ratio)),
    ("short_ratio", |r| json!(r.short_ratio)),
    ("discharges", |r| json!(r.discharges)),
    ("long_retreats", |r| json!(r.long_retreats)),
    ("short_cycle_ratio", |r| json!(r.short_cycle_ratio)),
    ("shorts", |r| json!(r.shorts)),
    ("long_retreats_shorted", |r| json!(r.long_retreats_shorted)),
    ("removal_mm3_min", |r| json!(r.removal_mm3_min)),
    ("crater_um", |r| json!(r.crater_um)),
    ("debris_mean", |r| json!(r.debris_mean)),
    ("damage_mean", |r| json!(r.damage_mean)),
    ("pit_um", |r| json!(r.pit_um)),
    ("contact_n_max", |r| json!(r.contact_n_max)),
    ("film_n_max", |r| json!(r.film_n_max)),
    ("lost_counts", |r| json!(r.lost_counts)),
    ("illegal_transitions", |r| json!(r.illegal_transitions)),
    ("faults", |r| json!(r.faults.iter().map(|fault| fault.fault.as_str()).collect::<Vec<_>>().join("; "))),
    ("findings", |r| json!(r.findings.iter().map(|finding| finding.text.as_str()).collect::<Vec<_>>().join("; "))),
];

//! What is beyond its limit, in words that a machinist understands.
//!
//! Limits say where a run deserves a look, not where a machine breaks. Those of motion are the bounds of the default
//! scenario; the others are assumed, and lie well above what the scenarios that work do.

use super::Report;
use serde::Serialize;

/// Deviation of the mean gap voltage, as a share of the voltage wanted.
pub const VOLTAGE_OFF: f64 = 0.075;
/// Deviation of 100 ms means of it, rms, as a share of the voltage wanted.
pub const VOLTAGE_STRAYS: f64 = 0.1;
/// Peak-to-peak of the electrode within half a second, um; \[R\]'s own machine made 40 um.
pub const SWING_UM: f64 = 15.0;
/// Amplitude of the electrode at one pitch between 5 and 50 Hz, um.
pub const LINE_UM: f64 = 3.0;
/// Velocity of the electrode above 50 Hz, mm/s rms.
pub const VIBRATION_MM_S: f64 = 1.0;
/// Share of the time with the duty at its limit.
pub const DUTY_AT_LIMIT: f64 = 0.01;
/// Share of arcs.
pub const ARCS: f64 = 0.05;
/// Share of shorts.
pub const SHORTS: f64 = 0.05;
/// Depth that a hole may be short of, mm: a count.
pub const COUNT_MM: f64 = 0.001;

/// A figure beyond its limit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Its name in the JSON.
    pub figure: &'static str,
    /// What it is.
    pub value: f64,
    /// What it may be.
    pub limit: f64,
    /// The same in words.
    pub text: String,
}

/// Everything that is beyond its limit.
pub(super) fn findings(report: &Report) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut beyond = |figure, value: Option<f64>, limit: f64, words: &dyn Fn(f64) -> String| {
        if let Some(value) = value.filter(|value| *value > limit) {
            found.push(Finding { figure, value, limit, text: words(value) });
        }
    };
    // A head knows of its carrier, not of what its electrode has lost: a hole that is not as deep as asked for is no fault of
    // the head, and the person must know.
    if let (true, Some(hole), Some(worn)) = (report.completed, report.hole_depth_mm, report.wear_mm) {
        let (wanted, through) = (report.target_depth_mm, report.through_ratio > 0.0);
        let short = Some(wanted - hole).filter(|_| !through);
        beyond("hole_depth_mm", short, COUNT_MM, &|short| {
            format!("hole {hole:.3} mm deep, {short:.3} mm less than asked for; the electrode has lost {worn:.3} mm")
        });
    }
    let percent = |share: f64| format!("{:.0} %", share * 100.0);
    let volts = &report.gap_voltage_v;
    if let (Some(mean), Some(wanted)) = (volts.mean, volts.setpoint) {
        let limit = VOLTAGE_OFF * wanted;
        let (side, gap) = if mean > wanted { ("above", "wide") } else { ("below", "narrow") };
        beyond("gap_voltage_v.mean", Some((mean - wanted).abs()), limit, &|off| {
            format!(
                "gap voltage {mean:.1} V on average, {off:.1} V {side} the {wanted:.1} V wanted (limit {limit:.1} V): the gap is too {gap}"
            )
        });
        let limit = VOLTAGE_STRAYS * wanted;
        beyond("gap_voltage_v.rms_error_100ms", volts.rms_error_100ms, limit, &|rms| {
            format!("gap voltage strays by {rms:.1} V over tenths of a second (limit {limit:.1} V)")
        });
    }
    beyond("position_pp_um_median", report.position_pp_um_median, SWING_UM, &|um| {
        format!("electrode swings {um:.1} um within half a second (limit {SWING_UM} um)")
    });
    beyond("position_line_um", report.position_line_um.amplitude, LINE_UM, &|um| {
        let hz = report.position_line_um.hz.unwrap_or_default();
        format!("electrode hunts by {um:.1} um at {hz:.0} Hz (limit {LINE_UM} um)")
    });
    beyond("vibration_mm_s", report.vibration_mm_s, VIBRATION_MM_S, &|mm_s| {
        format!("electrode vibrates with {mm_s:.1} mm/s rms above 50 Hz (limit {VIBRATION_MM_S} mm/s)")
    });
    beyond("duty_at_limit_ratio", report.duty_at_limit_ratio, DUTY_AT_LIMIT, &|share| {
        format!("duty at its limit for {} of the time (limit {})", percent(share), percent(DUTY_AT_LIMIT))
    });
    beyond("arc_ratio", report.arc_ratio, ARCS, &|share| {
        format!("{} of the pulses arc (limit {})", percent(share), percent(ARCS))
    });
    beyond("short_ratio", report.short_ratio, SHORTS, &|share| {
        format!("{} of the pulses are shorts (limit {})", percent(share), percent(SHORTS))
    });
    beyond("lost_counts", Some(report.lost_counts as f64), 0.0, &|n| format!("{n} encoder counts lost (limit 0)"));
    beyond("illegal_transitions", Some(report.illegal_transitions as f64), 0.0, &|n| {
        format!("{n} illegal encoder transitions (limit 0)")
    });
    found
}

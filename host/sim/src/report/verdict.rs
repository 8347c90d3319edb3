//! The figures of a run that are beyond their limits.
//!
//! A figure beyond its limit deserves attention; it is not a fault. Limits of motion are the bounds of the default
//! scenario; the others are assumed, well above the figures of the scenarios that work.

use super::Report;
use serde::Serialize;

/// Deviation of the mean gap voltage, as a share of the set point.
pub const VOLTAGE_OFF: f64 = 0.075;
/// Deviation of its 100 ms means from the set point, rms, as a share of that.
pub const VOLTAGE_RMS: f64 = 0.1;
/// Position ripple, um peak to peak within half a second; \[R\]'s own machine had 40 um.
pub const RIPPLE_UM: f64 = 15.0;
/// Amplitude of the largest tone of the position between 5 and 50 Hz, um.
pub const TONE_UM: f64 = 3.0;
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
    /// Value.
    pub value: f64,
    /// Limit.
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
            format!("hole {hole:.3} mm deep, {short:.3} mm less than requested; the electrode is {worn:.3} mm worn")
        });
    }
    let percent = |share: f64| format!("{:.0} %", share * 100.0);
    let volts = &report.gap_voltage_v;
    if let (Some(mean), Some(wanted)) = (volts.mean, volts.setpoint) {
        let limit = VOLTAGE_OFF * wanted;
        let (side, gap) = if mean > wanted { ("above", "wide") } else { ("below", "narrow") };
        beyond("gap_voltage_v.mean", Some((mean - wanted).abs()), limit, &|off| {
            format!(
                "mean gap voltage {mean:.1} V, {off:.1} V {side} the set point of {wanted:.1} V (limit {limit:.1} V): the gap is too {gap}"
            )
        });
        let limit = VOLTAGE_RMS * wanted;
        beyond("gap_voltage_v.rms_error_100ms", volts.rms_error_100ms, limit, &|rms| {
            format!("100 ms mean of the gap voltage {rms:.1} V rms about the set point (limit {limit:.1} V)")
        });
    }
    beyond("position_pp_um_median", report.position_pp_um_median, RIPPLE_UM, &|um| {
        format!("position ripple {um:.1} um p-p (limit {RIPPLE_UM} um)")
    });
    beyond("position_line_um", report.position_line_um.amplitude, TONE_UM, &|um| {
        let hz = report.position_line_um.hz.unwrap_or_default();
        format!("largest tone {um:.1} um at {hz:.0} Hz (limit {TONE_UM} um)")
    });
    beyond("vibration_mm_s", report.vibration_mm_s, VIBRATION_MM_S, &|mm_s| {
        format!("vibration {mm_s:.1} mm/s rms above 50 Hz (limit {VIBRATION_MM_S} mm/s)")
    });
    beyond("duty_at_limit_ratio", report.duty_at_limit_ratio, DUTY_AT_LIMIT, &|share| {
        format!("duty at its limit for {} of the time (limit {})", percent(share), percent(DUTY_AT_LIMIT))
    });
    beyond("arc_ratio", report.arc_ratio, ARCS, &|share| {
        format!("arcs {} of the pulses (limit {})", percent(share), percent(ARCS))
    });
    beyond("short_ratio", report.short_ratio, SHORTS, &|share| {
        format!("shorts {} of the pulses (limit {})", percent(share), percent(SHORTS))
    });
    beyond("lost_counts", Some(report.lost_counts as f64), 0.0, &|n| format!("{n} lost counts (limit 0)"));
    beyond("illegal_transitions", Some(report.illegal_transitions as f64), 0.0, &|n| {
        format!("{n} illegal transitions (limit 0)")
    });
    found
}

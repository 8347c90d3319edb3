//! The feed laws compared: with the parameters that were published, fixed before the first comparison, and with those that
//! the same search found for each of them ([`crate::search::best`]).
//!
//! \[G\] gives its thresholds for its own machine, where a plain average of open circuit, over on-time and off-time, reads
//! 32 V of 80; elsewhere none are published, and a law keeps the set point of the scenario. \[R\] gives structures and no
//! numbers: its laws run with the defaults of docs/settings.md.

use crate::process::Plant;
use crate::run::Setup;
use crate::search::best::{self, is_of_gao};
use crate::sweep::grid::Assignments;

/// A law, and how it is set.
pub struct Law {
    /// Name in tables.
    pub name: &'static str,
    /// What its numbers rest on.
    pub source: &'static str,
    /// What it sets in a scenario; `None` where it is no law for it.
    pub settings: Assignments,
}

/// All of them; the first is what the others are compared with.
pub const LAWS: &[Law] = &[
    Law {
        name: "increment_by_error",
        source: "[R] 6.7.3; the scenario's gain",
        settings: |_| set(&["feed.law=increment_by_error"]),
    },
    Law {
        name: "rate_by_error",
        source: "[R] 6.7.2; defaults, assumed",
        settings: |_| set(&["feed.law=rate_by_error"]),
    },
    Law { name: "fixed_rate", source: "[R] 6.7.1; defaults, assumed", settings: |_| set(&["feed.law=fixed_rate"]) },
    Law {
        name: "1tav",
        source: "[G]: 25 V; elsewhere the scenario's set point",
        settings: |setup| thresholds(setup, &["gap.setpoint_v=25", "feed.band_v=0"], "feed.band_v=0"),
    },
    Law {
        name: "2tav",
        source: "[G]: 30 and 20 V; elsewhere 10 V below the scenario's set point",
        settings: |setup| thresholds(setup, &["gap.setpoint_v=30", "feed.band_v=10"], "feed.band_v=10"),
    },
    Law {
        name: "2tav-wide",
        source: "[G]: 30 and 10 V; elsewhere 20 V below the scenario's set point",
        settings: |setup| thresholds(setup, &["gap.setpoint_v=30", "feed.band_v=20"], "feed.band_v=20"),
    },
    Law {
        name: "fc",
        source: "[G]: FC, 1 um every 100 ms, 150 discharges; elsewhere 1.5 % of what the generator makes",
        settings: |setup| counted(setup, "pulse_counts"),
    },
    Law {
        name: "fpcc",
        source: "[G]: FPCC, as fc; off-time doubled; weights and thresholds are chosen (docs/settings.md)",
        settings: |setup| counted(setup, "pulse_control"),
    },
    Law {
        name: "minimum_variance",
        source: "[X]: 0.1 s, 50 um; where the charging curve of its material holds",
        settings: |setup| if is_of_xin(&setup.process) { set(&["feed.law=minimum_variance"]) } else { None },
    },
    Law {
        name: "spark_frequency",
        source: "[L]; 60 % of the pulses, chosen",
        settings: |setup| {
            let sparks = format!("gap.spark_per_s={}", 0.6 * pulses_per_s(setup));
            Some(vec!["feed.law=spark_frequency".into(), sparks])
        },
    },
    Law { name: "gap_ratio", source: "defaults, chosen", settings: |_| set(&["feed.law=gap_ratio"]) },
    Law {
        name: "observed_gap",
        source: "our own; the head's defaults, which are for the sinker",
        settings: |_| {
            set(&[
                "feed.law=observed_gap",
                "gap.hazard_per_s=12600",
                "feed.observed_um=34",
                "feed.observed_per_s=20",
                "feed.observed_caution=0",
                "feed.observed_noise_um=5",
                "feed.observed_drift_um_s=20",
                "feed.observed_lost_percent=50",
            ])
        },
    },
    Law {
        name: "increment_by_error-searched",
        source: SEARCHED,
        settings: |s| best::settings(s, "increment_by_error"),
    },
    Law { name: "1tav-searched", source: SEARCHED, settings: |s| best::settings(s, "1tav") },
    Law { name: "2tav-searched", source: SEARCHED, settings: |s| best::settings(s, "2tav") },
    Law { name: "fc-searched", source: SEARCHED, settings: |s| best::settings(s, "fc") },
    Law { name: "fpcc-searched", source: SEARCHED, settings: |s| best::settings(s, "fpcc") },
    Law { name: "spark_frequency-searched", source: SEARCHED, settings: |s| best::settings(s, "spark_frequency") },
    Law { name: "gap_ratio-searched", source: SEARCHED, settings: |s| best::settings(s, "gap_ratio") },
    Law { name: "hazard-searched", source: SEARCHED, settings: |s| best::settings(s, "hazard") },
    Law { name: "observed_gap-searched", source: SEARCHED, settings: |s| best::settings(s, "observed_gap") },
    Law {
        name: "increment_by_error-pauses",
        source: PAUSES,
        settings: |s| best::settings(s, "increment_by_error-pauses"),
    },
    Law { name: "observed_gap-pauses", source: PAUSES, settings: |s| best::settings(s, "observed_gap-pauses") },
    Law { name: "2tav-fast", source: FAST, settings: |s| best::settings(s, "2tav-fast") },
    Law { name: "fc-fast", source: FAST, settings: |s| best::settings(s, "fc-fast") },
    Law { name: "fpcc-fast", source: FAST, settings: |s| best::settings(s, "fpcc-fast") },
];

const SEARCHED: &str = "parameters that `cargo sim search` found, at the published period";
const PAUSES: &str = "the same, with the off-time by class searched too";
const FAST: &str = "the same, the period searched too";

/// What all laws have in common, and what may be different for all of them; the first one by default.
pub const VARIANTS: [(&str, &str, Assignments); 3] = [
    ("reflex", "reflex 1 ms", |_| Some(Vec::new())),
    // The latest that the head takes: no law of 100 ms sees a short that has ended before.
    ("late-reflex", "reflex 100 ms", |_| set(&["retreat.after_ms=100", "retreat.after_shorts=1000"])),
    ("pauses", "reflex 1 ms, off-time by class", |setup| {
        let us = if is_of_gao(&setup.process) { 50 } else { 100 };
        Some(["spark", "arc", "short"].map(|class| format!("generator.pause_{class}_us={us}")).into())
    }),
];

fn set(assignments: &[&str]) -> Option<Vec<String>> {
    Some(assignments.iter().map(|word| (*word).to_owned()).collect())
}

/// A step of 1 um every 100 ms, the published one; on \[G\]'s machine by the average that \[G\] has.
fn thresholds(setup: &Setup, published: &[&str], elsewhere: &str) -> Option<Vec<String>> {
    let step = ["feed.law=two_thresholds", "feed.threshold_um_s=10", "feed.threshold_period_ms=100"];
    // Open circuit reads 32 V.
    let plain = ["gap.average=plain", "gap.open_min_v=31", "generator.pause_spark_us=0", "generator.pause_arc_us=0"];
    let own = [elsewhere];
    let rest: Vec<&str> = if is_of_gao(&setup.process) { [&plain, published].concat() } else { own.to_vec() };
    set(&[&step[..], &rest].concat())
}

/// FC and FPCC with the published numbers; discharges in proportion to the pulses of a period.
fn counted(setup: &Setup, law: &str) -> Option<Vec<String>> {
    let discharges = (0.015 * pulses_per_s(setup) * 0.1).round().max(1.0);
    let off_us = 2.0 * setup.process.model().off_us;
    let own = [
        format!("feed.law={law}"),
        format!("feed.pulses_discharges={discharges}"),
        format!("feed.long_off_time_us={off_us}"),
    ];
    Some(own.into())
}

/// Pulses a second of a generator whose pulses all stay open.
fn pulses_per_s(setup: &Setup) -> f64 {
    let parameters = setup.process.model();
    1e6 / (parameters.on_us + parameters.off_us)
}

fn is_of_xin(plant: &Plant) -> bool {
    plant.machine_name().starts_with("xin")
}

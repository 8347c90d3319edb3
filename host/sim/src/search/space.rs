//! What may be varied of each law, and in which range.

use crate::run::Setup;

/// A parameter.
#[derive(Clone, Copy, Debug)]
pub struct Dimension {
    /// Name in tables: that of the setting, or what it is made of.
    pub name: &'static str,
    /// Least and largest value, both positive where it is logarithmic.
    pub range: (f64, f64),
    logarithmic: bool,
}

/// A law with its parameters.
pub struct Law {
    /// As in `edm-sim compare`, and with `-fast` behind it where the period is searched, too.
    pub name: &'static str,
    /// What is varied.
    pub dimensions: &'static [Dimension],
    /// What values of these set in a scenario; `None` where it is no law for it.
    pub settings: fn(&Setup, &[f64]) -> Option<Vec<String>>,
}

const fn log(name: &'static str, from: f64, to: f64) -> Dimension {
    Dimension { name, range: (from, to), logarithmic: true }
}

const fn linear(name: &'static str, from: f64, to: f64) -> Dimension {
    Dimension { name, range: (from, to), logarithmic: false }
}

/// Set point as a share of the open-circuit voltage: both machines, whatever their voltage. Where few pulses discharge, the mean is
/// close to that.
const SET_POINT: Dimension = linear("gap.setpoint_percent", 40.0, 98.5);

/// Set point of the hazard, as the share of pulses that then discharge, %.
const DISCHARGING: Dimension = log("discharging_percent", 0.5, 95.0);

/// All of them.
pub const LAWS: &[Law] = &[
    Law {
        name: "increment_by_error",
        dimensions: &[SET_POINT, log("feed.gain_um_s_v", 0.3, 100.0)],
        settings: |setup, v| keyed(setup, "increment_by_error", &["feed.gain_um_s_v"], v),
    },
    Law {
        name: "rate_by_error",
        dimensions: &[SET_POINT, log("feed.standard_um_s", 1.0, 500.0)],
        settings: |setup, v| keyed(setup, "rate_by_error", &["feed.standard_um_s"], v),
    },
    Law {
        name: "fixed_rate",
        dimensions: &[SET_POINT, log("feed.fixed_rate_um_s", 1.0, 300.0)],
        settings: |setup, v| keyed(setup, "fixed_rate", &["feed.fixed_rate_um_s"], v),
    },
    Law {
        name: "1tav",
        dimensions: &[SET_POINT, log("feed.threshold_um_s", 1.0, 100.0)],
        settings: |setup, v| thresholds(setup, v[0], v[1], 0.0, 100.0),
    },
    Law {
        name: "2tav",
        dimensions: &[SET_POINT, log("feed.threshold_um_s", 1.0, 100.0), linear("feed.band_percent", 2.0, 30.0)],
        settings: |setup, v| thresholds(setup, v[0], v[1], v[2], 100.0),
    },
    Law {
        name: "2tav-fast",
        dimensions: &[
            SET_POINT,
            log("feed.threshold_um_s", 1.0, 100.0),
            linear("feed.band_percent", 0.0, 30.0),
            log("feed.threshold_period_ms", 1.0, 100.0),
        ],
        settings: |setup, v| thresholds(setup, v[0], v[1], v[2], v[3]),
    },
    Law { name: "fc", dimensions: COUNTED, settings: |setup, v| counted(setup, "pulse_counts", v, 100.0) },
    Law {
        name: "fc-fast",
        dimensions: &[COUNTED[0], COUNTED[1], COUNTED[2], COUNTED[3], log("feed.pulses_period_ms", 2.0, 100.0)],
        settings: |setup, v| counted(setup, "pulse_counts", v, v[4]),
    },
    Law {
        name: "fpcc",
        dimensions: &[
            COUNTED[0],
            COUNTED[1],
            COUNTED[2],
            COUNTED[3],
            linear("feed.direction_limit", 0.0, 1.0),
            linear("feed.shorts_limit_percent", 0.0, 50.0),
        ],
        settings: |setup, v| collaborating(setup, v, 100.0),
    },
    Law {
        name: "fpcc-fast",
        dimensions: &[
            COUNTED[0],
            COUNTED[1],
            COUNTED[2],
            COUNTED[3],
            linear("feed.direction_limit", 0.0, 1.0),
            linear("feed.shorts_limit_percent", 0.0, 50.0),
            log("feed.pulses_period_ms", 2.0, 100.0),
        ],
        settings: |setup, v| collaborating(setup, v, v[6]),
    },
    Law {
        name: "spark_frequency",
        dimensions: &[log("gap.spark_percent", 0.5, 95.0), log("feed.frequency_um_s", 2.0, 1000.0)],
        settings: |setup, v| {
            let sparks = v[0] * 1e-2 * pulses_per_s(setup);
            set("spark_frequency", &[("gap.spark_per_s", sparks), ("feed.frequency_um_s", v[1])])
        },
    },
    Law {
        name: "gap_ratio",
        dimensions: &[
            log("not_open_percent", 0.5, 95.0),
            log("feed.ratio_weight", 0.3, 30.0),
            log("feed.ratio_um_s", 2.0, 1000.0),
            log("feed.ratio_integral_ms", 50.0, 10_000.0),
            log("feed.ratio_period_ms", 1.0, 100.0),
        ],
        settings: |_, v| {
            let keys = [
                "feed.ratio_open_percent",
                "feed.ratio_weight",
                "feed.ratio_um_s",
                "feed.ratio_integral_ms",
                "feed.ratio_period_ms",
            ];
            let mut values = zipped(&keys, v);
            values[0].1 = 100.0 - v[0];
            set("gap_ratio", &values)
        },
    },
    Law { name: "observed_gap", dimensions: OBSERVED, settings: observed },
    Law {
        name: "observed_gap-pauses",
        dimensions: &[
            OBSERVED[0],
            OBSERVED[1],
            OBSERVED[2],
            OBSERVED[3],
            OBSERVED[4],
            OBSERVED[5],
            OBSERVED[6],
            PAUSES[0],
            PAUSES[1],
        ],
        settings: |setup, v| paused(observed(setup, v.get(..7)?)?, v.get(7..)?),
    },
    Law {
        name: "increment_by_error-pauses",
        dimensions: &[SET_POINT, log("feed.gain_um_s_v", 0.3, 100.0), PAUSES[0], PAUSES[1]],
        settings: |setup, v| {
            paused(keyed(setup, "increment_by_error", &["feed.gain_um_s_v"], v.get(..2)?)?, v.get(2..)?)
        },
    },
    Law {
        name: "hazard",
        dimensions: &[DISCHARGING, log("feed.gain_um_s_v", 0.1, 100.0), log("gap.memory_ms", 1.0, 100.0)],
        settings: |setup, v| {
            let (percent, v) = v.split_first()?;
            let mut values = zipped(&["feed.gain_um_s_v", "gap.memory_ms"], v);
            values.push(("gap.hazard_per_s", hazard(setup, *percent)));
            let mut all = set("increment_by_error", &values)?;
            all.push("gap.controlled=hazard".into());
            Some(all)
        },
    },
];

const OBSERVED: &[Dimension] = &[
    DISCHARGING,
    log("feed.observed_um", 2.0, 100.0),
    log("feed.observed_per_s", 0.5, 100.0),
    linear("feed.observed_caution", 0.0, 1.5),
    log("feed.observed_noise_um", 0.3, 30.0),
    log("feed.observed_drift_um_s", 0.3, 100.0),
    linear("feed.observed_lost_percent", 10.0, 80.0),
];

fn observed(setup: &Setup, v: &[f64]) -> Option<Vec<String>> {
    let keys = [
        "feed.observed_um",
        "feed.observed_per_s",
        "feed.observed_caution",
        "feed.observed_noise_um",
        "feed.observed_drift_um_s",
        "feed.observed_lost_percent",
    ];
    let (percent, v) = v.split_first()?;
    let mut values = zipped(&keys, v);
    values.push(("gap.hazard_per_s", hazard(setup, *percent)));
    set("observed_gap", &values)
}

/// Off-time by class: after a spark, and after an arc or a short.
const PAUSES: &[Dimension] =
    &[log("generator.pause_spark_us", 5.0, 300.0), log("generator.pause_arc_us, generator.pause_short_us", 5.0, 300.0)];

fn paused(mut settings: Vec<String>, v: &[f64]) -> Option<Vec<String>> {
    let &[spark, bad] = v else { return None };
    settings.extend(
        [("spark", spark), ("arc", bad), ("short", bad)].map(|(class, us)| format!("generator.pause_{class}_us={us}")),
    );
    Some(settings)
}

const COUNTED: &[Dimension] = &[
    log("feed.pulses_step_um_100ms", 0.1, 10.0),
    linear("feed.pulses_short_percent", 2.0, 95.0),
    log("discharges_percent", 0.2, 90.0),
    log("not_open_percent", 0.5, 95.0),
];

impl Law {
    /// Values of a point in the cube, to three digits.
    pub fn values(&self, point: &[f64]) -> Vec<f64> {
        let value = |(dimension, x): (&Dimension, &f64)| {
            let ((from, to), x) = (dimension.range, x.clamp(0.0, 1.0));
            let value = if dimension.logarithmic { from * (to / from).powf(x) } else { from + (to - from) * x };
            rounded(value)
        };
        self.dimensions.iter().zip(point).map(value).collect()
    }
}

/// To three digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

/// Pulses a second of a generator whose pulses all stay open.
fn pulses_per_s(setup: &Setup) -> f64 {
    let model = setup.process.model();
    1e6 / (model.on_us + model.off_us)
}

/// Hazard, 1/s, at which so many percent of the pulses ignite within their on-time.
fn hazard(setup: &Setup, percent: f64) -> f64 {
    -(1.0 - percent * 1e-2).ln() * 1e6 / setup.process.model().on_us
}

fn zipped<'a>(keys: &[&'a str], values: &[f64]) -> Vec<(&'a str, f64)> {
    keys.iter().copied().zip(values.iter().copied()).collect()
}

fn set(law: &str, values: &[(&str, f64)]) -> Option<Vec<String>> {
    let values = values.iter().map(|(key, value)| format!("{key}={}", rounded(*value)));
    Some([format!("feed.law={law}")].into_iter().chain(values).collect())
}

/// A set point, then keys.
fn keyed(setup: &Setup, law: &str, keys: &[&str], values: &[f64]) -> Option<Vec<String>> {
    let (percent, values) = values.split_first()?;
    let mut all = zipped(keys, values);
    all.extend(set_point(setup, *percent));
    set(law, &all)
}

/// A set point of the voltage, in percent of the open circuit, and the least open circuit, which has to be above it.
fn set_point(setup: &Setup, percent: f64) -> [(&'static str, f64); 2] {
    let open = setup.process.model().open_v;
    let volts = percent * 1e-2 * open;
    let least = f64::from(setup.head.gap_open_min);
    [("gap.setpoint_v", volts), ("gap.open_min_v", least.max(volts + 5e-3 * open))]
}

fn thresholds(setup: &Setup, percent: f64, rate: f64, band_percent: f64, period_ms: f64) -> Option<Vec<String>> {
    let open = setup.process.model().open_v;
    let mut values = vec![
        ("feed.threshold_um_s", rate),
        ("feed.band_v", band_percent * 1e-2 * open),
        ("feed.threshold_period_ms", period_ms),
    ];
    values.extend(set_point(setup, percent));
    set("two_thresholds", &values)
}

/// A step by its velocity: 1 um every 100 ms is 1, whatever the period. Discharges as a share of all pulses of a period.
fn counted(setup: &Setup, law: &str, v: &[f64], period_ms: f64) -> Option<Vec<String>> {
    let discharges = (v[2] * 1e-2 * pulses_per_s(setup) * period_ms * 1e-3).round().max(1.0);
    let values = [
        ("feed.pulses_step_um", (v[0] * period_ms / 100.0).max(0.01)),
        ("feed.pulses_short_percent", v[1]),
        ("feed.pulses_open_percent", 100.0 - v[3]),
        ("feed.pulses_period_ms", period_ms),
    ];
    let mut all = set(law, &values)?;
    all.push(format!("feed.pulses_discharges={discharges}"));
    Some(all)
}

fn collaborating(setup: &Setup, v: &[f64], period_ms: f64) -> Option<Vec<String>> {
    let mut all = counted(setup, "pulse_control", v, period_ms)?;
    let off_us = 2.0 * setup.process.model().off_us;
    all.extend([
        format!("feed.direction_limit={}", v[4]),
        format!("feed.shorts_limit_percent={}", v[5]),
        format!("feed.long_off_time_us={}", rounded(off_us)),
        format!("feed.long_off_ms={}", rounded((2.0 * period_ms).max(1.0))),
    ]);
    Some(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bore;

    #[test]
    fn every_corner_of_every_space_is_a_set_of_settings_that_a_head_accepts() {
        for scenario in ["micro-blind", "sinker"] {
            let setup = Setup::load(scenario).unwrap();
            for law in LAWS {
                let n = law.dimensions.len();
                let corners = (0..1 << n).map(|bits| (0..n).map(|d| f64::from(bits >> d & 1)).collect::<Vec<_>>());
                for point in corners.chain([vec![0.5; n]]) {
                    let mut setup = setup.clone();
                    let values = law.values(&point);
                    for assignment in (law.settings)(&setup.clone(), &values).unwrap() {
                        setup.set(&assignment).unwrap_or_else(|error| panic!("{}: {error}", law.name));
                    }
                    // A set point above the least open circuit is refused, and counts as a hole that is not finished.
                    if let Err(error) = bore::check(&setup) {
                        assert!(error.to_string().contains("gap.setpoint_v"), "{} {values:?}: {error}", law.name);
                    }
                }
            }
        }
    }

    #[test]
    fn values_are_those_of_the_range_to_three_digits() {
        let law = LAWS.iter().find(|law| law.name == "increment_by_error").unwrap();
        assert_eq!(law.values(&[0.0, 1.0]), [40.0, 100.0]);
        assert_eq!(law.values(&[0.5, 0.5]), [69.2, 5.48]);
        assert_eq!(law.values(&[-1.0, 2.0]), [40.0, 100.0]);
    }
}

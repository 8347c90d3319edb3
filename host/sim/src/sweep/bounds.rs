//! The bounds of the head.

use super::figures::FIGURES;
use crate::report::Report;
use crate::run::Setup;

/// One count of the encoder, mm: how exactly the depth has to be reached.
const COUNT_MM: f64 = 0.001;

/// A figure that a scenario has to keep: its name, the least and the most.
type Kept = (&'static str, f64, f64);

/// Its set point and gain make it calm: ten seeds find 148 to 150 s, 4.5 to 4.9 V, 10.8 to 11.0 V of which a gap held still has 4.7 to
/// 5.0, 12.9 to 13.6 um, 1.9 to 2.1 um, 4.2 to 4.7 % of arcs.
const DEFAULT: &[Kept] = &[
    ("sim_time_s", 115.0, 190.0),
    ("gap_voltage_v.rms_error_100ms", 0.0, 5.8),
    ("gap_voltage_v.filtered_rms", 0.0, 13.2),
    ("position_pp_um_median", 5.0, 15.0),
    ("position_line_um.amplitude", 0.0, 3.0),
    ("arc_ratio", 0.01, 0.06),
];
/// Of the sinker of \[R\], as ten seeds find it: 139 to 142 s, 3.6 to 3.8 V, 10.0 to 10.2 V of which a gap held still has 4.2 to
/// 4.5, 16.2 to 17.1 um, 2.7 to 2.9 um, 8 % of arcs. Its slow disturbance, which was fitted to the swing of a real machine, moves
/// the gap that ignites as well by a quarter rms: 34 um by 8.6, so a head that follows has a swing, and 24 um, the sine of that,
/// would be all of it.
const SINKER: &[Kept] = &[
    ("sim_time_s", 110.0, 180.0),
    ("gap_voltage_v.rms_error_100ms", 0.0, 4.8),
    ("gap_voltage_v.filtered_rms", 0.0, 12.8),
    ("position_pp_um_median", 5.0, 24.0),
    ("position_line_um.amplitude", 0.0, 3.0),
    ("arc_ratio", 0.01, 0.15),
];
/// Bounds of single scenarios. Times have two sides: on the same holes a head that is
/// suddenly much faster is as likely to have found a hole in the model as one that is slower is to be worse. The ranges are a
/// quarter and more about what five seeds do.
const KEPT: &[(&str, &[Kept])] = &[
    ("default", DEFAULT),
    ("sinker", SINKER),
    ("sinker-100khz", &[("sim_time_s", 19.0, 35.0), ("arc_ratio", 0.01, 0.3)]),
    ("sinker-1khz", &[("sim_time_s", 62.0, 105.0), ("arc_ratio", 0.0, 0.15)]),
    ("sinker-0.1kg", &[("sim_time_s", 46.0, 77.0), ("position_pp_um_median", 5.0, 25.0)]),
    ("sinker-0.4kg", &[("sim_time_s", 46.0, 79.0), ("position_pp_um_median", 5.0, 25.0)]),
    ("sinker-0.1mm", &[("sim_time_s", 13.0, 28.0), ("short_ratio", 0.0, 0.12)]),
    ("sinker-25mm", &[("sim_time_s", 130.0, 240.0), ("position_pp_um_median", 5.0, 35.0)]),
    ("sinker-dirty", &[("sim_time_s", 94.0, 157.0), ("arc_ratio", 0.05, 0.3)]),
    ("sinker-deep", &[("sim_time_s", 42.0, 77.0), ("arc_ratio", 0.05, 0.4)]),
    ("sinker-deep-jumps", &[("sim_time_s", 12.0, 29.0), ("arc_ratio", 0.004, 0.05)]),
    ("cavity", &[("sim_time_s", 125.0, 225.0), ("position_pp_um_median", 5.0, 35.0)]),
    // [R] section 4.2 has about 40 um at 17 to 20 Hz.
    (
        "thesis-machine",
        &[
            ("sim_time_s", 55.0, 110.0),
            ("position_pp_um_median", 20.0, 120.0),
            ("position_line_um.amplitude", 8.0, 25.0),
            ("position_line_um.hz", 15.0, 25.0),
        ],
    ),
    ("silicon", &[("sim_time_s", 57.0, 96.0), ("gap_voltage_v.rms_error_100ms", 0.0, 4.0)]),
    ("micro-blind", &[("sim_time_s", 26.0, 46.0), ("short_ratio", 0.005, 0.1), ("wear_mm", 0.008, 0.02)]),
    ("micro-blind-clear", &[("sim_time_s", 13.0, 27.0), ("short_ratio", 0.002, 0.1), ("wear_mm", 0.008, 0.02)]),
    ("micro-through", &[("sim_time_s", 32.0, 56.0), ("short_ratio", 0.005, 0.1), ("through_ratio", 1.0, 1.0)]),
    ("micro-through-clear", &[("sim_time_s", 17.0, 32.0), ("short_ratio", 0.002, 0.1), ("through_ratio", 1.0, 1.0)]),
];

/// What a run breaks, in a few words each.
pub fn broken(report: &Report) -> Vec<String> {
    let mut broken = Vec::new();
    let mut demand = |kept: bool, what: String| {
        if !kept {
            broken.push(what);
        }
    };
    // A head knows of its carrier, not of what the electrode loses; in version 0 that is less than a count.
    let worn = if report.model_version == 0 { Some(0.0) } else { report.wear_mm };
    let error_mm = report.depth_mm.zip(worn).map(|(depth, worn)| (depth + worn - report.target_depth_mm).abs());
    demand(report.completed, format!("stopped: {}", report.stop_reason));
    demand(report.faults.is_empty(), format!("{} faults", report.faults.len()));
    demand(error_mm.is_some_and(|error| error <= COUNT_MM), format!("{:?} mm deep", report.depth_mm));
    demand(report.lost_counts == 0, format!("{} counts lost", report.lost_counts));
    demand(report.illegal_transitions == 0, format!("{} illegal transitions", report.illegal_transitions));
    // Of the scenario as it is: with other values, another depth or another model it need not keep them.
    let own = Setup::load(&report.scenario).is_ok_and(|setup| setup.depth_mm == report.target_depth_mm);
    let kept = KEPT.iter().find(|(scenario, _)| own && *scenario == report.scenario).map_or(&[][..], |(_, kept)| kept);
    for (name, least, most) in kept {
        let figure = FIGURES.iter().find(|(figure, _)| figure == name).and_then(|(_, figure)| figure(report).as_f64());
        demand(
            figure.is_some_and(|figure| (*least..=*most).contains(&figure)),
            format!("{name} {figure:?}, must be {least} to {most}"),
        );
    }
    broken
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::BUILT_IN;

    #[test]
    fn every_scenario_of_version_1_keeps_figures_that_there_are() {
        for (name, text) in BUILT_IN {
            let setup = Setup::parse(name, text).unwrap();
            assert_eq!(KEPT.iter().any(|(kept, _)| kept == name), setup.process.version() == 1, "{name}");
        }
        for (scenario, figure, least, most) in
            KEPT.iter().flat_map(|(s, kept)| kept.iter().map(move |k| (s, k.0, k.1, k.2)))
        {
            assert!(FIGURES.iter().any(|(name, _)| *name == figure) && least <= most, "{scenario}: {figure}");
        }
    }
}

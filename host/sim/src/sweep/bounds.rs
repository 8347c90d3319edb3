//! The bounds that the head has to keep, and the table of what it did.

use super::row::Row;
use crate::report::Report;
use std::fmt::Write;

/// One count of the encoder, mm: how exactly the depth has to be reached.
const COUNT_MM: f64 = 0.001;

/// What a run breaks, in a few words each.
pub fn broken(report: &Report) -> Vec<String> {
    let mut broken = Vec::new();
    let mut demand = |kept: bool, what: String| {
        if !kept {
            broken.push(what);
        }
    };
    let error_mm = report.depth_mm.map(|depth| (depth - report.target_depth_mm).abs());
    demand(report.completed, format!("stopped: {}", report.stop_reason));
    demand(report.faults.is_empty(), format!("{} faults", report.faults.len()));
    demand(error_mm.is_some_and(|error| error <= COUNT_MM), format!("{:?} mm deep", report.depth_mm));
    demand(report.lost_counts == 0, format!("{} counts lost", report.lost_counts));
    demand(report.illegal_transitions == 0, format!("{} illegal transitions", report.illegal_transitions));
    if report.scenario == "default" {
        let volts = &report.gap_voltage_v;
        demand(
            volts.rms_error_100ms.is_some_and(|rms| rms <= 3.0),
            format!("{:?} V rms of 100 ms means", volts.rms_error_100ms),
        );
        let ratio = volts.filtered_rms.zip(volts.shot_floor_rms).map(|(rms, floor)| rms / floor);
        demand(ratio.is_some_and(|ratio| ratio <= 1.3), format!("{ratio:?} times the shot floor"));
        let swing = report.position_pp_um_median;
        demand(swing.is_some_and(|um| um <= 15.0), format!("{swing:?} um swing"));
        let line = report.position_line_um.amplitude;
        demand(line.is_some_and(|um| um <= 3.0), format!("{line:?} um at one pitch"));
    }
    broken
}

/// A table with the worst of each combination, and how many runs broke a bound or failed.
pub fn judge(rows: &[Row]) -> (String, usize) {
    let mut text = String::from(
        "| scenario | runs | depth error um | 100 ms means V rms | filtered / floor | swing um | line um | long retreats | bounds |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let mut failures = String::new();
    let mut count = 0;
    let several = rows.iter().any(|row| row.number("target_depth_mm") != rows[0].number("target_depth_mm"));
    let name = |row: &Row| {
        let scenario = row.text("scenario").unwrap_or_default();
        let depth = row.text("target_depth_mm").unwrap_or_default();
        if several { format!("{scenario}, {depth} mm") } else { scenario }
    };
    let mut names: Vec<String> = rows.iter().map(name).collect();
    // Runs of one combination lie together.
    names.dedup();
    for of in names {
        let runs: Vec<&Row> = rows.iter().filter(|row| name(row) == of).collect();
        let worst =
            |figure: &dyn Fn(&Row) -> Option<f64>| runs.iter().filter_map(|row| figure(row)).fold(0.0f64, f64::max);
        let mut kept = 0;
        for row in &runs {
            let failed = row.text("error").map(|error| format!("failed: {error}"));
            match failed.or_else(|| row.text("broken")) {
                None => kept += 1,
                Some(words) => {
                    count += 1;
                    let _ = writeln!(failures, "{of}, seed {}: {words}", row.text("seed").unwrap_or_default());
                }
            }
        }
        let _ = writeln!(
            text,
            "| {of} | {} | {:.2} | {:.2} | {:.2} | {:.1} | {:.1} | {:.0} | {kept} of {} |",
            runs.len(),
            worst(&|r| Some((r.number("depth_mm")? - r.number("target_depth_mm")?).abs() * 1e3)),
            worst(&|r| r.number("gap_voltage_v.rms_error_100ms")),
            worst(&|r| Some(r.number("gap_voltage_v.filtered_rms")? / r.number("gap_voltage_v.shot_floor_rms")?)),
            worst(&|r| r.number("position_pp_um_median")),
            worst(&|r| r.number("position_line_um.amplitude")),
            worst(&|r| r.number("long_retreats")),
            runs.len(),
        );
    }
    text.push_str("\nWorst of the runs in each column; simulated.\n");
    text.push_str(&failures);
    (text, count)
}

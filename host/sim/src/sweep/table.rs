//! The table of a sweep: the worst of the runs, and which bounds they broke.

use super::row::Row;
use std::fmt::Write;

/// A table with the worst of each combination, and how many runs broke a bound or failed.
pub fn evaluate(rows: &[Row]) -> (String, usize) {
    let mut text = String::from(
        "| scenario | runs | depth error um | 100 ms means V rms | filtered / floor | ripple um | tone um | long retreats | bounds |\n\
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
        // A law that does not go by the voltage has no error of it.
        let worst = |places: usize, figure: &dyn Fn(&Row) -> Option<f64>| {
            let most = runs.iter().filter_map(|row| figure(row)).reduce(f64::max);
            most.map_or_else(|| "-".into(), |most| format!("{most:.places$}"))
        };
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
            "| {of} | {} | {} | {} | {} | {} | {} | {} | {kept} of {} |",
            runs.len(),
            worst(2, &|r| {
                Some((r.number("depth_mm")? + r.number("wear_mm")? - r.number("target_depth_mm")?).abs() * 1e3)
            }),
            worst(2, &|r| r.number("gap_voltage_v.rms_error_100ms")),
            worst(2, &|r| Some(r.number("gap_voltage_v.filtered_rms")? / r.number("gap_voltage_v.shot_floor_rms")?)),
            worst(1, &|r| r.number("position_pp_um_median")),
            worst(1, &|r| r.number("position_line_um.amplitude")),
            worst(0, &|r| r.number("long_retreats")),
            runs.len(),
        );
    }
    text.push_str("\nWorst run in each column; simulated.\n");
    text.push_str(&failures);
    (text, count)
}

//! Accuracy of the gap estimators, measured on signals of which everything is known.
//!
//! All of it is simulated, from seeds: the same figures every time. What runs is the code of the core.

pub mod arcs;
pub mod average;
pub mod charging;
pub mod classifier;
pub mod filter;
pub mod likelihood;
pub mod notch;

use average::Kind;
use classifier::{Case, LABELS};
use edm_servo_head::gap::pulses::Class;
use edm_servo_head::gap::voltage::Average;
use serde::Serialize;
use std::fmt::Write;

/// How much is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Labelled pulses of a case.
    pub pulses: u64,
    /// Estimates of the hazard of each kind.
    pub estimates: u32,
    /// Pulses that are averaged.
    pub averaged: u32,
    /// Scenarios with arcs and without, and seeds of each.
    pub scenarios: &'static [&'static str],
    /// See there.
    pub seeds: u64,
}

impl Size {
    /// What the bounds are about.
    pub const FULL: Size = Size {
        pulses: 1_000_000,
        estimates: 20_000,
        averaged: 100_000,
        scenarios: &["sinker", "sinker-1khz", "sinker-dirty", "silicon"],
        seeds: 20,
    };
    /// What fits a quarter of a minute.
    pub const SHORT: Size =
        Size { pulses: 100_000, estimates: 4000, averaged: 20_000, scenarios: &["sinker", "sinker-dirty"], seeds: 2 };
}

/// Share of the pulses that are made arcs, %.
const ARCS_PERCENT: f64 = 90.0;
/// Recall of open, spark and short; of arc and spark at 20 dB and at 10 dB.
const RECALLS: [f64; 3] = [0.995, 0.97, 0.96];
/// Shorts of a million that may be taken for sparks.
const SHORTS_AS_SPARKS: u64 = 10;
/// What may be wrong beyond what Bayes' rule gets wrong.
const BEYOND_BAYES: f64 = 0.01;
/// Conversions since ignition for which the table has a row.
const CONVERSIONS: [usize; 10] = [1, 2, 3, 4, 6, 8, 10, 12, 14, 16];

/// Smallest recalls, and how many shorts were taken for sparks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Classifier {
    /// Of open, spark and short with 4 conversions at 20 dB.
    pub open_spark_short_20db: f64,
    /// Of arc and spark with 16 conversions after ignition at 20 dB.
    pub arc_16_20db: f64,
    /// The same at 10 dB.
    pub arc_16_10db: f64,
    /// Of the shorts of a case at 20 dB, 4 conversions each.
    pub short_as_spark_20db: u64,
}

/// Hazard of ignition.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Likelihood {
    /// Smallest share of the Cramer-Rao bound.
    pub efficiency_min: f64,
    /// Mean square of the error over the stated variance: that furthest from 1.
    pub chi2: f64,
}

/// What was measured; all of it simulated.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Largest difference of the filter chain from scipy, converter codes rms.
    pub filter_error_counts_rms_max: f64,
    /// Smallest attenuation of drifting hum in a second, dB.
    pub notch_drift_db_min: f64,
    /// Classes of pulses.
    pub classifier: Classifier,
    /// Hazard of ignition.
    pub likelihood: Likelihood,
    /// By what share the averages move when the off-time goes from 10 us to 1 ms.
    pub gated_average_shift: f64,
    /// The same, of the plain one.
    pub plain_average_shift: f64,
    /// Gap by charging time: single captures, um.
    pub tau_error_um_single_rms: f64,
    /// Means of sixteen.
    pub tau_error_um_mean16_rms: f64,
    /// See there.
    pub tau_error_um_single_max: f64,
    /// See there.
    pub tau_error_um_mean16_max: f64,
    /// Longest time until the head reports persistent arcs, ms.
    pub arc_named_ms_max: u64,
    /// Runs in which it reports persistent arcs without any.
    pub arc_false: u64,
    /// The tables of docs/gap-sensing.md.
    #[serde(skip)]
    pub tables: String,
    /// Rows whose bound is not met.
    #[serde(skip)]
    pub failed: Vec<String>,
}

/// Gathers a table, and which bounds are not met.
#[derive(Default)]
struct Sheet {
    tables: String,
    failed: Vec<String>,
}

impl Sheet {
    fn head(&mut self, title: &str, columns: &[&str]) {
        let _ = write!(self.tables, "{}### {title}\n\n", if self.tables.is_empty() { "" } else { "\n" });
        self.row(columns);
        let _ = writeln!(self.tables, "|{}", " --- |".repeat(columns.len()));
    }

    fn row<T: AsRef<str>>(&mut self, cells: &[T]) {
        let cells: Vec<&str> = cells.iter().map(AsRef::as_ref).collect();
        let _ = writeln!(self.tables, "| {} |", cells.join(" | "));
    }

    fn bound(&mut self, figure: &str, bound: &str, measured: String, holds: bool) {
        self.row(&[figure, bound, &measured]);
        if !holds {
            self.failed.push(format!("{figure}: {measured}, bound {bound}"));
        }
    }

    fn bounds(&mut self, title: &str) {
        self.head(title, &["figure", "bound", "measured"]);
    }
}

fn percent(share: f64) -> String {
    format!("{:.2} %", 100.0 * share)
}

/// Measures.
///
/// # Errors
/// When a head does not begin to erode.
pub fn measure(size: &Size) -> Result<Report, String> {
    let mut sheet = Sheet::default();
    let filter_error_counts_rms_max = filters(&mut sheet);
    let notch_drift_db_min = notches(&mut sheet);
    let classifier = classes(&mut sheet, size);
    let likelihood = hazards(&mut sheet, size);
    let [gated_average_shift, plain_average_shift] = averages(&mut sheet, size);
    let errors = charging::measure()?;
    captures(&mut sheet, &errors);
    let arcs = arcs::measure(size.scenarios, ARCS_PERCENT, size.seeds)?;
    persistent(&mut sheet, size, &arcs);
    Ok(Report {
        filter_error_counts_rms_max,
        notch_drift_db_min,
        classifier,
        likelihood,
        gated_average_shift,
        plain_average_shift,
        tau_error_um_single_rms: errors.single.0,
        tau_error_um_mean16_rms: errors.mean16.0,
        tau_error_um_single_max: errors.single.1,
        tau_error_um_mean16_max: errors.mean16.1,
        arc_named_ms_max: arcs.named_ms_max,
        arc_false: arcs.falsely,
        tables: sheet.tables,
        failed: sheet.failed,
    })
}

fn filters(sheet: &mut Sheet) -> f64 {
    sheet.bounds("Filter and mains notch");
    let (error, cases) = filter::worst();
    let bound = filter::BOUND;
    let figure = format!("low-pass and notch compared with scipy in f64, worst of {cases} cases");
    sheet.bound(&figure, &format!("{bound} codes rms"), format!("{error:.4} codes rms"), error <= bound);
    error
}

fn notches(sheet: &mut Sheet) -> f64 {
    let mut least = f64::INFINITY;
    for case in &notch::CASES {
        let notch::Attenuation { tracked, fixed } = notch::attenuation(case);
        least = least.min(tracked);
        let figure = format!("drift of +-0.5 Hz at 0.1 Hz/s: {}, worst second", case.name);
        let measured = format!("{tracked:.1} dB; a fixed notch {fixed:.1} dB");
        sheet.bound(&figure, &format!("{} dB", notch::BOUND_DB), measured, tracked >= notch::BOUND_DB);
    }
    let wandered = notch::wandering_hz(10);
    let figure = "no hum, noise of 6 V: drift of the notch in a minute, largest of 10 seeds";
    let holds = wandered <= notch::WANDERING_HZ;
    sheet.bound(figure, &format!("{} Hz", notch::WANDERING_HZ), format!("{wandered:.2} Hz"), holds);
    for hertz in [0.0, 5.0, 10.0, 20.0, 30.0] {
        let [chain, notch] = notch::group_delay_ms(hertz);
        let figure = format!("group delay at {hertz} Hz, low-pass 200 Hz and notch 50 Hz, Q 2.5 (calculated)");
        sheet.bound(&figure, "none", format!("{chain:.2} ms; notch alone {notch:.2} ms"), true);
    }
    least
}

fn classes(sheet: &mut Sheet, size: &Size) -> Classifier {
    let pulses = size.pulses;
    let columns = ["label", "open", "spark", "arc", "short", "no pulse", "uncertain"];
    let named = ["open", "spark", "arc", "short"];
    let mut confusions = vec![];
    for (snr_db, burns) in [(20.0, 4), (20.0, 16), (10.0, 16)] {
        let confusion = Case::new(snr_db, burns).run(pulses, 1);
        let title = format!("Confusion: {snr_db} dB, {burns} conversions after ignition, {pulses} pulses");
        sheet.head(&title, &columns);
        for (label, row) in named.iter().zip(&confusion) {
            let cells: Vec<String> = [(*label).into()].into_iter().chain(row.map(|count| count.to_string())).collect();
            sheet.row(&cells);
        }
        confusions.push(confusion);
    }
    let shorts = Case { labels: &[Class::Short], ..Case::new(20.0, 4) }.run(pulses, 2);
    let short_as_spark_20db = shorts[3][Class::Spark as usize];
    let (fast, fast_named) = classifier::at_100_khz(pulses);
    let burning = [Class::Spark, Class::Arc];
    let classifier = Classifier {
        open_spark_short_20db: classifier::least(&confusions[0], &[Class::Open, Class::Spark, Class::Short]),
        arc_16_20db: classifier::least(&confusions[1], &burning),
        arc_16_10db: classifier::least(&confusions[2], &burning),
        short_as_spark_20db,
    };
    sheet.bounds("Classifier");
    let recalls = [
        ("open, spark and short, 20 dB, 4 conversions: smallest recall", classifier.open_spark_short_20db),
        ("arc and spark, 20 dB, 16 conversions after ignition: smallest recall", classifier.arc_16_20db),
        ("arc and spark, 10 dB, 16 conversions after ignition: smallest recall", classifier.arc_16_10db),
    ];
    for ((figure, recall), bound) in recalls.into_iter().zip(RECALLS) {
        sheet.bound(figure, &format!("at least {} %", 100.0 * bound), percent(recall), recall >= bound);
    }
    let measured = format!("{short_as_spark_20db} of {pulses}");
    let holds = short_as_spark_20db <= SHORTS_AS_SPARKS * pulses / 1_000_000;
    sheet.bound("shorts classified as sparks, 20 dB", "10 of a million", measured, holds);
    let figure = "arcs and sparks at 100 kHz, half on (2 or 3 conversions), classified as arc or spark";
    sheet.bound(figure, "0", format!("{fast_named} of {fast}"), fast_named == 0);
    for snr_db in [20.0, 10.0] {
        fewer(sheet, snr_db, pulses);
    }
    classifier
}

/// Conversion by conversion, compared with the best possible rule.
fn fewer(sheet: &mut Sheet, snr_db: f64, pulses: u64) {
    let bound = format!("{} % wrong beyond Bayes", 100.0 * BEYOND_BAYES);
    sheet.head(
        &format!("By conversions after ignition, {snr_db} dB: right / uncertain / right by Bayes, %"),
        &["conversions", "spark", "arc", "short", "open"],
    );
    for burns in CONVERSIONS {
        let case = Case::new(snr_db, burns);
        let confusion = case.run(pulses, 3);
        let mut cells = vec![burns.to_string()];
        for label in [Class::Spark, Class::Arc, Class::Short, Class::Open] {
            let (right, open) = (classifier::recall(&confusion, label), classifier::uncertain(&confusion, label));
            let bayes = case.bayes(label);
            cells.push(format!("{:.2} / {:.2} / {:.2}", 100.0 * right, 100.0 * open, 100.0 * bayes));
            // Bayes' rule for an open pulse knows when it would ignite.
            if label != Class::Open && 1.0 - right - open > 1.0 - bayes + BEYOND_BAYES {
                sheet.failed.push(format!("{label:?} of {burns} conversions at {snr_db} dB: bound {bound}"));
            }
        }
        sheet.row(&cells);
    }
}

fn hazards(sheet: &mut Sheet, size: &Size) -> Likelihood {
    let mut likelihood = Likelihood { efficiency_min: f64::INFINITY, chi2: 1.0 };
    sheet.head(
        &format!("Ignition likelihood, {} estimates each", size.estimates),
        &["pulses", "gap", "hazard", "ignite", "kind", "bound / variance", "chi2", "gap by the curve"],
    );
    for case in likelihood::CASES {
        let row = likelihood::run(case, size.estimates);
        let (khz, on_us, gap_um) = case;
        for (k, kind) in ["500 pulses from the start", "memory of 250 pulses"].into_iter().enumerate() {
            let (efficiency, chi2) = (row.efficiency[k], row.chi2[k]);
            likelihood.efficiency_min = likelihood.efficiency_min.min(efficiency);
            if (chi2 - 1.0).abs() > (likelihood.chi2 - 1.0).abs() {
                likelihood.chi2 = chi2;
            }
            let (deviation, error) = row.gap_um;
            let gap = format!("{error:+.2} um mean, {deviation:.2} um standard deviation");
            sheet.row(&[
                format!("{khz} kHz, {on_us} us on"),
                format!("{gap_um} um"),
                format!("{:.0} /s", row.hazard),
                format!("{:.0} %", 100.0 * row.ignites),
                kind.into(),
                format!("{efficiency:.3}"),
                format!("{chi2:.3}"),
                if k == 1 { gap } else { String::new() },
            ]);
        }
    }
    sheet.bounds("Ignition likelihood, bounds");
    let Likelihood { efficiency_min, chi2 } = likelihood;
    let holds = efficiency_min >= likelihood::EFFICIENCY;
    let figure = "Cramer-Rao bound over variance, smallest";
    sheet.bound(figure, "at least 1 / 1.1 = 0.909", format!("{efficiency_min:.3}"), holds);
    let (low, high) = likelihood::CHI2;
    let holds = (low..=high).contains(&chi2);
    let figure = "mean square of the error over the stated variance, farthest from 1";
    sheet.bound(figure, &format!("{low} to {high}"), format!("{chi2:.3}"), holds);
    likelihood
}

fn averages(sheet: &mut Sheet, size: &Size) -> [f64; 2] {
    let pulses = size.averaged;
    sheet.bounds(&format!("Average of the same {pulses} pulses at off-times of 10 us and of 1 ms"));
    let mut shifts = [0.0; 2];
    for (kind, kind_name) in [(Kind::IsoFrequency, "on for 100 us"), (Kind::IsoEnergy, "on for 60 us from ignition")] {
        for (k, (average, name)) in [(Average::Gated, "gated"), (Average::Plain, "plain")].into_iter().enumerate() {
            let ([short, long], shift) = average::shift(kind, average, pulses);
            let bounded = kind == Kind::IsoFrequency && average == Average::Gated;
            if kind == Kind::IsoFrequency {
                shifts[k] = shift;
            }
            let measured = format!("{short:.2} V, {long:.2} V: {}", percent(shift));
            let bound = if bounded { "moves by less than 1 %" } else { "none" };
            sheet.bound(&format!("{name}, {kind_name}"), bound, measured, !bounded || shift < average::BOUND);
        }
    }
    shifts
}

fn captures(sheet: &mut Sheet, errors: &charging::Errors) {
    sheet.bounds(&format!("Gap by charging time, {} gaps from 10 to 80 um", errors.gaps));
    let rows = [("single captures", errors.single, 0), ("means of 16", errors.mean16, 1)];
    for (name, (rms, most), bound) in rows {
        let (rms_bound, most_bound) = charging::BOUNDS[bound];
        let bound = format!("{rms_bound} um rms, {most_bound} um");
        let holds = rms <= rms_bound && most <= most_bound;
        sheet.bound(&format!("{name}: error"), &bound, format!("{rms:.3} um rms, {most:.3} um largest"), holds);
    }
    let (rms, most) = errors.fitted;
    let measured = format!("{rms:.3} um rms, {most:.3} um largest");
    sheet.bound("polynomial fitted to 15 steps of 16 captures: error", "none", measured, true);
}

fn persistent(sheet: &mut Sheet, size: &Size, arcs: &arcs::Arcs) {
    sheet.bounds(&format!(
        "Persistent arcs, {} and {} seeds, {} runs",
        size.scenarios.join(", "),
        size.seeds,
        arcs.runs
    ));
    let figure = format!(
        "{ARCS_PERCENT} % of the pulses arcs: longest time from persistent arcs (by the process) to the report"
    );
    let (late, falsely) = (arcs.named_ms_max, arcs.falsely);
    sheet.bound(&figure, &format!("{} ms", arcs::NAMED_MS), format!("{late} ms"), late <= arcs::NAMED_MS);
    sheet.bound("the same, from the first arc", "none", format!("{} ms", arcs.after_ms_max), true);
    sheet.bound("runs with a false or another report", "0", falsely.to_string(), falsely == 0);
}

impl Report {
    /// Whether everything is within its bound.
    pub fn holds(&self) -> bool {
        self.failed.is_empty()
    }
}

// Columns of a confusion matrix follow the classes.
const _: () = assert!(LABELS.len() == 4 && Class::Open as usize == 0 && Class::Uncertain as usize == 5);

//! Accuracy of the gap estimators, measured on signals of which everything is known.
//!
//! All of it is simulated, from seeds: the same figures every time. What runs is the code of the core.

mod arcs;
mod average;
mod charging;
mod classifier;
mod filter;
mod likelihood;
mod notch;

use super::gate::{Gate, Kind, Wanted};
use super::statistics::each;
use average::Kind as Pulses;
use classifier::{Case, Confusion, LABELS};
use edm_servo_head::gap::pulses::Class;
use edm_servo_head::gap::voltage::Average;
use edm_sim::scenario::BUILT_IN;

/// How much is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Labelled pulses of a case.
    pub pulses: u64,
    /// Estimates of the hazard of each kind.
    pub estimates: u32,
    /// Seeds of each scenario with arcs and without.
    pub seeds: u64,
}

impl Size {
    /// What the bounds are about.
    pub const FULL: Size = Size { pulses: 1_000_000, estimates: 20_000, seeds: 20 };
    /// What fits a quarter of a minute.
    pub const SHORT: Size = Size { pulses: 100_000, estimates: 4000, seeds: 3 };
}

/// Pulses that are averaged.
const AVERAGED: u32 = 20_000;
/// Shares of the pulses that are made arcs, %, and the scenarios in which they are.
const ARCS_PERCENT: [f64; 3] = [75.0, 90.0, 100.0];
const WITH_ARCS: [&str; 4] = ["sinker", "sinker-1khz", "sinker-dirty", "silicon"];
/// Recall of open, spark and short; of arc and spark at 20 dB and at 10 dB.
const RECALLS: [f64; 3] = [0.995, 0.97, 0.96];
/// Shorts of a million that may be taken for sparks.
const SHORTS_AS_SPARKS: u64 = 10;
/// What may be wrong beyond what Bayes' rule gets wrong.
const BEYOND_BAYES: f64 = 0.01;
/// Conversions since ignition that are compared.
const CONVERSIONS: [usize; 10] = [1, 2, 3, 4, 6, 8, 10, 12, 14, 16];

fn gate(name: impl Into<String>, value: f64, wanted: Wanted, note: impl Into<String>) -> Gate {
    Gate::new(Kind::Physics, name, value, wanted, note)
}

/// The filter chain of the head.
pub fn filters() -> Vec<Gate> {
    let cases = filter::cases();
    let errors = cases.iter().map(|case| (case.error(case.config), case.name));
    let (error, name) = errors.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::NAN, ""));
    let note = format!("{name}, of {} cases", cases.len());
    let figure = "low-pass and notch compared with scipy in f64, codes rms";
    vec![gate(figure, error, Wanted::AtMost(filter::BOUND), note)]
}

/// The notch that follows the mains.
pub fn notches() -> Vec<Gate> {
    let mut gates = vec![];
    for case in &notch::CASES {
        let notch::Attenuation { tracked, fixed } = notch::attenuation(case);
        let figure = format!("drift of +-0.5 Hz at 0.1 Hz/s: {}, worst second, dB", case.name);
        gates.push(gate(figure, tracked, Wanted::Between(notch::BOUND_DB, 100.0), ""));
        // It does not reach what is asked, or nothing would have to follow.
        let figure = format!("the same of a notch at rest: {}, dB", case.name);
        gates.push(gate(figure, fixed, Wanted::AtMost(30.0), ""));
    }
    let figure = "no hum, noise of 6 V: drift of the notch in a minute, largest of 10 seeds, Hz";
    gates.push(gate(figure, notch::wandering_hz(10), Wanted::AtMost(notch::WANDERING_HZ), ""));
    for hertz in [0.0, 5.0, 10.0, 20.0, 30.0] {
        let [chain, notch] = notch::group_delay_ms(hertz);
        let figure = format!("group delay at {hertz} Hz, low-pass 200 Hz and notch 50 Hz, Q 2.5 (calculated), ms");
        gates.push(Gate::figure(figure, chain, format!("notch alone {notch:.2} ms")));
    }
    gates
}

/// A confusion matrix in words, in the order of [`Class`].
fn said(confusion: &Confusion) -> String {
    let rows = LABELS.iter().zip(confusion).map(|(label, row)| format!("{label:?}: {row:?}"));
    rows.collect::<Vec<_>>().join("; ")
}

/// Classes of labelled pulses.
pub fn classes(size: &Size) -> Vec<Gate> {
    let pulses = size.pulses;
    let burning = [Class::Spark, Class::Arc];
    let mut gates = vec![];
    let cases: [(&str, f64, usize, &[Class]); 3] = [
        ("open, spark and short, 20 dB, 4 conversions", 20.0, 4, &[Class::Open, Class::Spark, Class::Short]),
        ("arc and spark, 20 dB, 16 conversions after ignition", 20.0, 16, &burning),
        ("arc and spark, 10 dB, 16 conversions after ignition", 10.0, 16, &burning),
    ];
    for ((name, snr_db, burns, labels), least) in cases.into_iter().zip(RECALLS) {
        let confusion = Case::new(snr_db, burns).run(pulses, 1);
        let recall = classifier::least(&confusion, labels);
        gates.push(gate(format!("{name}: smallest recall"), recall, Wanted::AtLeast(least), said(&confusion)));
    }
    let shorts = Case { labels: &[Class::Short], ..Case::new(20.0, 4) }.run(pulses, 2);
    let wrong = shorts[3][Class::Spark as usize] as f64 * 1e6 / pulses as f64;
    let most = Wanted::AtMost(SHORTS_AS_SPARKS as f64);
    gates.push(gate("shorts classified as sparks, 20 dB, of a million", wrong, most, ""));
    let (fast, named) = classifier::at_100_khz(pulses);
    let figure = "arcs and sparks at 100 kHz, half on (2 or 3 conversions), classified as arc or spark";
    gates.push(gate(figure, named as f64, Wanted::AtMost(0.0), format!("of {fast}")));
    // Noise that the classifier was not made for leaves more than the bound wrong.
    let noisy = Case::new(6.0, 16).run(20_000, 1);
    let (sparks, arcs) = (classifier::recall(&noisy, Class::Spark), classifier::uncertain(&noisy, Class::Arc));
    gates.push(gate("negative control, 6 dB: recall of sparks", sparks, Wanted::AtMost(0.96), ""));
    gates.push(gate("negative control, 6 dB: share of uncertain arcs", arcs, Wanted::AtLeast(0.9), ""));
    for snr_db in [20.0, 10.0] {
        gates.extend(CONVERSIONS.into_iter().flat_map(|burns| fewer(snr_db, burns, pulses)));
    }
    gates
}

/// So many conversions after ignition, compared with the best possible rule.
fn fewer(snr_db: f64, burns: usize, pulses: u64) -> Vec<Gate> {
    let case = Case::new(snr_db, burns);
    let confusion = case.run(pulses, 3);
    // Bayes' rule for an open pulse knows when it would ignite.
    let labels = [Class::Spark, Class::Arc, Class::Short].into_iter();
    labels
        .map(|label| {
            let (right, open) = (classifier::recall(&confusion, label), classifier::uncertain(&confusion, label));
            let bayes = case.bayes(label);
            let figure = format!("{label:?}, {burns} conversions, {snr_db} dB: share wrong beyond Bayes");
            let note = format!("right {right:.4}, uncertain {open:.4}, right by Bayes {bayes:.4}");
            gate(figure, bayes - right - open, Wanted::AtMost(BEYOND_BAYES), note)
        })
        .collect()
}

/// Hazard of ignition.
pub fn hazards(size: &Size) -> Vec<Gate> {
    let mut gates = vec![];
    for (khz, on_us, gap_um) in likelihood::CASES {
        let row = likelihood::run((khz, on_us, gap_um), size.estimates);
        let (deviation, error) = row.gap_um;
        let said = format!(
            "hazard {:.0} /s, {:.0} % ignite; gap {error:+.2} um mean, {deviation:.2} um standard deviation",
            row.hazard,
            100.0 * row.ignites
        );
        let (low, high) = likelihood::CHI2;
        for (k, kind) in ["500 pulses from the start", "memory of 250 pulses"].into_iter().enumerate() {
            let name = |what: &str| format!("{khz} kHz, {on_us} us on, gap {gap_um} um, {kind}: {what}");
            let least = Wanted::AtLeast(likelihood::EFFICIENCY);
            gates.push(gate(name("Cramer-Rao bound over variance"), row.efficiency[k], least, said.clone()));
            let figure = name("mean square of the error over the stated variance");
            gates.push(gate(figure, row.chi2[k], Wanted::Between(low, high), ""));
        }
    }
    gates
}

/// Averages of the same pulses at two off-times.
pub fn averages() -> Vec<Gate> {
    let mut gates = vec![];
    for (kind, kind_name) in
        [(Pulses::IsoFrequency, "on for 100 us"), (Pulses::IsoEnergy, "on for 60 us from ignition")]
    {
        for (average, name) in [(Average::Gated, "gated"), (Average::Plain, "plain")] {
            let ([short, long], shift) = average::shift(kind, average, AVERAGED);
            let figure = format!("{name}, {kind_name}: share by which off-times of 10 us and 1 ms move it");
            let note = format!("{short:.2} V, {long:.2} V");
            gates.push(match (kind, average) {
                (Pulses::IsoFrequency, Average::Gated) => gate(figure, shift, Wanted::AtMost(average::BOUND), note),
                // It has to move, or nothing would need a gate.
                (Pulses::IsoFrequency, Average::Plain) => gate(figure, shift, Wanted::AtLeast(0.5), note),
                _ => Gate::figure(figure, shift, note),
            });
        }
    }
    gates
}

/// Gap by charging time.
pub fn captures() -> Vec<Gate> {
    let errors = charging::measure().expect("known steps make a polynomial");
    let mut gates = vec![];
    let rows = [("single captures", errors.single, 0), ("means of 16", errors.mean16, 1)];
    for (name, (rms, most), bound) in rows {
        let (rms_bound, most_bound) = charging::BOUNDS[bound];
        let note = format!("{} gaps from 10 to 80 um", errors.gaps);
        gates.push(gate(format!("{name}: error, um rms"), rms, Wanted::AtMost(rms_bound), note));
        gates.push(gate(format!("{name}: largest error, um"), most, Wanted::AtMost(most_bound), ""));
    }
    let (rms, most) = errors.fitted;
    let figure = "polynomial fitted to 15 steps of 16 captures: error, um rms";
    gates.push(Gate::figure(figure, rms, format!("{most:.3} um largest")));
    gates
}

/// Persistent arcs on the running head.
pub fn persistent(size: &Size) -> Vec<Gate> {
    let mut runs: Vec<(&str, Option<f64>, u64)> = vec![];
    for seed in 1..=size.seeds {
        runs.extend(WITH_ARCS.iter().flat_map(|name| ARCS_PERCENT.map(|percent| (*name, Some(percent), seed))));
        runs.extend(BUILT_IN.iter().map(|(name, _)| (*name, None, seed)));
    }
    let done = each(&runs, |&(name, percent, seed)| match percent {
        Some(percent) => {
            let named = arcs::with_arcs(name, percent, seed).expect("an erosion");
            (named.late_ms(), named.after_ms(), !named.rightly())
        }
        None => (0, 0, arcs::without_arcs(name, seed).expect("an erosion").falsely),
    });
    let most = |of: fn(&(u64, u64, bool)) -> u64| done.iter().map(of).max().unwrap_or(u64::MAX) as f64;
    let wrong = runs.iter().zip(&done).filter(|(_, done)| done.2);
    let wrong: Vec<String> = wrong.map(|((name, percent, seed), _)| format!("{name} {percent:?} {seed}")).collect();
    let late = Wanted::AtMost(arcs::NAMED_MS as f64);
    let note = format!("{} and {} seeds, 75, 90 and 100 % of the pulses arcs", WITH_ARCS.join(", "), size.seeds);
    vec![
        gate("longest time from persistent arcs (by the process) to the report, ms", most(|done| done.0), late, note),
        Gate::figure("the same, from the first arc, ms", most(|done| done.1), ""),
        gate("runs with a false or another report", wrong.len() as f64, Wanted::AtMost(0.0), wrong.join("; ")),
    ]
}

// Columns of a confusion matrix follow the classes.
const _: () = assert!(LABELS.len() == 4 && Class::Open as usize == 0 && Class::Uncertain as usize == 5);

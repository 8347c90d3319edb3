//! Arcs that stay, natively: found within 200 ms of the moment from which there are any, and never without.
//!
//! `gap_report::arcs` says what there really is. Everything is simulated. The short form runs three seeds; `EDM_SEEDS=20` runs
//! twenty.

use edm_sim::gap_report::arcs::{NAMED_MS, with_arcs, without_arcs};

fn seeds() -> u64 {
    std::env::var("EDM_SEEDS").ok().and_then(|seeds| seeds.parse().ok()).unwrap_or(3)
}

#[test]
fn arcs_that_stay_are_named_in_time() {
    let mut slowest = 0;
    for name in ["sinker", "sinker-1khz", "sinker-dirty", "silicon"] {
        for percent in [75.0, 90.0, 100.0] {
            for seed in 1..=seeds() {
                let named = with_arcs(name, percent, seed).unwrap();
                assert!(named.rightly(), "{name} {percent} % {seed}: {named:?}");
                assert!(named.late_ms() <= NAMED_MS, "{name} {percent} % {seed}: {named:?}");
                slowest = slowest.max(named.late_ms());
            }
        }
    }
    println!("at most {slowest} ms after there were any");
}

#[test]
fn without_arcs_that_stay_none_are_named_in_any_scenario() {
    let scenarios = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios")).unwrap();
    let mut names: Vec<String> =
        scenarios.map(|entry| entry.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned()).collect();
    names.sort();
    for name in names {
        let mut most = 0.0f64;
        for seed in 1..=seeds() {
            let without = without_arcs(&name, seed).unwrap();
            assert!(!without.falsely, "{name} {seed}: named with {:.0} % at most", without.most);
            most = most.max(without.most);
        }
        println!("{name}: at most {most:.0} % of the pulses of 200 ms were arcs");
    }
}

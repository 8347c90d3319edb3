//! Sensitivity: how far every unpublished number, one at a time, moves the results of the gates.
//!
//! A result that goes with the third power of a number that somebody assumed is that assumption, and nothing that was found.

use super::calibration;
use super::gate::{Gate, Kind, Wanted};
use super::statistics::each;
use edm_process::harness::{Law, Motion, Rig, Voltage};
use edm_process::parameters::{DECLARED, GAO, Machine, Parameters, SINKER, XIN};

/// What a number is multiplied and divided by.
const FACTOR: f64 = 1.5;

/// Results compared, with their units, and whether they may not go with the third power of a number: shares of rare events do.
const RESULTS: [(&str, bool); 7] = [
    ("sinker at 50 V: time to 0.1 mm, s", true),
    ("sinker at 50 V: arcs, %", false),
    ("thesis machine: swing, um", true),
    ("rate at 5 mm over 0.5 mm", true),
    ("[X]: removal at 40 um over 60 um", true),
    ("[G] at DHT 200: time to 0.2 mm, s", true),
    ("[G] at DHT 200: short cycles, %", false),
];
/// Largest power of a number.
const POWER: f64 = 3.0;

/// Numbers of the process that are assumed or chosen for any of the three machines and are not zero in all of them.
fn looked_at() -> Vec<&'static str> {
    let open = |key: &&str| [SINKER, XIN, GAO].iter().any(|machine| machine.unpublished().any(|other| other == *key));
    DECLARED.iter().map(|declared| declared.key).filter(open).collect()
}

/// First as it is, then every number down and up.
pub fn sensitivity() -> Vec<Gate> {
    let mut all = vec![("nothing", 1.0)];
    all.extend(looked_at().into_iter().flat_map(|key| [(key, 1.0 / FACTOR), (key, FACTOR)]));
    let found = each(&all, |&(key, factor)| results(key, factor));
    let mut rows = Vec::new();
    for (n, (what, bound)) in RESULTS.into_iter().enumerate() {
        let (mut most, mut by) = (0.0, "nothing".to_string());
        for (&(key, factor), results) in all.iter().zip(&found) {
            rows.push(Gate::figure(format!("{key} by {factor:.3}: {what}"), results[n], ""));
            let power = ((results[n] / found[0][n]).ln() / f64::ln(factor)).abs();
            // Not a number is the most there is.
            if factor != 1.0 && (power.is_nan() || power > most) {
                (most, by) = (power, format!("{key} by {factor:.3}"));
            }
        }
        let wanted = if bound { Wanted::AtMost(POWER) } else { Wanted::Anything };
        rows.push(Gate::new(
            Kind::Physics,
            format!("{what}: largest power of an unpublished number"),
            most,
            wanted,
            by,
        ));
    }
    rows
}

fn changed(machine: &Machine, key: &str, factor: f64) -> Parameters {
    let mut p = machine.of();
    // An arc burns below a spark: both levels move together.
    if matches!(key, "burn_v" | "arc_v") {
        (p.burn_v, p.arc_v) = (p.burn_v * factor, p.arc_v * factor);
        return p;
    }
    if let Some(k) = DECLARED.iter().position(|declared| declared.key == key) {
        let value = p.values().nth(k).unwrap_or(0.0) * factor;
        let (least, most) = DECLARED[k].range;
        // A machine for which it would leave its range keeps it at the end of that.
        let _ = p.set(key, value.clamp(least, most));
    }
    p
}

fn results(key: &str, factor: f64) -> [f64; 7] {
    const NOTHING: Motion = Motion { buzz: (0.0, 0.0), jump: (0.0, 0.0, 0.0) };
    const SEEDS: u64 = 2;
    let p = changed(&SINKER, key, factor);
    let (mut seconds, mut arcs, mut pulses) = (0.0, 0, 0);
    for seed in 1..=SEEDS {
        let Ok(mut rig) = Rig::new(&p, Law::Voltage(Voltage::calm(50.0)), NOTHING, seed) else { return [f64::NAN; 7] };
        seconds += rig.bore(100.0, 1000.0) / SEEDS as f64;
        arcs += rig.process.pulses().arc;
        pulses += rig.process.pulses().total();
    }
    let swing = Rig::new(&p, Law::Voltage(Voltage::thesis(50.0)), NOTHING, 1)
        .map_or(f64::NAN, |mut rig| edm_process::harness::swing(&mut rig, 5.0, 20.0).um);
    let rate = |depth_um| {
        let p = Parameters { depth_um, ..p };
        let Ok(mut rig) = Rig::new(&p, Law::Voltage(Voltage::calm(55.0)), NOTHING, 1) else { return f64::NAN };
        rig.run(30.0);
        let before = rig.process.depth_um();
        rig.run(80.0);
        rig.process.depth_um() - before
    };
    let removed = |gap| {
        let Ok(mut rig) = Rig::new(&changed(&XIN, key, factor), Law::Gap(gap), NOTHING, 1) else {
            return f64::NAN;
        };
        rig.run(10.0);
        let before = rig.process.depth_um();
        rig.run(50.0);
        rig.process.depth_um() - before
    };
    let ends = |at: usize| calibration::TABLE_4.get(at).map_or(f64::NAN, |row| row.0);
    let (mut micro_s, mut short) = (0.0, 0.0);
    for seed in 1..=SEEDS {
        let p = changed(&GAO, key, factor);
        let Ok(mut rig) = Rig::new(&p, Law::Fc(200, true), NOTHING, seed) else { return [f64::NAN; 7] };
        micro_s += rig.bore(200.0, 1000.0) / SEEDS as f64;
        short += 100.0 * rig.tally.short_cycles as f64 / rig.tally.cycles as f64 / SEEDS as f64;
    }
    let deep = rate(5000.0) / rate(500.0);
    [seconds, 100.0 * arcs as f64 / pulses as f64, swing, deep, removed(ends(0)) / removed(ends(2)), micro_s, short]
}

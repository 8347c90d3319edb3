//! Sensitivity: how far every unpublished number, one at a time, moves the results of the gates.

use super::calibration;
use super::gate::Gate;
use super::statistics::each;
use edm_process::harness::{Law, Motion, Rig, Voltage};
use edm_process::parameters::{DECLARED, GAO, Machine, Parameters, SINKER, XIN};

/// What a number is multiplied and divided by.
const FACTOR: f64 = 1.5;

/// Results compared, with their units.
const RESULTS: [&str; 7] = [
    "sinker at 50 V: time to 0.1 mm, s",
    "arcs there, %",
    "thesis machine: swing, um",
    "rate at 5 mm over 0.5 mm",
    "[X]: removal at 40 um over 60 um",
    "[G] at DHT 200: time to 0.2 mm, s",
    "short cycles there, %",
];

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
    let rows = all.iter().zip(found).flat_map(|(&(key, factor), results)| {
        RESULTS
            .into_iter()
            .zip(results)
            .map(move |(what, value)| Gate::figure(format!("{key} by {factor:.3}: {what}"), value, ""))
    });
    rows.collect()
}

fn changed(machine: &Machine, key: &str, factor: f64) -> Parameters {
    let mut p = machine.of();
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

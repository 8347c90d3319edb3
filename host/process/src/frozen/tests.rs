//! The fingerprint sees every number and every mechanism.

use super::*;
use crate::parameters::DECLARED;

/// What a course has come to after each of its milliseconds.
fn course(run: Run) -> Vec<Hash> {
    let mut course = Course::new(run, &(run.machine)()).unwrap();
    (0..Course::LASTS_MS).map(|_| course.millisecond(|_| {})).collect()
}

/// Whether a change of numbers, and of what acts, changes a run whose course is this.
fn moves(run: Run, usual: &[Hash], p: &Parameters, change: impl Fn(&mut Acts)) -> bool {
    let mut course = Course::new(run, p).unwrap();
    // One by one: most differ at once.
    usual.iter().any(|&usual| course.millisecond(&change) != usual)
}

/// The numbers of a run with one of them changed: by a tenth, to the other side where its range ends, a switch turned; `None` for one
/// that the run has not.
fn changed(run: Run, key: &str) -> Option<Parameters> {
    let p = (run.machine)();
    let value = DECLARED.iter().zip(p.values()).find(|(declared, _)| declared.key == key)?.1;
    let others = if matches!(key, "negative" | "comes_back") { [1.0 - value; 2] } else { [1.1 * value, 0.9 * value] };
    others.into_iter().find_map(|other| {
        let mut changed = p;
        (changed.set(key, other).is_ok() && changed.check().is_ok() && changed != p).then_some(changed)
    })
}

#[test]
fn the_model_is_the_one_of_its_version() {
    assert_eq!(fingerprint(), Ok(FINGERPRINT), "changed: a new version with its own gates");
}

#[test]
fn every_number_moves_a_run_and_what_all_generators_have_in_common_moves_each_of_theirs() {
    /// What a kind of generator has no use for.
    fn is_idle(kind: Kind, key: &str) -> bool {
        let transistor = matches!(kind, Kind::IsoFrequency | Kind::IsoEnergy);
        match key {
            "wait_us" => matches!(kind, Kind::IsoFrequency | Kind::ControlledRc),
            "on_us" | "off_us" => kind == Kind::Rc,
            "charge_ohm" | "permittivity" | "rounding_um" => !transistor,
            "burn_ohm" => kind == Kind::Rc,
            "short_v" => kind == Kind::ControlledRc,
            "capacitor_pf" | "capacitor_ohm" | "loop_nh" => transistor,
            _ => false,
        }
    }
    let usual: Vec<Vec<Hash>> = RUNS.iter().map(|run| course(*run)).collect();
    let mut failed = Vec::new();
    for declared in DECLARED {
        let key = declared.key;
        let moved = |(run, usual): (&Run, &Vec<Hash>)| changed(*run, key).map(|p| moves(*run, usual, &p, |_| {}));
        let moved: Vec<Option<bool>> = RUNS.iter().zip(&usual).map(moved).collect();
        if !moved.contains(&Some(true)) {
            failed.push(format!("{key} moves nothing"));
        }
        for (run, moved) in RUNS.iter().zip(moved).take(4) {
            let p = (run.machine)();
            let other_wear = if p.negative > 0.0 { "wear_positive" } else { "wear_negative" };
            if moved == Some(is_idle(p.kind, key) || key == other_wear || key == "thickness_um") {
                failed.push(format!("{key} moves {:?}: {moved:?}", p.kind));
            }
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn every_order_and_every_load_moves_a_run() {
    let usual = course(RUNS[0]);
    let p = (RUNS[0].machine)();
    let moves = |change: fn(&mut Acts)| moves(RUNS[0], &usual, &p, change);
    assert!(!moves(|_| {}));
    type Without = (&'static str, fn(&mut Acts));
    let without: [Without; 12] = [
        ("an off-time of the head's", |acts| acts.orders.off_us = None),
        ("a short across the gap", |acts| acts.orders.shorted = false),
        ("a dead generator", |acts| acts.orders.dead = false),
        ("no sense supply", |acts| acts.orders.senseless = false),
        ("arcs by order", |acts| acts.orders.arcs = 0.0),
        ("pulses inhibited", |acts| acts.orders.pulses = true),
        ("what pushes", |acts| acts.load.force_n = 0.0),
        ("contact", |acts| acts.load.gap_um = acts.load.gap_um.max(0.0)),
        ("film", |acts| acts.load.film.damping = 0.0),
        ("the end of suction", |acts| acts.load.film.suction = f64::INFINITY),
        ("diodes", |acts| {
            acts.winding = if acts.winding == Winding::Open { Winding::Volts(0.0) } else { acts.winding }
        }),
        ("a brake", |acts| {
            acts.winding = if acts.winding == Winding::Volts(0.0) { Winding::Open } else { acts.winding }
        }),
    ];
    for (what, change) in without {
        assert!(moves(change), "{what} moves nothing");
    }
}

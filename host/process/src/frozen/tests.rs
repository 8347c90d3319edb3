//! The fingerprint sees every number and every mechanism.

use super::*;

/// What a course has come to after each of its milliseconds.
fn course(version: u32, run: Run) -> Vec<Hash> {
    let mut course = Course::new(run, &(run.machine)(version)).unwrap();
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
fn changed(version: u32, run: Run, key: &str) -> Option<Parameters> {
    let p = (run.machine)(version);
    let value = DECLARED.iter().zip(p.values()).find(|(declared, _)| declared.key == key)?.1;
    let others = if matches!(key, "negative" | "comes_back") { [1.0 - value; 2] } else { [1.1 * value, 0.9 * value] };
    others.into_iter().find_map(|other| {
        let mut changed = p;
        (changed.set(key, other).is_ok() && changed.check().is_ok() && changed != p).then_some(changed)
    })
}

#[test]
fn the_model_is_the_one_of_its_version() {
    for (version, is) in FINGERPRINTS {
        assert_eq!(fingerprint(version), Ok(is), "version {version} changed: a new version with its own gates");
    }
}

#[test]
fn every_number_moves_a_run_and_what_all_generators_have_in_common_moves_each_of_theirs() {
    /// What a kind of generator has no use for.
    fn is_idle(version: u32, kind: Kind, key: &str) -> bool {
        let transistor = matches!(kind, Kind::IsoFrequency | Kind::IsoEnergy);
        match key {
            "wait_us" => matches!(kind, Kind::IsoFrequency | Kind::ControlledRc),
            "on_us" | "off_us" => kind == Kind::Rc,
            // In version 2 it goes with the burning time alone.
            "recovery_us" => kind == Kind::Rc && version == 2,
            "charge_ohm" | "permittivity" | "rounding_um" => !transistor,
            "burn_ohm" => kind == Kind::Rc,
            "short_v" => kind == Kind::ControlledRc,
            "capacitor_pf" | "capacitor_ohm" | "loop_nh" => transistor,
            _ => false,
        }
    }
    for (version, numbers) in [(1, OF_VERSION_1), (2, DECLARED.len())] {
        let usual: Vec<Vec<Hash>> = RUNS.iter().map(|run| course(version, *run)).collect();
        let mut failed = Vec::new();
        let added: Vec<&str> = DECLARED.iter().skip(OF_VERSION_1).map(|declared| declared.key).collect();
        for declared in DECLARED.iter().take(numbers) {
            let key = declared.key;
            let moved =
                |(run, usual): (&Run, &Vec<Hash>)| changed(version, *run, key).map(|p| moves(*run, usual, &p, |_| {}));
            let moved: Vec<Option<bool>> = RUNS.iter().zip(&usual).map(moved).collect();
            if !moved.contains(&Some(true)) {
                failed.push(format!("{key} moves nothing"));
            }
            // What version 2 has besides acts in some of them only.
            let in_all = version == 1 || !(key == "tear_um" || added.contains(&key));
            for (run, moved) in RUNS.iter().zip(moved).take(if in_all { 4 } else { 0 }) {
                let p = (run.machine)(version);
                let other_wear = if p.negative > 0.0 { "wear_positive" } else { "wear_negative" };
                if moved == Some(is_idle(version, p.kind, key) || key == other_wear || key == "thickness_um") {
                    failed.push(format!("{key} moves {:?}: {moved:?}", p.kind));
                }
            }
        }
        assert!(failed.is_empty(), "version {version}: {failed:#?}");
    }
}

#[test]
fn every_order_and_every_load_moves_a_run() {
    for version in [1, 2] {
        let usual = course(version, RUNS[0]);
        let p = (RUNS[0].machine)(version);
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
            assert!(moves(change), "version {version}: {what} moves nothing");
        }
    }
}

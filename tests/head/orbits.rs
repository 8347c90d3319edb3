//! Orbits: what the head makes of a depth, in its set points of all three axes.

use crate::bench::Bench;
use edm_servo_head::head::{Command, OrbitShape, Refused, State};
use edm_servo_head::units::{Fixed, Nanometres};
use std::collections::BTreeMap;

/// Depth below the home, um.
const DEPTH: f64 = 400.0;
const RADIUS: f64 = 50.0;
const PITCH: f64 = 100.0;

fn place(bench: &Bench) -> [f64; 3] {
    let status = bench.head.status();
    let [x, y] = status.beside.map(|um| f64::from(um.to_f32()));
    [f64::from(status.setpoint.to_f32()), x, y]
}

/// On its way to the depth in the open, where it goes as fast as it seeks; with a wire over the gap where that is set.
fn orbiting(shape: OrbitShape) -> Bench {
    let mut bench = Bench::with(|settings| {
        settings.orbit_shape = shape;
        (settings.orbit_radius, settings.orbit_pitch) = (RADIUS as f32, PITCH as f32);
        settings.seek_velocity = 2000.0;
    });
    bench.make_ready();
    bench.surface_um = 1e5;
    bench.command(Command::MoveTo(Nanometres(DEPTH as i64 * 1000)));
    bench.command(Command::Start);
    bench
}

#[test]
fn the_path_of_a_depth_is_its_orbit_and_ends_in_the_middle_of_the_bottom() {
    for shape in [OrbitShape::Circle, OrbitShape::Square, OrbitShape::Sphere] {
        let mut bench = orbiting(shape);
        let (mut travelled, mut last) = (0f64, place(&bench));
        let (mut at_depth, mut rings) = ([false; 8], BTreeMap::new());
        bench.run_until(20.0, |bench| {
            let now @ [down, x, y] = place(bench);
            let [dx, dy] = [x - last[1], y - last[2]];
            travelled += dx.hypot(dy);
            last = now;
            let out = match shape {
                OrbitShape::Square => x.abs().max(y.abs()),
                _ => x.hypot(y),
            };
            let allowed = match shape {
                // So much of the sphere is that wide at this depth.
                OrbitShape::Sphere => (RADIUS.powi(2) - (down - (DEPTH - RADIUS)).max(0.0).powi(2)).max(0.0).sqrt(),
                _ => RADIUS,
            };
            // On the way to a ring of the sphere it is inside.
            assert!(out <= allowed + 1.0, "{shape:?}: {out} of {allowed} um at {down}");
            if shape != OrbitShape::Sphere && down > 0.5 && down < DEPTH - 0.5 {
                assert!((out - RADIUS).abs() < 0.05, "{shape:?}: {out} um at {down}");
            }
            if (down - DEPTH).abs() < 0.02 && out > RADIUS - 0.1 {
                at_depth[((y.atan2(x) + core::f64::consts::PI) * 1.27) as usize % 8] = true;
            }
            *rings.entry(out.round() as i64).or_insert(0) += 1;
            bench.state() == State::Done
        });
        let [down, x, y] = place(&bench);
        assert!((down - DEPTH).abs() < 1e-6 && x.abs() < 1e-6 && y.abs() < 1e-6, "{shape:?}: {down} {x} {y}");
        match shape {
            OrbitShape::Sphere => assert!(rings.len() > 3, "{rings:?}"),
            _ => assert_eq!(at_depth, [true; 8], "{shape:?}: the whole wall is as deep"),
        }
        // Four turns down and one at the depth.
        let turn = match shape {
            OrbitShape::Circle => core::f64::consts::TAU * RADIUS,
            _ => 8.0 * RADIUS,
        };
        if shape != OrbitShape::Sphere {
            let expected = 5.0 * turn + 2.0 * RADIUS;
            assert!((travelled - expected).abs() < 0.01 * expected, "{shape:?}: {travelled} of {expected} um");
        }
        assert_eq!(bench.head.status().waiting, 0);
    }
}

#[test]
fn a_retreat_runs_the_orbit_backward_through_the_same_set_points() {
    for shape in [OrbitShape::Circle, OrbitShape::Square, OrbitShape::Sphere] {
        let mut bench = orbiting(shape);
        let (mut backward, mut last) = (0f64, Fixed(0));
        for tick in 0..60_000 {
            // A wire across the gap, now and then.
            bench.follows = (tick > 6000 && tick % 4000 > 3800).then_some(-1.0);
            if bench.follows.is_none() {
                bench.surface_um = 1e5;
            }
            bench.tick();
            let s = bench.head.in_force().path;
            backward += f64::from(last.minus(s).to_f32()).max(0.0);
            last = s;
            let [down, x, y] = place(&bench);
            if shape == OrbitShape::Circle && (1.0..DEPTH - 1.0).contains(&down) {
                // One place of the helix, in feed and in retreat.
                let turns = y.atan2(x) / core::f64::consts::TAU;
                let off = down / PITCH - turns;
                assert!((off - off.round()).abs() < 0.01 && (x.hypot(y) - RADIUS).abs() < 0.05, "{down} {x} {y}");
            }
            if bench.state() == State::Done {
                break;
            }
            assert_eq!(bench.fault(), None);
        }
        assert!(backward > 100.0, "{shape:?}: {backward} um back");
        bench.follows = None;
        bench.surface_um = 1e5;
        bench.run_until(20.0, |bench| bench.state() == State::Done);
        let [down, x, y] = place(&bench);
        assert!((down - DEPTH).abs() < 1e-6 && x.abs() < 1e-6 && y.abs() < 1e-6, "{shape:?}: {down} {x} {y}");
    }
}

#[test]
fn an_orbit_is_a_path_of_its_own() {
    let mut bench = orbiting(OrbitShape::Circle);
    bench.run(0.1);
    let deeper = Command::MoveTo(Nanometres(500_000));
    assert_eq!(bench.head.command(deeper), Err(Refused::PathActive), "until it is over");
    bench.run_until(20.0, |bench| bench.state() == State::Done);
    bench.command(deeper);
    bench.command(Command::Start);
    bench.run_until(20.0, |bench| bench.state() == State::Done);
    assert!((place(&bench)[0] - 500.0).abs() < 1e-6);
    // Upward there is nothing to widen.
    let mut bench = orbiting(OrbitShape::Circle);
    bench.run(0.01);
    bench.command(Command::Hold);
    bench.run(0.1);
    bench.command(Command::ClearPath);
    let equator = Bench::with(|settings| settings.orbit_shape = OrbitShape::Sphere);
    let mut bench = equator;
    bench.make_ready();
    let shallow = bench.head.command(Command::MoveTo(Nanometres(19_000)));
    assert!(matches!(shallow, Err(Refused::OutOfTravel { .. })), "{shallow:?}");
    bench.command(Command::MoveTo(Nanometres(20_000)));
}

//! Jumps: out of the work, and back to the float point.

use crate::bench::Bench;
use edm_servo_head::head::{Command, Fault, Reason, Refused, State};
use edm_servo_head::path::{Piece, Shape};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{MicrometresPerSecond2, Nanometres};

/// Jumps of 0.5 mm.
fn small(settings: &mut Settings) {
    settings.jump_height = 500.0;
}

/// Eroding, with jumps of 0.5 mm.
fn eroding(change: impl FnOnce(&mut Settings)) -> Bench {
    let mut bench = Bench::with(|settings| {
        small(settings);
        change(settings);
    });
    bench.make_ready();
    bench.erode();
    bench.changes();
    bench
}

fn setpoint(bench: &Bench) -> f64 {
    bench.head.status().setpoint.to_f32().into()
}

#[test]
fn a_jump_goes_up_by_its_height_without_pulses_and_back_to_the_same_counts() {
    let mut bench = eroding(|_| {});
    bench.surface_um = bench.um() + 30.0;
    bench.run(0.5);
    bench.changes();
    let (um, path) = (bench.um(), bench.head.status().path);
    bench.command(Command::Jump);
    let mut top = f64::INFINITY;
    let mut gap = f64::INFINITY;
    bench.run_until(0.5, |bench| {
        let away = bench.head.in_force().state == State::Jumping;
        assert!(!away || !bench.output.pulses, "pulses in a jump");
        top = top.min(bench.um());
        gap = gap.min(bench.surface_um - bench.um());
        bench.state() == State::Eroding && bench.um() < um
    });
    assert!((um - top - 500.0).abs() < 15.0, "{um} um, up to {top} um");
    assert!(gap > 25.0, "as near as {gap} um");
    let reasons: Vec<Reason> = bench.changes().iter().map(|change| change.reason).collect();
    assert_eq!(reasons, [Reason::Jumped, Reason::Returned]);
    // From the float point, 0.1 mm above, under gap control.
    assert!((um - bench.um() - 100.0).abs() < 15.0, "{} um back of {um}", bench.um());
    assert!((bench.head.status().path.minus(path).to_f32() + 100.0).abs() < 3.0);
    bench.run(1.5);
    assert_eq!(bench.fault(), None);
    assert!((bench.um() - um).abs() <= 2.0, "{} um again, {um} before", bench.um());
    let on_path = setpoint(&bench) - f64::from(bench.head.status().path.to_f32());
    assert!(on_path.abs() < 1e-3, "the same count for the same coordinate: {on_path}");
}

#[test]
fn a_jump_longer_than_the_free_stroke_is_refused_and_nothing_moves() {
    let mut bench = eroding(|settings| settings.jump_height = 4000.0);
    let um = bench.um();
    match bench.head.command(Command::Jump) {
        Err(Refused::NoRoom { height, free }) => {
            assert_eq!(height, Nanometres(4_000_000));
            assert!((free.0 - 1_960_000).abs() < 30_000, "{free:?}");
        }
        other => panic!("{other:?}"),
    }
    bench.run(0.1);
    assert!((bench.um() - um).abs() < 3.0);
    assert_eq!((bench.state(), bench.changes().len()), (State::Eroding, 0));
}

#[test]
fn only_a_head_that_erodes_and_has_a_home_jumps() {
    for mut bench in [Bench::new(), Bench::ready()] {
        let state = bench.state();
        assert_eq!(bench.head.command(Command::Jump), Err(Refused::State(state)));
    }
    let mut bench = Bench::with(small);
    bench.run(0.01);
    bench.command(Command::Enable);
    bench.command(Command::MoveBy(Nanometres(4_000_000)));
    bench.command(Command::Start);
    bench.run_until(10.0, |bench| bench.state() == State::Eroding);
    assert_eq!(bench.head.command(Command::Jump), Err(Refused::NotHomed));
    assert_eq!(bench.state(), State::Eroding);
}

#[test]
fn jumps_come_by_time() {
    let mut bench = eroding(|_| {});
    let timed = Settings { jump_every_ms: 300.0, ..bench.settings };
    bench.head.configure(timed.build().unwrap().head).unwrap();
    bench.run(3.0);
    let jumps = bench.changes().iter().filter(|change| change.reason == Reason::Jumped).count();
    // Some 50 ms away each.
    assert!((7..=10).contains(&jumps), "{jumps}");
    let mut never = eroding(|_| {});
    never.run(3.0);
    assert!(never.changes().iter().all(|change| change.reason != Reason::Jumped));
}

#[test]
fn a_jump_that_is_due_is_as_high_as_there_is_room_and_says_so() {
    let due = |height: f32| {
        let mut bench = eroding(|settings| settings.jump_height = height);
        let timed = Settings { jump_every_ms: 300.0, ..bench.settings };
        bench.head.configure(timed.build().unwrap().head).unwrap();
        let (um, mut top) = (bench.um(), f64::INFINITY);
        for _ in 0..2 * 20_000 {
            bench.tick();
            top = top.min(bench.um());
        }
        assert_eq!((bench.fault(), bench.head.status().saturated), (None, false));
        let jumps = bench
            .changes()
            .iter()
            .filter(|change| change.to == State::Jumping)
            .map(|change| change.reason)
            .collect::<Vec<_>>();
        assert!((4..=7).contains(&jumps.len()), "{jumps:?}");
        (um - top, top, bench.head.status().cramped, jumps)
    };
    // 1.96 mm are free.
    let (height, _, cramped, jumps) = due(1900.0);
    assert!((height - 1900.0).abs() < 30.0 && !cramped, "{height} um");
    assert!(jumps.iter().all(|reason| *reason == Reason::Jumped));
    let (_, top, cramped, jumps) = due(3000.0);
    assert!((top - 100.0).abs() < 30.0 && cramped, "up to {top} um, the float distance below the end of the travel");
    assert!(jumps.iter().all(|reason| *reason == Reason::JumpedLow));
}

#[test]
fn a_jump_that_is_due_where_there_is_no_room_at_all_is_left_out_and_says_so() {
    let mut bench = Bench::with(|settings| settings.jump_height = 3000.0);
    // 0.11 mm are free.
    bench.surface_um = 150.0;
    bench.make_ready();
    bench.erode();
    let timed = Settings { jump_every_ms: 300.0, ..bench.settings };
    bench.head.configure(timed.build().unwrap().head).unwrap();
    assert!(!bench.head.status().cramped);
    bench.run(0.5);
    assert!(bench.head.status().cramped);
    assert_eq!((bench.state(), bench.fault()), (State::Eroding, None));
    // Until there is room.
    bench.surface_um += 300.0;
    bench.run(3.0);
    assert!(bench.changes().iter().any(|change| change.to == State::Jumping));
    let enough = Settings { jump_height: 100.0, ..timed };
    bench.head.configure(enough.build().unwrap().head).unwrap();
    bench.run(1.0);
    assert!(!bench.head.status().cramped);
}

#[test]
fn arcs_are_jumped_out_of_where_that_is_asked_for() {
    let mut bench = eroding(|settings| settings.jump_arcs = 40);
    let jumps = |bench: &mut Bench| bench.changes().iter().filter(|change| change.reason == Reason::Jumped).count();
    bench.arcs = 30;
    bench.run(2.0);
    assert_eq!((bench.state(), jumps(&mut bench)), (State::Eroding, 0));
    bench.arcs = 90;
    bench.run_until(0.2, |bench| bench.state() == State::Jumping);
    bench.arcs = 0;
    bench.run(2.0);
    assert_eq!((bench.state(), bench.fault(), jumps(&mut bench)), (State::Eroding, None, 1), "fresh fluid helped");
    // Two in vain, and then it does.
    let two = |bench: &mut Bench| {
        bench.arcs = 90;
        for _ in 0..2 {
            bench.run_until(0.3, |bench| bench.state() == State::Jumping);
            bench.run_until(0.3, |bench| bench.state() == State::Eroding);
        }
    };
    two(&mut bench);
    bench.arcs = 0;
    bench.run(2.0);
    assert_eq!((bench.state(), jumps(&mut bench)), (State::Eroding, 2));
    two(&mut bench);
    bench.run_until(0.5, |bench| bench.fault().is_some());
    assert_eq!((bench.fault(), jumps(&mut bench)), (Some(Fault::PersistentArc), 3), "three in vain");
}

#[test]
fn arcs_that_no_jump_can_help_for_want_of_room_are_the_supervisions() {
    let mut bench = Bench::with(|settings| (settings.jump_arcs, settings.jump_height) = (40, 4000.0));
    bench.surface_um = 150.0;
    bench.make_ready();
    bench.erode();
    bench.arcs = 50;
    bench.run(2.0);
    assert_eq!((bench.state(), bench.fault()), (State::Eroding, None));
    bench.arcs = 90;
    bench.run_until(0.3, |bench| bench.fault().is_some());
    assert_eq!(bench.fault(), Some(Fault::PersistentArc));
}

#[test]
fn a_contact_on_the_way_back_ends_the_jump_and_is_named() {
    let mut bench = eroding(|_| {});
    bench.command(Command::Jump);
    bench.run_until(0.1, |bench| bench.head.status().velocity.0 > 20_000.0);
    bench.surface_um = bench.um() + 50.0;
    bench.run_until(0.1, |bench| bench.state() == State::Fault);
    assert_eq!(bench.fault(), Some(Fault::Contact));
    let deepest = bench.um();
    bench.run(0.5);
    assert!(bench.um() < deepest - 400.0, "retracts from {deepest} to {}", bench.um());
}

#[test]
fn a_fault_in_a_jump_makes_no_step_of_the_set_point() {
    for ticks in [50, 200, 400, 600] {
        let mut bench = eroding(|_| {});
        bench.command(Command::Jump);
        for _ in 0..ticks {
            bench.tick();
        }
        assert_eq!(bench.state(), State::Jumping);
        bench.head.raise(Fault::HostSilent);
        let mut before = setpoint(&bench);
        let farthest = bench.um();
        for _ in 0..10_000 {
            bench.tick();
            // 50 mm/s are 2.5 counts a tick.
            assert!((setpoint(&bench) - before).abs() < 3.0, "{before} to {} after {ticks} ticks", setpoint(&bench));
            before = setpoint(&bench);
            assert!(bench.um() < farthest + 100.0, "toward the work in a fault");
        }
        assert_eq!(bench.fault(), Some(Fault::HostSilent));
    }
}

#[test]
fn a_held_jump_comes_back_and_holds_and_a_brake_stops_it_where_it_is() {
    let mut bench = eroding(|_| {});
    let um = bench.um();
    bench.command(Command::Jump);
    bench.run(0.02);
    bench.command(Command::Hold);
    bench.run(0.3);
    assert_eq!(bench.state(), State::HoldingPosition);
    assert!((um - bench.um() - 100.0).abs() < 10.0);
    // The path is still there.
    bench.command(Command::Start);
    bench.run_until(1.0, |bench| bench.state() == State::Eroding);
    bench.run(0.5);
    bench.command(Command::Jump);
    bench.run(0.02);
    let braked = bench.um();
    bench.command(Command::Brake(MicrometresPerSecond2(1e6)));
    bench.run(0.1);
    assert_eq!((bench.state(), bench.fault()), (State::Ready, None));
    assert!((bench.um() - braked).abs() < 300.0, "{braked} to {}", bench.um());
}

#[test]
fn in_a_path_beside_the_head_x_and_y_stay_but_for_the_float_distance() {
    let mut bench = Bench::with(small);
    bench.make_ready();
    let line =
        |down: i64, x: i64| Piece { shape: Shape::Line, to: [down, x, 0], centre: [0; 2], mark: false, stop: false };
    bench.command(Command::AppendTo(line(2_000_000, 0)));
    bench.command(Command::AppendTo(line(2_000_000, 3_000_000)));
    bench.follows = None;
    bench.surface_um = 1990.0;
    bench.command(Command::Start);
    bench.run_until(10.0, |bench| bench.state() == State::Eroding);
    bench.surface_um = 2100.0;
    bench.run_until(10.0, |bench| bench.head.status().beside[0].to_f32() > 500.0);
    let x = bench.head.status().beside[0].to_f32();
    bench.command(Command::Jump);
    bench.run_until(0.5, |bench| bench.state() == State::Eroding);
    let float = bench.head.status().beside[0].to_f32();
    assert!((x - float - 100.0).abs() < 10.0, "{x} to {float} um");
    assert!((bench.um() - 2000.0).abs() < 15.0, "{} um", bench.um());
}

#[test]
fn a_long_retreat_returns_at_speed_to_the_float_point() {
    let mut bench = eroding(|settings| settings.retreat_clearance = 800.0);
    let um = bench.um();
    let surface = bench.surface_um;
    bench.surface_um = um - 1.0;
    bench.run_until(0.5, |bench| bench.state() == State::Retreating);
    bench.surface_um = surface;
    bench.run_until(0.5, |bench| bench.state() == State::Eroding);
    assert!(um - bench.um() > 700.0);
    let mut ticks = 0;
    bench.run_until(2.0, |bench| {
        ticks += 1;
        um - bench.um() < 130.0
    });
    // 0.7 mm: 140 ms at 5 mm/s, 2.3 s at 0.3 mm/s.
    assert!(ticks < 20 * 200, "{ticks} ticks");
    bench.run(0.1);
    // The rest is the law's.
    assert!(um - bench.um() > 60.0, "{} of {um} um", bench.um());
}

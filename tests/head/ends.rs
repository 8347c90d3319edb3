//! Ends of an erosion: spark-out, break-through, and the lift out of the work.

use crate::bench::{Bench, OPEN_V, SLOPE_V_UM};
use edm_servo_head::head::{Command, Reason, Refused, State, Structure};
use edm_servo_head::path::{Piece, Shape};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::Nanometres;

const END_UM: f64 = 2200.0;

/// Eroding toward the end of the path, 0.2 mm into the work, which goes with the head.
fn near_the_end(change: impl FnOnce(&mut Settings)) -> Bench {
    let mut bench = Bench::with(|settings| {
        settings.end_discharge = 5.0;
        settings.end_window_ms = 100.0;
        change(settings);
    });
    bench.make_ready();
    bench.command(Command::MoveTo(Nanometres((END_UM * 1e3) as i64)));
    bench.command(Command::Start);
    bench.run_until(10.0, |bench| bench.state() == State::Eroding);
    // One pulse in ten ignites at the end.
    bench.surface_um = END_UM + 45.0;
    bench.changes();
    bench
}

/// Seconds until a state, of ten.
fn until(bench: &mut Bench, state: State) -> f64 {
    let mut ticks = 0;
    bench.run_until(10.0, |bench| {
        ticks += 1;
        bench.state() == state
    });
    assert_eq!(bench.state(), state, "{:?}", bench.head.status());
    f64::from(ticks) / 20_000.0
}

fn reasons(bench: &mut Bench) -> Vec<Reason> {
    bench.changes().iter().map(|change| change.reason).collect()
}

#[test]
fn as_set_at_first_the_end_of_the_path_is_the_end_and_the_head_stays() {
    let mut bench = near_the_end(|_| {});
    until(&mut bench, State::Done);
    bench.run(0.5);
    assert!((bench.um() - END_UM).abs() <= 2.0, "{}", bench.um());
    assert_eq!(reasons(&mut bench), [Reason::PathEnd]);
}

#[test]
fn a_spark_out_goes_on_with_pulses_until_its_time_is_over_where_discharges_do() {
    let mut bench = near_the_end(|settings| settings.end_spark_out_ms = 800.0);
    bench.run_until(10.0, |bench| (bench.um() - END_UM).abs() < 1.0);
    let took = until(&mut bench, State::Done);
    assert!((0.75..0.95).contains(&took), "{took} s");
    assert_eq!(reasons(&mut bench), [Reason::SparkOutTime]);
}

#[test]
fn a_spark_out_is_over_when_discharges_are_rare_and_not_a_look_before() {
    let mut bench = near_the_end(|settings| settings.end_spark_out_ms = 5000.0);
    bench.run_until(10.0, |bench| (bench.um() - END_UM).abs() < 1.0);
    bench.run(1.0);
    assert_eq!(bench.state(), State::Eroding);
    assert!(bench.output.pulses);
    // What is left of the work goes.
    bench.surface_um = END_UM + OPEN_V / SLOPE_V_UM + 20.0;
    let took = until(&mut bench, State::Done);
    assert!((0.1..0.35).contains(&took), "{took} s");
    assert_eq!(reasons(&mut bench), [Reason::SparkedOut]);
    assert!((bench.um() - END_UM).abs() <= 2.0, "{}", bench.um());
}

#[test]
fn work_that_is_gone_is_a_break_through_where_it_is_looked_for_and_only_there() {
    for (through, found) in [(0.0, false), (50.0, true), (5000.0, false)] {
        let mut bench = Bench::with(|settings| {
            (settings.end_through, settings.end_window_ms, settings.end_lift) = (through, 100.0, 500.0);
        });
        bench.make_ready();
        bench.erode();
        bench.follows = None;
        let um = bench.um();
        for removed in [60.0, 80.0, 100.0, 120.0] {
            bench.surface_um = um + removed;
            bench.run(0.5);
        }
        assert_eq!(bench.state(), State::Eroding);
        assert!(bench.um() > um + 80.0);
        bench.surface_um = 1e6;
        bench.changes();
        bench.run(2.0);
        if found {
            assert_eq!(reasons(&mut bench), [Reason::BrokenThrough, Reason::Lifted]);
            assert_eq!(bench.state(), State::Done);
        } else {
            assert_eq!((bench.state(), reasons(&mut bench)), (State::Eroding, vec![]));
        }
    }
}

#[test]
fn the_way_back_over_a_long_retreat_is_no_break_through() {
    let mut bench = Bench::with(|settings| {
        (settings.end_through, settings.end_window_ms) = (10.0, 50.0);
        (settings.retreat_clearance, settings.jump_float) = (800.0, 400.0);
    });
    bench.make_ready();
    bench.erode();
    let (um, surface) = (bench.um(), bench.surface_um);
    bench.surface_um = um - 1.0;
    bench.run_until(0.5, |bench| bench.state() == State::Retreating);
    bench.follows = None;
    bench.surface_um = surface.max(um + 20.0);
    bench.run_until(0.5, |bench| bench.state() == State::Eroding);
    bench.changes();
    // 0.4 mm at 0.3 mm/s, with every pulse open.
    bench.run(1.0);
    assert!(um - bench.um() > 50.0 && bench.head.status().gap.filtered.0 > 0.99 * OPEN_V as f32);
    bench.run(2.0);
    assert_eq!((bench.state(), reasons(&mut bench)), (State::Eroding, vec![]));
}

#[test]
fn the_lift_goes_back_along_the_path_without_pulses_and_the_hole_can_be_gone_on_with() {
    // Farther than a working retreat may go.
    let mut bench = near_the_end(|settings| (settings.end_lift, settings.retreat_limit) = (1500.0, 100.0));
    until(&mut bench, State::Lifting);
    assert!(!bench.head.in_force().state.pulses() && !bench.output.pulses);
    assert_eq!(bench.head.command(Command::Start), Err(Refused::State(State::Lifting)));
    let more = Command::MoveBy(Nanometres(50_000));
    assert_eq!(bench.head.command(more), Err(Refused::State(State::Lifting)));
    until(&mut bench, State::Done);
    bench.run(0.1);
    assert!((END_UM - 1500.0 - bench.um()).abs() < 10.0, "{}", bench.um());
    assert_eq!(reasons(&mut bench), [Reason::PathEnd, Reason::Lifted]);
    bench.command(more);
    bench.command(Command::Start);
    bench.surface_um = END_UM + 95.0;
    until(&mut bench, State::Lifting);
    assert!((bench.um() - END_UM - 50.0).abs() <= 2.0, "{}", bench.um());
}

#[test]
fn a_lift_ends_where_nothing_is_left_to_go_back_along_and_a_hold_stops_it() {
    let mut bench = near_the_end(|settings| settings.end_lift = 50_000.0);
    until(&mut bench, State::Done);
    bench.run(0.1);
    assert!(bench.um().abs() < 10.0, "{}", bench.um());
    assert_eq!(bench.fault(), None);
    let mut bench = near_the_end(|settings| settings.end_lift = 1500.0);
    until(&mut bench, State::Lifting);
    bench.run(0.1);
    bench.command(Command::Hold);
    bench.run(0.1);
    let um = bench.um();
    bench.run(0.2);
    assert_eq!(bench.state(), State::HoldingPosition);
    assert!((bench.um() - um).abs() < 2.0 && um > END_UM - 1000.0);
}

/// A way to here, nm, with a stop at its end or none.
fn piece(to: i64, stop: bool) -> Command {
    Command::AppendTo(Piece { shape: Shape::Line, to: [to, 0, 0], centre: [0; 2], mark: false, stop })
}

#[test]
fn an_erosion_ends_at_a_stop_on_the_path_and_the_next_start_goes_on_from_there() {
    for (lift, spark_out, reason) in [
        (0.0, 0.0, Reason::PathStop),
        (500.0, 0.0, Reason::PathStop),
        (0.0, 300.0, Reason::SparkOutTime),
        (500.0, 300.0, Reason::SparkOutTime),
    ] {
        let what = format!("{lift} um, {spark_out} ms");
        let mut bench = Bench::with(|settings| (settings.end_lift, settings.end_spark_out_ms) = (lift, spark_out));
        bench.make_ready();
        bench.command(piece(2_050_000, true));
        bench.command(piece(2_100_000, true));
        bench.command(piece(2_150_000, false));
        for (end, reason) in [(2050.0, reason), (2100.0, reason), (2150.0, reason)] {
            let last = end == 2150.0 && reason == Reason::PathStop;
            let reason = if last { Reason::PathEnd } else { reason };
            bench.changes();
            bench.command(Command::Start);
            bench.run_until(10.0, |bench| bench.state() == State::Eroding);
            bench.surface_um = end + 40.0;
            let mut deepest = 0.0f64;
            bench.run_until(10.0, |bench| {
                deepest = deepest.max(bench.um());
                bench.state() == State::Done
            });
            let seen = reasons(&mut bench);
            assert!(seen.contains(&reason), "{what}, {end}: {seen:?}");
            assert!((deepest - end).abs() <= 2.0, "{what}: {deepest} for {end}");
            bench.run(0.2);
            assert!((bench.um() - (end - f64::from(lift))).abs() < 10.0, "{what}: {}", bench.um());
            assert!(!bench.output.pulses, "{what}");
        }
        let again = bench.head.command(Command::Start);
        assert_eq!(again, if lift > 0.0 { Ok(()) } else { Err(Refused::NoPath) }, "{what}");
    }
}

#[test]
fn a_head_that_is_held_at_a_stop_goes_on_behind_it() {
    let mut bench = Bench::with(|settings| settings.end_spark_out_ms = 5000.0);
    bench.make_ready();
    bench.command(piece(2_050_000, true));
    bench.command(piece(2_100_000, false));
    bench.command(Command::Start);
    bench.run_until(10.0, |bench| bench.state() == State::Eroding);
    bench.surface_um = 2140.0;
    bench.run_until(10.0, |bench| (bench.um() - 2050.0).abs() < 1.0);
    bench.run(1.0);
    assert!((bench.um() - 2050.0).abs() < 2.0, "{}", bench.um());
    bench.command(Command::Hold);
    bench.run(0.1);
    assert_eq!(bench.state(), State::HoldingPosition);
    bench.command(Command::Start);
    bench.run_until(10.0, |bench| (bench.um() - 2100.0).abs() < 1.0);
    assert!((bench.um() - 2100.0).abs() < 1.0, "{}", bench.um());
}

#[test]
fn a_cascade_without_a_position_loop_ends_with_a_lift_too() {
    for structure in [Structure::VelocityCascade, Structure::Path] {
        let mut bench = Bench::with(|settings| (settings.structure, settings.end_lift) = (structure, 500.0));
        bench.make_ready();
        bench.command(Command::MoveTo(Nanometres(2_050_000)));
        bench.command(Command::Start);
        bench.run_until(10.0, |bench| bench.state() == State::Eroding);
        bench.follows = None;
        bench.surface_um = 2095.0;
        until(&mut bench, State::Lifting);
        until(&mut bench, State::Done);
        bench.run(0.1);
        assert!((bench.um() - 1550.0).abs() < 20.0, "{structure:?}: {}", bench.um());
        assert_eq!(bench.fault(), None);
    }
}

#[test]
fn a_path_that_meets_no_work_ends_with_the_lift_as_well() {
    let mut bench = Bench::with(|settings| settings.end_lift = 300.0);
    bench.make_ready();
    bench.surface_um = 1e6;
    bench.changes();
    bench.command(Command::MoveTo(Nanometres(500_000)));
    bench.command(Command::Start);
    until(&mut bench, State::Done);
    assert_eq!(reasons(&mut bench), [Reason::Started, Reason::PathEnd, Reason::Lifted]);
}

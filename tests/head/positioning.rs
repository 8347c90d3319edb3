//! Axis positioning on the bench: profiles, set points, homing.

use crate::bench::Bench;
use edm_servo_head::head::{Command, Fault, Home, HomingState, MotionLimits, Reason, Refused, State};
use edm_servo_head::motion::{Method, Missed};
use edm_servo_head::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres, TICK_HZ};

const LIMITS: MotionLimits = MotionLimits {
    velocity: MicrometresPerSecond(20_000.0),
    acceleration: MicrometresPerSecond2(1e6),
    deceleration: MicrometresPerSecond2(1e6),
};

fn um(um: i64) -> Nanometres {
    Nanometres(um * 1000)
}

fn home(method: Method, at_um: i64) -> Command {
    Command::Home(Home {
        method,
        fast: MicrometresPerSecond(10_000.0),
        slow: MicrometresPerSecond(1_000.0),
        acceleration: MicrometresPerSecond2(1e6),
        at: um(at_um),
    })
}

#[test]
fn a_move_keeps_its_velocity_and_ends_on_its_count() {
    let mut bench = Bench::cleared();
    bench.changes();
    bench.command(Command::Position(um(1500), LIMITS));
    let mut fastest = 0.0f64;
    bench.run_until(0.2, |bench| {
        fastest = fastest.max(bench.v);
        bench.state() == State::Ready
    });
    assert!((0.0195..0.0225).contains(&fastest), "{fastest} m/s");
    bench.run(0.05);
    assert_eq!(bench.um().floor(), 1500.0);
    let reasons: Vec<Reason> = bench.changes().iter().map(|change| change.reason).collect();
    assert_eq!(reasons, [Reason::Positioned, Reason::Arrived]);
}

#[test]
fn a_target_may_change_on_the_way() {
    let mut bench = Bench::cleared();
    bench.command(Command::Position(um(5000), LIMITS));
    bench.run(0.1);
    bench.command(Command::Position(um(500), LIMITS));
    bench.run_until(1.0, |bench| bench.state() == State::Ready);
    bench.run(0.05);
    assert_eq!(bench.um().floor(), 500.0);
}

/// The demanded velocity, um/s, and the greatest change of it from one tick to the next while running for `seconds`.
fn demand(bench: &mut Bench, seconds: f64) -> (f32, f32) {
    let mut before = bench.head.status().feed.0;
    let mut hardest = 0.0f32;
    for _ in 0..(seconds * f64::from(TICK_HZ)) as u32 {
        bench.run(1.0 / f64::from(TICK_HZ));
        let now = bench.head.status().feed.0;
        hardest = hardest.max((now - before).abs());
        before = now;
    }
    (before, hardest)
}

#[test]
fn a_move_begins_with_the_velocity_that_the_one_before_has() {
    let mut bench = Bench::cleared();
    bench.command(Command::Position(um(5000), LIMITS));
    let (mut before, _) = demand(&mut bench, 0.1);
    assert_eq!(before, 20_000.0);
    // The head's own acceleration brakes a hold: 5 m/s^2.
    for (command, acceleration) in [
        (Command::Position(um(500), LIMITS), -1e6),
        (Command::Brake(LIMITS.deceleration), -1e6),
        (Command::Position(um(5000), LIMITS), 1e6),
        (Command::Hold, -5e6),
        (Command::Position(um(5000), LIMITS), 1e6),
        (Command::Position(um(1000), LIMITS), -1e6f32),
    ] {
        bench.command(command);
        let (now, hardest) = demand(&mut bench, 0.001);
        // A plan lasts 0.25 ms at the most, and 1 ms ends up to one plan after the newest.
        assert!(hardest <= acceleration.abs() * 0.25e-3 * 1.001, "{hardest} um/s after {command:?}");
        let share = (now - before) / (acceleration * 1e-3);
        assert!((0.7..1.01).contains(&share), "{before} to {now} um/s after {command:?}");
        before = now;
    }
    assert!(demand(&mut bench, 0.8).1 <= 250.3);
    assert_eq!((bench.um().floor(), bench.state()), (1000.0, State::Ready));
}

#[test]
fn hold_brings_a_move_to_rest_on_a_ramp() {
    let mut bench = Bench::ready();
    bench.command(Command::Position(um(5000), LIMITS));
    bench.run(0.1);
    bench.command(Command::Hold);
    bench.run(0.0005);
    assert_eq!(bench.state(), State::Positioning);
    bench.run_until(0.5, |bench| bench.state() == State::Ready);
    assert_eq!(bench.head.status().feed.0, 0.0);
}

#[test]
fn set_points_of_a_host_are_followed_to_the_count() {
    let mut bench = Bench::cleared();
    let mut worst = 0.0f32;
    // 10 mm/s, a set point each millisecond.
    for ms in 1..=300i64 {
        bench.command(Command::Follow(um(ms * 10), 20));
        bench.run(0.001);
        if ms > 100 {
            worst = worst.max(bench.head.status().following.abs());
        }
    }
    assert!(worst < 10.0, "{worst} counts behind");
    bench.run(0.05);
    assert!((bench.um() - 3000.5).abs() < 1.5, "{}", bench.um());
    assert_eq!(bench.state(), State::Positioning);
    bench.command(Command::Brake(MicrometresPerSecond2(1e6)));
    bench.run(0.001);
    assert_eq!(bench.state(), State::Ready);
}

#[test]
fn braking_ends_a_move_within_the_length_it_needs() {
    let mut bench = Bench::cleared();
    bench.command(Command::Position(um(5000), LIMITS));
    bench.run(0.1);
    let before = bench.um();
    bench.command(Command::Brake(MicrometresPerSecond2(2e6)));
    bench.run_until(0.1, |bench| bench.state() == State::Ready);
    bench.run(0.05);
    // 20 mm/s at 2 m/s^2: 100 um.
    let length = bench.um() - before;
    assert!((80.0..125.0).contains(&length), "{length} um");
}

#[test]
fn only_a_head_that_holds_its_position_can_be_moved_beside_the_path() {
    let mut bench = Bench::new();
    bench.run(0.01);
    let refused = bench.head.command(Command::Position(um(1), LIMITS));
    assert_eq!(refused, Err(Refused::State(State::Disabled)));
    let mut bench = Bench::eroding();
    let refused = bench.head.command(Command::Position(um(1), LIMITS));
    assert_eq!(refused, Err(Refused::State(State::Eroding)));
    let mut bench = Bench::ready();
    let refused = bench.head.command(Command::Position(um(12_001), LIMITS));
    assert!(matches!(refused, Err(Refused::OutOfTravel { .. })));
    bench.command(Command::Position(um(12_000), LIMITS));
    assert_eq!(bench.head.command(Command::MoveTo(um(100))), Err(Refused::State(State::Positioning)));
}

#[test]
fn eroding_begins_where_a_move_has_ended() {
    let mut bench = Bench::ready();
    bench.command(Command::Position(um(1900), LIMITS));
    bench.run_until(1.0, |bench| bench.state() == State::Ready);
    bench.erode();
}

#[test]
fn a_fault_on_the_way_leads_back_from_where_the_head_is() {
    let mut bench = Bench::cleared();
    bench.command(Command::Position(um(8000), LIMITS));
    bench.run_until(1.0, |bench| bench.um() > 5000.0);
    bench.head.raise(Fault::HostSilent);
    let mut lowest = f64::INFINITY;
    bench.run_until(2.0, |bench| {
        lowest = lowest.min(bench.um());
        bench.head.status().tick % TICK_HZ == 0
    });
    // The safe height is 1 mm above.
    assert!((lowest - 4000.0).abs() < 60.0, "{lowest}");
}

#[test]
fn homing_on_a_limit_switch_is_no_fault_and_sets_its_position() {
    let mut bench = Bench::new();
    bench.x = 0.003;
    bench.run(0.05);
    bench.command(Command::Enable);
    bench.command(home(Method::UpperLimit, 100));
    let mut opened = false;
    for _ in 0..4 * TICK_HZ {
        bench.safety.upper_limit = bench.um() < 200.0;
        opened |= bench.safety.upper_limit;
        bench.tick();
        assert_eq!(bench.fault(), None);
        if bench.head.status().homing != HomingState::Runs {
            break;
        }
    }
    assert!(opened);
    assert_eq!(bench.head.status().homing, HomingState::Done);
    assert!(bench.head.status().homed);
    bench.run(0.05);
    // The edge at 200 um is position 100.
    let position = bench.head.status().position as f64;
    assert!((bench.um() - 200.0 - (position - 100.0)).abs() < 2.5, "{} um reads {position}", bench.um());
    assert_eq!(bench.state(), State::Ready);
}

#[test]
fn homing_where_the_head_stands() {
    let mut bench = Bench::new();
    bench.x = 0.003;
    bench.run(0.05);
    bench.command(Command::Enable);
    bench.command(home(Method::Here, 2000));
    bench.run(0.05);
    assert_eq!(bench.head.status().position, 2000);
    assert_eq!(bench.head.status().homing, HomingState::Done);
    assert!((bench.um() - 3000.0).abs() < 1.5);
}

#[test]
fn homing_against_a_stop_without_a_switch_is_a_homing_error_and_goes_back() {
    for (fast, from) in [(1000.0, 0.000_3), (10_000.0, 0.002), (50_000.0, 0.002)] {
        let mut bench = Bench::new();
        bench.x = from;
        bench.run(0.05);
        bench.command(Command::Enable);
        bench.run(0.01);
        let Command::Home(way) = home(Method::UpperLimit, 100) else { unreachable!() };
        bench.command(Command::Home(Home { fast: MicrometresPerSecond(fast), ..way }));
        bench.run_until(2.0, |bench| bench.head.status().homing != HomingState::Runs);
        let status = *bench.head.status();
        assert_eq!((status.homing, status.homed), (HomingState::Failed(Missed::Blocked), false), "{fast} um/s");
        bench.run(0.05);
        // Half a millisecond off the stop, or where it has begun.
        assert_eq!((bench.state(), bench.fault()), (State::Ready, None), "{fast} um/s");
        assert!((bench.um() - (from * 1e6).min(500.0)).abs() < 12.0, "{fast} um/s: at rest at {} um", bench.um());
        // It is as good as before.
        bench.command(Command::Position(um(1500), LIMITS));
        bench.run_until(2.0, |bench| bench.state() == State::Ready);
    }
}

#[test]
fn an_encoder_that_dies_while_a_reference_is_looked_for_is_lost_all_the_same() {
    for (method, slow) in [(Method::UpperLimit, 1000.0), (Method::MarkBelow, 1000.0), (Method::MarkBelow, 10_000.0)] {
        let mut bench = Bench::new();
        (bench.x, bench.surface_um) = (0.006, 1e6);
        bench.run(0.4);
        bench.command(Command::Enable);
        bench.run(0.01);
        let Command::Home(way) = home(method, 100) else { unreachable!() };
        bench.command(Command::Home(Home { slow: MicrometresPerSecond(slow), ..way }));
        bench.run(0.1);
        bench.encoder_dead = true;
        let died = bench.um();
        let mut farthest = 0.0f64;
        bench.run_until(0.5, |bench| {
            farthest = farthest.max(bench.um() - died);
            bench.fault() == Some(Fault::EncoderLost)
        });
        assert!(farthest < 500.0, "{method:?}: {farthest} um toward the work");
    }
}

#[test]
fn homing_that_finds_nothing_fails_and_holds() {
    let mut bench = Bench::new();
    bench.stroke_m = 0.05;
    bench.x = 0.045;
    bench.run(0.05);
    bench.command(Command::Enable);
    bench.command(home(Method::UpperLimit, 0));
    bench.run_until(5.0, |bench| bench.state() == State::Ready);
    assert_eq!(bench.head.status().homing, HomingState::Failed(Missed::NotThere));
    assert!(!bench.head.status().homed);
    // A stroke and a fifth, 14.4 mm, and the way to stop.
    assert!((bench.um() - (45_000.0 - 14_400.0)).abs() < 100.0, "{}", bench.um());
}

#[test]
fn a_limit_switch_while_positioning_is_still_a_fault() {
    let mut bench = Bench::cleared();
    bench.command(Command::Position(um(8000), LIMITS));
    bench.run_until(1.0, |bench| bench.um() > 5000.0);
    bench.safety.lower_limit = true;
    bench.run(0.001);
    assert_eq!(bench.fault(), Some(Fault::LowerLimit));
}

#[test]
fn gains_may_change_while_eroding_and_the_plant_may_not() {
    let mut bench = Bench::eroding();
    let before = bench.um();
    let mut settings = bench.settings;
    settings.servo_velocity_hz = 120.0;
    settings.axis_duty_limit = 0.8;
    bench.head.configure(settings.build().unwrap().head).unwrap();
    bench.run(0.2);
    assert!((bench.um() - before).abs() < 3.0, "moved {} um", bench.um() - before);
    settings.axis_mass = 0.3;
    assert_eq!(bench.head.configure(settings.build().unwrap().head), Err(Refused::State(State::Eroding)));
}

#[test]
fn homing_is_refused_while_eroding_and_while_a_path_waits() {
    let home = |bench: &mut Bench| {
        let velocity = MicrometresPerSecond(1000.0);
        let acceleration = MicrometresPerSecond2(1e6);
        let home = Home { method: Method::Here, fast: velocity, slow: velocity, acceleration, at: Nanometres(0) };
        bench.head.command(Command::Home(home))
    };
    let mut bench = Bench::eroding();
    let at = bench.head.status().position;
    assert_eq!(home(&mut bench), Err(Refused::State(State::Eroding)));
    bench.command(Command::Hold);
    bench.run(0.1);
    assert_eq!(home(&mut bench), Err(Refused::PathActive));
    assert!((bench.head.status().position - at).abs() < 100);
    bench.command(Command::ClearPath);
    assert_eq!(home(&mut bench), Ok(()));
    bench.run_until(0.1, |bench| bench.state() == State::Ready);
    assert!(bench.head.status().position.abs() < 5);
}

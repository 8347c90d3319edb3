//! What is easily right for one sign, one end or one side of a bound only: here it is both of each.

use crate::bench::Bench;
use edm_servo_head::feed::Limiter;
use edm_servo_head::head::{Command, Fault, Home, HomingState, MotionLimits, Reason, Refused, State, Structure};
use edm_servo_head::motion::{Method, Missed};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{Micrometres, MicrometresPerSecond, MicrometresPerSecond2, Nanometres, PLAN_TICKS, TICK_S};

fn um(um: i64) -> Nanometres {
    Nanometres(um * 1000)
}

fn at(mm_s: f32) -> MotionLimits {
    let acceleration = MicrometresPerSecond2(5e6);
    MotionLimits { velocity: MicrometresPerSecond(mm_s * 1000.0), acceleration, deceleration: acceleration }
}

/// Enabled with `change`, at home in the middle of a long stroke far above the work. The encoder counts `counted` of what it
/// should.
fn in_the_middle(counted: f64, change: impl FnOnce(&mut Settings)) -> Bench {
    let mut bench = Bench::with(|settings| {
        settings.axis_stroke = 50_000.0;
        change(settings);
    });
    (bench.stroke_m, bench.surface_um, bench.encoder_sign) = (0.05, 1e6, counted);
    bench.put(0.025);
    bench.command(Command::Enable);
    bench.command(Command::SetHome(um(25_000)));
    bench.run(0.01);
    bench
}

/// Where it has been before, the head need not go slowly: so much further down.
fn clear(bench: &mut Bench, counts: i64) {
    let here = bench.head.status().position;
    for to in [here + counts, here] {
        bench.command(Command::Position(um(to), at(5.0)));
        bench.run_until(3.0, |bench| bench.state() == State::Ready);
        bench.run(0.1);
    }
    bench.changes();
}

#[test]
fn a_current_beyond_the_peak_is_too_much_either_way() {
    for reversed in [false, true] {
        for sign in [1.0, -1.0] {
            for (amps, found) in [(3.5, false), (4.0, true)] {
                let mut bench = Bench::with(|settings| settings.motor_reversed = reversed);
                bench.motor_sign = if reversed { -1.0 } else { 1.0 };
                bench.make_ready();
                bench.extra_amps = sign * amps;
                bench.run(0.004);
                // 3.75 A for 2 ms.
                let fault = found.then_some(Fault::OverCurrent);
                assert_eq!(bench.fault(), fault, "{} A, motor reversed: {reversed}", bench.extra_amps);
            }
        }
    }
}

#[test]
fn an_encoder_that_counts_too_little_contradicts_the_back_emf_whichever_way_the_head_goes() {
    for way in [1, -1] {
        // It counts three in ten: at 15 mm/s the head goes 50, at 40 mm/s 133. 50 mm/s are forgiven, and a fifth of what the
        // current against its friction, 0.07 A of 12.4 ohm at 7.5 V/(m/s), amounts to: 24 mm/s.
        for (mm_s, found) in [(15.0, None), (40.0, Some(Fault::EncoderLost))] {
            let mut bench = in_the_middle(0.3, |_| {});
            clear(&mut bench, 5000);
            bench.command(Command::Position(um(25_000 + way * 5000), at(mm_s)));
            bench.run(0.1);
            assert_eq!(bench.fault(), found, "{mm_s} mm/s, {way}");
        }
    }
}

#[test]
fn an_open_upper_limit_is_not_run_into_along_the_path() {
    // The head was enabled on its switch, which is no fault: it is to leave it downward.
    let mut bench = Bench::new();
    bench.x = 0.003;
    bench.surface_um = 3060.0;
    bench.safety.upper_limit = true;
    bench.run(0.01);
    bench.command(Command::Enable);
    bench.run(0.01);
    bench.command(Command::MoveBy(um(500)));
    bench.command(Command::Start);
    bench.run_until(2.0, |bench| bench.state() == State::Eroding);
    bench.run(0.2);
    let before = bench.um();
    assert!(before > 3010.0, "it has not left downward: {before} um");
    // A wire across the gap: the head would retreat, and then retrace.
    bench.follows = Some(-1.0);
    let mut highest = before;
    let mut rise = |bench: &Bench| highest = highest.min(bench.um());
    bench.run_until(0.1, |bench| bench.state() == State::Retreating);
    bench.run_until(2.0, |bench| {
        rise(bench);
        bench.fault() == Some(Fault::PersistentShort)
    });
    for _ in 0..20_000 {
        bench.tick();
        rise(&bench);
    }
    assert!(highest > before - 3.0, "rose by {} um", before - highest);
    assert_eq!(bench.fault(), Some(Fault::PersistentShort));
}

#[test]
fn an_open_upper_limit_is_not_run_into_where_the_gap_gives_the_duty() {
    let mut bench = Bench::with(|settings| settings.structure = Structure::SingleLoop);
    bench.x = 0.003;
    bench.surface_um = 3060.0;
    bench.safety.upper_limit = true;
    bench.run(0.01);
    bench.command(Command::Enable);
    bench.run(0.01);
    bench.command(Command::MoveBy(um(500)));
    bench.command(Command::Start);
    bench.run_until(2.0, |bench| bench.state() == State::Eroding);
    bench.run(0.2);
    let before = bench.um();
    // A gap that stays too small wherever the head goes, but is no short.
    bench.follows = Some(14.0);
    bench.run(1.0);
    assert_eq!((bench.state(), bench.fault()), (State::Eroding, None));
    assert!(bench.um() > before - 3.0, "rose by {} um", before - bench.um());
}

#[test]
fn a_retract_with_limited_force_ends_where_the_upper_limit_opens() {
    let mut bench = in_the_middle(1.0, |settings| settings.retreat_velocity = 2000.0);
    bench.command(Command::MoveTo(um(30_000)));
    bench.head.raise(Fault::FollowingError);
    bench.run(0.2);
    let opened = bench.um();
    assert!(opened < 24_700.0, "it retracts: {opened} um");
    bench.safety.upper_limit = true;
    bench.run(0.5);
    // 2 mm/s at 5 m/s2 is less than a micrometre; the rest is the loop's own lag.
    assert!(bench.um() > opened - 20.0, "went on by {} um", opened - bench.um());
    assert_eq!(bench.fault(), Some(Fault::FollowingError), "which is the more urgent one");
}

#[test]
fn a_lower_limit_that_opens_while_a_retract_with_limited_force_runs_changes_nothing() {
    let mut bench = in_the_middle(1.0, |settings| settings.retreat_velocity = 2000.0);
    bench.command(Command::MoveTo(um(30_000)));
    let mut other = in_the_middle(1.0, |settings| settings.retreat_velocity = 2000.0);
    other.command(Command::MoveTo(um(30_000)));
    for head in [&mut bench, &mut other] {
        head.head.raise(Fault::FollowingError);
        head.run(0.2);
    }
    bench.safety.lower_limit = true;
    bench.run(2.0);
    other.run(2.0);
    assert!((bench.um() - other.um()).abs() < 5.0, "{} um, and {} um with the limit closed", bench.um(), other.um());
    assert_eq!(bench.fault(), Some(Fault::FollowingError));
}

#[test]
fn an_open_upper_limit_is_not_run_into_beside_the_path() {
    for follows in [false, true] {
        for (way, moves) in [(-1, false), (1, true)] {
            let mut bench = Bench::new();
            (bench.x, bench.surface_um) = (0.006, 1e6);
            bench.safety.upper_limit = true;
            bench.run(0.4);
            bench.command(Command::Enable);
            bench.command(Command::SetHome(um(6000)));
            bench.run(0.01);
            bench.changes();
            let to = um(6000 + way * 500);
            bench.command(if follows { Command::Follow(to, 2500) } else { Command::Position(to, at(4.5)) });
            bench.run(0.2);
            let moved = bench.um() - 6000.0;
            if moves {
                assert!((moved - 500.5).abs() < 2.0, "moved by {moved} um");
            } else {
                assert!(moved.abs() < 2.0, "moved by {moved} um");
                let reasons: Vec<_> = bench.changes().iter().map(|change| change.reason).collect();
                assert_eq!(reasons, [Reason::Positioned, Reason::Held]);
            }
            assert_eq!(bench.fault(), None);
        }
    }
}

/// Seeking, above the work, under a load that only the integrator holds; the duty that it takes.
fn loaded(newtons: f64) -> (Bench, f64) {
    let mut bench = Bench::with(|settings| (settings.axis_breakaway, settings.servo_friction) = (20.0, 0.0));
    bench.make_ready();
    bench.command(Command::MoveTo(um(4000)));
    bench.command(Command::Start);
    for step in 0..1000 {
        bench.push = newtons * f64::from(step) / 1000.0;
        bench.tick();
    }
    bench.run(0.04);
    assert_eq!(bench.state(), State::Seeking);
    let duty = bench.duty();
    (bench, duty)
}

#[test]
fn a_fault_takes_from_the_loop_what_it_had_integrated_in_its_own_tick() {
    let (mut bench, before) = loaded(3.0);
    // 3 N less friction are 9.3 % of the duty; the net weight is held by 0.8 %.
    assert!(before < -0.07, "{before}");
    bench.head.raise(Fault::PersistentArc);
    bench.tick();
    assert_eq!(bench.fault(), Some(Fault::PersistentArc));
    assert!(bench.duty().abs() < 0.02, "{before} became {}", bench.duty());
}

#[test]
fn a_fault_that_a_plan_finds_takes_from_the_loop_what_it_had_integrated() {
    let (mut bench, before) = loaded(3.0);
    assert!(before < -0.07, "{before}");
    // No open-circuit voltage.
    bench.surface_um = bench.um() + 30.0;
    bench.run_until(0.2, |bench| bench.fault() == Some(Fault::OpenCircuitLow));
    assert!(bench.duty().abs() < 0.02, "{before} became {}", bench.duty());
}

#[test]
fn a_retrace_goes_further_back_than_a_working_retreat_may() {
    for swapped in [false, true] {
        let mut bench = Bench::with(|settings| settings.retreat_limit = 100.0);
        bench.make_ready();
        bench.erode();
        bench.head.raise(Fault::HostSilent);
        if swapped {
            // Nor does another configuration bound the reaction under way.
            bench.run(0.01);
            bench.head.configure(bench.settings.build().unwrap().head).unwrap();
        }
        bench.run(1.0);
        // The work was found at 42.5 um of gap, the safe height is 1 mm above that.
        assert!((bench.um() - 957.5).abs() < 10.0, "held at {} um", bench.um());
        // And it is bounded again when the fault is over.
        bench.command(Command::ResetFault);
        bench.command(Command::Enable);
        bench.run(0.01);
        bench.erode();
        let before = bench.um();
        bench.follows = Some(-1.0);
        bench.run_until(0.1, |bench| bench.state() == State::Retreating);
        bench.run_until(0.3, |bench| bench.fault() == Some(Fault::PersistentShort));
        let gone = before - bench.um();
        assert!((90.0..110.0).contains(&gone), "{gone} um");
    }
}

#[test]
fn a_short_is_persistent_after_its_time_however_slow_the_retreat() {
    let mut bench = Bench::with(|settings| settings.retreat_velocity = 100.0);
    bench.make_ready();
    bench.erode();
    bench.follows = Some(-1.0);
    bench.run_until(0.1, |bench| bench.state() == State::Retreating);
    bench.run(0.995);
    assert_eq!(bench.state(), State::Retreating, "1 s is allowed");
    bench.run(0.01);
    assert_eq!(bench.fault(), Some(Fault::PersistentShort));
}

#[test]
fn a_short_is_persistent_where_the_retreat_ends_however_long_it_might_last() {
    let mut bench = Bench::with(|settings| settings.retreat_persistent_ms = 60_000.0);
    bench.make_ready();
    bench.erode();
    let before = bench.um();
    bench.follows = Some(-1.0);
    bench.run_until(0.1, |bench| bench.state() == State::Retreating);
    // 2 mm at 5 mm/s, but not beyond the beginning of the path.
    bench.run(0.35);
    assert_eq!(bench.state(), State::Retreating);
    // There a bridge has 100 ms to tear.
    bench.run(0.1);
    assert_eq!(bench.state(), State::Retreating);
    bench.run_until(0.1, |bench| bench.fault() == Some(Fault::PersistentShort));
    assert!(before - bench.um() > 1900.0, "{} um", before - bench.um());
}

#[test]
fn a_bridge_that_tears_where_the_retreat_ends_is_no_fault() {
    let mut bench = Bench::with(|settings| settings.retreat_limit = 100.0);
    bench.make_ready();
    bench.erode();
    for _ in 0..3 {
        bench.follows = Some(-1.0);
        bench.run_until(0.1, |bench| bench.state() == State::Retreating);
        bench.run(0.1);
        (bench.follows, bench.surface_um) = (None, bench.um() + 60.0);
        bench.run_until(1.0, |bench| bench.state() == State::Eroding);
    }
}

fn home(method: Method, at: Nanometres, slow: f32) -> Command {
    let fast = MicrometresPerSecond(70_000.0);
    let slow = MicrometresPerSecond(slow);
    Command::Home(Home { method, fast, slow, acceleration: MicrometresPerSecond2(1e6), at })
}

#[test]
fn no_place_outside_the_travel_is_made_a_home() {
    for (at, inside) in [(-1, false), (0, true), (12_000_000, true), (12_000_001, false)] {
        let at = Nanometres(at);
        for method in [Method::Here, Method::UpperLimit] {
            let mut bench = Bench::new();
            (bench.x, bench.surface_um) = (0.006, 1e6);
            bench.run(0.4);
            bench.command(Command::Enable);
            let refused = Refused::OutOfTravel { target: at, min: um(0), max: um(12_000) };
            let answer = bench.head.command(home(method, at, 1000.0));
            assert_eq!(answer, if inside { Ok(()) } else { Err(refused) });
            bench.run(0.01);
            assert!(inside || !bench.head.status().homed);
            assert_eq!(bench.state() == State::Homing, inside && method == Method::UpperLimit);
        }
    }
}

#[test]
fn a_home_that_would_put_the_axis_outside_its_travel_is_none() {
    // Off the switch at 50 mm/s and 1 m/s2 it comes to rest 1.25 mm behind the edge, where the travel is to have ended; at
    // 10 mm/s that is 50 um, which half a millimetre of margin forgives.
    for (method, at) in [(Method::UpperLimit, um(12_000)), (Method::LowerLimit, um(0))] {
        for (slow, found) in [(10_000.0, true), (50_000.0, false)] {
            let mut bench = Bench::new();
            (bench.x, bench.surface_um) = (0.006, 1e6);
            bench.run(0.4);
            bench.command(Command::Enable);
            bench.run(0.01);
            clear(&mut bench, 5000);
            bench.command(home(method, at, slow));
            for _ in 0..40_000 {
                bench.safety.upper_limit = bench.um() < 3000.0;
                bench.safety.lower_limit = bench.um() > 9000.0;
                bench.tick();
                if bench.head.status().homing != HomingState::Runs {
                    break;
                }
            }
            let status = bench.head.status();
            let homing = if found { HomingState::Done } else { HomingState::Failed(Missed::OutOfTravel) };
            assert_eq!((status.homing, status.homed), (homing, found), "{method:?} at {slow} um/s");
            assert_eq!(bench.fault(), None);
        }
    }
}

/// The hardest braking before an end that is `left` um away, as a share of the acceleration.
fn braking(way: f32, ticks: u32, mut left: f32) -> f32 {
    let acceleration = MicrometresPerSecond2(1e6);
    let most = acceleration.0 * TICK_S * ticks as f32;
    let mut limiter = Limiter::default();
    let (mut before, mut hardest) = (0.0f32, 0.0f32);
    for _ in 0..100_000 {
        let (near, far) = (|| Micrometres(left), || Micrometres(1e6));
        let wanted = MicrometresPerSecond(way * 1e5);
        let velocity = if way > 0.0 {
            limiter.limit(wanted, acceleration, ticks, near, far)
        } else {
            limiter.limit(wanted, acceleration, ticks, far, near)
        };
        let speed = velocity.0 * way;
        hardest = hardest.max((before - speed) / most);
        before = speed;
        left -= speed * ticks as f32 * TICK_S;
    }
    hardest
}

#[test]
fn before_either_end_of_the_path_the_head_brakes_no_harder_than_it_accelerates() {
    for way in [1.0, -1.0] {
        for ticks in [1, PLAN_TICKS] {
            for left in [1.0, 30.0, 3000.0] {
                let hardest = braking(way, ticks, left);
                assert!(hardest < 1.01, "{hardest} of the acceleration, {left} um, {ticks} ticks, {way}");
            }
        }
    }
}

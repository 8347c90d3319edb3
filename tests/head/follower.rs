//! The servo tick between two plans: what may still move the head once something urgent has come.

use edm_hal_shim::bridge::Drive;
use edm_servo_head::head::{
    Fault, Follow, Follower, Plan, Reaction, SetPoint, State, TickInput, TickOutput, Touch, Trajectory,
};
use edm_servo_head::servo::Window;
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{CountsPerSecond, Fixed, Nanometres};

const FULL: Window = Window { low: -1.0, high: 1.0 };

/// What follows a set point at this velocity, counts/s.
fn at(velocity: f32) -> Trajectory {
    let travel = Fixed::short(velocity / 20e3);
    Trajectory {
        follow: Follow::Setpoint,
        window: FULL,
        velocity: CountsPerSecond(velocity),
        travel,
        ..Trajectory::COAST
    }
}

/// A positioned head that follows set points of SYNC, rises at 3000 counts/s on a short and stops on a fault.
fn positioned() -> Plan {
    Plan {
        state: State::Positioning,
        closed: true,
        trajectory: at(1000.0),
        set_points: true,
        toward: CountsPerSecond(2000.0),
        slew: CountsPerSecond(f32::INFINITY),
        retreat: Some(at(-3000.0)),
        stop: at(0.0),
        limited: Window { low: -0.5, high: 0.0 },
        lift: Trajectory::duty(-0.1, FULL),
        ..Plan::DISABLED
    }
}

fn tick(follower: &mut Follower, input: &TickInput) -> TickOutput {
    follower.tick(input, |_| None)
}

/// A follower in whose newest tick this plan has come into force.
fn carries_out(plan: &Plan) -> Follower {
    let mut follower = Follower::new(Settings::default().build().unwrap().head.follow());
    while !follower.tick(&TickInput::default(), |_| Some(plan)).begins {}
    follower
}

/// A set point this far away, counts, to be reached in a millisecond, which a SYNC has released.
fn released(by: i64) -> TickInput {
    let point = SetPoint { to: Nanometres(by * 1000), counts: Fixed::whole(by), ticks: 20 };
    TickInput { set_point: Some(point), asked: true, ..TickInput::default() }
}

#[test]
fn a_set_point_of_a_sync_is_followed_in_its_tick_toward_the_work_no_faster_than_the_plan_allows() {
    for (by, slew, expected) in [
        (10_000, f32::INFINITY, 2000.0..=2000.0),
        (-10_000, f32::INFINITY, f32::NEG_INFINITY..=-100_000.0),
        (10_000, 300.0, 1300.0..=1300.0),
        (-10_000, 300.0, 700.0..=700.0),
    ] {
        let mut follower = carries_out(&Plan { slew: CountsPerSecond(slew), ..positioned() });
        tick(&mut follower, &released(by));
        let Trajectory { velocity, travel, .. } = *follower.trajectory();
        assert!(expected.contains(&velocity.0), "{by} counts, {slew}: {} counts/s", velocity.0);
        assert_eq!(travel, Fixed::short(velocity.0 / 20e3), "{by} counts, {slew}");
    }
}

#[test]
fn no_set_point_of_a_sync_moves_a_head_that_reacts_to_a_fault() {
    for fault in [Fault::HostSilent, Fault::FollowingError, Fault::EncoderLost, Fault::OverCurrent] {
        let reported = TickInput { reported: Some(fault), asked: true, ..TickInput::default() };
        for by in [-10_000, 10_000] {
            // In the tick after the fault, and in its own.
            let mut follower = carries_out(&positioned());
            tick(&mut follower, &reported);
            let reacts = *follower.trajectory();
            assert_ne!(reacts, at(1000.0), "{}", fault.name());
            tick(&mut follower, &released(by));
            assert_eq!(*follower.trajectory(), reacts, "{}, {by} counts", fault.name());
            let mut follower = carries_out(&positioned());
            tick(&mut follower, &TickInput { reported: Some(fault), ..released(by) });
            assert_eq!(*follower.trajectory(), reacts, "{}, {by} counts, at once", fault.name());
        }
    }
}

#[test]
fn no_set_point_of_a_sync_takes_a_head_back_from_its_retreat_or_from_the_place_that_it_touches() {
    let reflex = TickInput { reflex: true, ..TickInput::default() };
    let touches = TickInput { touches: true, ..TickInput::default() };
    let touching = Plan { touch: Touch::End, retreat: None, ..positioned() };
    for (plan, input, velocity) in [(positioned(), reflex, -3000.0), (touching, touches, 0.0)] {
        let mut follower = carries_out(&plan);
        tick(&mut follower, &input);
        assert_eq!(*follower.trajectory(), at(velocity));
        tick(&mut follower, &released(10_000));
        assert_eq!(*follower.trajectory(), at(velocity));
    }
}

#[test]
fn a_head_that_touches_stands_in_the_same_tick_whatever_was_ready_for_a_stop() {
    for (touch, reaction) in [(Touch::End, None), (Touch::Fault, Some(Reaction::RetractOffLimit))] {
        // What is positioned would go on to its end for two ticks.
        let mut follower = carries_out(&Plan { touch, stop: at(1000.0), retreat: None, ..positioned() });
        tick(&mut follower, &TickInput { touches: true, ..TickInput::default() });
        let Trajectory { velocity, travel, .. } = *follower.trajectory();
        assert_eq!((velocity.0, travel), (0.0, Fixed(0)), "{touch:?}");
        assert_eq!(follower.plan().reaction, reaction);
    }
}

#[test]
fn a_short_gives_no_drive_to_a_head_that_a_fault_has_let_go() {
    let mut follower = carries_out(&Plan { state: State::Eroding, pulses: true, ..positioned() });
    let reported = TickInput { reported: Some(Fault::OverCurrent), asked: true, ..TickInput::default() };
    let output = tick(&mut follower, &reported);
    assert_eq!((output.drive, output.pulses), (Drive::Coast, false));
    let output = tick(&mut follower, &TickInput { reflex: true, short_ticks: 1000, ..TickInput::default() });
    assert_eq!((output.drive, output.pulses), (Drive::Coast, false));
}

#[test]
fn with_an_encoder_in_doubt_a_fault_closes_no_loop() {
    for (doubted, fault, follow, closed) in [
        (false, Fault::HostSilent, Follow::Setpoint, true),
        (true, Fault::HostSilent, Follow::Duty, false),
        (false, Fault::EncoderLost, Follow::Duty, false),
        (false, Fault::OverCurrent, Follow::Nothing, false),
    ] {
        let mut follower = carries_out(&Plan { doubted, ..positioned() });
        tick(&mut follower, &TickInput { reported: Some(fault), asked: true, ..TickInput::default() });
        let Plan { trajectory, closed: now, .. } = *follower.plan();
        assert_eq!((trajectory.follow, now), (follow, closed), "{}, in doubt: {doubted}", fault.name());
    }
}

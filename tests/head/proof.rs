//! The proof of an encoder that a fault has cast doubt on, and second faults.

use crate::bench::{Bench, LIFT};
use edm_servo_head::head::{Command, Fault, Home, MotionLimits, Reason, Refused, State};
use edm_servo_head::motion::Method;
use edm_servo_head::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres};

/// Within this an encoder proves itself, or does not, s.
const PROOF_S: f64 = 0.1;

/// A head in the middle of its stroke after a fault whose reaction is over.
fn after(fault: Fault) -> Bench {
    let mut bench = Bench::new();
    bench.x = 0.006;
    bench.surface_um = 9000.0;
    bench.make_ready();
    bench.head.raise(fault);
    bench.run(1.0);
    bench.command(Command::ResetFault);
    bench.put(0.006);
    assert_eq!(bench.state(), State::Disabled);
    bench
}

fn proves(bench: &mut Bench) {
    bench.command(Command::Enable);
    assert_eq!(bench.state(), State::Proving);
    bench.run_until(PROOF_S, |bench| {
        assert!(!bench.output.pulses);
        bench.state() == State::Ready
    });
    bench.run(0.1);
}

fn fails(bench: &mut Bench, fault: Fault) {
    bench.command(Command::Enable);
    bench.run_until(PROOF_S, |bench| bench.state() == State::Fault);
    assert_eq!(bench.fault(), Some(fault));
}

#[test]
fn after_a_fault_that_doubts_the_encoder_it_proves_itself_by_a_small_move_upward() {
    for fault in [Fault::EncoderLost, Fault::PolarityWrong, Fault::FollowingError] {
        let mut bench = after(fault);
        bench.changes();
        let at = bench.um();
        proves(&mut bench);
        let rise = at - bench.um();
        assert!((15.0..100.0).contains(&rise), "{}: rose by {rise} um", fault.name());
        let reasons: Vec<_> = bench.changes().iter().map(|change| change.reason).collect();
        assert_eq!(reasons, [Reason::ProofStarted, Reason::Enabled]);
        // Once is enough.
        bench.command(Command::Disable);
        bench.command(Command::Enable);
        assert_eq!(bench.state(), State::Ready);
    }
}

#[test]
fn after_another_fault_the_head_does_not_move_when_it_is_enabled() {
    for fault in Fault::ALL.iter().filter(|fault| !fault.doubts_encoder()) {
        let mut bench = after(*fault);
        let at = bench.um();
        bench.command(Command::Enable);
        assert_eq!(bench.state(), State::Ready);
        bench.run(0.1);
        assert!((bench.um() - at).abs() < 3.0, "{}", fault.name());
    }
}

#[test]
fn a_dead_encoder_fails_and_the_head_has_hardly_moved_toward_the_work() {
    // The last one holds by its friction alone, and the lift does not lift it: not even then does it creep down for ever.
    for (um, push) in [(0.0, 0.0), (6000.0, 0.0), (6000.0, -0.3), (6000.0, 0.3)] {
        let mut bench = after(Fault::EncoderLost);
        bench.encoder_dead = true;
        bench.x = um * 1e-6;
        bench.push = push;
        let mut lowest = bench.um();
        for _ in 0..10 {
            bench.command(Command::Enable);
            for _ in 0..10_000 {
                bench.tick();
                lowest = lowest.max(bench.um());
            }
            assert_eq!(bench.fault(), Some(Fault::EncoderLost));
            bench.command(Command::ResetFault);
        }
        let most = if push > 0.0 { 2000.0 } else { 800.0 };
        assert!(lowest - um < most, "from {um} um down to {lowest} um under {push} N");
    }
}

#[test]
fn a_head_in_doubt_accepts_nothing_else() {
    let mut bench = after(Fault::EncoderLost);
    let doubted = Err(Refused::Doubted(Fault::EncoderLost));
    assert_eq!(bench.head.command(Command::SetHome(Nanometres(0))), doubted);
    let limits = MotionLimits {
        velocity: MicrometresPerSecond(1000.0),
        acceleration: MicrometresPerSecond2(1e6),
        deceleration: MicrometresPerSecond2(1e6),
    };
    let home = Home {
        method: Method::Here,
        fast: MicrometresPerSecond(1000.0),
        slow: MicrometresPerSecond(1000.0),
        acceleration: MicrometresPerSecond2(1e6),
        at: Nanometres(0),
    };
    let others = [
        Command::Start,
        Command::Guide,
        Command::Hold,
        Command::ClearPath,
        Command::MoveBy(Nanometres(1000)),
        Command::Position(Nanometres(0), limits),
        Command::Follow(Nanometres(0), 20),
        Command::Home(home),
        Command::Brake(MicrometresPerSecond2(1e6)),
    ];
    for state in [State::Disabled, State::Proving] {
        for command in others {
            assert_eq!(bench.head.command(command), Err(Refused::State(state)), "{command:?}");
        }
        if state == State::Disabled {
            bench.command(Command::Enable);
        }
    }
    // It can be stopped at any time, and has proved nothing then.
    bench.tick();
    bench.command(Command::Disable);
    bench.run(0.2);
    assert!(bench.coasts());
    assert_eq!(bench.head.command(Command::SetHome(Nanometres(0))), doubted);
}

#[test]
fn an_encoder_that_counts_the_wrong_way_is_a_wrong_polarity_and_the_head_coasts() {
    let mut bench = after(Fault::PolarityWrong);
    bench.motor_sign = -1.0;
    let at = bench.um();
    fails(&mut bench, Fault::PolarityWrong);
    bench.run(0.2);
    assert!(bench.coasts(), "a lift would go down");
    assert!(bench.um() - at < 100.0, "moved down by {} um", bench.um() - at);
}

#[test]
fn counters_that_do_not_agree_prove_nothing() {
    let mut bench = Bench::new();
    bench.watch_offset = Some(0);
    bench.make_ready();
    bench.x = 0.006;
    bench.run(0.001);
    bench.head.raise(Fault::EncoderLost);
    bench.run(1.0);
    bench.command(Command::ResetFault);
    bench.put(0.006);
    bench.command(Command::Enable);
    bench.run(0.002);
    bench.watch_offset = Some(2);
    bench.run_until(PROOF_S, |bench| bench.state() == State::Fault);
    assert_eq!(bench.fault(), Some(Fault::EncoderLost));
}

#[test]
fn a_head_at_its_upper_stop_or_on_its_upper_limit_proves_itself_downward() {
    for switch in [false, true] {
        let mut bench = after(Fault::FollowingError);
        bench.safety.upper_limit = switch;
        bench.put(0.0);
        proves(&mut bench);
        assert!((15.0..100.0).contains(&bench.um()), "at {} um", bench.um());
        assert_eq!(bench.state(), State::Ready);
    }
}

#[test]
fn the_commissioning_of_a_head_in_doubt_begins_with_the_proof() {
    let mut bench = after(Fault::PolarityWrong);
    bench.encoder_dead = true;
    bench.command(Command::Commission);
    assert_eq!(bench.state(), State::Proving);
    bench.run_until(PROOF_S, |bench| bench.state() == State::Fault);
    bench.run(1.0);
    bench.encoder_dead = false;
    bench.surface_um = 20_000.0;
    bench.command(Command::ResetFault);
    bench.put(0.0);
    bench.command(Command::Commission);
    bench.run_until(PROOF_S, |bench| bench.state() == State::Commissioning);
    bench.run_until(30.0, |bench| bench.state() == State::Disabled);
    assert!(
        bench.head.commissioning_result().is_some_and(|result| result.is_ok()),
        "{:?}",
        bench.head.commissioning_result()
    );
}

/// A head that holds at its safe height after a fault.
fn holding() -> Bench {
    let mut bench = Bench::new();
    bench.watch_offset = Some(0);
    bench.make_ready();
    bench.erode();
    bench.head.raise(Fault::HostSilent);
    bench.run(1.0);
    assert_eq!(bench.state(), State::Fault);
    bench
}

#[test]
fn an_encoder_that_is_lost_while_a_fault_holds_escalates_to_the_lift_and_both_are_named() {
    let mut bench = holding();
    bench.watch_offset = Some(2);
    bench.run(0.005);
    let status = *bench.head.status();
    assert_eq!((status.first, status.fault), (Some(Fault::HostSilent), Some(Fault::EncoderLost)));
    assert!((bench.duty() - LIFT).abs() < 0.0005, "weight plus 20 %, and friction: {}", bench.duty());
    assert!(!status.homed && !status.closed);
    bench.run(0.4);
    assert_eq!(bench.duty(), 0.0, "weight plus 10 % is less than the counterbalance, and the bridge brakes");
    bench.command(Command::ResetFault);
    assert_eq!((bench.head.status().first, bench.fault()), (None, None));
    bench.watch_offset = Some(0);
    bench.put(0.001);
    proves(&mut bench);
}

#[test]
fn a_following_error_while_a_fault_holds_becomes_a_force_limited_retract_and_then_a_lift() {
    let mut bench = holding();
    // Dragged down by more than the limited force can hold.
    bench.push = 3.4;
    bench.run_until(0.5, |bench| bench.fault() == Some(Fault::FollowingError));
    assert_eq!(bench.head.status().first, Some(Fault::HostSilent));
    assert!(bench.head.status().homed);
    bench.run(0.025);
    assert!((bench.duty() - LIFT).abs() < 0.0005, "{}", bench.duty());
    assert!(!bench.head.status().homed, "what is lifted without its counts has lost its home");
}

#[test]
fn a_head_that_is_pushed_up_while_a_fault_holds_gives_way_and_is_no_second_fault() {
    let mut bench = holding();
    bench.push = -1.0;
    bench.run(0.05);
    bench.push = 0.0;
    bench.run(0.5);
    assert_eq!(bench.fault(), Some(Fault::HostSilent));
    assert!(bench.duty() < 0.0085, "nothing pushes it back down: {}", bench.duty());
}

#[test]
fn a_current_beyond_the_peak_while_a_fault_holds_or_lifts_coasts() {
    for lifts in [false, true] {
        let mut bench = holding();
        if lifts {
            bench.head.raise(Fault::EncoderLost);
            bench.run(0.05);
        }
        bench.extra_amps = 4.0;
        bench.run(0.006);
        assert_eq!(bench.fault(), Some(Fault::OverCurrent));
        assert!(bench.coasts());
    }
}

#[test]
fn a_lift_that_goes_down_coasts() {
    let mut bench = holding();
    bench.x = 0.001;
    bench.run(0.001);
    bench.head.raise(Fault::EncoderLost);
    bench.motor_sign = -1.0;
    // The encoder counts all the same, and shows where the lift leads.
    bench.push = 1.5;
    bench.run_until(0.2, |bench| bench.fault() == Some(Fault::PolarityWrong));
    bench.run(0.001);
    assert!(bench.coasts());
}

#[test]
fn a_sagging_bus_while_a_fault_holds_lifts_on_what_is_left() {
    let mut bench = holding();
    bench.bus = 30.0;
    bench.run(0.003);
    assert_eq!(bench.fault(), Some(Fault::BusSag));
    assert!((bench.duty() - LIFT).abs() < 0.0005);
}

#[test]
fn a_reaction_presses_nothing_down_that_does_not_rise() {
    // The count stands still, a little above the setpoint: a loop that trusted it would press harder and harder.
    for um in [0.3, 0.7, 5.0, 50.0] {
        let mut bench = holding();
        bench.encoder_dead = true;
        bench.x -= um * 1e-6;
        for _ in 0..100_000 {
            bench.tick();
            assert!(bench.duty() < 0.0085, "{um} um: {}", bench.duty());
        }
    }
}

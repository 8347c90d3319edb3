//! Every row of the fault table: pulses off at once and latched, and the motion that the row promises.

use crate::bench::{Bench, LIFT};
use edm_servo_head::gap::Quality;
use edm_servo_head::head::{Command, Fault, LEAD, MotionLimits, Reaction, Refused, State};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres};

/// Runs until the head notices, at most `ms`, and checks that pulses are off from that tick on, for good.
fn expect(bench: &mut Bench, fault: Fault, ms: u32) {
    for tick in 0..=ms * 20 {
        bench.tick();
        if bench.fault().is_some() {
            assert_eq!(bench.fault(), Some(fault), "after {tick} ticks");
            assert_eq!(bench.state(), State::Fault);
            // Supervision speaks after the tick: the next one acts. What the planner finds comes into force with its plan.
            bench.tick();
            if matches!(fault, Fault::GapSignalInvalid | Fault::OpenCircuitLow | Fault::PersistentShort) {
                (1..LEAD).for_each(|_| bench.tick());
            }
            assert!(!bench.output.pulses);
            return;
        }
    }
    panic!("{} not noticed within {ms} ms: {:?}", fault.name(), bench.head.status());
}

fn stays_latched(bench: &mut Bench) {
    for _ in 0..20_000 {
        bench.tick();
        assert!(!bench.output.pulses);
        assert_eq!(bench.state(), State::Fault);
    }
}

/// The row "retrace along the path to the safe height, hold".
fn retraces(bench: &mut Bench) {
    // The work was found 2 mm down at 42.5 um of gap (85 V); the safe height is 1 mm above that.
    bench.run(1.0);
    let held = bench.um();
    assert!((held - (2000.0 - 42.5 - 1000.0)).abs() < 10.0, "held at {held} um");
    stays_latched(bench);
    assert!((bench.um() - held).abs() < 2.0);
}

#[test]
fn a_persistent_short_retraces() {
    let mut bench = Bench::eroding();
    // The short comes along: a wire across the gap.
    for _ in 0..40_000 {
        bench.surface_um = bench.um() - 1.0;
        bench.tick();
        if bench.fault().is_some() {
            break;
        }
    }
    assert_eq!(bench.fault(), Some(Fault::PersistentShort));
    let at = bench.um();
    bench.run(0.5);
    assert!(bench.um() <= at + 1.0);
    stays_latched(&mut bench);
}

#[test]
fn a_persistent_arc_retraces() {
    let mut bench = Bench::eroding();
    bench.arcs = 90;
    // Half of 19 arcs beyond 67 %, 4.6 a millisecond, takes 2 ms; the time that this may last is 50 ms.
    bench.run(0.05);
    assert_eq!(bench.state(), State::Eroding);
    expect(&mut bench, Fault::PersistentArc, 10);
    retraces(&mut bench);
}

#[test]
fn arcs_below_their_share_are_part_of_the_work() {
    let mut bench = Bench::eroding();
    bench.arcs = 58;
    bench.run(2.0);
    assert_eq!((bench.state(), bench.fault()), (State::Eroding, None));
}

#[test]
fn a_gap_signal_that_cannot_be_right_retraces() {
    for (quality, fault) in [
        (Quality::Missing, Fault::GapSignalInvalid),
        (Quality::Saturated, Fault::GapSignalInvalid),
        (Quality::Reversed, Fault::GapReversed),
        (Quality::Unclear, Fault::BurningUnclear),
    ] {
        let mut bench = Bench::eroding();
        bench.quality = quality;
        bench.run(0.019);
        assert_eq!(bench.state(), State::Eroding, "{quality:?} may last 20 ms");
        expect(&mut bench, fault, 3);
        retraces(&mut bench);
    }
}

#[test]
fn a_missing_gate_retraces() {
    let mut bench = Bench::eroding();
    bench.quality = Quality::NoGate;
    bench.run(0.019);
    assert_eq!(bench.state(), State::Eroding);
    expect(&mut bench, Fault::GateMissing, 3);
    retraces(&mut bench);
}

#[test]
fn a_low_open_circuit_voltage_is_named_before_anything_moves() {
    let mut bench = Bench::ready();
    bench.surface_um = bench.um() + 30.0;
    bench.command(Command::MoveTo(Nanometres(4_000_000)));
    bench.command(Command::Start);
    expect(&mut bench, Fault::OpenCircuitLow, 200);
    assert!(bench.um() < 1.0);
}

#[test]
fn a_dielectric_that_is_not_ok_retraces_and_refuses_the_start() {
    let mut bench = Bench::eroding();
    bench.safety.dielectric = true;
    expect(&mut bench, Fault::DielectricNotOk, 0);
    retraces(&mut bench);
    let refused = bench.head.command(Command::ResetFault);
    assert_eq!(refused, Err(Refused::StillFaulty(Fault::DielectricNotOk)));
}

#[test]
fn a_silent_host_retraces() {
    let mut bench = Bench::with(|settings| settings.host_ms = 500);
    bench.make_ready();
    bench.erode();
    bench.host_alive = false;
    bench.run(0.499);
    assert_eq!(bench.state(), State::Eroding);
    expect(&mut bench, Fault::HostSilent, 3);
    retraces(&mut bench);
}

#[test]
fn a_host_that_is_not_expected_may_be_silent() {
    let mut bench = Bench::with(|_| {});
    bench.make_ready();
    bench.host_alive = false;
    bench.run(2.0);
    assert_eq!(bench.state(), State::Ready);
}

#[test]
fn the_lower_limit_retracts_by_half_a_millimetre_and_holds() {
    let mut bench = Bench::eroding();
    let at = bench.um();
    bench.safety.lower_limit = true;
    expect(&mut bench, Fault::LowerLimit, 0);
    bench.run(0.05);
    bench.safety.lower_limit = false;
    bench.run(1.0);
    let gone = at - bench.um();
    assert!((499.0..520.0).contains(&gone), "{gone} um");
    stays_latched(&mut bench);
}

#[test]
fn a_retract_that_ends_at_the_top_of_the_travel_holds_there_with_no_more_than_the_limited_force() {
    let mut bench = Bench::ready();
    let ramp = MicrometresPerSecond2(1e6);
    let limits = MotionLimits { velocity: MicrometresPerSecond(5e3), acceleration: ramp, deceleration: ramp };
    bench.command(Command::Position(Nanometres(100_000), limits));
    bench.run_until(1.0, |bench| bench.state() == State::Ready);
    // Half a millimetre is not left.
    bench.head.raise(Fault::Contact);
    bench.run_until(1.0, |bench| bench.um() < 4.0);
    // What the stop holds the head back by is never made up for.
    bench.encoder_dead = true;
    bench.run(3.0);
    assert_eq!((bench.state(), bench.fault()), (State::Fault, Some(Fault::Contact)));
    let active = bench.settings.build().unwrap().head;
    let least = active.axis.gains.holding() - active.lift.limited;
    assert!(bench.duty() >= f64::from(least) - 1e-3, "{} after 3 s, limited to {least}", bench.duty());
    assert!(bench.duty() < f64::from(least) + 0.01, "what the test is about: it winds up, {}", bench.duty());
}

#[test]
fn the_upper_limit_decelerates_and_holds_and_never_goes_further_up() {
    let mut bench = Bench::eroding();
    // A retrace is under way when the switch opens.
    bench.head.raise(Fault::PersistentArc);
    bench.run(0.1);
    bench.safety.upper_limit = true;
    let at = bench.um();
    expect(&mut bench, Fault::UpperLimit, 0);
    bench.run(1.0);
    // v^2 / 2a at 5 mm/s and 5 m/s2 is 2.5 um, and the loop's own lag.
    assert!(at - bench.um() < 40.0, "went on by {} um", at - bench.um());
    let held = bench.um();
    stays_latched(&mut bench);
    assert!(bench.um() > held - 2.0);
}

#[test]
fn a_head_that_rests_on_its_upper_limit_can_be_enabled_and_leaves_it_downward_only() {
    let mut bench = Bench::new();
    bench.x = 0.001;
    bench.safety.upper_limit = true;
    bench.make_ready();
    bench.command(Command::MoveBy(Nanometres(500_000)));
    bench.command(Command::Start);
    bench.run_until(3.0, |bench| bench.um() > 1100.0);
    bench.safety.upper_limit = false;
    bench.run_until(3.0, |bench| bench.state() == State::Done);
    bench.safety.upper_limit = true;
    expect(&mut bench, Fault::UpperLimit, 0);
}

#[test]
fn both_limits_open_is_a_wire_and_stops_where_it_is() {
    let mut bench = Bench::eroding();
    let at = bench.um();
    bench.safety.upper_limit = true;
    bench.safety.lower_limit = true;
    expect(&mut bench, Fault::BothLimits, 0);
    bench.run(1.0);
    assert!((bench.um() - at).abs() < 3.0);
    assert_eq!(bench.head.command(Command::ResetFault), Err(Refused::StillFaulty(Fault::BothLimits)));
}

#[test]
fn a_following_error_retracts_with_limited_force() {
    // What holds it back is not to be taken for an encoder that stands still: that lifts without a loop.
    let mut bench = Bench::with(|settings| (settings.axis_breakaway, settings.servo_friction) = (20.0, 0.0));
    bench.make_ready();
    bench.command(Command::MoveTo(Nanometres(4_000_000)));
    bench.command(Command::Start);
    bench.run_until(5.0, |bench| bench.um() > 1500.0);
    // Something holds the head back from below: it cannot follow the seek.
    bench.run_until(2.0, |bench| {
        let _ = bench;
        true
    });
    let blocked_at = bench.um();
    for _ in 0..40_000 {
        // A spring of 1 N/um.
        bench.push = (blocked_at - bench.um()).clamp(-60.0, 0.0);
        bench.tick();
        if bench.fault().is_some() {
            break;
        }
    }
    assert_eq!(bench.fault(), Some(Fault::FollowingError));
    bench.push = 0.0;
    let mut strongest = 0.0f64;
    for _ in 0..20_000 {
        bench.tick();
        strongest = strongest.max(bench.duty().abs());
        assert!(!bench.output.pulses);
    }
    assert!(bench.um() < blocked_at - 100.0, "at {} um", bench.um());
    // 3 N at 7.5 N/A is 0.4 A, 5 V, 10.3 % of 48 V, about the holding duty of 0.8 %.
    assert!(strongest < 0.115, "{strongest}");
}

#[test]
fn a_following_error_that_does_not_shrink_becomes_an_open_loop_lift() {
    // What drags at it is not to be taken for an encoder that stands still, nor for a wrong polarity.
    let mut bench = Bench::with(|settings| {
        (settings.axis_breakaway, settings.servo_friction, settings.runaway) = (20.0, 0.0, 1000.0)
    });
    bench.make_ready();
    bench.erode();
    // Dragged down with a little more than 3 A can hold (22.5 N), and much more than the limited force.
    for step in 0..10_000 {
        bench.push = 23.2f64.min(f64::from(step) * 0.01);
        bench.tick();
        if bench.fault().is_some() {
            break;
        }
    }
    assert_eq!(bench.fault(), Some(Fault::FollowingError));
    // Before it rises so fast that the winding is looked at.
    bench.run(0.015);
    let lift = bench.duty();
    // Never more than the limited 3 N about the holding duty, whatever friction it was told of: 2.76 N up, 9.51 %.
    assert!((lift - -0.0951).abs() < 0.0005, "{lift}");
    bench.run(0.31);
    assert_eq!(bench.duty(), 0.0, "it ends; weight plus 10 % is less than the counterbalance, and the bridge brakes");
}

#[test]
fn a_dead_encoder_lifts_open_loop_and_then_holds() {
    let mut bench = Bench::with(|settings| settings.following_limit = 5000.0);
    bench.make_ready();
    bench.surface_um = 9000.0;
    bench.command(Command::MoveTo(Nanometres(9_000_000)));
    bench.command(Command::Start);
    bench.run_until(5.0, |bench| bench.um() > 1000.0);
    bench.encoder_dead = true;
    bench.run_until(0.5, |bench| bench.fault().is_some());
    assert_eq!(bench.fault(), Some(Fault::EncoderLost));
    bench.run(0.002);
    assert!((bench.duty() - LIFT).abs() < 0.0005, "weight plus 20 %, and friction: {}", bench.duty());
    bench.run(0.31);
    // Weight plus 10 % would be 0.043 N down against the counterbalance.
    assert_eq!(bench.duty(), 0.0, "the bridge brakes");
    stays_latched(&mut bench);
}

#[test]
fn a_dead_encoder_ends_in_a_lift_also_when_the_following_error_is_noticed_first() {
    let mut bench = Bench::ready();
    bench.command(Command::MoveTo(Nanometres(4_000_000)));
    bench.command(Command::Start);
    bench.run_until(5.0, |bench| bench.um() > 1000.0);
    bench.encoder_dead = true;
    let at = bench.um();
    let mut lowest = at;
    for _ in 0..20_000 {
        bench.tick();
        lowest = lowest.max(bench.um());
    }
    assert_eq!(bench.state(), State::Fault);
    assert!(lowest - at < 6000.0, "ran {} um", lowest - at);
    assert!(bench.um() < lowest - 500.0 || lowest < at + 500.0);
}

#[test]
fn two_counters_that_disagree_for_good_are_a_lost_encoder() {
    let mut bench = Bench::new();
    bench.watch_offset = Some(0);
    bench.make_ready();
    bench.erode();
    bench.watch_offset = Some(1);
    bench.run(0.1);
    assert_eq!(bench.state(), State::Eroding, "one count may be an edge in flight");
    bench.watch_offset = Some(2);
    expect(&mut bench, Fault::EncoderLost, 3);
}

#[test]
fn a_head_that_lost_its_encoder_has_lost_its_home_and_works_again_once_it_has_a_new_one() {
    let mut bench = Bench::with(|_| ());
    bench.watch_offset = Some(0);
    bench.make_ready();
    bench.erode();
    bench.watch_offset = Some(2);
    expect(&mut bench, Fault::EncoderLost, 3);
    assert!(!bench.head.status().homed);
    bench.run(1.0);
    // The counters stay apart: nobody knows which is right, so neither is zero.
    bench.command(Command::ResetFault);
    bench.run(0.1);
    bench.command(Command::Enable);
    bench.run(0.1);
    assert_eq!(bench.state(), State::Ready);
    assert_eq!(bench.head.command(Command::MoveTo(Nanometres(1_000_000))), Err(Refused::NotHomed));
    bench.command(Command::SetHome(Nanometres(0)));
    bench.command(Command::MoveTo(Nanometres(1_000_000)));
}

#[test]
fn a_wrong_polarity_is_noticed_before_the_head_has_run_far() {
    let mut bench = Bench::ready();
    bench.x = 0.006;
    bench.run(0.001);
    let at = bench.um();
    bench.motor_sign = -1.0;
    bench.push = 0.5;
    bench.run_until(0.5, |bench| bench.fault().is_some());
    let fault = bench.fault().unwrap();
    assert!(matches!(fault, Fault::PolarityWrong | Fault::EncoderLost | Fault::FollowingError), "{}", fault.name());
    assert!((bench.um() - at).abs() < 6000.0);
    assert!(!bench.output.pulses);
}

#[test]
fn a_sagging_bus_lifts_on_what_is_left_and_then_coasts() {
    let mut bench = Bench::eroding();
    bench.bus = 30.0;
    expect(&mut bench, Fault::BusSag, 2);
    assert!((bench.duty() - LIFT).abs() < 0.0005);
    bench.bus = 14.0;
    bench.run(0.002);
    assert!(bench.coasts());
    stays_latched(&mut bench);
    assert_eq!(bench.head.command(Command::ResetFault), Err(Refused::StillFaulty(Fault::BusSag)));
}

#[test]
fn an_emergency_stop_lifts_for_at_most_300_ms_and_coasts() {
    let mut bench = Bench::eroding();
    bench.safety.emergency_stop = true;
    expect(&mut bench, Fault::EmergencyStop, 0);
    assert!(bench.duty() < 0.0);
    let lifted = (0..).find(|_| {
        bench.tick();
        bench.coasts()
    });
    assert!((5_990..=6_000).contains(&lifted.unwrap()), "{lifted:?} ticks");
    stays_latched(&mut bench);
    assert_eq!(bench.head.command(Command::ResetFault), Err(Refused::StillFaulty(Fault::EmergencyStop)));
    bench.safety.emergency_stop = false;
    bench.tick();
    bench.command(Command::ResetFault);
    assert_eq!(bench.state(), State::Disabled);
}

#[test]
fn a_bridge_fault_coasts_in_the_same_tick() {
    let mut bench = Bench::eroding();
    bench.safety.bridge_fault = true;
    bench.tick();
    assert!(bench.coasts() && !bench.output.pulses);
    assert_eq!(bench.fault(), Some(Fault::BridgeFault));
    stays_latched(&mut bench);
}

#[test]
fn a_current_beyond_the_peak_coasts() {
    let mut bench = Bench::eroding();
    bench.extra_amps = 3.5;
    bench.run(0.05);
    assert_ne!(bench.fault(), Some(Fault::OverCurrent), "3.75 A are allowed for 2 ms");
    let mut bench = Bench::eroding();
    bench.extra_amps = 4.0;
    expect(&mut bench, Fault::OverCurrent, 5);
    assert!(bench.coasts());
}

#[test]
fn a_stronger_reaction_replaces_a_milder_one_and_not_the_reverse() {
    let mut bench = Bench::eroding();
    bench.head.raise(Fault::HostSilent);
    bench.safety.lower_limit = true;
    expect(&mut bench, Fault::LowerLimit, 0);
    bench.head.raise(Fault::GateMissing);
    assert_eq!(bench.fault(), Some(Fault::LowerLimit));
    bench.safety.bridge_fault = true;
    expect(&mut bench, Fault::BridgeFault, 0);
}

/// Asks in every tick for the fault to be reset, until it is: after how many ms.
fn asks(bench: &mut Bench) -> f64 {
    let refused = |bench: &mut Bench| {
        let answer = bench.head.command(Command::ResetFault);
        assert!(matches!(answer, Ok(()) | Err(Refused::Reacting(_))), "{answer:?}");
        answer.is_err()
    };
    for tick in 0..40_000 {
        if !refused(bench) {
            assert_eq!((bench.state(), bench.fault()), (State::Disabled, None));
            return f64::from(tick) * 0.05;
        }
        bench.tick();
    }
    panic!("never: {:?}", bench.head.status());
}

#[test]
fn a_fault_is_not_reset_before_its_reaction_has_come_to_its_end() {
    // A millimetre at 5 mm/s, half of one, a lift of 300 ms, nothing.
    for (fault, least, most) in [
        (Fault::HostSilent, 195.0, 240.0),
        (Fault::Contact, 95.0, 140.0),
        (Fault::BothLimits, 5.0, 30.0),
        (Fault::EncoderLost, 299.0, 301.0),
        (Fault::OverCurrent, 0.0, 0.0),
    ] {
        let mut bench = Bench::eroding();
        bench.head.raise(fault);
        bench.tick();
        let ms = asks(&mut bench);
        assert!((least..=most).contains(&ms), "{}: reset after {ms} ms", fault.name());
        if fault.reaction() < Reaction::OpenLoopLift {
            assert!(bench.v.abs() < 1e-4, "{}: {} m/s", fault.name(), bench.v);
        }
    }
}

#[test]
fn a_fault_is_not_reset_while_a_dead_encoder_hides_how_fast_its_reaction_drives_the_head() {
    for dies_after in [0.001, 0.02, 0.1, 0.19, 0.21] {
        let mut bench = Bench::eroding();
        bench.head.raise(Fault::GapSignalInvalid);
        bench.run(dies_after);
        bench.encoder_dead = true;
        let ms = asks(&mut bench);
        assert!(bench.v.abs() < 1e-3, "dead after {dies_after} s: {} m/s, reset after {ms} ms", bench.v);
        let surface = bench.surface_um;
        bench.run(1.0);
        assert!(bench.um() < surface - 500.0, "dead after {dies_after} s: coasted to {} um", bench.um());
    }
}

#[test]
fn the_fault_of_a_head_that_stands_is_reset_without_a_wait() {
    let mut bench = Bench::ready();
    bench.run(0.2);
    bench.head.raise(Fault::UpperLimit);
    bench.tick();
    let ms = asks(&mut bench);
    assert!(ms < 20.0, "{ms} ms");
}

#[test]
fn a_lift_never_gives_a_duty_toward_the_work_whatever_the_settings_say_of_the_head() {
    type Wrong = fn(&mut Settings);
    // The bench has 0.2 kg, 2.2 N of counterbalance and 0.3 N of friction.
    let wrongs: [Wrong; 9] = [
        |_| {},
        |settings| settings.axis_counterbalance = 3.2,
        |settings| settings.axis_counterbalance = 4.4,
        |settings| settings.axis_counterbalance = 14.0,
        |settings| settings.axis_counterbalance = 0.0,
        |settings| settings.axis_mass = 0.1,
        |settings| settings.axis_mass = 1.0,
        |settings| settings.axis_breakaway = 0.0,
        |settings| settings.axis_resistance = 30.0,
    ];
    for (number, wrong) in wrongs.into_iter().enumerate() {
        for fault in [Fault::EncoderLost, Fault::EmergencyStop, Fault::BusSag] {
            // At rest, falling and rising; counting, and not any more.
            for mm_s in [0.0, 20.0, -20.0, -200.0] {
                for dead in [false, true] {
                    let mut bench = Bench::with(wrong);
                    bench.x = 0.006;
                    bench.make_ready();
                    bench.surface_um = 9000.0;
                    bench.v = mm_s * 1e-3;
                    bench.run(0.0006);
                    bench.encoder_dead = dead;
                    bench.head.raise(fault);
                    bench.run(0.0005);
                    let from = bench.um();
                    for _ in 0..12_000 {
                        bench.tick();
                        let what = format!("case {number}, {}, {mm_s} mm/s, dead {dead}", fault.name());
                        assert!(bench.duty() <= 0.0, "{what}: {} toward the work", bench.duty());
                        assert!(bench.um() < from + 500.0, "{what}: {} um further", bench.um() - from);
                    }
                }
            }
        }
    }
}

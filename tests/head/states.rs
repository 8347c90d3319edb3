//! States of the head on the bench: what it does when asked, and what it refuses.

use crate::bench::{Bench, OPEN_V};
use edm_servo_head::feed::LawName;
use edm_servo_head::gap::controlled::ControlledName;
use edm_servo_head::gap::voltage::Average;
use edm_servo_head::head::Structure;
use edm_servo_head::head::{Command, Fault, MotionLimits, Reason, Refused, State};
use edm_servo_head::path;
use edm_servo_head::settings::{SetpointUnit, Settings};
use edm_servo_head::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres, TICK_HZ, TICKS_PER_MS};

#[test]
fn a_head_that_was_never_enabled_coasts_with_pulses_off() {
    let mut bench = Bench::new();
    bench.run(0.1);
    assert!(bench.coasts() && !bench.output.pulses);
    assert_eq!(bench.state(), State::Disabled);
}

#[test]
fn there_is_no_jump_at_enable_wherever_the_head_stands() {
    for um in [0.0, 137.4, 5_000.9, 11_999.0] {
        let mut bench = Bench::new();
        bench.x = um * 1e-6;
        bench.run(0.05);
        bench.command(Command::Enable);
        let mut farthest = 0.0f64;
        bench.run_until(1.0, |bench| {
            farthest = farthest.max((bench.um() - um).abs());
            bench.head.status().tick > 10_000
        });
        assert!(farthest < 1.5, "moved {farthest} um from {um}");
    }
}

#[test]
fn a_hole_is_sought_eroded_and_done_with_a_reason_for_every_change() {
    let mut bench = Bench::ready();
    bench.changes();
    bench.command(Command::MoveTo(Nanometres(2_100_000)));
    bench.command(Command::Start);
    bench.run_until(10.0, |bench| bench.state() == State::Eroding);
    bench.run(0.5);
    let gap = bench.surface_um - bench.um();
    assert!((gap - 30.0).abs() < 1.5, "60 V at 2 V/um is a gap of 30 um, not {gap}");
    for _ in 0..1000 {
        bench.surface_um += 0.2;
        bench.run(0.01);
    }
    assert_eq!(bench.state(), State::Done);
    assert!(!bench.output.pulses);
    assert_eq!(bench.um().floor(), 2100.0);
    let reasons: Vec<_> = bench.changes().iter().map(|change| (change.to, change.reason)).collect();
    assert_eq!(
        reasons,
        [(State::Seeking, Reason::Started), (State::Eroding, Reason::WorkFound), (State::Done, Reason::PathEnd)]
    );
}

#[test]
fn a_short_retreats_along_the_path_within_its_time_and_comes_back() {
    let mut bench = Bench::eroding();
    bench.changes();
    let before = bench.um();
    bench.surface_um -= 35.0;
    let ticks = (0..).find(|_| {
        bench.tick();
        bench.state() == State::Retreating
    });
    assert_eq!(ticks, Some(19), "20 ticks of short are 1 ms");
    bench.run_until(0.1, |bench| bench.state() == State::Eroding);
    assert!(bench.um() < before - 9.0, "from {before} to {}", bench.um());
    let reasons: Vec<_> = bench.changes().iter().map(|change| change.reason).collect();
    assert_eq!(reasons, [Reason::Short, Reason::GapRecovered]);
    bench.run(1.0);
    assert!((bench.surface_um - bench.um() - 30.0).abs() < 1.5);
}

#[test]
fn a_retreat_that_the_reflex_began_goes_on_in_the_same_tick_and_comes_back() {
    let mut bench = Bench::eroding();
    bench.changes();
    bench.reflex = true;
    bench.tick();
    assert_eq!(bench.state(), State::Retreating);
    bench.run_until(0.1, |bench| bench.state() == State::Eroding);
    let reasons: Vec<_> = bench.changes().iter().map(|change| change.reason).collect();
    assert_eq!(reasons, [Reason::Short, Reason::GapRecovered]);
}

#[test]
fn the_reflex_moves_no_head_that_does_not_erode() {
    let mut bench = Bench::ready();
    let at = bench.um();
    bench.reflex = true;
    bench.run(0.1);
    assert_eq!(bench.state(), State::Ready);
    assert!((bench.um() - at).abs() < 1.5);
}

#[test]
fn the_setpoint_may_be_a_share_of_the_measured_open_circuit_voltage() {
    let mut bench = Bench::with(|settings| {
        settings.gap_setpoint_unit = SetpointUnit::PercentOfOpen;
        settings.gap_setpoint_percent = 40.0;
    });
    bench.make_ready();
    bench.erode();
    assert_eq!(bench.head.status().gap_setpoint.0.round(), 40.0);
    assert!((bench.surface_um - bench.um() - 20.0).abs() < 1.5);
}

#[test]
fn every_structure_and_law_of_the_voltage_keeps_the_gap() {
    for structure in [Structure::SingleLoop, Structure::VelocityCascade, Structure::Path] {
        for &law in LawName::ALL.iter().filter(|law| !law.needs_pulses()) {
            let mut bench = Bench::with(|settings| {
                settings.structure = structure;
                settings.law = law;
                settings.single_p = 0.000_5;
                settings.single_d = 0.000_05;
                settings.single_i = 0.001;
            });
            bench.make_ready();
            bench.erode();
            bench.run(2.0);
            let gap = bench.surface_um - bench.um();
            assert!((gap - 30.0).abs() < 3.0, "{structure:?} {law:?}: {gap} um");
        }
    }
}

#[test]
fn a_change_of_the_law_while_eroding_is_no_step_of_the_commanded_velocity() {
    let law = |law| move |settings: &mut Settings| settings.law = law;
    for from in [LawName::IncrementByError, LawName::FixedRate, LawName::SparkFrequency] {
        for to in [LawName::FixedRate, LawName::RateByError, LawName::GapRatio, LawName::SparkFrequency] {
            let mut bench = Bench::with(law(from));
            bench.make_ready();
            bench.erode();
            // A gap that is too wide by 5 um: every law wants something else.
            bench.surface_um += 5.0;
            bench.run(0.05);
            let before = bench.head.status().feed.0;
            let settings = Settings { law: to, ..bench.settings };
            bench.head.configure(settings.build().unwrap().head).unwrap();
            bench.run(0.000_25);
            let after = bench.head.status().feed.0;
            assert!((after - before).abs() < 3.0, "{from:?} to {to:?}: from {before} to {after} um/s");
        }
    }
}

#[test]
fn a_law_that_closes_the_pulses_does_so_for_its_time_and_without_a_fault() {
    let mut bench = Bench::with(|settings| settings.law = LawName::PulseCounts);
    // Neither short, nor open, nor discharges with a delay.
    bench.arcs = 60;
    bench.make_ready();
    bench.command(Command::MoveTo(Nanometres(4_000_000)));
    bench.command(Command::Start);
    bench.run_until(10.0, |bench| bench.state() == State::Eroding);
    let mut closed = 0;
    for _ in 0..TICK_HZ {
        bench.tick();
        closed += u32::from(!bench.output.pulses);
    }
    assert_eq!((bench.state(), bench.fault()), (State::Eroding, None));
    // 10 ms of every period of 100 ms but the first.
    let ms = closed / TICKS_PER_MS;
    assert!((80..=100).contains(&ms), "pulses closed for {ms} ms of a second");
}

#[test]
fn a_law_that_sees_nothing_is_a_fault_and_no_head_that_stands_still() {
    let mut bench = Bench::with(|settings| settings.law = LawName::ObservedGap);
    bench.make_ready();
    bench.command(Command::MoveTo(Nanometres(4_000_000)));
    bench.command(Command::Start);
    bench.run_until(10.0, |bench| bench.state() == State::Eroding);
    bench.run(0.2);
    assert_eq!(bench.head.status().fault, Some(Fault::GapSignalInvalid));
    let settings = Settings { law: LawName::ObservedGap, gap_average: Average::Plain, ..Settings::default() };
    assert!(settings.build().is_err());
}

#[test]
fn a_controlled_variable_that_is_not_known_is_a_fault_and_no_head_that_stands_still() {
    // The bench has no comparators; sparks it counts by their class.
    for controlled in [ControlledName::IgnitionHazard, ControlledName::GapDistance] {
        let mut bench = Bench::with(|settings| settings.controlled = controlled);
        bench.make_ready();
        bench.command(Command::MoveTo(Nanometres(4_000_000)));
        bench.command(Command::Start);
        bench.run_until(10.0, |bench| bench.state() == State::Eroding);
        bench.run(0.1);
        assert_eq!(bench.head.status().fault, Some(Fault::GapSignalInvalid), "{controlled:?}");
    }
    // The single loop runs on blocks, which have a voltage and nothing else.
    let settings = Settings {
        structure: Structure::SingleLoop,
        controlled: ControlledName::IgnitionHazard,
        ..Settings::default()
    };
    assert!(settings.build().is_err());
}

#[test]
fn hold_stops_with_pulses_off_and_start_goes_on() {
    let mut bench = Bench::eroding();
    bench.command(Command::Hold);
    bench.run(0.2);
    let held = bench.um();
    bench.run(0.5);
    assert!((bench.um() - held).abs() < 1.5 && !bench.output.pulses);
    assert_eq!(bench.state(), State::HoldingPosition);
    bench.command(Command::Start);
    bench.run(0.5);
    assert_eq!(bench.state(), State::Eroding);
}

#[test]
fn what_cannot_be_done_is_refused_and_changes_nothing() {
    let mut bench = Bench::new();
    bench.run(0.01);
    assert_eq!(bench.head.command(Command::Start), Err(Refused::State(State::Disabled)));
    assert_eq!(bench.head.command(Command::MoveBy(Nanometres(1000))), Err(Refused::State(State::Disabled)));
    bench.command(Command::Enable);
    assert_eq!(bench.head.command(Command::Enable), Err(Refused::State(State::Ready)));
    assert_eq!(bench.head.command(Command::Start), Err(Refused::NoPath));
    assert_eq!(bench.head.command(Command::MoveTo(Nanometres(1000))), Err(Refused::NotHomed));
    bench.command(Command::SetHome(Nanometres(0)));
    let too_far = Nanometres(12_000_001);
    let refused = bench.head.command(Command::MoveTo(too_far)).unwrap_err();
    assert_eq!(
        refused,
        Refused::OutOfTravel { target: Nanometres(12_000_000), min: Nanometres(0), max: Nanometres(12_000_000) }
    );
    assert!(bench.head.command(Command::MoveTo(Nanometres(-1000))).is_err());
    assert_eq!(bench.head.command(Command::MoveTo(Nanometres(0))), Err(Refused::Path(path::Refused::NoLength)));
    bench.command(Command::MoveTo(Nanometres(12_000_000)));
    assert!(bench.head.command(Command::MoveBy(Nanometres(1))).is_err());
    assert_eq!(bench.state(), State::Ready);
}

#[test]
fn incremental_moves_queue_from_the_end_of_the_queue() {
    let mut bench = Bench::ready();
    for _ in 0..256 {
        bench.command(Command::MoveBy(Nanometres(10_000)));
    }
    bench.command(Command::MoveBy(Nanometres(10_000)));
    assert_eq!(bench.head.command(Command::MoveBy(Nanometres(10_000))), Err(Refused::Path(path::Refused::QueueFull)));
    bench.surface_um = 9000.0;
    bench.command(Command::Start);
    bench.run_until(10.0, |bench| bench.state() == State::Done);
    assert_eq!(bench.um().floor(), 2570.0);
}

#[test]
fn a_configuration_is_swapped_while_eroding_without_a_bump() {
    let mut bench = Bench::eroding();
    let before = bench.um();
    let mut settings = bench.settings;
    settings.feed_gain = 5.0;
    bench.head.configure(settings.build().unwrap().head).unwrap();
    let mut farthest = 0.0f64;
    for _ in 0..2000 {
        bench.tick();
        farthest = farthest.max((bench.um() - before).abs());
    }
    assert!(farthest < 2.0);
    settings.axis_mass = 0.3;
    assert!(bench.head.configure(settings.build().unwrap().head).is_err(), "not the axis itself");
}

#[test]
fn a_hot_winding_gets_its_continuous_current_only_and_a_cool_one_its_peak() {
    // What pushes is not to be taken for an encoder that stands still.
    let mut bench = Bench::with(|settings| {
        (settings.motor_thermal, settings.axis_breakaway, settings.servo_friction) = (1.0, 20.0, 0.0)
    });
    bench.make_ready();
    // 15 N take about 2 A: allowed for 1 s * ln(4 / 3), 0.29 s, at 1 A continuous; then the head gives way.
    for step in 0..4000 {
        bench.push = 15.0f64.min(f64::from(step) * 0.01);
        bench.tick();
    }
    assert!(!bench.head.status().current_reduced && bench.head.status().current.0 < -1.8, "{:?}", bench.head.status());
    bench.run_until(0.3, |bench| bench.head.status().current_reduced);
    bench.run(0.005);
    assert!(bench.head.status().current.0 > -1.1, "{:?}", bench.head.status().current);
    // And never more than the peak, whatever the error asks for.
    let mut bench = Bench::with(|settings| (settings.axis_breakaway, settings.servo_friction) = (20.0, 0.0));
    bench.make_ready();
    let mut most = 0.0f32;
    for step in 0..4000 {
        bench.push = f64::from(step) * 0.01;
        bench.tick();
        most = most.max(bench.head.status().current.0.abs());
    }
    assert!(most > 2.5 && most < 3.1, "{most}");
}

#[test]
fn a_guiding_head_holds_its_place_tells_the_feed_and_comes_back_from_a_short() {
    let mut bench = Bench::ready();
    bench.command(Command::Position(
        Nanometres(1_900_000),
        MotionLimits {
            velocity: MicrometresPerSecond(20_000.0),
            acceleration: MicrometresPerSecond2(1e6),
            deceleration: MicrometresPerSecond2(1e6),
        },
    ));
    bench.run_until(1.0, |bench| bench.state() == State::Ready);
    bench.command(Command::Guide);
    bench.run(0.1);
    assert!(bench.output.pulses && (bench.um() - 1900.5).abs() < 1.5);
    assert!(bench.head.status().feed.0 > 0.0, "an open gap feeds");
    // The host moves the work: 20 um of gap are 40 V, below the 60 V to be kept.
    bench.surface_um = 1920.0;
    bench.run(0.1);
    assert!(bench.head.status().feed.0 < 0.0, "a narrow gap retreats");
    assert!((bench.um() - 1900.5).abs() < 1.5);
    bench.surface_um = 1899.0;
    bench.run_until(0.1, |bench| bench.state() == State::Retreating);
    bench.run_until(0.1, |bench| bench.um() < 1890.0);
    bench.surface_um = 1930.0;
    bench.run_until(0.1, |bench| bench.state() == State::Guiding);
    bench.run(0.1);
    assert!((bench.um() - 1900.5).abs() < 1.5, "back at {} um", bench.um());
}

#[test]
fn the_open_circuit_is_measured_anew_where_a_start_is_above_what_was_cleared() {
    for (up, open) in [(50.0, OPEN_V), (500.0, 80.0)] {
        let mut bench = Bench::eroding();
        bench.run(0.5);
        bench.command(Command::Hold);
        bench.run(0.05);
        let to = Nanometres(((bench.um() - up) * 1e3) as i64);
        let ramp = MicrometresPerSecond2(1e7);
        let limits = MotionLimits { velocity: MicrometresPerSecond(20e3), acceleration: ramp, deceleration: ramp };
        bench.command(Command::Position(to, limits));
        bench.run(0.5);
        bench.open_v = 80.0;
        bench.follows = None;
        bench.surface_um = bench.um() + 300.0;
        bench.command(Command::MoveTo(Nanometres(3_000_000)));
        bench.command(Command::Start);
        bench.run_until(2.0, |bench| bench.state() == State::Eroding);
        let measured = f64::from(bench.head.status().open_circuit.0);
        assert!((measured - open).abs() < 1.0, "{up} um up: {measured} V");
        // Work is what takes 15 % of that away: 20 % that the generator gives less are some.
        let gap = bench.surface_um - bench.um();
        assert!(open < OPEN_V && gap < 50.0 || open == OPEN_V && gap > 200.0, "{up} um up: found {gap} um above it");
    }
}

//! Commissioning: what is wrong is named, and no loop is closed on a wrong sign.

use crate::bench::Bench;
use edm_servo_head::head::{Command, Contradiction, Fault, Finding, Refused, Report, State};
use edm_servo_head::settings::Settings;

/// Runs a check on a bench that was never commissioned, and gives its result and the largest duty it used.
fn check(prepare: impl FnOnce(&mut Bench)) -> (Bench, Result<Report, Finding>, f64) {
    let mut bench = Bench::with(|settings| settings.commissioned = false);
    bench.surface_um = 1e6;
    prepare(&mut bench);
    bench.run(0.1);
    assert_eq!(bench.head.command(Command::Enable), Err(Refused::NotCommissioned));
    bench.command(Command::Commission);
    let mut strongest = 0.0f64;
    bench.run_until(30.0, |bench| {
        strongest = strongest.max(bench.duty().abs());
        bench.state() != State::Commissioning
    });
    bench.run(0.001);
    assert!(bench.coasts() && !bench.output.pulses);
    let result = bench.head.commissioning_result().expect("a check that has ended has a result");
    (bench, result, strongest)
}

#[test]
fn a_head_wired_right_passes_within_the_duty_limit_and_may_be_enabled() {
    let (mut bench, result, strongest) = check(|_| {});
    let report = result.unwrap();
    assert!(strongest <= 0.1, "{strongest}");
    assert!((report.stroke - 12_000).abs() <= 2, "{report:?}");
    assert_eq!(report.open.0, 100.0);
    // 0.2 kg against 2.2 N, with 0.3 N of friction, all within what the check is sure of, and closer.
    for (weighed, truth, near) in
        [(report.mass, 0.2, 0.02), (report.net_weight, -0.239, 0.02), (report.friction, 0.3, 0.08)]
    {
        let off = (weighed.value - truth).abs();
        assert!(off < weighed.uncertainty && off < near, "{truth}: {report:?}");
    }
    bench.command(Command::Enable);
}

#[test]
fn every_wrong_sign_is_named_and_refuses_the_loop() {
    type Wrong = fn(&mut Bench);
    let cases: [(Wrong, Finding); 4] = [
        (|bench| bench.motor_sign = -1.0, Finding::MotorReversed),
        (|bench| bench.encoder_sign = -1.0, Finding::EncoderReversed),
        (|bench| bench.gap_sign = -1.0, Finding::GapReversed),
        (
            |bench| {
                bench.motor_sign = -1.0;
                bench.encoder_sign = -1.0;
            },
            Finding::MotorReversed,
        ),
    ];
    for (wrong, finding) in cases {
        let (mut bench, result, _) = check(wrong);
        assert_eq!(result, Err(finding));
        assert_eq!(bench.head.command(Command::Enable), Err(Refused::NotCommissioned));
        assert!(bench.um() < 200.0, "it went {} um before it knew", bench.um());
    }
}

#[test]
fn an_encoder_that_dies_in_a_stroke_is_lost_before_the_head_has_run_to_the_other_end() {
    let mut bench = Bench::with(|settings| settings.commissioned = false);
    bench.surface_um = 20_000.0;
    bench.run(0.01);
    bench.command(Command::Commission);
    bench.run_until(10.0, |bench| bench.um() > 2000.0);
    bench.encoder_dead = true;
    bench.run_until(0.2, |bench| bench.state() == State::Fault);
    assert_eq!(bench.fault(), Some(Fault::EncoderLost));
    bench.run(0.5);
    assert!(bench.um() < 11_999.0, "at {} um", bench.um());
}

#[test]
fn signs_corrected_in_the_settings_pass() {
    let mut bench = Bench::with(|settings| {
        settings.commissioned = false;
        settings.motor_reversed = true;
        settings.encoder_reversed = true;
    });
    bench.surface_um = 1e6;
    bench.motor_sign = -1.0;
    bench.encoder_sign = -1.0;
    bench.run(0.1);
    bench.command(Command::Commission);
    bench.run_until(30.0, |bench| bench.state() != State::Commissioning);
    assert!(bench.head.commissioning_result().unwrap().is_ok());
}

#[test]
fn an_open_circuit_that_the_settings_do_not_say_is_named_with_what_it_may_be() {
    let check_of = |volts: f32| {
        let mut bench = Bench::with(|settings| {
            settings.commissioned = false;
            (settings.gap_open, settings.gap_open_min) = (volts, 65.0);
        });
        bench.surface_um = 1e6;
        bench.run(0.1);
        bench.command(Command::Commission);
        bench.run_until(30.0, |bench| bench.state() != State::Commissioning);
        bench.head.commissioning_result().unwrap()
    };
    for volts in [85.0, 115.0] {
        assert!(check_of(volts).is_ok(), "{volts}");
    }
    for volts in [70.0, 150.0] {
        let found = Contradiction { measured: 100_000, least: 75_000, most: 125_000 };
        assert_eq!(check_of(volts), Err(Finding::OpenCircuit(found)));
    }
}

#[test]
fn a_dead_encoder_a_dead_generator_and_a_short_stroke_are_named() {
    let (_, result, _) = check(|bench| bench.encoder_dead = true);
    assert_eq!(result, Err(Finding::NoMotion));
    let (_, result, _) = check(|bench| bench.surface_um = 20.0);
    assert_eq!(result, Err(Finding::NoOpenCircuit));
    let (_, result, _) = check(|bench| bench.stroke_m = 0.006);
    assert!(matches!(result, Err(Finding::Stroke(5_990..=6_010))), "{result:?}");
}

#[test]
fn a_head_that_does_not_start_at_its_upper_stop_is_told_so() {
    let (_, result, _) = check(|bench| bench.x = 0.003);
    assert_eq!(result, Err(Finding::NotAtUpperStop));
}

#[test]
fn an_emergency_stop_ends_the_check() {
    let mut bench = Bench::with(|settings| settings.commissioned = false);
    bench.run(0.1);
    bench.command(Command::Commission);
    bench.run(0.5);
    bench.safety.emergency_stop = true;
    bench.tick();
    assert_eq!(bench.state(), State::Fault);
    bench.run(1.0);
    assert!(bench.coasts());
    assert_eq!(bench.head.commissioning_result(), None);
}

/// What a check makes of settings on the bench, which has 0.2 kg, 2.2 N of counterbalance and 0.3 N of friction.
fn of_settings(change: impl FnOnce(&mut Settings)) -> Result<Report, Finding> {
    let mut bench = Bench::with(|settings| {
        settings.commissioned = false;
        change(settings);
    });
    bench.surface_um = 1e6;
    bench.run(0.1);
    bench.command(Command::Commission);
    bench.run_until(40.0, |bench| bench.state() != State::Commissioning);
    bench.head.commissioning_result().unwrap()
}

#[test]
fn settings_that_contradict_what_the_check_measures_are_refused_with_value_and_range() {
    let holds = |found: Contradiction, truth: i32, set: i32| {
        let Contradiction { measured, least, most } = found;
        assert!((measured - truth).abs() < truth / 10, "{truth}: {found:?}");
        assert!(least < measured && measured < most && !(least..=most).contains(&set), "{set}: {found:?}");
    };
    for counterbalance in [0.0, 1.6, 2.8, 3.2, 4.4, 14.0] {
        match of_settings(|settings| settings.axis_counterbalance = counterbalance) {
            Err(Finding::Counterbalance(found)) => holds(found, 2200, (counterbalance * 1e3) as i32),
            other => panic!("{counterbalance} N: {other:?}"),
        }
    }
    for mass in [0.02, 0.1, 0.3, 1.0] {
        match of_settings(|settings| settings.axis_mass = mass) {
            Err(Finding::Mass(found)) => holds(found, 200, (mass * 1e3) as i32),
            other => panic!("{mass} kg: {other:?}"),
        }
    }
    // They show as a mass.
    for share in [0.5, 1.5] {
        for change in [
            (|settings: &mut Settings, share| settings.axis_resistance *= share) as fn(&mut Settings, f32),
            |settings, share| settings.axis_force_constant *= share,
        ] {
            let found = of_settings(|settings| change(settings, share));
            assert!(matches!(found, Err(Finding::Mass(_))), "{share}: {found:?}");
        }
    }
}

#[test]
fn settings_within_what_the_check_is_sure_of_pass_and_what_it_measured_takes_their_place() {
    for (counterbalance, breakaway) in [(2.15, 0.0), (2.25, 3.0)] {
        let change = |settings: &mut Settings| {
            (settings.axis_counterbalance, settings.axis_breakaway) = (counterbalance, breakaway);
        };
        let report = of_settings(change).unwrap();
        let mut settings = Settings::default();
        change(&mut settings);
        let learnt = settings.learnt(&report);
        assert!((learnt.axis_counterbalance - 2.2).abs() < 0.02, "{}", learnt.axis_counterbalance);
        assert!((learnt.axis_breakaway - 0.3).abs() < 0.08, "{}", learnt.axis_breakaway);
    }
}

#[test]
fn a_duty_limit_that_is_hardly_more_than_friction_is_named() {
    let found = of_settings(|settings| settings.commission_duty = 0.035);
    assert_eq!(found, Err(Finding::TooWeak));
}

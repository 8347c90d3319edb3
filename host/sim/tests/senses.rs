//! Hazard, distance and spark frequency as the head estimates them, and as what it controls. Everything is simulated.

use edm_servo_head::gap::Quality;
use edm_servo_head::gap::controlled::ControlledName;
use edm_servo_head::head::{Command, State};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{Nanometres, TICK_HZ};
use edm_sim::machine::Machine;
use edm_sim::run::Setup;

fn run(machine: &mut Machine, seconds: f64, mut until: impl FnMut(&Machine) -> bool) -> bool {
    (0..(seconds * f64::from(TICK_HZ)) as u32).any(|_| {
        machine.tick();
        until(machine)
    })
}

/// A head that erodes, a short way from where it began, with its settings.
fn eroding(scenario: &str, controlled: ControlledName, seed: u64) -> (Machine, Settings) {
    let Setup { mut process, head, .. } = Setup::load(scenario).unwrap();
    process.base.surface = 0.5;
    let settings = Settings { commissioned: true, controlled, ..head };
    let mut machine = Machine::new(process, &settings, seed).unwrap();
    run(&mut machine, 0.01, |_| false);
    for command in
        [Command::SetHome(Nanometres(0)), Command::Enable, Command::MoveTo(Nanometres(3_000_000)), Command::Start]
    {
        machine.command(command).unwrap();
    }
    assert!(run(&mut machine, 5.0, |machine| machine.status().state == State::Eroding), "{scenario}");
    (machine, settings)
}

#[test]
fn every_controlled_variable_keeps_a_gap_of_its_own() {
    // Scenario, variable, mean gap and its rms, um.
    for (scenario, controlled, gaps, most) in [
        ("sinker", ControlledName::IgnitionHazard, 28.0..40.0, 8.0),
        ("sinker", ControlledName::Frequency, 36.0..48.0, 8.0),
        ("silicon", ControlledName::GapDistance, 43.0..46.0, 1.0),
    ] {
        for seed in 1..=3 {
            let (mut machine, _) = eroding(scenario, controlled, seed);
            run(&mut machine, 1.0, |_| false);
            let (mut sum, mut squares, mut count, mut error) = (0.0, 0.0, 0.0f64, 0.0);
            let fault = run(&mut machine, 4.0, |machine| {
                let status = machine.status();
                if status.state == State::Eroding && status.gap.quality == Quality::Valid {
                    error += f64::from(status.gap_error.0);
                    let gap = machine.process.truth().gap_um;
                    (sum, squares, count) = (sum + gap, squares + gap * gap, count + 1.0);
                }
                status.fault.is_some()
            });
            let (mean, error) = (sum / count, error / count);
            let rms = (squares / count - mean * mean).sqrt();
            println!("{scenario} {controlled:?} {seed}: gap {mean:.1} um, {rms:.1} um rms, error {error:+.2} V");
            assert!(!fault && count > 50_000.0, "{scenario} {controlled:?}: {:?}", machine.status().fault);
            assert!(gaps.contains(&mean) && rms < most, "{scenario} {controlled:?}: {mean} um, {rms} um rms");
            assert!(error.abs() < 2.0, "{scenario} {controlled:?}: {error} V off on average");
        }
    }
}

#[test]
fn another_controlled_variable_begins_without_a_step_of_the_gap_error() {
    for (scenario, to) in [
        ("sinker", ControlledName::IgnitionHazard),
        ("sinker", ControlledName::Frequency),
        ("silicon", ControlledName::GapDistance),
    ] {
        let (mut machine, mut settings) = eroding(scenario, ControlledName::GapVoltage, 1);
        run(&mut machine, 1.0, |_| false);
        // A set point far from the present gap.
        (settings.hazard_setpoint, settings.frequency_setpoint, settings.distance_setpoint) = (1e6, 1e5, 5.0);
        for controlled in [to, ControlledName::GapVoltage] {
            settings.controlled = controlled;
            let before = machine.status().gap_error.0;
            machine.configure(&settings.build().unwrap()).unwrap();
            let after = machine.status().gap_error.0;
            // What the gap itself does within a plan or two.
            assert!((after - before).abs() < 3.0, "{scenario} {controlled:?}: {before} V, then {after} V");
            run(&mut machine, 0.05, |_| false);
        }
    }
}

//! Hazard, distance and spark frequency as the head estimates them, and as what it controls. Everything is simulated.

use edm_servo_head::gap::Quality;
use edm_servo_head::gap::controlled::ControlledName;
use edm_servo_head::gap::voltage::Average;
use edm_servo_head::head::{Command, State};
use edm_servo_head::settings::{Declared as _, SetpointUnit, Settings, Value};
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
    let Setup { process, head, .. } = Setup::load(scenario).unwrap();
    let mut process = process;
    // An arc that stays is no ignition that the hazard counts, and one seed of three ended with it.
    process.set("model.arc_heat", Value::Number(0.0)).unwrap();
    process.installation.surface = 0.5;
    // The distance follows from the time to the comparator's threshold: one that is 15 % high makes 65 um of 44.
    process.installation.comparator_error = 0.0;
    let settings = Settings { commissioned: true, controlled, ..head };
    let mut machine = Machine::new(process, &settings, seed).unwrap();
    erode(&mut machine);
    (machine, settings)
}

fn erode(machine: &mut Machine) {
    run(machine, 0.01, |_| false);
    for command in
        [Command::SetHome(Nanometres(0)), Command::Enable, Command::MoveTo(Nanometres(3_000_000)), Command::Start]
    {
        machine.command(command).unwrap();
    }
    assert!(run(machine, 5.0, |machine| machine.status().state == State::Eroding), "{:?}", machine.status());
}

#[test]
fn every_controlled_variable_keeps_a_gap_of_its_own() {
    // Scenario, variable, mean gap and its rms, um.
    for (scenario, controlled, gaps, most) in [
        ("sinker", ControlledName::IgnitionHazard, 36.0..48.0, 8.0),
        ("sinker", ControlledName::Frequency, 44.0..56.0, 8.0),
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

#[test]
fn another_average_while_eroding_moves_neither_the_gap_error_nor_the_gap() {
    let Setup { mut process, head, .. } = Setup::load("sinker").unwrap();
    process.installation.surface = 0.5;
    let gated = Settings {
        commissioned: true,
        gap_setpoint_unit: SetpointUnit::PercentOfOpen,
        gap_average: Average::Gated,
        ..head
    };
    let plain = Settings { gap_average: Average::Plain, ..gated };
    // Two heads with the same process, one of which changes its average: of the gap itself both see the same.
    let [mut changes, mut stays] = [0, 1].map(|_| {
        let mut machine = Machine::new(process, &gated, 1).unwrap();
        erode(&mut machine);
        run(&mut machine, 1.0, |_| false);
        machine
    });
    let error = |machine: &mut Machine, settings: &Settings| {
        machine.configure(&settings.build().unwrap()).unwrap();
        let mut sum = 0.0;
        run(machine, 0.02, |machine| {
            sum += machine.status().gap_error.0 / 400.0;
            false
        });
        sum
    };
    let open = changes.status().open_circuit.0;
    let errors = [error(&mut changes, &plain), error(&mut stays, &gated)];
    // The averages are 14 V apart.
    assert!((errors[0] - errors[1]).abs() < 3.0, "{errors:?} V");
    let gap = |machine: &mut Machine| {
        let (mut sum, mut count) = (0.0, 0.0);
        let faulted = run(machine, 6.0, |machine| {
            (sum, count) = (sum + machine.process.truth().gap_um, count + 1.0);
            machine.status().fault.is_some()
        });
        assert!(!faulted, "{:?}", machine.status().fault);
        sum / count
    };
    let gaps = [gap(&mut changes), gap(&mut stays)];
    let now = changes.status().open_circuit.0;
    println!("gap {gaps:?} um, errors {errors:?} V, open circuit {open} V, then {now} V");
    assert!((gaps[0] - gaps[1]).abs() < 3.0, "{gaps:?} um");
    assert!((now - 0.8 * open).abs() < 1.5, "{now} V of {open} V");
    let _ = error(&mut changes, &gated);
    let back = gap(&mut changes);
    let now = changes.status().open_circuit.0;
    assert!((back - gaps[1]).abs() < 3.0 && (now - open).abs() < 1.5, "{back} um of {gaps:?}, {now} V of {open} V");
}

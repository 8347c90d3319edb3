//! Every feed law erodes natively, and what a law wants of the generator is done. Everything is simulated.

use edm_servo_head::feed::LawName;
use edm_servo_head::head::{Command, State};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{Nanometres, TICK_HZ};
use edm_sim::machine::Machine;
use edm_sim::process::Pulses;
use edm_sim::run::Setup;

fn run(machine: &mut Machine, seconds: f64, mut until: impl FnMut(&Machine) -> bool) -> bool {
    (0..(seconds * f64::from(TICK_HZ)) as u32).any(|_| {
        machine.tick();
        until(machine)
    })
}

/// A head that erodes, a short way from where it began.
fn eroding(scenario: &str, set: impl Fn(&mut Settings)) -> Machine {
    let Setup { mut process, head, .. } = Setup::load(scenario).unwrap();
    process.installation.surface = if scenario == "micro-blind" { 0.05 } else { 0.5 };
    let mut settings = Settings { commissioned: true, ..head };
    set(&mut settings);
    let mut machine = Machine::new(process, &settings, 1).unwrap();
    run(&mut machine, 0.01, |_| false);
    for command in
        [Command::SetHome(Nanometres(0)), Command::Enable, Command::MoveTo(Nanometres(3_000_000)), Command::Start]
    {
        machine.command(command).unwrap();
    }
    assert!(run(&mut machine, 5.0, |machine| machine.status().state == State::Eroding), "{scenario}");
    machine
}

#[test]
fn every_law_erodes_without_a_fault() {
    for &law in LawName::ALL {
        // The gap distance of charging times is that of its material.
        let scenario = if law == LawName::MinimumVariance { "silicon" } else { "sinker" };
        let mut machine = eroding(scenario, |settings| settings.law = law);
        let before = machine.status().position;
        let fault = run(&mut machine, 10.0, |machine| machine.status().fault.is_some());
        assert!(!fault, "{law:?}: {:?}", machine.status().fault);
        let um = machine.status().position - before;
        println!("{law:?}: {um} um in 10 s");
        assert!(um > 3, "{law:?}: {um} um in 10 s");
    }
}

fn pulses(scenario: &str, set: impl Fn(&mut Settings)) -> Pulses {
    let mut machine = eroding(scenario, set);
    let before = machine.process.truth().pulses;
    run(&mut machine, 4.0, |_| false);
    assert!(machine.status().fault.is_none(), "{:?}", machine.status().fault);
    machine.process.truth().pulses.since(&before)
}

#[test]
fn the_off_time_that_pulse_control_asks_for_is_made() {
    let made = |law| {
        pulses("micro-blind", |settings| {
            settings.law = law;
            // Whatever is seen: always.
            (settings.direction_limit, settings.shorts_limit_percent) = (0.0, 0.0);
            (settings.pulses_period_ms, settings.direction_weight, settings.shorts_periods) = (16.0, 0.5, 16);
            (settings.long_off_time_us, settings.long_off_ms) = (16.0, 10_000.0);
        })
    };
    let (without, with) = (made(LawName::PulseCounts), made(LawName::PulseControl));
    let ratio = with.total() as f64 / without.total() as f64;
    // 4 + 6 us a pulse, or 4 + 16: half of them, once the first shorts have come.
    assert!((0.45..0.7).contains(&ratio), "{ratio} {with:?} {without:?}");
}

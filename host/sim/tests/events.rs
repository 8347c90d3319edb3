//! Events of a scenario, and what the head does about each.

use edm_servo_head::head::{Command, Fault, State};
use edm_servo_head::settings::{Declared, Kind, Settings, Value};
use edm_servo_head::units::{Nanometres, TICK_HZ};
use edm_sim::bore::{self, Setup};
use edm_sim::events::{Event, Wires};
use edm_sim::machine::Machine;
use edm_sim::observe::Recorder;
use edm_sim::process::Truth;
use edm_sim::run::Job;

/// The default scenario erodes by then, and for minutes after.
const AT_S: f64 = 4.0;

fn event(at_s: f64, signal: &str, on: bool) -> Event {
    let field = Wires::FIELDS.iter().find(|field| field.key == signal).unwrap();
    let value = if field.kind == Kind::Flag { Value::Flag(on) } else { Value::Number(if on { 20.0 } else { 0.0 }) };
    Event::new(at_s, signal, value).unwrap()
}

/// A head that erodes, one tick before the event.
fn eroding(events: &[Event]) -> Machine {
    let setup = Setup::load("default").unwrap();
    let settings = Settings { commissioned: true, ..setup.head };
    let mut machine = Machine::new(setup.process, &settings, 1).unwrap();
    machine.process.schedule(events);
    run(&mut machine, 0.01);
    let target = Command::MoveTo(Nanometres(3_000_000));
    for command in [Command::SetHome(Nanometres(0)), Command::Enable, target, Command::Start] {
        machine.command(command).unwrap();
    }
    // Each command has taken as long as a plan.
    while machine.process.truth().t_s < AT_S - 1.5 / f64::from(TICK_HZ) {
        machine.tick();
    }
    assert_eq!((machine.status().state, machine.status().fault), (State::Eroding, None));
    machine
}

fn run(machine: &mut Machine, seconds: f64) {
    for _ in 0..(seconds * f64::from(TICK_HZ)).round() as u64 {
        machine.tick();
    }
}

/// Runs on until the reaction is over: what really is when the event happens, and afterwards.
fn after(signal: &str) -> (Machine, Truth, Truth) {
    let mut machine = eroding(&[event(AT_S, signal, true)]);
    let before = machine.process.truth();
    run(&mut machine, 2.0);
    let after = machine.process.truth();
    run(&mut machine, 0.1);
    assert_eq!(machine.process.truth().pulses, after.pulses, "{signal}: no pulse after the reaction");
    (machine, before, after)
}

#[test]
fn every_signal_brings_its_fault_and_nothing_is_rammed() {
    let faults = [
        ("encoder.cut", Fault::EncoderLost),
        ("limit.upper_open", Fault::UpperLimit),
        ("limit.lower_open", Fault::LowerLimit),
        ("stop.open", Fault::EmergencyStop),
        ("dielectric.lost", Fault::DielectricNotOk),
        ("bridge.fault", Fault::BridgeFault),
        ("bus.sag_v", Fault::BusSag),
        ("gap.saturated", Fault::GapSignalInvalid),
        ("gap.short", Fault::PersistentShort),
        ("generator.off", Fault::GateMissing),
        ("gate.cut", Fault::GateMissing),
        ("gate.start_cut", Fault::ReflexLost),
    ];
    // Of the sense supply, another workpiece and pulses without permission nothing is noticed while pulses are on, and a
    // hand is held off, and of a coarse axis that moves unasked: below, tests/contact.rs, tests/canopen_device/settings.rs. Arcs: arcs.rs.
    // Steps of a host and what it heeds: tests/canopen_device/steps.rs.
    assert_eq!(faults.len() + 8, Wires::FIELDS.len());
    for (signal, fault) in faults {
        let (machine, before, after) = after(signal);
        assert_eq!(machine.status().fault, Some(fault), "{signal}");
        assert!(after.position_um < before.position_um + 2.0, "{signal}: {before:?} {after:?}");
        assert!(after.contact_n < 10.0, "{signal}: {after:?}");
    }
}

#[test]
fn a_generator_that_does_not_obey_is_named_once_it_should_be_silent() {
    let mut machine = eroding(&[event(AT_S, "generator.disobeys", true)]);
    run(&mut machine, 0.5);
    assert_eq!((machine.status().state, machine.status().fault), (State::Eroding, None));
    machine.command(Command::Hold).unwrap();
    run(&mut machine, 0.01);
    assert_eq!(machine.status().fault, Some(Fault::UnpermittedPulses));
    // As long as it goes on the fault cannot be left behind.
    run(&mut machine, 2.0);
    machine.command(Command::ResetFault).unwrap();
    // Refused where it has been told of again already.
    let _ = machine.command(Command::Enable);
    run(&mut machine, 0.01);
    assert_eq!(machine.status().fault, Some(Fault::UnpermittedPulses));
}

#[test]
fn the_head_goes_where_the_fault_table_says() {
    let rise = |signal| {
        let (_, before, after) = after(signal);
        before.position_um - after.position_um
    };
    let safe = f64::from(Settings::default().retreat_safe);
    for signal in ["dielectric.lost", "gap.saturated", "generator.off"] {
        let rise = rise(signal);
        assert!((safe - 100.0..safe + 100.0).contains(&rise), "{signal}: {rise} um to the safe height");
    }
    let off = rise("limit.lower_open");
    assert!((500.0..600.0).contains(&off), "{off} um off the lower limit");
    let held = rise("limit.upper_open");
    assert!(held.abs() < 20.0, "{held} um: never further up, and no further down");
    for signal in ["stop.open", "encoder.cut"] {
        let lift = rise(signal);
        assert!(lift > 500.0, "{signal}: lifted by {lift} um");
    }
}

#[test]
fn a_fault_whose_cause_has_gone_can_be_reset_and_the_hole_goes_on() {
    let mut machine = eroding(&[event(AT_S, "dielectric.lost", true), event(AT_S + 1.0, "dielectric.lost", false)]);
    run(&mut machine, 0.9);
    assert!(machine.command(Command::ResetFault).is_err(), "the cause is still there");
    run(&mut machine, 0.2);
    let deep = machine.process.truth().surface_um;
    let target = Command::MoveTo(Nanometres(3_000_000));
    for command in [Command::ResetFault, Command::Enable, target, Command::Start] {
        machine.command(command).unwrap();
    }
    run(&mut machine, 5.0);
    assert_eq!(machine.status().state, State::Eroding);
    assert!(machine.process.truth().surface_um > deep);
}

#[test]
fn a_bore_with_an_event_ends_with_its_fault() {
    let mut setup = Setup::load("default").unwrap();
    setup.events = vec![event(AT_S, "limit.lower_open", true)];
    let job = Job { setup, depth_mm: 0.5, path: None, table: None, seed: 1, surrogate: false, coarse_error_um: 0.0 };
    let outcome = bore::bore(&job, &mut Recorder::new(None, false).unwrap(), &mut |_| {}).unwrap();
    assert_eq!((outcome.completed, outcome.stop_reason.as_str()), (false, "lower limit"));
    assert!((outcome.faults[0].t_s - AT_S).abs() < 2e-4, "{:?}", outcome.faults);
}

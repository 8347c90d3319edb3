//! A second fault under the first: the encoder dies while the reaction to another fault runs, in every row of the fault table
//! of docs/architecture.md; and a head whose encoder is dead is reset, enabled and told to seek.
//!
//! Forces are simulated: a contact of 2 N/um (assumed), a counterbalanced head of 0.2 kg with 0.3 N of friction. The short form
//! runs three seeds. `EDM_SEEDS=20` runs twenty and watches each of them longer.

use edm_servo_head::head::{Command, Fault, State};
use edm_servo_head::settings::{Settings, Value};
use edm_servo_head::units::{Nanometres, TICK_HZ};
use edm_sim::bore::Setup;
use edm_sim::machine::Machine;

/// Most that the electrode may press on the work once nobody knows any more where it is, N.
const CONTACT_N: f64 = 5.0;
/// Times from the first fault to the loss of the encoder, s.
const LOST_AFTER_S: [f64; 4] = [0.0, 0.5, 2.0, 10.0];

fn seeds() -> (u64, f64) {
    match std::env::var("EDM_SEEDS").ok().and_then(|seeds| seeds.parse().ok()) {
        Some(seeds) => (seeds, 20.0),
        None => (3, 5.0),
    }
}

/// A row of the table: a fault, and what brings it about. `None`: nothing in the model does, and it is raised.
type Row = (Fault, Option<&'static [(&'static str, Value<'static>)]>);

const ON: Value<'static> = Value::Flag(true);
const ROWS: &[Row] = &[
    (Fault::PersistentShort, Some(&[("gap.short", ON)])),
    (Fault::PersistentArc, Some(&[("gap.arcs_percent", Value::Number(100.0))])),
    (Fault::GapSignalInvalid, Some(&[("gap.saturated", ON)])),
    (Fault::GateMissing, Some(&[("generator.off", ON)])),
    (Fault::DielectricNotOk, Some(&[("dielectric.lost", ON)])),
    (Fault::HostSilent, Some(&[])),
    (Fault::LowerLimit, Some(&[("limit.lower_open", ON)])),
    (Fault::UpperLimit, Some(&[("limit.upper_open", ON)])),
    (Fault::BothLimits, Some(&[("limit.upper_open", ON), ("limit.lower_open", ON)])),
    (Fault::FollowingError, None),
    (Fault::EncoderLost, None),
    (Fault::PolarityWrong, None),
    (Fault::BusSag, Some(&[("bus.sag_v", Value::Number(20.0))])),
    (Fault::EmergencyStop, Some(&[("stop.open", ON)])),
    (Fault::OverCurrent, None),
    (Fault::BridgeFault, Some(&[("bridge.fault", ON)])),
];

fn settings(setup: &Setup) -> Settings {
    // A faster seek shortens the test.
    Settings { commissioned: true, host_ms: 500, seek_velocity: 5000.0, ..setup.head }
}

/// A head that has eroded for half a second.
fn eroding(seed: u64) -> Machine {
    let setup = Setup::load("default").unwrap();
    let mut machine = Machine::new(setup.process, &settings(&setup), seed).unwrap();
    run(&mut machine, 0.01);
    let target = Command::MoveTo(Nanometres(3_000_000));
    for command in [Command::SetHome(Nanometres(0)), Command::Enable, target, Command::Start] {
        machine.command(command).unwrap();
    }
    run_until(&mut machine, 3.0, |machine| machine.status().state == State::Eroding);
    run(&mut machine, 0.5);
    assert_eq!(machine.status().fault, None);
    machine
}

fn run(machine: &mut Machine, seconds: f64) {
    for _ in 0..(seconds * f64::from(TICK_HZ)).round() as u64 {
        machine.tick();
    }
}

fn run_until(machine: &mut Machine, seconds: f64, mut done: impl FnMut(&Machine) -> bool) {
    for _ in 0..(seconds * f64::from(TICK_HZ)) as u64 {
        machine.tick();
        if done(machine) {
            return;
        }
    }
    panic!("not within {seconds} s: {:?}", machine.status());
}

/// Worst of what was seen after the encoder was lost.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    /// Contact force, N.
    contact: f64,
    /// Motor current from one second on, A.
    current: f64,
    fault: Option<Fault>,
}

fn after_the_loss(row: Row, seed: u64, lost_after: f64, watched: f64) -> Seen {
    let (fault, cause) = row;
    let mut machine = eroding(seed);
    match cause {
        None => machine.raise(fault),
        Some(signals) => {
            machine.host_alive = fault != Fault::HostSilent;
            for (signal, value) in signals {
                machine.process.happen(signal, *value).unwrap();
            }
            run_until(&mut machine, 5.0, |machine| machine.status().fault.is_some());
        }
    }
    assert_eq!(machine.status().fault, Some(fault), "seed {seed}");
    run(&mut machine, lost_after);
    machine.process.happen("encoder.cut", ON).unwrap();
    let mut seen = Seen::default();
    for tick in 0..(watched * f64::from(TICK_HZ)) as u32 {
        machine.tick();
        seen.contact = seen.contact.max(machine.process.truth().contact_n);
        if tick >= TICK_HZ {
            seen.current = seen.current.max(f64::from(machine.status().current.0.abs()));
        }
    }
    seen.fault = machine.status().fault;
    seen
}

#[test]
fn an_encoder_lost_under_any_fault_presses_nothing_into_the_work() {
    let (seeds, watched) = seeds();
    let continuous = f64::from(Settings::default().motor_continuous);
    let mut bad = Vec::new();
    for &row in ROWS {
        for lost_after in LOST_AFTER_S {
            let mut worst = Seen::default();
            for seed in 1..=seeds {
                let seen = after_the_loss(row, seed, lost_after, watched);
                worst.contact = worst.contact.max(seen.contact);
                worst.current = worst.current.max(seen.current);
                worst.fault = seen.fault;
            }
            println!(
                "{:20} {lost_after:4} s  {:6.2} N  {:5.3} A  {:?}",
                row.0.name(),
                worst.contact,
                worst.current,
                worst.fault
            );
            if worst.contact > CONTACT_N || worst.current >= continuous {
                bad.push((row.0, lost_after, worst));
            }
        }
    }
    assert!(bad.is_empty(), "{bad:#?}");
}

/// The encoder dies while the head erodes; when the fault's reaction is over, somebody resets the fault and starts again,
/// without having looked. Greatest contact force after that, and how often he was let.
fn started_again(seed: u64, attempts: u32) -> (f64, u32) {
    let mut machine = eroding(seed);
    machine.process.happen("encoder.cut", ON).unwrap();
    run_until(&mut machine, 1.0, |machine| machine.status().fault.is_some());
    run(&mut machine, 2.0);
    let (mut contact, mut started) = (0.0f64, 0);
    for _ in 0..attempts {
        machine.command(Command::ResetFault).unwrap();
        machine.command(Command::Enable).unwrap();
        for tick in 0..3 * TICK_HZ {
            if tick == TICK_HZ / 5 {
                let asked = [Command::SetHome(Nanometres(0)), Command::MoveBy(Nanometres(3_000_000)), Command::Start];
                started += u32::from(asked.into_iter().all(|command| machine.command(command).is_ok()));
            }
            machine.tick();
            contact = contact.max(machine.process.truth().contact_n);
        }
        assert_eq!(machine.status().fault, Some(Fault::EncoderLost), "seed {seed}");
    }
    (contact, started)
}

#[test]
fn a_head_whose_encoder_is_dead_is_never_started_again_and_never_rams_the_work() {
    for seed in 1..=12 {
        let (contact, started) = started_again(seed, 3);
        assert_eq!(started, 0, "seed {seed}");
        assert!(contact <= CONTACT_N, "seed {seed}: {contact} N");
    }
}

#[test]
fn an_encoder_that_is_connected_again_proves_itself_and_the_head_works_on() {
    for seed in 1..=3 {
        let mut machine = eroding(seed);
        machine.process.happen("encoder.cut", ON).unwrap();
        run_until(&mut machine, 1.0, |machine| machine.status().fault.is_some());
        run(&mut machine, 2.0);
        machine.process.happen("encoder.cut", Value::Flag(false)).unwrap();
        machine.command(Command::ResetFault).unwrap();
        run(&mut machine, 0.1);
        let before = machine.process.truth().position_um;
        machine.command(Command::Enable).unwrap();
        run_until(&mut machine, 0.1, |machine| machine.status().state == State::Ready);
        run(&mut machine, 0.1);
        let moved = machine.process.truth().position_um - before;
        assert!((15.0..80.0).contains(&moved.abs()), "seed {seed}: moved by {moved} um");
        // Where it stood when the counts stopped nobody knows: a new home, and down to the work.
        for command in [Command::SetHome(Nanometres(0)), Command::MoveTo(Nanometres(3_000_000)), Command::Start] {
            machine.command(command).unwrap();
        }
        run_until(&mut machine, 3.0, |machine| machine.status().state == State::Eroding);
    }
}

#[test]
fn an_encoder_that_comes_and_goes_proves_itself_each_time_on_the_same_mark() {
    // A mark lies where the head rests when it has been lifted, and is another count each time.
    for seed in 1..=4 {
        let mut machine = eroding(seed);
        for time in 1..=6 {
            machine.process.happen("encoder.cut", ON).unwrap();
            run_until(&mut machine, 1.0, |machine| machine.status().fault.is_some());
            run(&mut machine, 2.0);
            machine.process.happen("encoder.cut", Value::Flag(false)).unwrap();
            machine.command(Command::ResetFault).unwrap();
            machine.command(Command::Enable).unwrap();
            run(&mut machine, 0.3);
            assert_eq!(machine.status().state, State::Ready, "seed {seed}, time {time}");
            for command in [Command::SetHome(Nanometres(0)), Command::MoveTo(Nanometres(3_000_000)), Command::Start] {
                machine.command(command).unwrap();
            }
            run_until(&mut machine, 3.0, |machine| machine.status().state == State::Eroding);
        }
    }
}

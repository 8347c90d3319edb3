//! Arcs that stay, natively: found within 200 ms of the moment from which there are any, and never without.
//!
//! What there really is, is counted by the process: arcs have had more than their share of all pulses of the last 200 ms
//! (`supervise.arc_percent`) for their time (`supervise.arc_ms`). The head sees one pulse a millisecond. Everything is
//! simulated. The short form runs three seeds; `EDM_SEEDS=20` runs twenty.

use edm_servo_head::head::{Command, Fault, State};
use edm_servo_head::settings::{Settings, Value};
use edm_servo_head::units::{Nanometres, TICK_HZ};
use edm_sim::bore::Setup;
use edm_sim::machine::Machine;
use edm_sim::process::Pulses;
use std::collections::VecDeque;

/// Time in which the head names arcs that stay, ms.
const NAMED_MS: u64 = 200;
/// Window of the shares, ms.
const WINDOW_MS: usize = 200;
/// Pulses in a window that are a share of anything.
const LEAST: u64 = 50;

fn seeds() -> u64 {
    std::env::var("EDM_SEEDS").ok().and_then(|seeds| seeds.parse().ok()).unwrap_or(3)
}

/// What the process knows of its arcs.
#[derive(Default)]
struct Truth {
    counts: VecDeque<Pulses>,
    /// Milliseconds in a row for which arcs have had more than their share.
    above: u64,
    /// Largest share that they have had, %.
    most: f64,
}

impl Truth {
    /// One more millisecond; whether arcs stay.
    fn look(&mut self, now: Pulses, settings: &Settings) -> bool {
        self.counts.push_back(now);
        if self.counts.len() <= WINDOW_MS {
            return false;
        }
        let Some(then) = self.counts.pop_front() else { return false };
        let since = now.since(&then);
        let share = 100.0 * since.arc as f64 / since.total().max(LEAST) as f64;
        self.most = self.most.max(share);
        self.above = if share > f64::from(settings.arc_share) { self.above + 1 } else { 0 };
        self.above > u64::from(settings.arc_ms)
    }
}

/// A head that has begun to erode.
fn eroding(name: &str, seed: u64) -> (Machine, Settings) {
    let setup = Setup::load(name).unwrap();
    let settings = Settings { commissioned: true, ..setup.head };
    let mut machine = Machine::new(setup.process, &settings, seed).unwrap();
    let millimetre = Command::MoveBy(Nanometres(2_000_000));
    (0..200).for_each(|_| machine.tick());
    for command in [Command::SetHome(Nanometres(0)), Command::Enable, millimetre, Command::Start] {
        machine.command(command).unwrap();
    }
    for _ in 0..20 * TICK_HZ {
        machine.tick();
        match machine.status().state {
            State::Eroding => return (machine, settings),
            State::Fault => break,
            _ => {}
        }
    }
    panic!("{name} {seed}: {:?} instead of eroding", machine.status().fault);
}

fn millisecond(machine: &mut Machine) {
    (0..TICK_HZ / 1000).for_each(|_| machine.tick());
}

#[test]
fn arcs_that_stay_are_named_in_time() {
    let mut slowest = 0;
    for name in ["default", "pulses-1khz", "sinker", "sinker-dirty", "silicon"] {
        for percent in [75.0, 90.0, 100.0] {
            for seed in 1..=seeds() {
                let (mut machine, settings) = eroding(name, seed);
                let mut truth = Truth::default();
                let mut arcs_since = None;
                for ms in 0..2000u64 {
                    if ms == 300 {
                        machine.process.happen("gap.arcs_percent", Value::Number(percent)).unwrap();
                    }
                    millisecond(&mut machine);
                    if truth.look(machine.process.truth().pulses, &settings) {
                        arcs_since.get_or_insert(ms);
                    }
                    if machine.status().state == State::Fault {
                        assert_eq!(machine.status().fault, Some(Fault::PersistentArc), "{name} {percent} % {seed}");
                        assert!(ms > 300 + u64::from(settings.arc_ms), "{name} {percent} % {seed}: at {ms} ms");
                        slowest = slowest.max(arcs_since.map_or(0, |since| ms - since));
                        break;
                    }
                    let late = arcs_since.is_some_and(|since| ms > since + NAMED_MS);
                    assert!(!late, "{name} {percent} % {seed}: not named {NAMED_MS} ms after {arcs_since:?}");
                }
                assert_eq!(machine.status().fault, Some(Fault::PersistentArc), "{name} {percent} % {seed}");
            }
        }
    }
    println!("at most {slowest} ms after there were any");
}

#[test]
fn without_arcs_that_stay_none_are_named_in_any_scenario() {
    let scenarios = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios")).unwrap();
    let mut names: Vec<String> =
        scenarios.map(|entry| entry.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned()).collect();
    names.sort();
    for name in names {
        let mut most = 0.0f64;
        for seed in 1..=seeds() {
            let (mut machine, settings) = eroding(&name, seed);
            let mut truth = Truth::default();
            let mut stay = false;
            for _ in 0..2000 {
                millisecond(&mut machine);
                stay |= truth.look(machine.process.truth().pulses, &settings);
                let named = machine.status().fault == Some(Fault::PersistentArc);
                assert!(stay || !named, "{name} {seed}: named with {:.0} % at most", truth.most);
            }
            most = most.max(truth.most);
        }
        println!("{name}: at most {most:.0} % of the pulses of 200 ms were arcs");
    }
}

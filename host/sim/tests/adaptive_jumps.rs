//! Adaptive jumps in a deep hole, natively. Everything is simulated.

use edm_servo_head::head::{Command, State};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{Nanometres, TICK_HZ};
use edm_sim::machine::Machine;
use edm_sim::run::Setup;

/// Erodes the deep hole for 24 s: depth, um, share of arcs, and jumps.
fn erode(seed: u64, set: impl Fn(&mut Settings)) -> (i64, f64, u32) {
    let Setup { mut process, head, .. } = Setup::load("sinker-deep-jumps").unwrap();
    process.installation.surface = 1.5;
    let mut settings = Settings { commissioned: true, ..head };
    set(&mut settings);
    let mut machine = Machine::new(process, &settings, seed).unwrap();
    (0..200).for_each(|_| machine.tick());
    let home = Command::SetHome(Nanometres(0));
    for command in [home, Command::Enable, Command::MoveTo(Nanometres(9_000_000)), Command::Start] {
        machine.command(command).unwrap();
    }
    let found = (0..20 * TICK_HZ).any(|_| {
        machine.tick();
        machine.status().state == State::Eroding
    });
    assert!(found, "{:?}", machine.status());
    let (before, from) = (machine.process.truth().pulses, machine.status().position);
    let (mut jumps, mut last, mut deepest) = (0, State::Eroding, from);
    for _ in 0..24 * TICK_HZ {
        machine.tick();
        let state = machine.status().state;
        jumps += u32::from(state == State::Jumping && last != State::Jumping);
        last = state;
        deepest = deepest.max(machine.status().position);
    }
    assert_eq!(machine.status().fault, None);
    let pulses = machine.process.truth().pulses.since(&before);
    (deepest - from, pulses.arc as f64 / pulses.total() as f64, jumps)
}

#[test]
fn jumps_come_when_the_gap_asks_for_them() {
    for seed in 1..=3 {
        let periodic = erode(seed, |settings| settings.jump_adaptive = 0.0);
        let adaptive = erode(seed, |_| ());
        println!("{seed}: every 4 s {periodic:?}, adaptive {adaptive:?}");
        assert!(adaptive.2 > periodic.2, "seed {seed}: {periodic:?} {adaptive:?}");
        assert!(adaptive.1 < 0.5 * periodic.1, "seed {seed}: {periodic:?} {adaptive:?}");
        assert!(adaptive.0 >= periodic.0, "seed {seed}: {periodic:?} {adaptive:?}");
    }
}

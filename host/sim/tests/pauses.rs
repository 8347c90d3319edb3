//! Pauses between pulses in a native bore: what the head's settings make of the simulated pulse train.

use edm_servo_head::head::{Command, State};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Machine;
use edm_sim::process::Pulses;
use edm_sim::run::Setup;

/// Servo ticks that are looked at: 4 s.
const TICKS: u32 = 80_000;
/// Pulses of `sinker`: on-time, off-time, us.
const PULSE_US: (f64, f64) = (160.0, 40.0);

/// Pulses of an eroding head in a scenario.
fn pulses(name: &str, set: impl Fn(&mut Settings)) -> Pulses {
    let Setup { process: mut plant, head, .. } = Setup::load(name).unwrap();
    let mut settings = Settings { commissioned: true, ..head };
    set(&mut settings);
    plant.installation.surface = 0.5;
    let mut machine = Machine::new(plant, &settings, 1).unwrap();
    (0..100).for_each(|_| machine.tick());
    let target = Command::MoveTo(Nanometres(3_000_000));
    for command in [Command::SetHome(Nanometres(0)), Command::Enable, target, Command::Start] {
        machine.command(command).unwrap();
    }
    let until = (0..200_000).find(|_| {
        machine.tick();
        machine.status().state == State::Eroding
    });
    assert!(until.is_some(), "{:?}", machine.status());
    let before = machine.process.truth().pulses;
    (0..TICKS).for_each(|_| machine.tick());
    assert!(machine.status().fault.is_none(), "{:?}", machine.status().fault);
    machine.process.truth().pulses.since(&before)
}

#[test]
fn the_off_time_after_a_spark_is_longer_by_its_pause() {
    let paused = pulses("sinker", |settings| {
        (settings.generator_off_time_us, settings.generator_pause_spark_us) = (40.0, 30.0);
    });
    // On-time, off-time and pause of every pulse make up the time; retreats with pulses off take a little of it.
    let (on, off) = PULSE_US;
    let us = paused.total() as f64 * (on + off) + paused.spark as f64 * 30.0;
    let share = us / (f64::from(TICKS) * 50.0);
    assert!((0.99..=1.0001).contains(&share), "{share} {paused:?}");
    assert!(paused.spark * 2 > paused.total(), "{paused:?}");
}

#[test]
fn arcs_get_fewer_with_a_pause_after_arcs() {
    let share = |pause_us: f32| {
        let pulses = pulses("sinker-dirty", |settings| settings.generator_pause_arc_us = pause_us);
        (pulses.arc as f64 / pulses.total() as f64, pulses)
    };
    let (without, with) = (share(0.0), share(200.0));
    assert!(without.0 > 0.01 && with.0 < 0.8 * without.0, "{without:?} {with:?}");
    // What a pause after an arc can do is to end its run.
    assert!(with.1.stable_arc * 10 < without.1.stable_arc, "{without:?} {with:?}");
}

#[test]
fn short_pulses_with_a_long_off_time_show_their_gate() {
    // 4 us in 54: one or two conversions, too few to judge a short by.
    let spaced = pulses("micro-blind", |settings| settings.generator_off_time_us = 50.0);
    let us = spaced.total() as f64 * 54.0;
    assert!((0.9..=1.001).contains(&(us / (f64::from(TICKS) * 50.0))), "{spaced:?}");
}

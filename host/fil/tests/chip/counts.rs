//! Counts of pulses on the chip: every gate that falls is one, in the block in which it fell, and in every sum of blocks.
//!
//! `EDM_PULSES` is the number of pulses at each rate.

use crate::common;
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_servo_head::gap::pulses::{Class, WINDOW};
use edm_servo_head::head::{Command, State};
use edm_servo_head::settings::{Declared as _, Settings, Value};
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Rig as _;
use edm_sim::run::Setup;

/// Most pulses of one hole: a deeper one has other pulses, and another seed has them too.
const HOLE: u64 = 50_000;
/// Cycles by which the stamp of an edge may lie beside it: synchronisation and filter of the input, and a transfer.
const STAMP: i64 = 32;
/// Ticks of 1, 100 and 200 ms.
const SPANS: [usize; 3] = [20, 2000, 4000];

/// What a hole has shown.
#[derive(Debug, Default)]
struct Seen {
    pulses: u64,
    /// By class, as the head has them.
    classes: [u64; 6],
    ticks: u64,
}

/// Bores until so many gates have fallen; every sum is checked on the way.
fn hole(image: &Image, name: &str, set: &[(&str, f64)], seed: u64, pulses: u64) -> Seen {
    let Setup { process: mut plant, head, .. } = Setup::load(name).unwrap();
    for (key, value) in set {
        plant.set(&format!("model.{key}"), Value::Number(*value)).unwrap();
    }
    plant.installation.surface = 0.2;
    let settings = Settings { commissioned: true, ..head };
    let mut rig = Emulated::start(image, plant, &settings, seed, Witness::None).unwrap();
    host::begin(&mut rig).unwrap();
    assert_eq!(rig.pulses().unwrap().counted.total(), 0);
    rig.machine_mut().soc().world.falls = Some(Vec::new());
    common::bore(&mut rig, Nanometres(10_000_000));
    let first = rig.pulses().unwrap().counted;
    // The newest block ends at the same moment of every tick. Where that is shows in what it has and has not: from the last gate
    // that counts to the first that does not.
    let (mut earliest, mut latest) = (i64::MIN, i64::MAX);
    let (mut counted, mut fallen) = (first, 0);
    let mut sums = SPANS.map(|span| (span, 0u64, first));
    let (mut looks, mut eroded, mut compared) = (Vec::new(), 0, 0);
    let mut ticks = 0usize;
    let mut rest = 0;
    while rest < 40 {
        rig.tick().unwrap();
        ticks += 1;
        let seen = rig.pulses().unwrap();
        let new = seen.counted.since(&counted);
        counted = seen.counted;
        let total = counted.total() as usize;
        let began = rig.window_began();
        let falls = rig.machine_mut().soc().world.falls.as_deref().unwrap();
        fallen = falls.len() as u64;
        let from = |fall: Option<&u64>| fall.map(|at| at.cast_signed() - began.cast_signed());
        earliest = earliest.max(total.checked_sub(1).and_then(|last| from(falls.get(last))).unwrap_or(i64::MIN));
        latest = latest.min(from(falls.get(total)).unwrap_or(i64::MAX));
        assert!(
            earliest <= latest.saturating_add(STAMP),
            "{name}, seed {seed}, tick {ticks}: {total} counted; from {earliest} to {latest} cycles"
        );
        assert!(new.total() <= 6, "{new:?} in 50 us");
        for (span, sum, before) in &mut sums {
            *sum += u64::from(new.total());
            if ticks.is_multiple_of(*span) {
                assert_eq!(*sum, u64::from(counted.since(before).total()), "{name}: {span} ticks");
                (*sum, *before) = (0, counted);
            }
        }
        // The servo task measures once a millisecond, and the supervision looks once a millisecond: two, and 100 pulses in each.
        let late = counted.since(&seen.looked);
        assert!(late.total() <= 205 && seen.looked.total() as usize <= total, "{name}: {late:?}");
        // Shares are those of the last 176 to 200 ms, and begin anew with every permission.
        eroded = if rig.status().state == State::Eroding { eroded + 1 } else { 0 };
        if ticks.is_multiple_of(20) {
            looks.push(seen.looked);
            if eroded > 20 * (WINDOW + 2) {
                let of = |back: usize| seen.looked.since(&looks[looks.len() - 1 - back]).classes;
                let [least, most] = [of(WINDOW - 25), of(WINDOW + 1)];
                for class in [Class::Open, Class::Spark, Class::Arc, Class::Short, Class::Uncertain] {
                    let share = u32::from(seen.shares[class as usize]);
                    let of = least[class as usize]..=most[class as usize];
                    assert!(of.contains(&share), "{name}, seed {seed}: {class:?} {share} of {of:?} in 200 ms");
                    compared += 1;
                }
            }
        }
        let done = fallen >= pulses;
        if done && rest == 0 {
            rig.command(Command::Hold).unwrap();
            // The ticks in which the command was on its way are not seen one by one.
            let now = rig.pulses().unwrap().counted;
            for (_, sum, _) in &mut sums {
                *sum += u64::from(now.since(&counted).total());
            }
            counted = now;
        }
        rest += u32::from(done);
        let status = rig.status();
        assert!(
            matches!(status.state, State::Seeking | State::Eroding | State::Retreating | State::Jumping) || rest > 0,
            "{name}, seed {seed}: {:?} {:?}",
            status.state,
            status.fault
        );
    }
    // Pulses are off: the last is over, and nothing is on its way.
    let end = rig.pulses().unwrap();
    let fallen = rig.machine_mut().soc().world.falls.as_ref().map_or(fallen, |falls| falls.len() as u64);
    assert_eq!(u64::from(end.counted.total()), fallen, "{name}, seed {seed}");
    assert_eq!(end.looked.total(), end.counted.total(), "{name}, seed {seed}");
    assert_eq!(u64::from(rig.status().gap.pulses.total()), fallen, "{name}, seed {seed}");
    // The generator does not count one that the hold has cut off.
    let made = rig.process_mut().truth().pulses.total();
    assert!(fallen - made <= 1, "{name}, seed {seed}: {fallen} gates, {made} pulses");
    assert!(compared > 100 || ticks < 20_000, "{name}, seed {seed}: shares were compared {compared} times");
    Seen { pulses: fallen, classes: end.counted.classes.map(u64::from), ticks: ticks as u64 }
}

fn counts(name: &str, set: &[(&str, f64)], rate_khz: u64) {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let wanted = std::env::var("EDM_PULSES").ok().and_then(|pulses| pulses.parse().ok());
    // A second of each rate: a push has no time for more.
    let wanted: u64 = wanted.unwrap_or((2000 * rate_khz).clamp(4000, 20_000));
    let mut all = Seen::default();
    for seed in 1.. {
        let seen = hole(&image, name, set, seed, HOLE.min(wanted - all.pulses));
        all.pulses += seen.pulses;
        all.ticks += seen.ticks;
        all.classes.iter_mut().zip(seen.classes).for_each(|(sum, new)| *sum += new);
        if all.pulses >= wanted {
            break;
        }
    }
    assert_eq!(all.classes.iter().sum::<u64>(), all.pulses);
    let rate = all.pulses as f64 / (all.ticks as f64 * 0.05);
    println!("counts: {rate_khz} kHz: {} gates in {} ticks, {rate:.2} a ms; {:?}", all.pulses, all.ticks, all.classes);
}

#[test]
fn every_sum_of_counts_is_that_of_the_gates_at_1_khz() {
    counts("sinker-1khz", &[], 1);
}

#[test]
fn every_sum_of_counts_is_that_of_the_gates_at_5_khz() {
    counts("sinker", &[], 5);
}

#[test]
fn every_sum_of_counts_is_that_of_the_gates_at_25_khz() {
    counts("sinker", &[("on_us", 32.0), ("off_us", 8.0)], 25);
}

#[test]
fn every_sum_of_counts_is_that_of_the_gates_at_100_khz() {
    counts("sinker-100khz", &[], 100);
}

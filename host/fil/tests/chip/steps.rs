//! Step and direction at the pins of the chip: every pulse of a host is counted, at 500 kHz and whichever way it goes.
//!
//! `EDM_STEPS` is the number of pulses.

use crate::common;
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_servo_head::head::Command;
use edm_servo_head::settings::Settings;
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Rig as _;
use edm_sim::process::Plant;
use edm_sim::process::steps::Move;

/// A disabled head on the bus.
fn head() -> Emulated {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let settings = Settings { commissioned: true, ..Settings::default() };
    let mut rig = Emulated::start(&image, Plant::default(), &settings, 1, Witness::None).unwrap();
    host::begin(&mut rig).unwrap();
    rig
}

/// Sends moves and reads 2016h afterwards: steps, rate while they come, turns within a step, times that some were lost.
fn sent(rig: &mut Emulated, moves: &[Move], within: bool) -> [i64; 4] {
    let world = &mut rig.machine_mut().soc().world;
    world.process.steps.turns_within = within;
    moves.iter().for_each(|next| world.process.steps.send(*next));
    let mut rate = 0;
    for ms in 0.. {
        (0..20).for_each(|_| rig.tick().unwrap());
        if ms == 15 {
            rate = host::read(rig, 0x2016, 2).unwrap().cast_signed();
        }
        if rig.process().steps.is_done() {
            break;
        }
    }
    (0..40).for_each(|_| rig.tick().unwrap());
    let [steps, turns, lost] = [1, 3, 4].map(|sub| host::read(rig, 0x2016, sub).unwrap());
    [steps.cast_signed().into(), rate.into(), turns.into(), lost.into()]
}

#[test]
fn no_step_is_lost_at_500_khz() {
    let wanted = std::env::var("EDM_STEPS").ok().and_then(|steps| steps.parse().ok()).unwrap_or(100_000i64);
    let mut rig = head();
    // Three quarters of them down, then up: the sum is half of all.
    let down = wanted * 3 / 4;
    let moves = [Move::Steps(down, 500_000.0), Move::Steps(down - wanted, 500_000.0)];
    let [steps, rate, turns, lost] = sent(&mut rig, &moves, false);
    assert_eq!([steps, turns, lost], [2 * down - wanted, 0, 0]);
    assert_eq!(rig.process().steps.sent(), steps);
    assert!((495_000..=505_000).contains(&rate), "{rate}");
    println!("steps: {wanted} at 500 kHz, none lost");
}

#[test]
fn the_axis_follows_steps_to_the_count() {
    let mut rig = head();
    rig.command(Command::SetHome(Nanometres(0))).unwrap();
    rig.command(Command::Enable).unwrap();
    host::write(&mut rig, 0x6060, 0, 0xFF, 1).unwrap();
    (0..200).for_each(|_| rig.tick().unwrap());
    assert!(rig.process().steps.ready, "the line says that steps are taken");
    let before = host::read(&mut rig, 0x6062, 0).unwrap();
    sent(&mut rig, &[Move::Steps(300, 4000.0), Move::Steps(-100, 3000.0), Move::Steps(1, 10.0)], false);
    (0..1000).for_each(|_| rig.tick().unwrap());
    let [demand, actual] = [0x6062, 0x6064].map(|index| host::read(&mut rig, index, 0).unwrap());
    assert_eq!(demand.wrapping_sub(before), 201);
    assert!((demand as i32 - actual as i32).abs() <= 2, "{demand} {actual}");
}

#[test]
fn a_host_that_turns_at_every_step_is_counted_and_one_that_turns_within_a_step_is_named() {
    let mut rig = head();
    // A turn every 25 us: ten in a plan.
    let turns = (0..1000).map(|turn| Move::Steps(if turn % 3 == 1 { -1 } else { 1 }, 50_000.0)).collect::<Vec<_>>();
    let [steps, _, within, lost] = sent(&mut rig, &turns, false);
    assert_eq!([steps, within, lost], [334, 0, 0]);
    let before = rig.process().steps.sent();
    let [steps, _, within, lost] = sent(&mut rig, &[Move::Steps(-5, 10_000.0), Move::Steps(5, 10_000.0)], true);
    assert_eq!((steps, within, lost), (rig.process().steps.sent(), 2, 0));
    // The first of each five goes the way of the five before.
    assert_eq!(steps - before, 0);
}

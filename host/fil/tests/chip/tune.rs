//! A tuning on the chip: the response is that of the loop, with the ticks that the chip takes from a duty to its pulse.
//!
//! It takes some seconds of the head, minutes on the modelled chip, so that a push leaves it out: `EDM_TUNE=1` runs it.

use crate::common;
use edm_fil::host;
use edm_servo_head::head::{Command, State};
use edm_servo_head::settings::Settings;
use edm_sim::machine::Rig as _;

/// Steps of 201Bh:2.
const FINISHED: u32 = 4;
const ENDED: u32 = 5;

#[test]
fn the_chip_measures_the_response_of_its_loop() {
    if std::env::var_os("EDM_TUNE").is_none() {
        return;
    }
    let mut rig = common::at_rest(4000, |settings| Settings {
        tune_points: 4,
        tune_lowest: 80.0,
        tune_highest: 640.0,
        ..settings
    });
    host::command(&mut rig, Command::Tune).unwrap();
    let step = common::measured(&mut rig, 200, 0x201B, [FINISHED, ENDED]);
    let points = host::read(&mut rig, 0x201B, 4).unwrap();
    println!("tune: step {step}, {points} points, {:.0} um", rig.status().position);
    assert_eq!((step, points, rig.status().fault), (FINISHED, 4, None), "why {:?}", host::read(&mut rig, 0x201B, 3));
    assert_eq!(rig.status().state, State::Ready);
    assert!((3995..=4005).contains(&rig.status().position), "{} um", rig.status().position);
}

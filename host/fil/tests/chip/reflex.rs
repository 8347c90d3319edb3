//! What the reflex does to the bridge of the modelled chip.

use crate::common;
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_hal_shim::bridge::Drive;
use edm_servo_head::head::{Command, State};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Rig as _;
use edm_sim::process::Plant;

/// What the bridge is forced to when a wire falls across the gap of an eroding head.
fn forced(reversed: bool) -> Vec<Drive> {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let settings = Settings { commissioned: true, motor_reversed: reversed, ..Settings::default() };
    // Work close to the stop: the seek is short.
    let plant = Plant::with(&[("wiring.motor_reversed", f64::from(u8::from(reversed))), ("workpiece.surface_mm", 0.3)])
        .unwrap();
    let mut rig = Emulated::start(&image, plant, &settings, 1, Witness::None).unwrap();
    host::begin(&mut rig).unwrap();
    for command in
        [Command::SetHome(Nanometres(0)), Command::Enable, Command::MoveTo(Nanometres(2_000_000)), Command::Start]
    {
        host::command(&mut rig, command).unwrap();
    }
    for _ in 0..40_000 {
        if rig.status().state == State::Eroding {
            break;
        }
        rig.tick().unwrap();
    }
    assert_eq!(rig.status().state, State::Eroding);
    rig.forced().clear();
    rig.process_mut().fault_inputs.short = true;
    for _ in 0..200 {
        rig.tick().unwrap();
    }
    let up = rig.status().velocity.0;
    assert!(up < 0.0, "the head retreats at {up} counts/s");
    rig.forced().clone()
}

#[test]
fn a_retreat_of_the_reflex_leads_away_from_the_work_whichever_way_round_the_motor_is() {
    let up = forced(false);
    assert!(!up.is_empty() && up.iter().all(|drive| *drive == Drive::Duty(-Drive::FULL)), "{up:?}");
    let reversed = forced(true);
    assert!(!reversed.is_empty() && reversed.iter().all(|drive| *drive == Drive::Duty(Drive::FULL)), "{reversed:?}");
}

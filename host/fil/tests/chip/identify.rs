//! An identification on the chip: it finds the machine, to what it states, although its conversions come a tick later than on a PC.
//!
//! It takes a quarter of a minute of the head, minutes on the modelled chip, so that a push leaves it out: `EDM_IDENTIFY=1` runs it.

use crate::common;
use edm_fil::host;
use edm_servo_head::head::{Command, State};
use edm_servo_head::settings::Settings;
use edm_sim::machine::Rig as _;

/// Steps of 2018h:2.
const FINISHED: u32 = 7;
const ENDED: u32 = 8;

#[test]
fn the_chip_identifies_its_machine_within_what_it_states() {
    if std::env::var_os("EDM_IDENTIFY").is_none() {
        return;
    }
    let mut rig = common::at_rest(3000, |settings| Settings {
        axis_resistance: 13.5,
        axis_mass: 0.22,
        axis_force_constant: 7.0,
        ..settings
    });
    host::command(&mut rig, Command::Identify).unwrap();
    let step = common::measured(&mut rig, 300, 0x2018, [FINISHED, ENDED]);
    assert_eq!((step, rig.status().fault), (FINISHED, None), "why {:?}", host::read(&mut rig, 0x2018, 3));
    assert_eq!(rig.status().state, State::Ready);
    for (name, sub, truth, most) in [
        ("resistance", 4, 12_400.0, 0.03),
        ("inductance", 6, 3000.0, 0.1),
        ("constant", 8, 7500.0, 0.03),
        ("mass", 10, 200_000.0, 0.1),
        ("breakaway", 12, 360.0, 0.15),
        ("sliding", 14, 300.0, 0.15),
    ] {
        let [found, off] = [sub, sub + 1].map(|sub| f64::from(host::read(&mut rig, 0x2018, sub).unwrap()));
        println!("identify: {name} {found} +- {off} of {truth}");
        assert!((found - truth).abs() <= most * truth && (found - truth).abs() <= off, "{name}: {found} +- {off}");
    }
}

//! What discharges couple into lines that do not carry them, as the chip converts it.

use crate::common;
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_servo_head::head::State;
use edm_servo_head::settings::{Declared as _, Settings, Value};
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Rig as _;
use edm_sim::process::Plant;

const TICKS: u32 = 4000;

/// What the firmware has of a head that erodes at a gap that stays: the mean of its gap voltage over a millisecond and its bus voltage, V, tick by
/// tick; and how many discharges there were.
fn eroding(values: [f64; 3]) -> (Vec<(f32, f32)>, u64) {
    let mut plant = Plant::default();
    plant.installation.surface = 0.3;
    for (key, value) in ["front_end.spark_v", "front_end.spark_bus_v", "scale.spark_edges"].iter().zip(values) {
        plant.set(key, Value::Number(value)).unwrap();
    }
    let settings = Settings { commissioned: true, ..Settings::default() };
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let mut rig = Emulated::start(&image, plant, &settings, 1, Witness::twin(&settings).unwrap()).unwrap();
    host::begin(&mut rig).unwrap();
    common::bore(&mut rig, Nanometres(1_000_000));
    assert!((0..40_000).any(|_| {
        rig.tick().unwrap();
        rig.status().state == State::Eroding
    }));
    rig.process_mut().hold_gap(30.0, 0.0);
    let before = rig.process().truth().pulses.discharges();
    let seen = (0..TICKS).map(|_| {
        rig.tick().unwrap();
        (rig.status().gap.mean.0, rig.status().bus.0)
    });
    let seen = seen.collect();
    assert_eq!(rig.status().state, State::Eroding, "{values:?}: {:?}", rig.status().fault);
    (seen, rig.process().truth().pulses.discharges() - before)
}

#[test]
fn the_chip_converts_what_a_discharge_couples_into_other_lines() {
    let spread = |volts: &[(f32, f32)]| {
        let [least, most] =
            volts.iter().fold([f32::MAX, 0.0], |[least, most], (_, bus)| [least.min(*bus), most.max(*bus)]);
        most - least
    };
    let (clean, _) = eroding([0.0; 3]);
    let (coupled, discharges) = eroding([20.0, 2.0, 1e-4]);
    assert!(discharges > 500, "{discharges}");
    // Each discharge meets a conversion; 2 V either way are most of 4 V.
    let differ = clean.iter().zip(&coupled).filter(|(a, b)| a.0 != b.0).count();
    assert!(differ > 10, "{differ} of {TICKS}");
    assert!(spread(&clean) < 0.5 && spread(&coupled) > 2.0, "{} V, {} V", spread(&clean), spread(&coupled));
}

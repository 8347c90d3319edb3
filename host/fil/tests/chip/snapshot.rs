//! Going back to a moment: what comes then is what came the first time, whatever was broken in between.

use crate::common;
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_servo_head::head::Command;
use edm_servo_head::settings::Settings;
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Rig as _;
use edm_sim::process::Plant;
use edm_soc::{Frame, Reset};

/// 100 ms: frames of the head, instructions and interrupts so far, where the head is.
fn run(rig: &mut Emulated) -> (Vec<(u64, Frame)>, u64, Vec<u64>, f64, u64) {
    for _ in 0..2000 {
        rig.tick().unwrap();
    }
    let frames = std::iter::from_fn(|| rig.take_timed()).collect();
    let stats = rig.machine().stats();
    let truth = rig.process().truth();
    (frames, stats.instructions, stats.entries.clone(), truth.position_um, truth.pulses.total())
}

#[test]
fn a_machine_that_goes_back_goes_on_as_it_did() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let settings = Settings { commissioned: true, ..Settings::default() };
    let plant = Plant::with(&[("workpiece.surface_mm", 0.05)]).unwrap();
    let mut rig = Emulated::start(&image, plant, &settings, 1, Witness::None).unwrap();
    host::begin(&mut rig).unwrap();
    for command in
        [Command::SetHome(Nanometres(0)), Command::Enable, Command::MoveTo(Nanometres(1_000_000)), Command::Start]
    {
        host::command(&mut rig, command).unwrap();
    }
    for _ in 0..8000 {
        rig.tick().unwrap();
    }
    rig.unwatched();
    while rig.take_timed().is_some() {}
    let moment = rig.snapshot().unwrap();
    let first = run(&mut rig);
    assert!(first.0.len() > 1 && first.4 > 100, "{first:?}");

    rig.restore(&moment).unwrap();
    assert_eq!(run(&mut rig), first);

    // The chip is reset, and its program goes somewhere else.
    rig.machine_mut().soc().ask_reset(Reset::Power);
    rig.process_mut().fault_inputs.short = true;
    run(&mut rig);
    rig.machine_mut().call(0x2000_f000, &[]).unwrap();
    assert_ne!(run(&mut rig), first);
    rig.restore(&moment).unwrap();
    assert_eq!(run(&mut rig), first);
}

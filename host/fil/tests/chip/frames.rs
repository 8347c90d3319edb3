//! Whatever the controller hands on as a frame, the firmware goes on.

use crate::common;
use edm_fil::host::{self, Bus as _};
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_servo_head::settings::Settings;
use edm_sim::process::Plant;
use edm_soc::{Frame, TICK_HZ};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

const MS: u64 = TICK_HZ / 1000;

fn started() -> Emulated {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let settings = Settings { commissioned: true, ..Settings::default() };
    let mut rig = Emulated::start(&image, Plant::default(), &settings, 1, Witness::None).unwrap();
    host::begin(&mut rig).unwrap();
    rig
}

/// The head still runs, and answers.
fn answers(rig: &mut Emulated, after: &str) {
    // A tick that is missed, as by a reset, ends the run.
    let read = host::read(rig, 0x1018, 2);
    assert_eq!(read.unwrap_or_else(|error| panic!("{error:#} after {after}")), 1, "{after}");
}

#[test]
fn every_data_length_code_is_a_frame_of_at_most_eight_bytes() {
    let mut rig = started();
    // Network management for another node, SYNC, an SDO that reads, RPDOs 1 and 2.
    for id in [0x000, 0x080, 0x601, 0x201, 0x301] {
        for length in 0..16 {
            let data = if id == 0x601 { [0x40, 0x18, 0x10, 2, 0, 0, 0, 0] } else { [0x80, 0x7F, 0, 0, 0, 0, 0, 0] };
            rig.send_at(MS / 2, Frame { id, length, data, ..Frame::default() });
            rig.pass().unwrap();
            while rig.take_timed().is_some() {}
        }
        answers(&mut rig, &format!("{id:03x}h"));
    }
}

#[test]
fn an_sdo_of_more_than_eight_by_its_code_is_one_of_eight_bytes() {
    let mut rig = started();
    for length in [8, 9, 15] {
        while rig.take_timed().is_some() {}
        rig.send_at(MS / 2, Frame { id: 0x601, length, data: [0x40, 0x18, 0x10, 2, 0, 0, 0, 0], ..Frame::default() });
        rig.pass().unwrap();
        rig.pass().unwrap();
        let answer = std::iter::from_fn(|| rig.take_timed()).find(|(_, frame)| frame.id == 0x581);
        assert_eq!(answer.unwrap().1.data, [0x43, 0x18, 0x10, 2, 1, 0, 0, 0], "code {length}");
    }
}

#[test]
fn any_register_values_leave_it_running() {
    let mut rig = started();
    let random = &mut Xoshiro256PlusPlus::seed_from_u64(1);
    for burst in 0..100 {
        for _ in 0..random.random_range(1..6) {
            let ours = [0x080, 0x601, 0x201, 0x301, 0x401];
            let frame = Frame {
                id: if random.random() { ours[random.random_range(0..5)] } else { random.random_range(0..0x800) },
                extended: random.random_range(0..8) == 0,
                remote: random.random_range(0..8) == 0,
                length: random.random_range(0..16),
                data: random.random(),
            };
            // Not what switches the node off.
            if frame.id != 0 {
                rig.send_at(random.random_range(0..MS), frame);
            }
        }
        rig.pass().unwrap();
        while rig.take_timed().is_some() {}
        if burst % 10 == 9 {
            answers(&mut rig, &format!("burst {burst}"));
        }
    }
}

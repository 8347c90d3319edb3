//! A head without a node-ID, and what it tells when it is given one.

use crate::rig::Rig;
use edm_hal_shim::store::Loaded;
use edm_servo_head::canopen::drive::DEVICE;
use edm_servo_head::canopen::{BusSettings, Node};
use edm_servo_head::head::Fault;
use edm_servo_head::settings::Settings;
use edm_servo_head::stored::{Outcome, StoredImage};

/// A head whose store cannot be read.
fn damaged() -> Rig {
    let mut rig = Rig::new(|_, _| {});
    let mut image = StoredImage::NOTHING;
    assert_eq!(image.load(Loaded::Newest(&[0x15; 40])), Outcome::Damaged);
    rig.node = Node::new(&DEVICE, BusSettings::at_1_mbit(None), 1);
    rig.drive.restart(Settings { commissioned: true, ..Settings::default() }, &image);
    rig.drive.boot(&mut rig.node, &image).unwrap();
    rig.image = image;
    rig.sent.clear();
    rig.run(100);
    assert!(rig.sent.is_empty(), "{:?}", rig.sent);
    rig
}

/// Names it as `examples/name_heads.py` does; whether it stores that.
fn name(rig: &mut Rig, store: bool) {
    rig.send(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
    rig.send(0x7E5, &[0x11, 5, 0, 0, 0, 0, 0, 0]);
    if store {
        rig.send(0x7E5, &[0x17, 0, 0, 0, 0, 0, 0, 0]);
        rig.run(5);
    }
    rig.send(0x7E5, &[4, 0, 0, 0, 0, 0, 0, 0]);
    rig.run(20);
}

fn emergencies(rig: &Rig) -> Vec<u16> {
    let all = rig.sent.iter().filter(|(_, frame)| frame.id() == 0x85);
    all.map(|(_, frame)| u16::from_le_bytes([frame.data()[0], frame.data()[1]])).collect()
}

#[test]
fn a_head_that_has_lost_what_it_had_stored_says_so_when_it_is_named() {
    for store in [false, true] {
        let mut rig = damaged();
        name(&mut rig, store);
        assert_eq!(emergencies(&rig), [0x6310], "stored {store}");
        assert_ne!(rig.status() & 0x80, 0, "the warning stays until the settings are stored anew: stored {store}");
    }
}

#[test]
fn a_fault_of_a_head_that_waits_for_its_name_is_told_when_it_has_one() {
    let mut rig = damaged();
    rig.machine.raise(Fault::HostSilent);
    rig.run(100);
    name(&mut rig, false);
    assert_eq!(emergencies(&rig).len(), 2, "{:x?}", emergencies(&rig));
    assert_eq!(rig.status() & 0x4F, 0x08);
}

#[test]
fn the_fault_of_a_change_of_bit_rate_is_told_after_it() {
    let mut rig = Rig::ready();
    rig.send(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
    rig.send(0x7E5, &[0x13, 0, 2, 0, 0, 0, 0, 0]);
    rig.send(0x7E5, &[0x15, 10, 0, 0, 0, 0, 0, 0]);
    rig.sent.clear();
    rig.run(100);
    assert_eq!(emergencies(&rig), [0x8130], "the host learns why its head is in a fault");
}

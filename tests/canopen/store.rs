//! Store and restore (CiA 301 7.5.2.13, 7.5.2.14), and the stored form of the communication area.

use crate::bench::{Bench, ID, crc, request, segment};
use crate::machine::*;
use edm_servo_head::canopen::{Abort, BootError, Group, IMAGE, Node, NodeId, Request};

const SAVE: [u8; 4] = *b"save";
const LOAD: [u8; 4] = *b"load";

#[test]
fn the_signature_is_passed_on_and_answered_when_the_device_has_done_it() {
    for (sub, group) in [(1, Group::All), (2, Group::Communication), (3, Group::Application)] {
        let mut bench = Bench::new();
        assert!(bench.sdo(request(0x23, 0x1010, sub, SAVE)).is_empty());
        assert_eq!(bench.machine.requests, [Request::Store(group)]);
        // Erasing flash takes its time.
        assert_eq!(bench.pass(5_000_000), []);
        bench.node.answer(Ok(()), &mut bench.machine);
        assert_eq!(bench.frames()[0].data(), request(0x60, 0x1010, sub, [0; 4]));
        bench.node.answer(Ok(()), &mut bench.machine);
        assert_eq!(bench.frames(), []);
        assert!(bench.sdo(request(0x23, 0x1011, sub, LOAD)).is_empty());
        assert_eq!(bench.machine.requests[1], Request::Restore(group));
        bench.node.answer(Err(Abort::Hardware), &mut bench.machine);
        assert_eq!(bench.frames()[0].data(), request(0x80, 0x1011, sub, 0x0606_0000u32.to_le_bytes()));
    }
}

#[test]
fn a_wrong_signature_or_an_enabled_machine_is_refused() {
    let mut bench = Bench::new();
    assert_eq!(bench.write(0x1010, 1, &LOAD), Err(0x0800_0020));
    assert_eq!(bench.write(0x1011, 1, &SAVE), Err(0x0800_0020));
    assert_eq!(bench.write(0x1010, 1, b"evas"), Err(0x0800_0020));
    assert_eq!(bench.write(0x1010, 4, &SAVE), Err(0x0609_0011));
    assert_eq!(bench.write(0x1010, 1, b"sav"), Err(0x0607_0013));
    bench.machine.enabled = true;
    assert_eq!(bench.write(0x1010, 1, &SAVE), Err(0x0800_0022));
    assert_eq!(bench.machine.requests, []);
}

#[test]
fn segmented_and_block_requests_are_answered_in_kind() {
    let mut bench = Bench::new();
    bench.ask(request(0x21, 0x1010, 1, [4, 0, 0, 0]));
    assert!(bench.sdo(segment(0x07, &SAVE)).is_empty());
    bench.node.answer(Ok(()), &mut bench.machine);
    assert_eq!(bench.frames()[0].data(), segment(0x20, &[]));
    bench.ask(request(0xC6, 0x1010, 1, [4, 0, 0, 0]));
    bench.ask(segment(0x81, &SAVE));
    assert!(bench.sdo(segment(0xC1 | 3 << 2, &crc(&SAVE).to_le_bytes())).is_empty());
    bench.node.answer(Ok(()), &mut bench.machine);
    assert_eq!(bench.frames()[0].data(), segment(0xA1, &[]));
    assert_eq!(bench.machine.requests.len(), 2);
}

#[test]
fn a_host_that_does_not_wait_gets_no_answer_to_what_it_asked_before() {
    let mut bench = Bench::new();
    bench.sdo(request(0x23, 0x1010, 1, SAVE));
    assert_eq!(bench.number(RANGED, 0), 500);
    bench.node.answer(Ok(()), &mut bench.machine);
    assert_eq!(bench.frames(), []);
}

/// A configuration that differs from the defaults in each kind of object.
fn configured() -> Bench {
    let mut bench = Bench::new();
    for (index, sub, bytes, value) in [
        (0x1007, 0, 4, 900),
        (0x1019, 0, 1, 20),
        (0x1006, 0, 4, 2_000),
        (0x1015, 0, 2, 7),
        (0x1016, 3, 4, 9 << 16 | 500),
        (0x1017, 0, 2, 250),
        (0x1029, 1, 1, 1),
        (0x1400, 5, 2, 77),
        (0x1802, 6, 1, 3),
        (0x1802, 3, 2, 11),
        (0x1A02, 0, 1, 0),
        (0x1A02, 1, 4, 0x6064_0020),
        (0x1A02, 2, 4, 0x6041_0010),
        (0x1A02, 0, 1, 2),
        (0x1802, 2, 1, 240),
        (0x1802, 1, 4, 0x4000_03A0),
    ] {
        bench.set(index, sub, bytes, value).unwrap();
    }
    bench
}

#[test]
fn what_was_stored_is_there_after_a_reset() {
    let mut bench = configured();
    let image = bench.node.image();
    bench.send(0, &[130, 0]);
    bench.node.boot(Some(&image), &mut bench.machine).unwrap();
    bench.frames();
    assert_eq!(bench.node.image(), image);
    assert_eq!(bench.number(0x1A02, 2), 0x6041_0010);
    assert_eq!(bench.number(0x1802, 1), 0x4000_03A0);
    assert_eq!(bench.number(0x1016, 3), 9 << 16 | 500);
}

#[test]
fn a_foreign_or_damaged_image_is_refused_whole() {
    let good = configured().node.image();
    let refused = |image: &[u8], id: u8| {
        let mut machine = Machine::new();
        let mut node = Node::new(&DEVICE, NodeId::new(id).unwrap(), 0);
        let result = node.boot(Some(image), &mut machine);
        let mut fresh = Node::new(&DEVICE, NodeId::new(id).unwrap(), 0);
        fresh.boot(None, &mut machine).unwrap();
        assert_eq!(result.is_err(), node.image() == fresh.image());
        result == Err(BootError::Stored)
    };
    assert!(!refused(&good, ID as u8));
    assert!(refused(&good, ID as u8 + 1));
    assert!(refused(&good[..IMAGE - 1], ID as u8));
    assert!(refused(&[], ID as u8));
    for (at, byte) in [
        (0, 2),    // version
        (2, 0x7F), // SYNC at a reserved identifier
        (3, 0xFF),
    ] {
        let mut bad = good;
        bad[at] = byte;
        assert!(refused(&bad, ID as u8), "{at}");
    }
    // A mapping of an object that does not exist.
    let at = good.windows(4).position(|bytes| bytes == 0x6041_0010u32.to_le_bytes()).unwrap();
    let mut bad = good;
    bad[at + 3] = 0x5F;
    assert!(refused(&bad, ID as u8));
}

#[test]
fn a_node_fits_its_memory() {
    // Half of 4 KiB: the other half is for the values of the device.
    assert!(size_of::<Node>() <= 2048, "{}", size_of::<Node>());
}

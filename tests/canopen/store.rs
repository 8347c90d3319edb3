//! Store and restore (CiA 301 7.5.2.13, 7.5.2.14), and booting with stored parameters.

use crate::bench::{Bench, crc, request, segment};
use crate::machine::*;
use edm_servo_head::canopen::{Abort, DataType, Group, Listed, Node, Record, Request, Restored, STORED};

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
        bench.node.answer(Group::All, Ok(()), &mut bench.machine);
        assert_eq!(bench.frames()[0].data(), request(0x60, 0x1010, sub, [0; 4]));
        bench.node.answer(Group::All, Ok(()), &mut bench.machine);
        assert_eq!(bench.frames(), []);
        assert!(bench.sdo(request(0x23, 0x1011, sub, LOAD)).is_empty());
        assert_eq!(bench.machine.requests[1], Request::Restore(group));
        bench.node.answer(Group::All, Err(Abort::Hardware), &mut bench.machine);
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
    bench.node.answer(Group::All, Ok(()), &mut bench.machine);
    assert_eq!(bench.frames()[0].data(), segment(0x20, &[]));
    bench.ask(request(0xC6, 0x1010, 1, [4, 0, 0, 0]));
    bench.ask(segment(0x81, &SAVE));
    assert!(bench.sdo(segment(0xC1 | 3 << 2, &crc(&SAVE).to_le_bytes())).is_empty());
    bench.node.answer(Group::All, Ok(()), &mut bench.machine);
    assert_eq!(bench.frames()[0].data(), segment(0xA1, &[]));
    assert_eq!(bench.machine.requests.len(), 2);
}

#[test]
fn a_host_that_does_not_wait_gets_no_answer_to_what_it_asked_before() {
    let mut bench = Bench::new();
    bench.sdo(request(0x23, 0x1010, 1, SAVE));
    assert_eq!(bench.number(RANGED, 0), 500);
    bench.node.answer(Group::All, Ok(()), &mut bench.machine);
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

/// A node that has booted with these parameters, and what became of them.
fn booted(stored: &[Record]) -> (Bench, Restored) {
    let mut bench = Bench::new();
    bench.send(0, &[130, 0]);
    let restored = bench.node.boot(Some(&mut stored.iter().copied()), &mut bench.machine).unwrap();
    bench.pass(1_000);
    (bench, restored)
}

fn listed(addresses: &[(u16, u8)]) -> Listed {
    let mut listed = Listed::default();
    addresses.iter().for_each(|(index, sub)| listed.add(*index, *sub));
    listed
}

/// The parameters of [`configured`] with another value at one address.
fn with(index: u16, sub: u8, value: u32) -> Vec<Record> {
    let mut stored = parameters(&configured().node);
    stored.iter_mut().find(|r| (r.index, r.sub) == (index, sub)).unwrap().value = value;
    stored
}

#[test]
fn what_was_stored_is_there_after_a_reset_in_whatever_order_it_is_given() {
    let stored = parameters(&configured().node);
    assert_eq!(stored.len(), STORED);
    let reversed: Vec<_> = stored.iter().rev().copied().collect();
    for given in [&stored, &reversed] {
        let (mut bench, restored) = booted(given);
        assert_eq!(restored, Restored::default());
        assert_eq!(parameters(&bench.node), stored);
        assert_eq!(bench.number(0x1A02, 2), 0x6041_0010);
        assert_eq!(bench.number(0x1802, 1), 0x4000_03A0);
        assert_eq!(bench.number(0x1016, 3), 9 << 16 | 500);
    }
}

#[test]
fn a_value_that_is_not_stored_is_the_default_and_named() {
    let stored = parameters(&configured().node);
    let defaults = parameters(&Bench::new().node);
    for (nth, left_out) in stored.iter().enumerate() {
        let mut given = stored.clone();
        given.remove(nth);
        let (bench, restored) = booted(&given);
        let address = (left_out.index, left_out.sub);
        assert_eq!((restored.skipped, restored.defaulted.first), (listed(&[]), Some(address)));
        assert_eq!(parameters(&bench.node)[nth].value & !(1 << 31), defaults[nth].value & !(1 << 31), "{left_out:x?}");
    }
    let (bench, restored) = booted(&[]);
    assert_eq!((restored.defaulted.count, parameters(&bench.node)), (STORED as u16, defaults));
}

#[test]
fn a_value_of_an_object_that_is_not_there_or_not_stored_is_skipped_and_named() {
    let stored = parameters(&configured().node);
    let strange = [(0x1018, 3), (0x1404, 1), (0x1010, 1), (0x1FFF, 0), (0x1017, 1)];
    let records = strange.map(|(index, sub)| Record::new(index, sub, DataType::Unsigned32, 1));
    let (bench, restored) = booted(&[&records[..], &stored].concat());
    assert_eq!(restored, Restored { skipped: listed(&strange), defaulted: listed(&[]) });
    assert_eq!(parameters(&bench.node), stored);
}

#[test]
fn a_value_that_cannot_be_is_the_default_and_named() {
    for (index, sub, value, default) in [
        (0x1005, 0, 0x7F, 0x80),
        (0x1019, 0, 1, 0),
        (0x1029, 1, 3, 0),
        (0x1016, 2, 200 << 16 | 500, 0),
        // A byte has no more than 8 bits.
        (0x1029, 1, 0x101, 0),
    ] {
        let (mut bench, restored) = booted(&with(index, sub, value));
        assert_eq!(restored.defaulted, listed(&[(index, sub)]));
        assert_eq!(bench.number(index, sub), default, "{index:x}:{sub}");
    }
    // Another type than that of the object.
    let mut stored = parameters(&configured().node);
    let heartbeat = stored.iter_mut().find(|r| r.index == 0x1017).unwrap();
    heartbeat.kind = DataType::Unsigned32.code() as u8;
    let (mut bench, restored) = booted(&stored);
    assert_eq!(restored.defaulted, listed(&[(0x1017, 0)]));
    assert_eq!(bench.number(0x1017, 0), u32::from(DEVICE.heartbeat));
}

#[test]
fn no_node_is_watched_twice_whatever_is_stored() {
    let (mut bench, restored) = booted(&with(0x1016, 4, 9 << 16 | 100));
    assert_eq!(restored.defaulted, listed(&[(0x1016, 4)]));
    assert_eq!((bench.number(0x1016, 3), bench.number(0x1016, 4)), (9 << 16 | 500, 0));
}

#[test]
fn a_pdo_that_has_lost_a_value_or_maps_what_is_not_there_is_put_out_of_use() {
    // An identifier and a type that cannot be, an object that does not exist, more entries than there are.
    for (index, sub, value, named) in [
        (0x1802, 1, 0x7FF, (0x1802, 1)),
        (0x1802, 2, 250, (0x1802, 2)),
        (0x1A02, 2, 0x5F41_0010, (0x1A02, 0)),
        (0x1A02, 0, 9, (0x1A02, 0)),
    ] {
        let (mut bench, restored) = booted(&with(index, sub, value));
        assert_eq!(restored.defaulted, listed(&[named]), "{index:x}:{sub}");
        assert_eq!(bench.number(0x1802, 1) >> 31, 1, "{index:x}:{sub}");
        assert_eq!(bench.number(0x1A02, 0), 0);
        // The others are as they were stored.
        assert_eq!(bench.number(0x1801, 1) >> 31, 0);
        assert_eq!(bench.number(0x1400, 5), 77);
    }
}

#[test]
fn a_node_fits_its_memory() {
    // Half of 4 KiB: the other half is for the values of the device.
    assert!(size_of::<Node>() <= 2048, "{}", size_of::<Node>());
}

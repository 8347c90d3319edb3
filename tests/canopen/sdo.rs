//! Expedited and segmented transfers (CiA 301 7.2.4.3.3 to 7.2.4.3.8, abort codes: table 22).

use crate::bench::{Bench, ID, request, segment, word};
use crate::machine::*;
use edm_servo_head::canopen::LONGEST;

#[test]
fn an_expedited_download_is_confirmed_and_can_be_read_back() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask([0x23, 0, 0x20, 0, 100, 0, 0, 0]), [0x60, 0, 0x20, 0, 0, 0, 0, 0]);
    assert_eq!(bench.ask([0x40, 0, 0x20, 0, 0, 0, 0, 0]), [0x43, 0, 0x20, 0, 100, 0, 0, 0]);
    assert_eq!(bench.ask([0x2B, 0x40, 0x60, 0, 0x0F, 0, 0, 0]), [0x60, 0x40, 0x60, 0, 0, 0, 0, 0]);
    assert_eq!(bench.ask([0x40, 0x40, 0x60, 0, 0, 0, 0, 0]), [0x4B, 0x40, 0x60, 0, 0x0F, 0, 0, 0]);
    assert_eq!(bench.ask([0x2F, 6, 0x20, 0, 1, 0, 0, 0])[0], 0x60);
    assert_eq!(bench.ask([0x40, 6, 0x20, 0, 0, 0, 0, 0]), [0x4F, 6, 0x20, 0, 1, 0, 0, 0]);
}

#[test]
fn an_expedited_download_without_a_size_has_that_of_the_object() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask(request(0x22, CONTROL, 0, [0x34, 0x12, 0xFF, 0xFF]))[0], 0x60);
    assert_eq!(bench.machine.value(CONTROL, 0), [0x34, 0x12]);
    assert_eq!(bench.ask(request(0x22, BYTES, 0, [1, 2, 3, 4]))[0], 0x60);
    assert_eq!(bench.machine.value(BYTES, 0), [1, 2, 3, 4]);
    assert_eq!(bench.refusal(request(0x22, LONG, 0, [1, 2, 3, 4])), 0x0607_0013);
}

#[test]
fn each_refusal_has_its_code_and_leaves_the_value() {
    let mut bench = Bench::new();
    let before = bench.machine.values.clone();
    for (request, code) in [
        (request(0x40, 0x2FFF, 0, [0; 4]), 0x0602_0000),
        (request(0x40, 0x0005, 0, [0; 4]), 0x0602_0000),
        (request(0x40, 0x1404, 0, [0; 4]), 0x0602_0000),
        (request(0x40, RANGED, 1, [0; 4]), 0x0609_0011),
        (request(0x40, 0x1018, 5, [0; 4]), 0x0609_0011),
        (request(0x40, WRITE_ONLY, 0, [0; 4]), 0x0601_0001),
        (request(0x2B, READ_ONLY, 0, [0; 4]), 0x0601_0002),
        (request(0x23, 0x1000, 0, [0; 4]), 0x0601_0002),
        (request(0x2F, ARRAY, 0, [0; 4]), 0x0601_0002),
        (request(0x23, 0x2FFF, 0, [0; 4]), 0x0602_0000),
        (request(0x23, CONTROL, 0, [1, 0, 0, 0]), 0x0607_0012),
        (request(0x2F, CONTROL, 0, [1, 0, 0, 0]), 0x0607_0013),
        (request(0x21, CONTROL, 0, [3, 0, 0, 0]), 0x0607_0012),
        (request(0x21, CONTROL, 0, [1, 0, 0, 0]), 0x0607_0013),
        (request(0x21, LONG, 0, [9, 0, 0, 0]), 0x0607_0012),
        (request(0x21, BYTES, 0, [253, 0, 0, 0]), 0x0504_0005),
        (request(0x21, BYTES, 0, [0xFF; 4]), 0x0504_0005),
        (request(0x23, RANGED, 0, [9, 0, 0, 0]), 0x0609_0032),
        (request(0x23, RANGED, 0, [0xE9, 3, 0, 0]), 0x0609_0031),
        (request(0x2F, FLAG, 0, [2, 0, 0, 0]), 0x0609_0030),
        (request(0xE0, RANGED, 0, [0; 4]), 0x0504_0001),
        (request(0x00, RANGED, 0, [0; 4]), 0x0504_0001),
        (request(0x60, RANGED, 0, [0; 4]), 0x0504_0001),
        (request(0xA1, RANGED, 0, [0; 4]), 0x0504_0001),
        (request(0xC1, RANGED, 0, [0; 4]), 0x0504_0001),
    ] {
        assert_eq!(bench.refusal(request), code, "{request:x?}");
    }
    bench.machine.enabled = true;
    assert_eq!(bench.refusal(request(0x23, GUARDED, 0, [1, 0, 0, 0])), 0x0800_0022);
    assert_eq!(bench.machine.values, before);
    // Both ends of the range are inside.
    assert_eq!(bench.set(RANGED, 0, 4, 10), Ok(()));
    assert_eq!(bench.set(RANGED, 0, 4, 1000), Ok(()));
}

#[test]
fn an_abort_names_the_object_it_is_about() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask(request(0x40, 0x2FFF, 3, [0; 4])), [0x80, 0xFF, 0x2F, 3, 0, 0, 2, 6]);
}

#[test]
fn a_segmented_transfer_carries_any_length_both_ways() {
    let mut bench = Bench::new();
    for length in (0..=LONGEST).filter(|length| !matches!(length, 1..=4)) {
        let value: Vec<u8> = (0..length).map(|n| (n * 7 + 1) as u8).collect();
        assert_eq!(bench.write(BYTES, 0, &value), Ok(()), "{length}");
        assert_eq!(bench.machine.value(BYTES, 0), value);
        assert_eq!(bench.read(BYTES, 0).unwrap(), value, "{length}");
    }
    let value = 0x0123_4567_89AB_CDEF_u64.to_le_bytes();
    assert_eq!(bench.write(LONG, 0, &value), Ok(()));
    assert_eq!(bench.read(LONG, 0).unwrap(), value);
    assert_eq!(bench.read(0x1008, 0).unwrap(), b"bench machine");
    let scope = bench.machine.scope();
    assert_eq!(bench.read(SCOPE, 0).unwrap(), scope);
}

#[test]
fn a_segmented_download_may_leave_its_size_open() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask(request(0x20, CONTROL, 0, [0; 4]))[0], 0x60);
    assert_eq!(bench.ask(segment(0x0B, &[0x34, 0x12]))[0], 0x20);
    assert_eq!(bench.machine.value(CONTROL, 0), [0x34, 0x12]);
    // Then it is judged at the end.
    bench.ask(request(0x20, CONTROL, 0, [0; 4]));
    assert_eq!(bench.refusal(segment(0x09, &[1, 2, 3])), 0x0607_0012);
    bench.ask(request(0x20, CONTROL, 0, [0; 4]));
    assert_eq!(bench.refusal(segment(0x0D, &[1])), 0x0607_0013);
    assert_eq!(bench.machine.value(CONTROL, 0), [0x34, 0x12]);
}

#[test]
fn more_or_less_than_announced_is_refused() {
    let mut bench = Bench::new();
    bench.ask(request(0x21, BYTES, 0, [8, 0, 0, 0]));
    bench.ask(segment(0x00, &[1; 7]));
    assert_eq!(bench.refusal(segment(0x1B, &[1, 2])), 0x0607_0012);
    bench.ask(request(0x21, BYTES, 0, [8, 0, 0, 0]));
    assert_eq!(bench.refusal(segment(0x01, &[1; 7])), 0x0607_0013);
    bench.ask(request(0x20, BYTES, 0, [0; 4]));
    for n in 0..36 {
        let toggle = (n % 2) << 4;
        assert_eq!(bench.ask(segment(toggle, &[1; 7]))[0], 0x20 | toggle);
    }
    assert_eq!(bench.refusal(segment(0x00, &[1; 7])), 0x0504_0005);
    assert_eq!(bench.machine.value(BYTES, 0), []);
}

#[test]
fn a_toggle_bit_that_does_not_alternate_ends_the_transfer() {
    let mut bench = Bench::new();
    bench.ask(request(0x21, BYTES, 0, [14, 0, 0, 0]));
    bench.ask(segment(0x00, &[1; 7]));
    assert_eq!(bench.refusal(segment(0x01, &[1; 7])), 0x0503_0000);
    assert_eq!(bench.refusal(segment(0x11, &[1; 7])), 0x0504_0001);
    assert_eq!(bench.machine.value(BYTES, 0), []);

    bench.ask(request(0x40, SCOPE, 0, [0; 4]));
    bench.ask(segment(0x60, &[]));
    assert_eq!(bench.refusal(segment(0x60, &[])), 0x0503_0000);
    assert_eq!(bench.refusal(segment(0x70, &[])), 0x0504_0001);
}

#[test]
fn the_segment_of_another_service_ends_the_transfer() {
    let mut bench = Bench::new();
    bench.ask(request(0x21, BYTES, 0, [14, 0, 0, 0]));
    assert_eq!(bench.ask(segment(0x60, &[])), request(0x80, BYTES, 0, 0x0504_0001u32.to_le_bytes()));
    bench.ask(request(0x40, SCOPE, 0, [0; 4]));
    assert_eq!(bench.ask(segment(0x00, &[1])), request(0x80, SCOPE, 0, 0x0504_0001u32.to_le_bytes()));
}

#[test]
fn an_abort_of_the_client_is_taken_without_an_answer() {
    let mut bench = Bench::new();
    bench.ask(request(0x21, BYTES, 0, [14, 0, 0, 0]));
    assert_eq!(bench.sdo(request(0x80, BYTES, 0, [0; 4])), [[0; 8]; 0]);
    assert_eq!(bench.refusal(segment(0x00, &[1; 7])), 0x0504_0001);
    assert_eq!(bench.sdo(request(0x80, BYTES, 0, [0; 4])), [[0; 8]; 0]);
}

#[test]
fn a_client_that_falls_silent_is_told_so_and_changes_nothing() {
    let mut bench = Bench::new();
    bench.ask(request(0x21, BYTES, 0, [14, 0, 0, 0]));
    bench.ask(segment(0x00, &[1; 7]));
    assert_eq!(bench.pass_for(1_000_000, 0x580 + ID), [[0; 8]; 0]);
    let expected = request(0x80, BYTES, 0, 0x0504_0000u32.to_le_bytes());
    assert_eq!(bench.pass_for(5_000_000, 0x580 + ID), [expected]);
    assert_eq!(bench.machine.value(BYTES, 0), []);
}

#[test]
fn a_new_initiate_replaces_what_was_under_way() {
    let mut bench = Bench::new();
    bench.ask(request(0x21, BYTES, 0, [8, 0, 0, 0]));
    bench.ask(segment(0x00, &[1; 7]));
    // Another master.
    assert_eq!(bench.read(RANGED, 0).unwrap(), 500u32.to_le_bytes());
    // The first one is told, and nothing of its value has arrived.
    assert_eq!(bench.refusal(segment(0x1D, &[1])), 0x0504_0001);
    assert_eq!(bench.machine.value(BYTES, 0), []);
    assert_eq!(bench.write(BYTES, 0, &[9; 8]), Ok(()));
    assert_eq!(bench.machine.value(BYTES, 0), [9; 8]);
}

#[test]
fn a_request_that_is_not_eight_bytes_long_is_none() {
    let mut bench = Bench::new();
    for length in 0..8 {
        assert_eq!(bench.send(0x600 + ID, &[0x40, 0, 0x10, 0, 0, 0, 0, 0][..length]), []);
    }
    assert_eq!(bench.send(0x601 + ID, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]), []);
    assert_eq!(bench.send(0x600 + ID, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]).len(), 1);
}

#[test]
fn the_value_read_is_that_of_the_start() {
    let mut bench = Bench::new();
    bench.machine.set(BYTES, &[1; 10]);
    bench.ask(request(0x40, BYTES, 0, [0; 4]));
    let first = bench.ask(segment(0x60, &[]));
    bench.machine.set(BYTES, &[2; 3]);
    let second = bench.ask(segment(0x70, &[]));
    assert_eq!([&first[..], &second[..]], [&[0x00, 1, 1, 1, 1, 1, 1, 1], &[0x19, 1, 1, 1, 0, 0, 0, 0]]);
}

#[test]
fn a_domain_that_changes_under_way_ends_its_transfer() {
    let mut bench = Bench::new();
    bench.machine.scope_broken_from = 100;
    assert_eq!(bench.read(SCOPE, 0), Err(0x0800_0022));
    bench.machine.enabled = true;
    assert_eq!(word(bench.ask(request(0x40, SCOPE, 0, [0; 4]))), 0x0800_0022);
}

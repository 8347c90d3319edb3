//! Block transfers (CiA 301 7.2.4.3.9 to 7.2.4.3.16).

use crate::bench::{Bench, ID, crc, request, segment, word};
use crate::machine::*;
use edm_servo_head::canopen::{Frame, LONGEST, Time};

/// Writes a value by blocks; the abort code if it is refused.
fn block_write(bench: &mut Bench, index: u16, value: &[u8], announced: Option<u32>, checked: bool) -> Result<(), u32> {
    let command = 0xC0 | u8::from(checked) << 2 | u8::from(announced.is_some()) << 1;
    let answer = bench.ask(request(command, index, 0, announced.unwrap_or(0).to_le_bytes()));
    if answer[0] == 0x80 {
        return Err(word(answer));
    }
    assert_eq!(answer[..4], request(0xA4, index, 0, [0; 4])[..4]);
    let block = usize::from(answer[4]);
    assert!((1..=127).contains(&block));
    let parts: Vec<&[u8]> = if value.is_empty() { vec![&[]] } else { value.chunks(7).collect() };
    for (first, parts_of_block) in parts.chunks(block).enumerate() {
        for (n, part) in (1..).zip(parts_of_block) {
            let last = (first * block + usize::from(n)) == parts.len();
            let answers = bench.sdo(segment(n | u8::from(last) << 7, part));
            match (answers.first(), last || usize::from(n) == block) {
                (Some(answer), _) if answer[0] == 0x80 => return Err(word(*answer)),
                (Some(answer), true) => assert_eq!(*answer, segment(0xA2, &[n, block as u8])),
                (answer, end) => assert_eq!((answer, end), (None, false)),
            }
        }
    }
    let unused = (parts.len() * 7 - value.len()) as u8;
    let answer = bench.ask(segment(0xC1 | unused << 2, &crc(value).to_le_bytes()));
    if answer[0] == 0x80 {
        return Err(word(answer));
    }
    assert_eq!(answer, segment(0xA1, &[]));
    Ok(())
}

/// Everything that comes until the node waits for us.
fn segments(bench: &mut Bench, first: Vec<[u8; 8]>) -> Vec<[u8; 8]> {
    let mut all = first;
    all.extend(bench.pass_for(60_000, 0x580 + ID).into_iter().map(|data| <[u8; 8]>::try_from(data).unwrap()));
    all
}

/// Reads a value by blocks of `block` segments. `keep` says whether a segment, numbered over the transfer, arrives.
fn block_read(bench: &mut Bench, index: u16, block: u8, mut keep: impl FnMut(usize) -> bool) -> Result<Vec<u8>, u32> {
    let answer = bench.ask(request(0xA4, index, 0, [block, 0, 0, 0]));
    if answer[0] == 0x80 {
        return Err(word(answer));
    }
    assert_eq!(answer[0], 0xC6);
    let length = word(answer) as usize;
    let (mut value, mut count, mut next) = (vec![], 0, segment(0xA3, &[]));
    loop {
        let first = bench.sdo(next);
        let (mut good, mut complete) = (0, false);
        for part in segments(bench, first) {
            if part[0] == 0x80 && part[1..3] == index.to_le_bytes() {
                return Err(word(part));
            }
            count += 1;
            if keep(count) && part[0] & 0x7F == good + 1 {
                good += 1;
                value.extend(&part[1..]);
                complete = part[0] & 0x80 != 0;
            }
        }
        next = segment(0xA2, &[good, block]);
        if complete {
            break;
        }
    }
    let end = bench.ask(next);
    assert_eq!(end[0] & 0xE3, 0xC1);
    value.truncate(value.len() - usize::from(end[0] >> 2 & 7));
    assert_eq!((value.len(), crc(&value)), (length, u16::from_le_bytes([end[1], end[2]])));
    assert_eq!(bench.sdo(segment(0xA1, &[])), [[0; 8]; 0]);
    Ok(value)
}

#[test]
fn a_block_download_carries_any_length_with_and_without_size_and_checksum() {
    let mut bench = Bench::new();
    for length in 0..=LONGEST {
        let value: Vec<u8> = (0..length).map(|n| (n * 11 + length) as u8).collect();
        let announced = (length % 2 == 0).then_some(length as u32);
        assert_eq!(block_write(&mut bench, BYTES, &value, announced, length % 3 != 0), Ok(()), "{length}");
        assert_eq!(bench.machine.value(BYTES, 0), value);
    }
    assert_eq!(block_write(&mut bench, RANGED, &77u32.to_le_bytes(), Some(4), true), Ok(()));
    assert_eq!(bench.number(RANGED, 0), 77);
}

#[test]
fn a_block_download_is_refused_like_any_other() {
    let mut bench = Bench::new();
    let before = bench.machine.values.clone();
    for (index, length, announced, code) in [
        (BYTES, 253, Some(253), 0x0504_0005),
        (BYTES, 253, None, 0x0504_0005),
        (BYTES, 8, Some(9), 0x0607_0013),
        (BYTES, 8, Some(7), 0x0607_0012),
        (CONTROL, 3, Some(3), 0x0607_0012),
        (CONTROL, 3, None, 0x0607_0012),
        (CONTROL, 1, None, 0x0607_0013),
        (READ_ONLY, 2, Some(2), 0x0601_0002),
        (0x2FFF, 2, Some(2), 0x0602_0000),
        (RANGED, 4, Some(4), 0x0609_0031),
        (NAME, 101, Some(101), 0x0607_0012),
    ] {
        let value = vec![0xFF; length];
        assert_eq!(block_write(&mut bench, index, &value, announced, true), Err(code), "{index:x} {length}");
    }
    assert_eq!(bench.machine.values, before);
}

#[test]
fn a_wrong_checksum_is_refused_and_changes_nothing() {
    let mut bench = Bench::new();
    bench.ask(request(0xC6, BYTES, 0, [10, 0, 0, 0]));
    bench.sdo(segment(1, &[5; 7]));
    bench.sdo(segment(0x82, &[5; 3]));
    let wrong = crc(&[5; 10]) ^ 1;
    assert_eq!(bench.refusal(segment(0xC1 | 4 << 2, &wrong.to_le_bytes())), 0x0504_0004);
    assert!(bench.machine.value(BYTES, 0).is_empty());
    // A client without checksums is believed.
    bench.ask(request(0xC2, BYTES, 0, [10, 0, 0, 0]));
    bench.sdo(segment(1, &[5; 7]));
    bench.sdo(segment(0x82, &[5; 3]));
    assert_eq!(bench.ask(segment(0xC1 | 4 << 2, &wrong.to_le_bytes()))[0], 0xA1);
}

#[test]
fn segments_lost_on_the_way_to_the_node_are_asked_for_again() {
    let mut bench = Bench::new();
    let value: Vec<u8> = (0..100).collect();
    let parts: Vec<&[u8]> = value.chunks(7).collect();
    bench.ask(request(0xC6, BYTES, 0, [100, 0, 0, 0]));
    // Number 4 is lost, 5 to 15 arrive for nothing.
    for n in (1..=14u8).filter(|n| *n != 4) {
        assert!(bench.sdo(segment(n, parts[usize::from(n) - 1])).is_empty());
    }
    assert_eq!(bench.ask(segment(0x80 | 15, parts[14])), segment(0xA2, &[3, 31]));
    for (n, part) in (1..).zip(&parts[3..14]) {
        assert!(bench.sdo(segment(n, part)).is_empty());
    }
    assert_eq!(bench.ask(segment(0x80 | 12, parts[14])), segment(0xA2, &[12, 31]));
    assert_eq!(bench.ask(segment(0xC1 | 5 << 2, &crc(&value).to_le_bytes()))[0], 0xA1);
    assert_eq!(bench.machine.value(BYTES, 0), value);
}

#[test]
fn an_impossible_segment_number_or_an_early_end_stops_a_block_download() {
    for command in [0x00, 0x20 | 0x40, 0x7F, 0xA1, 0xC1, 0xFF] {
        let mut bench = Bench::new();
        bench.ask(request(0xC6, BYTES, 0, [100, 0, 0, 0]));
        bench.sdo(segment(1, &[1; 7]));
        assert_eq!(bench.refusal(segment(command, &[])), 0x0504_0003, "{command:x}");
        assert!(bench.machine.value(BYTES, 0).is_empty());
    }
}

#[test]
fn another_master_can_begin_in_the_middle_of_a_block() {
    for (other, answer) in [(0x40, 0x43), (0x23, 0x60), (0xA0, 0xC6), (0xC0, 0xA4)] {
        let mut bench = Bench::new();
        bench.ask(request(0xC6, BYTES, 0, [100, 0, 0, 0]));
        bench.sdo(segment(1, &[1; 7]));
        assert_eq!(bench.ask(request(other, RANGED, 0, [50, 0, 0, 0]))[0], answer, "{other:x}");
        assert!(bench.machine.value(BYTES, 0).is_empty());
    }
}

#[test]
fn a_client_can_abort_within_a_block_of_either_direction() {
    let mut bench = Bench::new();
    bench.ask(request(0xC6, BYTES, 0, [100, 0, 0, 0]));
    bench.sdo(segment(1, &[1; 7]));
    assert!(bench.sdo(request(0x80, BYTES, 0, [0; 4])).is_empty());
    assert_eq!(bench.refusal(segment(2, &[])), 0x0504_0001);
    bench.ask(request(0xA4, SCOPE, 0, [127, 0, 0, 0]));
    assert!(!bench.sdo(segment(0xA3, &[])).is_empty());
    bench.sdo(request(0x80, SCOPE, 0, [0; 4]));
    assert_eq!(bench.pass_for(2_000_000, 0x580 + ID), [[0; 8]; 0]);
}

#[test]
fn segments_that_wait_for_the_bus_go_with_their_transfer() {
    for next in [request(0x80, SCOPE, 0, [0; 4]), request(0x40, RANGED, 0, [0; 4])] {
        let mut bench = Bench::new();
        bench.ask(request(0xA4, SCOPE, 0, [127, 0, 0, 0]));
        let start = Frame::new(0x600 + ID, &segment(0xA3, &[])).unwrap();
        bench.node.receive(&start, Time(bench.now), &mut bench.machine);
        assert!(bench.sdo(next).iter().all(|answer| answer[0] == 0x43));
    }
}

#[test]
fn a_block_upload_carries_any_length_at_any_block_size() {
    let mut bench = Bench::new();
    for length in [0, 1, 6, 7, 8, 13, 14, 15, 100, 888, 889, 890, 896, 5000] {
        bench.machine.scope_length = length;
        for block in [1, 2, 7, 126, 127] {
            if block > 2 || length < 1000 {
                let value = block_read(&mut bench, SCOPE, block, |_| true);
                assert_eq!(value.unwrap(), bench.machine.scope(), "{length} {block}");
            }
        }
    }
    assert_eq!(block_read(&mut bench, 0x1008, 127, |_| true).unwrap(), b"bench machine");
    assert_eq!(block_read(&mut bench, RANGED, 127, |_| true).unwrap(), 500u32.to_le_bytes());
}

#[test]
fn segments_lost_on_the_way_to_the_client_are_sent_again() {
    let mut bench = Bench::new();
    bench.machine.scope_length = 3000;
    for lost in [1, 5, 20, 100, 428, 429] {
        let value = block_read(&mut bench, SCOPE, 20, |n| n != lost).unwrap();
        assert_eq!(value, bench.machine.scope(), "{lost}");
    }
    let value = block_read(&mut bench, SCOPE, 50, |n| n % 3 != 0).unwrap();
    assert_eq!(value, bench.machine.scope());
}

#[test]
fn a_block_upload_is_refused_like_any_other() {
    let mut bench = Bench::new();
    for (index, block, code) in
        [(SCOPE, 0, 0x0504_0002), (SCOPE, 128, 0x0504_0002), (WRITE_ONLY, 127, 0x0601_0001), (0x2FFF, 127, 0x0602_0000)]
    {
        assert_eq!(bench.refusal(request(0xA4, index, 0, [block, 0, 0, 0])), code, "{index:x} {block}");
    }
    bench.machine.scope_broken_from = 300;
    assert_eq!(block_read(&mut bench, SCOPE, 127, |_| true), Err(0x0800_0022));
    assert_eq!(block_read(&mut bench, SCOPE, 2, |_| true), Err(0x0800_0022));
}

#[test]
fn an_impossible_acknowledgement_ends_a_block_upload() {
    for (next, code) in [
        (segment(0xA2, &[6, 5]), 0x0504_0003),
        (segment(0xA2, &[5, 0]), 0x0504_0002),
        (segment(0xA2, &[5, 128]), 0x0504_0002),
        (segment(0xA1, &[]), 0x0504_0001),
        (segment(0xA3, &[]), 0x0504_0001),
        (segment(0x60, &[]), 0x0504_0001),
    ] {
        let mut bench = Bench::new();
        bench.ask(request(0xA4, SCOPE, 0, [5, 0, 0, 0]));
        assert_eq!(bench.sdo(segment(0xA3, &[])).len(), 5);
        assert_eq!(bench.refusal(next), code, "{next:x?}");
        assert_eq!(bench.pass_for(2_000_000, 0x580 + ID), [[0; 8]; 0]);
    }
}

#[test]
fn an_acknowledgement_before_the_segments_is_out_of_place() {
    let mut bench = Bench::new();
    bench.ask(request(0xA4, SCOPE, 0, [127, 0, 0, 0]));
    assert_eq!(bench.refusal(segment(0xA2, &[0, 127])), 0x0504_0001);
    bench.ask(request(0xA4, SCOPE, 0, [127, 0, 0, 0]));
    bench.sdo(segment(0xA3, &[]));
    assert_eq!(bench.refusal(segment(0xA2, &[1, 127])), 0x0504_0001);
}

#[test]
fn a_short_value_goes_the_ordinary_way_if_the_client_would_rather() {
    let mut bench = Bench::new();
    bench.machine.set(BYTES, &[1; 20]);
    assert_eq!(bench.ask(request(0xA4, BYTES, 0, [127, 19, 0, 0]))[0], 0xC6);
    assert_eq!(bench.ask(request(0xA4, BYTES, 0, [127, 20, 0, 0])), request(0x41, BYTES, 0, [20, 0, 0, 0]));
    assert_eq!(bench.ask(segment(0x60, &[])), segment(0x00, &[1; 7]));
    assert_eq!(bench.ask(request(0xA4, RANGED, 0, [127, 4, 0, 0]))[0], 0x43);
}

#[test]
fn a_silent_client_ends_a_block_transfer_of_either_direction() {
    let expected = |index| [request(0x80, index, 0, 0x0504_0000u32.to_le_bytes())];
    let mut bench = Bench::new();
    bench.ask(request(0xC6, BYTES, 0, [100, 0, 0, 0]));
    bench.sdo(segment(1, &[1; 7]));
    assert_eq!(bench.pass_for(3_000_000, 0x580 + ID), expected(BYTES));
    bench.ask(request(0xA4, SCOPE, 0, [3, 0, 0, 0]));
    assert_eq!(bench.sdo(segment(0xA3, &[])).len(), 3);
    assert_eq!(bench.pass_for(3_000_000, 0x580 + ID), expected(SCOPE));
}

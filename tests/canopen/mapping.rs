//! Mapping and parameters of PDOs (CiA 301 7.5.2.35 to 7.5.2.38).

use crate::bench::{Bench, ID};
use crate::machine::*;
use edm_servo_head::canopen::mapped;

const INVALID: u32 = 1 << 31;

/// As python canopen and other masters do it.
fn remap(bench: &mut Bench, pdo: u16, transmission: u32, entries: &[u32]) -> Result<(), u32> {
    let id = bench.number(pdo, 1) & !INVALID;
    bench.set(pdo, 1, 4, id | INVALID)?;
    bench.set(pdo, 2, 1, transmission)?;
    bench.set(pdo + 0x200, 0, 1, 0)?;
    for (sub, entry) in (1..).zip(entries) {
        bench.set(pdo + 0x200, sub, 4, *entry)?;
    }
    bench.set(pdo + 0x200, 0, 1, entries.len() as u32)?;
    bench.set(pdo, 1, 4, id)
}

#[test]
fn a_remapped_pdo_carries_its_objects_in_their_order() {
    let mut bench = Bench::new();
    let entries = [mapped(CONTROL, 0, 16), mapped(WRITE_ONLY, 0, 8), mapped(5, 0, 8), mapped(TARGET, 0, 32)];
    assert_eq!(remap(&mut bench, 0x1402, 255, &entries), Ok(()));
    let entries = [mapped(STATUS, 0, 16), mapped(0x1001, 0, 8), mapped(ARRAY, 8, 16)];
    assert_eq!(remap(&mut bench, 0x1802, 255, &entries), Ok(()));
    bench.send(0, &[1, 0]);
    bench.send(0x400 + ID, &[0x0F, 0x01, 7, 99, 1, 2, 3, 4]);
    assert_eq!(bench.machine.value(CONTROL, 0), [0x0F, 0x01]);
    assert_eq!(bench.machine.value(WRITE_ONLY, 0), [7]);
    assert_eq!(bench.machine.value(TARGET, 0), [1, 2, 3, 4]);
    bench.machine.set(STATUS, &[0x37, 0x02]);
    bench.set(ARRAY, 8, 2, 0xFFFE).unwrap();
    bench.node.emergency(0x5530, 0x20, [0; 5]);
    assert_eq!(bench.pass_for(1_000, 0x380 + ID), [[0x37, 0x02, 0x21, 0xFE, 0xFF]]);
}

#[test]
fn a_mapping_changes_only_while_the_pdo_is_out_of_use_and_counts_no_entries() {
    let mut bench = Bench::new();
    let entry = mapped(TARGET, 0, 32);
    assert_eq!(bench.set(0x1600, 0, 1, 0), Err(0x0800_0022));
    assert_eq!(bench.set(0x1600, 1, 4, entry), Err(0x0800_0022));
    let id = bench.number(0x1400, 1);
    bench.set(0x1400, 1, 4, id | INVALID).unwrap();
    assert_eq!(bench.set(0x1600, 1, 4, entry), Err(0x0800_0022));
    bench.set(0x1600, 0, 1, 0).unwrap();
    assert_eq!(bench.set(0x1600, 1, 4, entry), Ok(()));
    assert_eq!(bench.set(0x1600, 0, 1, 1), Ok(()));
    assert_eq!(bench.number(0x1600, 1), entry);
}

#[test]
fn what_cannot_be_mapped_is_refused_where_it_is_entered() {
    let mut bench = Bench::new();
    for (map, entry, code) in [
        (0x1602, mapped(STATUS, 0, 16), 0x0604_0041),
        (0x1602, mapped(READ_ONLY, 0, 16), 0x0604_0041),
        (0x1602, mapped(NAME, 0, 64), 0x0604_0041),
        (0x1602, mapped(FLAG, 0, 8), 0x0604_0041),
        (0x1602, mapped(GUARDED, 0, 32), 0x0604_0041),
        (0x1602, mapped(0x1001, 0, 8), 0x0604_0041),
        (0x1602, mapped(0x1017, 0, 16), 0x0604_0041),
        (0x1602, mapped(TARGET, 0, 16), 0x0604_0041),
        (0x1602, mapped(TARGET, 0, 31), 0x0604_0041),
        (0x1602, mapped(5, 0, 16), 0x0604_0041),
        (0x1602, mapped(0x2FFF, 0, 16), 0x0602_0000),
        (0x1602, mapped(0x000F, 0, 16), 0x0602_0000),
        (0x1602, mapped(ARRAY, 9, 16), 0x0609_0011),
        (0x1A02, mapped(CONTROL, 0, 16), 0x0604_0041),
        (0x1A02, mapped(WRITE_ONLY, 0, 8), 0x0604_0041),
        (0x1A02, mapped(5, 0, 8), 0x0604_0041),
        (0x1A02, mapped(0x1003, 1, 32), 0x0604_0041),
    ] {
        assert_eq!(bench.set(map, 1, 4, entry), Err(code), "{map:x} {entry:x}");
        assert_eq!(bench.number(map, 1), 0);
    }
}

#[test]
fn a_pdo_holds_64_bits_and_not_one_more() {
    let mut bench = Bench::new();
    for sub in 1..=8 {
        bench.set(0x1602, sub, 4, mapped(ARRAY, sub, 16)).unwrap();
    }
    assert_eq!(bench.set(0x1602, 0, 1, 5), Err(0x0604_0042));
    assert_eq!(bench.set(0x1602, 0, 1, 9), Err(0x0604_0042));
    assert_eq!(bench.set(0x1602, 0, 1, 254), Err(0x0604_0042));
    assert_eq!(bench.number(0x1602, 0), 0);
    assert_eq!(bench.set(0x1602, 0, 1, 4), Ok(()));
    // Entries that are counted have to be there.
    assert_eq!(bench.set(0x1603, 0, 1, 1), Err(0x0602_0000));
    assert_eq!(remap(&mut bench, 0x1803, 1, &[mapped(LONG, 0, 64)]), Ok(()));
    assert_eq!(remap(&mut bench, 0x1803, 1, &[mapped(LONG, 0, 64), mapped(0x1001, 0, 8)]), Err(0x0604_0042));
}

#[test]
fn an_identifier_in_use_can_only_be_put_out_of_use() {
    let mut bench = Bench::new();
    for pdo in [0x1400, 0x1800] {
        let id = bench.number(pdo, 1);
        assert_eq!(bench.set(pdo, 1, 4, id + 1), Err(0x0800_0022));
        assert_eq!(bench.set(pdo, 1, 4, id + 0x100), Err(0x0800_0022));
        assert_eq!(bench.set(pdo, 1, 4, id), Ok(()));
        assert_eq!(bench.set(pdo, 1, 4, id | INVALID), Ok(()));
        assert_eq!(bench.set(pdo, 1, 4, 0x185), Ok(()));
        for reserved in [0, 0x7F, 0x101, 0x180, 0x5A0, 0x620, 0x6E0, 0x720, 0x780, 0x2000_0185, 0x1000_0185] {
            assert_eq!(bench.set(pdo, 1, 4, reserved | INVALID), Err(0x0609_0030), "{reserved:x}");
        }
        assert_eq!(bench.number(pdo, 1), 0x185);
    }
}

#[test]
fn inhibit_time_and_start_value_change_only_out_of_use_and_the_event_timer_always() {
    let mut bench = Bench::new();
    assert_eq!(bench.set(0x1800, 3, 2, 10), Err(0x0800_0022));
    assert_eq!(bench.set(0x1800, 6, 1, 10), Err(0x0800_0022));
    assert_eq!(bench.set(0x1800, 5, 2, 10), Ok(()));
    assert_eq!(bench.set(0x1400, 5, 2, 10), Ok(()));
    assert_eq!(bench.set(0x1802, 3, 2, 10), Ok(()));
    assert_eq!(bench.set(0x1802, 6, 1, 240), Ok(()));
    assert_eq!(bench.set(0x1802, 6, 1, 241), Err(0x0609_0030));
    assert_eq!(bench.read(0x1400, 3), Err(0x0609_0011));
}

#[test]
fn transmission_types_that_are_reserved_or_need_remote_frames_are_refused() {
    let mut bench = Bench::new();
    for pdo in [0x1402, 0x1802] {
        for value in 0..=255 {
            let expected = if matches!(value, 241..=253) { Err(0x0609_0030) } else { Ok(()) };
            assert_eq!(bench.set(pdo, 2, 1, value), expected);
        }
    }
}

#[test]
fn a_mapping_is_looked_up_once_and_not_with_every_frame() {
    let mut bench = Bench::operational();
    let before = bench.machine.searches.get();
    for n in 0..100u8 {
        bench.send(0x200 + ID, &[n, 0]);
        bench.machine.set(STATUS, &[n, 1]);
        bench.send(0x80, &[]);
        bench.pass(1_000);
    }
    assert_eq!(bench.machine.searches.get(), before);
}

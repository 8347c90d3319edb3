//! The objects of the communication area that are neither PDO nor heartbeat (CiA 301 7.5.2).

use crate::bench::{Bench, ID};
use crate::machine::*;
use edm_servo_head::canopen::{Access, DefaultValue, own_objects};

#[test]
fn every_described_object_reads_as_its_default() {
    let mut bench = Bench::new();
    for object in own_objects(&DEVICE) {
        if object.access == Access::WriteOnly {
            // An update of the program is not read back.
            assert_eq!((object.index, bench.read(object.index, object.sub)), (0x1F50, Err(0x0601_0001)));
            continue;
        }
        let value = bench.read(object.index, object.sub);
        match object.default {
            DefaultValue::Text(text) => assert_eq!(value.unwrap(), text.as_bytes()),
            DefaultValue::Unknown if object.index == 0x1003 => assert_eq!(value, Err(0x0800_0024)),
            DefaultValue::Unknown if object.index == 0x1F56 => assert_eq!(value.unwrap(), [0; 4]),
            DefaultValue::Unknown => assert_eq!((object.index, object.sub, bench.number(0x1018, 4)), (0x1018, 4, 7)),
            default => {
                let expected = match default {
                    DefaultValue::NodeId(base) => i64::from(base) + i64::from(ID),
                    DefaultValue::Number(number) => number,
                    other => panic!("{other:?}"),
                };
                let value = value.unwrap();
                assert_eq!(value.len(), object.kind.size().unwrap());
                assert_eq!(i64::from(bench.number(object.index, object.sub)), expected, "{:x}", object.index);
            }
        }
    }
}

#[test]
fn every_writable_object_takes_its_own_value_back() {
    let mut bench = Bench::new();
    // 1F51h orders what its value says: tests/canopen/update.rs.
    let all = own_objects(&DEVICE).filter(|object| object.access == Access::ReadWrite && object.index != 0x1F51);
    for object in all {
        let value = bench.read(object.index, object.sub).unwrap();
        let in_use = matches!(object.index, 0x1600 | 0x1601 | 0x1A00 | 0x1A01 | 0x1800 | 0x1801);
        let expected = match (object.index, object.sub) {
            // These take nothing but their signature.
            (0x1010 | 0x1011, _) => Err(0x0800_0020),
            // In use.
            (0x1600.., sub) if in_use && sub != 1 && sub != 2 && sub != 5 => Err(0x0800_0022),
            (0x1600..=0x1601 | 0x1A00..=0x1A01, _) => Err(0x0800_0022),
            _ => Ok(()),
        };
        assert_eq!(bench.write(object.index, object.sub, &value), expected, "{:x}:{}", object.index, object.sub);
    }
}

#[test]
fn what_is_read_only_stays_so() {
    let mut bench = Bench::new();
    for object in own_objects(&DEVICE).filter(|object| !object.access.writable()) {
        let value = vec![0; object.kind.size().unwrap_or(5)];
        assert_eq!(bench.write(object.index, object.sub, &value), Err(0x0601_0002), "{:x}", object.index);
    }
}

#[test]
fn identifiers_can_be_put_out_of_use_changed_and_put_back() {
    let mut bench = Bench::new();
    let valid = 0x80 + u32::from(ID);
    assert_eq!(bench.set(0x1014, 0, 4, 0x90), Err(0x0800_0022));
    assert_eq!(bench.set(0x1014, 0, 4, 0x8000_0000 | valid), Ok(()));
    assert_eq!(bench.set(0x1014, 0, 4, 0x90), Ok(()));
    bench.node.emergency(0x5530, 0, [1, 2, 3, 4, 5]);
    assert_eq!(bench.pass_for(1_000, 0x90), [[0x30, 0x55, 0x01, 1, 2, 3, 4, 5]]);
    for reserved in [0x0, 0x7F, 0x101, 0x180, 0x581, 0x601, 0x6E0, 0x701, 0x7FF, 0x2000_0090, 0x890] {
        assert_eq!(bench.set(0x1014, 0, 4, 0x8000_0000 | reserved), Err(0x0609_0030), "{reserved:x}");
        assert_eq!(bench.set(0x1005, 0, 4, reserved), Err(0x0609_0030), "{reserved:x}");
    }
    // No producer of SYNC.
    assert_eq!(bench.set(0x1005, 0, 4, 0x4000_0080), Err(0x0609_0030));
    assert_eq!(bench.number(0x1005, 0), 0x80);
    assert_eq!(bench.number(0x1014, 0), 0x90);
}

#[test]
fn an_emergency_out_of_use_is_remembered_but_not_sent() {
    let mut bench = Bench::new();
    bench.set(0x1014, 0, 4, 0x8000_0080 + u32::from(ID)).unwrap();
    bench.node.emergency(0x5530, 0, [0; 5]);
    assert_eq!(bench.pass(1_000_000), []);
    assert_eq!((bench.number(0x1003, 0), bench.number(0x1003, 1)), (1, 0x5530));
}

#[test]
fn the_inhibit_time_spaces_emergencies() {
    let mut bench = Bench::new();
    bench.set(0x1015, 0, 2, 100).unwrap();
    bench.node.emergency(0x3210, 4, [0; 5]);
    bench.node.emergency(0x2310, 2, [0; 5]);
    bench.node.emergency_over(0);
    let sent = bench.pass(100_000);
    let codes: Vec<_> = sent.iter().map(|(_, frame)| (frame.data()[..3]).to_vec()).collect();
    assert_eq!(codes, [[0x10, 0x32, 5], [0x10, 0x23, 7], [0, 0, 0]]);
    assert!(sent.windows(2).all(|pair| pair[1].0 - pair[0].0 == 10_000));
}

#[test]
fn the_list_of_errors_can_only_be_cleared() {
    let mut bench = Bench::new();
    bench.node.emergency(0x3210, 4, [0; 5]);
    bench.node.emergency(0x2310, 2, [0; 5]);
    let list: Vec<_> = (0..3).map(|sub| bench.number(0x1003, sub)).collect();
    assert_eq!(list, [2, 0x2310, 0x3210]);
    assert_eq!(bench.set(0x1003, 0, 1, 1), Err(0x0609_0030));
    assert_eq!(bench.set(0x1003, 1, 4, 0), Err(0x0601_0002));
    assert_eq!(bench.set(0x1003, 0, 1, 0), Ok(()));
    assert_eq!(bench.number(0x1003, 0), 0);
    assert_eq!(bench.read(0x1003, 1), Err(0x0800_0024));
    // The errors themselves are still there.
    assert_eq!(bench.number(0x1001, 0), 7);
}

#[test]
fn errors_of_the_device_outlast_a_reset_of_communication_but_not_of_the_node() {
    for (command, register) in [(130, 5), (129, 0)] {
        let mut bench = Bench::new();
        bench.node.emergency(0x3210, 4, [0; 5]);
        bench.pass(1_000);
        bench.send(0, &[command, 0]);
        bench.node.boot(None, &mut bench.machine).unwrap();
        bench.frames();
        assert_eq!(bench.number(0x1001, 0), register);
        assert_eq!(bench.number(0x1003, 0), u32::from(register != 0));
    }
}

#[test]
fn the_counter_overflow_changes_only_while_no_period_is_set() {
    let mut bench = Bench::new();
    bench.set(0x1006, 0, 4, 1_000).unwrap();
    assert_eq!(bench.set(0x1019, 0, 1, 10), Err(0x0800_0022));
    bench.set(0x1006, 0, 4, 0).unwrap();
    assert_eq!(bench.set(0x1019, 0, 1, 10), Ok(()));
    for wrong in [1, 241, 255] {
        assert_eq!(bench.set(0x1019, 0, 1, wrong), Err(0x0609_0030));
    }
}

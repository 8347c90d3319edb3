//! The dictionary as a master finds it is the one that the data sheet describes.

use crate::rig::Rig;
use edm_describe::everything;
use edm_servo_head::canopen::DefaultValue;

#[test]
fn every_object_of_the_data_sheet_answers_as_it_says() {
    let mut rig = Rig::new(|_, _| {});
    let (mut numbers, mut refused) = (0, 0);
    for d in everything() {
        let place = format!("{:04x}:{:02x}", d.index, d.sub);
        if !d.access.readable() {
            assert_eq!(rig.try_read(d.index, d.sub), Err(0x0601_0001), "{place}");
            refused += 1;
            continue;
        }
        // Texts and domains are longer than what is read here.
        let Some(size) = d.kind.size().filter(|size| *size <= 4) else { continue };
        let mask = u32::MAX >> (32 - 8 * size);
        let value = rig.try_read(d.index, d.sub);
        let expected = match d.default {
            // Past errors: none.
            DefaultValue::Unknown if d.index == 0x1003 => {
                assert_eq!(value, Err(0x0800_0024), "{place}");
                continue;
            }
            DefaultValue::Unknown => None,
            DefaultValue::Number(number) => Some(number as u32 & mask),
            DefaultValue::NodeId(base) => Some(base + 5),
            DefaultValue::Real(number) => Some(number.to_bits()),
            DefaultValue::Text(_) => None,
        };
        let value = value.unwrap_or_else(|abort| panic!("{place}: {abort:#010x}"));
        // The rig's head has passed its commissioning.
        let passed = d.object == "commission" && d.name == "passed";
        if let (Some(expected), false) = (expected, passed) {
            assert_eq!(value & mask, expected, "{place}");
            numbers += 1;
        }
    }
    assert!(numbers > 200 && refused > 3, "{numbers} compared, {refused} write-only");
}

#[test]
fn what_the_data_sheet_does_not_have_is_not_there() {
    let mut rig = Rig::new(|_, _| {});
    let places: std::collections::BTreeSet<(u16, u8)> = everything().map(|d| (d.index, d.sub)).collect();
    for index in (0x1FF0..0x2120).chain(0x6030..0x6110).chain(0x6500..0x6510) {
        let highest = places.range((index, 0)..=(index, 255)).last().map(|(_, sub)| *sub);
        let (sub, abort) = highest.map_or((0, 0x0602_0000), |highest| (highest + 1, 0x0609_0011));
        assert_eq!(rig.try_read(index, sub), Err(abort), "{index:04x}:{sub:02x}");
    }
}

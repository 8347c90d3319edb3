//! What the head senses of its gap, live: in process data, in the scope, and the ignition delays in both kinds of uploads.

use crate::rig::{ID, Rig};
use edm_servo_head::gap::pulses::Class;
use edm_servo_head::gap::senses::delays::BINS;
use edm_servo_head::head::{State, Status};

/// Objects and their bits, as four PDOs carry them.
const MAPS: [&[u32]; 4] = [
    // Open, sparks.
    &[0x2012_0B20, 0x2012_0C20],
    // Arcs, shorts.
    &[0x2012_0D20, 0x2012_0E20],
    // Hazard, its deviation, notch frequency.
    &[0x2012_0220, 0x2012_0310, 0x2012_0910],
    // Uncertain, distance, age.
    &[0x2012_0F20, 0x2012_0410, 0x2012_0810],
];
/// 50.12 Hz, and it follows.
const NOTCH: u32 = 1 << 31 | 5012;

/// A rig that erodes, with the notch at [`NOTCH`].
fn eroding() -> Rig {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.write(0x2001, 1, &[1]);
    rig.write32(0x607A, 0, 4000);
    rig.control(0x1F);
    rig.until(20_000, |rig| rig.machine.status().state == State::Eroding);
    rig.drive.set_slow(BINS, NOTCH);
    rig
}

/// Data of the four PDOs for a status, in the units of the objects.
fn expected(status: &Status) -> [[u8; 8]; 4] {
    let count = |class| status.gap.pulses.class(class);
    let hazard = status.senses.hazard.unwrap();
    let deviation = (hazard.variance.sqrt() * 1000.0) as u16;
    let distance = (status.senses.distance.unwrap().gap.0 * 100.0) as u16;
    let pair = |a: u32, b: u32| u64::from(a) | u64::from(b) << 32;
    let words = |a: u32, b: u16, c: u16| pair(a, u32::from(b) | u32::from(c) << 16);
    [
        pair(count(Class::Open), count(Class::Spark)),
        pair(count(Class::Arc), count(Class::Short)),
        words(hazard.rate as u32, deviation, 5012),
        words(count(Class::Uncertain), distance, status.senses.age),
    ]
    .map(u64::to_le_bytes)
}

#[test]
fn what_the_head_senses_goes_in_process_data_as_it_is() {
    let mut rig = eroding();
    for (number, objects) in (0..).zip(MAPS) {
        let id = 0x180 + 0x100 * i32::from(number) + i32::from(ID);
        rig.write32(0x1800 + number, 1, i32::MIN | id);
        rig.write(0x1A00 + number, 0, &[0]);
        for (sub, object) in (1..).zip(objects) {
            rig.write32(0x1A00 + number, sub, *object as i32);
        }
        rig.write(0x1A00 + number, 0, &[objects.len() as u8]);
        // When it changes, at any time, and every 5 ms.
        rig.write(0x1800 + number, 2, &[255]);
        rig.write(0x1800 + number, 3, &[0, 0]);
        rig.write(0x1800 + number, 5, &[5, 0]);
        rig.write32(0x1800 + number, 1, id);
    }
    let (mut came, mut first) = ([0; 4], None);
    for _ in 0..1000 {
        let status = *rig.machine.status();
        rig.sent.clear();
        rig.step();
        let expected = expected(&status);
        first.get_or_insert(expected);
        for (_, frame) in &rig.sent {
            let Some(number) = (0..4u16).find(|n| frame.id() == 0x180 + 0x100 * n + u16::from(ID)) else { continue };
            let number = usize::from(number);
            assert_eq!(frame.data(), expected[number], "TPDO {}", number + 1);
            came[number] += 1;
        }
    }
    assert!(came.iter().all(|frames| *frames >= 200), "{came:?}");
    let last = expected(rig.machine.status());
    assert!((0..4).all(|number| first.unwrap()[number] != last[number]), "{first:?} {last:?}");
}

#[test]
fn what_the_head_senses_is_recorded_by_its_scope() {
    let mut rig = eroding();
    for (sub, object) in (1..).zip([0x0020_1202, 0x0020_1204, 0x0020_120C, 0x0020_1206]) {
        rig.write32(0x2010, sub, object);
    }
    rig.write(0x2010, 5, &[1, 0]);
    rig.write(0x2010, 6, &[0]);
    rig.write(0x2010, 8, &[1]);
    let sparks: Vec<u32> = (0..300)
        .map(|_| {
            rig.step();
            rig.machine.status().gap.pulses.class(Class::Spark)
        })
        .collect();
    assert_eq!(rig.read(0x2010, 9), 3, "full");
    let record = rig.upload(0x2010, 11);
    assert_eq!(record.len(), 256 * 16);
    let signal = |place: usize| -> Vec<u32> {
        record.chunks(16).map(|s| u32::from_le_bytes(s[4 * place..][..4].try_into().unwrap())).collect()
    };
    // Each of them as the milliseconds had it, one after the other.
    let counted = signal(2);
    assert!(sparks.windows(200).any(|ms| *ms == counted[50..250]), "{counted:?} {sparks:?}");
    assert!(signal(0).iter().all(|hazard| (100..1_000_000).contains(hazard)), "{:?}", signal(0));
    assert!(signal(1).iter().all(|distance| *distance == 8061), "the longest of the polynomial: {:?}", signal(1));
    assert!(signal(3).iter().all(|sparks| (300..5100).contains(sparks)), "{:?}", signal(3));
}

#[test]
fn the_ignition_delays_are_read_in_segments_and_by_blocks() {
    let mut rig = Rig::new(|_, _| {});
    let bytes = |counts: [u32; BINS]| counts.map(u32::to_le_bytes).concat();
    let read = |rig: &mut Rig| {
        let whole = rig.upload(0x2012, 17);
        for block in [1, 7, 127] {
            assert_eq!(rig.block_upload(0x2012, 17, block), whole, "blocks of {block}");
        }
        whole
    };
    assert_eq!(read(&mut rig), bytes([0; BINS]));
    let count = |bin: usize| 0x1234_5678u32.wrapping_mul(bin as u32 + 1);
    (0..BINS).for_each(|bin| rig.drive.set_slow(bin, count(bin)));
    assert_eq!(read(&mut rig), bytes([0; BINS]), "not taken yet");
    rig.write(0x2012, 16, &[1]);
    assert_eq!(read(&mut rig), bytes(std::array::from_fn(count)));
    // From then on, also of counts that wrap.
    (0..BINS).for_each(|bin| rig.drive.set_slow(bin, count(bin).wrapping_add(u32::MAX - bin as u32)));
    assert_eq!(read(&mut rig), bytes(std::array::from_fn(count)), "the copy stays");
    rig.write(0x2012, 16, &[1]);
    assert_eq!(read(&mut rig), bytes(std::array::from_fn(|bin| u32::MAX - bin as u32)));
    assert_eq!(rig.try_write(0x2012, 16, &[2]), Err(0x0609_0031));
}

#[test]
fn pauses_are_counted() {
    let mut rig = Rig::new(|_, _| {});
    rig.drive.set_pauses(u32::MAX - 1);
    assert_eq!(rig.read(0x2012, 18), u32::MAX - 1);
}

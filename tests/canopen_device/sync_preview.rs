//! What the drive tells a head that hears of a SYNC before it does.

use crate::rig::Rig;
use edm_servo_head::canopen::Time;
use edm_servo_head::canopen::drive::{Order, SetPoint};
use edm_servo_head::head::Command;
use edm_servo_head::units::Nanometres;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Follows the set points of RPDO2, in force with SYNC.
fn cyclic() -> Rig {
    let mut rig = Rig::ready();
    rig.write(0x1401, 2, &[1]);
    rig.mode(8);
    while rig.drive.take().is_some() {}
    assert!(!rig.drive.preview_sync(&rig.node), "nothing has come");
    rig
}

fn set_point(rig: &mut Rig, target: i32) {
    rig.send(0x305, &target.to_le_bytes());
}

fn point(target: i64) -> Option<SetPoint> {
    Some(SetPoint { to: Nanometres(target * 1000), ticks: 20 })
}

/// SYNC as the chip deals with it; what is then ordered.
fn sync(rig: &mut Rig) -> Option<Order> {
    let now = Time(rig.ms * 1000);
    rig.send(0x80, &[]);
    if rig.node.synchronised(now, &mut rig.drive).is_some() {
        rig.drive.synchronised();
    }
    rig.drive.take()
}

#[test]
fn a_set_point_is_foreseen_when_its_rpdo_has_come_and_not_ordered_once_more() {
    let mut rig = cyclic();
    for target in [1700, 1710, 1710] {
        set_point(&mut rig, target);
        assert!(rig.drive.preview_sync(&rig.node));
        assert_eq!(rig.drive.sync_preview(), point(target.into()));
        assert!(!rig.drive.preview_sync(&rig.node), "told once");
        assert_eq!(rig.drive.take(), None, "SYNC has not come");
        assert_eq!(sync(&mut rig), None, "the head has done it");
        assert!(!rig.drive.preview_sync(&rig.node));
    }
    assert_eq!(sync(&mut rig), None, "nothing new has come");
    // Only the newest counts.
    set_point(&mut rig, 1500);
    set_point(&mut rig, 1600);
    assert!(rig.drive.preview_sync(&rig.node));
    assert_eq!(rig.drive.sync_preview(), point(1600));
}

#[test]
fn it_is_cut_off_at_the_limits_as_it_would_be_later() {
    let mut rig = cyclic();
    rig.write32(0x607D, 2, 1500);
    set_point(&mut rig, 1600);
    assert!(rig.drive.preview_sync(&rig.node));
    assert_eq!(rig.drive.sync_preview(), point(1500));
    assert_eq!(sync(&mut rig), None);
}

#[test]
fn what_has_changed_before_sync_is_ordered_as_it_is_then() {
    let mut rig = cyclic();
    set_point(&mut rig, 1700);
    assert!(rig.drive.preview_sync(&rig.node));
    // A cycle of 2 ms from now on, and nobody has looked once more.
    rig.write(0x60C2, 1, &[2]);
    let ordered = sync(&mut rig);
    assert_eq!(ordered, Some(Order::Command(Command::Follow(Nanometres(1_700_000), 40))));
}

#[test]
fn it_is_taken_back_when_the_set_point_no_longer_holds() {
    let takes_back: [fn(&mut Rig); 4] = [
        |rig| rig.control(0x010F),
        |rig| rig.write(0x6060, 0, &[1]),
        |rig| rig.send(0, &[128, 5]),
        |rig| rig.write(0x2001, 1, &[1]),
    ];
    for (n, take_back) in takes_back.into_iter().enumerate() {
        let mut rig = cyclic();
        set_point(&mut rig, 1700);
        assert!(rig.drive.preview_sync(&rig.node));
        take_back(&mut rig);
        while rig.drive.take().is_some() {}
        assert!(rig.drive.preview_sync(&rig.node), "{n}");
        assert_eq!(rig.drive.sync_preview(), None, "{n}");
    }
}

#[test]
fn a_sync_that_changes_something_else_as_well_waits_for_the_drive() {
    let mut rig = cyclic();
    rig.write32(0x1401, 1, i32::MIN | 0x305);
    rig.write(0x1601, 0, &[0]);
    rig.write32(0x1601, 1, 0x6040_0010);
    rig.write32(0x1601, 2, 0x607A_0020);
    rig.write(0x1601, 0, &[2]);
    rig.write32(0x1401, 1, 0x305);
    let content = |word: u16, target: i32| [&word.to_le_bytes()[..], &target.to_le_bytes()].concat();
    // The controlword stays.
    rig.send(0x305, &content(0x000F, 1700));
    assert!(rig.drive.preview_sync(&rig.node));
    assert_eq!(rig.drive.sync_preview(), point(1700));
    assert_eq!(sync(&mut rig), None);
    // It halts.
    rig.send(0x305, &content(0x010F, 1710));
    assert!(!rig.drive.preview_sync(&rig.node));
    assert_eq!(rig.drive.sync_preview(), None);
    assert!(matches!(sync(&mut rig), Some(Order::Command(Command::Brake(_)))));
    assert_eq!(rig.drive.take(), None, "it stays halted");
    // It goes on.
    rig.send(0x305, &content(0x000F, 1720));
    assert!(!rig.drive.preview_sync(&rig.node));
    assert_eq!(sync(&mut rig), point(1720).map(|point| Order::Command(point.command())));
}

#[test]
fn a_set_point_by_sdo_is_ordered_though_the_same_is_foreseen() {
    let mut rig = cyclic();
    set_point(&mut rig, 1700);
    assert!(rig.drive.preview_sync(&rig.node));
    // Up to the millisecond of the answer, which hands orders on, nothing has come of SYNC.
    rig.write32(0x607A, 0, 1700);
    assert!(!rig.drive.preview_sync(&rig.node));
    assert_eq!(rig.machine.status().state, edm_servo_head::head::State::Positioning);
}

#[test]
fn a_sync_of_the_wrong_length_releases_nothing() {
    let mut rig = cyclic();
    assert_eq!(rig.node.sync_length(), 0);
    set_point(&mut rig, 1700);
    assert!(rig.drive.preview_sync(&rig.node));
    rig.send(0x80, &[1]);
    assert_eq!(rig.node.synchronised(Time(rig.ms * 1000), &mut rig.drive), None);
    assert_eq!(rig.drive.sync_preview(), point(1700), "it still waits");
    rig.send(0, &[128, 5]);
    rig.write(0x1019, 0, &[10]);
    assert_eq!(rig.node.sync_length(), 1);
}

/// A frame as a host of a stream may send it, and now and then another.
fn frame(random: &mut Xoshiro256PlusPlus, target: &mut i32) -> (u16, Vec<u8>) {
    let mut pick = |bound: u32| random.random_range(0..bound) as usize;
    let write = |index: u16, sub: u8, value: i32, bytes: u8| {
        let [low, high] = index.to_le_bytes();
        let head = [0x23 | (4 - bytes) << 2, low, high, sub];
        (0x605, [head, value.to_le_bytes()].concat())
    };
    match pick(64) {
        0..20 => {
            *target += pick(21) as i32 - 10;
            (0x305, target.to_le_bytes().to_vec())
        }
        20..44 => (0x80, if pick(20) == 0 { vec![1] } else { vec![] }),
        44..54 => {
            let word = [0x0F, 0x0F, 0x0F, 0x0F, 0x07, 0x1F, 0x010F, 0x02][pick(8)];
            (0x205, u16::to_le_bytes(word).to_vec())
        }
        54 => write(0x607A, 0, *target + pick(3) as i32, 4),
        55 => write(0x6060, 0, [8, 8, 8, 1, 7, 0][pick(6)], 1),
        56 => write(0x60C2, 1, 1 + pick(3) as i32, 1),
        57 => write(0x607D, 1 + pick(2) as u8, *target + pick(101) as i32 - 50, 4),
        58 => write(0x607D, 2, 10_000, 4),
        59 => write(0x2001, 1, [0, 0, 0, 1][pick(4)], 1),
        60 => write(0x1400, 2, [255, 1][pick(2)], 1),
        61 => write(0x1401, 2, [1, 1, 1, 255, 0, 240][pick(6)], 1),
        62 => (0, vec![128, 5]),
        _ => (0, vec![1, 5]),
    }
}

#[test]
fn whatever_a_host_sends_what_is_released_is_what_would_be_ordered() {
    let mut released = [0; 2];
    for seed in 0..20 {
        let random = &mut Xoshiro256PlusPlus::seed_from_u64(seed);
        let (mut plain, mut early) = (cyclic(), cyclic());
        let mut target = plain.position() as i32;
        for n in 0..5000 {
            let (id, data) = frame(random, &mut target);
            for rig in [&mut plain, &mut early] {
                rig.send(id, &data);
            }
            let sync_preview = early.drive.sync_preview();
            let now = Time(plain.ms * 1000);
            let synchronised = plain.node.synchronised(now, &mut plain.drive);
            assert_eq!(synchronised, early.node.synchronised(now, &mut early.drive));
            let mut orders = [Vec::new(), Vec::new()];
            if synchronised.is_some() {
                early.drive.synchronised();
                orders[1].extend(sync_preview.map(|point| Order::Command(point.command())));
                released[usize::from(sync_preview.is_some())] += 1;
            }
            for (rig, orders) in [&mut plain, &mut early].into_iter().zip(&mut orders) {
                orders.extend(core::iter::from_fn(|| rig.drive.take()));
                orders.iter().for_each(|order| rig.carry_out(*order));
            }
            assert_eq!(
                orders[0], orders[1],
                "seed {seed}, frame {n}: {id:03x}h {data:x?}, sync_preview {sync_preview:?}"
            );
            early.drive.preview_sync(&early.node);
            if random.random_range(0..4) == 0 {
                plain.step();
                early.step();
                early.drive.preview_sync(&early.node);
            }
            // What a fault or a wrong step of the state machine has ended begins anew.
            if n % 100 == 99 {
                for rig in [&mut plain, &mut early] {
                    // The answers to the frames before, and the reaction to a fault, which lasts until the head stands.
                    rig.run(60);
                    rig.send(0, &[1, 5]);
                    rig.write(0x6060, 0, &[8]);
                    for word in [0x80u16, 0x06, 0x07, 0x0F] {
                        rig.control(word);
                    }
                }
                early.drive.preview_sync(&early.node);
            }
        }
    }
    assert!(released.iter().all(|count| *count > 1000), "without and with a set point: {released:?}");
}

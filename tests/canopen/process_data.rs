//! PDOs and SYNC at work (CiA 301 7.2.2, 7.2.5, 7.5.2.35, 7.5.2.37).

use crate::bench::{Bench, ID};
use crate::machine::*;
use edm_servo_head::canopen::{Event, Time};

const RPDO1: u16 = 0x200 + ID;
const RPDO2: u16 = 0x300 + ID;
const TPDO1: u16 = 0x180 + ID;
const TPDO2: u16 = 0x280 + ID;
const EMERGENCY: u16 = 0x80 + ID;
const SYNC: u16 = 0x80;

/// Out of use, one parameter changed, and back.
fn set_parked(bench: &mut Bench, pdo: u16, sub: u8, bytes: usize, value: u32) {
    let id = bench.number(pdo, 1);
    bench.set(pdo, 1, 4, id | 1 << 31).unwrap();
    bench.set(pdo, sub, bytes, value).unwrap();
    bench.set(pdo, 1, 4, id).unwrap();
}

fn target(bench: &Bench) -> i32 {
    i32::from_le_bytes(bench.machine.value(TARGET, 0).try_into().unwrap())
}

#[test]
fn event_driven_tpdos_leave_on_entering_operational_on_change_and_by_their_timer() {
    let mut bench = Bench::new();
    bench.send(0, &[1, 0]);
    assert_eq!(bench.pass_for(1_000, TPDO1), [[0, 0]]);
    let times: Vec<_> = bench.pass(200_000).into_iter().map(|(time, _)| time).collect();
    assert_eq!(times.len(), 4);
    assert!(times.windows(2).all(|pair| pair[1] - pair[0] == 50_000));
    bench.pass(10_000);
    bench.machine.set(STATUS, &[0x37, 0x06]);
    assert_eq!(bench.pass_for(1_000, TPDO1), [[0x37, 0x06]]);
    // The timer starts again.
    assert_eq!(bench.pass_for(49_000, TPDO1), [[0; 2]; 0]);
    assert_eq!(bench.pass_for(1_000, TPDO1).len(), 1);
}

#[test]
fn the_inhibit_time_delays_a_change_but_does_not_lose_it() {
    let mut bench = Bench::operational();
    set_parked(&mut bench, 0x1800, 3, 2, 100);
    bench.pass(1_000);
    for n in 1..=9 {
        bench.machine.set(STATUS, &[n, 0]);
        assert_eq!(bench.pass_for(1_000, TPDO1), [[0; 2]; 0], "{n}");
    }
    assert_eq!(bench.pass_for(1_000, TPDO1), [[9, 0]]);
}

#[test]
fn a_timer_of_zero_leaves_changes_alone() {
    let mut bench = Bench::operational();
    bench.set(0x1800, 5, 2, 0).unwrap();
    bench.pass(1_000);
    assert_eq!(bench.pass_for(10_000_000, TPDO1), [[0; 2]; 0]);
}

#[test]
fn a_cyclic_tpdo_leaves_with_every_nth_sync() {
    for (transmission, expected) in [(1, 24), (2, 12), (7, 3), (240, 0)] {
        let mut bench = Bench::operational();
        bench.set(0x1801, 2, 1, transmission).unwrap();
        let sent: Vec<_> = (1..=24).filter(|_| !bench.send(SYNC, &[]).is_empty()).collect();
        assert_eq!(sent.len(), expected, "{transmission}");
        assert!(sent.iter().all(|n| n % transmission == 0), "{transmission}: {sent:?}");
    }
}

#[test]
fn an_acyclic_tpdo_leaves_with_the_sync_after_a_change() {
    let mut bench = Bench::operational();
    bench.set(0x1801, 2, 1, 0).unwrap();
    bench.pass(10_000);
    assert_eq!(bench.send(SYNC, &[]).len(), 1);
    assert_eq!(bench.send(SYNC, &[]).len(), 0);
    bench.machine.set(POSITION, &[1, 2, 3, 4]);
    assert_eq!(bench.pass_for(10_000, TPDO2), [[0; 4]; 0]);
    assert_eq!(bench.send(SYNC, &[])[0].data(), [1, 2, 3, 4]);
    assert_eq!(bench.send(SYNC, &[]).len(), 0);
}

#[test]
fn the_start_value_names_the_sync_that_counts_first() {
    let mut bench = Bench::operational();
    bench.set(0x1019, 0, 1, 4).unwrap();
    set_parked(&mut bench, 0x1801, 6, 1, 3);
    bench.set(0x1801, 2, 1, 2).unwrap();
    let counters = [1, 2, 3, 4].into_iter().cycle().take(12).enumerate();
    let sent: Vec<_> = counters.filter(|(_, counter)| !bench.send(SYNC, &[*counter]).is_empty()).collect();
    assert_eq!(sent, [(3, 4), (5, 2), (7, 4), (9, 2), (11, 4)]);
}

#[test]
fn an_asynchronous_rpdo_acts_at_once() {
    let mut bench = Bench::operational();
    bench.send(RPDO1, &[0x0F, 0]);
    assert_eq!(bench.machine.value(CONTROL, 0), [0x0F, 0]);
}

#[test]
fn a_synchronous_rpdo_acts_at_the_tick_after_the_sync_behind_it() {
    let mut bench = Bench::operational();
    bench.send(RPDO2, &5i32.to_le_bytes());
    assert_eq!(bench.tick(), None);
    assert_eq!(target(&bench), 0);
    bench.now += 100;
    bench.send(SYNC, &[]);
    let sync = Time(bench.now);
    // A tick that began before the SYNC came does not act on it.
    assert_eq!(bench.node.synchronised(Time(bench.now - 1), &mut bench.machine), None);
    assert_eq!(target(&bench), 0);
    // What comes now belongs to the next SYNC.
    bench.send(RPDO2, &6i32.to_le_bytes());
    bench.now += 50;
    assert_eq!(bench.tick(), Some(sync));
    assert_eq!(target(&bench), 5);
    assert_eq!(bench.tick(), None);
    bench.send(SYNC, &[]);
    bench.tick();
    assert_eq!(target(&bench), 6);
    // A SYNC without a new set point changes nothing.
    bench.machine.set(TARGET, &9i32.to_le_bytes());
    bench.send(SYNC, &[]);
    assert!(bench.tick().is_some());
    assert_eq!(target(&bench), 9);
}

#[test]
fn the_last_of_several_set_points_before_a_sync_counts() {
    let mut bench = Bench::operational();
    for n in 1..=3i32 {
        bench.send(RPDO2, &n.to_le_bytes());
    }
    bench.send(SYNC, &[]);
    bench.tick();
    assert_eq!(target(&bench), 3);
}

#[test]
fn set_points_before_a_change_of_state_are_forgotten() {
    let mut bench = Bench::operational();
    bench.send(RPDO2, &5i32.to_le_bytes());
    bench.send(0, &[128, 0]);
    bench.send(0, &[1, 0]);
    bench.send(SYNC, &[]);
    bench.tick();
    assert_eq!(target(&bench), 0);
}

#[test]
fn a_set_point_outside_the_window_is_discarded() {
    let mut bench = Bench::operational();
    bench.set(0x1007, 0, 4, 200).unwrap();
    bench.send(SYNC, &[]);
    bench.now += 200;
    bench.send(RPDO2, &5i32.to_le_bytes());
    bench.now += 1;
    bench.send(RPDO2, &6i32.to_le_bytes());
    bench.send(SYNC, &[]);
    bench.tick();
    assert_eq!(target(&bench), 5);
}

#[test]
fn a_short_rpdo_is_not_applied_and_a_long_one_as_far_as_it_is_mapped() {
    let mut bench = Bench::operational();
    for length in 0..2 {
        bench.send(RPDO1, &[7, 7][..length]);
    }
    assert_eq!(bench.machine.value(CONTROL, 0), [0, 0]);
    assert_eq!(bench.pass_for(1_000, EMERGENCY), [[0x10, 0x82, 0x11, 1, 0, 0, 0, 0]]);
    bench.send(RPDO1, &[7, 0]);
    assert_eq!(bench.pass_for(1_000, EMERGENCY), [[0; 8]]);
    bench.send(RPDO1, &[8, 0, 0]);
    assert_eq!(bench.machine.value(CONTROL, 0), [8, 0]);
    assert_eq!(bench.pass_for(1_000, EMERGENCY), [[0x20, 0x82, 0x11, 1, 0, 0, 0, 0]]);
    bench.send(RPDO2, &[1, 2, 3]);
    bench.send(SYNC, &[]);
    bench.tick();
    assert_eq!(target(&bench), 0);
    assert_eq!(bench.pass_for(1_000, EMERGENCY), [[0x10, 0x82, 0x11, 2, 0, 0, 0, 0]]);
}

#[test]
fn a_value_that_its_object_refuses_does_not_arrive() {
    let mut bench = Bench::new();
    let id = bench.number(0x1402, 1);
    bench.set(0x1602, 1, 4, 0x2000_0020).unwrap();
    bench.set(0x1602, 0, 1, 1).unwrap();
    bench.set(0x1402, 1, 4, id & !(1 << 31)).unwrap();
    bench.send(0, &[1, 0]);
    bench.send(0x400 + ID, &1001u32.to_le_bytes());
    assert_eq!(bench.number(RANGED, 0), 500);
    bench.send(0x400 + ID, &1000u32.to_le_bytes());
    assert_eq!(bench.number(RANGED, 0), 1000);
}

#[test]
fn an_rpdo_that_does_not_come_in_time_is_an_event_once() {
    let mut bench = Bench::operational();
    bench.set(0x1400, 5, 2, 20).unwrap();
    bench.machine.events.clear();
    // Watched from the first one on.
    bench.pass(1_000_000);
    assert_eq!(bench.machine.events, []);
    for _ in 0..50 {
        bench.send(RPDO1, &[0, 0]);
        bench.pass(20_000);
    }
    assert_eq!(bench.machine.events, []);
    assert_eq!(bench.pass_for(1_000, EMERGENCY), [[0x50, 0x82, 0x11, 1, 0, 0, 0, 0]]);
    bench.pass(1_000_000);
    assert_eq!(bench.machine.events, [Event::ReceiveTimeout { pdo: 0 }]);
    bench.send(RPDO1, &[0, 0]);
    assert_eq!(bench.pass_for(1_000, EMERGENCY), [[0; 8]]);
}

#[test]
fn a_sync_that_fails_to_come_is_an_event_once() {
    let mut bench = Bench::operational();
    bench.set(0x1006, 0, 4, 2_000).unwrap();
    bench.machine.events.clear();
    for _ in 0..50 {
        bench.send(SYNC, &[]);
        bench.pass(3_000);
    }
    assert_eq!(bench.machine.events, []);
    assert_eq!(bench.pass_for(1_000, EMERGENCY), [[0x00, 0x81, 0x11, 1, 0, 0, 0, 0]]);
    bench.pass(1_000_000);
    assert_eq!(bench.machine.events, [Event::SyncLost]);
    bench.send(SYNC, &[]);
    assert_eq!(bench.pass_for(1_000, EMERGENCY), [[0; 8]]);
}

#[test]
fn a_sync_of_the_wrong_length_is_an_emergency_and_does_nothing() {
    let mut bench = Bench::operational();
    bench.send(RPDO2, &5i32.to_le_bytes());
    assert_eq!(bench.send(SYNC, &[1]), []);
    assert_eq!(bench.tick(), None);
    assert_eq!(bench.pass_for(1_000, EMERGENCY), [[0x40, 0x82, 0x11, 1, 0, 0, 0, 0]]);
}

#[test]
fn a_jammed_bus_costs_samples_and_no_emergencies() {
    let mut bench = Bench::operational();
    for n in 0..100u8 {
        bench.machine.set(POSITION, &[n; 4]);
        bench.machine.set(STATUS, &[n, 0]);
        // Nothing leaves.
        bench.node.receive(
            &edm_servo_head::canopen::Frame::new(SYNC, &[]).unwrap(),
            Time(bench.now),
            &mut bench.machine,
        );
        bench.now += 1_000;
        bench.node.poll(Time(bench.now), &mut bench.machine);
    }
    bench.node.emergency(0x5530, 0x20, [0; 5]);
    bench.node.poll(Time(bench.now), &mut bench.machine);
    let sent: Vec<_> = bench.frames().into_iter().map(|frame| (frame.id(), frame.data()[0])).collect();
    assert_eq!(sent, [(EMERGENCY, 0x30), (TPDO1, 99), (TPDO2, 99)]);
}

#[test]
fn several_nodes_live_in_one_process() {
    let mut one = Bench::operational();
    let other = Bench::operational();
    one.send(RPDO1, &[3, 0]);
    assert_eq!((one.machine.value(CONTROL, 0), other.machine.value(CONTROL, 0)), (&[3, 0][..], &[0, 0][..]));
}

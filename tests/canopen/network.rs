//! Network management and heartbeats (CiA 301 7.2.8, 7.3.2, 1016h, 1017h, 1029h).

use crate::bench::{Bench, ID, request, segment};
use crate::machine::*;
use edm_servo_head::canopen::{Controller, Event, Frame, NmtState, Restored};

const BOOT_UP: &[u8] = &[0];

#[test]
fn a_node_boots_up_once_and_is_then_pre_operational() {
    let mut bench = Bench::silent();
    assert_eq!(bench.pass(5_000_000), []);
    assert_eq!(bench.node.boot(None, &mut bench.machine), Ok(Restored::default()));
    assert_eq!(bench.frames(), [Frame::new(0x700 + ID, BOOT_UP).unwrap()]);
    assert_eq!(bench.node.state(), NmtState::PreOperational);
    assert_eq!(bench.pass(5_000_000), []);
    assert_eq!(bench.node.boot(None, &mut bench.machine), Ok(Restored::default()));
    assert_eq!(bench.frames(), []);
}

#[test]
fn nothing_overtakes_boot_up() {
    let mut bench = Bench::silent();
    bench.node.emergency(0x5530, 0, [0; 5]);
    bench.node.boot(None, &mut bench.machine).unwrap();
    bench.node.poll(edm_servo_head::canopen::Time(bench.now), &mut bench.machine);
    assert_eq!(bench.node.take().unwrap().id(), 0x700 + ID);
    let then: Vec<_> = bench.pass(1_000).into_iter().map(|(_, frame)| frame.id()).collect();
    assert_eq!(then, [0x80 + ID]);
}

#[test]
fn commands_reach_this_node_and_all_but_no_other() {
    use NmtState::{Operational, PreOperational, Stopped};
    let mut bench = Bench::new();
    for (data, state) in [
        (&[1, ID as u8][..], Operational),
        (&[128, ID as u8 + 1], Operational),
        (&[128, 0], PreOperational),
        (&[2, 0], Stopped),
        (&[1, 0], Operational),
        (&[3, 0], Operational),
        (&[2], Operational),
        (&[2, 0, 0], Operational),
        (&[], Operational),
        (&[2, ID as u8], Stopped),
        (&[128, ID as u8], PreOperational),
    ] {
        bench.send(0, data);
        assert_eq!(bench.node.state(), state, "{data:?}");
    }
    let expected = [PreOperational, Operational, PreOperational, Stopped, Operational, Stopped, PreOperational];
    assert_eq!(bench.machine.events, expected.map(Event::State));
}

#[test]
fn each_reset_ends_with_boot_up_and_the_defaults() {
    for (command, event) in [(129, Event::ResetNode), (130, Event::ResetCommunication)] {
        let mut bench = Bench::operational();
        bench.set(0x1006, 0, 4, 1234).unwrap();
        assert_eq!(bench.send(0, &[command, 0]), []);
        assert_eq!(bench.machine.events.last(), Some(&event));
        assert_eq!(bench.node.state(), NmtState::Initialising);
        // Deaf and mute until the device lets it go on.
        assert_eq!(bench.send(0, &[1, 0]), []);
        assert_eq!(bench.send(0x600 + ID, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]), []);
        assert_eq!(bench.pass(2_000_000), []);
        bench.node.boot(None, &mut bench.machine).unwrap();
        assert_eq!(bench.frames(), [Frame::new(0x700 + ID, BOOT_UP).unwrap()]);
        assert_eq!(bench.number(0x1006, 0), 0);
    }
}

#[test]
fn a_stopped_node_knows_network_management_and_heartbeats_alone() {
    let mut bench = Bench::operational();
    bench.set(0x1017, 0, 2, 100).unwrap();
    bench.send(0, &[2, 0]);
    bench.pass(1_000);
    assert_eq!(bench.send(0x600 + ID, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]), []);
    assert_eq!(bench.send(0x200 + ID, &[15, 0]), []);
    assert_eq!(bench.send(0x80, &[]), []);
    assert_eq!(bench.machine.value(CONTROL, 0), [0, 0]);
    bench.node.emergency(0x5530, 0, [0; 5]);
    let sent = bench.pass(1_000_000);
    assert_eq!(sent.len(), 10);
    assert!(sent.iter().all(|(_, frame)| *frame == Frame::new(0x700 + ID, &[4]).unwrap()));
    // What happened meanwhile is told afterwards.
    bench.send(0, &[128, 0]);
    assert_eq!(bench.pass_for(1_000, 0x80 + ID).len(), 1);
}

#[test]
fn a_pre_operational_node_knows_no_process_data() {
    let mut bench = Bench::new();
    bench.send(0x200 + ID, &[15, 0]);
    bench.send(0x80, &[]);
    assert_eq!(bench.machine.value(CONTROL, 0), [0, 0]);
    assert_eq!(bench.pass(1_000_000), []);
}

#[test]
fn the_heartbeat_comes_at_its_period_and_with_each_change_of_state() {
    let mut bench = Bench::new();
    // The node notices that its boot-up, its first heartbeat, is out.
    bench.pass(1_000);
    bench.set(0x1017, 0, 2, 100).unwrap();
    let start = bench.now;
    let beats: Vec<_> = bench.pass(1_000_000).into_iter().map(|(time, frame)| (time, frame.data()[0])).collect();
    assert_eq!(beats[0].0, start + 1_000);
    assert_eq!(beats.len(), 10);
    assert!(beats.windows(2).all(|pair| pair[1].0 - pair[0].0 == 100_000 && pair[1].1 == 127));
    bench.pass(50_000);
    bench.send(0, &[1, 0]);
    assert_eq!(bench.pass_for(1_000, 0x700 + ID), [[5]]);
    bench.set(0x1017, 0, 2, 0).unwrap();
    assert_eq!(bench.pass_for(1_000_000, 0x700 + ID), [[0; 1]; 0]);
}

/// Watches node 5, which has to be heard every 100 ms, as entry 2.
fn watching(behaviour: u32) -> Bench {
    let mut bench = Bench::operational();
    bench.set(0x1029, 1, 1, behaviour).unwrap();
    bench.set(0x1016, 2, 4, 5 << 16 | 100).unwrap();
    bench.send(0x705, &[5]);
    bench.pass(100_000);
    bench.machine.events.clear();
    bench
}

#[test]
fn a_lost_heartbeat_is_an_emergency_an_event_and_the_end_of_operation() {
    let mut bench = watching(0);
    assert_eq!(bench.pass_for(1_000, 0x80 + ID), [[0x30, 0x81, 0x11, 2, 0, 0, 0, 0]]);
    assert_eq!(bench.machine.events, [Event::HeartbeatLost { node: 5 }, Event::State(NmtState::PreOperational)]);
    assert_eq!(bench.number(0x1001, 0), 0x11);
    bench.send(0x705, &[5]);
    assert_eq!(bench.pass_for(1_000, 0x80 + ID), [[0; 8]]);
    assert_eq!(bench.number(0x1001, 0), 0);
    assert_eq!(bench.number(0x1003, 1), 0x0002_8130);
}

#[test]
fn trouble_of_the_controller_is_an_emergency_unless_the_node_is_alone() {
    let mut alone = Bench::new();
    let passive = Controller { passive: true, ..Controller::default() };
    alone.node.controller(passive);
    assert_eq!(alone.pass_for(1_000, 0x80 + ID), [[0u8; 8]; 0]);
    let mut bench = Bench::operational();
    for (trouble, code) in [
        (Controller { overrun: true, ..Controller::default() }, 0x10),
        (passive, 0x20),
        (Controller { bus_off: true, ..Controller::default() }, 0x40),
    ] {
        bench.node.controller(trouble);
        bench.node.controller(trouble);
        assert_eq!(bench.pass_for(1_000, 0x80 + ID), [[code, 0x81, 0x11, 1, 0, 0, 0, 0]]);
        (0..20).for_each(|_| bench.node.controller(Controller::default()));
        assert_eq!(bench.pass_for(1_000, 0x80 + ID), [[0; 8]]);
    }
}

#[test]
fn a_controller_that_leaves_the_bus_and_comes_back_again_and_again_is_one_emergency_until_it_stays() {
    let mut bench = Bench::operational();
    let (passive, bus_off) =
        (Controller { passive: true, ..Controller::default() }, Controller { bus_off: true, ..Controller::default() });
    for _ in 0..100 {
        for controller in [passive, bus_off, Controller::default()] {
            bench.node.controller(controller);
        }
    }
    let (passive, bus_off) = ([0x20, 0x81, 0x11, 1, 0, 0, 0, 0], [0x40, 0x81, 0x11, 1, 0, 0, 0, 0]);
    assert_eq!(bench.pass_for(1_000, 0x80 + ID), [passive, bus_off]);
    (0..20).for_each(|_| bench.node.controller(Controller::default()));
    assert_eq!(bench.pass_for(1_000, 0x80 + ID), [[0, 0, 0x11, 0, 0, 0, 0, 0], [0; 8]]);
}

#[test]
fn the_error_behaviour_says_what_a_lost_heartbeat_does_to_the_state() {
    for (behaviour, state) in [(0, NmtState::PreOperational), (1, NmtState::Operational), (2, NmtState::Stopped)] {
        let mut bench = watching(behaviour);
        bench.pass(1_000);
        assert_eq!(bench.node.state(), state);
    }
    let mut bench = Bench::new();
    assert_eq!(bench.set(0x1029, 1, 1, 3), Err(0x0609_0030));
    assert_eq!(bench.number(0x1029, 1), 0);
}

#[test]
fn a_stopped_node_stays_stopped_whatever_falls_silent() {
    let mut bench = watching(0);
    bench.send(0, &[2, 0]);
    bench.pass(1_000);
    assert_eq!(bench.machine.events.last(), Some(&Event::HeartbeatLost { node: 5 }));
    assert_eq!(bench.node.state(), NmtState::Stopped);
}

#[test]
fn a_reset_ends_watching_and_its_errors() {
    let mut bench = watching(0);
    let stored = parameters(&bench.node);
    for lost in [false, true] {
        bench.send(0x705, &[5]);
        bench.pass(if lost { 101_000 } else { 50_000 });
        assert_eq!(bench.number(0x1001, 0), if lost { 0x11 } else { 0 });
        bench.send(0, &[130, 0]);
        bench.node.boot(Some(&mut stored.iter().copied()), &mut bench.machine).unwrap();
        bench.machine.events.clear();
        bench.pass(1_000_000);
        assert_eq!((bench.machine.events.len(), bench.number(0x1001, 0)), (0, 0));
    }
}

#[test]
fn a_reset_ends_a_transfer() {
    let mut bench = Bench::new();
    bench.ask(request(0x21, BYTES, 0, [14, 0, 0, 0]));
    bench.send(0, &[130, 0]);
    bench.node.boot(None, &mut bench.machine).unwrap();
    bench.frames();
    assert_eq!(bench.refusal(segment(0x00, &[1; 7])), 0x0504_0001);
}

#[test]
fn a_heartbeat_in_time_changes_nothing() {
    let mut bench = watching(0);
    for _ in 0..100 {
        bench.send(0x705, &[5]);
        bench.pass(100_000);
    }
    assert_eq!(bench.machine.events, []);
}

#[test]
fn what_1016h_cannot_watch_is_refused() {
    let mut bench = Bench::new();
    assert_eq!(bench.set(0x1016, 1, 4, 5 << 16 | 100), Ok(()));
    // Twice the same node (CiA 301 7.5.2.19), node 128.
    assert_eq!(bench.set(0x1016, 2, 4, 5 << 16 | 200), Err(0x0604_0043));
    assert_eq!(bench.set(0x1016, 2, 4, 128 << 16 | 200), Err(0x0609_0030));
    assert_eq!(bench.set(0x1016, 1, 4, 5 << 16 | 200), Ok(()));
    assert_eq!(bench.set(0x1016, 2, 4, 127 << 16 | 200), Ok(()));
    assert_eq!(bench.set(0x1016, 5, 4, 0), Err(0x0609_0011));
}

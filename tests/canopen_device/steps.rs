//! Mode -1: the axis follows the steps of a host.

use crate::rig::Rig;
use edm_servo_head::head::{Fault, State};
use edm_sim::process::steps::Move;

/// 500 um below its upper stop, in mode -1, with these settings.
fn following(change: impl FnOnce(&mut edm_servo_head::settings::Settings)) -> Rig {
    let mut rig = Rig::new(|settings, _| change(settings));
    rig.make_ready();
    rig.mode(1);
    rig.write32(0x607A, 0, 500);
    rig.control(0x1F);
    rig.until(1000, |rig| rig.status() & 0x0400 != 0);
    rig.control(0x0F);
    rig.mode(0xFF);
    rig.run(20);
    assert_eq!((rig.read(0x6061, 0), rig.status() & 0x1000), (0xFF, 0x1000), "mode -1 follows");
    rig
}

fn send(rig: &mut Rig, moves: &[(i64, f64)]) {
    moves.iter().for_each(|(steps, hz)| rig.machine.process.steps.send(Move::Steps(*steps, *hz)));
    rig.until(20_000, |rig| rig.machine.process.steps.is_done());
    rig.run(30);
}

#[test]
fn steps_lead_the_axis_to_the_count_both_ways_and_by_any_ratio() {
    let mut rig = following(|_| {});
    send(&mut rig, &[(700, 5000.0), (-200, 4000.0), (33, 100.0)]);
    assert_eq!((rig.read(0x2016, 1), rig.read(0x6062, 0)), (533, 1033));
    assert!((rig.position() as i32 - 1033).abs() <= 1, "{}", rig.position());
    // Ten steps are three counts; what is left of one stays.
    let mut rig = following(|settings| (settings.step_counts, settings.step_steps) = (3, 10));
    for round in 1..=4 {
        send(&mut rig, &[(1001, 12_000.0), (-1, 12_000.0), (333, 3000.0), (-333, 20_000.0)]);
        assert_eq!((rig.read(0x2016, 1), rig.read(0x6062, 0)), (1000 * round, 500 + 300 * round));
    }
    // The other way round.
    let mut rig = following(|settings| settings.step_reversed = true);
    send(&mut rig, &[(-400, 5000.0)]);
    assert_eq!((rig.read(0x2016, 1), rig.read(0x6062, 0)), (400, 900));
}

#[test]
fn steps_that_come_already_are_refused_and_the_drive_is_not_enabled() {
    let mut rig = following(|_| {});
    rig.control(0x06);
    rig.run(50);
    rig.machine.process.fault_inputs.step_hz = 1000.0;
    rig.run(20);
    rig.control(0x07);
    rig.control(0x0F);
    rig.run(20);
    assert_eq!((rig.status() & 0x6F, rig.read(0x2000, 4)), (0x23, 22), "switched on, and no more");
    rig.machine.process.fault_inputs.step_hz = 0.0;
    rig.run(20);
    rig.control(0x07);
    rig.control(0x0F);
    rig.run(20);
    assert_eq!(rig.status() & 0x106F, 0x1027);
    // Halted, they lead nowhere; released while they come, neither.
    let before = rig.read(0x6062, 0);
    rig.control(0x10F);
    rig.machine.process.fault_inputs.step_hz = 1000.0;
    rig.run(50);
    rig.control(0x0F);
    rig.run(50);
    assert_eq!((rig.status() & 0x1000, rig.read(0x2000, 4), rig.read(0x6062, 0)), (0, 22, before));
}

#[test]
fn steps_too_fast_for_the_axis_are_a_fault_with_its_reason() {
    let mut rig = following(|_| {});
    // Down where it has not been the axis goes by contact.approach_mm_s.
    rig.machine.process.steps.send(Move::Steps(3000, 20_000.0));
    rig.until(500, |rig| rig.machine.status().state == State::Fault);
    rig.run(30);
    assert_eq!(rig.machine.status().fault, Some(Fault::StepsNotFollowed));
    assert_eq!((rig.read(0x603F, 0), rig.read(0x2016, 5)), (0xFF13, 1));
    let emergency = rig.sent.iter().rev().find(|(_, frame)| frame.data().first_chunk() == Some(&[0x13, 0xFF]));
    // The reason is in the message, too.
    assert_eq!(emergency.map(|(_, frame)| frame.data()[6]), Some(1));
    // It holds where it was.
    assert!(rig.position() < 1500, "{}", rig.position());
    rig.control(0x80);
    rig.run(30);
    rig.until(500, |rig| rig.machine.process.steps.is_done());
    rig.run(30);
    for word in [0x06, 0x07, 0x0F] {
        rig.control(word);
    }
    rig.run(30);
    assert_eq!((rig.status() & 0x106F, rig.read(0x2016, 5)), (0x1027, 0));
}

/// In mode -1 as above, the work 200 um below, steps become path.
fn recording(waits: bool) -> Rig {
    let mut rig = following(|_| {});
    rig.machine.process.steps.waits = waits;
    rig.write(0x2001, 1, &[1]);
    rig.until(300, |rig| rig.machine.status().records);
    rig.run(2);
    assert_eq!((rig.status() & 0x1000, rig.read(0x2016, 6), rig.read(0x60FE, 1) >> 19 & 1), (0x1000, 1, 1));
    rig
}

#[test]
fn recorded_steps_become_a_path_that_ends_on_their_count() {
    let mut rig = recording(true);
    let first = rig.read(0x200E, 10);
    // Down, a little up, down again: three ends, and one for each 50 counts.
    for (steps, hz) in [(120, 50_000.0), (-40, 20_000.0), (70, 3000.0)] {
        rig.machine.process.steps.send(Move::Steps(steps, hz));
    }
    rig.until(500, |rig| rig.machine.process.steps.is_done());
    rig.until(10_000, |rig| rig.machine.status().state == State::Done);
    assert_eq!((rig.read(0x2016, 1), rig.read(0x6062, 0), rig.read(0x2004, 6) as i32), (150, 650, 230));
    assert_eq!(first, rig.read(0x200E, 10), "those of the host are counted apart");
    // The host goes on, and the head with it.
    rig.machine.process.steps.send(Move::Steps(-15, 1000.0));
    rig.until(10_000, |rig| rig.read(0x6062, 0) == 635 && rig.machine.status().state == State::Done);
    assert_eq!(rig.read(0x2016, 5), 0);
    // Held, the steps lead nowhere.
    rig.write(0x2001, 2, &[1]);
    rig.run(20);
    assert_eq!((rig.status() & 0x1000, rig.read(0x2016, 6)), (0, 0));
}

#[test]
fn a_host_that_heeds_the_ready_line_loses_nothing_and_one_that_does_not_overruns_the_queue() {
    let mut rig = recording(true);
    // Four queues of turns, much faster than the head goes along them.
    for turn in 0..1000 {
        rig.machine.process.steps.send(Move::Steps(if turn % 2 == 0 { 2 } else { -1 }, 100_000.0));
    }
    let mut held = false;
    rig.until(60_000, |rig| {
        held |= !rig.machine.status().takes_steps;
        rig.machine.process.steps.is_done()
    });
    rig.until(60_000, |rig| rig.machine.status().state == State::Done);
    assert!(held);
    assert_eq!((rig.read(0x2016, 1), rig.read(0x6062, 0), rig.read(0x2016, 5)), (500, 1000, 0));

    let mut rig = recording(false);
    for turn in 0..1000 {
        rig.machine.process.steps.send(Move::Steps(if turn % 2 == 0 { 2 } else { -1 }, 100_000.0));
    }
    rig.until(500, |rig| rig.machine.status().state == State::Fault);
    assert_eq!(rig.machine.status().fault, Some(Fault::StepsNotFollowed));
    rig.run(5);
    assert_eq!((rig.read(0x603F, 0), rig.read(0x2016, 5), rig.read(0x2016, 6)), (0xFF13, 3, 0));
}

#[test]
fn a_recording_that_leads_out_of_the_travel_is_a_fault_with_its_reason() {
    let mut rig = recording(true);
    rig.machine.process.steps.send(Move::Steps(-700, 50_000.0));
    rig.until(500, |rig| rig.machine.status().state == State::Fault);
    rig.run(5);
    assert_eq!(rig.read(0x2016, 5), 4);
}

#[test]
fn limits_hold_the_axis_and_let_it_go_where_the_steps_come_back() {
    let mut rig = following(|_| {});
    rig.write32(0x607D, 2, 600);
    rig.run(5);
    send(&mut rig, &[(250, 2000.0)]);
    assert_eq!((rig.read(0x6062, 0), rig.status() & 0x0800), (600, 0x0800));
    send(&mut rig, &[(-200, 2000.0)]);
    assert_eq!((rig.read(0x6062, 0), rig.status() & 0x0800), (550, 0));
}

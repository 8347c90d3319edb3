//! Erosion over the bus.

use crate::rig::Rig;
use edm_servo_head::head::{Fault, State};

#[test]
fn a_hole_is_bored_by_a_set_point_of_profile_position() {
    let mut rig = Rig::ready();
    let surface = rig.machine.process.truth().surface_um;
    let depth = surface as i32 + 30 - (rig.machine.process.truth().position_um as i32 - rig.position() as i32);
    rig.mode(1);
    rig.write(0x2001, 1, &[1]);
    rig.write32(0x607A, 0, depth);
    rig.control(0x1F);
    assert_eq!(rig.status() & 0x1400, 0x1000);
    rig.until(20_000, |rig| rig.machine.status().state == State::Eroding);
    let feed = rig.read(0x2004, 7).cast_signed();
    assert!(feed.abs() <= 2000, "{feed}");
    rig.until(120_000, |rig| rig.status() & 0x0400 != 0);
    assert_eq!(rig.machine.status().state, State::Done);
    assert_eq!(rig.read(0x2003, 3), 1, "ended by depth");
    assert!((rig.position() as i32 - depth).abs() <= 1);
    assert!(rig.read(0x2006, 3) > 1000, "ms of erosion");
    // Up again, without pulses.
    rig.write(0x2001, 1, &[0]);
    rig.write32(0x607A, 0, 500);
    rig.control(0x0F);
    rig.control(0x1F);
    rig.until(2000, |rig| rig.status() & 0x0400 != 0);
    assert!((rig.position() - 500).abs() <= 2);
}

#[test]
fn erosion_is_aborted_by_its_enable_and_stopped_by_its_conditions() {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.write(0x2001, 1, &[1]);
    rig.write32(0x607A, 0, 4000);
    rig.control(0x1F);
    rig.until(20_000, |rig| rig.machine.status().state == State::Eroding);
    rig.write(0x2001, 1, &[0]);
    rig.run(2);
    assert_eq!(rig.machine.status().state, State::HoldingPosition);
    rig.write(0x2003, 1, &500u32.to_le_bytes());
    rig.write(0x2001, 1, &[1]);
    rig.run(5);
    assert!(rig.machine.status().state.pulses());
    rig.until(600, |rig| rig.machine.status().state == State::HoldingPosition);
    assert_eq!(rig.read(0x2003, 3), 2, "ended by time");
}

#[test]
fn a_path_is_queued_and_its_place_is_told() {
    let mut rig = Rig::ready();
    rig.mode(1);
    let space = rig.read(0x2004, 4);
    let here = rig.position() as i32;
    for n in 1..=3 {
        rig.write32(0x2004, 1, here + n * 100);
    }
    rig.run(2);
    // The first is under way, two wait.
    assert_eq!((rig.read(0x2004, 4), rig.read(0x2004, 5)), (space - 2, 1));
    rig.write(0x2004, 3, &[1]);
    rig.run(2);
    assert_eq!(rig.read(0x2004, 4), space);
    assert_eq!(rig.try_write(0x2004, 3, &[2]), Err(0x0609_0031));
}

#[test]
fn gap_set_points_are_shown_and_gains_change_while_eroding() {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.write(0x2001, 1, &[1]);
    rig.write32(0x607A, 0, 4000);
    rig.control(0x1F);
    rig.until(20_000, |rig| rig.machine.status().state == State::Eroding);
    let setpoint = edm_servo_head::canopen::objects::setting_address("gap.setpoint_v").unwrap();
    rig.write(setpoint.0, setpoint.1, &50.0f32.to_le_bytes());
    rig.run(2);
    assert_eq!(rig.read(0x2005, 5) as u16, 5000);
    let gain = edm_servo_head::canopen::objects::setting_address("servo.velocity_hz").unwrap();
    rig.write(gain.0, gain.1, &140.0f32.to_le_bytes());
    rig.run(200);
    assert!(rig.machine.status().state.pulses());
    let mass = edm_servo_head::canopen::objects::setting_address("axis.mass_kg").unwrap();
    assert_eq!(rig.try_write(mass.0, mass.1, &0.3f32.to_le_bytes()), Err(0x0800_0022));
}

#[test]
fn the_scope_records_a_step_response() {
    let mut rig = Rig::ready();
    rig.mode(1);
    // The position demand: that of the head trembles by a count.
    rig.write(0x2010, 1, &0x0060_6200u32.to_le_bytes());
    rig.write(0x2010, 2, &0x0060_6400u32.to_le_bytes());
    rig.write(0x2010, 6, &[3]);
    assert_eq!(rig.try_write(0x2010, 3, &0x0012_3400u32.to_le_bytes()), Err(0x0609_0030));
    rig.write(0x2010, 8, &[1]);
    rig.run(5);
    assert_eq!(rig.read(0x2010, 9), 1);
    rig.move_to(1000, 1000);
    rig.until(300, |rig| rig.read(0x2010, 9) == 3);
    assert_eq!(rig.read(0x2010, 10), 256);
}

#[test]
fn cyclic_and_interpolated_set_points_become_path_while_eroding() {
    for mode in [8, 7] {
        let mut rig = Rig::ready();
        rig.mode(mode);
        rig.write(0x2001, 1, &[1]);
        rig.control(0x1F);
        let here = rig.position() as i32;
        let (index, sub) = if mode == 8 { (0x607A, 0) } else { (0x60C1, 1) };
        for n in 1..=4 {
            rig.write32(index, sub, here + n * 100);
        }
        rig.run(3);
        assert!(rig.machine.status().state.pulses(), "mode {mode}");
        assert_eq!(rig.read(0x2004, 4), 253, "mode {mode}: one under way, three wait");
        rig.until(2000, |rig| rig.machine.status().state == State::Done);
        assert!((rig.position() as i32 - here - 400).abs() <= 1, "mode {mode}");
    }
}

/// A rig that has been moved by cyclic set points, and stands where the last one was, or still follows them.
fn followed(still: bool) -> Rig {
    let mut rig = Rig::ready();
    rig.mode(8);
    let here = rig.position() as i32;
    for n in 1..=50 {
        rig.write32(0x607A, 0, here + 4 * n);
        rig.run(1);
    }
    if still {
        rig.run(100);
    }
    assert_eq!(rig.machine.status().state, State::Positioning);
    rig
}

#[test]
fn erosion_begins_after_cyclic_set_points_have_moved_the_axis() {
    for still in [true, false] {
        let mut rig = followed(still);
        rig.write(0x2001, 1, &[1]);
        let here = rig.position() as i32;
        for n in 1..=9 {
            rig.write32(0x607A, 0, here + 100 + n * 20);
            rig.run(1);
        }
        rig.until(200, |rig| rig.machine.status().state.pulses());
        rig.until(2000, |rig| rig.machine.status().state == State::Done);
        assert!((rig.position() as i32 - here - 280).abs() <= 1, "{} from {here}", rig.position());
        assert_eq!(rig.read(0x2000, 4), 0, "nothing was refused");
    }
}

#[test]
fn what_was_to_begin_does_not_begin_once_the_host_has_stopped_the_head() {
    type Stop = (&'static str, fn(&mut Rig));
    let stops: [Stop; 6] = [
        ("2001h:1 = 0", |rig| rig.write(0x2001, 1, &[0])),
        ("halt", |rig| rig.control(0x10F)),
        ("quick stop", |rig| rig.control(0x0B)),
        ("disable operation", |rig| rig.control(0x07)),
        ("disable voltage", |rig| rig.control(0x00)),
        ("fault", |rig| rig.machine.raise(Fault::HostSilent)),
    ];
    for (what, stop) in stops {
        for erode in [1, 2] {
            let mut rig = followed(false);
            rig.write(0x2001, 1, &[erode]);
            let here = rig.position() as i32;
            if erode == 1 {
                rig.write32(0x607A, 0, here + 300);
            }
            stop(&mut rig);
            // It may just have begun.
            rig.run(2);
            rig.states.clear();
            rig.run(100);
            // And on again, without another word about erosion.
            rig.control(0x8F);
            for word in [0x06, 0x07, 0x0F] {
                rig.control(word);
                rig.run(50);
            }
            rig.run(200);
            assert!(!rig.states.iter().any(|state| state.pulses()), "{what}, {erode}: {:?}", rig.states);
        }
    }
}

#[test]
fn a_change_of_mode_stops_erosion_and_guiding_and_2001h_says_so() {
    for (erode, mode) in [(1, 3), (1, 8), (2, 1), (2, 6)] {
        let mut rig = Rig::ready();
        rig.mode(if erode == 1 { 1 } else { 8 });
        rig.write(0x2001, 1, &[erode]);
        if erode == 1 {
            rig.write32(0x607A, 0, 4000);
            rig.control(0x1F);
        }
        rig.until(200, |rig| rig.machine.status().state.pulses());
        if mode == 6 {
            assert_eq!(
                rig.try_write(0x6060, 0, &[mode]),
                Err(0x0800_0022),
                "no reference is looked for with pulses on"
            );
            continue;
        }
        rig.mode(mode);
        rig.run(5);
        assert!(!rig.machine.status().state.pulses(), "{erode}, mode {mode}");
        assert_eq!(rig.read(0x2001, 1), 0, "{erode}, mode {mode}");
    }
}

#[test]
fn profile_position_erodes_after_cyclic_set_points_and_a_host_may_lead_after_them() {
    for (still, erode_first) in [(true, true), (true, false), (false, true), (false, false)] {
        let mut rig = followed(still);
        if erode_first {
            rig.write(0x2001, 1, &[1]);
        }
        rig.write(0x6060, 0, &[1]);
        if !erode_first {
            rig.write(0x2001, 1, &[1]);
        }
        let target = rig.position() as i32 + 300;
        rig.write32(0x607A, 0, target);
        rig.control(0x1F);
        rig.until(200, |rig| rig.machine.status().state.pulses());
        rig.until(2000, |rig| rig.machine.status().state == State::Done);
        assert!((rig.position() as i32 - target).abs() <= 1, "{still}, {erode_first}");
        assert_eq!(rig.read(0x2000, 4), 0, "nothing was refused");
    }
    for still in [true, false] {
        let mut rig = followed(still);
        rig.write(0x2001, 1, &[2]);
        rig.until(200, |rig| rig.machine.status().state == State::Guiding);
        assert_eq!(rig.read(0x2000, 4), 0, "nothing was refused");
        // It follows, and says so.
        let there = rig.position() as i32 + 10;
        rig.write32(0x607A, 0, there);
        rig.run(50);
        assert_eq!(rig.machine.status().state, State::Guiding);
        assert!((rig.position() as i32 - there).abs() <= 1, "{} of {there}", rig.position());
        // The host has fallen silent behind its last step.
        assert_eq!((rig.status() & 0x1000, rig.read(0x2000, 8)), (0, 4));
    }
}

#[test]
fn a_host_that_keeps_the_path_reads_the_signed_feed() {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.write(0x2001, 1, &[2]);
    rig.run(200);
    assert_eq!(rig.machine.status().state, State::Guiding);
    assert!(rig.read(0x2004, 7).cast_signed() > 0, "two millimetres above the work");
    let (_, frame) = rig.sent.iter().rev().find(|(_, frame)| frame.id() == 0x385).unwrap();
    assert!(i32::from_le_bytes(frame.data()[..4].try_into().unwrap()) > 0);
    rig.write(0x2001, 1, &[0]);
    rig.run(2);
    assert_eq!(rig.machine.status().state, State::HoldingPosition);
}

#[test]
fn nothing_makes_the_bottom_of_a_hole_a_home() {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.write(0x2001, 1, &[1]);
    rig.write32(0x607A, 0, 4000);
    rig.control(0x1F);
    rig.until(20_000, |rig| rig.machine.status().state == State::Eroding);
    // Not even the mode: erosion goes on.
    assert_eq!(rig.try_write(0x6060, 0, &[6]), Err(0x0800_0022));
    rig.run(10);
    assert_eq!((rig.read(0x6061, 0), rig.machine.status().state), (1, State::Eroding));
    // Stopped half-way, the path still waits: homing is refused, and says so.
    rig.write(0x2001, 1, &[0]);
    rig.control(0x0F);
    rig.mode(6);
    let before = rig.position();
    rig.control(0x1F);
    rig.run(20);
    assert_eq!(rig.status() & 0x3400, 0x2400, "homing error");
    assert_eq!(rig.read(0x2000, 4), 12);
    assert!((rig.position() - before).abs() < 5);
    // Without the path it may be told that this is home.
    rig.control(0x0F);
    rig.write(0x2004, 3, &[1]);
    rig.control(0x1F);
    rig.until(100, |rig| rig.status() & 0x3400 == 0x1400);
    assert!(rig.position().abs() < 5);
}

#[test]
fn homing_that_has_been_chosen_before_is_refused_while_eroding() {
    let mut rig = Rig::ready();
    rig.write32(0x2004, 1, 4000);
    rig.write(0x2001, 1, &[1]);
    rig.until(20_000, |rig| rig.machine.status().state == State::Eroding);
    let before = rig.position();
    rig.control(0x1F);
    rig.run(20);
    assert_eq!(rig.machine.status().state, State::Eroding);
    assert_eq!(rig.status() & 0x3000, 0x2000, "homing error");
    assert!((rig.position() - before).abs() < 100);
}

#[test]
fn an_edge_is_found_where_touching_was_asked_for_and_is_a_fault_where_it_was_not() {
    let into_the_work = |touch: u8| {
        let mut rig = Rig::ready();
        rig.mode(1);
        rig.write(0x2001, 5, &[touch]);
        rig.write32(0x607A, 0, 5000);
        rig.control(0x0F);
        rig.control(0x1F);
        rig
    };
    let mut rig = into_the_work(1);
    rig.until(3000, |rig| rig.status() & 0x0400 != 0);
    let surface = rig.highest_peak();
    let offset = rig.machine.process.truth().count - rig.position();
    assert!((i64::from(rig.read(0x2001, 6).cast_signed()) + offset - surface).abs() <= 3);
    assert!((rig.position() + offset - surface + 10).abs() <= 4, "clear of it again");
    assert_eq!((rig.read(0x2000, 2), rig.read(0x2000, 3)), (0, 19), "no fault; touched");
    // Slow all the way: the limit shows.
    let mut rig = into_the_work(0);
    rig.run(100);
    assert_ne!(rig.status() & 1 << 11, 0, "10 mm/s asked for, 5 allowed");
    rig.until(3000, |rig| rig.status() & 0x6F == 0x08);
    assert_eq!(rig.read(0x603F, 0), 0xFF08);
}

#[test]
fn a_host_has_the_head_jump_while_it_erodes_and_is_told_why_not() {
    let mut rig = Rig::ready();
    rig.mode(1);
    assert_eq!((rig.read(0x2006, 5), rig.read(0x2000, 4)), (0, 0));
    assert_eq!(rig.try_write(0x2001, 7, &[1]), Err(0x0800_0022), "not in this state");
    rig.write(0x2001, 1, &[1]);
    rig.write32(0x607A, 0, 4000);
    rig.control(0x1F);
    rig.until(20_000, |rig| rig.machine.status().state == State::Eroding);
    let eroded = rig.read(0x2006, 3);
    rig.write(0x2001, 7, &[1]);
    rig.run(10);
    assert_eq!((rig.read(0x2000, 1), rig.read(0x2000, 3)), (13, 20), "jumping, a jump begun");
    rig.until(500, |rig| rig.machine.status().state == State::Eroding);
    rig.run(2);
    assert_eq!((rig.read(0x2000, 3), rig.read(0x2006, 5)), (21, 1), "back, one jump");
    // It is one erosion.
    assert!(rig.read(0x2006, 3) > eroded);
    let height = edm_servo_head::canopen::objects::setting_address("jump.height_um").unwrap();
    rig.write(height.0, height.1, &4000.0f32.to_le_bytes());
    rig.run(2);
    rig.write(0x2001, 7, &[1]);
    rig.run(5);
    assert_eq!((rig.read(0x2000, 1), rig.read(0x2000, 4)), (4, 19), "goes on eroding: longer than what is free");
    // Off in a jump: it comes back, and holds.
    rig.write(height.0, height.1, &500.0f32.to_le_bytes());
    rig.run(2);
    rig.write(0x2001, 7, &[1]);
    rig.run(10);
    rig.write(0x2001, 1, &[0]);
    rig.until(500, |rig| rig.machine.status().state == State::HoldingPosition);
}

//! The drive by its profile: state machine, modes, faults.

use crate::rig::Rig;
use edm_servo_head::head::{Fault, State};
use edm_sim::process::Cable;

#[test]
fn a_master_enables_step_by_step_and_each_step_shows() {
    let mut rig = Rig::new(|_, _| {});
    assert_eq!(rig.status() & 0x4F, 0x40);
    for (word, mask, shown) in [(0x06, 0x6F, 0x21), (0x07, 0x6F, 0x23), (0x0F, 0x6F, 0x27), (0x07, 0x6F, 0x23)] {
        rig.control(word);
        rig.until(100, |rig| rig.status() & mask == shown);
    }
    assert_eq!(rig.machine.status().state, State::Disabled);
    rig.control(0x0F);
    rig.until(5, |rig| rig.status() & 0x6F == 0x27);
    rig.control(0x00);
    assert_eq!(rig.status() & 0x4F, 0x40);
    assert_eq!(rig.machine.status().state, State::Disabled);
}

#[test]
fn a_transition_shows_within_two_milliseconds() {
    let mut rig = Rig::new(|_, _| {});
    rig.control(0x06);
    rig.control(0x07);
    rig.write(0x6040, 0, &[0x0F, 0]);
    let began = rig.ms;
    rig.until(5, |rig| rig.status() & 0x6F == 0x27);
    assert!(rig.ms - began <= 2, "{} ms", rig.ms - began);
}

#[test]
fn profile_position_goes_to_its_targets_and_acknowledges_them() {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.move_to(1500, 1000);
    assert!((rig.position() - 1500).abs() <= 2);
    rig.write(0x6081, 0, &30_000u32.to_le_bytes());
    rig.move_to(200, 1000);
    assert!((rig.position() - 200).abs() <= 2);
    // Relative, from the last target.
    rig.write32(0x607A, 0, 100);
    rig.control(0x4F);
    rig.control(0x5F);
    assert_eq!(rig.status() & 0x0400, 0, "not there yet");
    rig.until(1000, |rig| rig.status() & 0x0400 != 0);
    assert!((rig.position() - 300).abs() <= 2);
}

#[test]
fn a_second_set_point_waits_for_the_first_unless_it_is_to_change_at_once() {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.write32(0x607A, 0, 1000);
    rig.control(0x1F);
    rig.write32(0x607A, 0, 500);
    rig.control(0x0F);
    rig.control(0x1F);
    rig.control(0x0F);
    assert_ne!(rig.status() & 0x1000, 0, "the buffer is full");
    rig.until(1000, |rig| rig.position() >= 999);
    rig.until(1000, |rig| rig.status() & 0x0400 != 0 && (rig.position() - 500).abs() <= 2);
    assert_eq!(rig.status() & 0x1000, 0);

    rig.write32(0x607A, 0, 1800);
    rig.control(0x3F);
    rig.run(20);
    rig.write32(0x607A, 0, 400);
    rig.control(0x2F);
    rig.control(0x3F);
    let mut deepest = 0;
    rig.until(2000, |rig| {
        deepest = deepest.max(rig.position());
        rig.status() & 0x0400 != 0
    });
    assert!(deepest < 1200 && (rig.position() - 400).abs() <= 2, "{deepest}");
}

#[test]
fn a_target_beyond_the_software_limit_ends_there_and_says_so() {
    let mut rig = Rig::ready();
    rig.write32(0x607D, 2, 800);
    rig.mode(1);
    rig.move_to(1500, 1000);
    assert!((rig.position() - 800).abs() <= 2);
    assert_ne!(rig.status() & 0x0800, 0);
    assert_eq!(rig.try_write(0x607D, 1, &801i32.to_le_bytes()), Err(0x0604_0043));
}

#[test]
fn halt_brakes_and_its_end_lets_the_move_go_on() {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.write32(0x607A, 0, 1800);
    rig.control(0x1F);
    rig.run(50);
    rig.control(0x11F);
    rig.run(50);
    let halted = rig.position();
    assert!(halted < 1500 && rig.status() & 0x0400 != 0, "{halted}");
    rig.run(50);
    assert!((rig.position() - halted).abs() <= 2);
    rig.control(0x1F);
    rig.until(1000, |rig| rig.status() & 0x0400 != 0 && (rig.position() - 1800).abs() <= 2);
}

#[test]
fn profile_velocity_keeps_a_velocity_and_stops_at_the_limit() {
    let mut rig = Rig::ready();
    rig.write32(0x607D, 2, 1500);
    rig.mode(3);
    assert_ne!(rig.status() & 0x1000, 0, "standing");
    rig.write32(0x60FF, 0, 5000);
    rig.until(100, |rig| rig.status() & 0x0400 != 0);
    let from = rig.position();
    rig.run(100);
    let travel = rig.position() - from;
    assert!((travel - 500).abs() < 15, "{travel} counts in 0.1 s");
    let demanded = rig.read(0x606B, 0) as i32;
    assert!((demanded - 5000).abs() <= 1, "{demanded} counts/s demanded");
    rig.run(400);
    assert!((rig.position() - 1500).abs() <= 2);
    rig.write32(0x60FF, 0, -5000);
    rig.run(100);
    assert!(rig.position() < 1100);
    rig.write32(0x60FF, 0, 0);
    rig.until(100, |rig| rig.status() & 0x1400 == 0x1400);
}

#[test]
fn homing_on_the_limit_switch_is_no_fault() {
    let mut rig = Rig::new(|_, _| {});
    rig.enable();
    rig.mode(1);
    rig.move_to(1000, 1000);
    rig.write(0x6098, 0, &[17]);
    rig.write32(0x607C, 0, -50);
    rig.mode(6);
    rig.control(0x0F);
    rig.control(0x1F);
    assert_eq!(rig.status() & 0x3400, 0, "in progress");
    // A switch that opens at 500 um.
    let mut edge = 0.0;
    rig.until(5000, |rig| {
        let open = rig.machine.process.truth().position_um < 500.0;
        if rig.machine.process.fault_inputs.safety.upper_limit && !open {
            edge = rig.machine.process.truth().position_um;
        }
        rig.machine.process.fault_inputs.safety.upper_limit = open;
        assert_ne!(rig.status() & 0x4F, 0x08, "a home switch is no fault");
        rig.status() & 0x2400 != 0
    });
    assert_eq!(rig.status() & 0x3400, 0x1400);
    let off = rig.machine.process.truth().position_um - edge;
    assert!((rig.position() as f64 - 50.0 - off).abs() < 3.0, "{} counts, {off} um past the edge", rig.position());
}

#[test]
fn homing_that_cannot_be_says_so_and_can_be_interrupted() {
    let mut rig = Rig::ready();
    assert_eq!(rig.try_write(0x6098, 0, &[3]), Err(0x0609_0030));
    // The place found would lie below the travel.
    rig.write(0x6098, 0, &[35]);
    rig.write32(0x607C, 0, -13_000);
    rig.control(0x1F);
    rig.until(100, |rig| rig.status() & 0x3400 == 0x2400);
    // Downward to the next mark, and no further than the host waits.
    rig.write32(0x607C, 0, 0);
    rig.write(0x6098, 0, &[34]);
    rig.control(0x0F);
    rig.control(0x1F);
    rig.run(50);
    assert_eq!(rig.status() & 0x3400, 0);
    rig.control(0x0F);
    rig.until(100, |rig| rig.status() & 0x3400 == 0x0400);
}

/// Homes 1 mm below the stop; what the statusword and 2000h:9 say in the end.
fn home_from_1_mm(method: u8, change: impl Fn(&mut Rig)) -> (Rig, u16, u32) {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.move_to(1000, 1000);
    rig.write(0x6098, 0, &[method]);
    rig.write32(0x6099, 1, 50_000);
    change(&mut rig);
    rig.mode(6);
    rig.control(0x1F);
    rig.until(3000, |rig| rig.status() & 0x0400 != 0);
    let (status, error) = (rig.status(), rig.read(0x2000, 9));
    (rig, status, error)
}

#[test]
fn homing_that_meets_a_stop_or_the_work_is_a_homing_error_and_no_fault() {
    // No switch is there: 17 and 33 end at the stop, 18 and 34 in the work 1 mm below.
    for (method, error) in [(1, 3), (17, 3), (33, 3), (2, 4), (18, 4), (34, 4)] {
        let (mut rig, status, why) = home_from_1_mm(method, |_| {});
        assert_eq!((status & 0x3400, status & 0x6F, why), (0x2400, 0x27, error), "method {method}");
        assert_eq!(rig.read(0x603F, 0), 0, "method {method}");
        assert!(!rig.states.contains(&State::Fault), "method {method}: {:?}", rig.states);
        // The home of before is as good as it was: the axis has gone back and may go on.
        assert_eq!(rig.read(0x2000, 5), 1);
        rig.control(0x0F);
        rig.write(0x6098, 0, &[37]);
        rig.control(0x1F);
        rig.until(100, |rig| rig.status() & 0x3400 == 0x1400);
        assert_eq!(rig.read(0x2000, 9), 0, "it has not failed last");
    }
}

#[test]
fn homing_on_contact_makes_the_work_the_home_and_is_refused_without_its_sense() {
    let (mut rig, status, why) = home_from_1_mm(0xFF, |rig| rig.write32(0x607C, 0, -3000));
    assert_eq!((status & 0x3400, why), (0x1400, 0));
    // 10 um above the work, which is at 3000 now.
    rig.run(20);
    assert!((rig.position() - 2990).abs() <= 1, "{}", rig.position());
    assert_eq!(rig.read(0x60FD, 0) & 1 << 20, 0, "clear of it");
    assert!(!rig.states.iter().any(|state| state.pulses()), "{:?}", rig.states);
    let (index, sub) = edm_servo_head::canopen::objects::setting_address("contact.below_v").unwrap();
    rig.control(0x06);
    rig.run(50);
    rig.write(index, sub, &0f32.to_le_bytes());
    rig.enable();
    rig.control(0x1F);
    rig.until(100, |rig| rig.status() & 0x3400 == 0x2400);
    assert_eq!((rig.read(0x2000, 9), rig.read(0x2000, 4)), (5, 13));
}

#[test]
fn the_homing_methods_that_are_listed_are_those_that_are_taken() {
    let mut rig = Rig::ready();
    let listed: Vec<i8> = (1..=rig.read(0x60E3, 0) as u8).map(|sub| rig.read(0x60E3, sub) as i8).collect();
    for method in i8::MIN..=i8::MAX {
        let taken = rig.try_write(0x6098, 0, &method.to_le_bytes()).is_ok();
        assert_eq!(taken, listed.contains(&method), "{method}");
    }
}

#[test]
fn cyclic_set_points_by_sync_are_followed_in_the_next_tick() {
    let mut rig = Rig::ready();
    rig.write(0x1402, 2, &[255]);
    rig.write(0x1401, 2, &[1]);
    rig.mode(8);
    let start = rig.position() as i32;
    let mut worst = 0;
    for ms in 1..=300 {
        let target = start + ms * 5;
        rig.send(0x305, &target.to_le_bytes());
        rig.send(0x80, &[]);
        rig.step();
        worst = worst.max((rig.position() as i32 - target).abs());
        assert_ne!(rig.status() & 0x1000, 0, "follows");
    }
    // 5 mm/s: a millisecond and the loop behind.
    assert!(worst < 20, "{worst} counts behind");
    rig.run(50);
    assert!((rig.position() as i32 - start - 1500).abs() <= 2);
}

#[test]
fn interpolated_set_points_wait_in_their_buffer() {
    let mut rig = Rig::ready();
    rig.mode(7);
    rig.write(0x60C2, 1, &[10]);
    let start = rig.position() as i32;
    for n in 1..=20 {
        rig.write32(0x60C1, 1, start + n * 20);
    }
    assert_eq!(rig.read(0x60C4, 4), 20);
    assert!((rig.position() as i32 - start).abs() <= 1, "not before it is enabled");
    rig.control(0x1F);
    assert_ne!(rig.status() & 0x1000, 0);
    rig.run(100);
    let way = rig.position() as i32 - start;
    assert!((160..=230).contains(&way), "{way} of 200 counts in 100 ms");
    rig.run(150);
    assert!((rig.position() as i32 - start - 400).abs() <= 2);
    rig.control(0x0F);
    for n in 0..32 {
        rig.write32(0x60C1, 1, n);
    }
    assert_eq!(rig.try_write(0x60C1, 1, &[0; 4]), Err(0x0800_0022));
    rig.write(0x60C4, 6, &[0]);
    assert_eq!(rig.read(0x60C4, 4), 0);
}

#[test]
fn a_quick_stop_brakes_and_stays_until_it_is_left() {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.write32(0x607A, 0, 1800);
    rig.control(0x1F);
    rig.run(50);
    let before = rig.position();
    rig.control(0x02);
    assert_eq!(rig.status() & 0x6F, 0x07);
    rig.run(500);
    assert_eq!(rig.status() & 0x6F, 0x07);
    // 10 mm/s at 5 m/s^2.
    assert!((rig.position() - before) < 40, "{} um on", rig.position() - before);
    assert_eq!(rig.machine.status().state, State::Ready);
    rig.control(0x0F);
    assert_eq!(rig.status() & 0x6F, 0x27);
    rig.write(0x605A, 0, &2i16.to_le_bytes());
    rig.control(0x02);
    rig.until(100, |rig| rig.status() & 0x4F == 0x40);
    assert_eq!(rig.machine.status().state, State::Disabled);
}

#[test]
fn a_fault_shows_its_code_and_is_reset_by_a_rising_edge_once_its_cause_is_gone() {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.machine.process.fault_inputs.safety.emergency_stop = true;
    rig.run(3);
    assert!(matches!(rig.status() & 0x4F, 0x0F | 0x08));
    rig.until(1500, |rig| rig.status() & 0x4F == 0x08);
    assert_eq!(rig.read(0x603F, 0), 0x9000);
    assert_eq!(rig.read(0x1001, 0) & 1, 1);
    let emergencies: Vec<_> = rig.sent.iter().filter(|(_, frame)| frame.id() == 0x85).collect();
    assert_eq!(emergencies.last().unwrap().1.data()[..2], [0x00, 0x90]);
    rig.control(0x80);
    assert_eq!(rig.status() & 0x4F, 0x08, "the cause is still there");
    rig.machine.process.fault_inputs.safety.emergency_stop = false;
    rig.run(5);
    assert_eq!(rig.status() & 0x4F, 0x08, "no new edge");
    rig.control(0x00);
    rig.control(0x80);
    rig.until(5, |rig| rig.status() & 0x4F == 0x40);
    assert_eq!((rig.read(0x603F, 0), rig.read(0x1001, 0)), (0, 0));
    rig.enable();
}

#[test]
fn a_host_that_falls_silent_stops_the_drive() {
    let mut rig = Rig::new(|_, _| {});
    rig.send(0, &[1, 5]);
    rig.write(0x1016, 1, &(0x0001_0000u32 | 100).to_le_bytes());
    rig.enable();
    for _ in 0..5 {
        rig.send(0x701, &[5]);
        rig.run(50);
    }
    assert_eq!(rig.status() & 0x6F, 0x27);
    rig.until(200, |rig| matches!(rig.status() & 0x4F, 0x0F | 0x08));
    assert_eq!(rig.read(0x603F, 0), 0x8130);
    // At the upper stop, without a home, the retrace ends in another fault.
    rig.until(1500, |rig| rig.status() & 0x4F == 0x08);
}

#[test]
fn the_first_tpdo_tells_of_a_change_at_once_and_repeats_every_50_ms() {
    let mut rig = Rig::new(|_, _| {});
    rig.send(0, &[1, 5]);
    rig.run(300);
    let times: Vec<u64> = rig.sent.iter().filter(|(_, frame)| frame.id() == 0x185).map(|(ms, _)| *ms).collect();
    assert!(times.len() >= 6 && times.windows(2).all(|pair| pair[1] - pair[0] <= 50), "{times:?}");
    rig.write(0x6040, 0, &[0x06, 0]);
    let began = rig.ms;
    rig.step();
    let (ms, frame) = rig.sent.iter().rev().find(|(_, frame)| frame.id() == 0x185).unwrap();
    assert!(began - ms <= 1 && frame.data()[0] & 0x6F == 0x21, "{frame:?}");
}

#[test]
fn negative_and_unknown_modes_are_refused() {
    let mut rig = Rig::ready();
    assert_eq!(rig.try_write(0x6060, 0, &[0xFE]), Err(0x0609_0032));
    assert_eq!(rig.try_write(0x6060, 0, &[10]), Err(0x0609_0031));
    assert_eq!(rig.try_write(0x6060, 0, &[4]), Err(0x0609_0030));
    assert_eq!(rig.read(0x6502, 0), 0x101E5);
}

#[test]
fn a_second_fault_has_an_emergency_of_its_own_that_names_the_first() {
    let mut rig = Rig::ready();
    rig.machine.raise(Fault::HostSilent);
    rig.run(100);
    assert_eq!((rig.read(0x2000, 2), rig.read(0x2000, 6)), (6, 6));
    rig.machine.raise(Fault::EncoderLost);
    rig.run(10);
    assert_eq!((rig.read(0x2000, 2), rig.read(0x2000, 6), rig.read(0x603F, 0)), (11, 6, 0x7305));
    let emergencies: Vec<_> = rig.sent.iter().filter(|(_, frame)| frame.id() == 0x85).collect();
    let codes: Vec<_> = emergencies.iter().map(|(_, frame)| (frame.data()[..2].to_vec(), frame.data()[5])).collect();
    assert_eq!(codes, [(vec![0x30, 0x81], 6), (vec![0x05, 0x73], 6)]);
}

#[test]
fn an_ordinary_master_enables_a_head_whose_encoder_has_to_prove_itself() {
    let mut rig = Rig::ready();
    for dead in [false, true, false] {
        rig.machine.raise(Fault::EncoderLost);
        rig.until(1500, |rig| rig.status() & 0x4F == 0x08);
        rig.machine.process.fault_inputs.encoder = if dead { Cable::CUT } else { Cable::default() };
        rig.control(0x00);
        rig.control(0x80);
        rig.until(5, |rig| rig.status() & 0x4F == 0x40);
        for word in [0x06, 0x07, 0x0F] {
            rig.control(word);
        }
        assert_eq!((rig.status() & 0x6F, rig.machine.status().state), (0x23, State::Proving), "not yet");
        if dead {
            rig.until(100, |rig| matches!(rig.status() & 0x4F, 0x0F | 0x08));
            assert_eq!(rig.machine.status().fault, Some(Fault::EncoderLost));
            rig.until(1500, |rig| rig.status() & 0x4F == 0x08);
            rig.machine.process.fault_inputs.encoder = Cable::default();
            rig.control(0x00);
            rig.control(0x80);
            rig.until(5, |rig| rig.status() & 0x4F == 0x40);
            for word in [0x06, 0x07, 0x0F] {
                rig.control(word);
            }
        }
        rig.until(100, |rig| rig.status() & 0x6F == 0x27);
    }
}

#[test]
fn a_head_that_proves_its_encoder_can_be_switched_off_meanwhile() {
    let mut rig = Rig::ready();
    rig.machine.raise(Fault::EncoderLost);
    rig.until(1500, |rig| rig.status() & 0x4F == 0x08);
    for word in [0x00, 0x80, 0x06, 0x07, 0x0F] {
        rig.control(word);
    }
    assert_eq!(rig.machine.status().state, State::Proving);
    rig.control(0x00);
    rig.run(5);
    assert_eq!((rig.status() & 0x4F, rig.machine.status().state), (0x40, State::Disabled));
}

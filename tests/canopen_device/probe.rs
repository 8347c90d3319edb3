//! The touch probe over the bus: what it keeps, when, and what is refused.

use crate::rig::Rig;
use edm_servo_head::canopen::objects::setting_address;
use edm_servo_head::head::State;

/// Bits of 60B8h.
const ON: u16 = 1;
const EVERY: u16 = 2;
const INDEX: u16 = 4;
const CHOSEN: u16 = 8;
const BEGINS: u16 = 0x10;
const ENDS: u16 = 0x20;

/// Ns of a servo tick.
const TICK: u32 = 50_000;

fn arm(rig: &mut Rig, function: u16) {
    rig.write(0x60B8, 0, &function.to_le_bytes());
    rig.run(2);
}

/// Profile position to a target into which the electrode may run, at 5 mm/s.
fn touch(rig: &mut Rig, target: i32) {
    rig.mode(1);
    rig.write(0x2001, 5, &[1]);
    rig.write32(0x6081, 0, 5000);
    rig.move_to(target, 2000);
}

#[test]
fn a_contact_is_kept_where_and_when_it_begins_and_ends() {
    let mut rig = Rig::ready();
    arm(&mut rig, ON | BEGINS | ENDS);
    assert_eq!(rig.read(0x60B9, 0), 1);
    let before = rig.read(0x2000, 10);
    touch(&mut rig, 3000);
    assert_eq!(rig.read(0x60B9, 0), 0b111);
    let [begun, ended] = [0x60BA, 0x60BB].map(|index| rig.read(index, 0) as i32);
    // The peaks of the work are 2 mm below where the head was homed, and the head has left them again.
    let peak = rig.highest_peak();
    let touched = rig.read(0x2001, 6) as i32;
    assert!((i64::from(begun) - peak).abs() <= 2 && (begun - touched).abs() <= 1, "{begun}, {touched}, {peak}");
    assert!(ended <= begun && ended >= begun - 10, "{ended} from {begun}");
    let [came, went, now] = [(0x60D1, 0), (0x60D2, 0), (0x2000, 10)].map(|(index, sub)| rig.read(index, sub));
    let since = |time: u32| time.wrapping_sub(before);
    assert!(since(came) < since(went) && since(went) < since(now), "{before} {came} {went} {now}");
    // 2 mm at 5 mm/s.
    assert!((395_000_000..=420_000_000).contains(&since(came)) && since(came) % TICK == 0, "{} ns", since(came));
    // One more is not kept, until the probe is armed anew.
    touch(&mut rig, 1500);
    touch(&mut rig, 3000);
    assert_eq!([0x60D1, 0x60D2].map(|index| rig.read(index, 0)), [came, went]);
    assert_eq!(rig.read(0x60D5, 0), 1);
    touch(&mut rig, 1500);
    arm(&mut rig, 0);
    assert_eq!(rig.read(0x60B9, 0), 0);
    arm(&mut rig, ON | BEGINS);
    assert_eq!(rig.read(0x60B9, 0), 1);
    touch(&mut rig, 3000);
    assert_eq!(rig.read(0x60B9, 0), 0b011);
    assert_ne!(rig.read(0x60D1, 0), came);
    assert_eq!(rig.read(0x60D2, 0), went, "nobody has asked for it");
    assert_eq!(rig.states.iter().filter(|state| state.pulses()).count(), 0);
}

#[test]
fn every_edge_turns_a_bit_over_and_a_pdo_tells_of_it_at_once() {
    let mut rig = Rig::ready();
    // TPDO 4: status and position, at each change.
    rig.write32(0x1803, 1, -0x7FFF_FB7B);
    rig.write(0x1A03, 0, &[0]);
    rig.write32(0x1A03, 1, 0x60B9_0010);
    rig.write32(0x1A03, 2, 0x60BA_0020);
    rig.write(0x1A03, 0, &[2]);
    rig.write(0x1803, 2, &[255]);
    rig.write(0x1803, 3, &[0, 0]);
    rig.write(0x1803, 5, &[0, 0]);
    rig.write32(0x1803, 1, 0x485);
    arm(&mut rig, ON | EVERY | BEGINS);
    rig.sent.clear();
    for turn in [0x40, 0, 0x40] {
        touch(&mut rig, 3000);
        touch(&mut rig, 1900);
        let (_, frame) = *rig.sent.iter().rev().find(|(_, frame)| frame.id() == 0x485).unwrap();
        let position = rig.read(0x60BA, 0);
        assert_eq!(frame.data()[..2], [0b011 | turn, 0]);
        assert_eq!(frame.data()[2..], position.to_le_bytes());
    }
    assert_eq!(rig.sent.iter().filter(|(_, frame)| frame.id() == 0x485).count(), 3);
    assert_eq!(rig.read(0x60D5, 0), 3);
}

#[test]
fn an_index_mark_is_kept_where_the_decoder_has_timed_it() {
    let mut rig = Rig::new(|_, plant| plant.installation.surface = 11.5);
    rig.send(0, &[1, crate::rig::ID]);
    rig.enable();
    arm(&mut rig, (ON | INDEX | EVERY | BEGINS | ENDS) << 8);
    assert_eq!(rig.read(0x60B9, 0), 0x0100);
    rig.mode(1);
    rig.write32(0x6081, 0, 20_000);
    rig.move_to(10_300, 4000);
    assert_eq!(rig.read(0x60B9, 0), 0x4300);
    // Marks lie every 10 mm of the scale, whose zero is the upper stop.
    let mark = 10_000 + rig.position() - rig.machine.process.truth().count;
    assert_eq!(i64::from(rig.read(0x60BC, 0) as i32), mark);
    let down = rig.read(0x60D3, 0);
    rig.move_to(9_700, 4000);
    assert_eq!(rig.read(0x60B9, 0), 0xC700);
    assert_eq!(i64::from(rig.read(0x60BD, 0) as i32), mark);
    let up = rig.read(0x60D4, 0);
    assert!(up.wrapping_sub(down).is_multiple_of(TICK) && up.wrapping_sub(down) > 50_000_000, "{down} {up}");
    // A home given since moves what was kept along with the axis.
    rig.write(0x6098, 0, &[35]);
    rig.write32(0x607C, 0, -5000);
    let before = rig.position();
    rig.mode(6);
    rig.control(0x0F);
    rig.control(0x1F);
    rig.until(100, |rig| rig.status() & 0x3400 == 0x1400);
    let by = rig.position() - before;
    assert!((by + 4700).abs() < 5, "{by}");
    assert_eq!(i64::from(rig.read(0x60BC, 0) as i32), mark + by);
}

#[test]
fn the_first_discharge_is_kept_before_the_filter_knows_of_the_work() {
    let mut rig = Rig::ready();
    rig.write(0x60D0, 1, &(-1i16).to_le_bytes());
    arm(&mut rig, ON | CHOSEN | BEGINS);
    rig.mode(1);
    rig.write(0x2001, 1, &[1]);
    rig.write32(0x607A, 0, 4000);
    rig.control(0x0F);
    rig.control(0x1F);
    // Discharges in the model by the end of each millisecond, and the time of the newest tick then.
    let mut seen = Vec::new();
    rig.until(20_000, |rig| {
        let status = rig.machine.status();
        seen.push((status.tick.wrapping_mul(TICK), rig.machine.process.truth().pulses.discharges()));
        status.state == State::Eroding
    });
    rig.run(3);
    let (position, time) = (rig.read(0x60BA, 0) as i32, rig.read(0x60D1, 0));
    assert_eq!(rig.read(0x60B9, 0), 0b011);
    let found = rig.read(0x2000, 10).wrapping_sub(time);
    assert!((1_000_000..2_000_000_000).contains(&found), "{found} ns before");
    let after = |other: u32| other.wrapping_sub(time).cast_signed();
    let before = seen.iter().rfind(|(end, _)| after(*end) < 0).unwrap().1;
    let by_then = seen.iter().find(|(end, _)| after(*end) >= 0).unwrap().1;
    assert_eq!((before, by_then), (0, 1), "discharges before its millisecond, and by its end");
    let gap = rig.machine.process.truth().first_surface_um - f64::from(position);
    assert!((10.0..200.0).contains(&gap), "in a gap of {gap} um");
    // There are more, which are not kept.
    rig.run(500);
    assert_eq!((rig.read(0x60D1, 0), rig.read(0x60D5, 0)), (time, 1));
    arm(&mut rig, ON | CHOSEN | EVERY | BEGINS);
    rig.run(500);
    assert!(rig.read(0x60D5, 0) > 10, "{}", rig.read(0x60D5, 0));
}

#[test]
fn what_a_probe_cannot_do_is_refused() {
    let mut rig = Rig::ready();
    for (function, abort) in [(0x40, 0x0609_0030), (0x8000, 0x0609_0030), (0x0C, 0x0609_0030), (0x0D00, 0x0609_0030)] {
        assert_eq!(rig.try_write(0x60B8, 0, &(function as u16).to_le_bytes()), Err(abort), "{function:#x}");
        assert_eq!(rig.read(0x60B8, 0), 0);
    }
    for source in [0i16, 2, 3, 4] {
        assert_eq!(rig.try_write(0x60D0, 1, &source.to_le_bytes()), Err(0x0609_0030), "{source}");
    }
    assert_eq!(rig.try_write(0x60D0, 1, &6i16.to_le_bytes()), Err(0x0609_0031));
    arm(&mut rig, ON | CHOSEN | BEGINS);
    assert_eq!(rig.try_write(0x60D0, 1, &5i16.to_le_bytes()), Err(0x0800_0022));
    rig.write(0x60D0, 2, &(-1i16).to_le_bytes());
    // A reset switches it off.
    rig.send(0, &[129, crate::rig::ID]);
    rig.run(100);
    assert_eq!((rig.read(0x60B8, 0), rig.read(0x60B9, 0)), (0, 0));
    assert!(rig.machine.status().probes.iter().all(|latched| latched.probe.source as u8 == 0));
    let (index, sub) = setting_address("contact.below_v").unwrap();
    rig.write(index, sub, &0f32.to_le_bytes());
    assert_eq!(rig.try_write(0x60B8, 0, &(ON | BEGINS).to_le_bytes()), Err(0x0800_0022), "no sense supply");
    arm(&mut rig, ON | INDEX | BEGINS);
    assert_eq!(rig.read(0x60B9, 0), 1);
}

//! The inch-worm over the bus: the head asks, and the host answers.

use crate::rig::Rig;
use edm_servo_head::head::{Inch, State};

const ABORT_STATE: u32 = 0x0800_0022;
const ASKS: u16 = 1 << 15;
const WARNING: u16 = 1 << 7;

/// A head of a short stroke in the open, that is to go far below its travel.
fn seeking() -> Rig {
    let mut rig = Rig::new(|settings, plant| {
        (settings.axis_stroke, settings.inch_step, settings.inch_patience) = (3000.0, 1500.0, 2.0);
        (settings.seek_velocity, plant.installation.surface) = (5000.0, 11.0);
    });
    rig.make_ready();
    rig.mode(1);
    rig.write(0x2001, 1, &[1]);
    rig.write32(0x607A, 0, 6000);
    rig.control(0x1F);
    rig
}

fn asks(rig: &mut Rig) {
    rig.until(5000, |rig| rig.status() & ASKS != 0);
}

#[test]
fn a_host_that_answers_every_question_leads_the_head_below_its_travel() {
    let mut rig = seeking();
    for (word, moves) in [(true, 1), (false, 2), (true, 3)] {
        let sent = rig.sent.len();
        asks(&mut rig);
        rig.run(5);
        // TPDO 1 has the statusword: the question comes by itself.
        let told = rig.sent[sent..].iter().filter(|(_, frame)| frame.id() == 0x185);
        assert!(told.clone().any(|(_, frame)| frame.data()[1] & 0x80 != 0), "{}", told.count());
        assert_eq!((rig.read(0x2014, 1), rig.read(0x2014, 2)), (Inch::Asks as u32, 1));
        let to = rig.read(0x2014, 3) as i32;
        assert_eq!(to, 1500 * moves);
        assert_eq!(rig.read(0x2000, 3), 29, "the end of the stroke");
        let before = rig.position() as i32;
        if word {
            rig.write32(0x2014, 4, to);
        } else {
            rig.write(0x2014, 5, &[1]);
        }
        rig.run(2);
        assert_eq!(rig.status() & ASKS, 0);
        assert_eq!((rig.read(0x2014, 4) as i32, rig.read(0x2014, 6) as i32), (to, to));
        // It is on its way down already.
        assert!((1490..1600).contains(&(rig.position() as i32 - before)), "{before}");
        rig.until(2000, |rig| rig.machine.status().state == State::Seeking);
        rig.run(2);
        assert_eq!((rig.read(0x2014, 1), rig.read(0x2014, 7)), (0, moves as u32));
    }
    rig.until(5000, |rig| rig.machine.status().state == State::Done);
    assert!((rig.position() as i32 - 6000).abs() <= 1, "{}", rig.position() as i32);
}

#[test]
fn an_answer_is_a_change_and_comes_only_to_a_question() {
    let mut rig = seeking();
    assert_eq!(rig.try_write(0x2014, 5, &[1]), Err(ABORT_STATE), "nothing is asked");
    assert_eq!(rig.try_write(0x2014, 4, &1500i32.to_le_bytes()), Err(ABORT_STATE), "it moves");
    asks(&mut rig);
    rig.write(0x2014, 5, &[1]);
    asks(&mut rig);
    // The answer to the question before is still there.
    assert_eq!(rig.try_write(0x2014, 5, &[1]), Err(ABORT_STATE));
    rig.run(100);
    assert_ne!(rig.status() & ASKS, 0);
    rig.write(0x2014, 5, &[0]);
    rig.write(0x2014, 5, &[1]);
    rig.until(2000, |rig| rig.machine.status().state == State::Seeking);
}

#[test]
fn a_refusal_holds_and_a_host_that_is_late_or_contradicts_is_warned() {
    let mut rig = seeking();
    asks(&mut rig);
    rig.write(0x2014, 5, &[2]);
    rig.until(3000, |rig| rig.machine.status().state == State::HoldingPosition);
    rig.run(2);
    assert_eq!((rig.read(0x2000, 3), rig.read(0x2014, 1), rig.read(0x2014, 6)), (31, 0, 0));
    // Once more.
    rig.write(0x2001, 1, &[1]);
    asks(&mut rig);
    assert_eq!(rig.status() & WARNING, 0);
    rig.until(3000, |rig| rig.status() & ASKS == 0);
    assert_eq!(rig.status() & WARNING, WARNING);
    assert_eq!(rig.read(0x2014, 1), Inch::Late as u32);
    // Another axis has moved.
    rig.write32(0x2014, 4, 900);
    rig.run(5);
    assert_eq!((rig.read(0x2014, 1), rig.read(0x2014, 6)), (Inch::Contradicts as u32, 0));
    assert_eq!(rig.status() & WARNING, WARNING);
    rig.write32(0x2014, 4, 1500);
    rig.until(2000, |rig| rig.machine.status().state == State::Seeking);
    assert_eq!(rig.status() & WARNING, 0);
}

#[test]
fn at_rest_a_host_says_where_the_coarse_axis_is() {
    let mut rig = Rig::ready();
    rig.mode(1);
    let before = rig.position() as i32;
    rig.write32(0x2014, 4, -2000);
    rig.run(3);
    assert_eq!(rig.read(0x2014, 6) as i32, -2000);
    assert!((rig.position() as i32 - before + 2000).abs() <= 1, "{} from {before}", rig.position());
    // The travel goes along.
    rig.write32(0x607A, 0, -1000);
    rig.control(0x1F);
    rig.until(3000, |rig| rig.status() & 0x0400 != 0);
    assert!((rig.position() as i32 + 1000).abs() <= 2);
    rig.mode(8);
    assert_eq!(rig.try_write(0x2014, 4, &0i32.to_le_bytes()), Err(ABORT_STATE), "set points come by themselves");
}

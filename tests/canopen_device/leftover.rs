//! Erosion that was asked for while the head still positioned, and is no longer wanted when it has come to rest.

use crate::rig::{ID, Rig};
use edm_servo_head::head::{Fault, State};

/// What a host does in the same millisecond in which it asked.
type Then = (&'static str, &'static [u16]);

/// Controlwords after which nobody waits for erosion to begin, and at the end the operation is enabled again.
const OVER: [Then; 5] = [
    ("disable operation", &[0x07, 0x0F]),
    ("shutdown", &[0x06, 0x07, 0x0F]),
    ("disable voltage", &[0x00, 0x06, 0x07, 0x0F]),
    ("quick stop that ends in switch on disabled", &[0x0B, 0x06, 0x07, 0x0F]),
    ("quick stop taken back", &[0x0B, 0x0F]),
];

/// Cyclic set points move the axis.
fn followed(quick_stop: u8) -> Rig {
    let mut rig = Rig::ready();
    rig.write(0x605A, 0, &[quick_stop, 0]);
    rig.mode(8);
    let here = rig.position() as i32;
    for n in 1..=50 {
        rig.write32(0x607A, 0, here + 4 * n);
        rig.run(1);
    }
    assert_eq!(rig.machine.status().state, State::Positioning);
    rig
}

/// Two frames in a row: 2001h:1, and a controlword.
fn ask_and(rig: &mut Rig, erode: u8, word: u16) {
    rig.send(0x600 + u16::from(ID), &[0x2F, 0x01, 0x20, 1, erode, 0, 0, 0]);
    rig.send(0x200 + u16::from(ID), &word.to_le_bytes());
}

fn pulses_within(rig: &mut Rig, ms: u64) -> bool {
    (0..ms).any(|_| {
        rig.step();
        rig.machine.status().state.pulses()
    })
}

#[test]
fn who_enables_again_does_not_begin_what_was_asked_before() {
    let mut wrong = vec![];
    for erode in [1, 2] {
        for (what, words) in OVER {
            let mut rig = followed(if what.ends_with("back") { 6 } else { 2 });
            ask_and(&mut rig, erode, words[0]);
            let before = pulses_within(&mut rig, 1500);
            for word in &words[1..] {
                rig.control(*word);
            }
            if before || pulses_within(&mut rig, 500) {
                wrong.push((erode, what, before));
            }
        }
    }
    assert!(wrong.is_empty(), "pulses that nobody asked for: {wrong:?}");
}

#[test]
fn a_head_that_is_halted_does_not_begin() {
    for erode in [1, 2] {
        let mut rig = followed(2);
        ask_and(&mut rig, erode, 0x10F);
        assert!(!pulses_within(&mut rig, 500), "2001h:1 {erode}: pulses while halted");
    }
}

#[test]
fn a_change_of_mode_does_not_begin_what_2001h_1_has_kept() {
    for words in [&[0x07u16, 0x0F][..], &[0x0B, 0x06, 0x07, 0x0F]] {
        let mut rig = Rig::ready();
        rig.mode(8);
        rig.write(0x2001, 1, &[2]);
        rig.until(200, |rig| rig.machine.status().state == State::Guiding);
        for word in words {
            rig.control(*word);
            rig.run(200);
        }
        assert!(!pulses_within(&mut rig, 200), "enabled again after {words:x?}: pulses");
        rig.mode(3);
        assert!(!pulses_within(&mut rig, 200), "in velocity mode");
        rig.write32(0x60FF, 0, 2000);
        rig.run(50);
        assert_eq!(rig.machine.status().state, State::Positioning);
        rig.mode(8);
        assert!(!pulses_within(&mut rig, 500), "a change of mode: pulses after {words:x?}");
    }
}

#[test]
fn a_host_that_is_lost_and_back_does_not_begin_what_it_asked_before() {
    for (option, words) in [(2u8, &[0x06u16, 0x07, 0x0F][..]), (3, &[0x06, 0x07, 0x0F])] {
        let mut rig = followed(2);
        rig.write(0x6007, 0, &[option, 0]);
        rig.send(0x600 + u16::from(ID), &[0x2F, 0x01, 0x20, 1, 2, 0, 0, 0]);
        rig.send(0, &[128, ID]);
        assert!(!pulses_within(&mut rig, 1500), "6007h {option}");
        rig.send(0, &[1, ID]);
        for word in words {
            rig.control(*word);
        }
        assert!(!pulses_within(&mut rig, 500), "6007h {option}: pulses when the host is back");
    }
}

#[test]
fn what_is_withdrawn_does_not_begin() {
    for erode in [1, 2] {
        let mut rig = followed(2);
        rig.send(0x600 + u16::from(ID), &[0x2F, 0x01, 0x20, 1, erode, 0, 0, 0]);
        rig.send(0x600 + u16::from(ID), &[0x2F, 0x01, 0x20, 1, 0, 0, 0, 0]);
        assert!(!pulses_within(&mut rig, 500));
        // Nor after a fault.
        rig.write32(0x607A, 0, rig.position() as i32 + 50);
        rig.run(3);
        rig.send(0x600 + u16::from(ID), &[0x2F, 0x01, 0x20, 1, erode, 0, 0, 0]);
        rig.machine.raise(Fault::HostSilent);
        rig.run(1500);
        for word in [0x80, 0x06, 0x07, 0x0F] {
            rig.control(word);
        }
        assert!(!pulses_within(&mut rig, 500));
    }
}

//! Faults of the bus: frames of a wrong length, a line, a babbling neighbour, a second master.

use super::case::{Case, Expect};
use super::limits::{HOST_US, ON};
use super::stage::{Scene, Stage};
use crate::host::{HOST, NODE};
use edm_servo_head::head::State;
use edm_soc::{CanReply, Frame};

use Expect::{Harmless, Named, Obeyed};
use Scene::{Eroding, Positioning};

/// Frames that the head listens to, of this length on the wire: controlword and set points as they are, a request, SYNC, NMT,
/// a heartbeat.
fn of_length(length: u8) -> Vec<Frame> {
    let frames: [(u16, &[u8]); 7] = [
        (0x200 + NODE, &[0xF]),
        (0x300 + NODE, &[]),
        (0x400 + NODE, &[]),
        (0x600 + NODE, &[0x40, 0, 0x10]),
        (0x080, &[]),
        (0x000, &[1, NODE as u8]),
        (0x700 + HOST, &[5]),
    ];
    frames.into_iter().map(|(id, data)| Frame { length, ..Frame::new(id, data) }).collect()
}

/// Frames in a millisecond that fill a bus of 1 Mbit/s.
const FULL: usize = 7;

/// The cases.
pub fn bus(cases: &mut Vec<Case>) {
    for length in 0..=15 {
        let names: &[&str] = if length < 4 { &["PDO too short"] } else { &["PDO too long"] };
        let case = Case::new(format!("frames of length {length}"), Eroding, Named(names, ON), move |stage| {
            for frame in of_length(length) {
                stage.rig.send_at(0, frame);
            }
            Ok(())
        });
        cases.push(case.watched(300));
    }
    for (name, reply) in
        [("bus shorted: bit errors", CanReply::BitError), ("bus cut: no acknowledgement", CanReply::NoAcknowledge)]
    {
        cases.push(Case::new(name, Eroding, Named(&["host silent", "2000h:2 host silent"], HOST_US), move |stage| {
            stage.rig.host_alive = false;
            stage.rig.machine_mut().soc().world.reply = reply;
            Ok(())
        }));
    }
    let babble = |id: u16, data: &'static [u8]| {
        move |stage: &mut Stage| {
            for _ in 0..FULL {
                stage.rig.send_at(0, Frame::new(id, data));
            }
            Ok(())
        }
    };
    let silent = |stage: &mut Stage| {
        stage.rig.host_alive = false;
        Ok(())
    };
    let fine = |_: &mut Stage| Ok(());
    cases.push(
        Case::new("babbling neighbour with the highest priority", Eroding, Named(&["host silent"], HOST_US), silent)
            .meanwhile(babble(0x001, &[0xAA; 8])),
    );
    cases.push(
        Case::new("babbling neighbour with a foreign identifier", Eroding, Harmless(None), fine)
            .meanwhile(babble(0x7FF, &[0xAA; 8])),
    );
    cases.push(
        Case::new("babbling neighbour with SYNC", Eroding, Named(&["SYNC of a wrong length", "frames lost"], ON), fine)
            .meanwhile(babble(0x080, &[0; 8])),
    );
    cases.push(
        Case::new("babbling neighbour with set points", Eroding, Named(&["PDO too long"], ON), fine)
            .meanwhile(babble(0x301, &[0; 8])),
    );
    // A second master.
    cases.push(Case::new("two masters: the other disables", Eroding, Obeyed(&[State::Disabled], 5_000.0), |stage| {
        stage.rig.send_at(0, Frame::new(0x200 + NODE, &[0, 0]));
        Ok(())
    }));
    cases.push(
        Case::new("two masters: the other sends requests all the time", Eroding, Harmless(None), fine).meanwhile(
            |stage| {
                stage.rig.send_at(0, Frame::new(0x600 + NODE, &[0x40, 0x41, 0x60, 0, 0, 0, 0, 0]));
                Ok(())
            },
        ),
    );
    cases.push(Case::new("two masters: the other widens the supervision", Eroding, Harmless(None), |stage| {
        // 2107h:7, the lowest bus voltage, to 3 V.
        let [a, b, c, d] = 3f32.to_le_bytes();
        stage.rig.send_at(0, Frame::new(0x600 + NODE, &[0x23, 0x07, 0x21, 7, a, b, c, d]));
        Ok(())
    }));
    cases.push(Case::new(
        "two masters: the other stops the node",
        Eroding,
        Named(&["host silent", "log: host silent"], HOST_US),
        |stage| {
            stage.rig.send_at(0, Frame::new(0, &[2, NODE as u8]));
            Ok(())
        },
    ));
    cases.push(Case::new("two masters: the other resets the node", Eroding, Named(&["boot-up"], HOST_US), |stage| {
        stage.rig.send_at(0, Frame::new(0, &[0x81, NODE as u8]));
        Ok(())
    }));
    // Whose turn it is at the end decides.
    const EITHER: &[State] = &[State::Ready, State::Positioning];
    cases.push(Case::new("two masters: set points of both in turn", Positioning, Obeyed(EITHER, 0.0), fine).meanwhile(
        |stage| {
            for target in [4000i32, 200] {
                stage.rig.send_at(0, Frame::new(0x300 + NODE, &target.to_le_bytes()));
                stage.rig.send_at(0, Frame::new(0x200 + NODE, &[0x2F, 0]));
                stage.rig.send_at(0, Frame::new(0x200 + NODE, &[0x3F, 0]));
            }
            Ok(())
        },
    ));
}

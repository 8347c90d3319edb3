//! What the head keeps over a power cut, in the backup SRAM of the chip.

use crate::common;
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::latency::RATED_SCENE;
use edm_fil::session::{MS, Session};

/// A hole that is being eroded, from a surface at the present position.
fn eroding() -> Session {
    let mut session = Session::ready(&Image::parse(common::firmware().to_vec()).unwrap(), RATED_SCENE).unwrap();
    let surface = host::read(&mut session, 0x6063, 0).unwrap();
    host::write(&mut session, 0x2011, 11, surface, 4).unwrap();
    session.erode().unwrap();
    session
}

fn read(session: &mut Session, sub: u8) -> i32 {
    host::read(session, 0x201A, sub).unwrap().cast_signed()
}

/// The power comes back; what is kept: state, depth, head state, thousands of pulses.
fn back(session: &mut Session) -> [i32; 4] {
    session.idle(5 * MS).unwrap();
    host::begin(session).unwrap();
    [1, 4, 9, 12].map(|sub| read(session, sub))
}

#[test]
fn a_hole_is_known_after_a_cut_at_any_moment_and_also_within_the_record() {
    let mut session = eroding();
    let before = [1, 4, 9, 12].map(|sub| read(&mut session, sub));
    assert_eq!([before[0], before[2]], [2, 4], "kept while it erodes");
    assert!(before[1] > 0 && before[3] > 0, "{before:?}");
    let now = session.machine.soc().now() + 7 * MS / 3;
    session.machine.run_until(now).unwrap();
    session.machine.soc().cut_power(true);
    let after = back(&mut session);
    // What is kept is up to 10 ms old.
    assert!((before[1] - 2..=before[1] + 2).contains(&after[1]), "{before:?}, {after:?}");
    assert!(after[0] == 1 && after[2] == 4 && (before[3] - 1..=before[3] + 1).contains(&after[3]), "{after:?}");
    // The time under power goes on; a copy is written each second of it at least, and the power fails within.
    for written in [0, 1, 17, 32, 33] {
        session.machine.soc().cut_at_backup_write(written);
        session.machine.soc().world.calm();
        session.idle(30 * MS).unwrap();
        assert_eq!(back(&mut session), after, "{written} words");
    }
}

#[test]
fn without_its_cell_nothing_is_known_and_a_reset_does_not_need_one() {
    let mut session = eroding();
    // The record is up to 10 ms old: without that time it is still the one of the seek.
    session.idle(20 * MS).unwrap();
    let before = read(&mut session, 4);
    session.machine.soc().ask_reset(edm_soc::Reset::Software);
    let after = back(&mut session);
    assert!(after[0] == 1 && (before - 2..=before + 2).contains(&after[1]), "{before}, {after:?}");
    session.machine.soc().cut_power(false);
    assert_eq!(back(&mut session), [0, 0, 0, 0]);
}

//! What the firmware finds of itself at its start.

use crate::common::{self, place};
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::latency::RATED_SCENE;
use edm_fil::session::{MS, Session};
use edm_fil::synthetic::Rig;
use edm_hal_shim::seal::{PROGRAM, VECTORS};
use edm_hal_shim::self_test::SelfTest;
use edm_servo_head::head::{Fault, State};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// A head that has been switched on with this in its flash.
fn booted(file: &[u8]) -> anyhow::Result<Session> {
    Session::booted(&Image::parse(file.to_vec())?, Rig::new(RATED_SCENE), None)
}

/// Pulses may go on, the bridge drives, or the circuit behind the live signal would let them.
fn works(session: &mut Session) -> bool {
    let world = &session.machine.soc().world;
    world.permits() || world.gate() || world.drives() || world.latch.enables()
}

/// The head is on the bus, says what it has found, and stays as it is whatever a host wants.
#[track_caller]
fn expect(mut session: Session, found: SelfTest) {
    assert_eq!(host::read(&mut session, 0x2009, 3).unwrap(), u32::from(found.bits()), "{:?}", session.log);
    assert_eq!((session.state().unwrap(), session.fault().unwrap()), (State::Fault as u32, Some(Fault::Unfit)));
    for word in [0x80, 0x06, 0x07, 0x0F, 0x80, 0x00, 0x80] {
        host::write(&mut session, 0x6040, 0, word, 2).unwrap();
        session.idle(5 * MS).unwrap();
        assert!(!works(&mut session));
    }
    assert_eq!((session.state().unwrap(), session.fault().unwrap()), (State::Fault as u32, Some(Fault::Unfit)));
}

/// Where the seal stands in the file.
fn seal(file: &[u8]) -> usize {
    let table = Image::parse(file.to_vec()).unwrap();
    place(file, table.symbol("__eexceptions").unwrap() + 4 * 82)
}

#[test]
fn an_image_that_was_never_sealed_is_named() {
    let mut file = common::firmware().to_vec();
    let seal = seal(&file);
    file[seal..seal + 8].fill(0xFF);
    expect(booted(&file).unwrap(), SelfTest::UNSEALED);
}

#[test]
fn a_flipped_bit_is_named() {
    let file = common::firmware();
    let image = Image::parse(file.to_vec()).unwrap();
    // The vector of the window watchdog, which is not in use, the last constant, and the seal itself: the program can still tell.
    let constant = image.symbol("__erodata").unwrap() - 1;
    let places = [VECTORS + 4 * 16, constant].map(|address| place(file, address));
    for at in places.into_iter().chain([seal(file), seal(file) + 3, seal(file) + 4]) {
        let mut damaged = file.to_vec();
        damaged[at] ^= 1 << 4;
        expect(booted(&damaged).unwrap(), SelfTest::DAMAGED);
    }
}

/// What a program does of which any bit is wrong, nobody can know: that it drives nothing has to come before.
#[test]
fn wherever_the_bit_is_nothing_drives() {
    let file = common::firmware();
    let image = Image::parse(file.to_vec()).unwrap();
    // Initial values of variables are the last.
    let end = image.symbol("__sidata").unwrap() + image.symbol("__edata").unwrap() - image.symbol("__sdata").unwrap();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(4);
    let mut named = 0;
    for _ in 0..20 {
        let at = place(file, random.random_range(PROGRAM..end));
        let mut damaged = file.to_vec();
        damaged[at] ^= 1 << random.random_range(0..8);
        // Or it does not even come up.
        let Ok(mut session) = booted(&damaged) else { continue };
        assert!(!works(&mut session));
        named += u32::from(session.fault().is_ok_and(|fault| fault == Some(Fault::Unfit)));
    }
    assert!(named >= 15, "{named} of 20");
}

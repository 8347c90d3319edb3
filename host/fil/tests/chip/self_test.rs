//! What the firmware finds of itself at its start.

use crate::common::{self, place};
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::latency::RATED_SCENE;
use edm_fil::machine::Alter;
use edm_fil::session::{MS, Session};
use edm_fil::synthetic::Rig;
use edm_fil::wires::{ALLOW, ARM, FORWARD, LIVE, PWM, REVERSE};
use edm_hal_shim::seal::{BOOT, BOOT_LENGTH, PROGRAM};
use edm_hal_shim::self_test::SelfTest;
use edm_servo_head::head::{Fault, State};
use edm_soc::{Drive, Pin};
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
pub fn expect(mut session: Session, found: SelfTest) {
    assert_eq!(host::read(&mut session, 0x2009, 3).unwrap(), u32::from(found.bits()), "{:?}", session.log);
    assert_eq!(
        (session.state().unwrap(), session.fault().unwrap()),
        (State::Fault as u32, Some(Fault::SelfTestFailed))
    );
    for word in [0x80, 0x06, 0x07, 0x0F, 0x80, 0x00, 0x80] {
        host::write(&mut session, 0x6040, 0, word, 2).unwrap();
        session.idle(5 * MS).unwrap();
        assert!(!works(&mut session));
    }
    assert_eq!(
        (session.state().unwrap(), session.fault().unwrap()),
        (State::Fault as u32, Some(Fault::SelfTestFailed))
    );
}

const LCKR: u32 = 0x1c;
const PORTS: std::ops::Range<u32> = 0x4002_0000..0x4002_1400;
/// What could drive, or let pulses through.
const DRIVING: [Pin; 6] = [ALLOW, FORWARD, REVERSE, PWM, LIVE, ARM];

#[test]
fn what_could_drive_stays_an_input_whatever_a_damaged_program_does() {
    let unsealed = |file: &mut Vec<u8>| {
        let seal = seal(file);
        file[seal..seal + 8].fill(0xFF);
    };
    for (whole, released) in [(true, false), (false, true)] {
        let mut file = common::firmware().to_vec();
        if !whole {
            unsealed(&mut file);
        }
        let mut session = booted(&file).unwrap();
        for port in PORTS.step_by(0x400) {
            // Every pin an output, and high.
            session.machine.soc().write(port, 4, 0x5555_5555).unwrap();
            session.machine.soc().write(port + 0x18, 4, 0xFFFF).unwrap();
        }
        let driven = DRIVING.map(|pin| session.machine.soc().drive(pin) == Drive::Released);
        assert_eq!(driven, [released; 6], "{whole}");
    }
}

#[test]
fn pins_that_cannot_be_locked_are_named() {
    let keyless: Alter = Box::new(|address, _, value| match PORTS.contains(&address) && address % 0x400 == LCKR {
        true => value & 0xFFFF,
        false => value,
    });
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    expect(Session::booted(&image, Rig::new(RATED_SCENE), Some(keyless)).unwrap(), SelfTest::UNLOCKED);
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
    // The vector of the window watchdog, which is not in use, the last constant, and the seal itself: the program can still
    // tell.
    let constant = image.symbol("__erodata").unwrap() - 1;
    // And the last bytes in the room of the boot loader, which it does not need, with its sum.
    let rest = BOOT + BOOT_LENGTH - 8;
    let places = [PROGRAM + 4 * 16, constant, rest, rest + 4].map(|address| place(file, address));
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
        named += u32::from(session.fault().is_ok_and(|fault| fault == Some(Fault::SelfTestFailed)));
    }
    assert!(named >= 15, "{named} of 20");
}

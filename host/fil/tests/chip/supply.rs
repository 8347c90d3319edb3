//! The chip's own supply.

use crate::common;
use crate::self_test::expect;
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::latency::RATED_SCENE;
use edm_fil::session::{MS, Session};
use edm_fil::synthetic::Rig;
use edm_hal_shim::self_test::SelfTest;
use edm_servo_head::head::{Command, Fault, State};
use edm_soc::TICK_HZ;

const US: u64 = TICK_HZ / 1_000_000;

fn image() -> Image {
    Image::parse(common::firmware().to_vec()).unwrap()
}

fn on(level: u32) -> Session {
    Session::prepared(&image(), Rig::new(RATED_SCENE), None, |soc| soc.set_brown_out(level)).unwrap()
}

#[test]
fn a_brown_out_level_that_bring_up_has_not_set_is_named() {
    for level in [0, 1, 2] {
        expect(on(level), SelfTest::BROWN_OUT);
    }
    let mut session = on(3);
    assert_eq!((session.fault().unwrap(), host::read(&mut session, 0x2009, 3).unwrap()), (None, 0));
}

fn eroding() -> Session {
    let mut session = Session::ready(&image(), RATED_SCENE).unwrap();
    session.erode().unwrap();
    // A duty passes through nothing: the next ticks have one.
    session.idle(MS).unwrap();
    assert!(session.machine.soc().world.drives());
    session
}

fn works(session: &mut Session) -> bool {
    let world = &session.machine.soc().world;
    world.permits() || world.drives()
}

#[test]
fn a_supply_that_falls_switches_off_within_five_microseconds_and_is_named() {
    // At any moment of a tick.
    for step in 0..6 {
        let mut session = eroding();
        let now = session.machine.soc().now() + step * 1403;
        session.machine.run_until(now).unwrap();
        session.machine.soc().set_supply(2900);
        let now = session.machine.soc().now();
        session.machine.run_until(now + 5 * US).unwrap();
        assert!(!works(&mut session), "{step}");
        session.idle(10 * MS).unwrap();
        assert!(!works(&mut session));
        assert_eq!((session.state().unwrap(), session.fault().unwrap()), (State::Fault as u32, Some(Fault::SupplyLow)));
        assert_eq!(host::read(&mut session, 0x60FD, 0).unwrap() >> 19 & 1, 1);
    }
}

#[test]
fn it_works_again_when_the_supply_is_back_and_somebody_has_reset_the_fault() {
    let mut session = eroding();
    session.machine.soc().set_supply(2900);
    session.machine.soc().world.calm();
    session.idle(20 * MS).unwrap();
    assert!(session.command(Command::ResetFault).is_err() || session.state().unwrap() == State::Fault as u32);
    // Above the falling threshold and below the rising one it is not back.
    session.machine.soc().set_supply(3000);
    session.idle(5 * MS).unwrap();
    assert_eq!(host::read(&mut session, 0x60FD, 0).unwrap() >> 19 & 1, 1);
    session.machine.soc().set_supply(3300);
    session.idle(5 * MS).unwrap();
    assert_eq!(session.fault().unwrap(), Some(Fault::SupplyLow));
    session.command(Command::ResetFault).unwrap();
    session.idle(20 * MS).unwrap();
    assert_eq!((session.fault().unwrap(), host::read(&mut session, 0x60FD, 0).unwrap() >> 19 & 1), (None, 0));
    session.enable().unwrap();
}

#[test]
fn a_supply_within_its_tolerance_is_not_low() {
    let mut session = eroding();
    session.machine.soc().set_supply(3000);
    session.idle(20 * MS).unwrap();
    assert!(works(&mut session));
    assert_eq!(session.fault().unwrap(), None);
}

#[test]
fn one_that_is_low_at_the_start_is_named_as_soon_as_somebody_enables_the_head() {
    let low = Session::prepared(&image(), Rig::new(RATED_SCENE), None, |soc| soc.set_supply(2900));
    let mut session = low.unwrap();
    host::begin(&mut session).unwrap();
    assert_eq!(host::read(&mut session, 0x60FD, 0).unwrap() >> 19 & 1, 1);
    assert!(session.enable().is_err());
    assert!(!works(&mut session));
}

//! The live signal on the chip: a processor that does not go on, and a circuit that is not as it should be.

use crate::common;
use edm_fil::image::Image;
use edm_fil::latency::RATED_SCENE;
use edm_fil::live::MONOSTABLE;
use edm_fil::session::{MS, Session};
use edm_fil::synthetic::Rig;
use edm_fil::wires::ARMED;
use edm_hal_shim::double::live::Broken;
use edm_servo_head::head::{Command, Fault, State};
use edm_soc::{Change, Soc};

/// Clear-enable registers of the interrupt controller, and the interrupts of the servo task and of the gap task.
const ICER: u32 = 0xe000_e180;
const TIM1_UP: u32 = 25;
const GPIOB_IDR: u32 = 0x4002_0410;
/// What a debugger writes: DBGMCU_APB1_FZ, DEMCR.
const FREEZE: u32 = 0xe004_2008;
const DEMCR: u32 = 0xe000_edfc;
const DMA2_STREAM0: u32 = 56;

fn image() -> Image {
    Image::parse(common::firmware().to_vec()).unwrap()
}

/// A head that erodes, with edges and shorts at their rated speed, and a monostable that runs for `time`.
fn eroding(time: u64) -> Session {
    let mut session = Session::ready(&image(), RATED_SCENE).unwrap();
    session.machine.soc().world.latch.time = time;
    session.erode().unwrap();
    session.machine.soc().world.disturb();
    session.idle(50 * MS).unwrap();
    assert_eq!(session.state().unwrap(), State::Eroding as u32);
    session
}

/// Pulses may go on, or the bridge drives.
fn works(soc: &Soc<Rig>) -> bool {
    soc.world.permits() || soc.world.gate() || soc.world.drives()
}

/// The chip as it is, beside a processor that has been halted there.
fn halted(session: &mut Session) -> Soc<Rig> {
    session.machine.soc().clone()
}

#[test]
fn a_core_halted_at_any_instruction_has_pulses_and_bridge_off_within_a_millisecond() {
    // Some pulses and their shorts, by a step that is no part of a tick.
    for (time, points, step) in [(MONOSTABLE, 300, 1733), (MS * 3 / 10, 100, 3331), (MS * 8 / 10, 100, 3331)] {
        let mut session = eroding(time);
        let mut worked = 0;
        let mut at = session.machine.soc().now();
        for _ in 0..points {
            at += step;
            session.machine.run_until(at).unwrap();
            let mut soc = halted(&mut session);
            let now = soc.now();
            worked += usize::from(soc.world.permits() && soc.world.drives());
            soc.advance(now + MS);
            assert!(!works(&soc), "halted at {now}");
            let pulses = soc.world.pulses();
            for ms in 2..8 {
                soc.advance(now + ms * MS);
                assert!(!works(&soc) && soc.world.pulses() == pulses, "halted at {now}");
            }
        }
        // A short has switched the pulses off in some of them.
        assert!(worked > points / 3, "{worked} of {points} had something to switch off");
    }
}

#[test]
fn without_the_latch_pulses_and_bridge_would_go_on() {
    let mut session = eroding(MONOSTABLE);
    // Where no short has just switched them off.
    while !(session.machine.soc().world.permits() && session.machine.soc().world.drives()) {
        let next = session.machine.soc().now() + 173;
        session.machine.run_until(next).unwrap();
    }
    let mut soc = halted(&mut session);
    soc.world.latch.circuit.broken.latch = Some(true);
    let (now, pulses) = (soc.now(), soc.world.pulses());
    soc.advance(now + 5 * MS);
    assert!(works(&soc) && soc.world.pulses() > pulses);
}

#[test]
fn after_a_halt_the_head_says_so_and_works_again_only_when_it_is_enabled_anew() {
    let mut session = eroding(MONOSTABLE);
    let now = session.machine.soc().now();
    session.machine.halt_until(now + 2 * MS);
    assert!(!works(session.machine.soc()));
    for _ in 0..40 {
        session.idle(MS).unwrap();
        assert!(!works(session.machine.soc()));
    }
    assert_eq!((session.state().unwrap(), session.fault().unwrap()), (State::Fault as u32, Some(Fault::LiveLost)));
    // Its reaction has ended when it is at rest.
    session.machine.soc().world.calm();
    session.idle(20 * MS).unwrap();
    session.command(Command::ResetFault).unwrap();
    session.idle(5 * MS).unwrap();
    assert!(!works(session.machine.soc()));
    // Edges that came meanwhile were counted by the timer alone: the encoder may be found lost as soon as the loop is closed,
    // which lifts, perhaps before the host has seen that it was enabled.
    let enabled = session.command(Command::Enable);
    assert!(session.machine.soc().world.latch.enables());
    let fault = session.fault().unwrap();
    assert!(fault == Some(Fault::EncoderLost) || enabled.is_ok() && fault.is_none(), "{fault:?}, {:?}", enabled.err());
    assert_eq!(session.machine.stats().resets, 0);
}

#[test]
fn a_servo_task_that_does_not_come_any_more_switches_off_though_all_others_run() {
    let mut session = eroding(MONOSTABLE);
    let now = session.machine.soc().now();
    session.machine.soc().write(ICER, 4, 1 << TIM1_UP).unwrap();
    session.machine.run_until(now + MONOSTABLE + MS / 10).unwrap();
    assert!(!works(session.machine.soc()));
}

#[test]
fn a_task_that_falls_silent_switches_off() {
    let mut session = eroding(MONOSTABLE);
    let now = session.machine.soc().now();
    session.machine.soc().write(ICER + 4, 4, 1 << (DMA2_STREAM0 - 32)).unwrap();
    session.machine.run_until(now + 3 * MS).unwrap();
    assert!(!works(session.machine.soc()));
}

#[test]
fn what_is_stuck_while_the_head_erodes_is_off_within_a_millisecond_and_named() {
    for broken in [
        Broken { live: true, ..Broken::default() },
        Broken { monostable: Some(false), ..Broken::default() },
        Broken { latch: Some(false), ..Broken::default() },
        // The pulses go on for the millisecond until it is read.
        Broken { read: Some(false), ..Broken::default() },
    ] {
        let mut session = eroding(MONOSTABLE);
        session.machine.soc().world.latch.circuit.broken = broken;
        session.idle(2 * MS).unwrap();
        assert!(!works(session.machine.soc()), "{broken:?}");
        session.idle(10 * MS).unwrap();
        assert_eq!(session.fault().unwrap(), Some(Fault::LiveLost), "{broken:?}");
        assert!(!works(session.machine.soc()), "{broken:?}");
    }
}

#[test]
fn the_latch_is_read_without_the_pull_that_its_pin_has_after_a_reset() {
    let mut session = Session::booted(&image(), Rig::new(RATED_SCENE), None).unwrap();
    session.machine.soc().world.change(0, Change::Level(ARMED, None));
    session.machine.soc().world_changed();
    session.idle(MS).unwrap();
    assert_eq!(session.machine.soc().read(GPIOB_IDR, 4).unwrap() >> ARMED.number & 1, 0);
}

#[test]
fn a_circuit_that_is_not_as_it_should_be_is_named_at_power_up_and_nobody_enables_the_head() {
    let stuck = |fault, broken| (fault, broken);
    for (fault, broken) in [
        stuck(Fault::LiveLost, Broken { live: true, ..Broken::default() }),
        stuck(Fault::LiveLost, Broken { arm: true, ..Broken::default() }),
        stuck(Fault::LiveLost, Broken { monostable: Some(false), ..Broken::default() }),
        stuck(Fault::LiveLost, Broken { read: Some(false), ..Broken::default() }),
        stuck(Fault::LiveStuck, Broken { monostable: Some(true), ..Broken::default() }),
        stuck(Fault::LiveStuck, Broken { latch: Some(true), ..Broken::default() }),
        stuck(Fault::LiveStuck, Broken { read: Some(true), ..Broken::default() }),
    ] {
        let mut rig = Rig::new(RATED_SCENE);
        rig.latch.circuit.broken = broken;
        let mut session = Session::booted(&image(), rig, None).unwrap();
        session.idle(5 * MS).unwrap();
        assert_eq!(session.state().unwrap(), State::Fault as u32, "{broken:?}");
        assert_eq!(session.fault().unwrap(), Some(fault), "{broken:?}");
        assert!(session.enable().is_err(), "{broken:?}");
        assert!(!works(session.machine.soc()), "{broken:?}");
    }
}

#[test]
fn a_debugger_can_stop_neither_the_watchdog_nor_the_handler_of_a_fault() {
    let mut session = eroding(MONOSTABLE);
    session.machine.soc().write(FREEZE, 4, 1 << 12).unwrap();
    let catches = session.machine.soc().read(DEMCR, 4).unwrap() | 1 << 10 | 1;
    session.machine.soc().write(DEMCR, 4, catches).unwrap();
    session.idle(MS).unwrap();
    assert_eq!(session.machine.soc().read(FREEZE, 4), Ok(0));
    // A reset may be caught.
    assert_eq!(session.machine.soc().read(DEMCR, 4), Ok(1 << 24 | 1));
    let now = session.machine.soc().now();
    session.machine.halt_until(now + 60 * MS);
    session.machine.run_until(now + 61 * MS).unwrap();
    assert_eq!(session.machine.stats().resets, 1);
}

#[test]
fn a_halted_watchdog_would_have_waited() {
    let mut session = eroding(MONOSTABLE);
    let now = session.machine.soc().now();
    session.machine.soc().write(FREEZE, 4, 1 << 12).unwrap();
    session.machine.halt_until(now + 60 * MS);
    session.machine.run_until(now + 61 * MS).unwrap();
    assert_eq!(session.machine.stats().resets, 0);
}

#[test]
fn a_cycle_counter_that_a_debugger_has_stopped_is_named_and_goes_on() {
    let mut session = eroding(MONOSTABLE);
    session.machine.soc().write(DEMCR, 4, 0).unwrap();
    session.idle(3 * MS).unwrap();
    assert!(!works(session.machine.soc()));
    assert_eq!(session.fault().unwrap(), Some(Fault::ClockLost));
    assert_eq!(session.machine.soc().read(DEMCR, 4), Ok(1 << 24));
    session.machine.soc().world.calm();
    // The reaction shows until the head stands.
    session.idle(60 * MS).unwrap();
    session.command(Command::ResetFault).unwrap();
    session.enable().unwrap();
    assert_eq!(session.machine.stats().resets, 0);
}

//! The guard of the stack.

use crate::common::{self, place};
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::latency::RATED_SCENE;
use edm_fil::machine::Alter;
use edm_fil::session::{MS, Session};
use edm_fil::synthetic::Rig;
use edm_hal_shim::board::{FAST, RAM_END, STACK, STACK_GUARD};
use edm_hal_shim::seal::PROGRAM;

/// Where what may be touched begins.
const END: u32 = RAM_END - STACK;
const MPU_CTRL: u32 = 0xe000_ed94;
/// 2009h:4.
const STACK_REACHED_ITS_GUARD: u32 = 5;

fn image() -> Image {
    Image::parse(common::firmware().to_vec()).unwrap()
}

/// Between two tasks.
fn move_stack(session: &mut Session, to: u32) {
    while !session.machine.soc().nvic().nesting().is_empty() {
        let next = session.machine.soc().now() + 8;
        session.machine.run_until(next).unwrap();
    }
    session.machine.set_stack(to).unwrap();
}

/// The chip has been reset once and says why; before that pulses and bridge went off.
#[track_caller]
fn expect_named(session: &mut Session) {
    session.idle(60 * MS).unwrap();
    assert_eq!(session.machine.stats().resets, 1);
    let reported = session.log.iter().find(|line| line.contains("death: Stack"));
    assert!(reported.is_some(), "{:?}", session.log);
    assert_eq!(host::read(session, 0x2009, 4).unwrap(), STACK_REACHED_ITS_GUARD);
}

#[test]
fn an_interrupt_whose_frame_would_lie_in_the_guard_switches_off_and_is_named() {
    let mut session = Session::ready(&image(), RATED_SCENE).unwrap();
    session.erode().unwrap();
    // A duty passes through nothing: the next ticks have one.
    session.idle(MS).unwrap();
    assert!(session.machine.soc().world.drives());
    move_stack(&mut session, END + 16);
    let before = session.machine.soc().memory.sram.clone();
    let now = session.machine.soc().now();
    // The next one comes within a tick.
    session.machine.run_until(now + MS / 10).unwrap();
    let world = &session.machine.soc().world;
    assert!(!world.drives() && !world.permits());
    // What lies below the guard is as it was.
    let below = |memory: &edm_soc::Region| memory.load(END - STACK_GUARD - 4, 4);
    assert_eq!(below(&before), below(&session.machine.soc().memory.sram));
    expect_named(&mut session);
}

#[test]
fn without_the_guard_nobody_would_name_the_stack() {
    let alter: Alter = Box::new(|address, _, value| if address == MPU_CTRL { 0 } else { value });
    let mut session = Session::altered(&image(), RATED_SCENE, Some(alter)).unwrap();
    session.erode().unwrap();
    move_stack(&mut session, END + 16);
    let guard = |memory: &edm_soc::Region| -> Vec<_> {
        (END - STACK_GUARD..END).step_by(4).map(|at| memory.load(at, 4)).collect()
    };
    let before = guard(&session.machine.soc().memory.sram);
    let now = session.machine.soc().now();
    session.machine.run_until(now + MS / 10).unwrap();
    assert_ne!(before, guard(&session.machine.soc().memory.sram));
    // What lay there may be anything, and so may what comes of it: but for its name.
    let _ = session.idle(60 * MS);
    assert!(session.log.iter().all(|line| !line.contains("death: Stack")), "{:?}", session.log);
}

#[test]
fn a_function_that_reaches_into_the_guard_switches_off_and_is_named() {
    // A stack that begins so low that start-up does not fit.
    for room in [256, 1024, 2048] {
        let mut file = common::firmware().to_vec();
        let first = place(&file, PROGRAM);
        file[first..first + 4].copy_from_slice(&(END + room).to_le_bytes());
        let image = Image::parse(edm_seal::seal(file).unwrap()).unwrap();
        let mut session = Session::booted(&image, Rig::new(RATED_SCENE), None).unwrap();
        let world = &session.machine.soc().world;
        assert!(!world.drives() && !world.permits() && !world.latch.enables());
        // It starts again and again.
        assert!(session.machine.stats().resets > 0);
        assert!(session.log.iter().all(|line| !line.contains("death: HardFault")), "{:?}", session.log);
    }
}

#[test]
fn nobody_writes_code_that_runs_from_ram() {
    // Where it is fetched, and as data, which is the guard of the stack.
    for (to, death) in [(FAST + 0x100, "death: HardFault"), (0x2000_0000 + FAST + 0x100, "death: Stack")] {
        let mut session = Session::ready(&image(), RATED_SCENE).unwrap();
        session.erode().unwrap();
        let copy = image().symbol("memcpy").unwrap();
        session.machine.call(copy, &[to, PROGRAM, 4]).unwrap();
        session.idle(60 * MS).unwrap();
        assert_eq!(session.machine.stats().resets, 1);
        assert!(session.log.iter().any(|line| line.contains(death)), "{:?}", session.log);
    }
}

#[test]
fn the_last_word_of_the_stack_may_be_used() {
    let mut session = Session::booted(&image(), Rig::new(RATED_SCENE), None).unwrap();
    // A frame without the registers of the FPU, and one with them, of as many nested interrupts as may come.
    move_stack(&mut session, END + 12 * 1024);
    session.idle(5 * MS).unwrap();
    assert_eq!(session.machine.stats().resets, 0);
}

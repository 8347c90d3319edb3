//! An update of the program on the chip, over CAN and through the boot loader, and the power cut in it.

use crate::common;
use edm_boot::file::{sum, words};
use edm_boot::{DONE, Header, IS_READY, PRODUCT, PROGRAM, READY, STAGE, STAGE_SECTOR_LENGTH, STAGE_SECTORS};
use edm_fil::host::{self, Bus as _};
use edm_fil::image::Image;
use edm_fil::latency::RATED_SCENE;
use edm_fil::machine::Machine;
use edm_fil::session::{MS, Session};
use edm_fil::synthetic::Rig;
use edm_fil::wires::CRYSTAL_HZ;
use edm_servo_head::head::State;
use edm_soc::{Change, Frame, Region, Soc};

/// A program that is one endless loop.
fn program() -> Vec<u8> {
    let start = [0x2002_0000, PROGRAM + 0x11, 0, 0, 0xE7FE_E7FE];
    let rest = (5..130u32).map(|n| n.wrapping_mul(0x9E37_79B9));
    start.into_iter().chain(rest).flat_map(u32::to_le_bytes).collect()
}

fn update() -> Vec<u8> {
    let program = program();
    let sum = sum(words(&program));
    let header =
        Header { product: PRODUCT, board: 405, length: program.len() as u32, sum, id: 7, version: 0, build: 0 };
    edm_seal::update::with(&header, &program)
}

fn image() -> Image {
    Image::parse(common::firmware().to_vec()).unwrap()
}

/// Whether the flash has the new program, and whether it was started by the boot loader.
fn new(soc: &mut Soc<Rig>) -> (bool, bool) {
    let (flash, program) = (&soc.memory.flash, program());
    let there = (PROGRAM..).step_by(4).zip(words(&program)).all(|(address, word)| flash.load(address, 4) == Some(word));
    (there, soc.core().vtor == PROGRAM)
}

fn stage(flash: &Region) {
    flash.fill(STAGE, &update()).unwrap();
    flash.store(READY, 4, IS_READY).unwrap();
}

#[test]
fn a_boot_loader_with_nothing_to_do_takes_no_time() {
    let mut machine = Machine::new(&image(), Rig::new(RATED_SCENE), CRYSTAL_HZ).unwrap();
    while machine.soc().core().vtor != PROGRAM {
        let now = machine.soc().now();
        machine.run_until(now + MS / 1000).unwrap();
    }
    let instructions = machine.stats().instructions;
    assert!(instructions < 200, "{instructions} instructions");
}

#[test]
fn what_is_staged_is_copied_and_started_wherever_the_power_is_cut() {
    let run = |cut: Option<u64>| {
        let mut machine = Machine::new(&image(), Rig::new(RATED_SCENE), CRYSTAL_HZ).unwrap();
        stage(&machine.soc().memory.flash);
        machine.soc().cut_in(cut);
        for ms in (50..1000).step_by(50) {
            machine.run_until(ms * MS).unwrap();
            let world = &machine.soc().world;
            assert!(!world.drives() && !world.permits() && !world.latch.enables(), "{cut:?}");
        }
        assert_eq!(new(machine.soc()), (true, true), "{cut:?}");
        assert_eq!(machine.soc().memory.flash.load(DONE, 4), Some(0));
        assert_eq!(machine.stats().resets, u64::from(cut.is_some()), "{cut:?}");
        machine.soc().flash_operations()
    };
    // One erase, the words, the mark.
    let all = run(None);
    assert_eq!(all, 1 + program().len() as u64 / 4 + 1);
    let step = if std::env::var_os("EDM_EVERY_CUT").is_some() { 1 } else { 19 };
    let cuts: Vec<_> = (0..all).filter(|cut| cut % step == 0 || cut + 2 >= all).collect();
    cuts.iter().for_each(|cut| {
        run(Some(*cut));
    });
    println!("cuts: {} of {all} in the copy on the chip", cuts.len());
}

/// An SDO request and its answer: eight bytes, or nothing when the head is silent or refuses.
fn ask(session: &mut Session, requests: &[[u8; 8]]) -> Option<[u8; 8]> {
    while session.take().is_some() {}
    let now = session.now();
    for (at, request) in (now..).step_by(MS as usize / 4).zip(requests) {
        session.machine.soc().world.change(at, Change::Can(Frame::new(0x601, request)));
    }
    for _ in 0..80 {
        session.pass().unwrap();
        while let Some(frame) = session.take() {
            if frame.id == 0x581 {
                return (frame.data[0] != 0x80).then_some(frame.data);
            }
        }
    }
    None
}

fn control(session: &mut Session, value: u8) -> Option<[u8; 8]> {
    ask(session, &[[0x2F, 0x51, 0x1F, 1, value, 0, 0, 0]])
}

/// The first half of an update, as a host makes it: what was staged is erased. `None` when the head has fallen silent or refused
/// something.
fn erased(session: &mut Session) -> Option<()> {
    control(session, 0)?;
    control(session, 3)?;
    // Four erases of a second each, and a pause before each.
    for _ in 0..60 {
        session.idle(100 * MS).unwrap();
        if host::read(session, 0x1F57, 1).is_ok_and(|status| status == 0) {
            break;
        }
    }
    Some(())
}

/// The second half: the program, and the order to start it.
fn sent(session: &mut Session) -> Option<()> {
    let update = update();
    let [a, b, c, d] = (update.len() as u32).to_le_bytes();
    ask(session, &[[0xC2, 0x50, 0x1F, 1, a, b, c, d]])?;
    let parts: Vec<_> = update.chunks(7).collect();
    for (first, block) in parts.chunks(31).enumerate() {
        let frames: Vec<_> = (1..)
            .zip(block)
            .map(|(n, part)| {
                let last = 31 * first + usize::from(n) == parts.len();
                let mut frame = [n | u8::from(last) << 7, 0, 0, 0, 0, 0, 0, 0];
                frame[1..=part.len()].copy_from_slice(part);
                frame
            })
            .collect();
        let answer = ask(session, &frames)?;
        assert_eq!((answer[0], usize::from(answer[1])), (0xA2, block.len()));
    }
    let unused = (7 * parts.len() - update.len()) as u8;
    ask(session, &[[0xC1 | unused << 2, 0, 0, 0, 0, 0, 0, 0]])?;
    control(session, 1)?;
    Some(())
}

/// A head whose stage holds what is to be erased first.
fn head() -> Session {
    Session::prepared(&image(), Rig::new(RATED_SCENE), None, |soc| {
        for sector in 0..STAGE_SECTORS {
            soc.memory.flash.store(STAGE + sector * STAGE_SECTOR_LENGTH + 64, 4, 0x1234_5678).unwrap();
        }
    })
    .unwrap()
}

#[test]
fn an_update_over_can_is_started_and_a_cut_in_it_leaves_a_program_that_starts() {
    let mut session = head();
    let mut moments = vec![(session.machine.snapshot().unwrap(), session.now())];
    assert_eq!(erased(&mut session), Some(()), "{:?}", session.log);
    let erases = session.machine.soc().flash_operations();
    moments.push((session.machine.snapshot().unwrap(), session.now()));
    assert_eq!(sent(&mut session), Some(()), "{:?}", session.log);
    // No watchdog has bitten, whatever was erased.
    assert_eq!(session.machine.stats().resets, 0);
    let staged = session.machine.soc().flash_operations();
    // Old mark, sectors, words of the header that are not all ones, program, mark.
    assert_eq!(staged, 1 + 4 + 10 + program().len() as u64 / 4 + 1);
    session.idle(1000 * MS).unwrap();
    assert_eq!(new(session.machine.soc()), (true, true));
    assert_eq!(session.machine.stats().resets, 1);

    let every = std::env::var_os("EDM_EVERY_CUT").is_some();
    let some = [1, 3, 60, staged - 2, staged - 1];
    for cut in (0..staged).filter(|cut| if every { cut % 8 == 0 } else { some.contains(cut) }) {
        // What comes before the cut is what it was.
        let (moment, began) = &moments[usize::from(cut > erases)];
        session.machine.restore(moment).unwrap();
        session.go_back(*began);
        session.machine.soc().cut_in(Some(cut));
        if cut > erases || erased(&mut session).is_some() {
            sent(&mut session);
        }
        session.idle(1500 * MS).unwrap();
        let (there, started) = new(session.machine.soc());
        assert!(started, "cut {cut}: nothing starts");
        // Whoever is not the new one is the old one, and well.
        if !there {
            assert_eq!(session.state().unwrap(), State::Disabled as u32, "cut {cut}");
            assert_eq!(session.machine.stats().resets, 1, "cut {cut}");
        }
        assert!(!there || cut + 1 >= staged, "cut {cut}: half an update was started");
    }
}

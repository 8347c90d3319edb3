//! What is locked after the start, and that the short path does not need it.

use crate::{common, mutants};
use edm_fil::machine::Alter;
use edm_fil::session::Session;

const PORTS: [u32; 5] = [0x4002_0000, 0x4002_0400, 0x4002_0800, 0x4002_0c00, 0x4002_1000];
/// MODER, OTYPER, OSPEEDR, PUPDR, LCKR, AFRL, AFRH.
const CONFIGURATION: [u32; 7] = [0x00, 0x04, 0x08, 0x0c, 0x1c, 0x20, 0x24];
const TIM1_CR2: u32 = 0x4001_0004;
const TIM1_CCER: u32 = 0x4001_0020;
const TIM1_BDTR: u32 = 0x4001_0044;
/// What level 2 locks of them: idle levels, the polarity of channel 1, and of the break register all but the main output.
const LOCKED: [(u32, u32); 3] = [(TIM1_CR2, 0x7f00), (TIM1_CCER, 0b10), (TIM1_BDTR, 0x7fff)];

/// Writes that no program means, and the first register that one of them has changed.
fn stray(session: &mut Session) -> Option<u32> {
    let soc = session.machine.soc();
    let ports = PORTS.iter().flat_map(|port| CONFIGURATION.map(|offset| (port + offset, u32::MAX)));
    ports.chain(LOCKED).find_map(|(address, bits)| {
        let before = soc.read(address, 4).unwrap();
        for value in [before ^ bits, before & !bits, before | bits] {
            soc.write(address, 4, value).unwrap();
            if soc.read(address, 4).unwrap() != before {
                soc.write(address, 4, before).unwrap();
                return Some(address);
            }
        }
        None
    })
}

#[test]
fn a_stray_write_changes_nothing_and_the_reflex_serves_every_short() {
    let done =
        mutants::run(common::firmware(), None, |session| assert_eq!(stray(session).map(|at| format!("{at:#x}")), None));
    assert!(done.is_ok(), "{done:?}");
}

#[test]
fn without_the_lock_the_same_writes_would_be_taken() {
    let alter: Alter = Box::new(|address, _, value| if address == TIM1_BDTR { value & !(3 << 8) } else { value });
    let mut found = None;
    let done = mutants::run(common::firmware(), Some(alter), |session| found = stray(session));
    assert!(done.is_ok(), "{done:?}");
    assert_eq!(found, Some(TIM1_CR2));
}

//! The self-test at the start: see [`crate::self_test`].

use super::{change, pac, put};
use crate::seal::{BOOT, BOOT_LENGTH, PROGRAM, Seal};
use crate::self_test::SelfTest;

/// Clock gate of the CRC unit (RM0090 7.3.10).
const CRC: u32 = 1 << 12;

/// Filled in after linking, so that no compiler may know it.
#[unsafe(link_section = ".seal")]
#[used]
static SEAL: Seal = Seal::NONE;

/// Room for the boot loader; it is linked by itself, and filled in with its sum.
#[unsafe(link_section = ".boot")]
#[used]
static LOADER: [u8; BOOT_LENGTH as usize] = [0xFF; BOOT_LENGTH as usize];

/// What was built, by its seal.
pub fn seal() -> Seal {
    // SAFETY: a place of this image, and aligned; volatile, because what it holds is not what it is declared to.
    unsafe { (&raw const SEAL).read_volatile() }
}

/// Whether the flash holds what was built. First of all, from the internal oscillator: some 20 ms (on the modelled chip).
pub fn image(crc: &pac::CRC, rcc: &pac::RCC) -> SelfTest {
    let seal = seal();
    if seal == Seal::NONE {
        return SelfTest::UNSEALED;
    }
    if !seal.fits() {
        return SelfTest::DAMAGED;
    }
    change!(rcc.ahb1enr(), clear 0, set CRC);
    put!(crc.cr(), 1);
    let place = (&raw const SEAL).expose_provenance() as u32;
    add(crc, PROGRAM, place);
    add(crc, place + size_of::<Seal>() as u32, PROGRAM + seal.length);
    let program = crc.dr().read().bits();
    put!(crc.cr(), 1);
    // A word and its own sum make zero.
    add(crc, BOOT, BOOT + BOOT_LENGTH);
    if program == seal.crc && crc.dr().read().bits() == 0 { SelfTest::PASSED } else { SelfTest::DAMAGED }
}

/// Words of the flash from one address up to another.
fn add(crc: &pac::CRC, from: u32, to: u32) {
    for address in (from..to).step_by(4) {
        // SAFETY: aligned, and in the flash of this chip, which nothing changes meanwhile.
        let word = unsafe { core::ptr::with_exposed_provenance::<u32>(address as usize).read_volatile() };
        put!(crc.dr(), word);
    }
}

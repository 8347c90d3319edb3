//! The self-test at the start: see [`crate::self_test`].

use super::{change, pac, put};
use crate::seal::{PROGRAM, Seal, VECTORS};
use crate::self_test::SelfTest;

/// Clock gate of the CRC unit (RM0090 7.3.10).
const CRC: u32 = 1 << 12;

/// Filled in after linking, so that no compiler may know it.
#[unsafe(link_section = ".seal")]
#[used]
static SEAL: Seal = Seal::NONE;

/// Whether the flash holds what was built. First of all, from the internal oscillator: some 20 ms (on the modelled chip).
pub fn image(crc: &pac::CRC, rcc: &pac::RCC) -> SelfTest {
    // SAFETY: a place of this image, and aligned; volatile, because what it holds is not what it is declared to.
    let seal = unsafe { (&raw const SEAL).read_volatile() };
    if seal == Seal::NONE {
        return SelfTest::UNSEALED;
    }
    if !seal.fits() {
        return SelfTest::DAMAGED;
    }
    change!(rcc.ahb1enr(), clear 0, set CRC);
    put!(crc.cr(), 1);
    add(crc, VECTORS, (&raw const SEAL).expose_provenance() as u32);
    add(crc, PROGRAM, PROGRAM + seal.length);
    if crc.dr().read().bits() == seal.crc { SelfTest::PASSED } else { SelfTest::DAMAGED }
}

/// Words of the flash from one address up to another.
fn add(crc: &pac::CRC, from: u32, to: u32) {
    for address in (from..to).step_by(4) {
        // SAFETY: aligned, and in the flash of this chip, which nothing changes meanwhile.
        let word = unsafe { core::ptr::with_exposed_provenance::<u32>(address as usize).read_volatile() };
        put!(crc.dr(), word);
    }
}

//! The guard of the stack: memory that nobody may touch, below what the stack may take (ARMv7-M B3.5).
//!
//! The guard is larger than any frame (`cargo firmware` refuses an image with a larger one), so that no function steps over
//! it. Who touches it ends in HardFault, where the unit is off: the handler has the guard and what lies below for its own
//! stack. The pins come first there, and after the reset the last words name the stack.
//!
//! The same bytes hold the code that runs from RAM ([`super::fast`]), which is fetched through the code region: there it may be
//! read, and nothing of SRAM1 may be written.

use crate::board::{RAM_END, STACK, STACK_GUARD};
use cortex_m::peripheral::MPU;

const BASE: u32 = RAM_END - STACK - STACK_GUARD;
/// The guard is two regions, the larger one above. Of that the last eighths are the stack's.
const LOWER: u32 = 8 * 1024;
const UPPER: u32 = (STACK_GUARD - LOWER).next_power_of_two();
/// Where the upper one begins.
const MIDDLE: u32 = BASE + LOWER;
/// How many eighths those are.
const LEFT_OUT: u32 = (LOWER + UPPER - STACK_GUARD) / (UPPER / 8);
// A region is a power of two, 32 bytes at least, and a multiple of itself; one with eighths has 256 at least.
const _: () = assert!(BASE.is_multiple_of(LOWER) && MIDDLE.is_multiple_of(UPPER) && UPPER >= 256);
const _: () = assert!(LOWER + UPPER / 8 * (8 - LEFT_OUT) == STACK_GUARD);

/// Regions 0 and 2, with the number in the address.
const UPPER_REGION: u32 = MIDDLE | 1 << 4;
const LOWER_REGION: u32 = BASE | 1 << 4 | 2;
/// No access at all, nothing to be executed, of 2^(SIZE + 1) bytes but for so many eighths at their end (SRD, B3.5.9); enabled.
const fn no_access(bytes: u32, left_out: u32) -> u32 {
    1 << 28 | (0xFF00 >> left_out & 0xFF) << 8 | (bytes.ilog2() - 1) << 1 | 1
}
/// Region 1: SRAM1 where code is fetched, read only, cached as memory is by default (B3.5.9), of 128 KiB.
const CODE: u32 = 1 << 4 | 1;
const READ_ONLY: u32 = 6 << 24 | 1 << 17 | 16 << 1 | 1;
/// The default map elsewhere; enabled, but not in HardFault and NMI.
const ENABLE: u32 = 1 << 2 | 1;

/// Data that a region refuses, in the fault status: DACCVIOL, MUNSTKERR, MSTKERR, MLSPERR; and whether its address is known
/// (MMARVALID, B3.2.15).
const FAULTS: u32 = 1 << 1 | 1 << 3 | 1 << 4 | 1 << 5;
const KNOWN: u32 = 1 << 7;

/// Whether a fault of this status and address (MMFAR) is one of the guard.
pub fn refused(status: u32, address: u32) -> bool {
    status & FAULTS != 0 && (status & KNOWN == 0 || address >= BASE)
}

/// Sets the guard up.
pub fn guard(mpu: &mut MPU) {
    // SAFETY: nothing that this program uses as data lies in the guard: variables end below (`cargo firmware` looks), and the stack
    // above. Nothing is written where code is fetched.
    unsafe {
        mpu.rbar.write(UPPER_REGION);
        mpu.rasr.write(no_access(UPPER, LEFT_OUT));
        mpu.rbar.write(LOWER_REGION);
        mpu.rasr.write(no_access(LOWER, 0));
        mpu.rbar.write(CODE);
        mpu.rasr.write(READ_ONLY);
        mpu.ctrl.write(ENABLE);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

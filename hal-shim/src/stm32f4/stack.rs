//! The guard of the stack: memory that nobody may touch, below what the stack may take (ARMv7-M B3.5).
//!
//! The guard is larger than any frame (`cargo firmware` refuses an image with a larger one), so that no function steps over
//! it. Who touches it ends in HardFault, where the unit is off: the handler has the guard and what lies below for its own
//! stack. The pins come first there, and after the reset the last words name the stack.

use crate::board::{RAM_END, STACK, STACK_GUARD};
use cortex_m::peripheral::MPU;

const BASE: u32 = RAM_END - STACK - STACK_GUARD;
// A region is a power of two, 32 bytes at least, and a multiple of itself.
const _: () = assert!(STACK_GUARD.is_power_of_two() && STACK_GUARD >= 32 && BASE.is_multiple_of(STACK_GUARD));

/// Region 0, with the number in the address.
const REGION: u32 = 1 << 4;
/// No access at all, nothing to be executed, of 2^(SIZE + 1) bytes; enabled.
const NO_ACCESS: u32 = 1 << 28 | (STACK_GUARD.ilog2() - 1) << 1 | 1;
/// The default map elsewhere; enabled, but not in HardFault and NMI.
const ENABLE: u32 = 1 << 2 | 1;

/// Data that the guard refuses, in the fault status: DACCVIOL, MUNSTKERR, MSTKERR, MLSPERR (B3.2.15). There is no other region.
pub const FAULTS: u32 = 1 << 1 | 1 << 3 | 1 << 4 | 1 << 5;

/// Sets the guard up.
pub fn guard(mpu: &mut MPU) {
    // SAFETY: nothing that this program uses lies in the region: variables end below (`cargo firmware` looks), and the stack
    // above.
    unsafe {
        mpu.rbar.write(BASE | REGION);
        mpu.rasr.write(NO_ACCESS);
        mpu.ctrl.write(ENABLE);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

//! Critical sections that delay nothing but the tasks that log.
//!
//! The highest task that logs is masked by BASEPRI; those above it run on. They therefore must not log, lock or take a critical
//! section themselves: `cargo firmware` reads in the image that none of them reaches the log. PRIMASK is never set. A log
//! message is one section, however much it says: 88 us was seen (on the modelled chip), two frames on the bus.
//!
//! cortex-m brings one of its own, made of PRIMASK; the package beside this file keeps it out.

use crate::board;
use cortex_m::register::{basepri, basepri_max};

/// Priority bits of the STM32F4.
const BITS: u8 = 4;
/// Hardware priority of the highest task that is masked.
const CEILING: u8 = hardware(board::priority(board::LOGS));

/// Value for the interrupt controller of a priority of the task table, 1 to 15: its lower numbers come first.
pub const fn hardware(priority: u8) -> u8 {
    ((1 << BITS) - priority) << (8 - BITS)
}

struct Basepri;
critical_section::set_impl!(Basepri);

// SAFETY: `acquire` masks every interrupt that may use a critical section (the tasks that log), and `release` restores what
// was masked before, so sections nest. BASEPRI of 0 means nothing is masked and BASEPRI_MAX only ever raises it.
unsafe impl critical_section::Impl for Basepri {
    unsafe fn acquire() -> critical_section::RawRestoreState {
        let before = basepri::read();
        basepri_max::write(CEILING);
        // The new mask holds from the next instruction, and no access moves above it.
        cortex_m::asm::isb();
        before.into()
    }

    unsafe fn release(before: critical_section::RawRestoreState) {
        core::sync::atomic::compiler_fence(core::sync::atomic::Ordering::SeqCst);
        // SAFETY: restores the value that `acquire` found.
        unsafe { basepri::write(before as u8) };
    }
}

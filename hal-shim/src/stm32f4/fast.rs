//! Code that runs from RAM, where nothing is waited for: the flash takes five wait states, and its accelerator keeps 64 lines of 16
//! bytes, of which one run of the gap task alone touches 275 (docs/tick.md).
//!
//! memory.x says what it is. It is copied before anything else runs, and SRAM1 then appears at address 0, in the code region: there
//! instructions come over a bus of their own, as fast as the processor takes them (RM0090 2.3.1 and 9.2.1; at 0x2000_0000 they would
//! wait for data). `super::stack` keeps everybody from writing it.

use crate::board::FAST;

// In assembly, because it runs before there are variables. RCC_APB2ENR, SYSCFGEN (RM0090 7.3.14); SYSCFG_MEMRMP (9.2.1): a write to a
// peripheral whose clock has just been enabled may be lost, but for a read in between (ES0182, "Delay after an RCC peripheral clock enabling").
core::arch::global_asm!(
    ".section .text.copy_fast, \"ax\"",
    ".global __pre_init",
    ".type __pre_init, %function",
    ".thumb_func",
    "__pre_init:",
    "movw r0, :lower16:__sfast",
    "movt r0, :upper16:__sfast",
    "movw r1, :lower16:__efast",
    "movt r1, :upper16:__efast",
    "movw r2, :lower16:__sifast",
    "movt r2, :upper16:__sifast",
    "1: cmp r0, r1",
    "ittt lo",
    "ldrlo r3, [r2], #4",
    "strlo r3, [r0], #4",
    "blo 1b",
    "movw r0, :lower16:__sshared",
    "movt r0, :upper16:__sshared",
    "movw r1, :lower16:__eshared",
    "movt r1, :upper16:__eshared",
    "movw r2, :lower16:__sishared",
    "movt r2, :upper16:__sishared",
    "2: cmp r0, r1",
    "ittt lo",
    "ldrlo r3, [r2], #4",
    "strlo r3, [r0], #4",
    "blo 2b",
    "movw r0, #0x3844",
    "movt r0, #0x4002",
    "ldr r1, [r0]",
    "orr r1, r1, #0x4000",
    "str r1, [r0]",
    "ldr r1, [r0]",
    "movw r0, #0x3800",
    "movt r0, #0x4001",
    "movs r1, #3",
    "str r1, [r0]",
    "dsb",
    "isb",
    "bx lr",
    ".size __pre_init, . - __pre_init",
);

unsafe extern "C" {
    static __sfast: u32;
    static __efast: u32;
    static __sifast: u32;
}

/// Words that one look compares: all of 32 KiB within 0.52 s, at a look a millisecond.
const WORDS: u32 = 16;

/// A comparison of the copy with the flash, some words at a time.
pub(super) struct Copied {
    at: u32,
}

impl Copied {
    /// Nothing has been compared.
    pub const NEW: Copied = Copied { at: 0 };

    /// Whether the next words are what was copied.
    pub fn is_intact(&mut self) -> bool {
        // Addresses of the linker; nothing lies there that the compiler knows.
        let (from, to, original) = (&raw const __sfast, &raw const __efast, &raw const __sifast);
        let (length, original) = (to.addr().wrapping_sub(from.addr()) as u32, original.addr() as u32);
        let mut same = true;
        for _ in 0..WORDS {
            // SAFETY: both are memory of this chip, aligned, and read only; the length is that of the linker.
            let word = |begin: u32| unsafe {
                core::ptr::with_exposed_provenance::<u32>(begin.wrapping_add(self.at) as usize).read_volatile()
            };
            same &= word(FAST) == word(original);
            self.at = if self.at.wrapping_add(4) < length { self.at.wrapping_add(4) } else { 0 };
        }
        same
    }
}

//! Copies of memory, for all that the compiler does not write out itself: plans, estimates, states, frames.
//!
//! The compiler's own library copies a word in some 5.5 cycles; eight words by one load and one store come to 2.75 each
//! (estimated: DDI 0439, table 3-1). Its names are weak there, so these are what is linked.

// SAFETY, of all: AAPCS: destination in r0, source in r1, bytes in r2, and r0 to r3, r12 and the flags are its own.
// Whoever calls has so many bytes at both places, which do not overlap but in a move. They are called by their names alone, whose meaning is
// that of the run-time ABI for the Arm architecture (IHI 0043, section 5.3.2).

/// Copies bytes between places of any alignment.
///
/// # Safety
/// So many bytes at both places, which do not overlap.
#[unsafe(no_mangle)]
#[unsafe(naked)]
pub unsafe extern "C" fn __aeabi_memcpy(to: *mut u8, from: *const u8, bytes: usize) {
    core::arch::naked_asm!(
        "orr r3, r0, r1",
        "lsls r3, r3, #30",
        "beq {words}",
        "b {any}",
        words = sym __aeabi_memcpy4,
        any = sym memcpy,
    )
}

unsafe extern "C" {
    fn memcpy(to: *mut u8, from: *const u8, bytes: usize) -> *mut u8;
    fn memmove(to: *mut u8, from: *const u8, bytes: usize) -> *mut u8;
}

/// Copies bytes between double words.
///
/// # Safety
/// As [`__aeabi_memcpy4`].
#[unsafe(no_mangle)]
#[unsafe(naked)]
pub unsafe extern "C" fn __aeabi_memcpy8(to: *mut u8, from: *const u8, bytes: usize) {
    core::arch::naked_asm!("b {words}", words = sym __aeabi_memcpy4)
}

/// Moves bytes between words: the compiler says so where it does not know that the places are two.
///
/// # Safety
/// So many bytes at both places, which begin at words.
#[unsafe(no_mangle)]
#[unsafe(naked)]
pub unsafe extern "C" fn __aeabi_memmove4(to: *mut u8, from: *const u8, bytes: usize) {
    core::arch::naked_asm!(
        // From the lower end on, unless the upper part of what is read would have been written by then.
        "subs r3, r0, r1",
        "cmp r3, r2",
        "bhs {words}",
        "b {any}",
        words = sym __aeabi_memcpy4,
        any = sym memmove,
    )
}

/// Moves bytes between double words.
///
/// # Safety
/// As [`__aeabi_memmove4`].
#[unsafe(no_mangle)]
#[unsafe(naked)]
pub unsafe extern "C" fn __aeabi_memmove8(to: *mut u8, from: *const u8, bytes: usize) {
    core::arch::naked_asm!("b {words}", words = sym __aeabi_memmove4)
}

/// Copies bytes between words.
///
/// # Safety
/// So many bytes at both places, which begin at words and do not overlap.
#[unsafe(no_mangle)]
#[unsafe(naked)]
pub unsafe extern "C" fn __aeabi_memcpy4(to: *mut u8, from: *const u8, bytes: usize) {
    core::arch::naked_asm!(
        "push {{r4-r10, lr}}",
        "subs r2, #32",
        "blo 3f",
        "2:",
        "ldmia r1!, {{r3-r10}}",
        "subs r2, #32",
        "stmia r0!, {{r3-r10}}",
        "bhs 2b",
        "3:",
        // The low five bits are those of what is left: 16 is the carry now and 8 the sign, then 4 and 2, then 1.
        "lsls r2, r2, #28",
        "bcc 4f",
        "ldmia r1!, {{r3-r6}}",
        "stmia r0!, {{r3-r6}}",
        "4:",
        "bpl 5f",
        "ldmia r1!, {{r3, r4}}",
        "stmia r0!, {{r3, r4}}",
        "5:",
        "lsls r2, r2, #2",
        "bcc 6f",
        "ldr r3, [r1], #4",
        "str r3, [r0], #4",
        "6:",
        "bpl 7f",
        "ldrh r3, [r1], #2",
        "strh r3, [r0], #2",
        "7:",
        "lsls r2, r2, #1",
        "bpl 8f",
        "ldrb r3, [r1]",
        "strb r3, [r0]",
        "8:",
        "pop {{r4-r10, pc}}",
    )
}

//! Core-coupled memory: 64 KiB that no DMA reaches and nothing initialises; room for the path history, for what the scope keeps
//! over a reset, and for what the 20 kHz tasks own (firmware/src/main.rs).

use core::mem::{MaybeUninit, align_of, size_of};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::SeqCst};

/// Words that outlive a reset.
pub const KEPT: usize = 6180;
/// Bytes for what tasks own that run from RAM: their code is fetched from SRAM1, and would share that with their data.
const TASKS: usize = 4 * 1024;
/// What both leave, bytes.
const SIZE: usize = 64 * 1024 - (KEPT * 4).next_multiple_of(8) - TASKS;

#[repr(C, align(8))]
struct Memory([MaybeUninit<u8>; SIZE]);

/// Placed by memory.x; the linker reserves it, start-up leaves it alone.
#[unsafe(link_section = ".ccmram")]
static mut MEMORY: Memory = Memory([MaybeUninit::uninit(); SIZE]);
/// Neither `place` nor start-up touches it: it holds what the run before left, or noise after power-up.
#[unsafe(link_section = ".ccmram.kept")]
static WORDS: MaybeUninit<[AtomicU32; KEPT]> = MaybeUninit::uninit();
static TAKEN: AtomicBool = AtomicBool::new(false);

/// The words that outlive a reset without loss of power.
pub fn kept() -> &'static [AtomicU32; KEPT] {
    // SAFETY: any bits are a valid atomic integer, and only atomics ever write there.
    unsafe { WORDS.assume_init_ref() }
}

/// Makes a value in core-coupled memory. `None` when it was taken already; too large a type does not compile.
///
/// A value that is never touched by DMA, and has no invariants that noise could break before `make` has written it: there
/// are none, `make` writes it whole.
#[inline(always)]
pub fn place<T: Send>(make: impl FnOnce() -> T) -> Option<&'static mut T> {
    const { assert!(size_of::<T>() <= SIZE && align_of::<T>() <= 8, "does not fit core-coupled memory") };
    if TAKEN.swap(true, SeqCst) {
        return None;
    }
    let slot = (&raw mut MEMORY).cast::<MaybeUninit<T>>();
    // SAFETY: the memory is large and aligned enough (checked above), is always there, and was not taken before: this is its
    // only reference.
    Some(unsafe { (*slot).write(make()) })
}

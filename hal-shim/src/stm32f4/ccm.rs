//! Core-coupled memory: 64 KiB that no DMA reaches and nothing initialises; room for the path history.

use core::mem::{MaybeUninit, align_of, size_of};
use core::sync::atomic::{AtomicBool, Ordering::SeqCst};

/// Its size, bytes.
const SIZE: usize = 64 * 1024;

#[repr(C, align(8))]
struct Memory([MaybeUninit<u8>; SIZE]);

/// Placed by memory.x; the linker reserves it, start-up leaves it alone.
#[unsafe(link_section = ".ccmram")]
static mut MEMORY: Memory = Memory([MaybeUninit::uninit(); SIZE]);
static TAKEN: AtomicBool = AtomicBool::new(false);

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

//! Translated code lies near the program.
//!
//! At each block of the firmware the engine's code calls back into the program, twice. It asks for its memory at any address,
//! and the kernel's choice is too far away for a call with a distance of 32 bits: each is through a pointer then, and the
//! processor of the PC predicts few of them. Near the program the same bore takes two thirds of the time (measured in one
//! run). Elsewhere than on Linux with glibc the kernel still chooses, and nothing else changes.

use super::engine;
use anyhow::Result;
use rustix::mm::{MapFlags, ProtFlags, mmap_anonymous, munmap};
use std::ffi::{c_int, c_void};
use unicorn_engine::{ControlType, Unicorn, uc_ctl};

/// Bytes for translated code: the whole firmware takes some 20 MiB. The engine's own choice, 1 GiB, has room near the program once.
const SIZE: usize = 64 << 20;
/// The farthest that a call reaches, less the size of a program.
const REACH: usize = 1 << 30;

/// Limits the memory for translated code; before the engine takes it.
pub fn limit<D>(uc: &Unicorn<D>) -> Result<()> {
    // UC_CTL_WRITE with one argument.
    let control = ControlType(ControlType::TCG_BUFFER_SIZE.0 | 1 << 26 | 1 << 30);
    // SAFETY: the handle is the engine's, and this control takes one 32-bit number.
    let done = unsafe { uc_ctl(uc.get_handle(), control, SIZE as u32) };
    done.and(Ok(())).map_err(engine("limit the translated code"))
}

/// A place for executable memory near this function.
fn near(length: usize) -> Option<*mut c_void> {
    let here = near as fn(usize) -> Option<*mut c_void> as usize;
    let flags = MapFlags::PRIVATE;
    (1..=REACH / SIZE).find_map(|steps| {
        let wanted = (here.checked_sub(steps * SIZE)? & !(SIZE - 1)) as *mut c_void;
        // SAFETY: memory that nobody has yet, and without MAP_FIXED no other is replaced.
        unsafe {
            let found = mmap_anonymous(wanted, length, ProtFlags::all(), flags).ok()?;
            if found == wanted {
                return Some(found);
            }
            munmap(found, length).ok()?;
        }
        None
    })
}

unsafe extern "C" {
    fn __real_mmap64(
        at: *mut c_void,
        length: usize,
        rights: c_int,
        flags: c_int,
        file: c_int,
        from: i64,
    ) -> *mut c_void;
}

/// What the program's calls of `mmap64` come to (build.rs).
///
/// # Safety
/// As `mmap64`.
#[unsafe(no_mangle)]
unsafe extern "C" fn __wrap_mmap64(
    at: *mut c_void,
    length: usize,
    rights: c_int,
    flags: c_int,
    file: c_int,
    from: i64,
) -> *mut c_void {
    let executable = rights as u32 & ProtFlags::EXEC.bits() != 0 && at.is_null() && file == -1;
    if let Some(place) = executable.then(|| near(length)).flatten() {
        return place;
    }
    // SAFETY: the caller's promise.
    unsafe { __real_mmap64(at, length, rights, flags, file, from) }
}

//! The atomics and the cell that everything here is made of: those of `core`, or those of loom, which tries every order.

#[cfg(loom)]
pub use loom::cell::UnsafeCell;
#[cfg(loom)]
pub use loom::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicUsize};

#[cfg(all(not(loom), not(target_os = "none")))]
pub use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicUsize};
#[cfg(all(not(loom), target_os = "none"))]
pub use one_core::{AtomicBool, AtomicU8, AtomicU32, AtomicUsize};

/// The same for one core and its interrupts. The core keeps the order of its own accesses for its own interrupts, so that only
/// only the compiler needs a fence; the barrier instruction that an order costs between cores, four cycles at each access, would
/// buy nothing.
#[cfg(all(not(loom), target_os = "none"))]
mod one_core {
    use core::sync::atomic::Ordering::{Relaxed, SeqCst};
    use core::sync::atomic::{self, Ordering, compiler_fence};

    macro_rules! one_core {
        ($($atomic:ident: $value:ty),+) => {$(
            pub struct $atomic(atomic::$atomic);

            impl $atomic {
                pub const fn new(value: $value) -> Self {
                    Self(atomic::$atomic::new(value))
                }

                #[inline(always)]
                pub fn load(&self, _: Ordering) -> $value {
                    compiler_fence(SeqCst);
                    let value = self.0.load(Relaxed);
                    compiler_fence(SeqCst);
                    value
                }

                #[inline(always)]
                pub fn store(&self, value: $value, _: Ordering) {
                    compiler_fence(SeqCst);
                    self.0.store(value, Relaxed);
                    compiler_fence(SeqCst);
                }
            }
        )+};
    }

    one_core!(AtomicBool: bool, AtomicU8: u8, AtomicU32: u32, AtomicUsize: usize);

    macro_rules! swap {
        ($($atomic:ident: $value:ty),+) => {$(
            impl $atomic {
                #[inline(always)]
                pub fn swap(&self, value: $value, _: Ordering) -> $value {
                    compiler_fence(SeqCst);
                    let before = self.0.swap(value, Relaxed);
                    compiler_fence(SeqCst);
                    before
                }
            }
        )+};
    }

    swap!(AtomicBool: bool, AtomicU8: u8, AtomicU32: u32);
}

use core::mem::MaybeUninit;

/// A `core::cell::UnsafeCell` with the interface of loom's, which watches who is inside.
#[cfg(not(loom))]
pub struct UnsafeCell<T>(core::cell::UnsafeCell<T>);

#[cfg(not(loom))]
impl<T> UnsafeCell<T> {
    pub const fn new(value: T) -> UnsafeCell<T> {
        UnsafeCell(core::cell::UnsafeCell::new(value))
    }

    #[inline(always)]
    pub fn with<R>(&self, look: impl FnOnce(*const T) -> R) -> R {
        look(self.0.get())
    }

    #[inline(always)]
    pub fn with_mut<R>(&self, change: impl FnOnce(*mut T) -> R) -> R {
        change(self.0.get())
    }
}

/// Cells with nothing in them yet.
#[cfg(not(loom))]
pub const fn vacant<T, const N: usize>() -> [UnsafeCell<MaybeUninit<T>>; N] {
    [const { UnsafeCell::new(MaybeUninit::uninit()) }; N]
}

/// Cells with nothing in them yet.
#[cfg(loom)]
pub fn vacant<T, const N: usize>() -> [UnsafeCell<MaybeUninit<T>>; N] {
    core::array::from_fn(|_| UnsafeCell::new(MaybeUninit::uninit()))
}

/// The value of an atomic that only the caller's side writes.
///
/// loom checks that nobody else does. For it this is no access, because a load right before a store of the same thread keeps
/// loom 0.7 from trying the loads of the other thread behind that store (tokio-rs/loom issues 166 and 392).
macro_rules! own {
    ($atomic:expr) => {{
        #[cfg(not(loom))]
        let value = $atomic.load(core::sync::atomic::Ordering::Relaxed);
        #[cfg(loom)]
        // SAFETY: no other thread writes to it; loom would say so.
        let value = unsafe { $atomic.unsync_load() };
        value
    }};
}

/// A `const fn`; under loom, whose atomics know which run of a model they belong to, an ordinary one.
macro_rules! const_unless_loom {
    ($(#[$meta:meta])* pub const fn $($rest:tt)*) => {
        #[cfg(not(loom))]
        $(#[$meta])*
        pub const fn $($rest)*

        #[cfg(loom)]
        $(#[$meta])*
        pub fn $($rest)*
    };
}

pub(crate) use {const_unless_loom, own};

//! Stands in for the library `critical-section`, so that stm32f4xx-hal and our own critical section can be had together.
//!
//! stm32f4xx-hal turns on the feature `critical-section-single-core` of cortex-m. With it cortex-m registers a section made
//! of PRIMASK, which would mask reflex, stop and encoder for as long as a log line takes; and beside the one made of BASEPRI
//! (`edm_hal_shim::stm32f4::critical`) it does not link, since there is one pair of symbols. Cargo only ever adds features,
//! and a package that replaces cortex-m cannot use the cortex-m that it replaces. So the line is drawn here:
//! [`set_impl!`] passes over the section of cortex-m, by its name, and takes any other. Should cortex-m rename it, the
//! firmware does not link.
//!
//! The rest is the interface of the library, as far as the firmware's libraries use it; what is missing does not compile.
#![no_std]

use core::marker::PhantomData;

/// What an implementation keeps from `acquire` to `release`.
pub type RawRestoreState = u32;

/// The same, for those who must not look at it.
#[derive(Clone, Copy, Debug)]
pub struct RestoreState(RawRestoreState);

impl RestoreState {
    /// A placeholder, never to be passed to [`release`].
    pub const fn invalid() -> Self {
        RestoreState(0)
    }
}

/// Proof of being inside a critical section.
#[derive(Clone, Copy, Debug)]
pub struct CriticalSection<'cs>(PhantomData<&'cs ()>);

impl CriticalSection<'_> {
    /// # Safety
    ///
    /// Only inside a critical section, for as long as it lasts.
    #[inline(always)]
    pub unsafe fn new() -> Self {
        CriticalSection(PhantomData)
    }
}

/// An implementation.
///
/// # Safety
///
/// Between `acquire` and `release` nothing else that may use a critical section runs; sections nest.
pub unsafe trait Impl {
    /// Begins a section.
    ///
    /// # Safety
    ///
    /// As for [`acquire`].
    unsafe fn acquire() -> RawRestoreState;

    /// Ends it.
    ///
    /// # Safety
    ///
    /// As for [`release`].
    unsafe fn release(before: RawRestoreState);
}

unsafe extern "Rust" {
    fn _critical_section_1_0_acquire() -> RawRestoreState;
    fn _critical_section_1_0_release(before: RawRestoreState);
}

/// Begins a critical section.
///
/// # Safety
///
/// Each is ended by exactly one [`release`], in the opposite order.
#[inline(always)]
pub unsafe fn acquire() -> RestoreState {
    // SAFETY: the caller keeps the contract; [`set_impl!`] defines the function as it is declared.
    RestoreState(unsafe { _critical_section_1_0_acquire() })
}

/// Ends a critical section.
///
/// # Safety
///
/// `before` comes from the [`acquire`] that it ends.
#[inline(always)]
pub unsafe fn release(before: RestoreState) {
    // SAFETY: as for `acquire`.
    unsafe { _critical_section_1_0_release(before.0) }
}

/// Runs `f` in a critical section. A panic in it does not unwind here: it ends in a reset.
#[inline]
pub fn with<R>(f: impl FnOnce(CriticalSection<'_>) -> R) -> R {
    // SAFETY: released below.
    let before = unsafe { acquire() };
    // SAFETY: the section lasts until `f` has returned.
    let result = f(unsafe { CriticalSection::new() });
    // SAFETY: acquired above.
    unsafe { release(before) };
    result
}

/// Makes a type the implementation; twice does not link. The one of cortex-m is passed over.
#[macro_export]
macro_rules! set_impl {
    (SingleCoreCriticalSection) => {};
    ($Implementation:ty) => {
        // SAFETY: the names are this library's own, and defined once.
        #[unsafe(no_mangle)]
        unsafe fn _critical_section_1_0_acquire() -> $crate::RawRestoreState {
            // SAFETY: called by `acquire` alone, whose caller keeps the contract.
            unsafe { <$Implementation as $crate::Impl>::acquire() }
        }
        // SAFETY: as above.
        #[unsafe(no_mangle)]
        unsafe fn _critical_section_1_0_release(before: $crate::RawRestoreState) {
            // SAFETY: called by `release` alone, whose caller keeps the contract.
            unsafe { <$Implementation as $crate::Impl>::release(before) }
        }
    };
}

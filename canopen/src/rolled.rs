//! Loops that stay loops.
//!
//! Nothing in the node is hot, and its flash is counted: at the optimisation that the ticks need, a loop over four PDOs
//! would be written out four times. The compiler does not know how long these slices are. For the same reason many
//! functions of this room say `inline(never)`.

use core::hint::black_box;

/// All of a slice.
pub(super) fn rolled<T>(slice: &[T]) -> &[T] {
    black_box(slice)
}

/// All of a slice, to be changed.
pub(super) fn rolled_mut<T>(slice: &mut [T]) -> &mut [T] {
    black_box(slice)
}

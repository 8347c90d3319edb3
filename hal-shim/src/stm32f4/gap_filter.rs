//! The arithmetic of [`gap_filter`](crate::gap_filter) in assembly: 72 cycles with its return, where the compiler takes 96
//! (estimated: DDI 0439, tables 3-1 and 7-1).
//!
//! Nine coefficients and eight values of state come by three multiple loads and go by one multiple store, and a section
//! commits while the next one computes, because an instruction that needs the result of the one before waits a cycle. The
//! state comes into s8 to s15 and goes from s7 to s14: each new value has its place while the old ones are still needed.

use crate::gap_filter::{Coefficients, State};
use core::mem::{offset_of, size_of};

const _: () = {
    assert!(size_of::<Coefficients>() == 12 && size_of::<State>() == 12);
    assert!(offset_of!(Coefficients, r) == 0 && offset_of!(Coefficients, b) == 4 && offset_of!(Coefficients, g) == 8);
    assert!(offset_of!(State, band) == 0 && offset_of!(State, low) == 4 && offset_of!(State, lost) == 8);
};

/// As [`in_rust`](crate::gap_filter::in_rust), bit for bit.
// A naked function, because the compiler does not know the single registers of this FPU: they cannot be named in `asm!`.
// SAFETY: AAPCS with hard floats: c in r0, sections in r1, x and the result in s0; r0 to r3 and s0 to s15 are its own. It reads
// the nine words of `c`, and reads and writes the first eight of `sections`.
#[unsafe(naked)]
pub extern "C" fn tick(c: &[Coefficients; 3], sections: &mut [State; 3], x: f32) -> f32 {
    // A digit is the number of a section, a dash marks a new value of its state.
    core::arch::naked_asm!(
        ".fpu fpv4-sp-d16",
        "vldmia r0!, {{s1-s6}}",  // r0 b0 g0 r1 b1 g1
        "vldmia r1!, {{s8-s15}}", // band0 low0 lost0 band1 low1 lost1 band2 low2
        "vmul.f32 s1, s1, s8",
        "vmul.f32 s4, s4, s11",
        "vadd.f32 s1, s9, s1",  // rest0
        "vadd.f32 s4, s12, s4", // rest1
        "vsub.f32 s1, s0, s1",
        "vmul.f32 s7, s2, s1",  // band_rise0
        "vldmia r0, {{s0-s2}}", // r2 b2 g2
        "vadd.f32 s8, s8, s7",  // band in the middle of the tick: mid0
        "vmul.f32 s3, s3, s8",  // low_rise0
        "vadd.f32 s7, s8, s7",  // band0'
        "vadd.f32 s8, s9, s3",  // y0
        "vadd.f32 s3, s3, s3",
        "vsub.f32 s4, s8, s4",
        "vadd.f32 s3, s3, s10",  // step0
        "vmul.f32 s5, s5, s4",   // band_rise1
        "vadd.f32 s8, s9, s3",   // low0'
        "vadd.f32 s11, s11, s5", // mid1
        "vsub.f32 s9, s8, s9",
        "vmul.f32 s6, s6, s11",  // low_rise1
        "vsub.f32 s9, s3, s9",   // lost0'
        "vadd.f32 s4, s12, s6",  // y1
        "vadd.f32 s10, s11, s5", // band1'
        "vadd.f32 s6, s6, s6",
        "vmul.f32 s3, s0, s14",
        "vadd.f32 s6, s6, s13",  // step1
        "vadd.f32 s3, s15, s3",  // rest2
        "vadd.f32 s11, s12, s6", // low1'
        "vsub.f32 s3, s4, s3",
        "vsub.f32 s12, s11, s12",
        "vmul.f32 s1, s1, s3",   // band_rise2
        "vsub.f32 s12, s6, s12", // lost1'
        "vadd.f32 s14, s14, s1", // mid2
        "vsub.f32 s0, s0, s2",
        "vmul.f32 s2, s2, s14", // low_rise2
        "vmul.f32 s0, s0, s14",
        "vadd.f32 s2, s2, s2",
        "vadd.f32 s13, s14, s1", // band2'
        "vadd.f32 s14, s15, s2", // low2'
        "vsub.f32 s0, s4, s0",   // y2
        "vstmdb r1!, {{s7-s14}}",
        "bx lr",
    )
}

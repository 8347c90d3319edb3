//! One sample through two low-pass sections and a notch in series: what the gap task does 20 000 times a second.
//!
//! The sections are the state-variable sections of the core (`dsp::svf`), which says what they do and why, and designs their
//! coefficients. Here is the arithmetic of a sample alone, because the chip has it a second time, in assembly, with the
//! same operations in the same order, and therefore with the same bits (`stm32f4/gap_filter.rs`).

/// What a section multiplies by.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(C)]
pub struct Coefficients {
    /// g + k, with the damping k.
    pub r: f32,
    /// g / (1 + g (g + k)): solves the loop.
    pub b: f32,
    /// Gain of an integrator over half a tick.
    pub g: f32,
}

/// What a section remembers, in the unit of its input.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(C)]
pub struct State {
    /// First integrator.
    pub band: f32,
    /// Second integrator.
    pub low: f32,
    /// What the sum in `low` could not hold.
    pub lost: f32,
}

/// What a tick does to a section.
#[derive(Clone, Copy, Debug)]
struct Response {
    /// Rise of *band* over each half of the tick.
    band_rise: f32,
    /// *band* in the middle of the tick.
    band: f32,
    /// Rise of *low* over each half of the tick.
    low_rise: f32,
}

impl State {
    /// Answers the input `x`.
    #[inline(always)]
    fn respond(&self, c: &Coefficients, x: f32) -> Response {
        // The input under which *band* would not move.
        let rest = self.low + c.r * self.band;
        let band_rise = c.b * (x - rest);
        let band = self.band + band_rise;
        Response { band_rise, band, low_rise: c.g * band }
    }

    /// One sample through a low-pass.
    ///
    /// Close to rest the last steps of *low* are smaller than half its last digit: a plain sum would stop 0.05 codes
    /// short at 20 Hz. What the sum cannot hold is carried over to the next tick (Kahan).
    #[inline(always)]
    pub fn low_pass(&mut self, c: &Coefficients, x: f32) -> f32 {
        let Response { band_rise, band, low_rise } = self.respond(c, x);
        let y = self.low + low_rise;
        self.band = band + band_rise;
        let step = (low_rise + low_rise) + self.lost;
        let low = self.low + step;
        self.lost = step - (low - self.low);
        self.low = low;
        y
    }

    /// One sample through a notch, whose frequency and Q are such that a plain sum stops within 0.01/Q codes.
    #[inline(always)]
    pub fn notch(&mut self, c: &Coefficients, x: f32) -> f32 {
        let Response { band_rise, band, low_rise } = self.respond(c, x);
        self.band = band + band_rise;
        self.low += low_rise + low_rise;
        x - (c.r - c.g) * band
    }
}

/// Two low-passes and a notch, in this order: takes the newest sample, gives the filtered one.
#[inline(always)]
pub fn tick(c: &[Coefficients; 3], sections: &mut [State; 3], x: f32) -> f32 {
    #[cfg(all(target_arch = "arm", feature = "chip"))]
    return crate::stm32f4::gap_filter::tick(c, sections, x);
    #[cfg(not(all(target_arch = "arm", feature = "chip")))]
    in_rust(c, sections, x)
}

/// [`tick`] as the compiler writes it.
#[inline]
pub fn in_rust(c: &[Coefficients; 3], sections: &mut [State; 3], x: f32) -> f32 {
    let [first, second, third] = sections;
    let y = first.low_pass(&c[0], x);
    let y = second.low_pass(&c[1], y);
    third.notch(&c[2], y)
}

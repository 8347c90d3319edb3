//! Physical quantities, and the only place where a scale factor is written.
//!
//! A quantity that crosses a room's border is one of these newtypes; a bare `f32` is a ratio or sits inside a formula
//! whose doc comment names its units. Signs: position, path coordinate, velocity and duty are positive toward the work
//! (down).

/// Rate of the servo tick, Hz.
pub const TICK_HZ: u32 = 20_000;
/// Period of the servo tick, s.
pub const TICK_S: f32 = 1.0 / TICK_HZ as f32;
/// Rate of the fixed-rate gap-voltage conversion, Hz.
pub const ADC_HZ: u32 = TICK_HZ * edm_hal_shim::gap::BLOCK as u32;
/// Ticks of the 1 kHz supervision.
pub const TICKS_PER_MS: u32 = TICK_HZ / 1000;
/// Full scale of a 12-bit conversion.
pub const ADC_FULL_SCALE: u16 = 4095;

macro_rules! quantity {
    ($($(#[$doc:meta])* $name:ident),+ $(,)?) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub struct $name(pub f32);
    )+};
}

quantity! {
    /// Electric potential, V.
    Volts,
    /// Electric current, A.
    Amps,
    /// Length along the path or an axis, um.
    Micrometres,
    /// Velocity along the path or an axis, um/s.
    MicrometresPerSecond,
    /// Acceleration, um/s^2.
    MicrometresPerSecond2,
    /// Encoder velocity, counts/s.
    CountsPerSecond,
    /// Frequency, Hz.
    Hertz,
    /// Duration, s.
    Seconds,
    /// Force, N.
    Newtons,
}

impl Seconds {
    /// Whole servo ticks in this duration, rounded to nearest; saturates at the ends of `u32`.
    pub fn ticks(self) -> u32 {
        (self.0 * TICK_HZ as f32 + 0.5) as u32
    }
}

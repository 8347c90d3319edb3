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
/// Ticks from one plan of the head's motion to the next at the most, where it may move fast: 4 kHz (`head/follow.rs`).
pub const PLAN_TICKS: u32 = 5;
/// The same of a head that erodes and hardly moves: 2 kHz, 100 times the 20 Hz of the gap loop.
pub const CALM_TICKS: u32 = 2 * PLAN_TICKS;
/// Rate of the clock that times encoder edges: the core clock, Hz.
pub const CLOCK_HZ: u32 = 168_000_000;
/// Full scale of a 12-bit conversion.
pub const ADC_FULL_SCALE: u16 = 4095;

/// The larger number; `b` when `a` is none.
///
/// The Cortex-M4 has no instruction for it, and `f32::max` calls a function of 20 cycles for what two instructions do.
#[inline(always)]
pub(crate) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller number; `b` when `a` is none. See [`larger`].
#[inline(always)]
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The number nearest to `x` from `low` to `high`; `low` when `x` is none.
#[inline(always)]
pub(crate) fn within(x: f32, low: f32, high: f32) -> f32 {
    smaller(larger(x, low), high)
}

/// The number nearest to `x` from `-limit` to `limit`, which is not negative; `-limit` when `x` is none.
#[inline(always)]
pub(crate) fn within_either(x: f32, limit: f32) -> f32 {
    if x.abs() <= limit {
        x
    } else {
        rare();
        if x > 0.0 { limit } else { -limit }
    }
}

/// Tells the compiler which way of a branch is rare: the other one then runs straight on, which saves three cycles.
#[cold]
#[inline]
pub(crate) fn rare() {}

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
    /// Encoder acceleration, counts/s^2.
    CountsPerSecond2,
    /// Frequency, Hz.
    Hertz,
    /// Duration, s.
    Seconds,
    /// Force, N.
    Newtons,
}

/// A length that must stay exact over any travel, nm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Nanometres(pub i64);

impl Nanometres {
    /// The same length in um, for reports and rates.
    pub fn um(self) -> Micrometres {
        Micrometres(self.0 as f32 * 1e-3)
    }
}

/// Binary places of a path coordinate (um) and of an axis setpoint (counts).
///
/// 2^-24 um is fine enough that 0.1 mm/min, 1400 steps a tick, is exact to 0.1 %, and coarse enough that a step of
/// 128 um in one tick (2.5 m/s) still fits 32 bits.
pub const FRACTION_BITS: u32 = 24;

/// A coordinate with [`FRACTION_BITS`] binary places: um along the path, or encoder counts of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Fixed(pub i64);

impl Fixed {
    /// Largest magnitude that a whole number may have: 2^38 leaves room for every sum that the path makes.
    pub const MAX_WHOLE: i64 = 1 << 38;

    /// A whole number of um or counts; saturates at [`Fixed::MAX_WHOLE`].
    pub fn whole(x: i64) -> Fixed {
        Fixed(x.clamp(-Self::MAX_WHOLE, Self::MAX_WHOLE) << FRACTION_BITS)
    }

    /// Nearest whole number of um or counts.
    pub fn round(self) -> i64 {
        (self.0.wrapping_add(1 << (FRACTION_BITS - 1))) >> FRACTION_BITS
    }

    /// A short length, um or counts; saturates beyond +-128.
    pub fn short(x: f32) -> Fixed {
        Fixed(i64::from((x * (1u32 << FRACTION_BITS) as f32) as i32))
    }

    /// As a float: exact within +-1, then to 23 bits.
    ///
    /// The Cortex-M4 converts 32 bits in one instruction; 64 take a function of 40 cycles.
    #[inline]
    pub fn to_f32(self) -> f32 {
        const STEP: f32 = 1.0 / (1u32 << FRACTION_BITS) as f32;
        const HIGH: f32 = (1u64 << (32 - FRACTION_BITS)) as f32;
        let (high, low) = ((self.0 >> 32) as i32, self.0 as u32);
        if high == low.cast_signed() >> 31 {
            low.cast_signed() as f32 * STEP
        } else {
            rare();
            high as f32 * HIGH + low as f32 * STEP
        }
    }

    /// Sum; saturates.
    pub fn plus(self, other: Fixed) -> Fixed {
        Fixed(self.0.saturating_add(other.0))
    }

    /// Difference; saturates.
    pub fn minus(self, other: Fixed) -> Fixed {
        Fixed(self.0.saturating_sub(other.0))
    }

    /// Sum of two that lie within [`Fixed::MAX_WHOLE`] and cannot overflow: a third of the cycles of [`Fixed::plus`].
    #[inline]
    pub(crate) fn near(self, by: Fixed) -> Fixed {
        Fixed(self.0.wrapping_add(by.0))
    }

    /// Distance from `other`, which must lie as near, as a float. See [`Fixed::near`].
    #[inline]
    pub(crate) fn from(self, other: Fixed) -> f32 {
        Fixed(self.0.wrapping_sub(other.0)).to_f32()
    }
}

impl MicrometresPerSecond {
    /// Distance covered in one servo tick at this velocity; saturates beyond 2.5 m/s.
    pub fn per_tick(self) -> Fixed {
        Fixed::short(self.0 * TICK_S)
    }
}

impl Seconds {
    /// Whole servo ticks in this duration, rounded to nearest; saturates at the ends of `u32`.
    pub fn ticks(self) -> u32 {
        (self.0 * TICK_HZ as f32 + 0.5) as u32
    }
}

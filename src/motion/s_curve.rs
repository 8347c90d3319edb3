//! A move from rest to rest within limits of velocity, acceleration and jerk.
//!
//! The velocity is a pulse as long as the distance takes at full velocity, run through two moving averages, as long as the
//! ramp of velocity and that of acceleration take (\[A\] shapes its profiles by such a convolution). No average exceeds what it
//! is of, so that all three limits hold by construction. In ticks everything is a whole number: the place is a function of the
//! time, sums of tetrahedral numbers, and the last tick is exactly on the target.

use crate::units::{CountsPerSecond, CountsPerSecond2, Fixed, TICK_HZ, TICK_S, larger, smaller};

/// Longest part of a move, ticks: 0.8 s, so that the sums fit. A longer one is refused by the settings that would ask for it.
pub const LONGEST: u32 = 16_000;

/// Parts of a tick, for a move that waits.
pub const PART: u32 = 256;

/// Binary places that a share of the distance has beyond those of [`Fixed`]: what its rounding leaves for the last tick is no
/// jerk to speak of.
const SHARE_BITS: u32 = 48;

/// Limits of a move, positive.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct JerkLimits {
    /// Velocity.
    pub velocity: CountsPerSecond,
    /// Acceleration.
    pub acceleration: CountsPerSecond2,
    /// Jerk, counts/s^3.
    pub jerk: f32,
}

/// A move under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SCurve {
    from: Fixed,
    distance: Fixed,
    /// Lengths of the pulse and of the averages, ticks.
    parts: [u32; 3],
    /// Share of the distance for a sixth of a part, with [`SHARE_BITS`] more.
    share: i128,
}

impl SCurve {
    /// From a place to another, at rest in both.
    pub fn new(from: Fixed, to: Fixed, limits: &JerkLimits) -> SCurve {
        let distance = to.minus(from);
        let length = larger(distance.to_f32().abs(), 1e-3);
        let (v, a, j) = (limits.velocity.0, limits.acceleration.0, limits.jerk);
        // What the distance has room for: first the acceleration, then the velocity.
        let ramp = libm::cbrtf(length / (2.0 * j));
        let a = smaller(a, j * ramp);
        let tail = a / j;
        let v = smaller(v, 0.5 * a * (libm::sqrtf(tail * tail + 4.0 * length / a) - tail));
        let ticks = |seconds: f32| ((seconds * TICK_HZ as f32) as u32).saturating_add(1).min(LONGEST);
        // Each is calculated with what the one before leaves.
        let pulse = ticks(length / v);
        let v = length / (pulse as f32 * TICK_S);
        let rise = ticks(v / a);
        let a = v / (rise as f32 * TICK_S);
        let tail = ticks(a / j);
        // Were it shorter, two changes of the acceleration would overlap.
        let parts = [pulse.max(rise.saturating_add(tail)), rise, tail];
        let whole = parts.into_iter().fold(6i64, |product, ticks| product.saturating_mul(ticks.into()));
        let share = (i128::from(distance.0) << SHARE_BITS).checked_div(whole.into()).unwrap_or(0);
        SCurve { from, distance, parts, share }
    }

    /// Ticks that it takes.
    pub fn ticks(&self) -> u32 {
        self.parts.into_iter().fold(0, u32::saturating_add)
    }

    /// Where it ends.
    pub fn to(&self) -> Fixed {
        self.from.plus(self.distance)
    }

    /// Where it is after so many ticks, in parts of [`PART`].
    pub fn at_part(&self, parts: u32) -> Fixed {
        let (tick, part) = (parts / PART, i64::from(parts % PART));
        let before = self.at(tick);
        let travel = self.at(tick.saturating_add(1)).minus(before);
        before.plus(Fixed(travel.0.wrapping_mul(part) / i64::from(PART)))
    }

    /// Where it is after so many ticks.
    pub fn at(&self, tick: u32) -> Fixed {
        if tick >= self.ticks() {
            return self.to();
        }
        let [a, b, c] = self.parts;
        // The pulse and both averages begin with a step up and end with one down: eight steps, each of which counts on as the
        // tetrahedral numbers of the ticks since.
        let since = |ticks: u32| {
            let m = i64::from(tick.saturating_sub(ticks));
            m.saturating_mul(m.saturating_add(1)).saturating_mul(m.saturating_add(2))
        };
        let (ab, ac, bc) = (a.saturating_add(b), a.saturating_add(c), b.saturating_add(c));
        let up = since(0).saturating_add(since(ab)).saturating_add(since(ac)).saturating_add(since(bc));
        let down = since(a).saturating_add(since(b)).saturating_add(since(c));
        let gone = i128::from(up.saturating_sub(down)).wrapping_mul(self.share) >> SHARE_BITS;
        self.from.plus(Fixed(gone as i64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn limits(velocity: f32, acceleration: f32, jerk: f32) -> JerkLimits {
        JerkLimits { velocity: CountsPerSecond(velocity), acceleration: CountsPerSecond2(acceleration), jerk }
    }

    /// Largest velocity, acceleration and jerk of set points a plan apart, from whichever tick.
    fn largest(curve: &SCurve, offset: u32) -> [f64; 3] {
        let plan = crate::units::PLAN_TICKS;
        let plan_s = f64::from(plan) * f64::from(TICK_S);
        let place = |number: i64| {
            let tick = number * i64::from(plan) - i64::from(offset);
            curve.at(tick.max(0) as u32).0 as f64 / (1u64 << crate::units::FRACTION_BITS) as f64
        };
        let mut places: Vec<f64> = (-4..=i64::from(curve.ticks() / plan) + 6).map(place).collect();
        std::array::from_fn(|_| {
            places = places.windows(2).map(|pair| (pair[1] - pair[0]) / plan_s).collect();
            places.iter().fold(0.0, |most, x| f64::max(most, x.abs()))
        })
    }

    /// Checks a move of so many counts from each of the ticks that a plan may begin at.
    fn keeps_its_limits_and_ends_on_its_target(distance: i64, limits: &JerkLimits) {
        let curve = SCurve::new(Fixed::whole(7), Fixed::whole(7 + distance), limits);
        assert!(curve.parts.iter().all(|part| *part < LONGEST));
        assert_eq!(curve.at(0), Fixed::whole(7));
        assert_eq!(curve.at(curve.ticks()), Fixed::whole(7 + distance));
        // The tick before is next to it, by less than the finest count there is.
        let last = curve.at(curve.ticks() - 1).minus(curve.to()).to_f32();
        assert!(last.abs() < 0.01, "{last} before the end");
        let plan_s = f64::from(crate::units::PLAN_TICKS) / f64::from(TICK_HZ);
        for offset in 0..crate::units::PLAN_TICKS {
            let found = largest(&curve, offset);
            // A place is rounded down to 2^-24 counts. The first difference of what that takes away is below one such step, each
            // further one twice as large: up to 15 259 counts/s^3 of jerk. Relative: the limits are f32, and so is what is
            // calculated with them.
            let mut rounding = 1.0 / (1u64 << crate::units::FRACTION_BITS) as f64 / plan_s;
            for (found, limit) in found.into_iter().zip([limits.velocity.0, limits.acceleration.0, limits.jerk]) {
                assert!(
                    found <= f64::from(limit) * (1.0 + 2e-6) + rounding,
                    "{found} of {limits:?}, {distance}, {offset}"
                );
                rounding *= 2.0 / plan_s;
            }
        }
        // Set points never turn.
        let places: Vec<Fixed> = (0..=curve.ticks()).map(|tick| curve.at(tick)).collect();
        assert!(places.windows(2).all(|pair| (pair[1].0 - pair[0].0) * distance.signum() >= 0));
    }

    proptest! {
        #[test]
        fn a_move_keeps_its_limits_and_ends_on_its_target(
            distance in -200_000i64..200_000, v in 1e4f32..1e6, a in 1e6f32..1e8, ramp_ms in 0.5f32..20.0,
        ) {
            prop_assume!(distance.abs() > 10 && (distance.abs() as f32 / v) < 0.7);
            keeps_its_limits_and_ends_on_its_target(distance, &limits(v, a, a / (ramp_ms * 1e-3)));
        }
    }

    #[test]
    fn a_long_move_of_little_jerk_exceeds_it_by_the_rounding_of_places_only() {
        keeps_its_limits_and_ends_on_its_target(88_055, &limits(809_641.9, 1e6, 1e6 / 18.300_476e-3));
    }

    #[test]
    fn a_move_takes_as_long_as_the_best_there_is() {
        // 8 mm at 75 m/s^2 with 5 ms of jerk: D = v (v / a + a / j), so 0.609 m/s; and it takes 2 (v / a + a / j).
        let curve = SCurve::new(Fixed(0), Fixed::whole(8000), &limits(1e6, 75e6, 15e9));
        let peak = largest(&curve, 0)[0];
        assert!((peak - 609e3).abs() < 6e3, "{peak}");
        let ms = curve.ticks() as f32 / 20.0;
        assert!((ms - 26.2).abs() < 0.5, "{ms}");
    }

    #[test]
    fn the_longest_move_fits_its_numbers() {
        // 16 000 ticks each: 26.2 s of 1 m.
        let far = 1 << 20;
        let limits = limits(far as f32 / 0.7999, far as f32 / (0.7999 * 0.7999), far as f32 / (0.7999f32).powi(3));
        let curve = SCurve { parts: [LONGEST; 3], ..SCurve::new(Fixed(0), Fixed::whole(far), &limits) };
        let share = (i128::from(Fixed::whole(far).0) << SHARE_BITS) / (6 * i128::from(LONGEST).pow(3));
        let curve = SCurve { share, ..curve };
        let places: Vec<Fixed> = (0..=curve.ticks()).map(|tick| curve.at(tick)).collect();
        assert!(places.windows(2).all(|pair| pair[1] >= pair[0]));
        let half = places[places.len() / 2].to_f32() / far as f32;
        assert!((half - 0.5).abs() < 1e-3, "{half}");
    }
}

//! Limits that every motion along the path shares: acceleration, and what can still be stopped before an end.

use crate::units::{
    CALM_TICKS, Micrometres, MicrometresPerSecond, MicrometresPerSecond2, TICK_HZ, TICK_S, larger, smaller, within,
};
use micromath::F32Ext as Approximate;

/// Limits of path velocity under a feed law.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limits {
    /// Toward the work.
    pub feed: MicrometresPerSecond,
    /// Away from it.
    pub retreat: MicrometresPerSecond,
}

impl Limits {
    /// The nearest allowed velocity.
    pub fn clamp(&self, wanted: MicrometresPerSecond) -> MicrometresPerSecond {
        MicrometresPerSecond(within(wanted.0, -self.retreat.0, self.feed.0))
    }
}

/// Limits a path velocity and remembers what it let through.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limiter {
    velocity: f32,
}

impl Limiter {
    /// Velocity from now on; `ticks` have passed since the last call, and at most [`CALM_TICKS`] will until the next.
    /// `ahead` and `behind` give the lengths left toward either end: the head can always stop within them, v^2 <= 2 a d.
    pub fn limit(
        &mut self,
        wanted: MicrometresPerSecond,
        acceleration: MicrometresPerSecond2,
        ticks: u32,
        ahead: impl FnOnce() -> Micrometres,
        behind: impl FnOnce() -> Micrometres,
    ) -> MicrometresPerSecond {
        let step = acceleration.0 * TICK_S * ticks as f32;
        let slewed = within(wanted.0, self.velocity - step, self.velocity + step);
        // Only the end that it moves toward matters.
        self.velocity = if slewed > 0.0 {
            stoppable(acceleration, ahead(), slewed)
        } else if slewed < 0.0 {
            -stoppable(acceleration, behind(), -slewed)
        } else {
            0.0
        };
        MicrometresPerSecond(self.velocity)
    }

    /// The head goes at this velocity, whatever was let through last.
    pub fn go_on_from(&mut self, velocity: MicrometresPerSecond) {
        self.velocity = velocity.0;
    }

    /// Forgets the velocity: the head stands.
    pub fn stop(&mut self) {
        self.velocity = 0.0;
    }
}

/// The largest speed up to `speed`, positive, that can be stopped within `distance`, the travel until the next plan included.
///
/// Half the square root's argument is given away, which covers micromath's 5 % and the slew that is still to come.
fn stoppable(a: MicrometresPerSecond2, distance: Micrometres, speed: f32) -> f32 {
    let distance = larger(distance.0, 0.0);
    let square = a.0 * distance;
    let stop = if speed * speed <= square { speed } else { Approximate::sqrt(square) };
    smaller(stop, distance * (TICK_HZ / CALM_TICKS) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ACCELERATION: MicrometresPerSecond2 = MicrometresPerSecond2(1e6);

    fn far() -> Micrometres {
        Micrometres(1e6)
    }

    #[test]
    fn feed_and_retreat_have_limits_of_their_own() {
        let limits = Limits { feed: MicrometresPerSecond(200.0), retreat: MicrometresPerSecond(1000.0) };
        let clamp = |v| limits.clamp(MicrometresPerSecond(v)).0;
        assert_eq!([clamp(199.0), clamp(201.0), clamp(-999.0), clamp(-1001.0)], [199.0, 200.0, -999.0, -1000.0]);
    }

    #[test]
    fn velocity_changes_by_the_acceleration_and_no_more() {
        let mut limiter = Limiter::default();
        let first = limiter.limit(MicrometresPerSecond(-1000.0), ACCELERATION, 1, far, far).0;
        assert!((first + 50.0).abs() < 1e-3);
        let second = limiter.limit(MicrometresPerSecond(1000.0), ACCELERATION, 1, far, far).0;
        assert!(second.abs() < 1e-3);
    }

    #[test]
    fn the_head_stops_before_either_end_from_any_speed() {
        for (direction, ticks) in [(1.0f32, 1), (-1.0, 1), (1.0, CALM_TICKS), (-1.0, CALM_TICKS)] {
            let mut limiter = Limiter::default();
            let mut left = 30.0f32;
            let mut fastest = 0.0f32;
            for _ in 0..200_000 {
                let near = || Micrometres(left);
                let wanted = MicrometresPerSecond(direction * 1e5);
                let v = if direction > 0.0 {
                    limiter.limit(wanted, ACCELERATION, ticks, near, far).0
                } else {
                    limiter.limit(wanted, ACCELERATION, ticks, far, near).0
                };
                left -= v * direction * ticks as f32 * TICK_S;
                fastest = fastest.max(v.abs());
                assert!(left >= -1e-6, "ran over the end by {left} um");
            }
            assert!(left < 0.5, "crept to a halt {left} um before the end");
            assert!(fastest > 100.0);
        }
    }
}

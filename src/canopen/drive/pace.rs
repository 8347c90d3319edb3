//! The velocity that a host reads (606Ch).
//!
//! What the loops need is the newest distance between two edges, without any delay. Of a slow axis a host would see the least of
//! that: below some 1500 counts/s edges are rarer than the loop's bandwidth, the axis goes in steps of a count or two, and the mean
//! of what is read is not the way by the time. A host reads the counts of the last 20 ms instead, as long as the axis is slow.

use crate::units::{CountsPerSecond, TICK_HZ, TICK_S};

/// Time constant of the mean, s: one count is 50 counts/s.
const MEAN_S: f32 = 20e-3;
/// From here on, counts/s, the newest edges say it as well and at once: twice what an axis of 1000 counts/s was seen to have in
/// its steps, and a half more.
const FAST: f32 = 3000.0;

/// See the module.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pace {
    mean: f32,
    /// Newest position, counts, and its tick.
    position: i64,
    tick: u32,
}

impl Pace {
    /// Takes the newest position and velocity.
    pub fn observe(&mut self, position: i64, tick: u32, newest: CountsPerSecond) {
        let ticks = tick.wrapping_sub(self.tick);
        let moved = position.wrapping_sub(self.position);
        (self.position, self.tick) = (position, tick);
        if newest.0.abs() >= FAST || ticks >= (MEAN_S * TICK_HZ as f32) as u32 {
            self.mean = newest.0;
        } else if moved.unsigned_abs() < 100 {
            // Further in a millisecond is no motion, but another home.
            self.mean += moved as f32 / MEAN_S - self.mean * (ticks as f32 * (TICK_S / MEAN_S));
        }
    }

    /// The velocity to be read.
    pub fn velocity(&self) -> CountsPerSecond {
        CountsPerSecond(self.mean)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_axis_has_the_velocity_of_its_counts_and_a_fast_one_that_of_its_edges() {
        let mut pace = Pace::default();
        let (mut least, mut most) = (f32::INFINITY, 0.0f32);
        for ms in 0..1000u32 {
            // 500 counts/s in steps of two, and a new home in between.
            let home = if ms <= 500 { 0 } else { 1_000_000 };
            pace.observe(home + i64::from(ms / 4 * 2), ms * 20, CountsPerSecond(1800.0));
            if ms >= 200 {
                (least, most) = (least.min(pace.velocity().0), most.max(pace.velocity().0));
            }
        }
        assert!(least > 400.0 && most < 600.0, "{least} to {most}");
        pace.observe(1_000_499, 20_020, CountsPerSecond(-3000.0));
        assert_eq!(pace.velocity(), CountsPerSecond(-3000.0));
        // At rest it falls to nothing in the time of the mean.
        for ms in 1..=200 {
            pace.observe(1_000_499, 20_020 + ms * 20, CountsPerSecond(0.0));
        }
        assert!(pace.velocity().0.abs() < 1.0);
    }
}

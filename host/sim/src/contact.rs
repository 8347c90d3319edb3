//! Largest contact force allowed, and what it depends on.

use crate::process::Truth;
use edm_servo_head::units::TICKS_PER_MS;

/// Largest contact force of a slow approach, N.
pub const CONTACT_N: f64 = 5.0;
/// Largest contact force of any approach, N: at 20 mm/s, where coasting alone would press v sqrt(k m) = 12.6 N.
const MOST_N: f64 = 15.0;
/// Approaches for which these hold, um/s; in between the limit is interpolated.
const SLOW_UM_S: f64 = 5_000.0;
const FAST_UM_S: f64 = 20_000.0;
/// So fast, um/s, only a work is met that was raised where the head had been before; what is faster may press with more in
/// proportion. Seen in a soak of 100 hours: 15.5 N at 101 mm/s, where coasting alone would press 64 N.
const CLEARED_UM_S: f64 = 90_000.0;
/// Ticks for which the fastest approach is remembered: 100 ms.
const REMEMBERED: u32 = 100 * TICKS_PER_MS;

/// The approach that a contact comes from.
#[derive(Clone, Copy, Debug, Default)]
pub struct Approach {
    /// The fastest lately, um/s, and ticks since.
    fastest_um_s: f64,
    ticks: u32,
}

impl Approach {
    /// One more tick.
    pub fn tick(&mut self, truth: &Truth) {
        self.ticks = self.ticks.saturating_add(1);
        if truth.gap_um > 0.0 && (truth.velocity_um_s >= self.fastest_um_s || self.ticks > REMEMBERED) {
            *self = Approach { fastest_um_s: truth.velocity_um_s, ticks: 0 };
        }
    }

    /// The fastest lately, mm/s.
    pub fn fastest_mm_s(&self) -> f64 {
        self.fastest_um_s * 1e-3
    }

    /// Largest contact force allowed, N.
    pub fn bound(&self) -> f64 {
        let share = (self.fastest_um_s - SLOW_UM_S) / (FAST_UM_S - SLOW_UM_S);
        let more = (self.fastest_um_s / CLEARED_UM_S).max(1.0);
        more * (CONTACT_N + share.clamp(0.0, 1.0) * (MOST_N - CONTACT_N))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(ticks: &[(f64, f64)]) -> Approach {
        let mut approach = Approach::default();
        for &(gap_um, velocity_um_s) in ticks {
            approach.tick(&Truth { gap_um, velocity_um_s, ..Truth::default() });
        }
        approach
    }

    #[test]
    fn five_newtons_are_promised_of_a_slow_approach_and_fifteen_up_to_90_mm_s() {
        for (um_s, newtons) in
            [(-1e3, 5.0), (0.0, 5.0), (5e3, 5.0), (12.5e3, 10.0), (20e3, 15.0), (90e3, 15.0), (108e3, 18.0)]
        {
            assert_eq!(after(&[(10.0, um_s)]).bound(), newtons, "{um_s} um/s");
        }
    }

    #[test]
    fn an_approach_is_remembered_in_the_contact_and_forgotten_where_the_gap_has_long_been_open() {
        let came = (1.0, 12.5e3);
        assert_eq!(after(&[came, (-1.0, 30e3)]).bound(), 10.0);
        let mut ticks = vec![came];
        ticks.extend([(1.0, 0.0)].repeat(REMEMBERED as usize));
        assert_eq!(after(&ticks).bound(), 10.0);
        ticks.push((1.0, 0.0));
        assert_eq!(after(&ticks).bound(), 5.0);
    }
}

//! An encoder that falls silent in the middle of a fast motion, plan by plan.
//!
//! A closed loop makes up for counts that do not come with all its force: in three milliseconds a head of 50 mm/s has 270 mm/s, and
//! half a millimetre further on it is in the work. The supervision, which reckons with forces and looks once a millisecond, is
//! too slow for that. A mass that moves cannot stand still half a millisecond later, unless it is braked hard or meets
//! something rigid, and then it comes back.

use super::config::Config;
use crate::units::{CountsPerSecond, TICK_HZ, TICK_S, larger, smaller};

/// Two plans, ticks: in one, a head that bounces off something may be where it was.
const SILENT: u32 = 8;
/// The same at the most: after that it rests by itself.
const LATE: u32 = 12;
/// Ticks for which the duty counts as if nothing else held the head.
const DRIVEN: u32 = 100;
/// Way that it should have gone meanwhile, um and counts.
const WAY: f32 = 8.0;
/// Slowest motion of which that is expected, um a tick: 16 mm/s.
const FAST: f32 = 0.8;

/// Counts a tick in a tick, of counts a millisecond in a millisecond.
const PER_TICK: f32 = 1e6 * TICK_S * TICK_S;

/// What the head did, and what it must have done since its encoder fell silent.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Silence {
    /// Newest count. An encoder of which one line is dead trembles by one, and is left to the supervision.
    from: i64,
    /// Counts a tick in the newest interval with any, and in the one before: it may have fallen silent in the newest.
    newest: f32,
    before: f32,
    /// Velocity that the duty gave in the newest one.
    given: f32,
    /// Ticks since then, what the duty has given in them, and the way that the head must have gone.
    ticks: u32,
    gained: f32,
    way: f32,
}

impl Silence {
    /// So many ticks later, at a count, under a duty and a velocity of the set point; whether counts are missing.
    pub fn look(&mut self, config: &Config, count: i64, duty: f32, wanted: CountsPerSecond, ticks: u32) -> bool {
        let axis = &config.axis;
        let moved = count.wrapping_sub(self.from);
        self.ticks = self.ticks.saturating_add(ticks);
        self.gained +=
            (duty - axis.gains.holding()) * ticks as f32 * (config.supervise.breakaway.acceleration * PER_TICK);
        if moved != 0 {
            let newest = moved as f32 / self.ticks.max(1) as f32;
            // One that is long past says nothing.
            let before = if self.ticks <= LATE { self.newest } else { newest };
            *self = Silence { from: count, newest, before, given: self.gained, ..Silence::default() };
            return false;
        }
        if self.ticks > DRIVEN {
            *self = Silence { from: self.from, ticks: self.ticks, ..Silence::default() };
            return false;
        }
        let fastest = axis.gains.velocity_limit().0 * TICK_S;
        // What nobody has asked for is a knock, and may end like one.
        let asked = wanted.0 * self.before > 0.0;
        if !asked || !(FAST * axis.counts_per_um..=fastest).contains(&self.before.abs()) {
            return false;
        }
        // What drives it is the answer to the silence; what brakes it may be why it stands. One that is lighter than its settings
        // say is braked harder than calculated, but not ahead of its set point.
        let brakes = smaller((self.given + self.gained) * self.before.signum(), 0.0);
        let moves = smaller(self.before.abs() + brakes, wanted.0.abs() * TICK_S);
        self.way += larger(moves, 0.0) * ticks as f32;
        (SILENT..=LATE).contains(&self.ticks) && self.way > WAY * larger(axis.counts_per_um, 1.0)
    }

    /// Velocity that the head must have, if it counts no more.
    pub fn driven(&self) -> CountsPerSecond {
        CountsPerSecond((self.before + self.given + self.gained) * TICK_HZ as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use crate::units::PLAN_TICKS;

    fn config() -> Config {
        Settings::default().build().unwrap().head
    }

    /// Looks every plan at places, counts, with a set point that goes there at 50 mm/s times `wanted`; the plan, from 0 on, in which counts are missing.
    fn missing(duty: f32, wanted: f32, places: &[f32]) -> Option<usize> {
        let config = config();
        let mut silence = Silence::default();
        let duty = config.axis.gains.holding() + duty;
        let wanted = CountsPerSecond((50e3 * wanted).copysign(places[0] * wanted));
        let mut looks = |place: f32| silence.look(&config, place as i64, duty, wanted, PLAN_TICKS);
        looks(0.0);
        places.iter().position(|place| looks(*place))
    }

    #[test]
    fn counts_that_do_not_come_any_more_at_speed_are_missing_after_two_plans() {
        for sign in [1.0, -1.0] {
            let places = [12.0, 25.0, 37.0, 40.0, 40.0, 40.0, 40.0].map(|place| place * sign);
            assert_eq!(missing(0.0, 1.0, &places), Some(5));
        }
    }

    #[test]
    fn a_knock_that_ends_misses_none() {
        assert_eq!(missing(0.0, 0.0, &[12.0, 25.0, 37.0, 40.0, 40.0, 40.0, 40.0]), None);
    }

    #[test]
    fn a_slow_head_that_comes_to_rest_misses_none() {
        assert_eq!(missing(0.0, 1.0, &[2.0, 4.0, 6.0, 6.0, 6.0, 6.0, 6.0, 6.0]), None);
    }

    #[test]
    fn a_head_that_is_braked_with_all_its_force_misses_none() {
        // 25 mm/s, and 100 m/s^2 against it.
        assert_eq!(missing(-0.7, 1.0, &[6.0, 12.0, 15.0, 16.0, 16.0, 16.0]), None);
    }

    #[test]
    fn a_light_head_that_is_braked_with_its_set_point_misses_none() {
        // 75 m/s^2 against it, by a duty that would brake 0.2 kg by 37 m/s^2.
        let config = config();
        let duty = config.axis.gains.holding() - config.axis.plant.accelerating(37e6);
        let missing = |wanted: [f32; 7]| {
            let mut silence = Silence::default();
            let looks = [0, 17, 28, 31, 31, 31, 31].into_iter().zip(wanted);
            looks
                .filter(|(count, wanted)| {
                    silence.look(&config, *count, duty, CountsPerSecond(wanted * 1e3), PLAN_TICKS)
                })
                .count()
        };
        assert_eq!(missing([70.0, 55.0, 36.0, 17.0, 5.0, 1.0, 0.5]), 0);
        assert!(missing([50.0; 7]) > 0, "the set point goes on");
    }

    #[test]
    fn a_head_that_bounces_off_its_stop_misses_none() {
        assert_eq!(missing(0.1, 1.0, &[12.0, 25.0, 24.0, 14.0, 4.0, -6.0]), None);
    }

    #[test]
    fn what_the_duty_has_given_since_the_newest_count_belongs_to_the_velocity() {
        let config = config();
        let mut silence = Silence::default();
        let duty = config.axis.gains.holding() + config.axis.plant.accelerating(50e6);
        let mut looks = |place| silence.look(&config, place, duty, CountsPerSecond(48e3), PLAN_TICKS);
        for place in [0, 12, 24, 36, 36, 36] {
            looks(place);
        }
        // 48 mm/s, and 50 m/s^2 for three plans: it may have fallen silent in the newest with counts.
        assert!((silence.driven().0 - 85.5e3).abs() < 100.0, "{:?}", silence.driven());
        for _ in 0..30 {
            silence.look(&config, 36, duty, CountsPerSecond(48e3), PLAN_TICKS);
        }
        assert_eq!(silence.driven(), CountsPerSecond(0.0), "it stands by now");
    }
}

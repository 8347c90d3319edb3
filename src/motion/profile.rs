//! A set point within limits of velocity and acceleration.
//!
//! From the distance d to the target follows the velocity that can still be stopped, d = v^2 / 2a + v T: braking, and the
//! travel of one more plan of length T before it begins. Followed from plan to plan it never brakes harder than a.

use crate::units::{
    CountsPerSecond, CountsPerSecond2, Fixed, PLAN_TICKS, TICK_HZ, TICK_S, larger, smaller, within_either,
};

/// Time from one plan to the next at the most, s.
const PLAN_S: f32 = PLAN_TICKS as f32 * TICK_S;
/// Distance from the target, counts, at which a profile that can stop is there.
const THERE: f32 = 1.0 / 1024.0;

/// Share of the deceleration that a move counts on: the rest makes good what rounding has left undone.
const COUNTED_ON: f32 = 0.98;

/// Limits of a profile, positive.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ramp {
    /// Velocity.
    pub velocity: CountsPerSecond,
    /// Acceleration.
    pub acceleration: CountsPerSecond2,
    /// Deceleration.
    pub deceleration: CountsPerSecond2,
}

/// What the loop follows until the next plan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TrajectorySegment {
    /// Set point at the plan, counts.
    pub from: Fixed,
    /// Travel in a tick, counts.
    pub travel: Fixed,
    /// The same as a velocity.
    pub velocity: CountsPerSecond,
}

impl TrajectorySegment {
    /// From the same place, at a velocity.
    pub fn at(self, velocity: CountsPerSecond) -> TrajectorySegment {
        TrajectorySegment { travel: Fixed::short(velocity.0 * TICK_S), velocity, ..self }
    }
}

/// A moving set point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Profile {
    segment: TrajectorySegment,
}

impl Profile {
    /// At rest.
    pub fn at(position: Fixed) -> Profile {
        Profile { segment: TrajectorySegment { from: position, ..TrajectorySegment::default() } }
    }

    /// Moving along: the segment followed until now.
    pub fn along(segment: TrajectorySegment) -> Profile {
        Profile { segment }
    }

    /// The set point at the newest plan, counts.
    pub fn position(&self) -> Fixed {
        self.segment.from
    }

    /// Whether the set point stands.
    pub fn stands(&self) -> bool {
        self.segment.travel == Fixed(0)
    }

    /// The axis has been given other coordinates: `by` is added to all of them.
    pub fn shift(&mut self, by: Fixed) {
        self.segment.from = self.segment.from.plus(by);
    }

    /// Plans on to a target; `ticks` have passed since the plan before.
    pub fn toward(&mut self, target: Fixed, ramp: &Ramp, ticks: u32) -> TrajectorySegment {
        self.advance(ticks);
        let distance = target.minus(self.segment.from).to_f32();
        let brake = ramp.deceleration.0 * COUNTED_ON;
        let reserve = brake * PLAN_S;
        let square = 2.0 * brake * distance.abs();
        let stoppable = square / (libm::sqrtf(reserve * reserve + square) + reserve);
        let stops = self.stands() || self.segment.velocity.0.abs() <= ramp.deceleration.0 * TICK_S * ticks as f32;
        if distance.abs() < THERE && stops {
            self.segment = TrajectorySegment { from: target, ..TrajectorySegment::default() };
            return self.segment;
        }
        let wanted = smaller(stoppable, ramp.velocity.0).copysign(distance);
        self.change(wanted, ramp.acceleration.0, ramp.deceleration.0, ticks)
    }

    /// Plans on to a stop.
    pub fn stop(&mut self, deceleration: CountsPerSecond2, ticks: u32) -> TrajectorySegment {
        self.advance(ticks);
        self.change(0.0, deceleration.0, deceleration.0, ticks)
    }

    /// Plans on to reach `target` in `left` ticks, no faster than `limit`.
    pub fn reach(&mut self, target: Fixed, left: u32, limit: CountsPerSecond, ticks: u32) -> TrajectorySegment {
        self.advance(ticks);
        let distance = target.minus(self.segment.from);
        let travel = distance.0.checked_div(left.max(PLAN_TICKS).into()).unwrap_or(0);
        let velocity = within_either(Fixed(travel).to_f32() * TICK_HZ as f32, limit.0);
        self.set(velocity)
    }

    fn advance(&mut self, ticks: u32) {
        self.segment.from = Fixed(self.segment.from.0.wrapping_add(self.segment.travel.0.wrapping_mul(ticks.into())));
    }

    fn change(&mut self, wanted: f32, acceleration: f32, deceleration: f32, ticks: u32) -> TrajectorySegment {
        let now = self.segment.velocity.0;
        // The way round leads through standstill: beyond it the acceleration holds.
        let turns = wanted * now < 0.0;
        let wanted = if turns { 0.0 } else { wanted };
        let slows = wanted.abs() < now.abs();
        let step = if slows { deceleration } else { acceleration } * TICK_S * ticks as f32;
        self.set(if wanted > now { smaller(now + step, wanted) } else { larger(now - step, wanted) })
    }

    fn set(&mut self, velocity: f32) -> TrajectorySegment {
        self.segment.velocity = CountsPerSecond(velocity);
        self.segment.travel = Fixed::short(velocity * TICK_S);
        self.segment
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ramp(velocity: f32, acceleration: f32, deceleration: f32) -> Ramp {
        Ramp {
            velocity: CountsPerSecond(velocity),
            acceleration: CountsPerSecond2(acceleration),
            deceleration: CountsPerSecond2(deceleration),
        }
    }

    /// Plans every five ticks until the profile stands; gives the plans, the farthest point and the hardest braking.
    fn run(profile: &mut Profile, target: i64, ramp: &Ramp) -> (u32, f32, f32) {
        let (mut farthest, mut hardest) = (profile.position().to_f32(), 0.0f32);
        for plan in 1..2_000_000 {
            let before = profile.segment.velocity.0;
            let segment = profile.toward(Fixed::whole(target), ramp, PLAN_TICKS);
            hardest = hardest.max((segment.velocity.0 - before).abs() / PLAN_S);
            farthest = farthest.max(segment.from.to_f32());
            assert!(segment.velocity.0.abs() <= larger(ramp.velocity.0, before.abs()) * 1.0001);
            if profile.stands() && segment.from == Fixed::whole(target) {
                return (plan, farthest, hardest);
            }
        }
        panic!("never stands: {profile:?}");
    }

    proptest! {
        #[test]
        fn every_move_ends_on_its_target_without_overshoot_or_hard_braking(
            target in 1i64..200_000, velocity in 10.0f32..200_000.0, up in 1e4f32..1e7, down in 1e4f32..1e7,
        ) {
            // A minute at the most.
            prop_assume!((target as f32) < 60.0 * velocity);
            let mut profile = Profile::at(Fixed(0));
            let ramp = ramp(velocity, up, down);
            let (plans, farthest, hardest) = run(&mut profile, target, &ramp);
            prop_assert_eq!(profile.position(), Fixed::whole(target));
            prop_assert!(farthest <= target as f32 * 1.000001 + 0.1, "{} past {}", farthest, target);
            prop_assert!(hardest <= up.max(down) * 1.001 + 1.0);
            // No faster than the trapezoid, and not much slower.
            let (distance, peak) = (target as f32, velocity.min((2.0 * target as f32 * up * down / (up + down)).sqrt()));
            let ideal = distance / peak + peak / (2.0 * up) + peak / (2.0 * down);
            let took = plans as f32 * PLAN_S;
            prop_assert!(took > ideal * 0.98 && took < ideal * 1.05 + 40.0 * PLAN_S, "{} s, ideally {}", took, ideal);
        }
    }

    proptest! {
        #[test]
        fn a_move_changed_under_way_goes_on_from_its_velocity(
            moves in prop::collection::vec((-50_000i64..50_000, 100.0f32..50_000.0, 1e4f32..1e7, 1e4f32..1e7, 1u32..400), 1..8),
            stops in any::<u8>(),
        ) {
            let mut profile = Profile::at(Fixed(0));
            let mut last = (0, ramp(1.0, 1.0, 1.0));
            for (number, (target, velocity, up, down, plans)) in moves.into_iter().enumerate() {
                let ramp = ramp(velocity, up, down);
                last = (target, ramp);
                let begun = profile.segment;
                let (mut low, mut high) = (begun.from.to_f32(), begun.from.to_f32());
                for plan in 0..plans {
                    // What changes is planned at once, in the middle of a plan.
                    let ticks = if plan == 0 { 1 + number as u32 % PLAN_TICKS } else { PLAN_TICKS };
                    let before = profile.segment.velocity.0;
                    let segment = if stops >> number & 1 == 1 {
                        profile.stop(ramp.deceleration, ticks)
                    } else {
                        profile.toward(Fixed::whole(target), &ramp, ticks)
                    };
                    let (now, time) = (segment.velocity.0, ticks as f32 * TICK_S);
                    let allowed = if now.abs() > before.abs() { up } else { down };
                    prop_assert!((now - before).abs() <= allowed * time * 1.001 + 0.01, "{} to {}", before, now);
                    prop_assert!(now * before >= 0.0, "{} to {} without standing", before, now);
                    (low, high) = (low.min(segment.from.to_f32()), high.max(segment.from.to_f32()));
                }
                // Past start and target only by what stopping takes: v^2 / 2a, and two plans.
                let stop = begun.velocity.0 * begun.velocity.0 / (2.0 * down) + 2.0 * begun.velocity.0.abs() * PLAN_S + 1.0;
                let (from, to) = (begun.from.to_f32(), target as f32);
                prop_assert!(low >= from.min(to) - stop && high <= from.max(to) + stop, "{} to {}", low, high);
            }
            let (target, ramp) = last;
            run(&mut profile, target, &ramp);
            prop_assert_eq!(profile.position(), Fixed::whole(target));
        }
    }

    #[test]
    fn a_target_changed_behind_the_axis_turns_it_round() {
        let mut profile = Profile::at(Fixed(0));
        let ramp = ramp(10_000.0, 1e6, 1e6);
        for _ in 0..200 {
            profile.toward(Fixed::whole(10_000), &ramp, PLAN_TICKS);
        }
        let (_, farthest, hardest) = run(&mut profile, 0, &ramp);
        // 10 mm/s at 1 m/s^2 stops within 50 um.
        assert!(farthest > 400.0 && farthest < 600.0, "{farthest}");
        assert!(hardest < 1.001e6, "{hardest}");
        assert_eq!(profile.position(), Fixed(0));
    }

    #[test]
    fn set_points_are_reached_in_their_time_and_without_a_step_of_velocity() {
        let mut profile = Profile::at(Fixed(0));
        let (mut slowest, mut fastest) = (f32::INFINITY, 0.0f32);
        for cycle in 1..=100i64 {
            for plan in 0..4 {
                let left = 25 - plan * PLAN_TICKS;
                let segment = profile.reach(Fixed::whole(cycle * 10), left, CountsPerSecond(1e6), PLAN_TICKS);
                if cycle > 10 {
                    (slowest, fastest) = (slowest.min(segment.velocity.0), fastest.max(segment.velocity.0));
                }
            }
        }
        assert!(slowest > 9_990.0 && fastest < 10_010.0, "{slowest} to {fastest} counts/s for 10 counts in 1 ms");
    }

    #[test]
    fn a_set_point_out_of_reach_is_approached_at_the_limit() {
        let mut profile = Profile::at(Fixed(0));
        let segment = profile.reach(Fixed::whole(100_000), 20, CountsPerSecond(5e4), PLAN_TICKS);
        assert_eq!(segment.velocity.0, 5e4);
        let segment = profile.reach(Fixed::whole(-100_000), 20, CountsPerSecond(5e4), PLAN_TICKS);
        assert_eq!(segment.velocity.0, -5e4);
    }

    #[test]
    fn a_stop_brakes_as_asked_and_stands() {
        let mut profile = Profile::at(Fixed(0));
        let ramp = ramp(10_000.0, 1e6, 1e6);
        for _ in 0..200 {
            profile.toward(Fixed::whole(1_000_000), &ramp, PLAN_TICKS);
        }
        let plans = (0..1000).take_while(|_| profile.stop(CountsPerSecond2(1e6), PLAN_TICKS).velocity.0 > 0.0).count();
        // 10 ms of 0.25 ms each.
        assert!((39..=40).contains(&plans), "{plans}");
        assert!(profile.stands());
    }
}

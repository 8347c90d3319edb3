//! How hard a loop at rest may push toward the work before its encoder has counted: the bound that holds whatever the encoder says.
//!
//! Beside the head a lighter and smoother one is calculated, which moves under the duties given since the newest two net counts. An
//! encoder that has died, or trembles by a count, lets it go on; a sound one brings it back to the velocity that is measured. The duty
//! toward the work ends where the calculated head is so fast that it would strike the work; it is taken back until that head rests,
//! and is tried again.

use crate::servo::{Gains, Plant};
use crate::units::{CountsPerSecond, Newtons, TICK_S, TICKS_PER_MS, larger, smaller};

/// Net counts that prove a motion: one is a line that trembles.
const PROVES: u64 = 2;
/// Share of the settings' mass that a head has at the least, and of their friction that it slides on at the least.
const LIGHT: f32 = 0.75;
const SMOOTH: f32 = 0.5;
/// Share of the settings' net weight by which the true one may differ.
const UNSURE: f32 = 0.25;
/// Share of what a contact may press that a head may strike with: the rest is for the duty that goes on.
const STRIKE: f32 = 0.45;
/// Stiffness of a contact, N/m: 2 N/um (assumed, docs/process-model.md).
const STIFFNESS: f32 = 2e6;
/// Pushes taken back that no sound head withstands without a count, be it one that trembles.
const TRIES: u8 = 100;
/// Ticks by which the push that lets a film go three counts is multiplied: 2 ms for each of its.
const FILMS: f32 = 2.0 * TICKS_PER_MS as f32;

/// The head that is reckoned with, and what it may do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Counts/s that a duty of one gives it in a tick.
    gain: f32,
    /// Duty that it withstands while it slides.
    friction: f32,
    /// Velocity with which it would strike, counts/s.
    strikes: f32,
}

impl Config {
    /// For an actuator whose friction is that force, and which may press so hard: v = F / sqrt(k m) of a mass on a spring.
    pub fn of(plant: &Plant, friction: Newtons, press: Newtons) -> Config {
        Config {
            gain: TICK_S / (LIGHT * plant.accelerating(1.0)),
            friction: SMOOTH * plant.duty(friction),
            strikes: STRIKE * press.0 / libm::sqrtf(STIFFNESS * plant.mass_kg) * plant.counts_per_m,
        }
    }
}

/// The calculated head.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Restraint {
    /// Newest count that has proved a motion.
    from: i64,
    /// Velocity of the calculated head toward the work since then, counts/s.
    velocity: f32,
    /// It is too fast, and has not come to rest since.
    holds: bool,
    /// Newest count of all.
    newest: i64,
    /// Times since then that it was too fast, and sum of the duties beyond the friction of the settings, duty times ticks.
    tries: u8,
    pushed: f32,
}

impl Restraint {
    /// A head that rests at this count.
    pub fn at(count: i64) -> Restraint {
        Restraint { from: count, newest: count, ..Restraint::default() }
    }

    /// So many ticks later, at a count and a velocity that was measured, under a duty.
    pub fn look(
        &mut self,
        (config, gains): (&Config, &Gains),
        count: i64,
        velocity: CountsPerSecond,
        duty: f32,
        ticks: u32,
    ) {
        if count.abs_diff(self.from) >= PROVES {
            *self = Restraint { velocity: larger(velocity.0, 0.0), ..Restraint::at(count) };
            return;
        }
        if count != self.newest {
            (self.newest, self.tries, self.pushed) = (count, 0, 0.0);
        }
        let ticks = ticks as f32;
        self.pushed += larger(duty - gains.holding() - config.friction / SMOOTH, 0.0) * ticks;
        let resists = config.friction - unsure(gains);
        let beyond = duty - gains.against(self.velocity) - if self.holds { resists } else { larger(resists, 0.0) };
        self.velocity = larger(self.velocity + beyond * (ticks * config.gain), 0.0);
        let held = self.holds;
        self.holds = self.velocity > if held { 0.0 } else { config.strikes };
        self.tries = self.tries.saturating_add((self.holds && !held).into());
    }

    /// Largest duty toward the work, of one that would be `high`. A push is taken back to less than what holds the weight, so that even a head
    /// of which that is not quite known comes to rest.
    pub fn most(&self, config: &Config, gains: &Gains, high: f32) -> f32 {
        let less = larger(unsure(gains) - 0.5 * config.friction, 0.0);
        if self.holds { smaller(gains.holding() - less, high) } else { high }
    }

    /// Whether so many pushes have been taken back without a count that no sound head withstands them, nor a film that needs so much, duty
    /// times ms, to let it go three counts.
    pub fn is_lost(&self, film: f32) -> bool {
        self.tries >= TRIES && self.pushed > FILMS * film
    }
}

/// Duty by which the net weight may differ from that of the settings.
fn unsure(gains: &Gains) -> f32 {
    UNSURE * gains.holding().abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use crate::units::PLAN_TICKS;

    /// Duties above the one that holds, plan by plan, at counts; whether each is still let through after it.
    fn let_through(looks: &[(f32, i64)]) -> Vec<bool> {
        let head = Settings::default().build().unwrap().head;
        let (config, gains) = (&head.restraint, &head.axis.gains);
        let mut restraint = Restraint::default();
        let mut look = |(duty, count): &(f32, i64)| {
            restraint.look((config, gains), *count, CountsPerSecond(0.0), gains.holding() + duty, PLAN_TICKS);
            restraint.most(config, gains, 1.0) == 1.0
        };
        looks.iter().map(&mut look).collect()
    }

    #[test]
    fn a_push_without_counts_is_taken_back_until_even_a_light_head_rests_and_is_tried_again() {
        let pushed = let_through(&[(0.03, 0); 100]);
        let first = pushed.iter().position(|whole| !whole).unwrap();
        assert!((2..50).contains(&first), "after {first} plans");
        let looks: Vec<_> = (0..400).map(|plan| (if plan <= first { 0.03 } else { 0.0 }, 0)).collect();
        let rested = let_through(&looks)[first..].iter().position(|whole| *whole).unwrap();
        assert!(rested > first, "after {rested} more");
    }

    #[test]
    fn counts_that_tremble_prove_nothing_and_two_net_ones_do() {
        let trembling: Vec<_> = (0..100).map(|plan| (0.03, plan % 2)).collect();
        assert!(let_through(&trembling).contains(&false));
        let moving: Vec<_> = (0..100).map(|plan| (0.03, plan)).collect();
        assert!(!let_through(&moving).contains(&false));
    }

    #[test]
    fn a_push_within_its_friction_lasts() {
        let head = Settings::default().build().unwrap().head;
        assert!(
            !let_through(&[(0.99 * (head.restraint.friction - unsure(&head.axis.gains)), 0); 1000]).contains(&false)
        );
    }
}

//! How hard a loop may push toward the work before its encoder has counted: the bound that holds whatever the encoder says.
//!
//! Beside the head a lighter and smoother one is calculated, which moves under the duties given since the newest two net counts. An
//! encoder that has died, or trembles by a count, lets it go on; a sound one brings it back to the velocity that is measured. The duty
//! toward the work ends where the calculated head is so fast that it would strike the work; it is taken back until that head rests,
//! and is tried again. What the calculated head withstands in which state: docs/decisions.md, *Bound before detection*.

use crate::servo::{Gains, Plant};
use crate::units::{CountsPerSecond, Newtons, PLAN_TICKS, TICK_S, TICKS_PER_MS, larger, smaller, within};

/// Net counts that prove a motion of an encoder that does not tremble; each further turn of late asks for one more.
const PROVES: u64 = 2;
/// Turns of late beyond which an encoder trembles.
const TREMBLES: u32 = 3;
/// Turns that are remembered at the most: a sound loop that hunts over an edge for long proves its next motion all the same.
const TURNS: u32 = 20;
/// Ticks in which a turn is forgotten, 2 ms: a loop that hunts over an edge turns less often than that, a line that changes at random more often.
const TURN: u32 = 2 * TICKS_PER_MS;
/// Share of the settings' mass that a head has at the least, and of their friction that it slides on at the least.
const LIGHT: f32 = 0.75;
const SMOOTH: f32 = 0.5;
/// Times the friction of the settings that begins to move any head.
pub(super) const BEGINS: f32 = 1.3;
/// Share of the settings' net weight by which the true one may differ.
const UNSURE: f32 = 0.25;
/// Share of what a contact may press that a head may strike with: the rest is for the duty that goes on.
const STRIKE: f32 = 0.45;
/// Stiffness of a contact, N/m: 2 N/um (assumed, docs/process-model.md).
const STIFFNESS: f32 = 2e6;
/// Pushes taken back that no sound head withstands without a count, be it one that trembles.
const TRIES: u8 = 100;
/// Largest radius of a face, um, whose film a force of the loop squeezes out in milliseconds (Stefan: it goes with the fourth power).
const FACE: f32 = 10e3;
/// Ticks by which the push that lets a film go three counts, duty times ms, is multiplied: 2 ms for each ms of that push.
const FILMS: f32 = 2.0 * TICKS_PER_MS as f32;

/// The head that is reckoned with, and what it may do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Velocity that a duty of one gives the calculated head in a tick, counts/s.
    gain: f32,
    /// Duty that the calculated head withstands while it slides, 0 to 1.
    friction: f32,
    /// Velocity with which the calculated head would strike, counts/s.
    strikes: f32,
    /// The face is so small that no film holds it while it erodes.
    thin: bool,
}

impl Config {
    /// For an actuator whose friction is that force, which may press so hard, with a face of that radius, um: v = F / sqrt(k m) of a mass on a spring.
    pub fn of(plant: &Plant, friction: Newtons, press: Newtons, face: f32) -> Config {
        Config {
            thin: face <= FACE,
            gain: TICK_S / (LIGHT * plant.accelerating(1.0)),
            friction: SMOOTH * plant.duty(friction),
            strikes: STRIKE * press.0 / libm::sqrtf(STIFFNESS * plant.mass_kg) * plant.counts_per_m,
        }
    }

    /// Whether the face is so small that no film holds it while it erodes.
    pub fn is_thin(&self) -> bool {
        self.thin
    }

    /// Velocity with which the calculated head would strike, counts/s.
    pub fn strikes(&self) -> f32 {
        self.strikes
    }
}

/// What the values of a head are that its settings only come near to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Least moving mass, kg.
    pub mass: f32,
    /// Force by a volt on the winding at rest, N, from the least to the most: force constant by resistance.
    pub per_volt: [f32; 2],
    /// Greatest net weight, N, positive toward the work.
    pub net: f32,
    /// Least friction while it slides, N.
    pub sliding: f32,
}

/// Greatest force, N, with which a head that stands near its set point strikes the work once both lines of its encoder are dead. The settings are those
/// of `plant`, that friction, and what a contact may press; `truth` has the ends of the intervals of the true values. `None` where the settings are too
/// far off to bound it. A mass that is pushed on with s and strikes with v presses with s + sqrt(s^2 + k m v^2) (energy of a spring).
pub fn strike(plant: &Plant, friction: Newtons, press: Newtons, truth: &Truth) -> Option<Newtons> {
    let (Newtons(friction), Newtons(net)) = (friction, plant.net_weight());
    let [least, most] = truth.per_volt.map(|force| force * plant.resistance_ohm / plant.force_constant);
    // Force by which the head sinks under the duty that is to hold it.
    let sinks = truth.net - net * if net > 0.0 { least } else { most };
    let smooth = SMOOTH * friction - UNSURE * net.abs();
    let held = larger(UNSURE * net.abs() - 0.5 * SMOOTH * friction, 0.0);
    let bounded = truth.sliding - sinks >= larger(smooth, 0.0) * most && truth.sliding + held * least >= sinks;
    // As fast as the calculated head may be, and a plan in which that is pushed with what begins to move it.
    let pushed = (BEGINS - SMOOTH) * friction / (LIGHT * plant.mass_kg) * (PLAN_TICKS as f32 * TICK_S);
    let calculated = STRIKE * press.0 / libm::sqrtf(STIFFNESS * plant.mass_kg) + pushed;
    // A lighter mass is faster, and m v^2 is the greater the lighter it is.
    let velocity = calculated * most * LIGHT * plant.mass_kg / truth.mass;
    let pushes = larger(BEGINS * friction * most + sinks - truth.sliding, 0.0);
    let whole = pushes + libm::sqrtf(pushes * pushes + STIFFNESS * truth.mass * velocity * velocity);
    (bounded && whole.is_finite()).then_some(Newtons(whole))
}

/// The calculated head.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Restraint {
    /// Newest count that has proved a motion, and whether one has, or the axis was to rest, since it was left alone.
    from: i64,
    proved: bool,
    /// Velocity of the calculated head toward the work since then, counts/s.
    velocity: f32,
    /// The calculated head was fast enough to strike, and has not come to rest since.
    holds: bool,
    /// Newest count of all, and whether it came downward (1) or upward (-1).
    newest: i64,
    heading: i64,
    /// Turns that are not forgotten, by which more counts are asked for, and the ticks since the newest proof until which they were.
    turns: u32,
    forgot: u32,
    /// Pushes taken back since the newest count, and sum of the duties beyond the friction of the settings since then, duty times ticks.
    tries: u8,
    pushed: f32,
    /// Velocity at the newest proof, counts/s; sum of the duties since then, duty times ticks, and those ticks.
    began: f32,
    given: f32,
    since: u32,
    /// Duty that friction took on the way down between the two newest proofs.
    seen: f32,
}

/// What an axis was measured to do, and is asked to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    pub count: i64,
    pub velocity: CountsPerSecond,
    /// Velocity of the set point, counts/s, and whether that stands, led by nothing.
    pub wanted: f32,
    pub rests: bool,
    /// Duty of the ticks since the look before, and those.
    pub duty: f32,
    pub ticks: u32,
}

impl Restraint {
    /// A head that rests at this count.
    pub fn at(count: i64) -> Restraint {
        Restraint { from: count, newest: count, ..Restraint::default() }
    }

    /// Takes in what an axis did since the look before.
    #[inline(never)]
    pub fn look(&mut self, (config, gains): (&Config, &Gains), look: &Look) {
        let ticks = look.ticks as f32;
        (self.given, self.since) = (self.given + look.duty * ticks, self.since.saturating_add(look.ticks));
        let moved = look.count.wrapping_sub(self.from);
        let counts = look.count != self.newest;
        if counts {
            self.turn(look.count.wrapping_sub(self.newest).signum());
            (self.newest, self.tries, self.pushed) = (look.count, 0, 0.0);
        }
        if counts && moved.unsigned_abs() >= PROVES + u64::from(self.turns.saturating_sub(TREMBLES)) {
            let now = look.velocity.0;
            let seen = if moved > 0 { self.friction(config, gains, moved, now) } else { config.friction };
            let (heading, turns, velocity) = (self.heading, self.turns / 2, larger(now, 0.0));
            let rest = Restraint::at(look.count);
            *self = Restraint { proved: true, velocity, began: now, seen, heading, turns, ..rest };
            return;
        }
        self.proved |= look.rests;
        if !self.proved {
            return;
        }
        let push = look.duty - gains.holding();
        let smooth = config.friction - unsure(gains);
        if self.velocity == 0.0 && !self.holds && push <= smooth {
            return;
        }
        self.pushed += larger(push - config.friction / SMOOTH, 0.0) * ticks;
        // What it took of late says nothing of one that was pushed in vain, or trembles.
        let resists = if !look.rests && self.tries == 0 && self.turns <= TREMBLES {
            larger(self.seen, config.friction)
        } else {
            smooth
        };
        let resists = if self.holds { resists } else { larger(resists, 0.0) };
        let beyond = look.duty - gains.against(self.velocity) - resists;
        self.velocity = larger(self.velocity + beyond * (ticks * config.gain), 0.0);
        let held = self.holds;
        self.holds = self.velocity > if held { 0.0 } else { config.strikes + larger(look.wanted, 0.0) };
        self.tries = self.tries.saturating_add((self.holds && !held).into());
    }

    /// Takes in that the newest count came downward (1) or upward (-1).
    fn turn(&mut self, heading: i64) {
        let forgotten = self.since.saturating_sub(self.forgot) / TURN;
        self.forgot = self.forgot.saturating_add(forgotten.saturating_mul(TURN));
        let turns = self.turns.saturating_sub(forgotten) + u32::from(heading * self.heading < 0);
        self.turns = turns.min(TURNS);
        self.heading = heading;
    }

    /// Duty that friction took on the way down since the newest proof: the mean duty, less what held the weight, the back-EMF and what made the
    /// axis faster. No less than a smooth head has, and no more than begins to move one.
    fn friction(&self, config: &Config, gains: &Gains, moved: i64, now: f32) -> f32 {
        let per_tick = 1.0 / self.since.max(1) as f32;
        let mean = moved as f32 * (per_tick / TICK_S);
        let faster = (now - self.began) * per_tick / (LIGHT * config.gain);
        within(self.given * per_tick - gains.against(mean) - faster, config.friction, BEGINS * config.friction / SMOOTH)
    }

    /// Largest duty toward the work, of one that would be `high`. A push is taken back to less than what holds the weight, so that even a head
    /// of which that is not quite known comes to rest.
    pub fn most(&self, config: &Config, gains: &Gains, high: f32) -> f32 {
        if !self.holds {
            return high;
        }
        let less = larger(unsure(gains) - 0.5 * config.friction, 0.0);
        smaller(gains.holding() - less, high)
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

    /// Duties above the one that holds, plan by plan, at counts; whether each is still let through after it.
    fn let_through(looks: &[(f32, i64)]) -> Vec<bool> {
        let head = Settings::default().build().unwrap().head;
        let (config, gains) = (&head.restraint, &head.axis.gains);
        let mut restraint = Restraint::default();
        let mut look = |(duty, count): &(f32, i64)| {
            let duty = gains.holding() + duty;
            let velocity = CountsPerSecond(0.0);
            restraint.look(
                (config, gains),
                &Look { count: *count, velocity, wanted: 0.0, rests: true, duty, ticks: PLAN_TICKS },
            );
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

    /// Strike of a head of 0.2 kg with a tenth of a newton of net weight and so much friction, whose settings are off by that share: mass, net weight
    /// and friction; resistance and force constant by 0.6 of it each.
    fn strikes(friction: f32, share: f32) -> Option<f32> {
        let plant = Settings::default().build().unwrap().head.axis.plant;
        let plant = Plant { counterbalance: Newtons(plant.weight().0 - 0.1), ..plant };
        let (per_volt, off) = (plant.force_constant / plant.resistance_ohm, 0.6 * share);
        let truth = Truth {
            mass: plant.mass_kg * (1.0 - share),
            per_volt: [per_volt * (1.0 - off) / (1.0 + off), per_volt * (1.0 + off) / (1.0 - off)],
            net: 0.1 * (1.0 + share),
            sliding: 0.67 * friction * (1.0 - share),
        };
        strike(&plant, Newtons(friction), Newtons(5.0), &truth).map(|force| force.0)
    }

    #[test]
    fn no_head_whose_settings_were_measured_strikes_harder_than_its_contact_may_press() {
        for friction in [0.15, 0.36, 0.8] {
            let mut before = 0.0;
            for share in [0.0, 0.05, 0.1] {
                let force = strikes(friction, share).unwrap_or(f32::INFINITY);
                assert!(before < force && force < 5.0, "{friction} N, {share}: {force} N after {before} N");
                before = force;
            }
        }
        // Settings that nobody has measured bound no head for certain; how seldom one strikes is drawn (host/sim/tests/drawn_heads.rs).
        assert_eq!(strikes(0.36, 0.25), None);
    }
}

//! The proof of an encoder: a small move under open-loop limited force, before any loop is closed over it.
//!
//! After a lost encoder, a wrong polarity or a following error the fault may be reset, but nobody knows yet whether the
//! encoder counts, nor which way. So the next [`Command::Enable`](super::Command::Enable), or commissioning, begins with
//!
//! 1. a push *upward* that grows from nothing to half of `lift.limited_n`. It ends as soon as the head has risen by
//!    [`DISTANCE_UM`], two whole periods of the encoder at least (one dead line of A and B counts back and forth, but never
//!    through a whole period);
//! 2. when the push has ended without that: the same push *downward*. It comes only to a head that has just been pushed upward
//!    in vain, or whose upper limit switch is open: one that rests at its upper stop, and has to leave it to show anything.
//!    Without the switch it comes [`DESCENTS`] times at the most;
//! 3. a rest of [`COMPARED`] in which the two counters are compared.
//!
//! Counts against the push by two periods are a wrong polarity at once, and the head coasts: a lift would push the wrong way,
//! too. No counts either way are a lost encoder again.
//!
//! How long a push grows: it has to move the mass m by the distance D with what friction leaves of the force F, at least half
//! of it. A force that grows from zero to F in a time T, of which the second half moves the head, moves it by F T^2 / (48 m),
//! so T = sqrt(48 m D / F), and half as long again is allowed. A head with a dead encoder and no friction at all then moves
//! by F T^2 / (6 m) = 18 D, 0.36 mm: upward first, and back by as much.

use super::config::Config;
use super::fault::Fault;
use crate::units::{Newtons, TICK_S, larger};

/// Move that proves an encoder, um; two periods (eight counts) where those are longer.
const DISTANCE_UM: f32 = 20.0;
/// Two periods of the encoder, counts.
const TWO_PERIODS: i64 = 8;
/// Downward pushes without an upper limit switch that shows where the head is, until one encoder has proved itself: a head
/// that nothing lifts in between would creep toward the work, by half a millimetre each time.
const DESCENTS: u32 = 3;
/// Ticks for which the counters are compared afterwards: four looks, one more than a lasting difference takes to show.
const COMPARED: u32 = (5e-3 / TICK_S) as u32;

/// What comes after the proof.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Goal {
    /// The loop is closed.
    Ready,
    /// Commissioning.
    Commissioning,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Up,
    Down,
    Compare,
}

/// What the proof wants, or its result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Outcome {
    /// This duty.
    Push(f32),
    /// The head held where it is.
    Hold,
    /// The encoder counts, and the right way.
    Proved(Goal),
    /// It does not.
    Failed(Fault),
}

/// A proof under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Proof {
    goal: Goal,
    step: Step,
    ticks: u32,
    start: i64,
    /// It may be pushed downward.
    descends: bool,
    /// Counts that prove.
    distance: i64,
    /// Greatest force, as a duty, and the ticks in which it is reached.
    force: f32,
    growth: u32,
}

impl Proof {
    /// Begins where the head is; `descents` says how often it was pushed downward in vain.
    pub fn new(config: &Config, position: i64, goal: Goal, descents: u32) -> Proof {
        let axis = &config.axis;
        let distance = ((DISTANCE_UM * axis.counts_per_um) as i64).max(TWO_PERIODS);
        let force = 0.5 * config.lift.limited;
        let newtons = force / axis.plant.duty(Newtons(1.0));
        let metres = distance as f32 / axis.plant.counts_per_m;
        let growth = 1.5 * libm::sqrtf(48.0 * axis.plant.mass_kg * metres / newtons);
        Proof {
            goal,
            step: Step::Up,
            ticks: 0,
            start: position,
            descends: descents < DESCENTS,
            distance,
            force,
            growth: (growth / TICK_S) as u32,
        }
    }

    /// Goes on, `ticks` after the plan before.
    pub fn plan(&mut self, config: &Config, position: i64, upper_limit: bool, ticks: u32) -> Outcome {
        self.ticks = self.ticks.saturating_add(ticks);
        let moved = position.saturating_sub(self.start);
        let holding = config.axis.gains.holding();
        let push = self.force * self.ticks as f32 / larger(self.growth as f32, 1.0);
        let over = self.ticks > self.growth;
        match self.step {
            Step::Up if moved >= TWO_PERIODS => Outcome::Failed(Fault::PolarityWrong),
            Step::Up if moved <= -self.distance => self.compare(),
            Step::Down if moved >= self.distance => self.compare(),
            Step::Up if upper_limit || over && self.descends => {
                self.step = Step::Down;
                self.ticks = 0;
                self.start = position;
                Outcome::Push(holding)
            }
            Step::Up | Step::Down if over => Outcome::Failed(Fault::EncoderLost),
            Step::Up => Outcome::Push(holding - push),
            Step::Down => Outcome::Push(holding + push),
            Step::Compare if self.ticks <= COMPARED => Outcome::Hold,
            Step::Compare => Outcome::Proved(self.goal),
        }
    }

    /// The head is being pushed downward.
    pub fn is_descending(&self) -> bool {
        self.step == Step::Down
    }

    fn compare(&mut self) -> Outcome {
        self.step = Step::Compare;
        self.ticks = 0;
        Outcome::Hold
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    /// Pushes a mass upward against dry friction, a share of the push's greatest force: where it got to, um, and the outcome.
    fn pushed(settings: &Settings, friction: f32, counts: bool) -> (f32, Outcome) {
        let config = settings.build().unwrap().head;
        let (plant, holding) = (&config.axis.plant, config.axis.gains.holding());
        let per_duty = 1.0 / plant.duty(Newtons(1.0));
        let friction = 0.5 * config.lift.limited * per_duty * friction;
        let mut proof = Proof::new(&config, 0, Goal::Ready, 0);
        let (mut x, mut v) = (0.0f32, 0.0f32);
        loop {
            let count = if counts { (x * plant.counts_per_m).floor() as i64 } else { 0 };
            match proof.plan(&config, count, false, 1) {
                Outcome::Push(duty) if proof.step == Step::Up => {
                    let force = (duty - holding) * per_duty;
                    let free = v + force / plant.mass_kg * TICK_S;
                    v = (free.abs() - friction / plant.mass_kg * TICK_S).max(0.0).copysign(free);
                    x += v * TICK_S;
                }
                outcome => return (x * 1e6, outcome),
            }
        }
    }

    fn heads() -> impl Iterator<Item = Settings> {
        [(0.1, 2.0, 1.0), (0.2, 3.0, 1.0), (0.2, 3.0, 0.1), (0.2, 3.0, 5.0), (1.0, 12.0, 1.0)].into_iter().map(
            |(mass, limited, count)| Settings {
                axis_mass: mass,
                axis_counterbalance: mass * 9.8,
                lift_force: limited,
                encoder_count: count,
                ..Settings::default()
            },
        )
    }

    #[test]
    fn a_push_moves_a_head_whose_friction_is_half_of_it() {
        for settings in heads() {
            let (um, outcome) = pushed(&settings, 0.5, true);
            assert_eq!(outcome, Outcome::Hold, "{um} um of {} kg", settings.axis_mass);
        }
    }

    #[test]
    fn a_push_that_no_encoder_ends_moves_a_head_without_friction_by_less_than_twenty_times_the_distance() {
        for settings in heads() {
            let (um, outcome) = pushed(&settings, 0.0, false);
            let distance = DISTANCE_UM.max(TWO_PERIODS as f32 * settings.encoder_count);
            assert!(matches!(outcome, Outcome::Push(_)) && (-20.0 * distance..0.0).contains(&um), "{um} um");
        }
    }

    #[test]
    fn one_line_of_the_encoder_alone_proves_nothing() {
        let config = Settings::default().build().unwrap().head;
        let mut proof = Proof::new(&config, 0, Goal::Ready, 0);
        let outcome =
            (0..).map(|tick| proof.plan(&config, -(tick & 1), false, 1)).find(|o| !matches!(o, Outcome::Push(_)));
        assert_eq!(outcome, Some(Outcome::Failed(Fault::EncoderLost)));
    }
}

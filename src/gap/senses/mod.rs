//! What the pulses of late say of the gap, once a millisecond: hazard of ignition, gap by charging time, spark frequency.
//!
//! All of it comes of the [`Counts`] that a [`GapReading`](super::GapReading) carries, so no servo tick pays for it. What is older
//! counts less: every millisecond, what is remembered is multiplied by 1 - 1/memory, where `memory` is `gap.memory_ms`. After
//! long, that is the same as 2 memory - 1 milliseconds that count alike.
//!
//! Each estimator is a file: `hazard` is [`Likelihood`], `distance` and `frequency` are here.

pub mod delays;
mod distance;
mod frequency;

pub use distance::Distance;
pub use frequency::SparkFrequency;

use super::charging::{Charged, Material};
use super::likelihood::{Hazard, Likelihood};
use super::pulses::Counts;
use crate::dsp::{OutOfRange, in_range};

/// What the estimators run on.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Milliseconds remembered, 1..=10 000.
    pub memory: f32,
    /// Gap by charging time.
    pub material: Material,
}

impl Config {
    /// Memory in milliseconds, 1..=10 000, and the polynomial of the work's material.
    ///
    /// # Errors
    /// The memory is out of range.
    pub fn new(memory: f32, material: Material) -> Result<Config, OutOfRange> {
        Ok(Config { memory: in_range("memory of the gap senses (ms)", memory, 1.0, 10_000.0)?, material })
    }
}

/// What is known of the gap beside its voltage.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Senses {
    /// Milliseconds with pulses so far, wrapping: a reader sees by it that there is something new.
    pub updates: u32,
    /// Milliseconds since the newest pulse; as many as can be counted where there was none.
    pub age: u16,
    /// Hazard of ignition; `None` where no pulse of late was seen to wait.
    pub hazard: Option<Hazard>,
    /// Gap by charging time; `None` where no pulse of late was seen to charge.
    pub distance: Option<Charged>,
    /// Sparks a second; `None` without pulses.
    pub frequency: Option<f32>,
    /// No spark for longer than 13 of their mean periods.
    pub missing: bool,
}

impl Senses {
    /// Nothing seen yet.
    pub const NONE: Senses =
        Senses { updates: 0, age: u16::MAX, hazard: None, distance: None, frequency: None, missing: false };
}

impl Default for Senses {
    fn default() -> Senses {
        Senses::NONE
    }
}

/// The estimators.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sensing {
    last: Counts,
    hazard: Likelihood,
    distance: Distance,
    frequency: SparkFrequency,
    senses: Senses,
}

impl Sensing {
    /// Takes the pulses of a millisecond. Without permission to pulse nothing is remembered.
    pub fn look(&mut self, config: &Config, counts: &Counts, permitted: bool) -> &Senses {
        let new = counts.since(&self.last);
        self.last = *counts;
        let updates = self.senses.updates;
        if !permitted {
            *self = Sensing { last: self.last, senses: Senses { updates, ..Senses::NONE }, ..Sensing::default() };
            return &self.senses;
        }
        let keep = 1.0 - 1.0 / config.memory;
        let pulses = new.total();
        self.hazard.step(keep, new.waited, new.ignited);
        self.distance.millisecond(keep, &new);
        self.frequency.millisecond(keep, &new);
        self.senses = Senses {
            updates: updates.wrapping_add(u32::from(pulses > 0)),
            age: if pulses > 0 { 0 } else { self.senses.age.saturating_add(1) },
            hazard: self.hazard.hazard().or_else(|| self.hazard.rare()),
            distance: self.distance.gap(&config.material),
            frequency: self.frequency.rate(),
            missing: self.frequency.is_missing(),
        };
        &self.senses
    }

    /// What was found last.
    pub fn senses(&self) -> &Senses {
        &self.senses
    }
}

#[cfg(test)]
mod tests {
    use super::super::pulses::Class;
    use super::*;
    use crate::units::CLOCK_HZ;
    use proptest::prelude::*;

    const US: u32 = CLOCK_HZ / 1_000_000;

    fn config() -> Config {
        Config::new(10.0, Material::SILICON).unwrap()
    }

    /// So many milliseconds of 5 pulses that charge for 1 us and wait for 100 us, of which some ignite.
    fn run(sensing: &mut Sensing, counts: &mut Counts, ms: u32, ignited: u32) -> Senses {
        for _ in 0..ms {
            counts.classes[Class::Spark as usize] += ignited;
            counts.classes[Class::Open as usize] += 5 - ignited;
            counts.charged += 5;
            counts.charging += 5 * US;
            counts.waited += 500 * US;
            counts.ignited += ignited;
            sensing.look(&config(), counts, true);
        }
        *sensing.senses()
    }

    #[test]
    fn hazard_distance_and_frequency_are_those_of_the_pulses() {
        let (mut sensing, mut counts) = (Sensing::default(), Counts::default());
        let senses = run(&mut sensing, &mut counts, 200, 4);
        let hazard = senses.hazard.unwrap();
        // 4 ignitions in 500 us of waiting; 19 ms that count alike have 76 of them.
        assert!((hazard.rate - 8000.0).abs() < 1.0 && (hazard.variance * 76.0 - 1.0).abs() < 0.01, "{hazard:?}");
        assert!((senses.frequency.unwrap() - 4000.0).abs() < 1.0 && !senses.missing, "{senses:?}");
        // 1 us to 70 % is a time constant of 0.8306 us.
        let (found, right) = (senses.distance.unwrap(), Material::SILICON.gap(1.0 / 1.203_973));
        assert!((found.gap.0 - right.gap.0).abs() < 1e-3 && found.inside, "{found:?}, {right:?}");
        assert_eq!((senses.updates, senses.age), (200, 0));
    }

    #[test]
    fn a_gap_that_ignites_no_more_has_a_hazard_that_falls_with_every_pulse_that_waits() {
        let (mut sensing, mut counts) = (Sensing::default(), Counts::default());
        run(&mut sensing, &mut counts, 100, 4);
        let rates: Vec<f32> =
            (0..10).map(|_| run(&mut sensing, &mut counts, 20, 0).hazard.map_or(0.0, |hazard| hazard.rate)).collect();
        assert!(rates.windows(2).all(|pair| pair[1] <= pair[0]), "{rates:?}");
        assert!(rates[9] > 0.0 && rates[9] < 120.0, "{rates:?}");
        let senses = sensing.senses();
        assert!(senses.missing && senses.frequency.unwrap() < 6.0, "{senses:?}");
    }

    #[test]
    fn pulses_that_stay_away_show_as_an_age_and_nothing_is_known_of_the_gap_in_the_end() {
        let (mut sensing, mut counts) = (Sensing::default(), Counts::default());
        run(&mut sensing, &mut counts, 100, 4);
        for _ in 0..200 {
            sensing.look(&config(), &counts, true);
        }
        let senses = sensing.senses();
        assert_eq!((senses.age, senses.hazard, senses.distance, senses.frequency), (200, None, None, None));
    }

    #[test]
    fn without_permission_to_pulse_nothing_is_remembered() {
        let (mut sensing, mut counts) = (Sensing::default(), Counts::default());
        run(&mut sensing, &mut counts, 100, 4);
        let senses = *sensing.look(&config(), &counts, false);
        assert_eq!(senses, Senses { updates: 100, ..Senses::NONE });
        assert_eq!(run(&mut sensing, &mut counts, 1, 4).hazard.map(|hazard| hazard.rate.round()), Some(8000.0));
    }

    #[test]
    fn the_memory_has_a_range() {
        for memory in [0.9, 10_001.0, f32::NAN] {
            assert!(Config::new(memory, Material::SILICON).is_err(), "{memory}");
        }
    }

    proptest! {
        #[test]
        fn no_counts_make_it_fail(each: Vec<([u32; 6], u32, u32, u32, u32, bool)>, memory in 1.0f32..10_000.0) {
            let config = Config::new(memory, Material::SILICON).unwrap();
            let mut sensing = Sensing::default();
            for (classes, charged, charging, waited, ignited, permitted) in each {
                let counts = Counts { classes, charged, charging, waited, ignited, ..Counts::default() };
                let senses = sensing.look(&config, &counts, permitted);
                prop_assert!(senses.hazard.is_none_or(|hazard| hazard.rate.is_finite() && hazard.variance.is_finite()));
                prop_assert!(senses.distance.is_none_or(|charged| charged.gap.0.is_finite()));
                prop_assert!(senses.frequency.is_none_or(|rate| rate.is_finite() && rate >= 0.0));
            }
        }
    }
}

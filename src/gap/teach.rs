//! Levels of pulses, learnt from what burned.
//!
//! While the head erodes, what a pulse has burned at is counted in a histogram of 1 V ([`Burns`]): the mean of its conversions, which
//! has less noise than one of them. The noise of one is that of the differences of two neighbours, d:
//! s = sqrt(sum d^2 / 2 n), whatever they burn at. Shorts lie below a
//! sixteenth of the open-circuit voltage. What lies above is split in two by the threshold of least error (Kittler and Illingworth,
//! Pattern Recognition 19, 1986, 41), which takes both sides for normal and finds a rare one too:
//!
//! ```text
//! J = P1 ln(s1 / P1) + P2 ln(s2 / P2) is least         P: shares, s: standard deviations of the sides
//! ```
//!
//! The sides are arcs and sparks where each has at least 0.5 % of the pulses and their means are at least [`APART`] standard
//! deviations apart. Otherwise one level burned, which is taken for
//! sparks; then arcs are assumed to burn at 0.7 of that, as in \[R\] section 4.4 with the arcs of the process model.
//!
//! Nothing here decides for the head: the result is proposed as settings `gap.open_v`, `gap.spark_v`, `gap.arc_below_v`,
//! `gap.short_v` and `gap.noise_v`.

use crate::units::Volts;

/// Volts that are told apart, from 0 up; what is higher counts as the highest.
pub const BURNS: usize = 64;
/// Pulses that burned, by voltage: 1 V each.
pub type Burns = [u32; BURNS];
/// Fewest burning pulses from which levels are learnt: 0.5 % of them are 50, whose mean is known to a seventh of the spread.
pub const LEAST: u32 = 10_000;
/// Standard deviations between two levels from which they are two: half-way between them lies an error of 2.3 % either way.
pub const APART: f32 = 4.0;
/// Share of the pulses that a level has at least.
const RARE: f32 = 0.005;
/// Arc over spark where no arcs were seen.
const ASSUMED: f32 = 0.7;

/// Levels, and how well they separate.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Taught {
    /// Open-circuit voltage.
    pub open: Volts,
    /// What a spark burns at.
    pub spark: Volts,
    /// Boundary of arcs.
    pub arc_below: Volts,
    /// Boundary of shorts.
    pub short_below: Volts,
    /// Standard deviation of a conversion, or that of the pulses of one level from each other, where they differ more.
    pub noise: Volts,
    /// Distance of arcs and sparks, standard deviations of what the pulses burned at; `None`: no arcs were seen, their level is assumed.
    pub apart: Option<f32>,
}

/// What a pulse has shown.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Shown {
    /// It did not ignite, and was so high at its end.
    Open(Volts),
    /// It burned at this mean; and the difference of two of its conversions.
    Burned(Volts, Option<Volts>),
}

impl Shown {
    /// The volt of [`Burns`] that a voltage is counted in.
    pub fn bin(volts: Volts) -> usize {
        (volts.0.max(0.0) as usize).min(BURNS - 1)
    }
}

/// Sum of so many values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sum {
    /// How many.
    pub count: u32,
    /// Their sum.
    pub sum: f32,
}

impl Sum {
    /// Values that are added: with more of them the sum has no more bits for the next.
    pub const MOST: u32 = 1 << 16;
    /// Fewest values whose mean counts.
    const LEAST: u32 = 100;

    fn mean(&self) -> Option<f32> {
        (self.count >= Self::LEAST).then(|| self.sum / self.count as f32)
    }
}

/// What many pulses have shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Gathered {
    /// What they burned at.
    pub burns: Burns,
    /// Open-circuit voltages, V.
    pub open: Sum,
    /// Squares of the differences of two conversions, V^2.
    pub steps: Sum,
}

impl Gathered {
    /// Learns the levels. Not for a tick: some 10 000 cycles (estimated).
    ///
    /// # Errors
    /// See [`TeachError`].
    pub fn levels(&self) -> Result<Taught, TeachError> {
        let open = self.open.mean().ok_or(TeachError::NoOpenCircuit)?;
        let noise = self.steps.mean().map_or(0.0, |square| libm::sqrtf(0.5 * square));
        levels(&self.burns, Volts(open), Volts(noise))
    }
}

/// Why levels cannot be learnt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TeachError {
    /// Fewer pulses than [`LEAST`] burned above the voltage of a short.
    TooFew,
    /// No open-circuit voltage is known, or sparks burn at more than 0.8 of it.
    NoOpenCircuit,
}

/// One level: how many, their mean and the sum of their squares about it.
#[derive(Clone, Copy, Debug, Default)]
struct Level {
    count: f32,
    sum: f32,
    squares: f32,
}

impl Level {
    /// With the pulses of one volt more, the middle of which they are taken for.
    fn with(&self, at: usize, count: u32) -> Level {
        let (volts, count) = (at as f32 + 0.5, count as f32);
        Level {
            count: self.count + count,
            sum: self.sum + count * volts,
            squares: self.squares + count * volts * volts,
        }
    }

    /// Without those of another.
    fn less(&self, other: &Level) -> Level {
        Level { count: self.count - other.count, sum: self.sum - other.sum, squares: self.squares - other.squares }
    }

    fn mean(&self) -> f32 {
        if self.count > 0.0 { self.sum / self.count } else { 0.0 }
    }

    /// Sum of squares about the mean.
    fn spread(&self) -> f32 {
        (self.squares - self.sum * self.mean()).max(0.0)
    }

    /// Standard deviation. One that is counted in whole volts has an error of its own.
    fn deviation(&self) -> f32 {
        let variance = if self.count > 0.0 { self.spread() / self.count } else { 0.0 };
        libm::sqrtf(variance.max(1.0 / 12.0))
    }
}

/// Learns the levels from what has burned at an open-circuit voltage, with so much noise of a conversion. Not for a tick.
///
/// # Errors
/// See [`TeachError`].
pub fn levels(burns: &Burns, open: Volts, noise: Volts) -> Result<Taught, TeachError> {
    if open.0.is_nan() || open.0 <= 0.0 {
        return Err(TeachError::NoOpenCircuit);
    }
    // A short shows what falls over cable and contact: less than this.
    let shorts = ((open.0 / 16.0) as usize + 1).min(BURNS);
    let burning = || burns.iter().enumerate().skip(shorts);
    let all = burning().fold(Level::default(), |level, (at, count)| level.with(at, *count));
    if all.count < LEAST as f32 {
        return Err(TeachError::TooFew);
    }
    let enough = |level: &Level| level.count >= RARE * all.count;
    let error = |level: &Level| {
        let share = level.count / all.count;
        share * libm::logf(level.deviation() / share)
    };
    let (mut arcs, mut split) = (Level::default(), None::<(Level, f32)>);
    for (at, count) in burning() {
        arcs = arcs.with(at, *count);
        let sparks = all.less(&arcs);
        if *count > 0 && enough(&arcs) && enough(&sparks) {
            let now = error(&arcs) + error(&sparks);
            if split.as_ref().is_none_or(|(_, least)| now < *least) {
                split = Some((arcs, now));
            }
        }
    }
    let arcs = split.map_or(Level::default(), |(arcs, _)| arcs);
    let sparks = all.less(&arcs);
    let both = Level { squares: arcs.spread() + sparks.spread(), count: all.count, sum: 0.0 };
    let apart = (sparks.mean() - arcs.mean()) / both.deviation();
    let two = arcs.count > 0.0 && apart >= APART;
    let (spark, arc, apart_by) = if two {
        (sparks.mean(), arcs.mean(), both.deviation())
    } else {
        (all.mean(), ASSUMED * all.mean(), all.deviation())
    };
    if spark > 0.8 * open.0 {
        return Err(TeachError::NoOpenCircuit);
    }
    Ok(Taught {
        open,
        spark: Volts(spark),
        arc_below: Volts(0.5 * (spark + arc)),
        short_below: Volts(0.5 * arc),
        noise: Volts(noise.0.max(apart_by)),
        apart: two.then_some(apart),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pulses that burn at a level with noise of a standard deviation, by the quantiles of a normal distribution.
    fn add(burns: &mut Burns, pulses: u32, volts: f32, noise: f32) {
        let mut left = 0.0;
        for (at, count) in burns.iter_mut().enumerate() {
            let below = |edge: f32| 0.5 * (1.0 + libm::erff((edge - volts) / (noise * 2f32.sqrt())));
            left += pulses as f32 * (below(at as f32 + 1.0) - below(at as f32));
            let whole = left as u32;
            left -= whole as f32;
            *count += whole;
        }
    }

    #[test]
    fn levels_of_three_generators_are_found_within_half_a_volt() {
        for (open, spark, arc) in [(100.0, 40.0, 28.0), (80.0, 25.0, 18.0), (65.0, 22.0, 15.0)] {
            for (arcs, shorts, most) in [(400, 100, 1.0), (5_000, 3_000, 1.5), (30_000, 0, 1.5)] {
                // Of rare arcs more noise lets nothing be seen.
                for noise in [0.5, 1.0, most] {
                    let mut burns = [0; BURNS];
                    add(&mut burns, 40_000, spark, noise);
                    add(&mut burns, arcs, arc, noise);
                    add(&mut burns, shorts, 1.5, noise.min(0.5));
                    let taught = levels(&burns, Volts(open), Volts(0.0)).unwrap();
                    let near = |found: Volts, is: f32| (found.0 - is).abs() < 0.5;
                    assert!(near(taught.spark, spark) && near(taught.arc_below, 0.5 * (spark + arc)), "{taught:?}");
                    assert!(taught.short_below.0 > 5.0 && taught.short_below.0 < arc - 2.0, "{taught:?}");
                    assert!((taught.noise.0 - noise).abs() < 0.2, "{noise}: {taught:?}");
                    assert!(taught.apart.is_some_and(|apart| apart >= APART), "{taught:?}");
                }
            }
        }
    }

    #[test]
    fn without_arcs_their_level_is_assumed_and_said_so() {
        let mut burns = [0; BURNS];
        add(&mut burns, 40_000, 25.0, 1.0);
        let taught = levels(&burns, Volts(80.0), Volts(3.0)).unwrap();
        assert_eq!(taught.noise, Volts(3.0));
        assert_eq!(taught.apart, None);
        assert!((taught.spark.0 - 25.0).abs() < 0.2 && (taught.arc_below.0 - 21.25).abs() < 0.3, "{taught:?}");
    }

    #[test]
    fn levels_that_noise_covers_are_not_taken_for_two() {
        let mut burns = [0; BURNS];
        add(&mut burns, 40_000, 25.0, 3.0);
        add(&mut burns, 20_000, 18.0, 3.0);
        assert_eq!(levels(&burns, Volts(80.0), Volts(0.0)).unwrap().apart, None);
    }

    #[test]
    fn too_few_pulses_and_no_open_circuit_are_named() {
        let mut burns = [0; BURNS];
        assert_eq!(levels(&burns, Volts(100.0), Volts(1.0)), Err(TeachError::TooFew));
        add(&mut burns, LEAST / 2, 40.0, 1.0);
        assert_eq!(levels(&burns, Volts(100.0), Volts(1.0)), Err(TeachError::TooFew));
        add(&mut burns, LEAST, 40.0, 1.0);
        for open in [0.0, f32::NAN, 45.0] {
            assert_eq!(levels(&burns, Volts(open), Volts(1.0)), Err(TeachError::NoOpenCircuit), "{open}");
        }
        assert!(levels(&[u32::MAX; BURNS], Volts(100.0), Volts(1.0)).is_ok());
    }
}

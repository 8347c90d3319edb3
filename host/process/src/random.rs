//! Randomness from one seed, a stream for every cause: what one cause draws leaves the others as they were.

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

/// What draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Whether a pulse ignites, and when. Every pulse that waits draws one, so that the fate of one does not shift that of others.
    Ignition = 1,
    /// Where.
    Place,
    /// Arcs.
    Arc,
    /// Bridges across the gap: when they form, how long they last, where they tear.
    Bridge,
    /// Scatter of the burn voltage.
    Burn,
    /// Peaks that a crater leaves.
    Peak,
    /// The slow disturbance of ignition.
    Slow,
    /// Sparks without a delay, and arcs with one.
    Prompt,
    /// Of the harness: what its ideal instruments are off by.
    Instrument,
}

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Stream(Xoshiro256PlusPlus);

impl Stream {
    /// That of a cause in the run of a seed.
    pub fn new(cause: Cause, seed: u64) -> Stream {
        Stream(Xoshiro256PlusPlus::seed_from_u64(seed.wrapping_mul(16).wrapping_add(cause as u64)))
    }

    /// Evenly in 0 to 1, without either.
    #[inline]
    pub fn unit(&mut self) -> f64 {
        ((self.0.next_u64() >> 11) as f64 + 0.5) * (1.0 / (1u64 << 53) as f64)
    }

    /// Exponential of mean 1.
    #[inline]
    pub fn exponential(&mut self) -> f64 {
        -libm::log(self.unit())
    }

    /// Of mean 0 and deviation 1, as the ones of 64 bits: steps of a quarter, normal to the eye and as a sum of a few.
    #[inline]
    pub fn step(&mut self) -> f64 {
        (f64::from(self.0.next_u64().count_ones()) - 32.0) * 0.25
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_by_cause_and_by_seed_and_repeat() {
        let first = |cause: Cause, seed| Stream::new(cause, seed).unit();
        let all = [
            first(Cause::Ignition, 1),
            first(Cause::Arc, 1),
            first(Cause::Slow, 1),
            first(Cause::Ignition, 2),
            first(Cause::Slow, 0),
        ];
        for (i, a) in all.iter().enumerate() {
            assert!(all.iter().skip(i + 1).all(|b| b != a));
        }
        assert_eq!(first(Cause::Burn, 7), first(Cause::Burn, 7));
    }

    #[test]
    fn the_distributions_have_their_moments() {
        let mut stream = Stream::new(Cause::Slow, 1);
        let n = 100_000;
        let moments = |draw: &mut dyn FnMut() -> f64| {
            let all: Vec<f64> = (0..n).map(|_| draw()).collect();
            let mean = all.iter().sum::<f64>() / f64::from(n);
            (mean, all.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / f64::from(n))
        };
        let (mean, variance) = moments(&mut || stream.unit());
        assert!((mean - 0.5).abs() < 0.004 && (variance - 1.0 / 12.0).abs() < 0.002, "{mean} {variance}");
        let (mean, variance) = moments(&mut || stream.exponential());
        assert!((mean - 1.0).abs() < 0.015 && (variance - 1.0).abs() < 0.04, "{mean} {variance}");
        let (mean, variance) = moments(&mut || stream.step());
        assert!(mean.abs() < 0.015 && (variance - 1.0).abs() < 0.02, "{mean} {variance}");
    }
}

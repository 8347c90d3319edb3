//! Randomness from one seed, a stream for every cause: what one cause draws leaves the others as they were.

use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

/// A stream.
pub type Random = Xoshiro256PlusPlus;

/// What draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Noise of the converter and phase of the mains.
    FrontEnd = 5,
    /// Encoder edges that get lost.
    Encoder,
    /// Noise of the converter that looks into each pulse.
    Gated,
    /// Numbers of the model that are not known.
    Perturbation,
    /// Noise of the converter of the motor current.
    MotorCurrent,
    /// What discharges couple into other lines.
    Coupling,
}

impl Cause {
    /// The stream of this cause in the run of a seed.
    pub fn stream(self, seed: u64) -> Random {
        Random::seed_from_u64(seed.wrapping_mul(16).wrapping_add(self as u64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;

    #[test]
    fn streams_differ_by_cause_and_by_seed_and_repeat() {
        let first = |cause: Cause, seed| cause.stream(seed).next_u64();
        let all = [
            first(Cause::FrontEnd, 1),
            first(Cause::Gated, 1),
            first(Cause::Encoder, 1),
            first(Cause::FrontEnd, 2),
            first(Cause::Encoder, 0),
        ];
        for (i, a) in all.iter().enumerate() {
            assert!(all.iter().skip(i + 1).all(|b| b != a));
        }
        assert_eq!(first(Cause::Gated, 7), first(Cause::Gated, 7));
    }
}

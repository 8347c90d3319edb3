//! Rate by error: a standard velocity at a standard error, in proportion, clamped (\[R\] section 6.7.2).

use super::{Answer, FeedLaw, View};
use crate::units::{MicrometresPerSecond, Volts, within};

/// Velocity in proportion to the gap error, up to a multiple of the standard one.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RateByError {
    /// um/s per volt: the standard velocity divided by the standard error.
    per_volt: f32,
    clamp: MicrometresPerSecond,
}

impl RateByError {
    /// Law with `standard` velocity at an error of `at` (more than zero), clamped to `clamp` either way.
    pub fn new(standard: MicrometresPerSecond, at: Volts, clamp: MicrometresPerSecond) -> Self {
        RateByError { per_volt: standard.0 / at.0, clamp }
    }
}

impl FeedLaw for RateByError {
    type State = ();
    const BY_ERROR: bool = true;

    fn act(&self, (): &mut (), view: &View<'_>) -> Answer {
        Answer::feed(within(view.error.0 * self.per_volt, -self.clamp.0, self.clamp.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feed::acts;

    #[test]
    fn the_standard_error_gives_the_standard_velocity_and_the_clamp_holds_both_ways() {
        let law = RateByError::new(MicrometresPerSecond(100.0), Volts(5.0), MicrometresPerSecond(400.0));
        assert_eq!(acts(&law, &mut (), 5.0, 1), 100.0);
        assert_eq!(acts(&law, &mut (), -2.5, 1), -50.0);
        assert_eq!(acts(&law, &mut (), 19.9, 1), 398.0);
        assert_eq!(acts(&law, &mut (), 20.1, 1), 400.0);
        assert_eq!(acts(&law, &mut (), -60.0, 1), -400.0);
    }
}

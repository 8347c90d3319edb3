//! Spark frequency: velocity in proportion to what the frequency of sparks is short of its set point (\[L\]: the machine whose gap
//! signal is a frequency).
//!
//! \[L\] publishes the signal and no gain. A frequency that falls to nothing asks for the whole velocity, so missing sparks need no
//! rule of their own.

use super::{Answer, FeedLaw, View};
use crate::units::{MicrometresPerSecond, larger};

/// Numbers of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SparkFrequency {
    /// Sparks a second to keep.
    pub setpoint: f32,
    /// Path velocity without sparks.
    pub rate: MicrometresPerSecond,
}

impl FeedLaw for SparkFrequency {
    type State = ();
    const NEEDS_PULSES: bool = true;

    fn act(&self, (): &mut (), view: &View<'_>) -> Answer {
        let Some(frequency) = view.senses.frequency else { return Answer::BLIND };
        Answer::feed(self.rate.0 * (1.0 - frequency / larger(self.setpoint, 1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feed::Pulsed;

    #[test]
    fn fewer_sparks_feed_more_retreat_and_none_that_are_known_of_is_blind() {
        let law = SparkFrequency { setpoint: 2000.0, rate: MicrometresPerSecond(100.0) };
        let at = |frequency| {
            let mut pulsed = Pulsed::default();
            pulsed.senses.frequency = frequency;
            pulsed.act(&law, &mut (), 5)
        };
        assert_eq!(at(Some(0.0)), Answer::feed(100.0));
        assert_eq!(at(Some(1000.0)), Answer::feed(50.0));
        assert_eq!(at(Some(2000.0)), Answer::feed(0.0));
        assert_eq!(at(Some(4000.0)), Answer::feed(-100.0));
        assert_eq!(at(None), Answer::BLIND);
    }
}

//! Fixed rate: full feed or full retreat by the sign of the error (\[R\] section 6.7.1).

use super::{Answer, FeedLaw, View};
use crate::units::MicrometresPerSecond;

/// Feeds or retreats at one velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FixedRate {
    /// Path velocity, either way.
    pub rate: MicrometresPerSecond,
}

impl FeedLaw for FixedRate {
    type State = ();
    const BY_ERROR: bool = true;

    fn act(&self, (): &mut (), view: &View<'_>) -> Answer {
        let (rate, error) = (self.rate.0, view.error.0);
        Answer::feed(if error > 0.0 {
            rate
        } else if error < 0.0 {
            -rate
        } else {
            0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feed::acts;

    #[test]
    fn a_wide_gap_feeds_a_narrow_one_retreats_and_the_right_one_stays() {
        let law = FixedRate { rate: MicrometresPerSecond(50.0) };
        assert_eq!(acts(&law, &mut (), 0.01, 1), 50.0);
        assert_eq!(acts(&law, &mut (), -40.0, 1), -50.0);
        assert_eq!(acts(&law, &mut (), 0.0, 1), 0.0);
    }
}

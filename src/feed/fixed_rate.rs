//! Fixed rate: full feed or full retreat by the sign of the error (\[R\] section 6.7.1).

use super::FeedLaw;
use crate::units::{MicrometresPerSecond, Volts};

/// Feeds or retreats at one velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FixedRate {
    /// Path velocity, either way.
    pub rate: MicrometresPerSecond,
}

impl FeedLaw for FixedRate {
    fn velocity(&mut self, error: Volts, _: u32) -> MicrometresPerSecond {
        let rate = self.rate.0;
        MicrometresPerSecond(if error.0 > 0.0 {
            rate
        } else if error.0 < 0.0 {
            -rate
        } else {
            0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wide_gap_feeds_a_narrow_one_retreats_and_the_right_one_stays() {
        let mut law = FixedRate { rate: MicrometresPerSecond(50.0) };
        assert_eq!(law.velocity(Volts(0.01), 1).0, 50.0);
        assert_eq!(law.velocity(Volts(-40.0), 1).0, -50.0);
        assert_eq!(law.velocity(Volts(0.0), 1).0, 0.0);
    }
}

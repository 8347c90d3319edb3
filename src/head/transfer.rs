//! Bumpless transfer: after a change of what gives a value, the value goes on from where it was, and what it is off by fades.

/// Difference that is no difference any more: a hundredth of a volt is a tenth of the noise of a filtered gap voltage, a hundredth
/// of a um/s a count in 100 s.
const GONE: f32 = 0.01;

/// The values of one source, then of another.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Transfer {
    /// Value that was given last.
    last: f32,
    /// What is added to the values of the new source; before one was known, `None`.
    offset: Option<f32>,
    /// Nothing is added any more, and nothing is to be found out.
    over: bool,
}

impl Transfer {
    /// No change yet.
    pub const NONE: Transfer = Transfer { last: 0.0, offset: None, over: true };

    /// The values come from another source from here on.
    pub fn begin(&mut self) {
        (self.offset, self.over) = (None, false);
    }

    /// Value to act on: `raw` is that of the source, and `fades` the share of the offset that fades until the next call. What is
    /// not known is 0: no reason to move.
    pub fn value(&mut self, raw: Option<f32>, fades: f32) -> f32 {
        let Some(raw) = raw else { return 0.0 };
        if !self.over {
            let offset = match self.offset {
                None => self.last - raw,
                Some(offset) => offset * (1.0 - fades),
            };
            self.over = offset.abs() < GONE;
            self.offset = (!self.over).then_some(offset);
        }
        self.last = raw + self.offset.unwrap_or(0.0);
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transfer_begins_without_a_step_and_fades() {
        let mut transfer = Transfer::NONE;
        assert_eq!(transfer.value(Some(5.0), 0.1), 5.0);
        transfer.begin();
        // Not known yet.
        assert_eq!(transfer.value(None, 0.1), 0.0);
        assert_eq!(transfer.value(Some(-20.0), 0.1), 5.0);
        let mut last = 5.0;
        for _ in 0..100 {
            let value = transfer.value(Some(-20.0), 0.1);
            assert!(value <= last && last - value <= 2.5 + 1e-3, "{value}");
            last = value;
        }
        assert_eq!(last, -20.0);
        // Over: what comes is given as it is.
        assert_eq!(transfer.value(Some(7.0), 0.1), 7.0);
    }
}

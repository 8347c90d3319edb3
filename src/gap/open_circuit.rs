//! The open-circuit voltage as this front end reads it, so that a setpoint can be a share of it.

use super::{GapReading, Quality};
use crate::units::{Seconds, Volts};

/// Reads the open-circuit voltage while the electrode is away from the work, and knows when a reading has settled.
///
/// Measured and not set: it follows the generator's setting, the divider, and what a plain average makes of off-time.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OpenCircuit {
    settle_ticks: u32,
    ticks: u32,
    settled: bool,
    volts: Volts,
    measured: bool,
}

impl OpenCircuit {
    /// Trusts a reading once pulses have been on for `settle`, which must outlast the ringing of the filters after they
    /// start: 4 / corner + 2 Q / mains frequency brings it below 1 %.
    pub fn new(settle: Seconds) -> Self {
        Self { settle_ticks: settle.ticks(), ticks: 0, settled: false, volts: Volts(0.0), measured: false }
    }

    /// Pulses begin anew: readings have to settle. What was measured stays, for now the gap may be anything.
    pub fn begin(&mut self) {
        (self.ticks, self.settled) = (0, false);
    }

    /// Takes a reading with pulses on, `ticks` after the one before.
    pub fn observe(&mut self, reading: &GapReading, ticks: u32) {
        if self.settled {
            return;
        }
        if reading.quality != Quality::Valid {
            self.ticks = 0;
        } else if self.ticks < self.settle_ticks {
            self.ticks = self.ticks.saturating_add(ticks);
        } else {
            self.settled = true;
            self.volts = if self.measured { self.volts } else { reading.filtered };
            self.measured = true;
        }
    }

    /// The same voltage reads so many times as high from here on.
    pub fn scale(&mut self, ratio: f32) {
        self.volts = Volts(self.volts.0 * ratio);
    }

    /// What was measured, once readings have settled.
    pub fn volts(&self) -> Option<Volts> {
        self.settled.then_some(self.volts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn valid(volts: f32) -> GapReading {
        GapReading { filtered: Volts(volts), quality: Quality::Valid, ..GapReading::default() }
    }

    #[test]
    fn it_is_read_only_after_readings_were_good_without_interruption() {
        for quality in [Quality::Missing, Quality::NoGate, Quality::Saturated, Quality::Reversed] {
            let mut open = OpenCircuit::new(Seconds(0.01));
            for _ in 0..150 {
                open.observe(&valid(111.0), 1);
            }
            open.observe(&GapReading { quality, ..valid(7.0) }, 1);
            for _ in 0..200 {
                open.observe(&valid(105.0), 1);
            }
            assert_eq!(open.volts(), None);
            open.observe(&valid(100.0), 1);
            assert_eq!(open.volts(), Some(Volts(100.0)));
        }
    }

    #[test]
    fn pulses_that_begin_anew_have_to_settle_and_measure_nothing() {
        let mut open = OpenCircuit::new(Seconds(0.01));
        (0..=200).for_each(|_| open.observe(&valid(100.0), 1));
        open.begin();
        for _ in 0..200 {
            assert_eq!(open.volts(), None);
            open.observe(&valid(55.0), 1);
        }
        open.observe(&valid(55.0), 1);
        assert_eq!(open.volts(), Some(Volts(100.0)));
    }
}

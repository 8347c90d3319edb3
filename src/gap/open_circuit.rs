//! The open-circuit voltage as this front end reads it, so that a setpoint can be a share of it.

use super::{GapReading, Quality};
use crate::units::{Seconds, Volts};

/// Reads the open-circuit voltage while the electrode is away from the work.
///
/// Measured and not set: it follows the generator's setting, the divider, and what a plain average makes of off-time.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OpenCircuit {
    settle_ticks: u32,
    open_ticks: u32,
    volts: Option<Volts>,
}

impl OpenCircuit {
    /// Trusts the reading once the gap has been open for `settle`, which must outlast the ringing of the filters after
    /// pulses start: 4 / corner + 2 Q / mains frequency brings it below 1 %.
    pub fn new(settle: Seconds) -> Self {
        Self { settle_ticks: settle.ticks(), open_ticks: 0, volts: None }
    }

    /// Takes a reading, `ticks` after the one before; `open` says that pulses are on and the electrode is too far away to
    /// spark.
    pub fn observe(&mut self, reading: &GapReading, open: bool, ticks: u32) {
        if !open || reading.quality != Quality::Valid {
            self.open_ticks = 0;
        } else if self.open_ticks < self.settle_ticks {
            self.open_ticks = self.open_ticks.saturating_add(ticks);
        } else {
            self.volts = Some(reading.filtered);
        }
    }

    /// The newest measurement, `None` before the first.
    pub fn volts(&self) -> Option<Volts> {
        self.volts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn valid(volts: f32) -> GapReading {
        GapReading { filtered: Volts(volts), quality: Quality::Valid, ..GapReading::default() }
    }

    #[test]
    fn it_is_read_only_after_the_gap_has_been_open_without_interruption() {
        let mut open = OpenCircuit::new(Seconds(0.01));
        for _ in 0..150 {
            open.observe(&valid(111.0), true, 1);
        }
        open.observe(&valid(111.0), false, 1);
        for _ in 0..200 {
            open.observe(&valid(105.0), true, 1);
        }
        assert_eq!(open.volts(), None);
        open.observe(&valid(100.0), true, 1);
        assert_eq!(open.volts(), Some(Volts(100.0)));
    }

    #[test]
    fn sparks_and_bad_readings_leave_the_measurement_alone() {
        let mut open = OpenCircuit::new(Seconds(0.0));
        open.observe(&valid(100.0), true, 1);
        open.observe(&valid(55.0), false, 1);
        for quality in [Quality::Missing, Quality::NoGate, Quality::Saturated, Quality::Reversed] {
            open.observe(&GapReading { quality, ..valid(7.0) }, true, 1);
        }
        assert_eq!(open.volts(), Some(Volts(100.0)));
        open.observe(&valid(98.0), true, 1);
        assert_eq!(open.volts(), Some(Volts(98.0)));
    }
}

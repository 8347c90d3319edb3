//! ADC3: motor current and bus voltage, once a tick at the same phase of the PWM.

use super::blocks::{channel, power_up, sampling};
use super::{pac, put};
use crate::board::GATED_SAMPLING;
use crate::safety::{DriveCodes, DriveSense};

const CURRENT: u32 = channel("motor_current");
const BUS: u32 = channel("bus_voltage");
/// Start of an injected sequence.
const JSWSTART: u32 = 1 << 22;
/// End of an injected sequence.
const JEOC: u32 = 1 << 2;

/// The drive's own measurements.
pub struct DriveAdc(pac::ADC3);

impl DriveAdc {
    /// Configures the converter and starts the first pair.
    pub fn new(adc: pac::ADC3) -> Self {
        sampling(&adc, CURRENT, GATED_SAMPLING.smpr);
        sampling(&adc, BUS, GATED_SAMPLING.smpr);
        put!(adc.cr1(), 1 << 8);
        // A sequence of two sits in the last two places (RM0090 13.13.12).
        put!(adc.jsqr(), 1 << 20 | BUS << 15 | CURRENT << 10);
        power_up(&adc);
        put!(adc.cr2(), 1 | JSWSTART);
        DriveAdc(adc)
    }
}

impl DriveSense for DriveAdc {
    /// The pair that the last call started, done for almost a tick; starts the next.
    #[inline]
    fn read(&mut self) -> DriveCodes {
        let code = |n: usize| self.0.jdr(n).read().bits() as u16;
        let codes = DriveCodes { motor_current: code(0), bus_voltage: code(1) };
        put!(self.0.cr2(), 1 | JSWSTART);
        codes
    }

    /// A converter without a clock neither ends a pair nor lets the end of an earlier one be cleared.
    fn stands(&mut self) -> bool {
        let ended = self.0.sr().read().bits() & JEOC != 0;
        put!(self.0.sr(), !JEOC);
        !ended || self.0.sr().read().bits() & JEOC != 0
    }
}

//! The pulse generator: inhibit line and off-time request.

use super::pins::{self, Output};
use super::{Board, pac, power, put};
use crate::board::gpio::{PA4, Pin};
use crate::board::{DAC_STEPS, Pin as Place};
use crate::generator::{Generator, InhibitPin};
use core::convert::Infallible;
use embedded_hal::digital::PinState;

/// Off-time at full scale of the output, ns: 200 us a full scale of 3.3 V (assumed; a property of the interface, see the
/// wiring page).
const FULL_SCALE_NS: u32 = 200_000;

const ALLOW: Place = Board::TABLE.pin("allow_pulses");

/// The generator's interface. Pulses are inhibited when it is made, as they were by the pull before.
pub struct Interface {
    inhibit: InhibitPin<Output<{ ALLOW.port }, { ALLOW.number }>>,
    dac: pac::DAC,
}

impl Interface {
    /// Takes the pins. The line that allows is low before it becomes an output.
    pub fn new(
        dac: pac::DAC,
        allow: Pin<{ ALLOW.port }, { ALLOW.number }>,
        off_time: PA4,
        rcc: &pac::RCC,
    ) -> Result<Self, Infallible> {
        let inhibit = InhibitPin::new(pins::output_low(allow), PinState::High)?;
        power::DAC.reset(rcc);
        pins::analog(off_time);
        put!(dac.dhr12r(0), 0);
        put!(dac.cr(), 1);
        Ok(Interface { inhibit, dac })
    }
}

impl Generator for Interface {
    /// After allowing, [`super::lines::settle`] must follow: the reflex may have come in between.
    #[inline]
    fn set_pulses(&mut self, enabled: bool) {
        let Ok(()) = self.inhibit.set_pulses(enabled);
    }

    /// Longer than full scale requests full scale. 0 V is the generator's own setting.
    fn request_off_time(&mut self, off_ns: Option<u32>) {
        let ns = off_ns.unwrap_or(0).min(FULL_SCALE_NS);
        let code = (u64::from(ns) * u64::from(DAC_STEPS - 1) / u64::from(FULL_SCALE_NS)) as u32;
        put!(self.dac.dhr12r(0), code);
    }
}

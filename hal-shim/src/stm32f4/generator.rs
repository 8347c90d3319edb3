//! The pulse generator: inhibit line and off-time request.

use super::hal::dac::{C1, DacExt, DacOut, DacPin};
use super::lines::Allow;
use super::pins::Output;
use super::{Board, pac};
use crate::board::gpio::Pin;
use crate::board::gpio::gpioa::PA4;
use crate::board::{DAC_STEPS, Pin as Place};
use crate::generator::{Generator, InhibitPin};
use crate::pause::Permission;
use core::convert::Infallible;

/// Off-time at full scale of the output, ns: 200 us a full scale of 3.3 V (assumed; a property of the interface, see the
/// wiring page).
const FULL_SCALE_NS: u32 = 200_000;

const ALLOW: Place = Board::TABLE.pin("allow_pulses");

/// The generator's interface. Pulses are inhibited when it is made, as they were by the pull before.
pub struct Interface {
    /// From now on written as [`Allow`], which the tasks share that hold pulses back.
    _inhibit: InhibitPin<Output<{ ALLOW.port }, { ALLOW.number }>, true>,
    permission: Permission,
    dac: C1,
}

impl Interface {
    /// Takes the pins. The line that allows is low before it becomes an output.
    pub fn new(
        dac: pac::DAC,
        allow: Pin<{ ALLOW.port }, { ALLOW.number }>,
        off_time: PA4,
        rcc: &mut pac::RCC,
    ) -> Result<Self, Infallible> {
        let inhibit = InhibitPin::new(allow.into_push_pull_output())?;
        let mut dac = dac.constrain(off_time.into_analog(), rcc);
        dac.set_value(0);
        dac.enable();
        Ok(Interface { _inhibit: inhibit, permission: Permission::new(), dac })
    }
}

impl Generator for Interface {
    /// After allowing, [`super::lines::settle`] must follow: the reflex may have come in between.
    #[inline]
    fn set_pulses(&mut self, enabled: bool) {
        if enabled {
            self.permission.permit(&Allow);
        } else {
            self.permission.forbid(&Allow);
        }
    }

    /// Longer than full scale requests full scale. 0 V is the generator's own setting.
    fn request_off_time(&mut self, off_ns: Option<u32>) {
        let ns = off_ns.unwrap_or(0).min(FULL_SCALE_NS);
        let code = (u64::from(ns) * u64::from(DAC_STEPS - 1) / u64::from(FULL_SCALE_NS)) as u16;
        self.dac.set_value(code);
    }
}

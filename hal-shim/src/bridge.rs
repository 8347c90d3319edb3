//! H-bridge of the drive: PWM and two direction inputs (drive, reverse, brake, coast).
//!
//! Terms, as on the L298 of \[R\]: *drive* is forward high and reverse low, *reverse* the opposite, *brake* both high while
//! the PWM is high, *coast* everything low. \[R\] burnt a bridge on rapid reversals; [`PwmBridge`] therefore changes the
//! direction inputs only while the PWM is off.

use core::fmt;
use embedded_hal::digital::OutputPin;
use embedded_hal::pwm::SetDutyCycle;

/// What the bridge does until the next command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Drive {
    /// All switches open. The de-energised state.
    #[default]
    Coast,
    /// Winding shorted: slows, does not hold a weight.
    Brake,
    /// Signed share of the bus voltage, [`Drive::FULL`] is all of it; positive toward the work. A value beyond
    /// plus or minus [`Drive::FULL`] means full duty.
    Duty(i16),
}

impl Drive {
    /// Full duty.
    pub const FULL: i16 = 10_000;
}

/// An H-bridge.
pub trait HBridge {
    /// Why an output could not be set.
    type Error: core::fmt::Debug;
    /// Applies `drive`. A change of sign switches off first, then the direction, then the new duty.
    fn apply(&mut self, drive: Drive) -> Result<(), Self::Error>;
}

/// The output that could not be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BridgeFault {
    /// The PWM (enable input).
    Pwm,
    /// The direction input that drives toward the work.
    Forward,
    /// The direction input that drives away from the work.
    Reverse,
}

impl fmt::Display for BridgeFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let output = match self {
            BridgeFault::Pwm => "PWM",
            BridgeFault::Forward => "forward direction",
            BridgeFault::Reverse => "reverse direction",
        };
        write!(f, "H-bridge {output} output could not be set")
    }
}

impl core::error::Error for BridgeFault {}

/// What the direction inputs were last set to.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    /// A write failed half way: nothing is known.
    Unknown,
    Coast,
    Forward,
    Reverse,
    Brake,
}

/// An H-bridge on a PWM output and two direction pins.
///
/// The PWM's `set_duty_cycle_fully_off` must have switched the output off when it returns. One that waits for the next
/// PWM period lets the direction change under load: on a timer with preload, force the output inactive. Dead time between
/// the two switches of a half-bridge is the bridge's own.
///
/// After an error every output has been set low, whatever the others answered, and the next
/// [`apply`](HBridge::apply) sets all of them again.
pub struct PwmBridge<P, A, B> {
    pwm: P,
    forward: A,
    reverse: B,
    side: Side,
}

impl<P: SetDutyCycle, A: OutputPin, B: OutputPin> PwmBridge<P, A, B> {
    /// Takes the outputs and coasts. `forward` is the pin that drives toward the work.
    pub fn new(pwm: P, forward: A, reverse: B) -> Result<Self, BridgeFault> {
        let mut bridge = PwmBridge { pwm, forward, reverse, side: Side::Unknown };
        bridge.apply(Drive::Coast)?;
        Ok(bridge)
    }

    fn try_apply(&mut self, drive: Drive) -> Result<(), BridgeFault> {
        match drive {
            // Written out even when coasting already: the safe state does not rely on memory.
            Drive::Coast => self.change(Side::Coast),
            Drive::Brake => {
                self.turn(Side::Brake)?;
                self.pwm.set_duty_cycle_fully_on().map_err(|_| BridgeFault::Pwm)
            }
            // The direction stays, so that a duty passing through zero costs no direction change.
            Drive::Duty(0) if matches!(self.side, Side::Forward | Side::Reverse) => self.off(),
            Drive::Duty(0) => self.change(Side::Coast),
            Drive::Duty(duty) => {
                self.turn(if duty > 0 { Side::Forward } else { Side::Reverse })?;
                let duty = scale(duty, self.pwm.max_duty_cycle());
                self.pwm.set_duty_cycle(duty).map_err(|_| BridgeFault::Pwm)
            }
        }
    }

    #[inline]
    fn turn(&mut self, side: Side) -> Result<(), BridgeFault> {
        if self.side == side { Ok(()) } else { self.change(side) }
    }

    /// Sets the direction inputs, PWM off first; the input that goes low does so before the other goes high.
    #[cold]
    fn change(&mut self, side: Side) -> Result<(), BridgeFault> {
        self.side = Side::Unknown;
        self.off()?;
        match side {
            Side::Forward => {
                self.reverse.set_low().map_err(|_| BridgeFault::Reverse)?;
                self.forward.set_high().map_err(|_| BridgeFault::Forward)?;
            }
            Side::Reverse => {
                self.forward.set_low().map_err(|_| BridgeFault::Forward)?;
                self.reverse.set_high().map_err(|_| BridgeFault::Reverse)?;
            }
            Side::Brake => {
                self.forward.set_high().map_err(|_| BridgeFault::Forward)?;
                self.reverse.set_high().map_err(|_| BridgeFault::Reverse)?;
            }
            Side::Coast | Side::Unknown => {
                self.forward.set_low().map_err(|_| BridgeFault::Forward)?;
                self.reverse.set_low().map_err(|_| BridgeFault::Reverse)?;
            }
        }
        self.side = side;
        Ok(())
    }

    fn off(&mut self) -> Result<(), BridgeFault> {
        self.pwm.set_duty_cycle_fully_off().map_err(|_| BridgeFault::Pwm)
    }
}

impl<P: SetDutyCycle, A: OutputPin, B: OutputPin> HBridge for PwmBridge<P, A, B> {
    type Error = BridgeFault;

    fn apply(&mut self, drive: Drive) -> Result<(), BridgeFault> {
        let result = self.try_apply(drive);
        if result.is_err() {
            // As far toward coasting as the outputs still obey; the first fault is the one reported.
            self.side = Side::Unknown;
            let _ = self.pwm.set_duty_cycle_fully_off();
            let _ = self.forward.set_low();
            let _ = self.reverse.set_low();
        }
        result
    }
}

/// `duty` of [`Drive::FULL`] as a share of `max`, rounded to nearest.
fn scale(duty: i16, max: u16) -> u16 {
    const FULL: u32 = Drive::FULL as u32;
    let magnitude = u32::from(duty.unsigned_abs()).min(FULL);
    ((magnitude * u32::from(max) + FULL / 2) / FULL) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn duty_scales_to_nearest_and_stops_at_full() {
        assert_eq!(scale(9_999, u16::MAX), 65_528);
        assert_eq!(scale(10_000, u16::MAX), u16::MAX);
        assert_eq!(scale(10_001, u16::MAX), u16::MAX);
        assert_eq!(scale(i16::MIN, u16::MAX), u16::MAX);
        assert_eq!(scale(-4, 1250), 1);
        assert_eq!(scale(-3, 1250), 0);
        assert_eq!(scale(i16::MAX, 0), 0);
    }
}

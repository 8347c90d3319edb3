//! The pulse generator, seen from the head.
//!
//! *Inhibit* is the line that stops pulses. Released, that is undriven, it must inhibit: the board pulls it there.

use embedded_hal::digital::{OutputPin, PinState};

/// What the head can ask of the pulse generator.
pub trait Generator {
    /// Lets pulses through (`true`) or inhibits them. Released hardware inhibits: a dead controller makes no pulses.
    fn set_pulses(&mut self, enabled: bool);
    /// Requests an off-time, ns. `None` leaves the generator's own setting.
    fn request_off_time(&mut self, off_ns: Option<u32>);
}

/// The inhibit line on an output pin; a board's [`Generator`] holds one next to its off-time output. `ALLOW` is the level
/// that lets pulses through, `true` for high; the line's pull must be to the other.
pub struct InhibitPin<O, const ALLOW: bool>(O);

impl<O: OutputPin, const ALLOW: bool> InhibitPin<O, ALLOW> {
    /// Takes the pin and inhibits.
    pub fn new(pin: O) -> Result<Self, O::Error> {
        let mut inhibit = InhibitPin(pin);
        inhibit.set_pulses(false)?;
        Ok(inhibit)
    }

    /// Lets pulses through or inhibits them. When the pin cannot be set to allow, it is set to inhibit.
    #[inline]
    pub fn set_pulses(&mut self, enabled: bool) -> Result<(), O::Error> {
        let result = self.0.set_state(PinState::from(enabled == ALLOW));
        if enabled && result.is_err() {
            let _ = self.0.set_state(PinState::from(!ALLOW));
        }
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal_mock::eh1::MockError;
    use embedded_hal_mock::eh1::digital::{Mock as Pin, State, Transaction as Set};
    use std::io::ErrorKind;

    fn run<const ALLOW: bool>(transactions: &[Set], calls: impl FnOnce(&mut InhibitPin<Pin, ALLOW>)) {
        let mut pin = Pin::new(transactions);
        calls(&mut InhibitPin::new(pin.clone()).unwrap());
        pin.done();
    }

    #[test]
    fn starts_inhibited_and_follows_either_active_level() {
        fn follows<const ALLOW: bool>(yes: State, no: State) {
            run::<ALLOW>(&[Set::set(no), Set::set(yes), Set::set(no)], |inhibit| {
                inhibit.set_pulses(true).unwrap();
                inhibit.set_pulses(false).unwrap();
            });
        }
        follows::<true>(State::High, State::Low);
        follows::<false>(State::Low, State::High);
    }

    #[test]
    fn a_pin_that_cannot_allow_is_told_to_inhibit() {
        let broken = MockError::Io(ErrorKind::BrokenPipe);
        let transactions =
            [Set::set(State::Low), Set::set(State::High).with_error(broken.clone()), Set::set(State::Low)];
        run::<true>(&transactions, |inhibit| assert_eq!(inhibit.set_pulses(true), Err(broken)));
    }

    #[test]
    fn a_pin_that_cannot_inhibit_says_so_at_once() {
        let broken = MockError::Io(ErrorKind::BrokenPipe);
        let mut pin = Pin::new(&[Set::set(State::Low).with_error(broken.clone())]);
        assert_eq!(InhibitPin::<_, true>::new(pin.clone()).err(), Some(broken));
        pin.done();
    }
}

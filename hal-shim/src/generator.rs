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

/// The inhibit line on an output pin; a board's [`Generator`] holds one beside its off-time output.
pub struct InhibitPin<O> {
    pin: O,
    allow: PinState,
}

impl<O: OutputPin> InhibitPin<O> {
    /// Takes the pin and inhibits. `allow` is the level that lets pulses through; the line's pull must be to the other.
    pub fn new(pin: O, allow: PinState) -> Result<Self, O::Error> {
        let mut inhibit = InhibitPin { pin, allow };
        inhibit.set_pulses(false)?;
        Ok(inhibit)
    }

    /// Lets pulses through or inhibits them. When the pin cannot be set to allow, it is told to inhibit.
    pub fn set_pulses(&mut self, enabled: bool) -> Result<(), O::Error> {
        let result = self.pin.set_state(if enabled { self.allow } else { !self.allow });
        if enabled && result.is_err() {
            let _ = self.pin.set_state(!self.allow);
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

    fn run(transactions: &[Set], allow: PinState, calls: impl FnOnce(&mut InhibitPin<Pin>)) {
        let mut pin = Pin::new(transactions);
        calls(&mut InhibitPin::new(pin.clone(), allow).unwrap());
        pin.done();
    }

    #[test]
    fn starts_inhibited_and_follows_either_active_level() {
        for (allow, yes, no) in [(PinState::High, State::High, State::Low), (PinState::Low, State::Low, State::High)] {
            run(&[Set::set(no), Set::set(yes), Set::set(no)], allow, |inhibit| {
                inhibit.set_pulses(true).unwrap();
                inhibit.set_pulses(false).unwrap();
            });
        }
    }

    #[test]
    fn a_pin_that_cannot_allow_is_told_to_inhibit() {
        let broken = MockError::Io(ErrorKind::BrokenPipe);
        let transactions =
            [Set::set(State::Low), Set::set(State::High).with_error(broken.clone()), Set::set(State::Low)];
        run(&transactions, PinState::High, |inhibit| assert_eq!(inhibit.set_pulses(true), Err(broken)));
    }

    #[test]
    fn a_pin_that_cannot_inhibit_says_so_at_once() {
        let broken = MockError::Io(ErrorKind::BrokenPipe);
        let mut pin = Pin::new(&[Set::set(State::Low).with_error(broken.clone())]);
        assert_eq!(InhibitPin::new(pin.clone(), PinState::High).err(), Some(broken));
        pin.done();
    }
}

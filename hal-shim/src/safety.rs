//! Safety inputs and the drive's own measurements.
//!
//! Contacts are normally closed, to ground, against a pull-up: closed reads low and is safe, an open contact and a broken
//! wire read high. A [`Contact`] may also be safe at the other level.

use embedded_hal::digital::InputPin;

/// Safety inputs as conditions, not levels: `true` is the unsafe reading. Normally closed contacts make a broken wire
/// read as unsafe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SafetyInputs {
    /// Upper limit switch open.
    pub upper_limit: bool,
    /// Lower limit switch open.
    pub lower_limit: bool,
    /// Emergency stop open.
    pub emergency_stop: bool,
    /// Dielectric level, flow or temperature not OK.
    pub dielectric: bool,
    /// H-bridge reports a fault.
    pub bridge_fault: bool,
    /// The chip's own supply is low: no line, and always `false` where nobody watches it.
    pub supply_low: bool,
}

impl SafetyInputs {
    /// Themselves, if any of the conditions is unsafe.
    pub fn unsafe_ones(self) -> Option<SafetyInputs> {
        (self != SafetyInputs::default()).then_some(self)
    }
}

/// Reads the safety inputs.
pub trait Safety {
    /// Conditions now, without debounce: the first edge stops, debounce only delays re-arming.
    fn read(&mut self) -> SafetyInputs;
    /// Nothing is unsafe now, nor was since the last [`Safety::read`]: what nearly every tick finds, quicker than by reading.
    fn are_quiet(&mut self) -> bool {
        self.read() == SafetyInputs::default()
    }
}

/// One safety input on a pin, safe at one level; its pull must be to the other. The level is part of the type, so that
/// reading it takes no decision.
pub struct Contact<P, const SAFE_HIGH: bool = false>(P);

impl<P: InputPin> Contact<P> {
    /// A normally closed contact to ground with a pull-up: low is safe.
    pub fn normally_closed(pin: P) -> Self {
        Contact(pin)
    }
}

impl<P: InputPin> Contact<P, true> {
    /// An input that is safe at high, such as the fault output of a bridge.
    pub fn safe_at_high(pin: P) -> Self {
        Contact(pin)
    }
}

impl<P: InputPin, const SAFE_HIGH: bool> Contact<P, SAFE_HIGH> {
    /// Not at its safe level, or not readable.
    #[inline]
    pub fn is_unsafe(&mut self) -> bool {
        let is_safe = if SAFE_HIGH { self.0.is_high() } else { self.0.is_low() };
        !is_safe.unwrap_or(false)
    }
}

/// The five safety inputs on pins.
pub struct SafetyPins<U, L, E, D, B> {
    /// Upper limit switch.
    pub upper_limit: Contact<U>,
    /// Lower limit switch.
    pub lower_limit: Contact<L>,
    /// Emergency stop.
    pub emergency_stop: Contact<E>,
    /// Dielectric OK.
    pub dielectric: Contact<D>,
    /// Fault output of the H-bridge.
    pub bridge_fault: Contact<B, true>,
}

impl<U: InputPin, L: InputPin, E: InputPin, D: InputPin, B: InputPin> Safety for SafetyPins<U, L, E, D, B> {
    #[inline]
    fn read(&mut self) -> SafetyInputs {
        SafetyInputs {
            upper_limit: self.upper_limit.is_unsafe(),
            lower_limit: self.lower_limit.is_unsafe(),
            emergency_stop: self.emergency_stop.is_unsafe(),
            dielectric: self.dielectric.is_unsafe(),
            bridge_fault: self.bridge_fault.is_unsafe(),
            supply_low: false,
        }
    }
}

/// Converter codes of the drive, 12 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DriveCodes {
    /// Motor current; mid-scale is zero.
    pub motor_current: u16,
    /// Bus voltage.
    pub bus_voltage: u16,
}

/// Measures the drive.
pub trait DriveSense {
    /// Newest conversions.
    fn read(&mut self) -> DriveCodes;
    /// Whether nothing has been converted since the last call, which was a tick ago or earlier.
    fn stands(&mut self) -> bool;
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal_mock::eh1::MockError;
    use embedded_hal_mock::eh1::digital::{Mock as Pin, State, Transaction as Get};
    use std::io::ErrorKind;

    fn low() -> Get {
        Get::get(State::Low)
    }
    fn high() -> Get {
        Get::get(State::High)
    }
    fn dead(level: State) -> Get {
        Get::get(level).with_error(MockError::Io(ErrorKind::BrokenPipe))
    }

    const SAFE: SafetyInputs = SafetyInputs {
        upper_limit: false,
        lower_limit: false,
        emergency_stop: false,
        dielectric: false,
        bridge_fault: false,
        supply_low: false,
    };

    /// Reads five pins: four normally closed contacts and a bridge fault that is safe at high.
    fn read(levels: [Get; 5]) -> SafetyInputs {
        let mut pins = levels.map(|level| Pin::new(&[level]));
        let [u, l, e, d, b] = pins.clone();
        let mut safety = SafetyPins {
            upper_limit: Contact::normally_closed(u),
            lower_limit: Contact::normally_closed(l),
            emergency_stop: Contact::normally_closed(e),
            dielectric: Contact::normally_closed(d),
            bridge_fault: Contact::safe_at_high(b),
        };
        let inputs = safety.read();
        pins.iter_mut().for_each(Pin::done);
        inputs
    }

    #[test]
    fn closed_contacts_are_safe() {
        assert_eq!(read([low(), low(), low(), low(), high()]), SAFE);
    }

    #[test]
    fn each_open_contact_is_its_own_condition() {
        assert_eq!(read([high(), low(), low(), low(), high()]), SafetyInputs { upper_limit: true, ..SAFE });
        assert_eq!(read([low(), high(), low(), low(), high()]), SafetyInputs { lower_limit: true, ..SAFE });
        assert_eq!(read([low(), low(), high(), low(), high()]), SafetyInputs { emergency_stop: true, ..SAFE });
        assert_eq!(read([low(), low(), low(), high(), high()]), SafetyInputs { dielectric: true, ..SAFE });
        assert_eq!(read([low(), low(), low(), low(), low()]), SafetyInputs { bridge_fault: true, ..SAFE });
    }

    #[test]
    fn an_input_that_cannot_be_read_is_unsafe_whatever_its_level() {
        for level in [State::Low, State::High] {
            let inputs = read([dead(level), dead(level), dead(level), dead(level), dead(level)]);
            let all = SafetyInputs {
                upper_limit: true,
                lower_limit: true,
                emergency_stop: true,
                dielectric: true,
                bridge_fault: true,
                supply_low: false,
            };
            assert_eq!(inputs, all);
        }
    }
}

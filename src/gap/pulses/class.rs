//! What a pulse was, by what was seen of it.

/// What a pulse was. See the [module](super).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Class {
    /// Not ignited when it was looked at.
    Open,
    /// A discharge.
    Spark,
    /// A discharge that stays where the one before was.
    Arc,
    /// Current without voltage.
    Short,
    /// There was none.
    #[default]
    NoPulse,
    /// There was one, and nothing tells what.
    Uncertain,
}

/// How many classes there are.
pub const CLASSES: usize = 6;

/// A look into a pulse, converter codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PulseSample {
    /// Gap current.
    pub current: u16,
    /// Gap voltage.
    pub voltage: u16,
}

impl PulseSample {
    /// As the reflex's converter gives it: current, voltage.
    pub fn of([current, voltage]: [u16; 2]) -> PulseSample {
        PulseSample { current, voltage }
    }
}

/// What tells pulses apart. Voltages are codes above that of no voltage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Levels {
    /// Code of no voltage.
    pub zero: u16,
    /// The gap leads are swapped: a voltage makes the code smaller.
    pub reversed: bool,
    /// Code of the current from which it flows.
    pub current: u16,
    /// A pulse with current is short below this,
    pub short: i32,
    /// an arc below this, and a spark from here on.
    pub arc: i32,
}

impl Levels {
    /// Voltage of a code.
    #[inline(always)]
    pub fn voltage(&self, code: u16) -> i32 {
        let above = i32::from(code) - i32::from(self.zero);
        if self.reversed { -above } else { above }
    }

    /// What burns at the mean of so many voltages.
    #[inline(always)]
    pub fn burning(&self, sum: i32, count: i32) -> Class {
        if sum < count.wrapping_mul(self.short) {
            Class::Short
        } else if sum < count.wrapping_mul(self.arc) {
            Class::Arc
        } else {
            Class::Spark
        }
    }

    /// What a pulse was, by one look.
    pub fn class(&self, look: PulseSample) -> Class {
        let voltage = self.voltage(look.voltage);
        match look.current >= self.current {
            true => self.burning(voltage, 1),
            // It has burned out, or does not come up.
            false if voltage < self.short => Class::Uncertain,
            false => Class::Open,
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// 20 V and 34 V of 0.1 V, 1 A.
    pub const LEVELS: Levels = Levels { zero: 410, reversed: false, current: 2110, short: 200, arc: 340 };

    #[test]
    fn a_pulse_is_told_by_voltage_and_current() {
        for (current, volts, class) in [
            (2048, 100, Class::Open),
            (2109, 20, Class::Open),
            (2109, 19, Class::Uncertain),
            (2110, 19, Class::Short),
            (2110, 20, Class::Arc),
            (2600, 28, Class::Arc),
            (2600, 33, Class::Arc),
            (2600, 34, Class::Spark),
            (2600, 40, Class::Spark),
            (2600, 0, Class::Short),
        ] {
            let look = PulseSample { current, voltage: 410 + 10 * volts };
            assert_eq!(LEVELS.class(look), class, "{current} {volts} V");
            let swapped = Levels { zero: 3686, reversed: true, ..LEVELS };
            let look = PulseSample { current, voltage: 3686 - 10 * volts };
            assert_eq!(swapped.class(look), class, "{current} {volts} V, leads swapped");
        }
    }
}

//! Controlled variable: the quantity that is kept at its set point, and the gap error that a feed law gets of it.
//!
//! Voltage is what \[R\] and \[G\] control, the distance by charging time what \[X\] controls, a frequency of sparks what \[L\]
//! gets; the hazard of ignition has the least variance of all that pulses show (docs/gap-sensing.md). A law is the same for
//! each: every variable gives its error in *volts*, by a weight of its own, so that the gains of a law keep their meaning.
//!
//! Another variable is a file here, a line in [`variables!`](self) and its settings.

use super::GapReading;
use super::senses::Senses;
use crate::units::Volts;

/// What is known of the gap at a plan.
#[derive(Clone, Copy, Debug)]
pub struct Sensed<'a> {
    /// Newest reading, which is valid.
    pub gap: &'a GapReading,
    /// What its pulses say.
    pub senses: &'a Senses,
    /// Gap voltage to keep; `None` for a share of an open circuit that was not measured yet.
    pub setpoint: Option<Volts>,
}

/// A quantity with its set point.
pub trait Variable {
    /// Gap error: positive where the gap is too wide; `None` where the quantity is not known.
    fn error(&self, sensed: &Sensed<'_>) -> Option<Volts>;
}

/// Declares the variables: `number file::Variable;`. The file's name is the variable's name to a host, the number its value on
/// CAN: numbers count from 0 and, once released, stay.
macro_rules! variables {
    ($($(#[doc = $doc:literal])+ $number:literal $name:ident::$variable:ident;)+) => {
        $(
            mod $name;
            pub use $name::$variable;
        )+

        /// The variable in force.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum Controlled {
            $($(#[doc = $doc])+ $variable($variable),)+
        }

        impl Variable for Controlled {
            fn error(&self, sensed: &Sensed<'_>) -> Option<Volts> {
                match self { $(Controlled::$variable(variable) => variable.error(sensed),)+ }
            }
        }

        /// A variable by name, before it has its numbers.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum ControlledName {
            $($(#[doc = $doc])+ $variable = $number,)+
        }

        impl ControlledName {
            /// Every variable, by number.
            pub const ALL: &'static [ControlledName] = &[$(ControlledName::$variable),+];
            /// Their names, by number.
            pub const NAMES: &'static [&'static str] = &[$(stringify!($name)),+];

            /// The variable with the numbers that it takes of `settings`.
            pub fn build<'a, S>(self, settings: &'a S) -> Controlled
            where
                $($variable: From<&'a S>,)+
            {
                match self { $(ControlledName::$variable => Controlled::$variable(settings.into()),)+ }
            }
        }
    };
}

variables! {
    /// Filtered gap voltage (\[R\] section 6.5).
    0 voltage::GapVoltage;
    /// Hazard of ignition, e-folds below its set point.
    1 hazard::IgnitionHazard;
    /// Gap by charging time (\[X\] section 2).
    2 distance::GapDistance;
    /// Sparks a second, e-folds below their set point (\[L\]).
    3 frequency::Frequency;
}

/// Natural logarithm of a ratio of two rates; what is no rate counts as the smallest.
fn e_folds(over: f32, under: f32) -> f32 {
    use crate::units::{larger, within};
    /// Smallest rate, 1/s, and most e-folds: e^20 is 5 10^8.
    const SMALLEST: f32 = 1e-3;
    const MOST: f32 = 20.0;
    within(libm::logf(larger(over, SMALLEST) / larger(under, SMALLEST)), -MOST, MOST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gap::Quality;
    use crate::gap::charging::Charged;
    use crate::gap::likelihood::Hazard;
    use crate::settings::Settings;
    use crate::units::Micrometres;
    use proptest::prelude::*;

    fn errors(senses: &Senses, volts: f32) -> Vec<Option<f32>> {
        let gap = GapReading { filtered: Volts(volts), quality: Quality::Valid, ..GapReading::default() };
        let sensed = Sensed { gap: &gap, senses, setpoint: Some(Volts(60.0)) };
        let settings = Settings::default();
        ControlledName::ALL.iter().map(|name| name.build(&settings).error(&sensed).map(|error| error.0)).collect()
    }

    #[test]
    fn every_variable_is_positive_in_a_wide_gap_and_negative_in_a_narrow_one() {
        let at = |share: f32, um: f32, volts: f32| {
            let settings = Settings::default();
            let senses = Senses {
                hazard: Some(Hazard { rate: share * settings.hazard_setpoint, variance: 0.01 }),
                distance: Some(Charged { gap: Micrometres(um), inside: true }),
                frequency: Some(share * settings.frequency_setpoint),
                ..Senses::NONE
            };
            errors(&senses, volts)
        };
        let set = Settings::default().distance_setpoint;
        assert!(at(0.5, set + 10.0, 70.0).iter().all(|error| error.is_some_and(|volts| volts > 1.0)));
        assert!(at(2.0, set - 10.0, 50.0).iter().all(|error| error.is_some_and(|volts| volts < -1.0)));
        assert!(at(1.0, set, 60.0).iter().all(|error| error.is_some_and(|volts| volts.abs() < 0.1)));
    }

    #[test]
    fn what_is_not_known_gives_no_error() {
        assert_eq!(errors(&Senses::NONE, 60.0), [Some(0.0), None, None, None]);
    }

    #[test]
    fn rates_that_are_none_have_e_folds_all_the_same() {
        for (over, under) in [(0.0, 1.0), (1.0, 0.0), (f32::NAN, 1.0), (f32::INFINITY, 1.0)] {
            assert!(e_folds(over, under).abs() <= 20.0, "{over} {under}");
        }
        assert_eq!(e_folds(3.0, 3.0), 0.0);
    }

    proptest! {
        #[test]
        fn no_senses_make_a_variable_fail(rate: f32, um: f32, frequency: f32, volts: f32) {
            let senses = Senses {
                hazard: Some(Hazard { rate, variance: 1.0 }),
                distance: Some(Charged { gap: Micrometres(um), inside: true }),
                frequency: Some(frequency),
                ..Senses::NONE
            };
            for error in errors(&senses, volts).iter().skip(1) {
                prop_assert!(error.is_none_or(|volts| volts.is_finite()));
            }
        }
    }
}

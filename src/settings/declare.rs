//! The declaration a setting is made with: key, unit, range, default and source in one place.
//!
//! [`declare!`](crate::declare) turns a list of settings into a struct, its defaults, a table for documents and
//! description files, and access by key that refuses what is out of range. The process model of `host/sim` declares its
//! parameters the same way.

use core::fmt;

/// A value on its way in or out, before it is checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value<'a> {
    /// A number, whole or not.
    Number(f64),
    /// True or false.
    Flag(bool),
    /// The name of a choice.
    Word(&'a str),
}

impl fmt::Display for Value<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            // A value that came from an f32 reads as the f32 was written.
            Value::Number(x) if f64::from(*x as f32) == *x => write!(f, "{}", *x as f32),
            Value::Number(x) => write!(f, "{x}"),
            Value::Flag(x) => write!(f, "{x}"),
            Value::Word(x) => write!(f, "\"{x}\""),
        }
    }
}

/// What a setting may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// A number within limits, both included.
    Number {
        /// Smallest value.
        min: f32,
        /// Largest value.
        max: f32,
    },
    /// A whole number within limits, both included.
    Integer {
        /// Smallest value.
        min: u32,
        /// Largest value.
        max: u32,
    },
    /// True or false.
    Flag,
    /// One of these names.
    Choice(&'static [&'static str]),
}

/// What is known of one setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Field {
    /// Name in files, on the command line and in documents.
    pub key: &'static str,
    /// Unit, empty for a ratio, a flag or a choice.
    pub unit: &'static str,
    /// What it does.
    pub doc: &'static str,
    /// Where the default comes from: a publication, a data sheet, or "assumed".
    pub source: &'static str,
    /// What it may be.
    pub kind: Kind,
}

/// Its key alone: the log's reader has the table.
#[cfg(feature = "defmt")]
impl defmt::Format for Field {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{=str}", self.key);
    }
}

impl Field {
    /// The allowed values, in words.
    pub fn allowed(&self) -> impl fmt::Display + '_ {
        Allowed(self)
    }
}

struct Allowed<'a>(&'a Field);

impl fmt::Display for Allowed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = self.0.unit;
        let gap = if unit.is_empty() { "" } else { " " };
        match self.0.kind {
            Kind::Number { min, max } => write!(f, "a number from {min} to {max}{gap}{unit}"),
            Kind::Integer { min, max } => write!(f, "a whole number from {min} to {max}{gap}{unit}"),
            Kind::Flag => f.write_str("true or false"),
            Kind::Choice(names) => {
                f.write_str("one of ")?;
                for (i, name) in names.iter().enumerate() {
                    write!(f, "{}{name}", if i == 0 { "" } else { ", " })?;
                }
                Ok(())
            }
        }
    }
}

/// Why a value was refused. Nothing was changed.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SettingError {
    /// No setting has this key.
    UnknownKey,
    /// Not a value this setting can have; [`Field::allowed`] says which it can.
    NotAllowed(&'static Field),
    /// Allowed by itself, but not together with another setting.
    Conflict {
        /// The setting that has to change.
        field: &'static str,
        /// What it has to satisfy.
        rule: &'static str,
    },
}

impl fmt::Display for SettingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SettingError::UnknownKey => f.write_str("no such setting"),
            SettingError::NotAllowed(field) => write!(f, "{} must be {}", field.key, field.allowed()),
            SettingError::Conflict { field, rule } => write!(f, "{field}: {rule}"),
        }
    }
}

impl core::error::Error for SettingError {}

/// A type that a setting can have.
pub trait Setting: Copy {
    /// Takes a value if `kind` allows it.
    fn take(value: Value<'_>, kind: &Kind) -> Option<Self>;
    /// Gives the value back.
    fn value(self) -> Value<'static>;
}

impl Setting for f32 {
    fn take(value: Value<'_>, kind: &Kind) -> Option<f32> {
        let (Value::Number(x), Kind::Number { min, max }) = (value, kind) else { return None };
        let x = x as f32;
        (*min..=*max).contains(&x).then_some(x)
    }
    fn value(self) -> Value<'static> {
        Value::Number(f64::from(self))
    }
}

impl Setting for u32 {
    fn take(value: Value<'_>, kind: &Kind) -> Option<u32> {
        let (Value::Number(x), Kind::Integer { min, max }) = (value, kind) else { return None };
        let whole = x as u32;
        (f64::from(whole) == x && (*min..=*max).contains(&whole)).then_some(whole)
    }
    fn value(self) -> Value<'static> {
        Value::Number(f64::from(self))
    }
}

impl Setting for bool {
    fn take(value: Value<'_>, _: &Kind) -> Option<bool> {
        if let Value::Flag(x) = value { Some(x) } else { None }
    }
    fn value(self) -> Value<'static> {
        Value::Flag(self)
    }
}

/// A setting that is one of a few names.
pub trait Choice: Setting + PartialEq + 'static {
    /// The names, in the order of declaration.
    const NAMES: &'static [&'static str];
}

/// Makes an enum a [`Choice`]: `choice!(Law { FixedRate = "fixed_rate", ... })`.
#[macro_export]
macro_rules! choice {
    ($type:ident { $($variant:ident = $name:literal),+ $(,)? }) => {
        impl $crate::settings::Choice for $type {
            const NAMES: &'static [&'static str] = &[$($name),+];
        }

        impl $crate::settings::Setting for $type {
            fn take(value: $crate::settings::Value<'_>, _: &$crate::settings::Kind) -> Option<Self> {
                match value {
                    $($crate::settings::Value::Word($name) => Some($type::$variant),)+
                    _ => None,
                }
            }
            fn value(self) -> $crate::settings::Value<'static> {
                match self {
                    $($type::$variant => $crate::settings::Value::Word($name),)+
                }
            }
        }
    };
}

/// The [`Kind`] of a declared type and its limits.
#[doc(hidden)]
#[macro_export]
macro_rules! setting_kind {
    (f32, ($min:expr, $max:expr)) => {
        $crate::settings::Kind::Number { min: $min, max: $max }
    };
    (u32, ($min:expr, $max:expr)) => {
        $crate::settings::Kind::Integer { min: $min, max: $max }
    };
    (bool, ()) => {
        $crate::settings::Kind::Flag
    };
    ($choice:ident, ()) => {
        $crate::settings::Kind::Choice(<$choice as $crate::settings::Choice>::NAMES)
    };
}

/// Access by key to a struct made with [`declare!`](crate::declare).
pub trait Declared: Sized {
    /// The table, in the order of declaration.
    const FIELDS: &'static [Field];
    /// The value of the field at `index` of [`Declared::FIELDS`].
    fn get(&self, index: usize) -> Option<Value<'static>>;
    /// Sets the field called `key`; a refused value changes nothing.
    fn set(&mut self, key: &str, value: Value<'_>) -> Result<(), SettingError>;
    /// Checks every field against its own limits, for values that did not come through [`Declared::set`].
    fn check(&self) -> Result<(), SettingError>;
}

/// Declares a struct of settings: `/// doc`, `name: type = default, limits, "key", "unit", "source";`.
#[macro_export]
macro_rules! declare {
    ($(#[$outer:meta])* $vis:vis struct $struct:ident {
        $($(#[doc = $doc:literal])+ $name:ident: $type:ident = $default:expr, $limits:tt, $key:literal, $unit:literal, $source:literal;)+
    }) => {
        $(#[$outer])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        $vis struct $struct {
            $($(#[doc = $doc])+ pub $name: $type,)+
        }

        impl Default for $struct {
            fn default() -> Self {
                Self { $($name: $default,)+ }
            }
        }

        impl $crate::settings::Declared for $struct {
            const FIELDS: &'static [$crate::settings::Field] = {
                &[$($crate::settings::Field {
                    key: $key,
                    unit: $unit,
                    doc: concat!($($doc),+),
                    source: $source,
                    kind: $crate::setting_kind!($type, $limits),
                },)+]
            };

            fn get(&self, index: usize) -> Option<$crate::settings::Value<'static>> {
                let key = Self::FIELDS.get(index)?.key;
                match key {
                    $($key => Some($crate::settings::Setting::value(self.$name)),)+
                    _ => None,
                }
            }

            fn set(&mut self, key: &str, value: $crate::settings::Value<'_>) -> Result<(), $crate::settings::SettingError> {
                let Some(field) = Self::FIELDS.iter().find(|field| field.key == key) else {
                    return Err($crate::settings::SettingError::UnknownKey);
                };
                let refused = $crate::settings::SettingError::NotAllowed(field);
                match key {
                    $($key => self.$name = <$type as $crate::settings::Setting>::take(value, &field.kind).ok_or(refused)?,)+
                    _ => return Err($crate::settings::SettingError::UnknownKey),
                }
                Ok(())
            }

            fn check(&self) -> Result<(), $crate::settings::SettingError> {
                let mut copy = *self;
                for (index, field) in Self::FIELDS.iter().enumerate() {
                    if let Some(value) = self.get(index) {
                        copy.set(field.key, value)?;
                    }
                }
                Ok(())
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Colour {
        Red,
        Green,
    }
    choice!(Colour { Red = "red", Green = "green" });

    declare! {
        /// A sample.
        struct Sample {
            /// Gap voltage to keep.
            setpoint: f32 = 60.0, (1.0, 300.0), "gap.setpoint_v", "V", "[R] ch. 2";
            /// Blocks in a run.
            run: u32 = 5, (1, 100), "gap.run", "", "assumed";
            /// Whether to dance.
            dance: bool = false, (), "dance", "", "assumed";
            /// Which colour.
            colour: Colour = Colour::Red, (), "colour", "", "assumed";
        }
    }

    #[test]
    fn a_value_in_range_is_taken_and_given_back() {
        let mut s = Sample::default();
        for (key, value) in [
            ("gap.setpoint_v", Value::Number(300.0)),
            ("gap.run", Value::Number(1.0)),
            ("dance", Value::Flag(true)),
            ("colour", Value::Word("green")),
        ] {
            s.set(key, value).unwrap();
            let index = Sample::FIELDS.iter().position(|f| f.key == key).unwrap();
            assert_eq!(s.get(index), Some(value));
        }
        assert_eq!(s, Sample { setpoint: 300.0, run: 1, dance: true, colour: Colour::Green });
    }

    #[test]
    fn a_value_out_of_range_of_the_wrong_type_or_not_a_number_changes_nothing() {
        let mut s = Sample::default();
        for (key, value) in [
            ("gap.setpoint_v", Value::Number(300.1)),
            ("gap.setpoint_v", Value::Number(f64::NAN)),
            ("gap.setpoint_v", Value::Number(f64::INFINITY)),
            ("gap.setpoint_v", Value::Flag(true)),
            ("gap.run", Value::Number(1.5)),
            ("gap.run", Value::Number(0.0)),
            ("gap.run", Value::Number(-1.0)),
            ("gap.run", Value::Number(f64::NAN)),
            ("dance", Value::Number(1.0)),
            ("colour", Value::Word("blue")),
        ] {
            let SettingError::NotAllowed(field) = s.set(key, value).unwrap_err() else { panic!("{key}") };
            assert_eq!(field.key, key);
        }
        assert_eq!(s.set("nope", Value::Flag(true)), Err(SettingError::UnknownKey));
        assert_eq!(s, Sample::default());
    }

    #[test]
    fn a_struct_filled_by_hand_is_checked_too() {
        assert_eq!(Sample::default().check(), Ok(()));
        let bad = Sample { setpoint: f32::NAN, ..Sample::default() };
        assert!(matches!(bad.check(), Err(SettingError::NotAllowed(f)) if f.key == "gap.setpoint_v"));
    }

    #[test]
    fn the_error_names_key_range_and_unit() {
        extern crate std;
        use std::string::ToString;
        let mut s = Sample::default();
        let text = s.set("gap.setpoint_v", Value::Number(0.0)).unwrap_err().to_string();
        assert_eq!(text, "gap.setpoint_v must be a number from 1 to 300 V");
        let text = s.set("colour", Value::Word("blue")).unwrap_err().to_string();
        assert_eq!(text, "colour must be one of red, green");
    }
}

//! The declaration a setting is made with: key, unit, range, default and source in one place.
//!
//! [`declare!`](crate::declare) turns a list of settings into a struct, its defaults, a table for documents and
//! description files, and access by key that refuses what is out of range. The process model of `host/sim` declares its
//! parameters the same way.

#[cfg(not(target_os = "none"))]
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

#[cfg(not(target_os = "none"))]
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
    /// One of these names, by its place; an empty one is of no value any more.
    Choice(&'static [&'static str]),
}

impl Kind {
    /// Whether a word is a value that the setting may have.
    pub fn admits(&self, word: u32) -> bool {
        match self {
            Kind::Number { min, max } => (*min..=*max).contains(&f32::from_bits(word)),
            Kind::Integer { min, max } => (*min..=*max).contains(&word),
            Kind::Flag => word <= 1,
            Kind::Choice(_) => self.value(word).is_some(),
        }
    }

    /// The value that a word stands for; `None` for a choice that does not exist.
    fn value(&self, word: u32) -> Option<Value<'static>> {
        match self {
            Kind::Number { .. } => Some(Value::Number(f32::from_bits(word).into())),
            Kind::Integer { .. } => Some(Value::Number(word.into())),
            Kind::Flag => Some(Value::Flag(word != 0)),
            Kind::Choice(names) => {
                names.get(word as usize).filter(|name| !name.is_empty()).map(|name| Value::Word(name))
            }
        }
    }

    /// The word that stands for a value, if a setting of this kind can have such a value.
    fn word(&self, value: Value<'_>) -> Option<u32> {
        match (self, value) {
            (Kind::Number { .. }, Value::Number(x)) => Some((x as f32).to_bits()),
            (Kind::Integer { .. }, Value::Number(x)) => Some(x as u32).filter(|whole| f64::from(*whole) == x),
            (Kind::Flag, Value::Flag(x)) => Some(x.into()),
            (Kind::Choice(names), Value::Word(word)) => {
                let place = names.iter().position(|name| *name == word && !word.is_empty());
                place.map(|place| place as u32)
            }
            _ => None,
        }
    }
}

/// In which direction a setting may change while the head is enabled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// In both.
    Live,
    /// In none.
    Disabled,
    /// Down.
    Falls,
    /// Down; 0 stands for no limit at all and is the most there is.
    FallsFromNever,
    /// Up.
    Rises,
}

impl Change {
    /// Whether a setting of this kind may go from one word to another while the head is enabled.
    pub fn permits(self, kind: &Kind, from: u32, to: u32) -> bool {
        let falls = |from: u32, to: u32| match kind {
            Kind::Number { .. } => f32::from_bits(to) < f32::from_bits(from),
            _ => to < from,
        };
        let never = |word: u32| if word == 0 { u32::MAX } else { word };
        from == to
            || match self {
                Change::Live => true,
                Change::Disabled => false,
                Change::Falls => falls(from, to),
                Change::FallsFromNever => falls(never(from), never(to)),
                Change::Rises => falls(to, from),
            }
    }

    /// What it asks of a host.
    pub const fn rule(self) -> &'static str {
        match self {
            Change::Live => "may change at any time",
            Change::Disabled => "may not change while the head is enabled",
            Change::Falls => "may only become smaller while the head is enabled",
            Change::FallsFromNever => "may only become smaller, and not 0, while the head is enabled",
            Change::Rises => "may only become larger while the head is enabled",
        }
    }
}

/// What is known of one setting. What only documents say is not on the chip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Field {
    /// Name in files, on the command line, in documents and in logs.
    pub key: &'static str,
    /// Unit, empty for a ratio, a flag or a choice.
    #[cfg(not(target_os = "none"))]
    pub unit: &'static str,
    /// What it does.
    #[cfg(not(target_os = "none"))]
    pub doc: &'static str,
    /// Where the default comes from: a publication, a data sheet, or "assumed".
    #[cfg(not(target_os = "none"))]
    pub source: &'static str,
    /// What it may be.
    pub kind: Kind,
    /// How it may change while the head is enabled.
    pub change: Change,
    /// What another change would do; empty where every change is allowed.
    #[cfg(not(target_os = "none"))]
    pub hazard: &'static str,
}

/// Its key alone: the log's reader has the table.
#[cfg(feature = "defmt")]
impl defmt::Format for Field {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{=str}", self.key);
    }
}

#[cfg(not(target_os = "none"))]
impl Field {
    /// The allowed values, in words.
    pub fn allowed(&self) -> impl fmt::Display + '_ {
        Allowed(self)
    }
}

#[cfg(not(target_os = "none"))]
struct Allowed<'a>(&'a Field);

#[cfg(not(target_os = "none"))]
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
                for (i, name) in names.iter().filter(|name| !name.is_empty()).enumerate() {
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

#[cfg(not(target_os = "none"))]
impl fmt::Display for SettingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SettingError::UnknownKey => f.write_str("no such setting"),
            SettingError::NotAllowed(field) => write!(f, "{} must be {}", field.key, field.allowed()),
            SettingError::Conflict { field, rule } => write!(f, "{field}: {rule}"),
        }
    }
}

#[cfg(not(target_os = "none"))]
impl core::error::Error for SettingError {}

/// A type that a setting can have: what there is of it fits a *word*, which is how settings are stored and sent.
pub trait Setting: Copy {
    /// The word: bits of an f32, a whole number, 0 or 1 of a flag, place of a choice among its names.
    fn word(self) -> u32;
    /// The value of a word that [`Kind::admits`]; of another one, any value.
    fn from_word(word: u32) -> Self;
}

impl Setting for f32 {
    fn word(self) -> u32 {
        self.to_bits()
    }
    fn from_word(word: u32) -> f32 {
        f32::from_bits(word)
    }
}

impl Setting for u32 {
    fn word(self) -> u32 {
        self
    }
    fn from_word(word: u32) -> u32 {
        word
    }
}

impl Setting for bool {
    fn word(self) -> u32 {
        self.into()
    }
    fn from_word(word: u32) -> bool {
        word != 0
    }
}

/// A setting that is one of a few names.
pub trait Choice: Setting + PartialEq + 'static {
    /// The name of each word; an empty one where a word is of no value any more.
    const NAMES: &'static [&'static str];
}

/// Makes an enum a [`Choice`]: `choice!(Colour { Red = "red", ... })`, or `choice!(Colour)` of one that has constants `ALL`
/// and `NAMES`.
#[macro_export]
macro_rules! choice {
    ($type:ident { $($variant:ident = $name:literal),+ $(,)? }) => {
        $crate::choice!($type, &[$($type::$variant),+], &[$($name),+]);
    };
    ($type:ident) => {
        $crate::choice!($type, $type::ALL, $type::NAMES);
    };
    ($type:ident, $all:expr, $names:expr) => {
        impl $crate::settings::Choice for $type {
            const NAMES: &'static [&'static str] = $names;
        }

        // Each value has a name, in the order of the enum.
        const _: () = {
            let (all, names): (&[$type], &[&str]) = ($all, $names);
            let (mut at, mut word) = (0, 0);
            while at < all.len() {
                while names[word].is_empty() {
                    word += 1;
                }
                assert!(all[at] as usize == word, "names of a choice are in the order of its values, which count from 0");
                (at, word) = (at + 1, word + 1);
            }
            assert!(word == names.len(), "a name of a choice without a value");
        };

        impl $crate::settings::Setting for $type {
            fn word(self) -> u32 {
                self as u32
            }
            fn from_word(word: u32) -> Self {
                let all: &[$type] = $all;
                all.iter().copied().find(|value| *value as u32 == word).unwrap_or(all[0])
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

/// The [`Change`] of a declared field.
#[doc(hidden)]
#[macro_export]
macro_rules! setting_change {
    () => {
        $crate::settings::Change::Live
    };
    (live) => {
        $crate::settings::Change::Live
    };
    (disabled) => {
        $crate::settings::Change::Disabled
    };
    (falls) => {
        $crate::settings::Change::Falls
    };
    (falls_from_never) => {
        $crate::settings::Change::FallsFromNever
    };
    (rises) => {
        $crate::settings::Change::Rises
    };
}

/// Access by place and by key to a struct made with [`declare!`](crate::declare).
pub trait Declared: Sized {
    /// The table, in the order of declaration.
    const FIELDS: &'static [Field];
    /// The keys in that order, for constants.
    const KEYS: &'static [&'static str];
    /// Index and sub-index of each as an object, in that order; empty for a struct whose fields are none.
    const ADDRESSES: &'static [(u16, u8)];
    /// The word of the field at `index` of [`Declared::FIELDS`].
    fn word(&self, index: usize) -> Option<u32>;
    /// Sets the field at `index`; a refused word changes nothing.
    fn put_word(&mut self, index: usize, word: u32) -> Result<(), SettingError>;
    /// The value of the field at `index`.
    fn get(&self, index: usize) -> Option<Value<'static>> {
        Self::FIELDS.get(index)?.kind.value(self.word(index)?)
    }
    /// Sets the field at `index`; a refused value changes nothing.
    fn put(&mut self, index: usize, value: Value<'_>) -> Result<(), SettingError> {
        let field = Self::FIELDS.get(index).ok_or(SettingError::UnknownKey)?;
        self.put_word(index, field.kind.word(value).ok_or(SettingError::NotAllowed(field))?)
    }
    /// Sets the field called `key`; a refused value changes nothing.
    fn set(&mut self, key: &str, value: Value<'_>) -> Result<(), SettingError> {
        let index = Self::FIELDS.iter().position(|field| field.key == key).ok_or(SettingError::UnknownKey)?;
        self.put(index, value)
    }
    /// Checks every field against its own limits, for values that did not come through [`Declared::set`].
    fn check(&self) -> Result<(), SettingError>;
}

/// ObjectHandle of the key among `keys`, in a constant: there an unknown one does not compile.
pub const fn place(keys: &[&str], key: &str) -> usize {
    let mut at = 0;
    while !same(keys[at], key) {
        at += 1;
    }
    at
}

const fn same(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut at = 0;
    while at < a.len() && at < b.len() && a[at] == b[at] {
        at += 1;
    }
    at == a.len() && at == b.len()
}

/// Whether no address is there twice.
pub const fn distinct(addresses: &[(u16, u8)]) -> bool {
    let mut at = 1;
    while at < addresses.len() {
        let mut before = 0;
        while before < at {
            if addresses[before].0 == addresses[at].0 && addresses[before].1 == addresses[at].1 {
                return false;
            }
            before += 1;
        }
        at += 1;
    }
    true
}

/// Checks words against the limits of their fields.
pub fn check(fields: &'static [Field], words: &[u32]) -> Result<(), SettingError> {
    match fields.iter().zip(words).find(|(field, word)| !field.kind.admits(**word)) {
        Some((field, _)) => Err(SettingError::NotAllowed(field)),
        None => Ok(()),
    }
}

/// Declares a struct of settings: `/// doc`, `index:sub name: type = default, limits, "key", "unit", "source", change
/// "hazard";`. Index and sub-index are those of the object that a setting is, and stand in front of all fields or of none. What
/// is an object says at its end how it may change while the head is enabled: `live`, or one of `disabled`, `falls`,
/// `falls_from_never`, `rises` with what another change would do.
///
/// ```
/// edm_servo_head::declare! {
///     /// Of a press.
///     struct Press {
///         /// Force to keep.
///         0x2100:2 force: f32 = 10.0, (0.0, 90.0), "press.force_n", "N", "assumed", falls "it would press harder";
///         /// Length of its stroke.
///         0x2100:1 stroke: f32 = 10.0, (0.0, 50.0), "press.stroke_mm", "mm", "assumed", live;
///     }
/// }
/// ```
///
/// An address that is there twice does not compile:
///
/// ```compile_fail,E0080
/// edm_servo_head::declare! {
///     /// Of a press.
///     struct Press {
///         /// Force to keep.
///         0x2100:1 force: f32 = 10.0, (0.0, 90.0), "press.force_n", "N", "assumed", live;
///         /// Length of its stroke.
///         0x2100:1 stroke: f32 = 10.0, (0.0, 50.0), "press.stroke_mm", "mm", "assumed", live;
///     }
/// }
/// ```
#[macro_export]
macro_rules! declare {
    ($(#[$outer:meta])* $vis:vis struct $struct:ident {
        $($(#[doc = $doc:literal])+ $($index:literal : $sub:literal)? $name:ident: $type:ident = $default:expr, $limits:tt, $key:literal, $unit:literal, $source:literal $(, $change:ident $($hazard:literal)?)?;)+
    }) => {
        $(#[$outer])*
        #[derive(Clone, Copy, Debug)]
        $vis struct $struct {
            $($(#[doc = $doc])+ pub $name: $type,)+
        }

        const _: () = {
            let addresses = <$struct as $crate::settings::Declared>::ADDRESSES;
            assert!($crate::settings::distinct(addresses), "two settings have the same index and sub-index");
            assert!(addresses.is_empty() || addresses.len() == $struct::COUNT, "a setting has no index and sub-index");
            let changes: &[&str] = &[$($(stringify!($change),)?)+];
            assert!(addresses.len() == changes.len(), "an object does not say how it may change");
        };

        impl $struct {
            /// How many there are.
            $vis const COUNT: usize = <Self as $crate::settings::Declared>::FIELDS.len();

            /// Every value as a word, in the order of declaration.
            $vis fn words(&self) -> [u32; Self::COUNT] {
                let mut words = [0; Self::COUNT];
                let [$($name,)+] = &mut words;
                $(*$name = $crate::settings::Setting::word(self.$name);)+
                words
            }

            /// Takes the values of words that were checked. One by one: made at once they would all wait in registers.
            #[inline(never)]
            $vis fn take_words(&mut self, words: &[u32; Self::COUNT]) {
                let [$($name,)+] = words;
                $(self.$name = $crate::settings::Setting::from_word(*$name);)+
            }
        }

        // Word by word: field by field it would be a branch each.
        impl PartialEq for $struct {
            fn eq(&self, other: &Self) -> bool {
                self.words() == other.words()
            }
        }

        impl Default for $struct {
            fn default() -> Self {
                const { Self { $($name: $default,)+ } }
            }
        }

        impl $crate::settings::Declared for $struct {
            const KEYS: &'static [&'static str] = &[$($key),+];
            const ADDRESSES: &'static [(u16, u8)] = &[$($(($index, $sub),)?)+];
            const FIELDS: &'static [$crate::settings::Field] = {
                &[$($crate::settings::Field {
                    key: $key,
                    #[cfg(not(target_os = "none"))]
                    unit: $unit,
                    #[cfg(not(target_os = "none"))]
                    doc: concat!($($doc),+),
                    #[cfg(not(target_os = "none"))]
                    source: $source,
                    kind: $crate::setting_kind!($type, $limits),
                    change: $crate::setting_change!($($change)?),
                    #[cfg(not(target_os = "none"))]
                    hazard: concat!($($($hazard)?)?),
                },)+]
            };

            fn word(&self, index: usize) -> Option<u32> {
                self.words().get(index).copied()
            }

            fn put_word(&mut self, index: usize, word: u32) -> Result<(), $crate::settings::SettingError> {
                let mut words = self.words();
                let (Some(field), Some(slot)) = (Self::FIELDS.get(index), words.get_mut(index)) else {
                    return Err($crate::settings::SettingError::UnknownKey);
                };
                if !field.kind.admits(word) {
                    return Err($crate::settings::SettingError::NotAllowed(field));
                }
                *slot = word;
                self.take_words(&words);
                Ok(())
            }

            fn check(&self) -> Result<(), $crate::settings::SettingError> {
                $crate::settings::check(Self::FIELDS, &self.words())
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
            0x2100:2 setpoint: f32 = 60.0, (1.0, 300.0), "gap.setpoint_v", "V", "[R] ch. 2", live;
            /// Blocks in a run.
            0x2100:1 run: u32 = 5, (1, 100), "gap.run", "", "assumed", live;
            /// Whether to dance.
            0x2101:1 dance: bool = false, (), "dance", "", "assumed", live;
            /// Which colour.
            0x2101:2 colour: Colour = Colour::Red, (), "colour", "", "assumed", live;
        }
    }

    declare! {
        /// Fields that are no objects.
        struct Plain {
            /// A length.
            length: f32 = 1.0, (0.0, 2.0), "length", "m", "assumed";
        }
    }

    /// Number 1 was another one.
    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Shape {
        Round = 0,
        Square = 2,
    }
    choice!(Shape, &[Shape::Round, Shape::Square], &["round", "", "square"]);

    #[test]
    fn a_number_that_has_no_choice_any_more_is_refused_and_has_no_name() {
        let kind = Kind::Choice(Shape::NAMES);
        assert_eq!([0, 1, 2, 3].map(|word| kind.admits(word)), [true, false, true, false]);
        assert_eq!(
            [0, 1, 2].map(|word| kind.value(word)),
            [Some(Value::Word("round")), None, Some(Value::Word("square"))]
        );
        assert_eq!(["round", "", "square"].map(|name| kind.word(Value::Word(name))), [Some(0), None, Some(2)]);
        assert_eq!((Shape::Square.word(), Shape::from_word(2)), (2, Shape::Square));
    }

    #[test]
    fn addresses_are_those_of_the_declaration_whatever_its_order() {
        assert_eq!(Sample::ADDRESSES, [(0x2100, 2), (0x2100, 1), (0x2101, 1), (0x2101, 2)]);
        assert!(Plain::ADDRESSES.is_empty());
        assert_eq!(Plain::default().length, 1.0);
    }

    #[test]
    fn an_address_that_is_there_twice_is_found_wherever_it_stands() {
        assert!(distinct(&[]) && distinct(&[(1, 1)]) && distinct(&[(1, 1), (1, 2), (2, 1)]));
        assert!(!distinct(&[(1, 1), (1, 1)]));
        assert!(!distinct(&[(1, 1), (1, 2), (2, 1), (1, 2)]));
        assert!(!distinct(&[(2, 1), (1, 2), (2, 1)]));
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
    fn a_guarded_setting_changes_in_its_direction_alone() {
        let number = Kind::Number { min: -10.0, max: 10.0 };
        let whole = Kind::Integer { min: 0, max: 10 };
        let word = f32::to_bits;
        for (change, kind, from, to, permitted) in [
            (Change::Live, number, word(1.0), word(2.0), true),
            (Change::Disabled, number, word(1.0), word(1.0), true),
            (Change::Disabled, number, word(1.0), word(2.0), false),
            (Change::Disabled, Kind::Flag, 0, 1, false),
            (Change::Falls, number, word(1.0), word(-2.0), true),
            (Change::Falls, number, word(-2.0), word(1.0), false),
            (Change::Falls, whole, 2, 1, true),
            (Change::Falls, whole, 1, 2, false),
            (Change::Rises, number, word(-2.0), word(1.0), true),
            (Change::Rises, number, word(1.0), word(-2.0), false),
            (Change::FallsFromNever, whole, 0, 10, true),
            (Change::FallsFromNever, whole, 10, 0, false),
            (Change::FallsFromNever, whole, 10, 9, true),
            (Change::FallsFromNever, whole, 9, 10, false),
        ] {
            assert_eq!(change.permits(&kind, from, to), permitted, "{change:?} {kind:?}: {from} to {to}");
        }
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

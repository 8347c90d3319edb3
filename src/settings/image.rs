//! The settings as they are stored: the values in the order of declaration, behind a head that says what they are.
//!
//! | bytes | content |
//! | --- | --- |
//! | 1 | version of this layout |
//! | 4 | *fingerprint* of the declarations: keys, types, names of choices |
//! | 4 each | numbers (f32) and whole numbers (u32), little-endian |
//! | 1 each | flags (0, 1) and choices (place in the list of names) |
//!
//! An image of another fingerprint belongs to another firmware and is refused whole: half a set of settings, the rest
//! defaults, would be a machine that nobody has commissioned. Checksums are the store's affair.

use super::{Declared, Field, Kind, SettingError, Settings, check};

/// Version of the layout.
const VERSION: u8 = 1;
/// Bytes before the first value.
const HEAD: usize = 5;
/// Length of an image, bytes.
pub const LENGTH: usize = length(Settings::FIELDS);
const _: () = assert!(LENGTH <= edm_hal_shim::store::MAX_IMAGE);
/// Fingerprint of the settings of this firmware.
const FINGERPRINT: u32 = fingerprint(Settings::KEYS, Settings::FIELDS);

/// Why an image was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ImageError {
    /// An unknown layout.
    Version(u8),
    /// Settings of another firmware.
    Foreign,
    /// A value that its setting cannot have.
    Value(SettingError),
}

const fn size(kind: &Kind) -> usize {
    match kind {
        Kind::Number { .. } | Kind::Integer { .. } => 4,
        Kind::Flag | Kind::Choice(_) => 1,
    }
}

const fn length(fields: &[Field]) -> usize {
    let mut length = HEAD;
    let mut i = 0;
    while i < fields.len() {
        length += size(&fields[i].kind);
        i += 1;
    }
    length
}

/// FNV-1a over what gives the bytes their meaning.
const fn fingerprint(keys: &[&str], fields: &[Field]) -> u32 {
    let mut hash = 0x811C_9DC5;
    let mut i = 0;
    while i < fields.len() {
        hash = mix(hash, keys[i]);
        hash = match fields[i].kind {
            Kind::Number { .. } => mix(hash, "number"),
            Kind::Integer { .. } => mix(hash, "integer"),
            Kind::Flag => mix(hash, "flag"),
            Kind::Choice(names) => {
                let mut hash = hash;
                let mut j = 0;
                while j < names.len() {
                    hash = mix(hash, names[j]);
                    j += 1;
                }
                hash
            }
        };
        i += 1;
    }
    hash
}

const fn mix(hash: u32, text: &str) -> u32 {
    let (bytes, mut hash) = (text.as_bytes(), hash);
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u32).wrapping_mul(0x0100_0193);
        i += 1;
    }
    // Ends the word: "ab" and "c" are not "a" and "bc".
    (hash ^ 0xFF).wrapping_mul(0x0100_0193)
}

impl Settings {
    /// The image of these settings.
    pub fn image(&self) -> [u8; LENGTH] {
        let mut image = [0; LENGTH];
        let [a, b, c, d] = FINGERPRINT.to_le_bytes();
        let mut rest = put(&mut image, &[VERSION, a, b, c, d]);
        for (field, word) in Self::FIELDS.iter().zip(self.words()) {
            let bytes = word.to_le_bytes();
            rest = put(rest, bytes.get(..size(&field.kind)).unwrap_or(&[]));
        }
        image
    }

    /// The settings of an image, each value checked against its own limits; [`Settings::build`] checks them together.
    pub fn from_image(image: &[u8]) -> Result<Settings, ImageError> {
        match image.split_first_chunk::<HEAD>() {
            Some((&[VERSION, a, b, c, d], values))
                if u32::from_le_bytes([a, b, c, d]) == FINGERPRINT && image.len() == LENGTH =>
            {
                let mut rest = values;
                let mut words = [0; Self::COUNT];
                for (field, slot) in Self::FIELDS.iter().zip(&mut words) {
                    let (bytes, tail) = rest.split_at_checked(size(&field.kind)).ok_or(ImageError::Foreign)?;
                    *slot = bytes.iter().rev().fold(0, |word, byte| word << 8 | u32::from(*byte));
                    rest = tail;
                }
                check(Self::FIELDS, &words).map_err(ImageError::Value)?;
                let mut settings = Settings::default();
                settings.take_words(&words);
                Ok(settings)
            }
            Some(([VERSION, ..], _)) => Err(ImageError::Foreign),
            _ => Err(ImageError::Version(image.first().copied().unwrap_or(0))),
        }
    }
}

/// Writes bytes and gives the room behind them; beyond the end nothing is written.
fn put<'a>(room: &'a mut [u8], bytes: &[u8]) -> &'a mut [u8] {
    let (here, behind) = room.split_at_mut_checked(bytes.len()).unwrap_or_default();
    if here.len() == bytes.len() {
        here.copy_from_slice(bytes);
    }
    behind
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Value;

    /// A value that the field may have and `settings` has not.
    fn other(settings: &Settings, index: usize) -> Value<'static> {
        let now = settings.get(index).unwrap();
        let candidates = match Settings::FIELDS[index].kind {
            Kind::Number { min, max } => [min, max].map(|x| Value::Number(x.into())).to_vec(),
            Kind::Integer { min, max } => [min, max].map(|x| Value::Number(x.into())).to_vec(),
            Kind::Flag => [true, false].map(Value::Flag).to_vec(),
            Kind::Choice(names) => names.iter().map(|name| Value::Word(name)).collect(),
        };
        candidates.into_iter().find(|value| *value != now).unwrap()
    }

    /// Where the value of a field lies in an image.
    fn place(key: &str) -> usize {
        let index = Settings::FIELDS.iter().position(|field| field.key == key).unwrap();
        length(&Settings::FIELDS[..index])
    }

    #[test]
    fn every_setting_survives_alone_and_together() {
        let mut all = Settings::default();
        for (index, field) in Settings::FIELDS.iter().enumerate() {
            let mut one = Settings::default();
            one.set(field.key, other(&one, index)).unwrap();
            all.set(field.key, other(&all, index)).unwrap();
            assert_ne!(one, Settings::default(), "{}", field.key);
            assert_eq!(Settings::from_image(&one.image()), Ok(one), "{}", field.key);
        }
        assert_eq!(Settings::from_image(&all.image()), Ok(all));
        assert_eq!(Settings::from_image(&Settings::default().image()), Ok(Settings::default()));
    }

    #[test]
    fn an_image_of_another_length_is_refused() {
        let image = Settings::default().image();
        assert_eq!(Settings::from_image(&[]), Err(ImageError::Version(0)));
        for length in HEAD..LENGTH {
            assert_eq!(Settings::from_image(&image[..length]), Err(ImageError::Foreign), "{length}");
        }
        let longer = [&image[..], &[0]].concat();
        assert_eq!(Settings::from_image(&longer), Err(ImageError::Foreign));
    }

    #[test]
    fn every_flipped_bit_of_the_head_is_refused() {
        for bit in 0..8 * HEAD {
            let mut image = Settings::default().image();
            image[bit / 8] ^= 1 << (bit % 8);
            let expected = if bit < 8 { ImageError::Version(image[0]) } else { ImageError::Foreign };
            assert_eq!(Settings::from_image(&image), Err(expected));
        }
    }

    #[test]
    fn a_value_out_of_range_is_refused_by_name() {
        for (key, bytes) in [
            ("gap.setpoint_v", f32::NAN.to_le_bytes().to_vec()),
            ("gap.setpoint_v", 0.5f32.to_le_bytes().to_vec()),
            ("retreat.after_shorts", 0u32.to_le_bytes().to_vec()),
            ("commission.passed", vec![2]),
            ("feed.law", vec![3]),
        ] {
            let mut image = Settings::default().image();
            image[place(key)..place(key) + bytes.len()].copy_from_slice(&bytes);
            let Err(ImageError::Value(SettingError::NotAllowed(field))) = Settings::from_image(&image) else {
                panic!("{key}")
            };
            assert_eq!(field.key, key);
        }
    }

    #[test]
    fn whatever_changes_the_meaning_of_the_bytes_changes_the_fingerprint() {
        let field = |key, kind| Field { key, unit: "", doc: "", source: "", kind };
        let number = Kind::Number { min: 0.0, max: 1.0 };
        let base = [field("a", number), field("b", Kind::Choice(&["x", "yz"]))];
        let others = [
            [field("b", Kind::Choice(&["x", "yz"])), field("a", number)],
            [field("a", Kind::Integer { min: 0, max: 1 }), field("b", Kind::Choice(&["x", "yz"]))],
            [field("a", number), field("b", Kind::Choice(&["yz", "x"]))],
            [field("a", number), field("b", Kind::Choice(&["xy", "z"]))],
            [field("a", number), field("c", Kind::Choice(&["x", "yz"]))],
        ];
        let fingerprint = |fields: [Field; 2]| fingerprint(&fields.map(|field| field.key), &fields);
        for other in others {
            assert_ne!(fingerprint(base), fingerprint(other));
        }
        let wider = [field("a", Kind::Number { min: -9.0, max: 9.0 }), field("b", Kind::Choice(&["x", "yz"]))];
        assert_eq!(fingerprint(base), fingerprint(wider), "a range is checked by value");
    }
}

//! The description file of a head (EDS, CiA 306-1): what its objects are called, what they hold, in which unit and range.
//!
//! CiA 306-1 has no place for units, ranges of floats and the names of a choice; edm-describe writes them as comments, and they
//! are read from there. A file without them works too: values are then numbers without a unit.

use crate::sdo::Address;
use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};

/// The file of the heads of this tree.
const OWN: &str = include_str!("../../../docs/edm-servo-head.eds");
/// Settings of a head.
const SETTINGS: std::ops::RangeInclusive<u16> = 0x2100..=0x21FF;

/// Settings that are suggested for one that does not exist.
const LIKE: usize = 4;

/// Data type (CiA 301 table 44).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Yes or no, one byte.
    Flag,
    /// A whole number of so many bytes, with a sign or without.
    Whole(usize, bool),
    /// 32 bits of floating point.
    Real,
    /// Text.
    Text,
    /// Bytes.
    Domain,
}

impl Kind {
    fn of(code: u64) -> Option<Kind> {
        Some(match code {
            0x01 => Kind::Flag,
            0x02 => Kind::Whole(1, true),
            0x03 => Kind::Whole(2, true),
            0x04 => Kind::Whole(4, true),
            0x05 => Kind::Whole(1, false),
            0x06 => Kind::Whole(2, false),
            0x07 => Kind::Whole(4, false),
            0x08 => Kind::Real,
            0x09 => Kind::Text,
            0x0F => Kind::Domain,
            _ => return None,
        })
    }
}

/// A value as a person sees it.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Yes or no.
    Flag(bool),
    /// A whole number.
    Whole(i64),
    /// A number.
    Real(f32),
    /// One of several words.
    Word(String),
    /// Text.
    Text(String),
    /// Bytes.
    Bytes(Vec<u8>),
}

impl Display for Value {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Value::Flag(value) => write!(f, "{value}"),
            Value::Whole(value) => write!(f, "{value}"),
            Value::Real(value) => write!(f, "{value}"),
            Value::Word(text) | Value::Text(text) => f.write_str(text),
            Value::Bytes(bytes) => write!(f, "{} bytes", bytes.len()),
        }
    }
}

impl From<&Value> for serde_json::Value {
    fn from(value: &Value) -> serde_json::Value {
        match value {
            Value::Flag(value) => (*value).into(),
            Value::Whole(value) => (*value).into(),
            // The digits of the float, not those of the double next to it.
            Value::Real(value) => value.to_string().parse::<f64>().unwrap_or(f64::NAN).into(),
            Value::Word(text) | Value::Text(text) => text.clone().into(),
            Value::Bytes(bytes) => bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>().into(),
        }
    }
}

/// One value of the dictionary.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Where it is.
    pub address: Address,
    /// `record.name`, or the name of a variable. For a setting it is its key.
    pub key: String,
    /// Data type.
    pub kind: Kind,
    /// A host may write it.
    pub writable: bool,
    /// Its default.
    pub default: Option<Value>,
    /// Smallest and largest value.
    pub range: Option<(f64, f64)>,
    /// A stored number times this is in the unit.
    pub factor: f64,
    /// Unit; empty for none.
    pub unit: String,
    /// What it does.
    pub doc: String,
    /// Names of a choice.
    pub choices: BTreeMap<i64, String>,
}

impl Object {
    /// A value from its bytes; `None` when they are too few.
    pub fn decode(&self, bytes: &[u8]) -> Option<Value> {
        Some(match self.kind {
            Kind::Flag => Value::Flag(*bytes.first()? != 0),
            Kind::Whole(size, signed) => {
                let mut wide = if signed && bytes.get(size - 1)? & 0x80 != 0 { [0xFF; 8] } else { [0; 8] };
                wide[..size].copy_from_slice(bytes.get(..size)?);
                let number = i64::from_le_bytes(wide);
                match self.choices.get(&number) {
                    Some(word) => Value::Word(word.clone()),
                    None => Value::Whole(number),
                }
            }
            Kind::Real => Value::Real(f32::from_le_bytes(bytes.get(..4)?.try_into().ok()?)),
            Kind::Text => Value::Text(String::from_utf8_lossy(bytes).trim_end_matches('\0').into()),
            Kind::Domain => Value::Bytes(bytes.to_vec()),
        })
    }

    /// A number from its bytes, in the unit.
    pub fn number(&self, bytes: &[u8]) -> Option<f64> {
        let plain = Object { choices: BTreeMap::new(), ..self.clone() };
        match plain.decode(bytes)? {
            Value::Flag(value) => Some(f64::from(u8::from(value))),
            Value::Whole(value) => Some(value as f64 * self.factor),
            Value::Real(value) => Some(f64::from(value) * self.factor),
            _ => None,
        }
    }

    /// A value from what a person typed, within the range.
    ///
    /// # Errors
    /// What would be allowed.
    pub fn parse(&self, text: &str) -> Result<Value, String> {
        let refuse = || format!("{} = {text}: must be {}", self.key, self.allowed());
        let value = match self.kind {
            Kind::Flag => match text {
                "true" | "yes" | "1" => Value::Flag(true),
                "false" | "no" | "0" => Value::Flag(false),
                _ => return Err(refuse()),
            },
            Kind::Whole(..) if !self.choices.is_empty() => {
                let known = self.choices.iter().find(|(number, word)| *word == text || number.to_string() == text);
                Value::Word(known.ok_or_else(refuse)?.1.clone())
            }
            Kind::Whole(..) => Value::Whole(text.parse().map_err(|_| refuse())?),
            Kind::Real => Value::Real(text.parse().map_err(|_| refuse())?),
            Kind::Text => Value::Text(text.into()),
            Kind::Domain => return Err(refuse()),
        };
        let fits = |number: f64| self.range.is_none_or(|(low, high)| (low..=high).contains(&number));
        match value {
            Value::Whole(number) if !fits(number as f64) => Err(refuse()),
            // Limits are floats themselves, written with the digits of a float.
            Value::Real(number) if !number.is_finite() || !fits(number.to_string().parse().unwrap_or(f64::NAN)) => {
                Err(refuse())
            }
            value => Ok(value),
        }
    }

    /// The bytes of a value; `None` when it is of another type.
    pub fn encode(&self, value: &Value) -> Option<Vec<u8>> {
        let whole = |number: i64, size| Some(number.to_le_bytes().get(..size)?.to_vec());
        match (self.kind, value) {
            (Kind::Flag, Value::Flag(value)) => Some(vec![u8::from(*value)]),
            (Kind::Whole(size, _), Value::Whole(number)) => whole(*number, size),
            (Kind::Whole(size, _), Value::Word(word)) => {
                whole(*self.choices.iter().find(|(_, known)| *known == word)?.0, size)
            }
            (Kind::Real, Value::Real(number)) => Some(number.to_le_bytes().to_vec()),
            (Kind::Text, Value::Text(text)) => Some(text.as_bytes().to_vec()),
            _ => None,
        }
    }

    /// What it may be, in words.
    pub fn allowed(&self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        match (self.kind, self.range) {
            (Kind::Flag, _) => "true or false".into(),
            (Kind::Whole(..), _) if !self.choices.is_empty() => {
                self.choices.values().map(String::as_str).collect::<Vec<_>>().join(", ")
            }
            (Kind::Whole(..), Some((low, high))) => format!("a whole number from {low} to {high}{unit}"),
            (Kind::Whole(..), None) => format!("a whole number{unit}"),
            (_, Some((low, high))) => format!("a number from {low} to {high}{unit}"),
            (Kind::Real, None) => format!("a number{unit}"),
            (Kind::Text, _) => "text".into(),
            (Kind::Domain, _) => "read only".into(),
        }
    }

    /// Names of numbers that its text gives: `0 disabled, 1 commissioning, ...`.
    pub fn names(&self) -> BTreeMap<i64, String> {
        if !self.choices.is_empty() {
            return self.choices.clone();
        }
        let named = self.doc.split([',', ';', ':']).filter_map(|part| {
            let (number, name) = part.trim().split_once(' ')?;
            Some((number.parse().ok()?, name.to_owned()))
        });
        named.collect()
    }
}

/// 1018h of a head without its serial number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceId {
    /// Vendor-ID.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Revision number: rises when a range is narrowed.
    pub revision: u32,
}

/// A description file.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// What it describes.
    pub device_id: DeviceId,
    /// Name of the product.
    pub product: String,
    /// CRC-32 of its text.
    pub fingerprint: u32,
    objects: BTreeMap<Address, Object>,
}

impl Sheet {
    /// The file of the heads of this tree.
    ///
    /// # Errors
    /// When it cannot be read, which a test excludes.
    pub fn own() -> Result<Sheet, String> {
        Sheet::parse(OWN)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// The line, and what is wrong with it.
    pub fn parse(text: &str) -> Result<Sheet, String> {
        let sections = sections(text)?;
        let device = sections.get("DeviceInfo").ok_or("no [DeviceInfo]: not an EDS")?;
        let number = |name: &str| {
            let text = device.get(name).ok_or_else(|| format!("no {name} in [DeviceInfo]"))?;
            unsigned(text).and_then(|n| u32::try_from(n).ok()).ok_or_else(|| format!("{name}={text}: must be a number"))
        };
        let device_id = DeviceId {
            vendor: number("VendorNumber")?,
            product: number("ProductNumber")?,
            revision: number("RevisionNumber")?,
        };
        let mut objects = BTreeMap::new();
        for (name, section) in &sections {
            let Some((address, record)) = address(name) else { continue };
            let Some(kind) = section.get("DataType") else { continue };
            let kind =
                unsigned(kind).and_then(Kind::of).ok_or_else(|| format!("[{name}]: DataType={kind} is unknown"))?;
            let called = section.get("ParameterName").ok_or_else(|| format!("[{name}]: no ParameterName"))?;
            let key =
                match record.and_then(|record| sections.get(record)).and_then(|record| record.get("ParameterName")) {
                    Some(record) => format!("{record}.{called}"),
                    None => called.to_owned(),
                };
            objects.insert(address, section.object(address, key, kind));
        }
        if objects.is_empty() {
            return Err("no object in the file: is it truncated?".into());
        }
        let product = device.get("ProductName").unwrap_or("a device").to_owned();
        let fingerprint = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(text.as_bytes());
        Ok(Sheet { device_id, product, fingerprint, objects })
    }

    /// The object at an address.
    pub fn get(&self, address: Address) -> Option<&Object> {
        self.objects.get(&address)
    }

    /// The object with an address (2005:1) or a key, in upper or lower case.
    ///
    /// # Errors
    /// Why there is none.
    pub fn named(&self, text: &str) -> Result<&Object, String> {
        let by = |so: fn(&str, &str) -> bool| self.objects().find(|object| so(&object.key, text));
        if let Some(object) = by(|key, text| key == text).or_else(|| by(str::eq_ignore_ascii_case)) {
            return Ok(object);
        }
        let Ok(address) = text.parse::<Address>() else {
            let like = either(&like(self.objects(), text));
            return Err(format!(
                "{text}: no such object, did you mean {like}? An address is as 2005:1 or 6041; `edm-desk signals` lists what a scope records"
            ));
        };
        self.get(address).ok_or_else(|| format!("{address}: not in the description file; docs/objects.md lists all"))
    }

    /// Every object.
    pub fn objects(&self) -> impl Iterator<Item = &Object> + Clone {
        self.objects.values()
    }

    /// Every setting that a host may write.
    pub fn settings(&self) -> impl Iterator<Item = &Object> + Clone {
        self.objects().filter(|object| SETTINGS.contains(&object.address.0) && object.writable)
    }

    /// A setting by its key, be it one that only the head sets.
    ///
    /// # Errors
    /// As [`setting`](Sheet::setting).
    pub fn readable(&self, key: &str) -> Result<&Object, String> {
        let found = self.objects().find(|object| object.key == key && SETTINGS.contains(&object.address.0));
        found.map_or_else(|| self.setting(key), Ok)
    }

    /// A setting by its key.
    ///
    /// # Errors
    /// What it may have been meant to be.
    pub fn setting(&self, key: &str) -> Result<&Object, String> {
        self.settings().find(|object| object.key == key).ok_or_else(|| {
            if self.objects().any(|object| object.key == key && SETTINGS.contains(&object.address.0)) {
                return format!("{key}: only the head sets it");
            }
            let like = either(&like(self.settings(), key));
            format!("{key}: no such setting, did you mean {like}? `edm-desk settings list` lists all")
        })
    }
}

/// Keys of objects that may have been meant: those with the word in them, or in their text, or else the one that is spelled like it.
fn like<'a>(objects: impl Iterator<Item = &'a Object> + Clone, word: &str) -> Vec<&'a str> {
    let low = word.to_lowercase();
    let has = |text: &str| text.to_lowercase().contains(&low);
    let in_key = objects.clone().filter(|object| has(&object.key));
    let in_text = objects.clone().filter(|object| !has(&object.key) && has(&object.doc));
    let with: Vec<&str> = in_key.chain(in_text).take(LIKE).map(|object| object.key.as_str()).collect();
    // A key that is spelled out is misspelled.
    if word.contains('.') || with.is_empty() {
        let near = |object: &&Object| (1e6 * strsim::jaro(&object.key.to_lowercase(), &low)) as u32;
        return objects.max_by_key(near).map(|object| object.key.as_str()).into_iter().collect();
    }
    with
}

/// Alternatives as a sentence has them.
fn either(keys: &[&str]) -> String {
    match keys {
        [others @ .., last] if !others.is_empty() => format!("{} or {last}", others.join(", ")),
        _ => keys.concat(),
    }
}

/// `12AB` or `12ABsub3`, and of the latter the section of its record.
fn address(section: &str) -> Option<(Address, Option<&str>)> {
    let (index, sub) = section.split_once("sub").map_or((section, None), |(index, sub)| (index, Some(sub)));
    if index.len() != 4 {
        return None;
    }
    let number = u16::from_str_radix(index, 16).ok()?;
    match sub {
        None => Some((Address(number, 0), None)),
        Some(sub) => Some((Address(number, u8::from_str_radix(sub, 16).ok()?), Some(index))),
    }
}

fn unsigned(text: &str) -> Option<u64> {
    match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => u64::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}

#[derive(Default)]
struct Section<'a> {
    values: BTreeMap<String, &'a str>,
    comments: Vec<&'a str>,
}

impl<'a> Section<'a> {
    fn get(&self, name: &str) -> Option<&'a str> {
        self.values.get(&name.to_ascii_lowercase()).copied()
    }

    fn object(&self, address: Address, key: String, kind: Kind) -> Object {
        let mut object = Object {
            address,
            key,
            kind,
            writable: matches!(self.get("AccessType"), Some("rw" | "rww" | "rwr" | "wo")),
            default: None,
            range: None,
            factor: 1.0,
            unit: String::new(),
            doc: String::new(),
            choices: BTreeMap::new(),
        };
        let limit = |name| self.get(name).and_then(|text| text.parse::<f64>().ok());
        object.range = limit("LowLimit").zip(limit("HighLimit"));
        let mut default = self.get("DefaultValue");
        for comment in &self.comments {
            if let Some(value) = comment.strip_prefix("default ") {
                default = Some(value);
            } else if let Some((low, high)) = comment.strip_prefix("from ").and_then(|rest| rest.split_once(" to "))
                && let (Ok(low), Ok(high)) = (low.parse(), high.parse())
            {
                object.range = Some((low, high));
            } else if let Some(unit) = comment.strip_prefix("in ")
                && object.unit.is_empty()
                && object.doc.is_empty()
            {
                (object.factor, object.unit) = match unit.split_once(' ') {
                    Some((factor, unit)) if factor.parse::<f64>().is_ok() => {
                        (factor.parse().unwrap_or(1.0), unit.into())
                    }
                    _ => (1.0, unit.into()),
                };
            } else if let Some((number, word)) = comment.split_once(' ')
                && let Ok(number) = number.parse()
                && !word.contains(' ')
            {
                object.choices.insert(number, word.into());
            } else {
                object.doc =
                    if object.doc.is_empty() { (*comment).into() } else { format!("{} {comment}", object.doc) };
            }
        }
        // What depends on the node-ID is no default of its own.
        object.default = default.and_then(|text| object.parse(text).ok());
        object
    }
}

fn sections(text: &str) -> Result<BTreeMap<&str, Section<'_>>, String> {
    let mut all: BTreeMap<&str, Section<'_>> = BTreeMap::new();
    let mut name = None;
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim();
        if let Some(section) = line.strip_prefix('[') {
            let section = section.strip_suffix(']').ok_or_else(|| format!("line {number}: {line}: no ]"))?;
            all.entry(section).or_default();
            name = Some(section);
        } else if let (Some(comment), Some(name)) = (line.strip_prefix(';'), name) {
            all.entry(name).or_default().comments.push(comment.trim());
        } else if !line.is_empty() && !line.starts_with(';') {
            let (key, value) = line.split_once('=').ok_or_else(|| format!("line {number}: {line}: no ="))?;
            let name = name.ok_or_else(|| format!("line {number}: {line}: before the first section"))?;
            all.entry(name).or_default().values.insert(key.trim().to_ascii_lowercase(), value.trim());
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_describe::everything;
    use edm_servo_head::settings::Settings;

    #[test]
    fn every_object_of_the_declarations_is_in_the_file_as_it_was_declared() {
        let sheet = Sheet::own().unwrap();
        for declared in everything() {
            let object = sheet.get(Address(declared.index, declared.sub)).unwrap();
            assert_eq!(object.writable, declared.access.writable(), "{}", object.key);
            let (factor, unit) = edm_describe::eds::scaled(declared.unit);
            assert_eq!((object.factor.to_string().as_str(), object.unit.as_str()), (factor, unit), "{}", object.key);
            if let Some((low, high)) = declared.range {
                let (from, to) = object.range.unwrap();
                assert_eq!((from as f32, to as f32), (low as f32, high as f32), "{}", object.key);
            }
            let choices: Vec<&str> = object.choices.values().map(String::as_str).collect();
            assert_eq!(choices, declared.choices, "{}", object.key);
        }
        let keys: Vec<String> = sheet.settings().map(|object| object.key.clone()).collect();
        // All but commission.passed, which the head alone sets.
        assert_eq!(keys.len(), Settings::COUNT - 1);
        assert!(sheet.settings().all(|object| object.default.is_some()));
    }

    #[test]
    fn a_value_is_the_same_after_it_was_written_and_read_and_a_wrong_one_says_what_is_allowed() {
        let sheet = Sheet::own().unwrap();
        for (key, text, bytes) in [
            ("gap.setpoint_v", "58.5", &58.5f32.to_le_bytes()[..]),
            ("gap.average", "gated", &[1]),
            ("gap.zero_code", "410", &[0x9A, 1, 0, 0]),
            ("motor.reversed", "true", &[1]),
        ] {
            let object = sheet.setting(key).unwrap();
            let value = object.parse(text).unwrap();
            assert_eq!((object.encode(&value).unwrap(), value.to_string()), (bytes.to_vec(), text.to_owned()));
            assert_eq!(object.decode(bytes), Some(value));
        }
        for (key, text, part) in [
            ("gap.setpoint_v", "0", "gap.setpoint_v = 0: must be a number from 1 to 300 V"),
            ("gap.setpoint_v", "NaN", "must be a number from 1 to 300 V"),
            ("gap.average", "mean", "must be plain, gated"),
            ("gap.zero_code", "1.5", "must be a whole number from 0 to 4095 codes"),
            ("motor.reversed", "maybe", "must be true or false"),
        ] {
            let error = sheet.setting(key).unwrap().parse(text).unwrap_err();
            assert!(error.contains(part), "{error}");
        }
        assert!(sheet.setting("gap.setpoint").unwrap_err().contains("did you mean gap.setpoint_v?"));
        for (word, meant) in
            [("friction", "servo.friction_percent"), ("setpoint", "gap.setpoint_v"), ("stroke", "axis.stroke_um")]
        {
            let error = sheet.setting(word).unwrap_err();
            assert!(error.contains(meant), "{error}");
        }
        assert_eq!(sheet.setting("commission.passed").unwrap_err(), "commission.passed: only the head sets it");
    }

    #[test]
    fn an_object_is_named_by_its_address_or_as_it_is_printed() {
        let sheet = Sheet::own().unwrap();
        for name in ["2005:1", "2005h:1", "Gap.Voltage", "gap.voltage"] {
            assert_eq!(sheet.named(name).unwrap().address, Address(0x2005, 1), "{name}");
        }
        assert_eq!(sheet.named("gap.setpoint_v").unwrap().key, "gap.setpoint_v");
        // Every name that is printed names that object, or one before it that has the same name.
        assert!(sheet.objects().all(|object| sheet.named(&object.key).unwrap().key == object.key));
        let error = sheet.named("Gap.Colour").unwrap_err();
        assert!(error.contains("did you mean") && error.contains("2005:1 or 6041"), "{error}");
        assert!(sheet.named("3000:1").unwrap_err().contains("3000h:1: not in the description file"));
    }

    #[test]
    fn a_signed_number_with_a_factor_is_in_its_unit() {
        let sheet = Sheet::own().unwrap();
        let voltage = sheet.get(Address(0x2005, 1)).unwrap();
        let volts = voltage.number(&(-6012i16).to_le_bytes()).unwrap();
        assert!((volts + 60.12).abs() < 1e-9 && voltage.unit == "V", "{volts}");
        assert_eq!(voltage.number(&[1]), None);
        assert_eq!(sheet.get(Address(0x2000, 1)).unwrap().names()[&7], "holding position");
    }

    #[test]
    fn what_is_no_description_is_refused() {
        for (text, part) in [
            ("", "not an EDS"),
            ("hello", "line 1: hello: no ="),
            ("[DeviceInfo", "line 1"),
            ("[DeviceInfo]\nVendorNumber=1", "no ProductNumber"),
            ("[DeviceInfo]\nVendorNumber=x\nProductNumber=1\nRevisionNumber=1", "must be a number"),
            ("[DeviceInfo]\nVendorNumber=1\nProductNumber=1\nRevisionNumber=1", "truncated"),
        ] {
            let error = Sheet::parse(text).unwrap_err();
            assert!(error.contains(part), "{text:?}: {error}");
        }
    }
}

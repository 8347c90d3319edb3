//! Settings of a head: listed, kept in a file, compared, written in one go.
//!
//! A file has one table per group (`gap.setpoint_v` is in `[gap]`), and before them `[file]` with the number of settings:
//! so a truncated file is detected. A file without `[file]` is a hand-written one, and may have only a few settings.

use crate::Failure;
use crate::head::{Head, Identity, at, unsigned};
use crate::sdo::{Address, SdoError};
use crate::sheet::{Object, Sheet, Value};
use serde::Serialize;
use std::fmt::Write;

/// A setting and its value in a head.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting<'a> {
    /// The object.
    pub object: &'a Object,
    /// What the head has.
    pub value: Value,
}

/// A setting as a program reads it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// `group.name`.
    pub key: String,
    /// In the unit.
    pub value: serde_json::Value,
    /// Unit; empty for none.
    pub unit: String,
    /// Default.
    pub default: Option<serde_json::Value>,
    /// The value is another than the default.
    pub changed: bool,
    /// What it may be.
    pub allowed: String,
    /// What it does.
    pub doc: String,
}

impl Setting<'_> {
    /// Whether it differs from its default.
    pub fn changed(&self) -> bool {
        self.object.default.as_ref().is_some_and(|default| *default != self.value)
    }

    /// As a program reads it.
    pub fn line(&self) -> Line {
        Line {
            key: self.object.key.clone(),
            value: (&self.value).into(),
            unit: self.object.unit.clone(),
            default: self.object.default.as_ref().map(Into::into),
            changed: self.changed(),
            allowed: self.object.allowed(),
            doc: self.object.doc.clone(),
        }
    }
}

/// Reads a setting.
///
/// # Errors
/// Those of the transfer.
pub fn read<'a>(head: &Head, object: &'a Object) -> Result<Setting<'a>, SdoError> {
    let bytes = head.sdo.read(object.address)?;
    let value = object.decode(&bytes).ok_or(SdoError::Garbled(head.node, object.address))?;
    Ok(Setting { object, value })
}

/// Reads every setting. One that this head's program does not have yet is left out.
///
/// # Errors
/// Those of the transfers.
pub fn read_all(head: &Head) -> Result<Vec<Setting<'_>>, SdoError> {
    let mut all = Vec::new();
    for object in head.sheet.settings() {
        match read(head, object) {
            Ok(setting) => all.push(setting),
            Err(SdoError::Refused(_, 0x0602_0000 | 0x0609_0011)) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(all)
}

/// The file that has these settings.
pub fn file(identity: &Identity, settings: &[Setting<'_>]) -> String {
    let mut text = format!(
        "# Settings of node {}, {} {}, serial number {}.\n# edm-desk settings compare FILE, edm-desk settings import FILE\n\n\
         [file]\nof = {:?}\nrevision = {}\nsettings = {}\n",
        identity.node,
        identity.name,
        identity.software,
        identity.serial,
        identity.name,
        identity.revision,
        settings.len()
    );
    let mut group = "";
    for Setting { object, value } in settings {
        let (record, name) = object.key.split_once('.').unwrap_or(("", &object.key));
        if record != group {
            group = record;
            // A string takes everything; so it does below.
            let _ = write!(text, "\n[{group}]\n");
        }
        let unit = if object.unit.is_empty() { String::new() } else { format!("  # {}", object.unit) };
        let _ = match value {
            Value::Word(word) => writeln!(text, "{name} = {word:?}{unit}"),
            value => writeln!(text, "{name} = {value}{unit}"),
        };
    }
    text
}

/// Reads a file.
///
/// # Errors
/// The first thing that is wrong with it, and what is allowed; never half of it.
pub fn parse<'a>(sheet: &'a Sheet, text: &str) -> Result<Vec<Setting<'a>>, String> {
    let table: toml::Table = text.parse().map_err(|error: toml::de::Error| {
        let line = error.span().map_or(0, |span| text[..span.start.min(text.len())].lines().count().max(1));
        format!("line {line}: {}", error.message().replace('\n', ", "))
    })?;
    let mut settings = Vec::new();
    let mut announced = None;
    for (group, values) in &table {
        let values = values.as_table().ok_or_else(|| format!("{group}: must be in a [group], as in `[gap]`"))?;
        if group == "file" {
            let revision = values.get("revision").and_then(toml::Value::as_integer);
            if revision.is_some_and(|revision| revision != i64::from(sheet.device_id.revision)) {
                let known = sheet.device_id.revision;
                return Err(format!("revision {}, must be {known}", revision.unwrap_or_default()));
            }
            announced = values.get("settings").and_then(toml::Value::as_integer);
            continue;
        }
        for (name, value) in values {
            let object = sheet.setting(&format!("{group}.{name}"))?;
            let text = match value {
                toml::Value::String(text) => text.clone(),
                other => other.to_string(),
            };
            settings.push(Setting { object, value: object.parse(&text)? });
        }
    }
    // As the sheet has them, wherever they stand in the file.
    settings.sort_by_key(|setting| setting.object.address);
    match announced {
        Some(count) if count != settings.len() as i64 => {
            Err(format!("{} of {count} settings: the file is truncated", settings.len()))
        }
        _ if settings.is_empty() => Err("no setting in the file".into()),
        _ => Ok(settings),
    }
}

/// Settings from `KEY=VALUE`.
///
/// # Errors
/// The first that is wrong, and what is allowed.
pub fn assignments<'a>(sheet: &'a Sheet, words: &[String]) -> Result<Vec<Setting<'a>>, String> {
    let one = |word: &String| {
        let (key, value) = word.split_once('=').ok_or_else(|| format!("{word}: must be KEY=VALUE"))?;
        let object = sheet.setting(key.trim())?;
        Ok(Setting { object, value: object.parse(value.trim())? })
    };
    words.iter().map(one).collect()
}

/// A setting of which head and file have another value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// `group.name`.
    pub key: String,
    /// What the head has; nothing when its program does not have the setting.
    pub head: Option<serde_json::Value>,
    /// What the file has.
    pub file: serde_json::Value,
    /// Unit; empty for none.
    pub unit: String,
}

/// Differences of a head from wanted values.
///
/// # Errors
/// Those of the transfers.
pub fn compare(head: &Head, wanted: &[Setting<'_>]) -> Result<Vec<Difference>, SdoError> {
    let mut all = Vec::new();
    for Setting { object, value } in wanted {
        let has = match read(head, object) {
            Ok(setting) if setting.value == *value => continue,
            Ok(setting) => Some((&setting.value).into()),
            Err(SdoError::Refused(_, 0x0602_0000 | 0x0609_0011)) => None,
            Err(error) => return Err(error),
        };
        all.push(Difference { key: object.key.clone(), head: has, file: value.into(), unit: object.unit.clone() });
    }
    Ok(all)
}

/// What a staged write has done.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Written {
    /// `group.name` of those that have another value now.
    pub changed: Vec<String>,
    /// Each of them with its old and its new value, in words.
    #[serde(skip)]
    pub said: Vec<String>,
    /// They have taken away the pass of the guided check.
    pub check_again: bool,
}

/// Writes settings that were checked before: all of them, or none. One that does not fit another that is still to come waits
/// for that.
///
/// # Errors
/// Which the head refuses and why; the head has then what it had before, or the error says what not.
pub fn write(head: &Head, wanted: &[Setting<'_>]) -> Result<Written, Failure> {
    let mut before = Vec::new();
    for setting in wanted {
        let has = read(head, setting.object).map_err(|error| named(head, setting.object, &error))?;
        if has.value != setting.value {
            before.push(has);
        }
    }
    let passed = head.whole(at::COMMISSIONED)?;
    let new: Vec<Setting<'_>> =
        wanted.iter().filter(|new| before.iter().any(|old| old.object == new.object)).cloned().collect();
    if let Err((object, error)) = pass(head, &new) {
        let why = named(head, object, &error);
        return Err(match pass(head, &before) {
            Ok(()) => Failure::Failed(format!("{why}; nothing was changed")),
            Err((object, _)) => {
                Failure::Failed(format!("{why}; and {} could not be restored: compare with a file", object.key))
            }
        });
    }
    let check_again = passed == 1 && head.whole(at::COMMISSIONED)? == 0;
    let said = before.iter().filter_map(|old| {
        let now = new.iter().find(|new| new.object == old.object)?;
        let line = format!("{} {} -> {} {}", old.object.key, old.value, now.value, old.object.unit);
        Some(line.trim_end().to_owned())
    });
    let said = said.collect();
    Ok(Written { changed: new.iter().map(|setting| setting.object.key.clone()).collect(), said, check_again })
}

/// Writes, again and again while that gets further.
fn pass<'a>(head: &Head, settings: &[Setting<'a>]) -> Result<(), (&'a Object, SdoError)> {
    let mut left: Vec<&Setting<'a>> = settings.iter().collect();
    loop {
        let mut refused = Vec::new();
        let mut why = None;
        let count = left.len();
        for setting in left {
            let bytes = setting.object.encode(&setting.value).unwrap_or_default();
            if let Err(error) = head.sdo.write(setting.object.address, &bytes) {
                if !matches!(error, SdoError::Refused(..)) {
                    return Err((setting.object, error));
                }
                why.get_or_insert((setting.object, error));
                refused.push(setting);
            }
        }
        match why {
            None => return Ok(()),
            Some(why) if refused.len() == count => return Err(why),
            Some(_) => left = refused,
        }
    }
}

/// A refusal with the setting's name, and the rule that it or another one would break.
fn named(head: &Head, object: &Object, error: &SdoError) -> Failure {
    let SdoError::Refused(_, code) = error else { return error.clone().into() };
    let mut text = format!("{}: {}", object.key, crate::words::abort(*code));
    if *code == 0x0604_0043
        && let Ok(bytes) = head.sdo.read(at::REFUSED_SETTING)
    {
        let other = unsigned(&bytes);
        let rule = head.sdo.read(at::REFUSED_RULE).unwrap_or_default();
        if let Some(other) = head.sheet.get(Address((other >> 8) as u16, other as u8)) {
            text += &format!("; {} {}", other.key, String::from_utf8_lossy(&rule));
        }
    }
    Failure::Failed(format!("{text}; allowed: {}", object.allowed()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn identity() -> Identity {
        Identity {
            node: 1,
            name: "EDM servo head".into(),
            hardware: "X".into(),
            software: "0".into(),
            serial: 7,
            revision: Sheet::own().unwrap().device_id.revision,
        }
    }

    fn defaults(sheet: &Sheet) -> Vec<Setting<'_>> {
        sheet.settings().map(|object| Setting { object, value: object.default.clone().unwrap() }).collect()
    }

    #[test]
    fn a_file_says_what_it_was_made_of() {
        let sheet = Sheet::own().unwrap();
        let settings = defaults(&sheet);
        assert!(parse(&sheet, &file(&identity(), &settings)).unwrap() == settings);
        assert!(settings.iter().all(|setting| !setting.changed()));
    }

    #[test]
    fn a_file_that_was_cut_off_anywhere_is_refused_in_one_line() {
        let sheet = Sheet::own().unwrap();
        let text = file(&identity(), &defaults(&sheet));
        let body = text.find("[gap]").unwrap();
        // The last line may lose its unit, which is a remark.
        let last = text.trim_end().rfind('\n').unwrap();
        for end in (body..last).step_by(7) {
            let error = parse(&sheet, &text[..end]).unwrap_err();
            assert!(!error.contains('\n') && !error.is_empty(), "{error}");
        }
    }

    #[test]
    fn what_is_wrong_in_a_file_is_named_with_what_is_allowed() {
        let sheet = Sheet::own().unwrap();
        for (text, part) in [
            ("[gap]\nsetpoint_v = 0", "gap.setpoint_v = 0: must be a number from 1 to 300 V"),
            ("[gap]\nsetpoint = 50", "did you mean gap.setpoint_v?"),
            ("[gap]\naverage = \"none\"", "must be plain, gated"),
            ("setpoint_v = 50", "must be in a [group]"),
            ("[gap]\nsetpoint_v = ", "line 2: "),
            ("[file]\nrevision = 9", "revision 9, must be "),
            ("[file]\nsettings = 3\n[gap]\nsetpoint_v = 50", "1 of 3 settings"),
            ("", "no setting in the file"),
            ("[commission]\npassed = true", "only the head sets it"),
        ] {
            let error = parse(&sheet, text).unwrap_err();
            assert!(error.contains(part), "{text:?}: {error}");
        }
        let assigned = assignments(&sheet, &["gap.setpoint_v=55".into(), "gap.average = gated".into()]).unwrap();
        assert_eq!(assigned.len(), 2);
        assert!(assignments(&sheet, &["gap.setpoint_v".into()]).unwrap_err().contains("must be KEY=VALUE"));
    }
}

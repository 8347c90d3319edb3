//! A technology table in a head: written, checked and taken into use there. The head runs its rows.

use crate::Failure;
use crate::head::{Head, at};
use crate::sdo::Address;
use edm_servo_head::settings::Settings;
use edm_technology::{File, Row, setting};
use serde::Serialize;
use std::time::{Duration, Instant};

/// States of 201Ch:6.
mod state {
    pub const CHECKS: i64 = 1;
    pub const READY: i64 = 2;
    pub const WAITS: i64 = 4;
    pub const DONE: i64 = 6;
    pub const UNANSWERED: i64 = 8;
    pub const REFUSED: i64 = 9;
}

/// Of 201Ch:3: the row does not end deeper than the one before.
const NO_SETTING: i64 = 2;

/// Time that the check of a table may take: a millisecond a row.
const CHECKED: Duration = Duration::from_secs(1);

/// Longest wait of a head for the person who sets the generator, s: the most that it allows.
pub const PATIENCE_S: f32 = 3600.0;

/// The row under way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Now {
    /// Its number, from 1.
    pub number: usize,
    /// Rows of the table.
    pub of: usize,
    /// Its name.
    pub name: String,
    /// What the generator is to be set to, in words.
    pub generator: String,
    /// The head waits, pulses off, until that is done.
    pub waits: bool,
}

/// A row as a program reads it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// Its name.
    pub name: String,
    /// It ends so far above the depth of the hole, um.
    pub leaves_um: f64,
    /// The electrode is so much smaller than the hole, a side, um.
    pub undersize_um: Option<f64>,
    /// What the generator is to be set to.
    pub generator: String,
    /// Settings of the head.
    pub settings: Vec<String>,
}

impl From<&Row> for Line {
    fn from(row: &Row) -> Line {
        let Row { name, leaves_um, undersize_um, generator, settings, .. } = row;
        Line {
            name: name.clone(),
            leaves_um: *leaves_um,
            undersize_um: *undersize_um,
            generator: generator.clone(),
            settings: settings.iter().map(setting).collect(),
        }
    }
}

/// Reads a table, and checks it with the defaults of a head.
///
/// # Errors
/// The first thing that is wrong with it, and what is allowed.
pub fn parse(text: &str) -> Result<File, String> {
    let file = File::parse(text)?;
    file.check(&Settings::default())?;
    Ok(file)
}

/// Takes what table a head has out of use.
///
/// # Errors
/// Those of the transfers.
pub fn clear(head: &Head) -> Result<(), Failure> {
    Ok(head.set(at::TABLE_USE, 0)?)
}

/// Has a head take a table into use.
///
/// # Errors
/// The row that it refuses, the setting and the rule.
pub fn load(head: &Head, table: &File) -> Result<(), Failure> {
    for write in table.writes() {
        head.set(at::technology(write.sub), write.value.into())?;
    }
    head.set(at::TABLE_USE, 1)?;
    let end = Instant::now() + CHECKED;
    while head.whole(at::TABLE_STATE)? == state::CHECKS && Instant::now() < end {}
    if head.whole(at::TABLE_STATE)? == state::READY {
        return Ok(());
    }
    let [_, row] = at::TABLE_REFUSED;
    let row = table.rows.get((head.whole(row)? - 1).max(0) as usize);
    let (name, line) = row.map_or(("", 1), |row| (row.name.as_str(), row.line));
    Err(Failure::BadInput(format!("table line {line}: row {name:?}: {}", refused(head)?)))
}

/// Why the head has refused it, in words.
fn refused(head: &Head) -> Result<String, Failure> {
    let [why, _] = at::TABLE_REFUSED;
    let why = head.whole(why)?;
    if why == NO_SETTING {
        return Ok("must leave less than the row before".into());
    }
    let setting = head.whole(at::REFUSED_SETTING)? as u32;
    let object = head.sheet.get(Address((setting >> 8) as u16, setting as u8));
    let (key, allowed) = object.map_or_else(Default::default, |object| (object.key.clone(), object.allowed()));
    let rule = String::from_utf8_lossy(&head.sdo.read(at::REFUSED_RULE)?).into_owned();
    Ok(if rule.is_empty() { format!("{key}: must be {allowed}") } else { format!("{key} {rule}") })
}

/// The row under way; `None` before the first and after the last.
///
/// # Errors
/// Those of the transfers; an erosion that a row has ended.
pub fn now(head: &Head, table: &File) -> Result<Option<Now>, Failure> {
    let number = head.whole(at::TABLE_ROW)? as usize;
    let row = number.checked_sub(1).and_then(|place| table.rows.get(place));
    let name = row.map_or(String::new(), |row| row.name.clone());
    let why = match head.whole(at::TABLE_STATE)? {
        state::UNANSWERED => "the generator was not set within technology.answer_s",
        state::REFUSED => "its settings contradict those that were changed since",
        state::READY | state::DONE => return Ok(None),
        at => {
            let generator = row.map_or(String::new(), |row| row.generator.clone());
            let waits = at == state::WAITS;
            return Ok((number > 0).then_some(Now { number, of: table.rows.len(), name, generator, waits }));
        }
    };
    Err(Failure::Failed(format!("row {name:?}: {why}")))
}

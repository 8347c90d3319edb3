//! The head's own scope (2010h): up to four signals, 256 samples, one a millisecond or slower, from a trigger on. Samples before the
//! trigger are not kept.

use crate::Failure;
use crate::head::{Head, Tick};
use crate::sdo::Address;
use crate::sheet::{Kind, Object, Sheet};
use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::time::{Duration, Instant};

/// Signals that it has.
pub const SIGNALS: usize = 4;
/// Samples of a record.
pub const SAMPLES: u16 = 256;
/// Polling period of its state.
const LOOK: Duration = Duration::from_millis(10);

/// 2010h.
mod at {
    use super::Address;
    pub const SIGNAL: [Address; super::SIGNALS] =
        [Address(0x2010, 1), Address(0x2010, 2), Address(0x2010, 3), Address(0x2010, 4)];
    pub const EVERY: Address = Address(0x2010, 5);
    pub const TRIGGER: Address = Address(0x2010, 6);
    pub const LEVEL: Address = Address(0x2010, 7);
    pub const ARM: Address = Address(0x2010, 8);
    pub const STATE: Address = Address(0x2010, 9);
    pub const DATA: Address = Address(0x2010, 11);
}

/// 2010h:9.
const FULL: i64 = 3;

/// What begins a record; the number is that of 2010h:6.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Trigger {
    /// At once.
    #[default]
    Now = 0,
    /// The first signal rises to the level.
    Rises = 1,
    /// The first signal falls to the level.
    Falls = 2,
    /// The first signal changes.
    Changes = 3,
}

impl Trigger {
    fn text(self) -> &'static str {
        match self {
            Trigger::Now => "at once",
            Trigger::Rises => "level, rising",
            Trigger::Falls => "level, falling",
            Trigger::Changes => "change",
        }
    }
}

/// What is to be recorded.
#[derive(Clone, Debug, Deserialize)]
pub struct Plan {
    /// Addresses, as 2005:1.
    pub signals: Vec<String>,
    /// Time from one sample to the next, ms.
    #[serde(default = "every")]
    pub every_ms: u16,
    /// What begins it.
    #[serde(default)]
    pub trigger: Trigger,
    /// In the unit of the first signal.
    #[serde(default)]
    pub level: f64,
    /// How long to wait for the trigger, s.
    pub wait_s: f64,
}

/// Default of [`Plan::every_ms`].
pub const fn every() -> u16 {
    1
}

/// One signal of a record.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Signal {
    /// Its name.
    pub key: String,
    /// Unit; empty for none.
    pub unit: String,
    /// One value a sample.
    pub values: Vec<f64>,
}

/// What was recorded.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Record {
    /// Time from one sample to the next, ms.
    pub every_ms: f64,
    /// Samples from before the trigger.
    pub before: usize,
    /// What has begun it.
    pub begun: String,
    /// The requested signals.
    pub signals: Vec<Signal>,
}

impl Plan {
    /// The objects to record.
    ///
    /// # Errors
    /// The first thing that cannot be, and what is allowed.
    pub fn check<'a>(&self, sheet: &'a Sheet) -> Result<Vec<&'a Object>, Failure> {
        let refused = |why: String| Err(Failure::BadInput(why));
        if !(1..=SIGNALS).contains(&self.signals.len()) {
            return refused(format!("{} signals: must be 1 to {SIGNALS}", self.signals.len()));
        }
        let mut objects = Vec::new();
        for text in &self.signals {
            let object = sheet.named(text).map_err(|why| match crate::fast::like(text) {
                Some(signal) if !text.contains('.') => {
                    Failure::BadInput(format!("{text}: no such signal, did you mean {signal}?"))
                }
                _ => Failure::BadInput(why),
            })?;
            if !records(object) {
                return refused(format!("{text}: must be an object with a number of up to 32 bits"));
            }
            objects.push(object);
        }
        if let Some(range) = sheet.get(at::EVERY).and_then(|object| object.range)
            && !(range.0..=range.1).contains(&self.every_ms.into())
        {
            return refused(format!("sample period {} ms: must be {} to {} ms", self.every_ms, range.0, range.1));
        }
        if !(0.0..=86_400.0).contains(&self.wait_s) {
            return refused(format!("wait {} s: must be a number from 0 to 86400", self.wait_s));
        }
        let levelled = matches!(self.trigger, Trigger::Rises | Trigger::Falls);
        if levelled && objects.first().is_none_or(|first| self.raw(first).is_none()) {
            return refused(format!(
                "level {}: must be a value that the first signal, a whole number, can have",
                self.level
            ));
        }
        Ok(objects)
    }

    /// The level as the head compares it.
    fn raw(&self, first: &Object) -> Option<i32> {
        let raw = (self.level / first.factor).round();
        let fits = matches!(first.kind, Kind::Whole(..)) && (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&raw);
        fits.then_some(raw as i32)
    }

    /// Records.
    ///
    /// # Errors
    /// When it cannot be, the head refuses, or the trigger does not come.
    pub fn record(&self, head: &Head, tick: Tick<'_>) -> Result<Record, Failure> {
        let objects = self.check(&head.sheet)?;
        head.set(at::ARM, 0)?;
        for (place, address) in at::SIGNAL.into_iter().enumerate() {
            let signal =
                objects.get(place).map_or(0, |object| i64::from(object.address.0) << 8 | i64::from(object.address.1));
            head.set(address, signal)?;
        }
        head.set(at::EVERY, self.every_ms.into())?;
        head.set(at::TRIGGER, self.trigger as i64)?;
        head.set(at::LEVEL, objects.first().and_then(|first| self.raw(first)).unwrap_or_default().into())?;
        head.set(at::ARM, 1)?;
        let record = Duration::from_millis(u64::from(self.every_ms) * u64::from(SAMPLES));
        let end = Instant::now() + Duration::from_secs_f64(self.wait_s) + record;
        let mut full = false;
        while !full && Instant::now() < end {
            tick()?;
            std::thread::sleep(LOOK);
            full = head.whole(at::STATE)? == FULL;
        }
        if !full {
            head.set(at::ARM, 0)?;
            let wait = self.wait_s;
            return Err(Failure::Failed(format!("no trigger within {wait} s, or the record was not full in time")));
        }
        let data = head.sdo.read_block(at::DATA)?;
        let (samples, _) = data.as_chunks::<{ 4 * SIGNALS }>();
        let signal = |(place, object): (usize, &&Object)| Signal {
            key: object.key.clone(),
            unit: object.unit.clone(),
            values: samples.iter().filter_map(|sample| object.number(sample.get(4 * place..)?)).collect(),
        };
        let every_ms = self.every_ms.into();
        let begun = self.trigger.text().to_owned();
        Ok(Record { every_ms, before: 0, begun, signals: objects.iter().enumerate().map(signal).collect() })
    }
}

/// Whether the scope can record it.
pub fn records(object: &Object) -> bool {
    matches!(object.kind, Kind::Flag | Kind::Real) || matches!(object.kind, Kind::Whole(size, _) if size <= 4)
}

impl Record {
    /// As a table: time from the trigger, ms, and the signals, with their units in the first line.
    pub fn csv(&self) -> String {
        let named = |signal: &Signal| {
            let name = match signal.unit.as_str() {
                "" => signal.key.clone(),
                unit => format!("{} [{unit}]", signal.key),
            };
            if name.contains(',') { format!("\"{name}\"") } else { name }
        };
        let mut text = String::from("time [ms]");
        // A string takes everything; so it does below.
        self.signals.iter().for_each(|signal| {
            let _ = write!(text, ",{}", named(signal));
        });
        let count = self.signals.first().map_or(0, |signal| signal.values.len());
        for place in 0..count {
            // Whole servo ticks.
            let ms = ((place as f64 - self.before as f64) * self.every_ms * 100.0).round() / 100.0;
            let _ = write!(text, "\n{ms}");
            for signal in &self.signals {
                let _ = signal.values.get(place).map(|value| write!(text, ",{value}"));
            }
        }
        text + "\n"
    }

    /// Of such a table.
    ///
    /// # Errors
    /// The first line that is none of it, and what it must be.
    pub fn from_csv(text: &str) -> Result<Record, String> {
        let mut lines = text.lines();
        // A name with a comma is quoted.
        let mut quoted = false;
        let names: Vec<String> = lines
            .next()
            .unwrap_or_default()
            .split(|letter| {
                quoted ^= letter == '"';
                letter == ',' && !quoted
            })
            .map(|name| name.replace('"', ""))
            .collect();
        let [time, names @ ..] = names.as_slice() else { return Err("is empty".into()) };
        if time != "time [ms]" || names.is_empty() {
            return Err("must begin with time [ms] and the names of signals".into());
        }
        let named = |name: &String| match name.strip_suffix(']').and_then(|name| name.rsplit_once(" [")) {
            Some((key, unit)) => Signal { key: key.into(), unit: unit.into(), values: Vec::new() },
            None => Signal { key: name.clone(), unit: String::new(), values: Vec::new() },
        };
        let (mut signals, mut times): (Vec<Signal>, _) = (names.iter().map(named).collect(), Vec::new());
        for (number, line) in lines.enumerate() {
            let row: Option<Vec<f64>> =
                line.split(',').map(|text| text.parse().ok().filter(|x: &f64| x.is_finite())).collect();
            let row = row.filter(|row| row.len() == signals.len() + 1);
            let Some([time, values @ ..]) = row.as_deref() else {
                return Err(format!("line {}: must have {} numbers", number + 2, signals.len() + 1));
            };
            times.push(*time);
            signals.iter_mut().zip(values).for_each(|(signal, value)| signal.values.push(*value));
        }
        let [first, .., last] = times.as_slice() else { return Err("must have two samples or more".into()) };
        let every_ms = (last - first) / (times.len() - 1) as f64;
        let before = times.iter().filter(|time| **time < 0.0).count();
        Ok(Record { every_ms: (every_ms * 100.0).round() / 100.0, before, begun: "not in the file".into(), signals })
    }

    /// What there is, in a line a signal.
    pub fn text(&self) -> String {
        let line = |signal: &Signal| {
            let Signal { key, unit, values } = signal;
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            format!(
                "{key:32} {low} to {high} {unit}, mean {mean:.3}, {} samples every {} ms\n",
                values.len(),
                self.every_ms
            )
        };
        let lines: String = self.signals.iter().map(line).collect();
        format!("{lines}trigger: {}, {} samples before it\n", self.begun, self.before)
    }
}

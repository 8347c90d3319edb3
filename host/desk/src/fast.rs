//! The scope of the servo tick (2019h): up to eight signals by name, one sample every 50 us or slower, with samples from before the
//! trigger, on one head or several; and the snapshot that a head takes of each fault.

use crate::Failure;
use crate::head::{Head, Tick};
use crate::scope::{Record, Signal};
use crate::sdo::Address;
use crate::words;
use clap::ValueEnum;
use edm_servo_head::scope::{SIGNAL_TEXTS, SIGNALS, STREAM_HEADER};
use serde::Deserialize;
use std::time::{Duration, Instant};

/// Polling period of the state.
const LOOK: Duration = Duration::from_millis(10);
/// A servo tick, ms.
const TICK_MS: f64 = 0.05;
/// Samples of a record of all signals.
const SAMPLES: usize = 512;

/// 2019h.
mod at {
    use super::Address;
    pub const fn signal(place: usize) -> Address {
        Address(0x2019, 1 + place as u8)
    }
    pub const EVERY: Address = Address(0x2019, 9);
    pub const TRIGGER: Address = Address(0x2019, 10);
    pub const SOURCE: Address = Address(0x2019, 11);
    pub const LEVEL: Address = Address(0x2019, 12);
    pub const BEFORE: Address = Address(0x2019, 13);
    pub const ARM: Address = Address(0x2019, 14);
    pub const STATE: Address = Address(0x2019, 15);
    pub const DATA: Address = Address(0x2019, 16);
    pub const SNAPSHOTS: Address = Address(0x2019, 17);
    pub const SNAPSHOT: Address = Address(0x2019, 18);
}

/// 2019h:15.
const COMPLETE: i64 = 3;
/// Mark and version of a record.
const MAGIC: u32 = 0x4353_0001;

/// What begins a record; the number is that of 2019h:10.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Trigger {
    /// At once.
    #[default]
    Now = 0,
    /// A signal rises to the level.
    Rises = 1,
    /// A signal falls to the level.
    Falls = 2,
    /// The state changes.
    State = 3,
    /// A fault.
    Fault = 4,
    /// A short retreats.
    Short = 5,
}

/// What has begun a record, by the number in it.
const CAUSES: [&str; 7] =
    ["stopped", "at once", "level, rising", "level, falling", "change of state", "fault", "short"];

/// A row of the table of signals.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row {
    number: u8,
    name: &'static str,
    factor: f64,
    unit: &'static str,
}

fn rows() -> impl Iterator<Item = Row> {
    SIGNAL_TEXTS.iter().map(|&(number, name, factor, unit, _)| Row { number, name, factor, unit })
}

impl Row {
    /// Value of a step and unit: lengths along the axis in mm, the following error in um.
    fn scaled(&self, counts_per_mm: f64) -> (f64, &'static str) {
        match self.unit {
            "counts" if self.name == "following_error" => (1000.0 * self.factor / counts_per_mm, "um"),
            "counts" => (self.factor / counts_per_mm, "mm"),
            "counts/s" => (self.factor / counts_per_mm, "mm/s"),
            unit => (self.factor, unit),
        }
    }
}

/// Every signal: name, unit, what it is.
pub fn signals() -> impl Iterator<Item = (&'static str, &'static str, &'static str)> {
    SIGNAL_TEXTS.iter().zip(rows()).map(|(text, row)| (row.name, row.scaled(1.0).1, text.4))
}

/// The signal of the servo tick that is spelled like this.
pub fn like(text: &str) -> Option<&'static str> {
    let near = |name: &&str| (1e3 * strsim::jaro(name, &text.to_lowercase())) as u32;
    rows().map(|row| row.name).filter(|name| near(name) > 850).max_by_key(near)
}

/// Whether this names a signal of the servo tick.
pub fn has(name: &str) -> bool {
    rows().any(|row| row.name == name)
}

/// What is to be recorded.
#[derive(Clone, Debug, Deserialize)]
pub struct Plan {
    /// Names.
    pub signals: Vec<String>,
    /// Time from one sample to the next, ms.
    #[serde(default = "every")]
    pub every_ms: f64,
    /// What begins it.
    #[serde(default)]
    pub trigger: Trigger,
    /// Which signal is compared with the level; the first if none is named.
    #[serde(default)]
    pub of: Option<String>,
    /// In the unit of that signal.
    #[serde(default)]
    pub level: f64,
    /// Share from before the trigger, percent.
    #[serde(default = "before")]
    pub before: f64,
    /// How long to wait for the trigger, s.
    pub wait_s: f64,
}

/// Default of [`Plan::every_ms`].
pub const fn every() -> f64 {
    TICK_MS
}

/// Default of [`Plan::before`].
pub const fn before() -> f64 {
    50.0
}

impl Plan {
    fn rows(&self) -> Result<Vec<Row>, Failure> {
        let refused = |why: String| Err(Failure::BadInput(why));
        if !(1..=SIGNALS).contains(&self.signals.len()) {
            return refused(format!("{} signals: must be 1 to {SIGNALS}", self.signals.len()));
        }
        let mut found = Vec::new();
        for name in &self.signals {
            let Some(row) = rows().find(|row| row.name == name) else {
                let all: Vec<&str> = rows().map(|row| row.name).collect();
                return refused(format!("{name}: must be one of {}", all.join(", ")));
            };
            found.push(row);
        }
        Ok(found)
    }

    /// Place of the signal that is compared with the level.
    fn source(&self, rows: &[Row]) -> Result<usize, Failure> {
        let Some(name) = &self.of else { return Ok(0) };
        rows.iter()
            .position(|row| row.name == name)
            .ok_or_else(|| Failure::BadInput(format!("trigger on {name}: must be one of the recorded signals")))
    }

    /// Servo ticks from one sample to the next.
    fn ticks(&self) -> i64 {
        (self.every_ms / TICK_MS).round() as i64
    }

    /// Finds what cannot be, without a head.
    ///
    /// # Errors
    /// The first thing that cannot be, and what is allowed.
    pub fn check(&self) -> Result<(), Failure> {
        let refused = |why: String| Err(Failure::BadInput(why));
        let rows = self.rows()?;
        self.source(&rows)?;
        let ticks = self.every_ms / TICK_MS;
        if !(0.999..=20_000.001).contains(&ticks) || (ticks - ticks.round()).abs() > 1e-3 {
            return refused(format!(
                "sample period {} ms: must be a multiple of 0.05 ms from 0.05 to 1000 ms",
                self.every_ms
            ));
        }
        if !(0.0..=100.0).contains(&self.before) {
            return refused(format!("{} % before the trigger: must be 0 to 100 %", self.before));
        }
        if !(0.0..=86_400.0).contains(&self.wait_s) {
            return refused(format!("wait {} s: must be a number from 0 to 86400", self.wait_s));
        }
        if !self.level.is_finite() {
            return refused(format!("level {}: must be a number", self.level));
        }
        Ok(())
    }

    fn arm(&self, head: &Head, rows: &[Row]) -> Result<(), Failure> {
        let source = self.source(rows)?;
        let per_mm = head.counts_per_mm()?;
        let (step, unit) = rows.get(source).map_or((1.0, ""), |row| row.scaled(per_mm));
        let level = (self.level / step).round();
        if !(f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&level) {
            return Err(Failure::BadInput(format!("level {} {unit}: is more than the signal can be", self.level)));
        }
        for place in 0..SIGNALS {
            head.set(at::signal(place), rows.get(place).map_or(0, |row| row.number.into()))?;
        }
        head.set(at::EVERY, self.ticks())?;
        head.set(at::TRIGGER, self.trigger as i64)?;
        head.set(at::SOURCE, source as i64 + 1)?;
        head.set(at::LEVEL, level as i64)?;
        head.set(at::BEFORE, self.before.round() as i64)?;
        Ok(head.set(at::ARM, 1)?)
    }

    /// Records on all heads; each waits for its own trigger.
    ///
    /// # Errors
    /// When it cannot be, a head refuses, or the trigger does not come.
    pub fn record(&self, heads: &[Head], tick: Tick<'_>) -> Result<Record, Failure> {
        self.check()?;
        let rows = self.rows()?;
        for head in heads {
            self.arm(head, &rows)?;
        }
        let ring = SAMPLES * SIGNALS / rows.len();
        let end = Instant::now() + Duration::from_secs_f64(self.wait_s + 1e-3 * self.every_ms * ring as f64 + 0.1);
        let mut records = Vec::new();
        for head in heads {
            while head.whole(at::STATE)? != COMPLETE {
                let over = Instant::now() > end;
                let ended = tick();
                if over || ended.is_err() {
                    heads.iter().try_for_each(|head| head.set(at::ARM, 0))?;
                    ended?;
                    let wait = self.wait_s;
                    return Err(Failure::Failed(format!("node {}: no trigger within {wait} s", head.node)));
                }
                std::thread::sleep(LOOK);
            }
        }
        for head in heads {
            records.push(read(head, at::DATA)?.ok_or_else(|| Failure::Failed("the record is gone".into()))?);
        }
        Ok(side_by_side(heads, records))
    }
}

/// The record that a head has, complete since it was armed; through a reset as well.
///
/// # Errors
/// Those of the transfer.
pub fn last(head: &Head) -> Result<Option<Record>, Failure> {
    read(head, at::DATA)
}

/// The snapshot of the last fault, if there is one.
///
/// # Errors
/// Those of the transfer.
pub fn snapshot(head: &Head) -> Result<Option<Record>, Failure> {
    loop {
        let number = head.whole(at::SNAPSHOTS)?;
        let record = read(head, at::SNAPSHOT)?;
        // Another fault may have come meanwhile.
        if head.whole(at::SNAPSHOTS)? == number {
            return Ok(record);
        }
    }
}

fn read(head: &Head, data: Address) -> Result<Option<Record>, Failure> {
    let bytes = head.sdo.read_block(data)?;
    if bytes.is_empty() {
        return Ok(None);
    }
    let garbled =
        || Failure::Failed(format!("node {}: {data} is no record of the scope as this program knows it", head.node));
    decode(&bytes, head.counts_per_mm()?).map(Some).ok_or_else(garbled)
}

/// A record as the head gives it.
fn decode(bytes: &[u8], counts_per_mm: f64) -> Option<Record> {
    let words: Vec<u32> = bytes.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
    let (&[magic, what, low, high, ticks, count, trigger, _], data) = words.split_first_chunk::<STREAM_HEADER>()?;
    let [width, cause, fault, _] = what.to_le_bytes();
    let numbers: Vec<u8> = [low, high].iter().flat_map(|word| word.to_le_bytes()).take(width.into()).collect();
    if magic != MAGIC || data.len() != count as usize * usize::from(width) || width == 0 {
        return None;
    }
    let signal = |(place, number): (usize, &u8)| {
        let known = rows().find(|row| row.number == *number);
        let (step, unit) = known.map_or((1.0, ""), |row| row.scaled(counts_per_mm));
        Signal {
            key: known.map_or_else(|| format!("signal {number}"), |row| row.name.to_owned()),
            unit: unit.to_owned(),
            values: data
                .iter()
                .skip(place)
                .step_by(width.into())
                .map(|word| rounded(f64::from(word.cast_signed()) * step))
                .collect(),
        }
    };
    let begun = CAUSES.get(usize::from(cause)).map_or_else(|| format!("cause {cause}"), |text| (*text).to_owned());
    let begun = words::fault(fault).map_or(begun.clone(), |fault| format!("{begun}: {}", fault.name()));
    Some(Record {
        every_ms: rounded(f64::from(ticks) * TICK_MS),
        before: trigger as usize,
        begun,
        signals: numbers.iter().enumerate().map(signal).collect(),
    })
}

/// Nine digits: what steps are computed with is no more exact.
fn rounded(value: f64) -> f64 {
    format!("{value:.8e}").parse().unwrap_or(value)
}

/// Records of several heads as one, each at its trigger: what all of them have.
fn side_by_side(heads: &[Head], mut records: Vec<Record>) -> Record {
    if records.len() < 2 {
        return records.pop().unwrap_or_default();
    }
    let samples = |record: &Record| record.signals.first().map_or(0, |signal| signal.values.len());
    let before = records.iter().map(|record| record.before).min().unwrap_or_default();
    let after = records.iter().map(|record| samples(record) - record.before).min().unwrap_or_default();
    let every_ms = records.first().map_or(TICK_MS, |record| record.every_ms);
    let begun: Vec<String> =
        heads.iter().zip(&records).map(|(head, record)| format!("node {}: {}", head.node, record.begun)).collect();
    let signals = heads.iter().zip(records).flat_map(|(head, record)| {
        let first = record.before - before;
        record.signals.into_iter().map(move |signal| Signal {
            key: format!("node {} {}", head.node, signal.key),
            values: signal.values[first..first + before + after].to_vec(),
            unit: signal.unit,
        })
    });
    let signals = signals.collect();
    Record { every_ms, before, begun: begun.join("; "), signals }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(words: &[u32]) -> Vec<u8> {
        words.iter().flat_map(|word| word.to_le_bytes()).collect()
    }

    #[test]
    fn a_record_is_read_in_units_and_what_is_none_is_not() {
        // Position in counts of 1 um, gap voltage; two samples a tick apart, the second that of the fault.
        let words =
            [MAGIC, 2 | 5 << 8 | 15 << 16, 1 | 7 << 8, 0, 1, 2, 1, 77, (-1500i32).cast_unsigned(), 6500, 250, 0];
        let read = decode(&record(&words), 1000.0).unwrap();
        assert_eq!((read.every_ms, read.before), (0.05, 1));
        assert!(read.begun.starts_with("fault: "), "{}", read.begun);
        assert_eq!(read.signals[0], Signal { key: "position".into(), unit: "mm".into(), values: vec![-1.5, 0.25] });
        assert_eq!(read.signals[1], Signal { key: "gap_voltage".into(), unit: "V".into(), values: vec![65.0, 0.0] });
        assert_eq!(read.csv(), "time [ms],position [mm],gap_voltage [V]\n-0.05,-1.5,65\n0,0.25,0\n");
        for (at, wrong) in [(0, 1), (1, 0), (1, 3), (5, 3)] {
            let mut words = words;
            words[at] = wrong;
            assert_eq!(decode(&record(&words), 1000.0), None, "word {at}");
        }
        assert_eq!(decode(&[0; 31], 1000.0), None);
    }

    #[test]
    fn what_cannot_be_recorded_says_what_can() {
        let plan = Plan {
            signals: vec!["position".into()],
            every_ms: 0.05,
            trigger: Trigger::Now,
            of: None,
            level: 0.0,
            before: 50.0,
            wait_s: 1.0,
        };
        plan.check().unwrap();
        for (wrong, part) in [
            (
                Plan { signals: vec!["posision".into()], ..plan.clone() },
                "posision: must be one of position, set_point,",
            ),
            (Plan { signals: vec!["position".into(); 9], ..plan.clone() }, "9 signals: must be 1 to 8"),
            (Plan { every_ms: 0.07, ..plan.clone() }, "sample period 0.07 ms: must be a multiple of 0.05 ms"),
            (Plan { every_ms: 2000.0, ..plan.clone() }, "sample period 2000 ms"),
            (Plan { before: 101.0, ..plan.clone() }, "101 % before the trigger: must be 0 to 100 %"),
            (Plan { of: Some("duty".into()), ..plan.clone() }, "trigger on duty: must be one of the recorded signals"),
            (Plan { wait_s: -1.0, ..plan.clone() }, "wait -1 s"),
        ] {
            let why = wrong.check().unwrap_err().to_string();
            assert!(why.contains(part), "{why}");
        }
    }
}

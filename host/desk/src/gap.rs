//! The gap as the head sees it: voltages from open circuit to short, classes of pulses, what the pulses say of the gap, requested feed.
//!
//! A quantity without meaning has no value: the voltage without pulses, shares without a sample, the open-circuit voltage before
//! a seek has measured it.

use crate::Failure;
use crate::head::{Head, at, state};
use crate::sdo::{Address, SdoError};
use crate::sheet::Object;
use edm_servo_head::gap::senses::delays::{BINS, upper};
use edm_servo_head::units::CLOCK_HZ;
use serde::Serialize;
use std::time::{Duration, Instant};

/// Qualities (2005h:3) of a voltage that means something: valid, at the end of the range, reversed.
pub const MEASURED: [i64; 3] = [1, 3, 4];
/// What to do where the levels of the settings are not those of the pulses, by 2013h:16 from 2 on.
const TEACH: [&str; 4] = [
    "The levels do not fit this generator. Pulses are told by what the head has learned of sparks; pauses and the reflex go by the settings. Teach them: \
     write 1 to 2013h:1, erode, and apply with 2; or set gap.open_v, gap.spark_v, gap.arc_below_v and gap.short_v.",
    "Open pulses and sparks differ from their levels by one share: the divider of the gap voltage is another one. Correct gap.volts_per_code.",
    "Open pulses differ from gap.open_v, sparks do not differ from gap.spark_v: the generator has another supply. Set gap.open_v.",
    "Sparks burn above 0.55 of the open circuit: the comparator cannot tell them from it. Raise the open-circuit voltage of the generator.",
];
/// Classes of pulses: shares in 200Fh:1 to 6, half percents.
const CLASSES: u16 = 0x200F;
/// Counts of the same classes, 2012h:11 to 15, in the order of [`NAMES`].
const COUNTS: Address = Address(0x2012, 11);
const NAMES: [&str; 5] = ["open", "spark", "arc", "short", "uncertain"];
/// Of those: the share of the milliseconds without a pulse.
const NO_PULSE: u8 = 5;
/// Ignition delays are taken so often: fewer have too few counts to see their distribution.
const TAKEN_EVERY: Duration = Duration::from_secs(1);
/// Share of arcs and shorts from which a gap that sparks is said to have them, %. Assumed: twice what the verdict on a bore allows
/// over a whole run, since a share of 0.2 s sways.
const SPOILT: f64 = 10.0;

/// What the head senses of the gap, 2012h.
mod sensed {
    use super::Address;
    pub const ERROR: Address = Address(0x2012, 1);
    pub const HAZARD: Address = Address(0x2012, 2);
    pub const DEVIATION: Address = Address(0x2012, 3);
    pub const DISTANCE: Address = Address(0x2012, 4);
    pub const DISTANCE_VALIDITY: Address = Address(0x2012, 5);
    pub const FREQUENCY: Address = Address(0x2012, 6);
    pub const MISSING: Address = Address(0x2012, 7);
    pub const AGE: Address = Address(0x2012, 8);
    pub const NOTCH: Address = Address(0x2012, 9);
    pub const FOLLOWS: Address = Address(0x2012, 10);
    pub const TAKE: Address = Address(0x2012, 16);
    pub const DELAYS: Address = Address(0x2012, 17);
}

/// Pulse age (2012h:8) that is longer than can be counted, ms.
const NO_AGE: f64 = 65_535.0;

/// A voltage to compare with.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rung {
    /// Which.
    pub what: &'static str,
    /// V; nothing where it is not known.
    pub volts: Option<f64>,
    /// Where it is from.
    pub from: &'static str,
}

/// Share of a pulse class in all pulses since the last look; at the first one, of the last 0.2 s.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Share {
    /// Which kind.
    pub what: String,
    /// None where there was no pulse.
    pub percent: Option<f64>,
}

/// What the pulses of late say of the gap; a quantity that is not known has no value.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Senses {
    /// Ignitions a second of waiting.
    pub hazard_per_s: Option<f64>,
    /// Its standard deviation.
    pub hazard_deviation_per_s: Option<f64>,
    /// Gap by charging time, um.
    pub distance_um: Option<f64>,
    /// The distance is beyond what was calibrated, and the nearest end of it.
    pub distance_beyond: bool,
    /// Sparks a second.
    pub sparks_per_s: Option<f64>,
    /// No spark for much longer than their mean period.
    pub sparks_missing: bool,
    /// Time since the newest pulse, ms.
    pub pulse_age_ms: Option<f64>,
    /// Frequency of the notch, Hz.
    pub notch_hz: f64,
    /// It follows the mains.
    pub notch_follows: bool,
}

/// The quantity that is kept.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Controlled {
    /// `gap.controlled`.
    pub what: String,
    /// Value that is kept, in its unit.
    pub setpoint: f64,
    /// Value now.
    pub now: Option<f64>,
    /// Unit of both.
    pub unit: String,
    /// Gap error that the feed law acts on, V; positive in a wide gap. Not of the same instant as `now`.
    pub error_v: Option<f64>,
}

/// Ignition delays of a while.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Delays {
    /// How long they were counted, s.
    pub seconds: f64,
    /// Where each bin ends, us; the last one has no end.
    pub ends_us: Vec<Option<f64>>,
    /// Pulses in each bin.
    pub counts: Vec<u32>,
}

impl Delays {
    /// From what 2012h:17 holds.
    fn of(bytes: &[u8], seconds: f64) -> Option<Delays> {
        let (counts, []) = bytes.as_chunks() else { return None };
        let end = |bin| upper(bin).map(|cycles| f64::from(cycles) * 1e6 / f64::from(CLOCK_HZ));
        let counts: Vec<u32> = counts.iter().map(|count| u32::from_le_bytes(*count)).collect();
        (counts.len() == BINS).then(|| Delays { seconds, ends_us: (0..BINS).map(end).collect(), counts })
    }

    /// Pulses that ignited.
    pub fn total(&self) -> u64 {
        self.counts.iter().map(|count| u64::from(*count)).sum()
    }

    /// Half of the delays are shorter, us: the end of the bin in which that is so.
    pub fn median_us(&self) -> Option<f64> {
        let half = self.total().div_ceil(2);
        let mut sum = 0;
        let bin = self.counts.iter().position(|count| {
            sum += u64::from(*count);
            sum >= half && sum > 0
        })?;
        *self.ends_us.get(bin)?
    }
}

/// The gap now.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Gap {
    /// Node-ID.
    pub node: u8,
    /// State of the head, in words.
    pub state: String,
    /// Gap voltage after the filters, V.
    pub volts: Option<f64>,
    /// What that is worth, in words.
    pub quality: String,
    /// From open circuit to short.
    pub ladder: [Rung; 4],
    /// How it sparks, in words.
    pub verdict: String,
    /// That is as it should be; nothing without pulses.
    pub good: Option<bool>,
    /// What the pulses were.
    pub shares: Vec<Share>,
    /// Share of the milliseconds without a pulse, %.
    pub no_pulse_percent: f64,
    /// What is wrong with that, and what to do.
    pub levels: Option<&'static str>,
    /// Pulses, voltage and hazard were all measured in this look. A look at the end of the pulses counts pulses, but measures nothing.
    pub whole: bool,
    /// There were pulses.
    pub pulses: bool,
    /// How many since the last look; nothing at the first one.
    pub pulse_count: Option<u64>,
    /// Velocity along the path that the gap requests, um/s; none while it is not used.
    pub feed_um_s: Option<f64>,
    /// What the pulses say; nothing of a head that does not sense it (0.2.0).
    pub senses: Option<Senses>,
    /// What is kept.
    pub controlled: Option<Controlled>,
    /// Ignition delays of the last second.
    pub delays: Option<Delays>,
}

/// Looks at the gap of a head again and again.
pub struct Watch {
    head: Head,
    /// When the delays were taken last.
    taken: Option<Instant>,
    /// Of how many seconds the copy in the head is that was not read yet.
    copied: Option<f64>,
    /// Pulses of each class at the last look.
    counts: Option<[u32; NAMES.len()]>,
    slow: Option<(Instant, Slow)>,
    delays: Option<Delays>,
}

impl Watch {
    /// Begins to watch.
    pub fn new(head: &Head) -> Watch {
        Watch { head: head.clone(), taken: None, copied: None, counts: None, slow: None, delays: None }
    }

    /// Reads the gap, and every second what changes slowly and the ignition delays since the second before.
    ///
    /// # Errors
    /// Those of the transfers.
    pub fn look(&mut self) -> Result<Gap, Failure> {
        let slow = match self.slow.take() {
            Some((read, slow)) if read.elapsed() < TAKEN_EVERY => (read, slow),
            _ => (Instant::now(), Slow::look(&self.head)?),
        };
        let (_, slow) = self.slow.insert(slow);
        let counts = if slow.notch.is_some() { Some(counts(&self.head)?) } else { None };
        let last = std::mem::replace(&mut self.counts, counts);
        let new = counts.zip(last).and_then(|(now, last)| since(now, last));
        let mut gap = Gap::look(&self.head, slow, new)?;
        if gap.pulses && gap.senses.is_some() {
            self.take()?;
            gap.delays = self.delays.clone();
        } else {
            (self.taken, self.copied, self.delays) = (None, None, None);
        }
        Ok(gap)
    }

    fn take(&mut self) -> Result<(), Failure> {
        let late = self.taken.is_none_or(|last| last.elapsed() >= TAKEN_EVERY);
        if self.copied.is_none() && late {
            self.head.set(sensed::TAKE, 1)?;
            let last = self.taken.replace(Instant::now());
            // What came before the first time is of an unknown while.
            self.copied = last.map(|last| last.elapsed().as_secs_f64());
        }
        if let Some(seconds) = self.copied {
            match self.head.sdo.read_block(sensed::DELAYS) {
                Ok(bytes) => (self.delays, self.copied) = (Delays::of(&bytes, seconds), None),
                // Another program that talks to the head has ended the transfer: the copy is still there at the next look.
                Err(SdoError::Garbled(..) | SdoError::Refused(..)) => {}
                Err(silent) => return Err(silent.into()),
            }
        }
        Ok(())
    }
}

/// A number in its unit; nothing where the head or its description file has no such object.
fn number(head: &Head, address: Address) -> Result<Option<f64>, Failure> {
    if head.sheet.get(address).is_none() {
        return Ok(None);
    }
    match head.number(address) {
        Err(SdoError::Refused(..)) => Ok(None),
        number => Ok(Some(number?)),
    }
}

/// Pulses of each class since power-on.
fn counts(head: &Head) -> Result<[u32; NAMES.len()], Failure> {
    let mut counts = [0; NAMES.len()];
    for (count, sub) in counts.iter_mut().zip(COUNTS.1..) {
        *count = head.whole(Address(COUNTS.0, sub))? as u32;
    }
    Ok(counts)
}

/// Pulses of each class since earlier counts; nothing where the head has begun to count anew. They are read one after the other, and
/// each of them over the same time: their shares are of that many pulses, and make 100 %.
fn since(now: [u32; NAMES.len()], last: [u32; NAMES.len()]) -> Option<[u32; NAMES.len()]> {
    let new: [u32; NAMES.len()] = std::array::from_fn(|class| now[class].wrapping_sub(last[class]));
    new.iter().all(|count| *count < 1 << 31).then_some(new)
}

/// What changes slowly: it is read once a second, so that other transfers find room.
#[derive(Clone, Debug, Default)]
struct Slow {
    /// Frequency of the notch, Hz, and whether it follows; nothing of a head that does not sense the gap.
    notch: Option<(f64, bool)>,
    /// What is controlled, its set point where that is a setting, and its unit.
    kept: Option<(String, Option<f64>, String)>,
}

impl Slow {
    fn look(head: &Head) -> Result<Slow, Failure> {
        let Some(notch_hz) = number(head, sensed::NOTCH)? else { return Ok(Slow::default()) };
        let notch = Some((notch_hz, head.whole(sensed::FOLLOWS)? == 1));
        let Ok(choice) = head.sheet.setting("gap.controlled") else { return Ok(Slow { notch, kept: None }) };
        let chosen = head.whole(choice.address)?;
        let what = choice.names().get(&chosen).cloned().unwrap_or_else(|| chosen.to_string());
        let key = match what.as_str() {
            "hazard" => "gap.hazard_per_s",
            "distance" => "gap.distance_um",
            "frequency" => "gap.spark_per_s",
            // Or a share of the open circuit: the head says how many volts that is.
            _ => return Ok(Slow { notch, kept: Some((what, None, "V".into())) }),
        };
        let setting = head.sheet.setting(key).map_err(Failure::Failed)?;
        Ok(Slow { notch, kept: Some((what, Some(head.number(setting.address)?), setting.unit.clone())) })
    }
}

impl Senses {
    /// Reads what the pulses say; without pulses that is nothing.
    fn look(head: &Head, (notch_hz, notch_follows): (f64, bool), pulses: bool) -> Result<Senses, Failure> {
        let silent = Senses { notch_hz, notch_follows, ..Senses::default() };
        if !pulses {
            return Ok(silent);
        }
        let known = |number: f64| (number > 0.0).then_some(number);
        let hazard_per_s = known(head.number(sensed::HAZARD)?);
        let percent = head.number(sensed::DEVIATION)?;
        let validity = head.whole(sensed::DISTANCE_VALIDITY)?;
        Ok(Senses {
            hazard_per_s,
            hazard_deviation_per_s: hazard_per_s.map(|hazard| hazard * percent / 100.0),
            distance_um: if validity == 0 { None } else { Some(head.number(sensed::DISTANCE)?) },
            distance_beyond: validity == 2,
            sparks_per_s: known(head.number(sensed::FREQUENCY)?),
            sparks_missing: head.whole(sensed::MISSING)? == 1,
            pulse_age_ms: Some(head.number(sensed::AGE)?).filter(|age| *age < NO_AGE),
            ..silent
        })
    }
}

impl Senses {
    /// In a part of a line.
    fn text(&self) -> String {
        let hazard = self.hazard_per_s.zip(self.hazard_deviation_per_s);
        let hazard = hazard.map_or("-".into(), |(hazard, spread)| format!("{hazard:.0} +- {spread:.0} /s"));
        let distance = match self.distance_um {
            Some(um) if !self.distance_beyond => format!("{um:.1} um"),
            Some(_) => "beyond its range".into(),
            None => "-".into(),
        };
        let sparks = self.sparks_per_s.map_or("-".into(), |rate| format!("{rate:.0} /s"));
        let missing = if self.sparks_missing { ", missing" } else { "" };
        let age = self.pulse_age_ms.map_or("-".into(), |age| format!("{age:.0} ms"));
        let follows = if self.notch_follows { ", follows" } else { "" };
        let notch = self.notch_hz;
        format!(
            "; hazard {hazard}, distance {distance}, sparks {sparks}{missing}, pulse age {age}, notch {notch:.2} Hz{follows}"
        )
    }
}

impl Controlled {
    /// In a part of a line.
    fn text(&self) -> String {
        let Controlled { what, setpoint, now, unit, error_v } = self;
        let now = now.map_or("-".into(), |now| format!("{now:.1}"));
        let error = error_v.map_or("-".into(), |error| format!("{error:+.1} V"));
        format!("; controlled {what} {now}, set point {setpoint:.1} {unit}, error {error}")
    }
}

/// Shares of pulses of the last 0.2 s as the head has them, without those of milliseconds without a pulse.
fn window(head: &Head) -> Result<Vec<(String, u32)>, Failure> {
    let is_share = |Address(index, sub): Address| index == CLASSES && sub > 0 && sub != NO_PULSE;
    let objects = head.sheet.objects().filter(|object| is_share(object.address));
    let share = |object: &Object| {
        let what = object.key.rsplit('.').next().unwrap_or_default().to_lowercase();
        Ok((what, head.whole(object.address)? as u32))
    };
    objects.map(share).collect()
}

/// How it sparks, and whether that is as it should be.
fn verdict(shares: &[Share], senses: Option<&Senses>) -> (String, Option<bool>) {
    let percent = |what: &str| {
        let of = |share: &&Share| share.what == what;
        shares.iter().find(of).and_then(|share| share.percent).unwrap_or(0.0)
    };
    if shares.iter().all(|share| share.percent.is_none()) {
        return ("No pulses".into(), None);
    }
    let (spark, open, bad) = (percent("spark"), percent("open"), percent("arc") + percent("short"));
    let said = if spark >= 50.0 && bad < SPOILT {
        return (format!("Sparks well: {spark:.0} % of all pulses"), Some(true));
    } else if bad >= SPOILT {
        format!("Arcs and shorts: {bad:.0} % of all pulses; sparks: {spark:.0} %")
    } else if senses.is_some_and(|senses| senses.sparks_missing) {
        format!("Sparks are missing: {open:.0} % of all pulses are open")
    } else if open >= 50.0 {
        format!("The gap is wide: {open:.0} % of all pulses are open")
    } else {
        format!("Sparks: {spark:.0} % of all pulses")
    };
    (said, Some(false))
}

impl Gap {
    /// Reads the gap, without ignition delays.
    fn look(head: &Head, slow: &Slow, new: Option<[u32; NAMES.len()]>) -> Result<Gap, Failure> {
        let named = |address: Address, number: i64| {
            let names = head.sheet.get(address).map(|object| object.names()).unwrap_or_default();
            names.get(&number).cloned().unwrap_or_else(|| number.to_string())
        };
        let quality = head.whole(at::GAP_QUALITY)?;
        let volts = head.number(at::GAP)?;
        let open = Some(head.number(at::OPEN)?).filter(|volts| *volts > 0.0);
        let percent = head.setting("seek.threshold_percent")?;
        let seek = open.map(|open| open * percent / 100.0);
        let setpoint = head.number(at::SETPOINT)?;
        let rung = |what, volts, from| Rung { what, volts, from };
        let ladder = [
            rung("open circuit", open, "2005h:6, measured at the start of the seek"),
            rung("seek ends", seek, "seek.threshold_percent of open circuit"),
            rung("set point", Some(setpoint), "2005h:5"),
            rung("short", Some(head.setting("gap.short_v")?), "gap.short_v"),
        ];
        let no_pulse_percent = f64::from(head.whole(Address(CLASSES, NO_PULSE))? as u32) * 0.5;
        let shares = match new {
            Some(new) => NAMES.iter().map(|name| (*name).to_owned()).zip(new).collect(),
            None => window(head)?,
        };
        let all: u64 = shares.iter().map(|(_, count)| u64::from(*count)).sum();
        let (pulses, pulse_count) = (all > 0, new.map(|_| all));
        let share = |count| pulses.then(|| 100.0 * f64::from(count) / all as f64);
        let shares: Vec<Share> =
            shares.into_iter().map(|(what, count)| Share { what, percent: share(count) }).collect();
        // A head of 0.2.0 has no such object.
        let fit = head.whole(at::LEVELS).ok().and_then(|fit| usize::try_from(fit).ok());
        let levels = fit.and_then(|fit| TEACH.get(fit.checked_sub(2)?)).copied();
        let now = head.whole(at::STATE)?;
        let feed_um_s = if state::LED.contains(&(now as u8)) { Some(head.number(at::FEED)?) } else { None };
        let volts = MEASURED.contains(&quality).then_some(volts);
        let senses = slow.notch.map_or(Ok(None), |notch| Senses::look(head, notch, pulses).map(Some))?;
        let controlled = match (&senses, &slow.kept) {
            (Some(senses), Some((what, set, unit))) => {
                let now = match what.as_str() {
                    "hazard" => senses.hazard_per_s,
                    "distance" => senses.distance_um,
                    "frequency" => senses.sparks_per_s,
                    _ => volts,
                };
                let error_v = if pulses { Some(head.number(sensed::ERROR)?) } else { None };
                let (what, unit) = (what.clone(), unit.clone());
                Some(Controlled { what, setpoint: set.unwrap_or(setpoint), now, unit, error_v })
            }
            _ => None,
        };
        let (verdict, good) = verdict(&shares, senses.as_ref());
        Ok(Gap {
            node: head.node,
            state: named(at::STATE, now),
            volts,
            quality: named(at::GAP_QUALITY, quality),
            ladder,
            verdict,
            good,
            shares,
            no_pulse_percent,
            levels,
            whole: pulses && volts.is_some() && senses.as_ref().is_none_or(|senses| senses.hazard_per_s.is_some()),
            pulses,
            pulse_count,
            feed_um_s,
            senses,
            controlled,
            delays: None,
        })
    }

    /// Whether it replaces the one that is kept. A head without comparators never measures the hazard: there the newest with pulses is kept.
    pub fn replaces(&self, kept: Option<&Gap>) -> bool {
        self.whole || (self.pulses && self.volts.is_some() && !kept.is_some_and(|kept| kept.whole))
    }

    /// In one line.
    pub fn text(&self) -> String {
        let said = |volts: Option<f64>| volts.map_or("-".into(), |volts| format!("{volts:.1} V"));
        let ladder: Vec<String> =
            self.ladder.iter().map(|rung| format!("{} {}", rung.what, said(rung.volts))).collect();
        let shares: Vec<String> = self
            .shares
            .iter()
            .map(|share| {
                format!("{} {}", share.what, share.percent.map_or("-".into(), |percent| format!("{percent:.0} %")))
            })
            .collect();
        let kept = self.controlled.as_ref().map_or(String::new(), Controlled::text);
        format!(
            "{:16} gap {:>8} ({}); {}; {}; {}{}{kept}; feed {}{}\n",
            self.state,
            said(self.volts),
            self.quality,
            ladder.join(", "),
            self.verdict,
            shares.join(", "),
            self.senses.as_ref().map_or(String::new(), Senses::text),
            self.feed_um_s.map_or("-".into(), |feed| format!("{feed:.0} um/s")),
            self.levels.map_or(String::new(), |levels| format!("\n{levels}"))
        )
    }
}

//! Wrong settings: the guided check refuses them with the reason, or no fault makes the head press harder than
//! [`CONTACT_N`]. The machine is that of the scenario `default`.

use super::row::{Campaign, Row};
use super::trial::{Became, of_settings};
use super::{COMMAND, Faults, together};
use crate::contact::CONTACT_N;
use crate::pool;
use crate::progress::Runs;
use crate::run::Setup;
use crate::terminal::Failure;
use clap::ValueEnum;
use edm_servo_head::head::Fault;
use edm_servo_head::settings::{Declared, Kind, Settings, Value};
use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Which settings are wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Sets {
    /// Mass, counterbalance, friction, force constant, resistance and length of a count, wrong by 20 and 50 %, alone and in pairs
    Constants,
    /// Every setting at both its ends, one at a time
    Ends,
    /// A random set per seed that the guided check accepts
    Random,
}

/// Settings that [`Sets::Constants`] changes, and the factors.
const CONSTANTS: [&str; 6] = [
    "axis.mass_kg",
    "axis.counterbalance_n",
    "axis.breakaway_n",
    "axis.force_constant_n_a",
    "axis.resistance_ohm",
    "encoder.count_um",
];
const FACTORS: [f64; 4] = [0.5, 0.8, 1.2, 1.5];
/// Most settings that a random set changes.
const MOST: u32 = 6;
/// Random sets tried until the check accepts one.
const DRAWS: u64 = 100;

/// Settings with a name.
pub struct Set {
    /// Name.
    pub name: String,
    /// All of them.
    pub settings: Settings,
}

impl Sets {
    /// Tries them all; true when none presses.
    pub(super) fn execute(self, faults: &Faults) -> Result<bool, Failure> {
        let mut setup = Setup::load("default").map_err(Failure::Failed)?;
        setup.process.installation.couple();
        // A fast seek shortens the campaign.
        let base = Settings { seek_velocity: 5000.0, ..setup.head };
        let all = match self {
            Sets::Constants => constants(&base),
            Sets::Ends => ends(&base),
            Sets::Random => {
                (1..=faults.seeds).map(|seed| Set { name: format!("random set {seed}"), settings: base }).collect()
            }
        };
        let chosen = faults.options.choose(all, |set| set.name.clone()).map_err(Failure::BadInput)?;
        let written = faults.options.claim(COMMAND).map_err(Failure::BadInput)?;
        let work: Vec<usize> = (0..chosen.len()).collect();
        let mut rows: Vec<(usize, Row)> = Vec::new();
        let bar = Runs::new(work.len(), 0);
        let one = |&at: &usize| {
            let row = chosen.get(at).map(|set| match self {
                Sets::Random => random(&setup, set),
                _ => of_settings(&setup, &set.settings, 1).map(|became| row(set.name.clone(), became)),
            });
            (at, row)
        };
        let made = pool::run_all(&work, pool::workers(faults.jobs), one, |(at, row)| {
            let row = row.transpose()?;
            bar.finished(row.as_ref().map_or("", |row| &row.fault));
            rows.extend(row.map(|row| (at, row)));
            Ok(())
        });
        bar.finish();
        made.map_err(Failure::Failed)?;
        rows.sort_by_key(|(at, _)| *at);
        let campaign = Campaign::new(rows.into_iter().map(|(_, row)| row).collect());
        let how = "Settings that do not fit the machine: refused by the guided check, or tried under faults.";
        written.finish(&campaign, how).map_err(Failure::Failed)
    }
}

fn row(fault: String, became: Became) -> Row {
    let (reaction, reported, contact_n) = match became {
        Became::Refused(why) => ("refused".into(), why, 0.0),
        Became::Accepted(seen, worst) => {
            let mut reactions = together(seen.named.iter().map(|fault| fault.reaction().name()));
            if !worst.is_empty() {
                reactions = format!("{reactions}; largest force after: {worst}");
            }
            (reactions, together(seen.named.iter().copied().map(Fault::name)), seen.contact_n)
        }
    };
    Row {
        fault,
        reaction,
        time_us: None,
        reported: Some(reported),
        contact_n,
        current_a: 0.0,
        recovers: true,
        pass: contact_n <= CONTACT_N,
    }
}

/// A setting multiplied.
fn scaled(settings: &mut Settings, key: &str, factor: f64) {
    let place = Settings::KEYS.iter().position(|known| *known == key);
    if let Some(place) = place
        && let Some(Value::Number(value)) = settings.get(place)
    {
        // One that leaves its range stays as it was, and is right.
        let _ = settings.put(place, Value::Number(value * factor));
    }
}

/// The sets of [`Sets::Constants`], on settings that fit.
pub fn constants(base: &Settings) -> Vec<Set> {
    let one = |key: &str, factor: f64| format!("{key} x {factor}");
    let mut all = Vec::new();
    for (at, first) in CONSTANTS.iter().enumerate() {
        for by in FACTORS {
            let mut settings = *base;
            scaled(&mut settings, first, by);
            all.push(Set { name: one(first, by), settings });
            for second in CONSTANTS.iter().skip(at + 1) {
                for also in FACTORS {
                    let mut both = settings;
                    scaled(&mut both, second, also);
                    all.push(Set { name: format!("{}, {}", one(first, by), one(second, also)), settings: both });
                }
            }
        }
    }
    all
}

/// The values at the ends of a setting's range, or all that it may have.
fn extremes(kind: &Kind) -> Vec<Value<'static>> {
    match *kind {
        Kind::Number { min, max } => [min, max].map(|end| Value::Number(end.into())).into(),
        Kind::Integer { min, max } => [min, max].map(|end| Value::Number(end.into())).into(),
        Kind::Flag => [false, true].map(Value::Flag).into(),
        Kind::Choice(names) => names.iter().copied().filter(|name| !name.is_empty()).map(Value::Word).collect(),
    }
}

fn ends(base: &Settings) -> Vec<Set> {
    let mut all = Vec::new();
    for (place, field) in Settings::FIELDS.iter().enumerate() {
        for value in extremes(&field.kind) {
            let mut settings = *base;
            if settings.put(place, value).is_ok() && settings != *base {
                all.push(Set { name: format!("{} = {value}", field.key), settings });
            }
        }
    }
    all
}

/// A value anywhere in a setting's range, evenly over its decades where it has any, and often at an end.
fn drawn(kind: &Kind, random: &mut impl Rng) -> Value<'static> {
    let ends = extremes(kind);
    let spread = |min: f64, max: f64, random: &mut dyn Rng| {
        let share = random.random::<f64>();
        if min > 0.0 { min * (max / min).powf(share) } else { min + (max - min) * share.powi(3) }
    };
    match *kind {
        Kind::Number { min, max } if random.random_bool(0.8) => {
            Value::Number(f64::from(spread(min.into(), max.into(), random) as f32))
        }
        Kind::Integer { min, max } if random.random_bool(0.8) => {
            Value::Number(spread(min.into(), max.into(), random).round())
        }
        _ => ends.get(random.random_range(0..ends.len())).copied().unwrap_or(Value::Flag(false)),
    }
}

/// The first random set of a seed that the guided check accepts.
fn random(setup: &Setup, set: &Set) -> Result<Row, String> {
    let seed: u64 = set.name.rsplit(' ').next().and_then(|seed| seed.parse().ok()).unwrap_or(1);
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    for _ in 0..DRAWS {
        let mut settings = set.settings;
        let mut changes = Vec::new();
        for _ in 0..random.random_range(1..=MOST) {
            let place = random.random_range(0..Settings::COUNT);
            let Some(field) = Settings::FIELDS.get(place) else { continue };
            let value = drawn(&field.kind, &mut random);
            if settings.put(place, value).is_ok() {
                changes.push(format!("{}={value}", field.key));
            }
        }
        let became = of_settings(setup, &settings, seed)?;
        if matches!(became, Became::Accepted(..)) {
            return Ok(row(format!("{}: {}", set.name, changes.join(" ")), became));
        }
    }
    Err(format!("{}: the guided check accepts none of {DRAWS} random sets", set.name))
}

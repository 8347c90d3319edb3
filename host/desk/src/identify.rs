//! Identification of a head (2018h): the head measures motor, mass and friction by itself; this asks for it, shows it, takes it over.
//!
//! The head needs a home and room above. One without a home takes where it rests for it, as in a hole. It is disabled at the end:
//! only then may the settings change.

use crate::Failure;
use crate::head::{Head, MOVES, at};
use crate::live::{Live, Sample};
use crate::sdo::Address;
use edm_servo_head::head::{Truth, strike as strike_of};
use edm_servo_head::servo::{GRAVITY, Plant};
use edm_servo_head::units::{Newtons, Volts};
use serde::Serialize;
use std::time::{Duration, Instant};

const IDENTIFY: Address = Address(0x2018, 1);
const STEP: Address = Address(0x2018, 2);
const WHY: Address = Address(0x2018, 3);
/// Steps 7 and 8 are the end, with a result and without.
const FINISHED: i64 = 7;
const ENDED: i64 = 8;
/// Longest identification.
const LONGEST: Duration = Duration::from_secs(120);
/// Time in which it begins.
const BEGINS: Duration = Duration::from_secs(3);
/// Time between two samples.
const PERIOD: Duration = Duration::from_millis(50);

/// What is found: name, setting, unit, sub-index of the value, with its uncertainty behind it, and how many of them make a unit.
const VALUES: [(&str, Option<&str>, &str, u8, f64); 7] = [
    ("resistance", Some("axis.resistance_ohm"), "ohm", 4, 1e3),
    ("inductance", Some("axis.inductance_mh"), "mH", 6, 1e3),
    ("force constant", Some("axis.force_constant_n_a"), "N/A", 8, 1e3),
    ("mass", Some("axis.mass_kg"), "kg", 10, 1e6),
    ("breakaway", Some("axis.breakaway_n"), "N", 12, 1e3),
    ("sliding friction", None, "N", 14, 1e3),
    ("counterbalance", Some("axis.counterbalance_n"), "N", 16, 1e3),
];

/// A value that the head has found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Value {
    /// Name.
    pub name: &'static str,
    /// Setting that it is for.
    pub key: Option<&'static str>,
    /// Unit.
    pub unit: &'static str,
    /// Value.
    pub value: f64,
    /// What it may be wrong by, in nine cases of ten at the least.
    pub uncertainty: f64,
    /// What the setting is at present.
    pub set: Option<f64>,
}

impl Value {
    /// Whether the setting lies outside of what was found.
    pub fn contradicts(&self) -> bool {
        self.set.is_some_and(|set| (set - self.value).abs() > self.uncertainty)
    }

    /// A line of a table.
    pub fn text(&self) -> String {
        let Value { name, unit, value, uncertainty, set, .. } = self;
        if !value.is_finite() {
            return format!("{name:16} not bounded: the settings are too far from these values\n");
        }
        let set = match set {
            Some(set) if self.contradicts() => format!("set to {set:.4}: differs"),
            Some(set) => format!("set to {set:.4}"),
            None => String::new(),
        };
        format!("{name:16} {value:9.4} +- {uncertainty:7.4} {unit:4} {set}").trim_end().to_owned() + "\n"
    }
}

/// How it stands.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Progress {
    /// Present step, in words.
    pub doing: String,
    /// What the head does.
    pub sample: Sample,
}

/// Setting with the length that an identification needs above the head.
pub const TRAVEL: &str = "identify.travel_um";

/// What has been found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// Node-ID.
    pub node: u8,
    /// Everything.
    pub values: Vec<Value>,
    /// The values are settings now.
    pub taken_over: bool,
}

/// Inputs of a run.
pub struct Identify<'a> {
    /// The head.
    pub head: &'a Head,
    /// What it does.
    pub live: &'a mut Live,
    /// Where it identifies, mm below home; where it is without.
    pub at_mm: Option<f64>,
    /// Called in every wait. An error ends the run.
    pub alive: &'a dyn Fn() -> Result<(), Failure>,
    /// Called with the progress.
    pub on_progress: &'a mut dyn FnMut(&Progress),
}

impl Identify<'_> {
    /// Identifies, and disables the head.
    ///
    /// # Errors
    /// What went wrong; the head is disabled or in a fault then, or the error says that it may not be.
    pub fn execute(mut self) -> Result<Outcome, Failure> {
        self.head.free()?;
        self.head.place(self.at_mm, TRAVEL)?;
        let armed = self.head.arm()?;
        self.live.expect_heartbeat();
        let found = self.run();
        let now = self.head.stop();
        armed.disarm();
        match (found, now) {
            (Ok(()), Ok(_)) => Ok(Outcome { node: self.head.node, values: values(self.head)?, taken_over: false }),
            (Ok(()), Err(why)) => Err(why),
            (Err(why @ Failure::BadInput(_)), Ok(_)) => Err(why),
            (Err(why), Ok(now)) => Err(Failure::Failed(format!("{why}; {now}"))),
            (Err(why), Err(now)) => Err(Failure::Failed(format!("{why}; {now}; the head retreats by itself"))),
        }
    }

    fn run(&mut self) -> Result<(), Failure> {
        let (live, on_progress, alive) = (&mut *self.live, &mut *self.on_progress, self.alive);
        self.head.place_to_measure(self.at_mm, TRAVEL, &mut || alive(), &mut || {
            on_progress(&Progress { doing: MOVES.into(), sample: live.sample()? });
            Ok(())
        })?;
        self.identify()
    }

    fn identify(&mut self) -> Result<(), Failure> {
        let head = self.head;
        let refusals = head.whole(at::REFUSALS)?;
        head.set(IDENTIFY, 1)?;
        let (mut begun, start) = (false, Instant::now());
        while start.elapsed() < LONGEST {
            (self.alive)()?;
            let sample = self.live.sample()?;
            if sample.fault_number != 0 {
                return Err(Failure::Failed(sample.fault));
            }
            head.refused(refusals)?;
            let step = head.whole(STEP)?;
            // What is there before it begins is of the one before.
            begun |= step != FINISHED && step != ENDED && step != 0;
            match step {
                FINISHED if begun => return Ok(()),
                ENDED if begun => return Err(Failure::Failed(format!("no result: {}", word(head, WHY)?))),
                _ if !begun && start.elapsed() > BEGINS => {
                    return Err(Failure::Failed(format!("not begun within {} s", BEGINS.as_secs())));
                }
                _ => {}
            }
            (self.on_progress)(&Progress { doing: word(head, STEP)?, sample });
            std::thread::sleep(PERIOD);
        }
        Err(Failure::Failed(format!("it did not end within {} s", LONGEST.as_secs())))
    }
}

/// What an object's number means.
fn word(head: &Head, address: Address) -> Result<String, Failure> {
    let number = head.whole(address)?;
    let names = head.sheet.get(address).map(|object| object.names()).unwrap_or_default();
    Ok(names.get(&number).cloned().unwrap_or_else(|| number.to_string()))
}

/// The newest values of a head.
///
/// # Errors
/// Those of the transfers.
pub fn values(head: &Head) -> Result<Vec<Value>, Failure> {
    let found = |&(name, key, unit, sub, per_unit): &(&'static str, Option<&'static str>, &'static str, u8, f64)| {
        let number = |sub| head.whole(Address(0x2018, sub)).map(|whole| whole as f64 / per_unit);
        let set = key.map(|key| head.setting(key)).transpose()?;
        Ok(Value { name, key, unit, value: number(sub)?, uncertainty: number(sub + 1)?, set })
    };
    let mut values = VALUES.iter().map(found).collect::<Result<Vec<_>, Failure>>()?;
    let force = strike(head, &values)?;
    values.push(Value { name: "dead encoder", key: None, unit: "N", value: force, uncertainty: 0.0, set: None });
    Ok(values)
}

/// Greatest force, N, with which the head strikes the work if its encoder dies at rest: with the settings as they are, and these values as
/// uncertain as they are. Infinite where that is not bounded.
fn strike(head: &Head, values: &[Value]) -> Result<f64, Failure> {
    let set = |key| head.setting(key).map(|number| number as f32);
    let plant = Plant {
        mass_kg: set("axis.mass_kg")?,
        resistance_ohm: set("axis.resistance_ohm")?,
        inductance_h: 1e-3 * set("axis.inductance_mh")?,
        force_constant: set("axis.force_constant_n_a")?,
        bus: Volts(set("axis.bus_v")?),
        counterbalance: Newtons(set("axis.counterbalance_n")?),
        counts_per_m: 1e6 / set("encoder.count_um")?,
    };
    let between = |name| {
        let found = values.iter().find(|value| value.name == name);
        found.map_or([f64::NAN; 2], |found| [found.value - found.uncertainty, found.value + found.uncertainty])
    };
    let [mass, heaviest] = between("mass");
    let ([ohm, most_ohm], [constant, most_constant]) = (between("resistance"), between("force constant"));
    // What the motor holds is measured; the weight is calculated from the mass, and so is the counterbalance.
    let (balance, weight) = (between("counterbalance"), f64::from(GRAVITY) * 0.5 * (mass + heaviest));
    let unsure = (0.5 * (balance[1] - balance[0]) - f64::from(GRAVITY) * 0.5 * (heaviest - mass)).max(0.0);
    let truth = Truth {
        mass: mass as f32,
        per_volt: [constant / most_ohm, most_constant / ohm].map(|force| force as f32),
        net: (weight - 0.5 * (balance[0] + balance[1]) + unsure) as f32,
        sliding: between("sliding friction")[0] as f32,
    };
    let [friction, press] = [set("axis.breakaway_n")?, set("contact.press_n")?].map(Newtons);
    Ok(strike_of(&plant, friction, press, &truth).map_or(f64::INFINITY, |force| force.0.into()))
}

/// Makes the newest values settings of a disabled head: all, or none.
///
/// # Errors
/// Why the head refuses.
pub fn take_over(head: &Head) -> Result<(), Failure> {
    if head.whole(STEP)? != FINISHED {
        return Err(Failure::BadInput("the head has found nothing since it was switched on: identify it first".into()));
    }
    let state = head.whole(at::STATE)? as u8;
    if state != crate::head::state::DISABLED {
        return Err(Failure::BadInput("the head is not disabled: only then may these settings change".into()));
    }
    head.set(IDENTIFY, 2).map_err(|why| {
        let setting = head.whole(at::REFUSED_SETTING).unwrap_or(0) as u32;
        let address = Address((setting >> 8) as u16, setting as u8);
        let key = head.sheet.get(address).map_or(String::new(), |object| format!(" {}", object.key));
        Failure::Failed(format!("the head refuses{key}: {why}"))
    })
}

//! The machine with its process, for each version of the process model.
//!
//! Version 0 is declared in [`Parameters`], versions 1 and 2 in `host/process`: there every number is one of a published machine,
//! `model.machine`, unless a scenario names it as `model.NAME`. What the model has nothing to do with is the same for both:
//! where the work lies, bus, limit switches, wiring, scale and front end. A value of the other version is refused.

use super::Parameters;
use super::random::Cause;
use edm_process::frozen::VERSION;
use edm_process::gates::unpublished;
use edm_process::parameters::{Basis, DECLARED, Kind as Generator, MACHINES, Machine, OF_VERSION_1, Refused};
use edm_servo_head::settings::{Change, Declared, Field, Kind, SettingError, Value};
use rand::RngExt;

/// What a person sets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plant {
    /// Version 0, and what both have.
    pub base: Parameters,
    /// Version of the process model.
    version: u32,
    /// Index of the machine in [`MACHINES`].
    machine: usize,
    /// Its generator, when it is another one.
    generator: Option<Generator>,
    /// Its numbers that are others, in the order of [`DECLARED`].
    numbers: [Option<f64>; DECLARED.len()],
    /// Those of `base` that are set, a bit each.
    named: u64,
}

/// Fields that version 0 has not, other than numbers.
const CHOICES: [Field; 3] = [
    field(
        "model.version",
        "",
        "Version of the process model.",
        "docs/process-model.md",
        Kind::Integer { min: 0, max: 2 },
    ),
    field(
        "model.machine",
        "",
        "Machine that versions 1 and 2 start from.",
        "docs/process-model.md",
        Kind::Choice(&MACHINE_NAMES),
    ),
    field(
        "model.generator",
        "",
        "How its generator makes pulses.",
        "that of its machine",
        Kind::Choice(&GENERATOR_NAMES),
    ),
];

const MACHINE_NAMES: [&str; MACHINES.len()] = {
    let mut names = [""; MACHINES.len()];
    let mut at = 0;
    while at < names.len() {
        names[at] = MACHINES[at].name;
        at += 1;
    }
    names
};

const GENERATOR_NAMES: [&str; Generator::ALL.len()] = {
    let mut names = [""; Generator::ALL.len()];
    let mut at = 0;
    while at < names.len() {
        names[at] = Generator::ALL[at].1;
        at += 1;
    }
    names
};

const fn field(key: &'static str, unit: &'static str, doc: &'static str, source: &'static str, kind: Kind) -> Field {
    Field { key, unit, doc, source, kind, change: Change::Live, hazard: "" }
}

/// Where the fields of version 1 begin, and how many there are of all.
const BASE: usize = Parameters::COUNT;
const NUMBERS: usize = BASE + CHOICES.len();
const ALL: usize = NUMBERS + DECLARED.len();
const _: () = assert!(BASE <= u64::BITS as usize, "a bit for each field of version 0");

static FIELDS: [Field; ALL] = {
    let mut all = [CHOICES[0]; ALL];
    let mut at = 0;
    while at < ALL {
        all[at] = if at < BASE {
            Parameters::FIELDS[at]
        } else if at < NUMBERS {
            CHOICES[at - BASE]
        } else {
            let number = &DECLARED[at - NUMBERS];
            let source = match number.basis {
                Basis::Source(source) => source,
                Basis::Fitted(_) => "of sinker; fitted, docs/process-model.md",
                Basis::Chosen(_) => "of sinker; chosen, docs/process-model.md",
                Basis::Assumed(_) => "of sinker; assumed, docs/process-model.md",
            };
            let kind = Kind::Number { min: number.range.0 as f32, max: number.range.1 as f32 };
            field(number.path, number.unit, number.doc, source, kind)
        };
        at += 1;
    }
    all
};

static KEYS: [&str; ALL] = {
    let mut keys = [""; ALL];
    let mut at = 0;
    while at < ALL {
        keys[at] = FIELDS[at].key;
        at += 1;
    }
    keys
};

impl Default for Plant {
    /// The version of a scenario that names none.
    fn default() -> Plant {
        Plant { version: VERSION, ..Plant::from(&Parameters::default()) }
    }
}

impl From<&Parameters> for Plant {
    /// Version 0.
    fn from(base: &Parameters) -> Plant {
        Plant { base: *base, version: 0, machine: 0, generator: None, numbers: [None; DECLARED.len()], named: 0 }
    }
}

impl Plant {
    /// Version of the process model.
    pub fn version(&self) -> u32 {
        self.version
    }

    /// The same with a version of the model, without what belongs to the other one.
    pub fn turned_to(&self, version: u32) -> Plant {
        let mut plant = Plant { version, ..Plant::default() };
        if version != 0 && self.version != 0 {
            (plant.machine, plant.generator, plant.numbers) = (self.machine, self.generator, self.numbers);
            if version == 1 {
                plant.numbers.iter_mut().skip(OF_VERSION_1).for_each(|number| *number = None);
            }
        }
        for at in (0..BASE).filter(|&at| self.named >> at & 1 == 1 && is_common(FIELDS[at].key)) {
            if let Some(value) = self.base.get(at) {
                // It was checked when it came here.
                let _: Result<(), SettingError> = plant.put(at, value);
            }
        }
        plant
    }

    fn machine(&self) -> Option<&'static Machine> {
        const ALL: &[Machine] = &MACHINES;
        ALL.get(self.machine)
    }

    /// Changes each unpublished number of versions 1 and 2 by a random share of up to this one; the generator's settings
    /// stay. The same seed gives the same numbers, whatever else is different.
    pub fn perturb(&mut self, share: f64, seed: u64) {
        const SET: [&str; 4] = ["open_v", "on_us", "off_us", "wait_us"];
        let Some(machine) = self.machine().filter(|_| share > 0.0 && self.version != 0) else { return };
        let open: Vec<&str> = unpublished(self.version, machine).collect();
        let mut random = Cause::Perturbation.stream(seed);
        let values: Vec<f64> = self.model().values().collect();
        for ((declared, value), number) in DECLARED.iter().zip(values).zip(&mut self.numbers) {
            // Drawn for every one: which are changed does not move the others.
            let drawn = random.random_range(-1.0..=1.0);
            if open.contains(&declared.key) && !SET.contains(&declared.key) {
                let (least, most) = declared.range;
                *number = Some((value * (1.0 + share * drawn)).clamp(least, most));
            }
        }
        // An arc burns no higher than a spark: the model refuses one that does.
        let model = self.model();
        if model.arc_v > model.burn_v
            && let Some((_, arc_v)) =
                DECLARED.iter().zip(&mut self.numbers).find(|(declared, _)| declared.key == "arc_v")
        {
            *arc_v = Some(model.burn_v);
        }
    }

    /// Name of the machine; `None` in version 0.
    pub fn machine_name(&self) -> Option<&'static str> {
        self.machine().filter(|_| self.version != 0).map(|machine| machine.name)
    }

    /// Face of the electrode, mm^2.
    pub fn face_mm2(&self) -> f64 {
        let radius_mm = if self.version == 0 { self.base.radius.into() } else { self.model().radius_um * 1e-3 };
        std::f64::consts::PI * radius_mm * radius_mm
    }

    /// The numbers of versions 1 and 2.
    pub fn model(&self) -> edm_process::Parameters {
        let mut p = self.machine().map(|machine| machine.of(self.version)).unwrap_or_default();
        p.kind = self.generator.unwrap_or(p.kind);
        for (declared, number) in DECLARED.iter().zip(self.numbers) {
            if let Some(number) = number {
                // It was checked when it was put here.
                let _: Result<(), Refused> = p.set(declared.key, number);
            }
        }
        p
    }

    /// Stroke between the stops, mm.
    pub fn stroke_mm(&self) -> f64 {
        if self.version == 0 { self.base.stroke.into() } else { self.model().stroke_mm }
    }

    /// Open-circuit voltage, V.
    pub fn open_v(&self) -> f64 {
        if self.version == 0 { self.base.open.into() } else { self.model().open_v }
    }

    /// Checks every number, alone and against the others.
    ///
    /// # Errors
    /// The first that does not fit, or belongs to the other version.
    pub fn validate(&self) -> Result<(), SettingError> {
        self.base.check()?;
        self.base.fits(self.stroke_mm() as f32)?;
        let foreign = |index: usize, rule| Err(SettingError::Conflict { field: FIELDS[index].key, rule });
        if self.version == 0 {
            let rule = "belongs to versions 1 and 2 of the process model, and model.version is 0";
            if self.machine != 0 || self.generator.is_some() {
                return foreign(BASE + if self.machine != 0 { 1 } else { 2 }, rule);
            }
            return match self.numbers.iter().position(Option::is_some) {
                Some(at) => foreign(NUMBERS + at, rule),
                None => self.base.validate(),
            };
        }
        let alien = (0..BASE).find(|&at| self.named >> at & 1 == 1 && !is_common(FIELDS[at].key));
        if let Some(at) = alien {
            return foreign(at, "belongs to version 0 of the process model, and model.version is not 0");
        }
        let only_2 = self.numbers.iter().skip(OF_VERSION_1).position(Option::is_some);
        if let Some(at) = only_2.filter(|_| self.version == 1) {
            let rule = "belongs to version 2 of the process model, and model.version is 1";
            return foreign(NUMBERS + OF_VERSION_1 + at, rule);
        }
        self.model().check().map_err(|refused| match refused {
            Refused::Conflict(rule) => SettingError::Conflict { field: "model", rule },
            Refused::Range(declared, _) => SettingError::Conflict { field: declared.path, rule: "is out of its range" },
            Refused::Unknown => SettingError::UnknownKey,
        })
    }
}

/// Whether both versions have a field of [`Parameters`].
fn is_common(key: &str) -> bool {
    matches!(key, "workpiece.surface_mm" | "actuator.bus_v")
        || ["limit.", "wiring.", "scale.", "front_end."].iter().any(|group| key.starts_with(group))
}

impl Declared for Plant {
    const FIELDS: &'static [Field] = &FIELDS;
    const KEYS: &'static [&'static str] = &KEYS;
    const ADDRESSES: &'static [(u16, u8)] = &[];

    fn word(&self, index: usize) -> Option<u32> {
        match self.get(index)? {
            Value::Number(x) if matches!(FIELDS.get(index)?.kind, Kind::Number { .. }) => Some((x as f32).to_bits()),
            Value::Number(x) => Some(x as u32),
            Value::Flag(x) => Some(x.into()),
            Value::Word(word) => {
                let Kind::Choice(names) = FIELDS.get(index)?.kind else { return None };
                names.iter().position(|name| *name == word).map(|at| at as u32)
            }
        }
    }

    fn put_word(&mut self, index: usize, word: u32) -> Result<(), SettingError> {
        let field = FIELDS.get(index).ok_or(SettingError::UnknownKey)?;
        let value = match field.kind {
            Kind::Number { .. } => Value::Number(f32::from_bits(word).into()),
            Kind::Integer { .. } => Value::Number(word.into()),
            Kind::Flag => Value::Flag(word != 0),
            Kind::Choice(names) => Value::Word(names.get(word as usize).ok_or(SettingError::NotAllowed(field))?),
        };
        self.put(index, value)
    }

    fn get(&self, index: usize) -> Option<Value<'static>> {
        if index < BASE {
            return self.base.get(index);
        }
        match index - BASE {
            0 => Some(Value::Number(self.version.into())),
            1 => MACHINE_NAMES.get(self.machine).map(|name| Value::Word(name)),
            2 => {
                let kind = self.model().kind;
                Generator::ALL.iter().find(|(other, _)| *other == kind).map(|(_, name)| Value::Word(name))
            }
            _ => self.model().values().nth(index - NUMBERS).map(Value::Number),
        }
    }

    fn put(&mut self, index: usize, value: Value<'_>) -> Result<(), SettingError> {
        if index < BASE {
            self.base.put(index, value)?;
            self.named |= 1 << index;
            return Ok(());
        }
        let field = FIELDS.get(index).ok_or(SettingError::UnknownKey)?;
        let refused = SettingError::NotAllowed(field);
        match (index - BASE, value) {
            (0, Value::Number(x)) if x == 0.0 || x == 1.0 || x == 2.0 => self.version = x as u32,
            (1, Value::Word(word)) => {
                self.machine = MACHINE_NAMES.iter().position(|name| *name == word).ok_or(refused)?;
            }
            (2, Value::Word(word)) => {
                let (kind, _) = Generator::ALL.iter().find(|(_, name)| *name == word).ok_or(refused)?;
                self.generator = Some(*kind);
            }
            (3.., Value::Number(x)) => {
                let at = index - NUMBERS;
                let fits = DECLARED.get(at).is_some_and(|declared| (declared.range.0..=declared.range.1).contains(&x));
                *self.numbers.get_mut(at).filter(|_| fits).ok_or(refused)? = Some(x);
            }
            _ => return Err(refused),
        }
        Ok(())
    }

    fn check(&self) -> Result<(), SettingError> {
        self.base.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn conflict(set: &[(&str, Value<'_>)]) -> Option<&'static str> {
        let mut plant = Plant::default();
        for (key, value) in set {
            plant.set(key, *value).unwrap();
        }
        match plant.validate() {
            Ok(()) => None,
            Err(SettingError::Conflict { field, .. }) => Some(field),
            Err(error) => panic!("{error}"),
        }
    }

    const ZERO: (&str, Value<'_>) = ("model.version", Value::Number(0.0));

    #[test]
    fn a_value_of_the_other_version_is_refused_by_name() {
        let (mass, radius) = (("actuator.mass_kg", Value::Number(0.4)), ("model.radius_um", Value::Number(100.0)));
        assert_eq!(conflict(&[mass, ZERO]), None);
        assert_eq!(conflict(&[mass]), Some("actuator.mass_kg"));
        assert_eq!(conflict(&[ZERO, radius]), Some("model.radius_um"));
        assert_eq!(conflict(&[radius]), None);
        let (reach, one) = (("model.reach_um_v", Value::Number(1.0)), ("model.version", Value::Number(1.0)));
        assert_eq!(conflict(&[reach, one]), Some("model.reach_um_v"));
        assert_eq!(conflict(&[reach]), None);
        assert_eq!(conflict(&[ZERO, ("model.machine", Value::Word("gao"))]), Some("model.machine"));
        for common in ["workpiece.surface_mm", "scale.count_um", "front_end.hum_v", "actuator.bus_v"] {
            assert_eq!(conflict(&[(common, Value::Number(5.0))]), None, "{common}");
        }
        assert_eq!(conflict(&[("workpiece.surface_mm", Value::Number(12.0))]), Some("workpiece.surface_mm"));
        assert_eq!(
            conflict(&[("model.burn_v", Value::Number(99.0)), ("model.open_v", Value::Number(50.0))]),
            Some("model")
        );
    }

    #[test]
    fn another_version_keeps_what_both_have() {
        let mut plant = Plant::from(&Parameters::default());
        for (key, value) in [("scale.count_um", 0.1), ("actuator.mass_kg", 0.4)] {
            plant.set(key, Value::Number(value)).unwrap();
        }
        let plant = plant.turned_to(1);
        assert_eq!(plant.validate(), Ok(()));
        assert_eq!((plant.version(), plant.base.count, plant.base.mass), (1, 0.1, 0.2));
        // Machine and numbers are of versions 1 and 2; version 1 leaves out what only 2 has.
        let mut plant = Plant::default();
        assert_eq!(plant.version(), 2);
        for (key, value) in [("model.radius_um", 123.0), ("model.reach_um_v", 0.5)] {
            plant.set(key, Value::Number(value)).unwrap();
        }
        plant.set("model.machine", Value::Word("gao")).unwrap();
        assert_eq!(plant.validate(), Ok(()));
        assert_eq!((plant.model().radius_um, plant.model().reach_um_v), (123.0, 0.5));
        let plant = plant.turned_to(1);
        assert_eq!(plant.validate(), Ok(()));
        assert_eq!(
            (plant.model().radius_um, plant.model().reach_um_v, plant.machine_name()),
            (123.0, 0.0, Some("gao"))
        );
    }

    #[test]
    fn what_nobody_has_published_is_perturbed_within_its_share_by_the_seed_alone() {
        let sinker = Plant::default();
        let own = sinker.model();
        let perturbed = |seed| {
            let mut plant = sinker;
            plant.perturb(0.3, seed);
            plant.model()
        };
        let (one, two) = (perturbed(1), perturbed(2));
        assert_eq!(one, perturbed(1));
        assert_ne!(one, two);
        let machine = sinker.machine().unwrap();
        for (declared, (was, is)) in DECLARED.iter().zip(own.values().zip(one.values())) {
            assert!((is - was).abs() <= 0.3 * was.abs() + 1e-12, "{}: {was} {is}", declared.key);
            let set = ["open_v", "on_us", "off_us", "wait_us"].contains(&declared.key);
            let moves = unpublished(VERSION, machine).any(|key| key == declared.key) && !set;
            assert_eq!(is != was, moves, "{}: {was} {is}", declared.key);
        }
        let usual = Plant::from(&Parameters::default());
        let mut zero = usual;
        zero.perturb(0.3, 1);
        assert_eq!(zero, usual);
        // Whatever the seed, it is a model.
        for seed in 0..200 {
            let mut gao = sinker;
            gao.set("model.machine", Value::Word("gao")).unwrap();
            gao.perturb(0.3, seed);
            assert_eq!(gao.model().check(), Ok(()), "seed {seed}");
        }
    }

    #[test]
    fn numbers_are_those_of_the_machine_but_for_those_that_were_named() {
        let mut plant = Plant::default();
        plant.set("model.radius_um", Value::Number(123.0)).unwrap();
        plant.set("model.machine", Value::Word("gao")).unwrap();
        let p = plant.model();
        assert_eq!((p.radius_um, p.open_v, p.kind), (123.0, 80.0, Generator::ControlledRc));
        plant.set("model.generator", Value::Word("rc")).unwrap();
        assert_eq!(plant.model().kind, Generator::Rc);
        let index = Plant::KEYS.iter().position(|key| *key == "model.radius_um").unwrap();
        assert_eq!(plant.get(index), Some(Value::Number(123.0)));
        assert!(plant.set("model.radius_um", Value::Number(1.0)).is_err());
        assert_eq!(plant.model().radius_um, 123.0);
    }

    #[test]
    fn the_gates_of_every_scenario_run_its_own_numbers() {
        let built_in = crate::scenario::BUILT_IN;
        let of = |name: &str| crate::run::Setup::load(name).unwrap().process;
        for situation in edm_process::gates::SITUATIONS {
            let Some((name, _)) = built_in.iter().find(|(name, _)| *name == situation.name) else { continue };
            for version in [1, 2] {
                assert_eq!(of(name).turned_to(version).model(), situation.of(version), "{name}");
            }
        }
        // The others only differ from one of these in mass, friction, surface, thickness or jumps.
        let gated = |name: &str| edm_process::gates::SITUATIONS.iter().any(|situation| situation.name == name);
        let others = [
            "default",
            "sinker-0.1kg",
            "sinker-0.4kg",
            "sinker-deep-jumps",
            "thesis-machine",
            "micro-through",
            "micro-through-clear",
        ];
        for (name, _) in built_in.iter().filter(|(name, _)| of(name).version() != 0) {
            assert!(gated(name) || others.contains(name), "{name}: no gates");
        }
    }
}

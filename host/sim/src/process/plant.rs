//! The machine with its process and what stands around it.
//!
//! Numbers of machine and process are declared in `host/process`: each is one of a published machine, `model.machine`, unless a scenario
//! names it as `model.NAME`. What stands around them is an [`Installation`].

use super::Installation;
use super::lines::THRESHOLDS;
use super::random::Cause;
use edm_process::parameters::{Basis, DECLARED, Kind as Generator, MACHINES, Machine, Refused};
use edm_servo_head::settings::{Change, Declared, Field, Kind, SettingError, Value};
use rand::RngExt;

/// What a person sets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plant {
    /// What stands around machine and process.
    pub installation: Installation,
    /// Index of the machine in [`MACHINES`].
    machine: usize,
    /// Its generator, when it is another one.
    generator: Option<Generator>,
    /// Its numbers that are others, in the order of [`DECLARED`].
    numbers: [Option<f64>; DECLARED.len()],
}

/// Fields of the model other than numbers.
const CHOICES: [Field; 2] = [
    field(
        "model.machine",
        "",
        "Machine that the numbers start from.",
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

/// Where the fields of the model begin, where its numbers, and how many fields there are.
const MODEL: usize = Installation::COUNT;
const NUMBERS: usize = MODEL + CHOICES.len();
const ALL: usize = NUMBERS + DECLARED.len();

static FIELDS: [Field; ALL] = {
    let mut all = [CHOICES[0]; ALL];
    let mut at = 0;
    while at < ALL {
        all[at] = if at < MODEL {
            Installation::FIELDS[at]
        } else if at < NUMBERS {
            CHOICES[at - MODEL]
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
    /// The sinker in the usual surroundings.
    fn default() -> Plant {
        Plant { installation: Installation::default(), machine: 0, generator: None, numbers: [None; DECLARED.len()] }
    }
}

impl Plant {
    /// The sinker with these values; what is no number is 0 or 1.
    ///
    /// # Errors
    /// The first value that is refused, or a key that there is not.
    pub fn with(values: &[(&str, f64)]) -> Result<Plant, SettingError> {
        let mut plant = Plant::default();
        for &(key, value) in values {
            let is_flag = FIELDS.iter().any(|field| field.key == key && matches!(field.kind, Kind::Flag));
            plant.set(key, if is_flag { Value::Flag(value != 0.0) } else { Value::Number(value) })?;
        }
        Ok(plant)
    }

    fn machine(&self) -> Option<&'static Machine> {
        const ALL: &[Machine] = &MACHINES;
        ALL.get(self.machine)
    }

    /// Changes each unpublished number by a random share of up to this one; the generator's settings stay. The same seed gives the same
    /// numbers, whatever else is different.
    pub fn perturb(&mut self, share: f64, seed: u64) {
        const SET: [&str; 4] = ["open_v", "on_us", "off_us", "wait_us"];
        let Some(machine) = self.machine().filter(|_| share > 0.0) else { return };
        let open: Vec<&str> = machine.unpublished().collect();
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

    /// Name of the machine.
    pub fn machine_name(&self) -> &'static str {
        self.machine().map_or("", |machine| machine.name)
    }

    /// Face of the electrode, mm^2.
    pub fn face_mm2(&self) -> f64 {
        let radius_mm = self.model().radius_um * 1e-3;
        std::f64::consts::PI * radius_mm * radius_mm
    }

    /// The numbers of machine and process.
    pub fn model(&self) -> edm_process::Parameters {
        let mut p = self.machine().map(|machine| machine.of()).unwrap_or_default();
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
        self.model().stroke_mm
    }

    /// Voltages at which the high and the low comparator switch, V.
    pub fn comparators_v(&self) -> [f64; 2] {
        let set = f64::from(self.installation.comparators_for);
        let published = || self.machine().map_or(0.0, |machine| machine.of().open_v);
        let open_v = if set > 0.0 { set } else { published() };
        THRESHOLDS.map(|share| share * open_v * (1.0 + 0.01 * f64::from(self.installation.comparator_error)))
    }

    /// Checks every number, alone and against the others.
    ///
    /// # Errors
    /// The first that does not fit.
    pub fn validate(&self) -> Result<(), SettingError> {
        self.installation.check()?;
        self.installation.fits(self.stroke_mm() as f32)?;
        self.model().check().map_err(|refused| match refused {
            Refused::Conflict(rule) => SettingError::Conflict { field: "model", rule },
            Refused::Range(declared, _) => SettingError::Conflict { field: declared.path, rule: "is out of its range" },
            Refused::Unknown => SettingError::UnknownKey,
        })
    }
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
        if index < MODEL {
            return self.installation.get(index);
        }
        match index - MODEL {
            0 => MACHINE_NAMES.get(self.machine).map(|name| Value::Word(name)),
            1 => {
                let kind = self.model().kind;
                Generator::ALL.iter().find(|(other, _)| *other == kind).map(|(_, name)| Value::Word(name))
            }
            _ => self.model().values().nth(index - NUMBERS).map(Value::Number),
        }
    }

    fn put(&mut self, index: usize, value: Value<'_>) -> Result<(), SettingError> {
        if index < MODEL {
            return self.installation.put(index, value);
        }
        let field = FIELDS.get(index).ok_or(SettingError::UnknownKey)?;
        let refused = SettingError::NotAllowed(field);
        match (index - MODEL, value) {
            (0, Value::Word(word)) => {
                self.machine = MACHINE_NAMES.iter().position(|name| *name == word).ok_or(refused)?;
            }
            (1, Value::Word(word)) => {
                let (kind, _) = Generator::ALL.iter().find(|(_, name)| *name == word).ok_or(refused)?;
                self.generator = Some(*kind);
            }
            (2.., Value::Number(x)) => {
                let at = index - NUMBERS;
                let fits = DECLARED.get(at).is_some_and(|declared| (declared.range.0..=declared.range.1).contains(&x));
                *self.numbers.get_mut(at).filter(|_| fits).ok_or(refused)? = Some(x);
            }
            _ => return Err(refused),
        }
        Ok(())
    }

    fn check(&self) -> Result<(), SettingError> {
        self.installation.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_do_not_fit_each_other_are_refused_by_name() {
        let conflict = |values: &[(&str, f64)]| match Plant::with(values).unwrap().validate() {
            Err(SettingError::Conflict { field, .. }) => field,
            other => panic!("{other:?}"),
        };
        assert_eq!(conflict(&[("workpiece.surface_mm", 12.0)]), "workpiece.surface_mm");
        assert_eq!(conflict(&[("limit.lower_mm", 0.5), ("limit.upper_mm", 0.5)]), "limit.lower_mm");
        assert_eq!(conflict(&[("scale.mark_mm", 0.3), ("scale.count_um", 100.0)]), "scale.mark_mm");
        assert_eq!(conflict(&[("model.burn_v", 99.0), ("model.open_v", 50.0)]), "model");
        assert!(matches!(
            Plant::with(&[("model.mass_kg", f64::NAN)]),
            Err(SettingError::NotAllowed(field)) if field.key == "model.mass_kg"
        ));
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
            let moves = machine.unpublished().any(|key| key == declared.key) && !set;
            assert_eq!(is != was, moves, "{}: {was} {is}", declared.key);
        }
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
}

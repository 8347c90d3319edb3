//! Scenarios: named sets of values for process and head.
//!
//! A scenario file is TOML: `title`, `description`, if it has a depth of its own `depth_mm`, and the tables `[process]` and `[head]`, whose keys are those that
//! `edm-sim settings` prints (`"model.on_us" = 160`, quoted or as nested tables). What a file does not name keeps
//! its default. Every `[[event]]` has a time `at_s`, a `signal` out of the same list and the `value` that it takes then. Every
//! refusal is one line that names file and line, key, value and what is allowed.

use crate::events::{AT, Event, EventError, Wires};
use edm_servo_head::settings::{Declared, Field, Kind, SettingError, Value};
use edm_technology::from_toml;
use std::fs;
use std::path::{MAIN_SEPARATOR, Path};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

macro_rules! scenarios {
    ($($name:literal),+ $(,)?) => {
        /// The scenarios that come with the program: name and text.
        pub const BUILT_IN: &[(&str, &str)] =
            &[$(($name, include_str!(concat!("../scenarios/", $name, ".toml")))),+];
    };
}

scenarios![
    "default",
    "roberts-original",
    "sinker",
    "sinker-100khz",
    "sinker-1khz",
    "sinker-0.1kg",
    "sinker-0.4kg",
    "sinker-0.1mm",
    "sinker-25mm",
    "sinker-dirty",
    "sinker-deep",
    "sinker-deep-jumps",
    "cavity",
    "thesis-machine",
    "silicon",
    "micro-blind",
    "micro-blind-clear",
    "micro-through",
    "micro-through-clear",
];

/// Depth of a hole when neither scenario nor command line gives one, mm.
pub const DEPTH_MM: f64 = 0.5;

/// Values for a run, each within its own limits.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario<P, H> {
    /// Name, or file, and what was changed on the command line.
    pub name: String,
    /// One line for lists and headings.
    pub title: String,
    /// What it is for.
    pub description: String,
    /// Default depth, mm.
    pub depth_mm: f64,
    /// Values of the process model.
    pub process: P,
    /// Settings of the head.
    pub head: H,
    /// Faults of the machine, and when they happen.
    pub events: Vec<Event>,
}

impl<P: Declared + Default, H: Declared + Default> Scenario<P, H> {
    /// Loads a built-in scenario by name, or a file. `which` is a file if it says so by a separator or `.toml`, or if no
    /// scenario has that name and the file exists.
    pub fn load(which: &str) -> Result<Self, String> {
        if let Some((_, text)) = BUILT_IN.iter().find(|(name, _)| *name == which) {
            return Self::parse(which, text);
        }
        let path = Path::new(which);
        if which.contains(['/', MAIN_SEPARATOR]) || which.ends_with(".toml") || path.exists() {
            let text =
                fs::read_to_string(path).map_err(|error| format!("--scenario {which}: cannot be read: {error}"))?;
            return Self::parse(which, &text);
        }
        let names: Vec<&str> = BUILT_IN.iter().map(|(name, _)| *name).collect();
        Err(format!("--scenario {which}: no such scenario{}; there are {}", hint(which, &names), names.join(", ")))
    }

    /// Reads a scenario; `name` is what messages and reports call it.
    pub fn parse(name: &str, text: &str) -> Result<Self, String> {
        let (root, at) = read_toml(name, text)?;
        let mut scenario = Scenario {
            name: name.into(),
            title: String::new(),
            description: String::new(),
            depth_mm: DEPTH_MM,
            process: P::default(),
            head: H::default(),
            events: Vec::new(),
        };
        for (key, value) in root.get_ref() {
            let done = match (key.get_ref().as_ref(), value.get_ref()) {
                ("title", DeValue::String(words)) => {
                    scenario.title = words.trim().into();
                    Ok(())
                }
                ("description", DeValue::String(words)) => {
                    scenario.description = words.trim().into();
                    Ok(())
                }
                ("title" | "description", _) => {
                    Err((value.span().start, format!("{} must be a text in quotes", key.get_ref())))
                }
                ("depth_mm", _) => match from_toml(value) {
                    Some(Value::Number(depth)) => {
                        scenario.depth_mm = depth;
                        Ok(())
                    }
                    _ => Err((value.span().start, "depth_mm must be a number of mm".into())),
                },
                ("process", DeValue::Table(table)) => fill(&mut scenario.process, H::FIELDS, "head", table, "", text),
                ("head", DeValue::Table(table)) => fill(&mut scenario.head, P::FIELDS, "process", table, "", text),
                ("process" | "head", _) => Err((value.span().start, format!("{} must be a table", key.get_ref()))),
                ("event", DeValue::Array(events)) => {
                    let read = events.iter().map(|value| event(value, text));
                    read.collect::<Result<_, _>>().map(|events| scenario.events = events)
                }
                ("event", _) => Err((value.span().start, "event must be tables: [[event]]".into())),
                (other, _) => {
                    let known = ["title", "description", "depth_mm", "process", "head", "event"];
                    let message =
                        format!("{other}: no such entry{}; there are {}", hint(other, &known), known.join(", "));
                    Err((key.span().start, message))
                }
            };
            done.map_err(|(offset, message)| format!("{}: {message}", at(offset)))?;
        }
        for (key, words) in [("title", &scenario.title), ("description", &scenario.description)] {
            if words.is_empty() {
                return Err(format!("{name}: {key} is missing: it must be a text in quotes"));
            }
        }
        Ok(scenario)
    }

    /// Applies `key=value` from the command line; of two for the same key the later one holds.
    pub fn set(&mut self, assignment: &str) -> Result<(), String> {
        let Some((key, word)) = assignment.split_once('=').map(|(key, word)| (key.trim(), word.trim())) else {
            return Err(format!("{assignment}: must be key=value"));
        };
        if find::<P>(key).is_some() {
            assign(&mut self.process, key, word, |field| from_word(field, word))?;
        } else if find::<H>(key).is_some() {
            assign(&mut self.head, key, word, |field| from_word(field, word))?;
        } else {
            return Err(unknown(key, word, P::FIELDS.iter().chain(H::FIELDS)));
        }
        self.name = format!("{}, {key}={word}", self.name);
        Ok(())
    }

    /// A refusal by the machine in words, with the value that caused it.
    pub fn refusal(&self, error: SettingError) -> String {
        let SettingError::Conflict { field, rule } = error else { return error.to_string() };
        self.value(field).map_or_else(|| error.to_string(), |value| format!("{field} = {value}: {rule}"))
    }

    /// Value of the process or the head with this key, as a person would type it.
    pub fn value(&self, key: &str) -> Option<String> {
        value_of(&self.process, key).or_else(|| value_of(&self.head, key))
    }
}

/// A value as a person would type it: a number as short as its precision allows.
pub fn typed(value: Value<'_>, field: &Field) -> String {
    match (value, field.kind) {
        (Value::Number(x), Kind::Number { .. }) => format!("{}", x as f32),
        (Value::Word(word), _) => word.into(),
        (value, _) => value.to_string(),
    }
}

fn find<D: Declared>(key: &str) -> Option<&'static Field> {
    D::FIELDS.iter().find(|field| field.key == key)
}

fn value_of<D: Declared>(values: &D, key: &str) -> Option<String> {
    let index = D::FIELDS.iter().position(|field| field.key == key)?;
    Some(typed(values.get(index)?, D::FIELDS.get(index)?))
}

/// Sets one field; `word` is the value as it was typed.
fn assign<'a, D: Declared>(
    values: &mut D,
    key: &str,
    word: &str,
    value: impl FnOnce(&Field) -> Option<Value<'a>>,
) -> Result<(), String> {
    let Some(field) = find::<D>(key) else { return Err(unknown(key, word, D::FIELDS.iter())) };
    let taken = value(field).is_some_and(|value| values.set(key, value).is_ok());
    if taken { Ok(()) } else { Err(format!("{key} = {word}: must be {}", field.allowed())) }
}

/// Reads an `[[event]]`. An error carries its offset in the text.
fn event(value: &Spanned<DeValue<'_>>, text: &str) -> Result<Event, (usize, String)> {
    const ENTRIES: [&str; 3] = ["at_s", "signal", "value"];
    let DeValue::Table(table) = value.get_ref() else {
        return Err((value.span().start, "event must be tables: [[event]]".into()));
    };
    if let Some((key, _)) = table.iter().find(|(key, _)| !ENTRIES.contains(&key.get_ref().as_ref())) {
        let name = key.get_ref();
        let message = format!("{name}: no such entry{}; an event has {}", hint(name, &ENTRIES), ENTRIES.join(", "));
        return Err((key.span().start, message));
    }
    let entry = |name: &str| {
        let found = table.iter().find(|(key, _)| key.get_ref() == name);
        let (_, found) = found.ok_or((value.span().start, format!("event: {name} is missing")))?;
        let word = text.get(found.span()).and_then(|source| source.lines().next()).unwrap_or_default();
        Ok((found, word))
    };
    let ((at, at_word), (signal, signal_word), (value, word)) = (entry("at_s")?, entry("signal")?, entry("value")?);
    let refused = |at: &Spanned<DeValue<'_>>, message| Err((at.span().start, message));
    let no_time = || refused(at, format!("at_s = {at_word}: must be {}", AT.allowed()));
    let Some(Value::Number(at_s)) = from_toml(at) else { return no_time() };
    let name = signal.get_ref().as_str().unwrap_or_default();
    // Not a value of any kind: refused in the words of the signal.
    let no_value = Value::Word("");
    match Event::new(at_s, name, from_toml(value).unwrap_or(no_value)) {
        Ok(event) => Ok(event),
        Err(EventError::Time) => no_time(),
        Err(EventError::Signal) => {
            let keys: Vec<&str> = Wires::FIELDS.iter().map(|field| field.key).collect();
            let message =
                format!("signal = {signal_word}: no such signal{}; `edm-sim settings` lists all", hint(name, &keys));
            refused(signal, message)
        }
        Err(EventError::Value(field)) => refused(value, format!("value = {word}: {name} must be {}", field.allowed())),
    }
}

/// Reads a table into `values`; dotted keys may be quoted or nested. An error carries its offset in the text.
fn fill<D: Declared>(
    values: &mut D,
    others: &[Field],
    other_table: &str,
    table: &DeTable<'_>,
    prefix: &str,
    text: &str,
) -> Result<(), (usize, String)> {
    for (name, value) in table {
        let key = if prefix.is_empty() { name.get_ref().to_string() } else { format!("{prefix}.{}", name.get_ref()) };
        if let DeValue::Table(inner) = value.get_ref() {
            fill(values, others, other_table, inner, &key, text)?;
            continue;
        }
        let word = text.get(value.span()).and_then(|source| source.lines().next()).unwrap_or_default();
        let done = if find::<D>(&key).is_none() && others.iter().any(|field| field.key == key) {
            Err(format!("{key} = {word}: belongs in the table [{other_table}]"))
        } else {
            assign(values, &key, word, |_| from_toml(value))
        };
        done.map_err(|message| (name.span().start, message))?;
    }
    Ok(())
}

/// A value as it was typed, if it can be one of this field's kind.
pub(crate) fn from_word<'a>(field: &Field, word: &'a str) -> Option<Value<'a>> {
    match field.kind {
        Kind::Number { .. } | Kind::Integer { .. } => word.parse().ok().map(Value::Number),
        Kind::Flag => word.parse().ok().map(Value::Flag),
        Kind::Choice(_) => Some(Value::Word(word)),
    }
}

/// Reads TOML. The second value names the place of an offset in the text: file and line.
///
/// # Errors
/// Place and reason, in one line.
pub(crate) fn read_toml<'a>(
    name: &'a str,
    text: &'a str,
) -> Result<(Spanned<DeTable<'a>>, impl Fn(usize) -> String + use<'a>), String> {
    let at = move |offset: usize| {
        let line = text.get(..offset).unwrap_or(text).matches('\n').count() + 1;
        format!("{name}:{line}")
    };
    let root = DeTable::parse(text).map_err(|error| {
        let offset = error.span().map_or(0, |span| span.start);
        format!("{}: not TOML: {}", at(offset), error.message().replace('\n', " "))
    })?;
    Ok((root, at))
}

fn unknown<'a>(key: &str, word: &str, fields: impl Iterator<Item = &'a Field>) -> String {
    let keys: Vec<&str> = fields.map(|field| field.key).collect();
    format!("{key} = {word}: no such setting{}; `edm-sim settings` lists all", hint(key, &keys))
}

/// ", did you mean ...?" where a known name is near what was typed; where only its group is known, what there is in the group.
pub(crate) fn hint(typed: &str, known: &[&str]) -> String {
    // "gain" is far from "law", but what they have in common, "feed.", would make them near.
    let parts =
        |name: &str| name.rsplit_once('.').map_or((String::new(), name.to_owned()), |(a, b)| (a.into(), b.into()));
    let near = |a: &str, b: &str| strsim::normalized_damerau_levenshtein(a, b);
    let (group, word) = parts(typed);
    let score = |name: &&str| {
        let (other_group, other) = parts(name);
        let unit_left_out = !word.is_empty() && other.strip_prefix(&word).is_some_and(|unit| unit.starts_with('_'));
        let words = near(&word, &other);
        let words = if unit_left_out { 0.9 + 0.1 * words } else { words };
        // Without a group the word alone decides.
        if group.is_empty() { words } else { words.min(near(&group, &other_group)) }
    };
    let nearest = known.iter().copied().max_by(|a, b| score(a).total_cmp(&score(b))).filter(|name| score(name) >= 0.6);
    if let Some(name) = nearest {
        return format!(", did you mean {name}?");
    }
    let of_group: Vec<&str> =
        known.iter().copied().filter(|name| !group.is_empty() && parts(name).0 == group).collect();
    if of_group.is_empty() { String::new() } else { format!("; {group} has {}", of_group.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_servo_head::{choice, declare};

    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Law {
        Slow,
        Fast,
    }
    choice!(Law { Slow = "slow", Fast = "fast" });

    declare! {
        /// A process.
        struct Process {
            /// On-time.
            on: f32 = 160.0, (1.0, 5000.0), "generator.on_us", "us", "assumed";
            /// Pulses in a burst.
            burst: u32 = 1, (1, 100), "generator.burst", "", "assumed";
        }
    }
    declare! {
        /// A head.
        struct Head {
            /// Gap voltage to keep.
            setpoint: f32 = 55.0, (1.0, 300.0), "gap.setpoint_v", "V", "assumed";
            /// Law.
            law: Law = Law::Slow, (), "feed.law", "", "assumed";
            /// Notch.
            notch: bool = true, (), "gap.notch", "", "assumed";
        }
    }

    fn parse(body: &str) -> Result<Scenario<Process, Head>, String> {
        Scenario::parse("try.toml", &format!("title = \"T\"\ndescription = \"D\"\n{body}"))
    }

    #[test]
    fn what_a_file_names_is_set_and_the_rest_keeps_its_default() {
        let s = parse("[process]\n\"generator.on_us\" = 4\ngenerator.burst = 0x10\n[head]\n\"feed.law\" = \"fast\"")
            .unwrap();
        assert_eq!(s.process, Process { on: 4.0, burst: 16 });
        assert_eq!(s.head, Head { law: Law::Fast, ..Head::default() });
        assert_eq!((s.title.as_str(), s.description.as_str()), ("T", "D"));
    }

    #[test]
    fn quoted_dotted_and_nested_keys_are_the_same_key() {
        let quoted = parse("[head]\n\"gap.notch\" = false").unwrap();
        assert_eq!(parse("[head]\ngap.notch = false").unwrap(), quoted);
        assert_eq!(parse("[head.gap]\nnotch = false").unwrap(), quoted);
    }

    #[test]
    fn a_refusal_names_file_line_key_value_and_range() {
        for (body, message) in [
            ("[head]\n\"gap.setpoint_v\" = 301", "try.toml:4: gap.setpoint_v = 301: must be a number from 1 to 300 V"),
            ("[head]\n\"gap.setpoint_v\" = nan", "try.toml:4: gap.setpoint_v = nan: must be a number from 1 to 300 V"),
            (
                "[head]\n\"gap.setpoint_v\" = \"60\"",
                "try.toml:4: gap.setpoint_v = \"60\": must be a number from 1 to 300 V",
            ),
            (
                "[head]\n\"gap.setpoint_v\" = [60,\n61]",
                "try.toml:4: gap.setpoint_v = [60,: must be a number from 1 to 300 V",
            ),
            ("[head]\n\"gap.notch\" = 1", "try.toml:4: gap.notch = 1: must be true or false"),
            ("\n[head]\n\"feed.law\" = \"furious\"", "try.toml:5: feed.law = \"furious\": must be one of slow, fast"),
            (
                "[process]\n\"generator.burst\" = 1.5",
                "try.toml:4: generator.burst = 1.5: must be a whole number from 1 to 100",
            ),
            (
                "[process]\n\"generator.on\" = 1",
                "try.toml:4: generator.on = 1: no such setting, did you mean generator.on_us?; `edm-sim settings` lists all",
            ),
            ("[process]\n\"gap.notch\" = true", "try.toml:4: gap.notch = true: belongs in the table [head]"),
            ("process = 1", "try.toml:3: process must be a table"),
            (
                "[processs]",
                "try.toml:3: processs: no such entry, did you mean process?; there are title, description, depth_mm, process, head, event",
            ),
        ] {
            assert_eq!(parse(body).unwrap_err(), message);
        }
    }

    #[test]
    fn events_are_read_in_the_order_of_the_file() {
        let s = parse(
            "[[event]]\nat_s = 3\nsignal = \"gap.short\"\nvalue = true\n[[event]]\nsignal = \"bus.sag_v\"\nvalue = 20\nat_s = 1.5",
        )
        .unwrap();
        let event = |at_s, signal, value| Event::new(at_s, signal, value).unwrap();
        let expected = [event(3.0, "gap.short", Value::Flag(true)), event(1.5, "bus.sag_v", Value::Number(20.0))];
        assert_eq!(s.events, expected);
        assert_eq!(parse("").unwrap().events, []);
    }

    #[test]
    fn an_event_that_cannot_be_is_refused_with_its_line_and_what_is_allowed() {
        for (event, message) in [
            ("at_s = -1\nsignal = \"gap.short\"\nvalue = true", "4: at_s = -1: must be a number from 0 to 100000 s"),
            (
                "at_s = true\nsignal = \"gap.short\"\nvalue = true",
                "4: at_s = true: must be a number from 0 to 100000 s",
            ),
            (
                "at_s = 1\nsignal = \"limit.uper_open\"\nvalue = true",
                "5: signal = \"limit.uper_open\": no such signal, did you mean limit.upper_open?; `edm-sim settings` lists all",
            ),
            ("at_s = 1\nsignal = 3\nvalue = true", "5: signal = 3: no such signal; `edm-sim settings` lists all"),
            ("at_s = 1\nsignal = \"gap.short\"\nvalue = 1", "6: value = 1: gap.short must be true or false"),
            (
                "at_s = 1\nsignal = \"bus.sag_v\"\nvalue = 61",
                "6: value = 61: bus.sag_v must be a number from 0 to 60 V",
            ),
            (
                "at_s = 1\nsignal = \"bus.sag_v\"\nvalue = [1]",
                "6: value = [1]: bus.sag_v must be a number from 0 to 60 V",
            ),
            ("at_s = 1\nvalue = true", "3: event: signal is missing"),
            ("at = 1", "4: at: no such entry, did you mean at_s?; an event has at_s, signal, value"),
        ] {
            assert_eq!(parse(&format!("[[event]]\n{event}")).unwrap_err(), format!("try.toml:{message}"));
        }
        assert_eq!(parse("event = 1").unwrap_err(), "try.toml:3: event must be tables: [[event]]");
        assert_eq!(parse("event = [1]").unwrap_err(), "try.toml:3: event must be tables: [[event]]");
    }

    #[test]
    fn what_is_not_toml_or_has_no_title_is_refused_in_one_line() {
        let error = parse("[head\n").unwrap_err();
        assert!(error.starts_with("try.toml:3: not TOML: ") && !error.contains('\n'), "{error}");
        let error = parse("[head]\n\"gap.notch\" = true\n\"gap.notch\" = true").unwrap_err();
        assert!(error.starts_with("try.toml:5: not TOML: duplicate key"), "{error}");
        let error = Scenario::<Process, Head>::parse("try.toml", "description = \"D\"").unwrap_err();
        assert_eq!(error, "try.toml: title is missing: it must be a text in quotes");
    }

    #[test]
    fn the_command_line_sets_both_tables_and_leaves_its_trace_in_the_name() {
        let mut s = parse("").unwrap();
        for assignment in ["generator.on_us=4", "feed.law=fast", "gap.notch = false", "generator.on_us=5"] {
            s.set(assignment).unwrap();
        }
        assert_eq!((s.process.on, s.head.law, s.head.notch), (5.0, Law::Fast, false));
        assert_eq!(s.name, "try.toml, generator.on_us=4, feed.law=fast, gap.notch=false, generator.on_us=5");
    }

    #[test]
    fn a_bad_assignment_changes_nothing() {
        let mut s = parse("").unwrap();
        let before = s.clone();
        for (assignment, message) in [
            ("gap.setpoint_v=0.9", "gap.setpoint_v = 0.9: must be a number from 1 to 300 V"),
            ("gap.setpoint_v=NaN", "gap.setpoint_v = NaN: must be a number from 1 to 300 V"),
            ("gap.setpoint_v=inf", "gap.setpoint_v = inf: must be a number from 1 to 300 V"),
            ("gap.setpoint_v=1e99", "gap.setpoint_v = 1e99: must be a number from 1 to 300 V"),
            ("gap.setpoint_v=", "gap.setpoint_v = : must be a number from 1 to 300 V"),
            ("generator.burst=-1", "generator.burst = -1: must be a whole number from 1 to 100"),
            ("gap.notch=yes", "gap.notch = yes: must be true or false"),
            ("feed.law=furious", "feed.law = furious: must be one of slow, fast"),
            (
                "setpoint_v=1",
                "setpoint_v = 1: no such setting, did you mean gap.setpoint_v?; `edm-sim settings` lists all",
            ),
            ("x=1", "x = 1: no such setting; `edm-sim settings` lists all"),
            ("gap.notch", "gap.notch: must be key=value"),
        ] {
            assert_eq!(s.set(assignment).unwrap_err(), message);
            assert_eq!(s, before);
        }
    }

    #[test]
    fn a_hint_is_near_in_group_and_word_or_lists_the_group() {
        let known = [
            "feed.law",
            "feed.standard_um_s",
            "gap.setpoint_v",
            "gap.setpoint_percent",
            "gap.average",
            "limit.lower_open",
            "generator.on_us",
        ];
        for (typed, expected) in [
            ("feed.gain", "; feed has feed.law, feed.standard_um_s"),
            ("feed.lae", ", did you mean feed.law?"),
            ("fed.law", ", did you mean feed.law?"),
            ("gap.setpont_v", ", did you mean gap.setpoint_v?"),
            ("gap.setpoint", ", did you mean gap.setpoint_v?"),
            ("generator.on", ", did you mean generator.on_us?"),
            ("limit.lower", ", did you mean limit.lower_open?"),
            ("setpoint_v", ", did you mean gap.setpoint_v?"),
            ("average", ", did you mean gap.average?"),
            ("nonsense", ""),
            ("weather.rain", ""),
            ("", ""),
        ] {
            assert_eq!(hint(typed, &known), expected, "{typed}");
        }
        assert_eq!(hint("defualt", &["default", "sinker-dirty"]), ", did you mean default?");
    }

    #[test]
    fn a_conflict_is_reported_with_the_value_that_is_in_the_way() {
        let s = parse("").unwrap();
        let error = SettingError::Conflict { field: "gap.setpoint_v", rule: "must be below the open-circuit voltage" };
        assert_eq!(s.refusal(error), "gap.setpoint_v = 55: must be below the open-circuit voltage");
    }

    #[test]
    fn an_unknown_scenario_is_refused_with_the_names_there_are() {
        let error = Scenario::<Process, Head>::load("defualt").unwrap_err();
        assert!(
            error.starts_with("--scenario defualt: no such scenario, did you mean default?; there are default, "),
            "{error}"
        );
        let error = Scenario::<Process, Head>::load("nowhere/x.toml").unwrap_err();
        assert!(error.starts_with("--scenario nowhere/x.toml: cannot be read: "), "{error}");
    }
}

//! Objects that a host has once been able to use stay where they are and what they are: the declarations against
//! docs/released-objects.csv, which nothing generates.
//!
//! A line of that list is an object as it was released. Columns: index; sub-index, empty for the object as a whole, whose type
//! is then its shape; type; unit; access; smallest and largest value, empty for all that the type has; names of a choice from 0
//! on, with | between; the version that brought it, `next` for the one to come; its name then. Lines are added at the end and
//! never changed, but for `next`, which becomes the number of the release. That released lines are those of the history is
//! checked by `cargo xtask docs --check`.
//!
//! A line whose address is there already takes the place of the one before, and its name begins with `narrowed:` and says why:
//! a safety ceiling may come down. Then 1018h:3 goes up by one (docs/canopen.md).

use edm_describe::{Declaration, Shape, everything};
use edm_servo_head::canopen::drive::DEVICE;
use edm_servo_head::canopen::{Access, DataType};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

const LIST: &str = include_str!("../docs/released-objects.csv");
const HEAD: &str = "index,sub,type,unit,access,min,max,choices,since,name";
/// The version that is not released yet.
const NEXT: &str = "next";
const NARROWED: &str = "narrowed:";

/// Index and sub-index; no sub-index for the object as a whole.
type Address = (u16, Option<u8>);

#[derive(Clone, Debug, PartialEq)]
struct Object {
    kind: String,
    unit: String,
    access: String,
    /// None: all that the type has.
    range: Option<(f64, f64)>,
    choices: Vec<String>,
    since: String,
    name: String,
}

fn line(text: &str) -> (Address, Object) {
    let columns: Vec<_> = text.splitn(10, ',').collect();
    let [index, sub, kind, unit, access, min, max, choices, since, name] = columns[..] else { panic!("{text}") };
    let number = |text: &str| text.parse::<f64>().unwrap();
    let index = u16::from_str_radix(index.strip_prefix("0x").unwrap(), 16).unwrap();
    let object = Object {
        kind: kind.into(),
        unit: unit.into(),
        access: access.into(),
        range: (!min.is_empty()).then(|| (number(min), number(max))),
        choices: choices.split('|').filter(|name| !name.is_empty()).map(Into::into).collect(),
        since: since.into(),
        name: name.into(),
    };
    ((index, (!sub.is_empty()).then(|| sub.parse().unwrap())), object)
}

/// What the list promises, and how often it has narrowed a range.
fn promised(list: &str) -> Result<(BTreeMap<Address, Object>, usize), String> {
    let mut lines = list.lines();
    assert_eq!(lines.next(), Some(HEAD));
    let (mut objects, mut narrowing) = (BTreeMap::<Address, Object>::new(), BTreeSet::new());
    let mut unreleased = false;
    for text in lines {
        let (address, mut object) = line(text);
        if unreleased && object.since != NEXT {
            return Err(format!("{text}\nstands behind a line of the version to come"));
        }
        unreleased = object.since == NEXT;
        if let Some(before) = objects.get(&address) {
            let same = |o: &Object| (o.kind.clone(), o.unit.clone(), o.access.clone(), o.choices.clone());
            if same(before) != same(&object) || !object.name.starts_with(NARROWED) {
                return Err(format!(
                    "{text}\nhas the address of {}: only a range can be narrowed, and is named so",
                    before.name
                ));
            }
            // An object stays as old as it is.
            narrowing.insert(core::mem::replace(&mut object.since, before.since.clone()));
        }
        objects.insert(address, object);
    }
    Ok((objects, narrowing.len()))
}

/// What the code declares.
fn declared() -> BTreeMap<Address, Object> {
    let mut objects = BTreeMap::new();
    for declaration in everything() {
        let d = &declaration;
        if d.shape != Shape::Variable {
            let kind = if d.shape == Shape::Array { "ARRAY" } else { "RECORD" };
            objects.entry((d.index, None)).or_insert_with(|| Object {
                kind: kind.into(),
                unit: String::new(),
                access: String::new(),
                range: None,
                choices: Vec::new(),
                since: NEXT.into(),
                name: d.object.into(),
            });
        }
        objects.insert((d.index, Some(d.sub)), value(&declaration));
    }
    objects
}

fn value(declaration: &Declaration) -> Object {
    let d = declaration;
    let access = match d.access {
        Access::Const => "const",
        Access::ReadOnly => "ro",
        Access::WriteOnly => "wo",
        Access::ReadWrite => "rw",
    };
    // As the f32 that it is reads.
    let number = |x: f64| if d.kind == DataType::Real32 { (x as f32).to_string().parse().unwrap() } else { x };
    Object {
        kind: format!("{:?}", d.kind).to_uppercase(),
        unit: declaration.unit.into(),
        access: access.into(),
        range: declaration.range.map(|(low, high)| (number(low), number(high))),
        choices: declaration.choices.iter().map(|name| (*name).into()).collect(),
        since: NEXT.into(),
        name: if d.object == d.name { d.name.into() } else { format!("{}: {}", d.object, d.name) },
    }
}

/// All that a type of the list can be.
fn whole(kind: &str) -> (f64, f64) {
    let bits = |prefix| kind.strip_prefix(prefix).and_then(|bits: &str| bits.parse::<i32>().ok());
    match (bits("UNSIGNED"), bits("INTEGER")) {
        (Some(bits), _) => (0.0, 2f64.powi(bits) - 1.0),
        (_, Some(bits)) => (-2f64.powi(bits - 1), 2f64.powi(bits - 1) - 1.0),
        _ => (f64::NEG_INFINITY, f64::INFINITY),
    }
}

fn text(address: Address, object: &Object) -> String {
    let Object { kind, unit, access, range, choices, since, name } = object;
    let sub = address.1.map_or(String::new(), |sub| sub.to_string());
    let (min, max) = range.map_or_else(Default::default, |(min, max)| (min.to_string(), max.to_string()));
    format!("0x{:04X},{sub},{kind},{unit},{access},{min},{max},{},{since},{name}", address.0, choices.join("|"))
}

/// Where the code does not keep what the list promises, and what the list lacks.
fn differences(promised: &BTreeMap<Address, Object>, declared: &BTreeMap<Address, Object>) -> String {
    let mut said = String::new();
    for (address, old) in promised {
        let place = text(*address, old);
        let Some(new) = declared.get(address) else {
            let advice = if old.since == NEXT { ": take the line out" } else { "" };
            writeln!(said, "gone{advice}\n  {place}").unwrap();
            continue;
        };
        for (what, old, new) in
            [("type", &old.kind, &new.kind), ("unit", &old.unit, &new.unit), ("access", &old.access, &new.access)]
        {
            if old != new {
                writeln!(said, "{what} is now {new:?}\n  {place}").unwrap();
            }
        }
        if !new.choices.starts_with(&old.choices) {
            writeln!(said, "choices are now {}\n  {place}", new.choices.join("|")).unwrap();
        }
        let ((low, high), (min, max)) =
            (old.range.unwrap_or_else(|| whole(&old.kind)), new.range.unwrap_or_else(|| whole(&new.kind)));
        if min > low || max < high {
            let line = Object { name: format!("{NARROWED} <why>"), ..new.clone() };
            writeln!(
                said,
                "narrower than it was\n  {place}\nif that is for safety, add at the end\n  {}",
                text(*address, &line)
            )
            .unwrap();
        }
    }
    let new = declared.iter().filter(|(address, _)| !promised.contains_key(address));
    let lines: Vec<_> = new.map(|(address, object)| text(*address, object)).collect();
    if !lines.is_empty() {
        writeln!(said, "not in docs/released-objects.csv; add at the end\n{}", lines.join("\n")).unwrap();
    }
    said
}

#[test]
fn every_object_ever_released_is_where_it_was_and_what_it_was() {
    let (promised, narrowed) = promised(LIST).unwrap_or_else(|error| panic!("docs/released-objects.csv: {error}"));
    let said = differences(&promised, &declared());
    assert!(said.is_empty(), "\n{said}");
    assert_eq!(
        DEVICE.revision as usize,
        1 + narrowed,
        "1018h:3 counts the releases that have narrowed a range, from 1"
    );
}

#[test]
fn the_first_release_has_448_objects() {
    let (promised, _) = promised(LIST).unwrap();
    assert_eq!(promised.values().filter(|object| object.since == "0.1.0").count(), 448);
}

/// What the list promises, and what the code declares of it.
fn both() -> (BTreeMap<Address, Object>, BTreeMap<Address, Object>) {
    let (promised, _) = promised(LIST).unwrap();
    let mut objects = declared();
    objects.retain(|address, _| promised.contains_key(address));
    (promised, objects)
}

/// What is said of a change to one object of the first release.
fn said_of(address: Address, change: impl FnOnce(&mut Object)) -> String {
    let (promised, mut objects) = both();
    change(objects.get_mut(&address).unwrap());
    differences(&promised, &objects)
}

const ACCELERATION: Address = (0x2102, Some(11));
const LAW: Address = (0x2102, Some(2));

#[test]
fn a_change_of_type_unit_access_or_of_the_meaning_of_a_choice_is_named() {
    let said = |address, change: fn(&mut Object)| said_of(address, change);
    assert_eq!(said(ACCELERATION, |_| ()), "");
    assert!(
        said(ACCELERATION, |o| o.kind = "UNSIGNED32".into()).starts_with("type is now \"UNSIGNED32\"\n  0x2102,11,")
    );
    assert!(said(ACCELERATION, |o| o.unit = "mm/s^2".into()).starts_with("unit is now"));
    assert!(said(ACCELERATION, |o| o.access = "ro".into()).starts_with("access is now"));
    assert!(said(LAW, |o| o.choices.swap(0, 1)).starts_with("choices are now"));
    assert_eq!(said(LAW, |o| o.choices.push("another".into())), "");
    assert!(said((0x2102, None), |o| o.kind = "ARRAY".into()).starts_with("type is now"));
}

#[test]
fn a_range_may_be_wider_but_not_narrower() {
    let said = |range| said_of(ACCELERATION, |o| o.range = range);
    assert_eq!(said(Some((0.01, 100.0))), "");
    assert_eq!(said(Some((0.0, 1000.0))), "");
    assert_eq!(said(None), "");
    assert!(said(Some((0.011, 100.0))).starts_with("narrower than it was\n  0x2102,11,"));
    assert!(said(Some((0.01, 99.9))).contains("\n  0x2102,11,REAL32,m/s^2,rw,0.01,99.9,,next,narrowed: <why>\n"));
    // Where the list has no range, it has that of the type.
    let heartbeat = |range| said_of((0x1017, Some(0)), |o| o.range = Some(range));
    assert_eq!(heartbeat((0.0, 65_535.0)), "");
    assert!(heartbeat((0.0, 65_534.0)).starts_with("narrower"));
}

#[test]
fn an_object_that_is_gone_has_moved_or_is_new_is_named_with_the_line_to_add() {
    let (promised, mut objects) = both();
    let moved = objects.remove(&ACCELERATION).unwrap();
    assert!(differences(&promised, &objects).starts_with("gone\n  0x2102,11,REAL32,"));
    objects.insert((0x2102, Some(99)), moved);
    let said = differences(&promised, &objects);
    let line = "0x2102,99,REAL32,m/s^2,rw,0.01,100,,next,feed: acceleration_m_s2\n";
    assert!(said.starts_with("gone\n") && said.ends_with(&format!("; add at the end\n{line}")), "{said}");
}

#[test]
fn a_range_is_narrowed_by_a_line_that_says_so_and_by_no_other() {
    let list = |lines: &str| format!("{HEAD}\n{}", lines);
    let first = "0x2107,2,REAL32,A,rw,0.1,20,,0.1.0,motor: peak_a\n";
    let lower = "0x2107,2,REAL32,A,rw,0.1,10,,next,narrowed: the bridge was found to fail at 12 A\n";
    let (objects, narrowed) = promised(&list(&format!("{first}{lower}"))).unwrap();
    assert_eq!((objects[&(0x2107, Some(2))].range, narrowed), (Some((0.1, 10.0)), 1));
    for wrong in [first, &lower.replace("narrowed: ", ""), &lower.replace(",A,", ",mA,"), &lower.replace("rw", "ro")] {
        assert!(promised(&list(&format!("{first}{wrong}"))).is_err(), "{wrong}");
    }
    assert!(promised(&list(&format!("{lower}{first}"))).is_err(), "released behind what is not");
}

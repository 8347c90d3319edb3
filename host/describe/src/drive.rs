//! The objects of the drive: those of its table, and the settings from 2100h on.

use crate::Shape::{Record, Variable};
use crate::{Declaration, HIGHEST};
use edm_canopen::{Access, DataType, DefaultValue, Mapping};
use edm_servo_head::canopen::objects::{Row, rows, setting_address_at, setting_kind};
use edm_servo_head::settings::{Declared, Kind, Settings, Value};
use std::collections::BTreeMap;

/// Every object of the drive by rising index and sub-index, the highest sub-indices included.
pub(crate) fn declarations() -> impl Iterator<Item = Declaration> {
    let values = rows().iter().map(row).chain((0..Settings::COUNT).filter_map(setting));
    let mut all: BTreeMap<_, _> = values.map(|value| ((value.index, value.sub), value)).collect();
    let records: Vec<_> = all.values().filter(|value| value.shape == Record).copied().collect();
    // Rising: the last is the highest.
    all.extend(records.into_iter().map(|value| ((value.index, 0), highest(&value))));
    all.into_values()
}

/// The highest sub-index of a record, by the value that has it.
fn highest(last: &Declaration) -> Declaration {
    Declaration {
        index: last.index,
        sub: 0,
        shape: Record,
        object: last.object,
        name: HIGHEST,
        kind: DataType::Unsigned8,
        access: Access::Const,
        mapping: Mapping::No,
        default: DefaultValue::Number(last.sub.into()),
        unit: "",
        range: None,
        doc: "",
        choices: &[],
        stored: false,
    }
}

fn row(row: &Row) -> Declaration {
    let (object, text, unit) = row.texts();
    // A name for description files, and what follows it for people.
    let (name, doc) = text.split_once(": ").unwrap_or((text, ""));
    let number = !matches!(row.kind(), DataType::VisibleString | DataType::Domain);
    let (low, high) = row.range();
    let default = if number && (row.access().writable() || row.default() != 0) {
        DefaultValue::Number(row.default().into())
    } else {
        DefaultValue::Unknown
    };
    let (index, sub) = row.address();
    Declaration {
        index,
        sub,
        shape: if sub == 0 { Variable } else { Record },
        object,
        name,
        kind: row.kind(),
        access: row.access(),
        mapping: row.mapping(),
        default,
        unit,
        range: number.then_some((low as f64, high as f64)),
        doc,
        choices: &[],
        stored: row.is_stored(),
    }
}

/// The setting at a place.
fn setting(place: usize) -> Option<Declaration> {
    let field = Settings::FIELDS.get(place)?;
    let (index, sub) = setting_address_at(place)?;
    let (kind, access) = setting_kind(u16::try_from(place).ok()?)?;
    let default = match (Settings::default().get(place)?, field.kind) {
        (Value::Number(x), Kind::Number { .. }) => DefaultValue::Real(x as f32),
        (Value::Number(x), _) => DefaultValue::Number(x as i64),
        (Value::Flag(x), _) => DefaultValue::Number(x.into()),
        (Value::Word(word), Kind::Choice(names)) => {
            DefaultValue::Number(names.iter().position(|name| *name == word)? as i64)
        }
        _ => return None,
    };
    let (range, choices) = match field.kind {
        Kind::Number { min, max } => (Some((min.into(), max.into())), &[][..]),
        Kind::Integer { min, max } => (Some((min.into(), max.into())), &[][..]),
        Kind::Flag => (None, &[][..]),
        Kind::Choice(names) => (Some((0.0, names.len().saturating_sub(1) as f64)), names),
    };
    let (object, name) = field.key.split_once('.').unwrap_or((field.key, field.key));
    let (unit, doc) = (field.unit, field.doc);
    Some(Declaration {
        index,
        sub,
        shape: Record,
        object,
        name,
        kind,
        access,
        mapping: Mapping::No,
        default,
        unit,
        range,
        doc,
        choices,
        stored: true,
    })
}

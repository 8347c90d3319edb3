//! Settings (what a person sets) -> [`build`] -> Active (what the ticks run).

mod declare;

pub use declare::{Choice, Declared, Field, Kind, Setting, SettingError, Value};

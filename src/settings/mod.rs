//! Settings (what a person sets) -> [`Settings::build`] -> [`Active`] (what the ticks run).
//!
//! A setting out of range, or at odds with another, never reaches a tick. Each is stored by its address: [`crate::stored`].

mod build;
mod declare;
mod laws;
mod table;

pub use build::Active;
pub use declare::{Change, Choice, Declared, Field, Kind, Setting, SettingError, Value, check, distinct, place};
pub use table::{SetpointUnit, Settings};

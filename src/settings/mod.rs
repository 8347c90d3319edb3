//! Settings (what a person sets) -> [`Settings::build`] -> [`Active`] (what the ticks run).
//!
//! A setting out of range, or at odds with another, never reaches a tick. [`Settings::image`] is what is stored.

mod build;
mod declare;
mod image;
mod table;

pub use build::Active;
pub use declare::{Choice, Declared, Field, Kind, Name, Setting, SettingError, Value, check, distinct, place};
pub use image::{ImageError, LENGTH as IMAGE_LENGTH};
pub use table::{LawName, SetpointUnit, Settings};

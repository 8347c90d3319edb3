//! Process data: objects carried by a frame without further ado (CiA 301 7.2.2).

mod mapping;
mod receive;
mod transmit;

pub(super) use mapping::Map;
pub(super) use receive::{Receive, Taken};
pub(super) use transmit::Transmit;

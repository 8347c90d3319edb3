//! Process data: objects carried by a frame without further ado (CiA 301 7.2.2).

mod mapping;
mod receive;
mod transmit;

pub(super) use mapping::Map;
pub(super) use receive::{Receive, Taken};
pub(super) use transmit::Transmit;

/// Direction of a PDO, seen from the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    /// RPDO.
    Receive,
    /// TPDO.
    Transmit,
}

/// Highest transmission type that waits for SYNC.
const SYNCHRONOUS: u8 = 240;

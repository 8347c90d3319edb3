//! A device for the unit tests of this package.

use super::{Device, PdoDefault};

/// PDO 1 of each direction in use, nothing mapped.
pub(super) const DEVICE: Device = Device {
    device_type: 0x0002_0192,
    name: "test",
    hardware: "1",
    software: "2",
    vendor: 0,
    product: 1,
    revision: 0x0001_0000,
    heartbeat: 0,
    update: 2000,
    receive: [
        PdoDefault { valid: true, ..PdoDefault::UNUSED },
        PdoDefault::UNUSED,
        PdoDefault::UNUSED,
        PdoDefault::UNUSED,
    ],
    transmit: [
        PdoDefault { valid: true, ..PdoDefault::UNUSED },
        PdoDefault::UNUSED,
        PdoDefault::UNUSED,
        PdoDefault::UNUSED,
    ],
};

//! What the node is made with: the identity of the device, and its PDOs before a host maps others.

use crate::canopen::{Device, PDOS, PdoDefault, mapped};

/// The head as a CANopen device: servo drive (402), with what it maps at first.
///
/// TPDO1 repeats every 50 ms and is sent at once after a change or a refusal. TPDO3 is for a CNC that keeps the path itself:
/// signed feed and gap voltage.
pub const DEVICE: Device = Device {
    // Profile 402, servo drive.
    device_type: 0x0002_0192,
    name: "EDM servo head",
    hardware: "STM32F405",
    software: env!("CARGO_PKG_VERSION"),
    // Nobody's: no vendor-ID has been given to this project.
    vendor: 0,
    product: 1,
    revision: 0x0000_0003,
    heartbeat: 0,
    update: edm_hal_shim::seal::LONGEST_UPDATE,
    receive: [
        PdoDefault { valid: true, entries: &[mapped(0x6040, 0, 16)], ..PdoDefault::UNUSED },
        PdoDefault { valid: true, entries: &[mapped(0x607A, 0, 32)], ..PdoDefault::UNUSED },
        PdoDefault { valid: true, entries: &[mapped(0x60FF, 0, 32)], ..PdoDefault::UNUSED },
        PdoDefault { entries: &[mapped(0x60C1, 1, 32)], ..PdoDefault::UNUSED },
    ],
    transmit: [
        PdoDefault {
            valid: true,
            timer: 50,
            entries: &[mapped(0x6041, 0, 16), mapped(0x6061, 0, 8), mapped(0x2000, 4, 8), mapped(0x2000, 7, 8)],
            ..PdoDefault::UNUSED
        },
        PdoDefault {
            valid: true,
            transmission: 1,
            entries: &[mapped(0x6064, 0, 32), mapped(0x606C, 0, 32)],
            ..PdoDefault::UNUSED
        },
        PdoDefault {
            valid: true,
            inhibit: 20,
            timer: 100,
            entries: &[mapped(0x2004, 7, 32), mapped(0x2005, 1, 16), mapped(0x2000, 1, 8), mapped(0x2000, 3, 8)],
            ..PdoDefault::UNUSED
        },
        PdoDefault {
            inhibit: 20,
            timer: 100,
            entries: &[mapped(0x2004, 6, 32), mapped(0x2006, 1, 32)],
            ..PdoDefault::UNUSED
        },
    ],
};
const _: () = assert!(DEVICE.transmit.len() == PDOS);

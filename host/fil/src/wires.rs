//! Where the signals of the modelled board arrive at the chip: from the table that the firmware's own pins come from.

use edm_hal_shim::board::{F405, Pin as BoardPin};
use edm_soc::Pin;

const fn pin(signal: &str) -> Pin {
    let BoardPin { port, number } = F405::TABLE.pin(signal);
    Pin::new(port, number)
}

/// Crystal of the board, Hz.
pub const CRYSTAL_HZ: u64 = F405::TABLE.crystal_hz as u64;
/// Output of the bridge's duty.
pub const PWM: Pin = pin("pwm");
/// Bridge direction toward the work.
pub const FORWARD: Pin = pin("forward");
/// Bridge direction away from the work.
pub const REVERSE: Pin = pin("reverse");
/// Pulses allowed.
pub const ALLOW: Pin = pin("allow_pulses");
/// Edges while the program runs.
pub const LIVE: Pin = pin("live");
/// Arms the latch.
pub const ARM: Pin = pin("arm");
/// The latch.
pub const ARMED: Pin = pin("armed");
/// Encoder lines A, B and index.
pub const ENCODER: [Pin; 3] = [pin("encoder_a"), pin("encoder_b"), pin("encoder_index")];
/// Lets a host step.
pub const STEP_READY: Pin = pin("step_ready");
/// Steps of a host, and their direction.
pub const STEPS: [Pin; 2] = [pin("step"), pin("step_direction")];
/// The generator's gate, at both its pins.
pub const GATE: [Pin; 2] = [pin("gate"), pin("gate_start")];
/// Comparators of the gap voltage: high, low.
pub const COMPARATORS: [Pin; 2] = [pin("comparator_high"), pin("comparator_low")];
/// Contact of the dielectric.
pub const DIELECTRIC: Pin = pin("dielectric");
/// Contacts in the order of [`edm_hal_shim::safety::SafetyInputs`]: open when the pin is high.
pub const CONTACTS: [Pin; 4] = [pin("upper_limit"), pin("lower_limit"), pin("emergency_stop"), DIELECTRIC];
/// Fault output of the bridge, low in a fault.
pub const BRIDGE_FAULT: Pin = pin("bridge_fault");

/// Converter channel of the gap voltage, free-running.
pub const GAP: u8 = F405::TABLE.adc_channel("gap_voltage");
/// Converter channel of the gap voltage, with the gate.
pub const GATED: u8 = F405::TABLE.adc_channel("gap_voltage_gated");
/// Converter channel of the gap current.
pub const GAP_CURRENT: u8 = F405::TABLE.adc_channel("gap_current");
/// Converter channel of the motor current.
pub const MOTOR_CURRENT: u8 = F405::TABLE.adc_channel("motor_current");
/// Converter channel of the bus voltage.
pub const BUS_VOLTAGE: u8 = F405::TABLE.adc_channel("bus_voltage");

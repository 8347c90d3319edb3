//! Safety inputs and the drive's own measurements.

/// Safety inputs as conditions, not levels: `true` is the unsafe reading. Normally closed contacts make a broken wire
/// read as unsafe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SafetyInputs {
    /// Upper limit switch open.
    pub upper_limit: bool,
    /// Lower limit switch open.
    pub lower_limit: bool,
    /// Emergency stop open.
    pub emergency_stop: bool,
    /// Dielectric level, flow or temperature not OK.
    pub dielectric: bool,
    /// H-bridge reports a fault.
    pub bridge_fault: bool,
}

/// Reads the safety inputs.
pub trait Safety {
    /// Conditions now, without debounce: the first edge stops, debounce only delays re-arming.
    fn read(&mut self) -> SafetyInputs;
}

/// Converter codes of the drive, 12 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DriveCodes {
    /// Motor current; mid-scale is zero.
    pub motor_current: u16,
    /// Bus voltage.
    pub bus_voltage: u16,
}

/// Measures the drive.
pub trait DriveSense {
    /// Newest conversions.
    fn read(&mut self) -> DriveCodes;
}

//! H-bridge of the drive: PWM and two direction inputs (drive, reverse, brake, coast).

/// What the bridge is to do until told otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Drive {
    /// All switches open. The de-energised state.
    #[default]
    Coast,
    /// Winding shorted: slows, does not hold a weight.
    Brake,
    /// Signed share of the bus voltage, [`Drive::FULL`] is all of it; positive toward the work.
    Duty(i16),
}

impl Drive {
    /// Full duty.
    pub const FULL: i16 = 10_000;
}

/// An H-bridge.
pub trait HBridge {
    /// Why an output could not be set.
    type Error: core::fmt::Debug;
    /// Applies `drive`. A change of sign switches off first, then the direction, then the new duty.
    fn apply(&mut self, drive: Drive) -> Result<(), Self::Error>;
}

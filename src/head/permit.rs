//! The permit to write flash: the processor stalls for up to half a second, so the head must neither drive nor spark meanwhile.

use edm_hal_shim::store::Permit;

/// Permit to store settings: while it is out, the bridge coasts, pulses are off and the head cannot be enabled.
///
/// Only a disabled head gives it, once at a time, and wants it back.
#[derive(Debug)]
pub struct WritePermit(());

impl WritePermit {
    /// For the planner alone, which keeps still until it has it back.
    pub(super) fn new() -> WritePermit {
        WritePermit(())
    }
}

impl Permit for WritePermit {
    /// Always: the head keeps still until it has the permit back.
    fn holds(&self) -> bool {
        true
    }
}

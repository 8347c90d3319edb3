//! Leave to write flash: the processor stalls for up to half a second, so the head must neither drive nor spark meanwhile.

use super::{Head, Refused, State};
use crate::path::Path;
use core::ops::DerefMut;
use edm_hal_shim::store::Permit;

/// Leave to store settings: while it is out, the bridge coasts, pulses are off and the head cannot be enabled.
///
/// Only a disabled head gives it, once at a time, and wants it back.
#[derive(Debug)]
pub struct Leave(());

impl Permit for Leave {
    /// Always: the head keeps still until it has the leave back.
    fn holds(&self) -> bool {
        true
    }
}

impl<P: DerefMut<Target = Path>> Head<P> {
    /// Gives leave to store settings, or says why not.
    pub fn give_leave(&mut self) -> Result<Leave, Refused> {
        if self.status.state != State::Disabled {
            return Err(Refused::State(self.status.state));
        }
        self.refuse_on_leave()?;
        self.on_leave = true;
        Ok(Leave(()))
    }

    /// Takes the leave back.
    pub fn end_leave(&mut self, _: Leave) {
        self.on_leave = false;
    }

    pub(super) fn refuse_on_leave(&self) -> Result<(), Refused> {
        if self.on_leave { Err(Refused::Storing) } else { Ok(()) }
    }
}

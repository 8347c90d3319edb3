//! WritePermit to write flash: the processor stalls for up to half a second, so the head must neither drive nor spark meanwhile.

use super::{Head, Refused, State};
use crate::path::Path;
use core::ops::DerefMut;
use edm_hal_shim::store::Permit;

/// WritePermit to store settings: while it is out, the bridge coasts, pulses are off and the head cannot be enabled.
///
/// Only a disabled head gives it, once at a time, and wants it back.
#[derive(Debug)]
pub struct WritePermit(());

impl Permit for WritePermit {
    /// Always: the head keeps still until it has the permit back.
    fn holds(&self) -> bool {
        true
    }
}

impl<P: DerefMut<Target = Path>> Head<P> {
    /// Gives the permit to write flash, or says why not.
    pub fn permit_write(&mut self) -> Result<WritePermit, Refused> {
        if self.status.state != State::Disabled {
            return Err(Refused::State(self.status.state));
        }
        self.refuse_while_storing()?;
        self.write_permitted = true;
        Ok(WritePermit(()))
    }

    /// Takes the permit back.
    pub fn end_write(&mut self, _: WritePermit) {
        self.write_permitted = false;
    }

    pub(super) fn refuse_while_storing(&self) -> Result<(), Refused> {
        if self.write_permitted { Err(Refused::Storing) } else { Ok(()) }
    }
}

//! Emergencies for faults of the head and for what of the stored values was lost.

use super::stored::Loss;
use super::{Drive, codes};
use crate::canopen::{NmtState, Node};
use crate::head::Fault;

impl Drive {
    /// Sends emergencies for new errors and for errors that have ended; of a node that waits to be booted, after the boot.
    pub(super) fn report_errors(&mut self, node: &mut Node) {
        if node.state() == NmtState::Initialising {
            return;
        }
        let now = (self.alarm, self.loss);
        let before = core::mem::replace(&mut self.reported, now);
        let (mut register, mut gone) = (0, false);
        if let Some(fault) = self.alarm {
            let (code, bits) = codes::error_code(fault);
            if before.0 != self.alarm {
                // A second fault that escalates the first is reported as well, with the first.
                let first = self.status.first.map_or(0, Fault::number);
                let cause = if fault == Fault::StepsNotFollowed { self.status.unfollowed as u8 } else { 0 };
                node.emergency(code, bits, [fault.number(), self.reason, first, cause, 0]);
            }
            register |= bits;
        } else {
            gone |= before.0.is_some();
        }
        if let Some(Loss { code: (code, bits), detail }) = self.loss {
            if before.1 != self.loss {
                node.emergency(code, bits, detail);
            }
            register |= bits;
        } else {
            gone |= before.1.is_some();
        }
        if gone {
            node.emergency_over(register);
        }
    }
}

//! Frames between the controller and the protocol's queues.

use super::supervise::host_is_alive;
use edm_hal_shim::stm32f4::bxcan::Frame;
use edm_hal_shim::stm32f4::can::{Receiver, Sender, next};
use heapless::spsc::{Consumer, Producer};

/// What arrives.
pub struct Receive {
    /// `None` when the controller did not start.
    pub(super) receiver: Option<Receiver>,
    pub(super) received: Producer<'static, Frame>,
}

/// What leaves.
pub struct Transmit {
    /// `None` when the controller did not start.
    pub(super) sender: Option<Sender>,
    pub(super) sending: Consumer<'static, Frame>,
}

impl Receive {
    /// Empties the controller: three frames at the most, and what arrives meanwhile.
    pub fn frames(&mut self) {
        let Some(receiver) = &mut self.receiver else { return };
        while let Some(frame) = next(receiver) {
            match frame {
                Ok(frame) => {
                    host_is_alive();
                    if self.received.enqueue(frame).is_err() {
                        defmt::warn!("CAN: queue full, frame dropped");
                    }
                }
                Err(_) => defmt::warn!("CAN: overrun"),
            }
        }
    }
}

impl Transmit {
    /// Fills the mailboxes.
    pub fn frames(&mut self) {
        let Some(sender) = &mut self.sender else { return };
        sender.clear();
        while let Some(frame) = self.sending.peek() {
            if !sender.send(frame) {
                break;
            }
            self.sending.dequeue();
        }
    }
}

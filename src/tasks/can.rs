//! Frames between the controller and the protocol's queues.

use super::supervise::host_is_alive;
use super::{Arrival, BACKLOG, LOST, PROTOCOL_VECTOR, SYNC_LENGTH, SYNCS};
use core::sync::atomic::Ordering::Relaxed;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::stm32f4::bxcan::{self, Data, Id, StandardId};
use edm_hal_shim::stm32f4::can::{Inbox, Receiver, Sender, sync_waits};
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_servo_head::canopen::Frame;
use heapless::spsc::{Consumer, Producer};

/// What arrives.
pub struct Receive {
    /// `None` when the controller did not start.
    pub(super) receiver: Option<Receiver>,
    pub(super) clock: Cycles,
    pub(super) received: Producer<'static, Arrival>,
}

/// What leaves.
pub struct Transmit {
    /// `None` when the controller did not start.
    pub(super) sender: Option<Sender>,
    pub(super) sending: Consumer<'static, Frame>,
}

impl Receive {
    /// Empties a FIFO of the controller: three frames at the most, and what arrives meanwhile.
    pub fn frames(&mut self, from: Inbox) {
        let stamp = self.clock.now();
        let Some(receiver) = &mut self.receiver else { return };
        loop {
            if from == Inbox::Sync {
                // Counted before it leaves: the servo task, which may come in between, sees it in the controller or in the
                // count.
                let Some(length) = sync_waits() else { break };
                if length == SYNC_LENGTH.load(Relaxed) {
                    SYNCS.store(SYNCS.load(Relaxed).wrapping_add(1), Relaxed);
                }
            }
            match receiver.next(from) {
                Some(Ok(frame)) => {
                    host_is_alive();
                    if let Some(frame) = from_bus(&frame)
                        && self.received.enqueue(Arrival { frame, stamp, syncs: SYNCS.load(Relaxed) }).is_err()
                    {
                        LOST.store(true, Relaxed);
                    }
                }
                Some(Err(_)) => LOST.store(true, Relaxed),
                None => break,
            }
        }
        rtic::pend(PROTOCOL_VECTOR);
    }
}

impl Transmit {
    /// Fills the mailboxes.
    pub fn frames(&mut self) {
        let Some(sender) = &mut self.sender else { return };
        sender.clear();
        while let Some(frame) = self.sending.peek() {
            if to_bus(frame).is_some_and(|frame| !sender.send(&frame)) {
                return;
            }
            self.sending.dequeue();
        }
        if BACKLOG.load(Relaxed) {
            BACKLOG.store(false, Relaxed);
            rtic::pend(PROTOCOL_VECTOR);
        }
    }
}

fn from_bus(frame: &bxcan::Frame) -> Option<Frame> {
    match (frame.id(), frame.data()) {
        (Id::Standard(id), Some(data)) => Frame::new(id.as_raw(), data),
        _ => None,
    }
}

fn to_bus(frame: &Frame) -> Option<bxcan::Frame> {
    Some(bxcan::Frame::new_data(StandardId::new(frame.id())?, Data::new(frame.data())?))
}

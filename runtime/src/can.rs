//! Frames between the controller and the protocol's rings.

use crate::Board;
use crate::board::Caller;
use crate::crossings::{Arrival, Signals};
use edm_crossing::ring::{Receiver, Sender};
use edm_hal_shim::can::{self, Inbox, Inboxes, Mailboxes, SyncInbox};
use edm_hal_shim::clock::Clock;
use edm_servo_head::canopen::Frame;

/// What arrives.
pub struct Receive<B: Board> {
    /// `None` when the controller did not start.
    pub(crate) inboxes: Option<B::Inboxes>,
    pub(crate) sync: B::Sync,
    pub(crate) clock: B::Clock,
    pub(crate) caller: B::Caller,
    pub(crate) signals: &'static Signals,
    pub(crate) received: Sender<'static, Arrival, 32>,
}

/// What leaves.
pub struct Transmit<B: Board> {
    /// `None` when the controller did not start.
    pub(crate) mailboxes: Option<B::Mailboxes>,
    pub(crate) caller: B::Caller,
    pub(crate) signals: &'static Signals,
    pub(crate) sending: Receiver<'static, Frame, 8>,
}

impl<B: Board> Receive<B> {
    /// Empties an inbox of the controller: three frames at the most, and what arrives meanwhile.
    pub fn frames(&mut self, from: Inbox) {
        let stamp = self.clock.now();
        let Some(inboxes) = &mut self.inboxes else { return };
        loop {
            if from == Inbox::Sync {
                // Counted before it leaves: the servo task, which may come in between, sees it in the controller or in the
                // count.
                let Some(length) = self.sync.waits() else { break };
                if u32::from(length) == self.signals.sync_length.load() {
                    self.signals.syncs.increment();
                }
            }
            match inboxes.next(from) {
                Some(Ok(frame)) => {
                    self.signals.host.set();
                    if let Some(frame) = from_bus(&frame) {
                        self.received.send(Arrival { frame, stamp, syncs: self.signals.syncs.read() });
                    }
                }
                Some(Err(can::Overrun)) => self.signals.overruns.increment(),
                None => break,
            }
        }
        self.caller.protocol();
    }
}

impl<B: Board> Transmit<B> {
    /// Fills the mailboxes.
    pub fn frames(&mut self) {
        let Some(mailboxes) = &mut self.mailboxes else { return };
        mailboxes.acknowledge();
        while let Some(frame) = self.sending.peek() {
            if to_bus(frame).is_some_and(|frame| !mailboxes.send(&frame)) {
                return;
            }
            self.sending.receive();
        }
        if self.signals.backlog.take() {
            self.caller.protocol();
        }
    }
}

/// Remote frames and 29-bit identifiers mean nothing to a node.
fn from_bus(frame: &impl can::Frame) -> Option<Frame> {
    match frame.id() {
        can::Id::Standard(id) if frame.is_data_frame() => Frame::new(id.as_raw(), frame.data()),
        _ => None,
    }
}

fn to_bus<F: can::Frame>(frame: &Frame) -> Option<F> {
    F::new(can::StandardId::new(frame.id())?, frame.data())
}

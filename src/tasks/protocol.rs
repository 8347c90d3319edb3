//! The host's frames in and out: `remote` knows what they mean.

use super::{Answer, NODE, PROTOCOL, ROLL, Request, WAITING};
use core::sync::atomic::Ordering::Relaxed;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::stm32f4::bxcan::{Data, Frame, Id, StandardId};
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_servo_head::head::Status;
use edm_servo_head::remote::{self, Heartbeat};
use heapless::spsc::{Consumer, Producer};

/// Queues of the protocol.
pub struct Protocol {
    pub(super) clock: Cycles,
    pub(super) heartbeat: Heartbeat,
    pub(super) received: Consumer<'static, Frame>,
    pub(super) requests: Producer<'static, Request>,
    pub(super) answers: Consumer<'static, Answer>,
    pub(super) published: Consumer<'static, Status>,
    pub(super) sending: Producer<'static, Frame>,
}

impl Protocol {
    /// Requests in, answers, reports and heartbeat out.
    pub fn run(&mut self) {
        while let Some(frame) = self.received.dequeue() {
            let to_us = StandardId::new(remote::COMMAND | u16::from(NODE)).map(Id::Standard) == Some(frame.id());
            let (Some(data), true) = (frame.data(), to_us) else { continue };
            let number = data.first().copied().unwrap_or(0);
            match remote::request(data) {
                Some(request) if self.requests.enqueue((number, request)).is_ok() => WAITING.store(true, Relaxed),
                _ => self.send(remote::ANSWER, &remote::unknown(number)),
            }
        }
        while let Some((number, result)) = self.answers.dequeue() {
            self.send(remote::ANSWER, &remote::answer(number, result));
        }
        while let Some(status) = self.published.dequeue() {
            self.send(remote::REPORT, &remote::report(&status));
            if let Some(content) = self.heartbeat.with_report() {
                self.send(remote::HEARTBEAT, &[content]);
            }
        }
        ROLL.report(PROTOCOL, self.clock.now());
    }

    fn send(&mut self, identifier: u16, data: &[u8]) {
        let id = StandardId::new(identifier | u16::from(NODE));
        if let (Some(id), Some(data)) = (id, Data::new(data)) {
            // A full queue means that nobody listens.
            let _ = self.sending.enqueue(Frame::new_data(id, data));
        }
    }
}

//! What has no deadline: the task watchdog, the log, what is stored in flash, the resets of a host.

use crate::Board;
use crate::board::Caller;
use crate::crossings::{MS, Reset, Signals, StorageJob};
use crate::image_store::ImageStore;
use crate::note::Note;
use crate::protocol::Protocol;
use edm_crossing::ring::{Receiver, Sender};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::EdgeGuard;
use edm_hal_shim::watchdog::Watchdog;
use edm_servo_head::head::WritePermit;
use rtic_core::Mutex;

/// Cycles from a reset by the host to boot-up. Hosts begin to wait for it after they have sent the reset, and miss one that
/// comes at once.
const START_UP: u32 = 50 * MS;

/// What idle owns.
pub struct Idle<B: Board> {
    pub(crate) watchdog: B::Watchdog,
    pub(crate) image_store: ImageStore<B>,
    pub(crate) guard: B::Guard,
    pub(crate) clock: B::Clock,
    pub(crate) caller: B::Caller,
    pub(crate) signals: &'static Signals,
    /// The host has reset the node, at this count.
    pub(crate) reset: Option<u32>,
    pub(crate) granted: Receiver<'static, (StorageJob, WritePermit), 1>,
    pub(crate) returned: Sender<'static, WritePermit, 1>,
    pub(crate) resets: Receiver<'static, Reset, 4>,
}

impl<B: Board> Idle<B> {
    /// One round.
    pub fn round(&mut self, protocol: &mut impl Mutex<T = Protocol<B>>) {
        match self.signals.task_watchdog.missing(self.clock.now()) {
            None => self.watchdog.feed(),
            Some(task) => self.watchdog.silent(task),
        }
        if self.signals.clock_lost.take() {
            self.clock.restart();
        }
        if self.signals.second.take() {
            let status = protocol.lock(|protocol| *protocol.status());
            self.caller.note(&Note::Status(status));
            self.caller.note(&Note::Pulses(self.caller.pulse()));
        }
        if let Some((job, permit)) = self.granted.receive() {
            self.change(job, permit, protocol);
        }
        let begun = match self.resets.peek() {
            None => false,
            Some(Reset::Communication) => true,
            Some(Reset::Node) => {
                let image = self.image_store.load_watched(&mut self.watchdog);
                let report = protocol.lock(|protocol| protocol.restart(image));
                if let Some(report) = report {
                    self.caller.note(&Note::Loaded(report));
                }
                report.is_some()
            }
        };
        if begun {
            self.resets.receive();
            self.reset = Some(self.clock.now());
        }
        let now = self.clock.now();
        if self.reset.take_if(|since| now.wrapping_sub(*since) >= START_UP).is_some() {
            let image = self.image_store.load_watched(&mut self.watchdog);
            self.caller.note(&Note::booted(protocol.lock(|protocol| protocol.boot(image))));
        }
    }

    fn change(&mut self, job: StorageJob, permit: WritePermit, protocol: &mut impl Mutex<T = Protocol<B>>) {
        let compose = |image: &mut _| protocol.lock(|protocol| protocol.keep(job, image));
        let result = self.image_store.change(&permit, &mut self.watchdog, compose);
        // Nobody could report or decode an edge while the flash was erased.
        self.guard.missed();
        self.signals.task_watchdog.start(self.clock.now());
        // Back before anybody is answered, who may want the next.
        self.returned.send(permit);
        self.signals.waiting.set();
        protocol.lock(|protocol| protocol.done(job, result));
    }
}

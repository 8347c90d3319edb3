//! What has no deadline: the task watchdog, the log, what is kept and stored, the resets of a host.

use crate::Board;
use crate::board::Caller;
use crate::crossings::{MS, Reset, Signals, StorageJob};
use crate::image_store::ImageStore;
use crate::note::Note;
use crate::protocol::Protocol;
use crate::staging::{Due, Piece, Staging};
use edm_crossing::ring::{Receiver, Sender};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::EdgeGuard;
use edm_hal_shim::watchdog::Watchdog;
use edm_servo_head::backup::Keeper;
use edm_servo_head::canopen::Update;
use edm_servo_head::head::WritePermit;
use rtic_core::Mutex;

/// Cycles from a reset by the host to boot-up. Hosts begin to wait for it after they have sent the reset, and miss one that
/// comes at once.
const START_UP: u32 = 50 * MS;

/// Cycles between two looks at what is to be kept over a power cut: less than a count of feed in a hole, at 0.1 mm/s.
const KEEPS: u32 = 10 * MS;

/// What idle owns.
pub struct Idle<B: Board> {
    pub(crate) watchdog: B::Watchdog,
    pub(crate) image_store: ImageStore<B>,
    pub(crate) keeper: Keeper<B::Backup>,
    /// Count of the newest look at what is to be kept.
    pub(crate) kept: u32,
    pub(crate) staging: Staging<B::Stage>,
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
    pub fn round(&mut self, protocol: &mut impl Mutex<T = &'static mut Protocol<B>>) {
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
        let now = self.clock.now();
        if now.wrapping_sub(self.kept) >= KEEPS {
            self.kept = now;
            let backup = protocol.lock(|protocol| protocol.drive().backup());
            self.keeper.keep(&backup);
        }
        if let Some((job, permit)) = self.granted.receive() {
            match job {
                StorageJob::Update(update) => self.update(update, permit, protocol),
                _ => self.change(job, permit, protocol),
            }
        }
        match self.staging.due(self.clock.now()) {
            Due::Nothing => {}
            Due::Sector => self.erase(protocol),
            Due::Restart => self.restart(protocol),
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

    /// A part of an update of the program.
    fn update(&mut self, update: Update, permit: WritePermit, protocol: &mut impl Mutex<T = &'static mut Protocol<B>>) {
        let piece = protocol.lock(|protocol| protocol.node().piece().and_then(Piece::of));
        let patient = Staging::<B::Stage>::takes_long(update).then(|| self.watchdog.erase());
        let (result, permit) = self.staging.run(update, piece, permit, self.clock.now());
        if patient.is_some_and(|patient| patient.and(self.watchdog.normal()).is_err()) {
            self.caller.note(&Note::WatchdogStuck);
        }
        self.give_back(permit);
        let status = self.staging.status();
        protocol.lock(|protocol| protocol.updated(result, status));
    }

    /// Erases one sector of the stage; the processor stands still meanwhile.
    fn erase(&mut self, protocol: &mut impl Mutex<T = &'static mut Protocol<B>>) {
        let patient = self.watchdog.erase();
        let clock = self.clock;
        let permit = self.staging.erase(|| clock.now());
        if patient.and(self.watchdog.normal()).is_err() {
            self.caller.note(&Note::WatchdogStuck);
        }
        self.guard.missed();
        self.signals.task_watchdog.start(self.clock.now());
        self.give_back(permit);
        let status = self.staging.status();
        protocol.lock(|protocol| protocol.staged(status));
    }

    /// Starts the program that was staged.
    fn restart(&mut self, protocol: &mut impl Mutex<T = &'static mut Protocol<B>>) {
        let permit = self.staging.restart();
        self.give_back(permit);
        let id = self.staging.id();
        protocol.lock(|protocol| protocol.begin_anew(id));
    }

    fn give_back(&mut self, permit: Option<WritePermit>) {
        if let Some(permit) = permit {
            self.returned.send(permit);
            self.signals.waiting.set();
        }
    }

    fn change(
        &mut self,
        job: StorageJob,
        permit: WritePermit,
        protocol: &mut impl Mutex<T = &'static mut Protocol<B>>,
    ) {
        let compose = |image: &mut _| protocol.lock(|protocol| protocol.keep(job, image));
        let result = self.image_store.change(&permit, &mut self.watchdog, compose);
        // Nobody could report or decode an edge while the flash was erased.
        self.guard.missed();
        self.signals.task_watchdog.start(self.clock.now());
        // Back before anybody is answered, who may want the next.
        self.give_back(Some(permit));
        protocol.lock(|protocol| protocol.done(job, result));
    }
}

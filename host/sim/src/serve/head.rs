//! One virtual head: the tasks of a head on the process model, those of the bus included, and what it keeps when its power is
//! cut.
//!
//! The frames of a tick come before it: the interrupts of the controller take them, the protocol deals with them, and what it
//! orders is carried out in the tick that follows. What a task asks for runs as soon as no task of higher priority has
//! anything to do.

use crate::board::{PROTOCOL, Part, Pc, Ports, TRANSMIT};
use crate::bore::Setup;
use crate::machine::{Core, Others, show};
use crate::process::Process;
use crate::store::Store;
use edm_bus::Frame;
use edm_hal_shim::store::BUFFER;
use edm_runtime::Note;
use edm_runtime::can::{Receive, Transmit};
use edm_runtime::idle::Idle;
use edm_runtime::keeper::Keeper;
use edm_runtime::protocol::Protocol;
use edm_servo_head::canopen::drive::{BLANK, DEVICE, Drive, Identity};
use edm_servo_head::canopen::{Node, NodeId};
use edm_servo_head::head::Status;
use edm_servo_head::settings::{SettingError, Settings};
use rtic_core::Mutex;

/// A head on the bus.
pub struct Head {
    /// The machine and the process.
    pub process: Process,
    pub(crate) core: Core,
    pub(crate) receive: Receive<Pc>,
    pub(crate) transmit: Transmit<Pc>,
    pub(crate) protocol: Alone<Protocol<Pc>>,
    pub(crate) idle: Idle<Pc>,
    id: NodeId,
}

/// What tasks share, where no task comes in between.
pub(crate) struct Alone<T>(pub T);

impl<T> Mutex for Alone<T> {
    type T = T;
    fn lock<R>(&mut self, f: impl FnOnce(&mut T) -> R) -> R {
        f(&mut self.0)
    }
}

impl Head {
    /// A head that has just been switched on.
    ///
    /// # Errors
    /// When the values do not fit together.
    pub fn new(setup: &Setup, id: NodeId, seed: u64, store: Store) -> Result<Head, String> {
        // The virtual head's guided check counts as passed: it needs an axis without a workpiece.
        let settings = Settings { commissioned: true, ..setup.head };
        let mut process = Process::new(&setup.process, seed).map_err(|error| setup.refusal(error))?;
        process.schedule(&setup.events);
        let head = Head::of(process, settings, id, store).map_err(|error| setup.refusal(error))?;
        head.complain();
        Ok(head)
    }

    /// A head on this process, that runs these settings when nothing is stored.
    ///
    /// # Errors
    /// When the settings do not fit together.
    pub fn of(process: Process, settings: Settings, id: NodeId, store: Store) -> Result<Head, SettingError> {
        // For as long as the program runs, as on the chip.
        let record = Box::leak(Box::new(BLANK));
        let identity = Identity { reset_cause: 0, build: concat!("virtual ", env!("CARGO_PKG_VERSION")) };
        let drive = Box::leak(Box::new(Drive::new(settings, identity, record)?));
        let node = Box::leak(Box::new(Node::new(&DEVICE, id, id.get().into())));
        // The head begins with what the drive says then, which is what was stored if that can be.
        let ports = Ports::leak();
        let mut keeper = Keeper::new(store, Box::leak(Box::new([0; BUFFER])), Part(ports));
        let kept = keeper.load();
        let refused = drive.restart(settings, kept.application()).err().map(Note::SettingsRefused);
        let unfit = node.boot(kept.communication(), drive).err().map(Note::ParametersRefused);
        drive.started();
        show(ports, &process);
        let (core, others) = Core::on(ports, drive.active());
        ports.notes.borrow_mut().extend(refused.into_iter().chain(unfit));
        let [sync, others_of_node @ ..] = node.identifiers();
        edm_hal_shim::can::Filters::listen(&mut Part(ports), sync, &others_of_node);
        let Others { host, idle, receive, transmit } = others;
        let protocol = Alone(host.protocol(node, drive, settings));
        let idle = idle.idle(Part(ports), keeper);
        Ok(Head { process, core, receive, transmit, protocol, idle, id })
    }

    /// What the head knows after the last tick.
    pub fn status(&self) -> &Status {
        self.core.status()
    }

    /// The protocol.
    pub fn protocol(&self) -> &Protocol<Pc> {
        &self.protocol.0
    }

    /// One servo tick: takes the frames that have come since the last, appends those to be sent.
    pub fn tick<'a>(&mut self, came: impl Iterator<Item = &'a Frame>, sent: &mut Vec<Frame>) {
        for frame in came {
            if let Some(inbox) = self.core.ports.arrives(frame) {
                self.receive.frames(inbox);
            }
            self.wanted();
        }
        let supervised = self.core.tick(&mut self.process);
        self.wanted();
        if supervised {
            self.idle.round(&mut self.protocol);
            self.wanted();
            self.complain();
        }
        sent.extend(self.core.ports.outbox.borrow_mut().drain(..));
    }

    /// Runs what was asked for: transmission before the protocol, by their priorities.
    fn wanted(&mut self) {
        loop {
            if self.core.ports.wanted(TRANSMIT) {
                self.transmit.frames();
            } else if self.core.ports.wanted(PROTOCOL) {
                self.protocol.0.run();
            } else {
                return;
            }
        }
    }

    /// Says what went wrong.
    fn complain(&self) {
        for note in self.core.ports.notes.borrow_mut().drain(..) {
            let what = match note {
                Note::StoreUnreadable => "what is stored cannot be read, and is not used".into(),
                Note::StoreForeign => "what is stored is damaged or of another firmware, and is not used".into(),
                Note::SettingsRefused(error) => format!("the stored settings are refused: {error}"),
                Note::ParametersRefused(error) => {
                    format!("the stored communication parameters are refused: {error:?}")
                }
                Note::NotStored => "nothing was stored".into(),
                Note::Lost { frames, events } => format!("lost since the start: {frames} frames, {events} events"),
                _ => continue,
            };
            eprintln!("node {}: {what}", self.id.get());
        }
    }
}

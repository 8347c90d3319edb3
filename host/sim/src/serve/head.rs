//! One virtual head: the tasks of a head on the process model, those of the bus included, and what it keeps when its power is
//! cut.
//!
//! The frames of a tick come before it: the interrupts of the controller take them, the protocol deals with them, and what it
//! orders is carried out in the tick that follows. A requested task runs as soon as no task of higher
//! priority is active.

use crate::battery::Battery;
use crate::board::{PROTOCOL, Part, Pc, Ports, TRANSMIT};
use crate::machine::{Core, Others, leak, show};
use crate::process::Process;
use crate::run::Setup;
use crate::stage::Memory;
use crate::store::Store;
use edm_bus::Frame;
use edm_hal_shim::bridge::Drive as Output;
use edm_hal_shim::self_test::SelfTest;
use edm_hal_shim::store::BUFFER;
use edm_runtime::Note;
use edm_runtime::board::Caller;
use edm_runtime::can::{Receive, Transmit};
use edm_runtime::idle::Idle;
use edm_runtime::image_store::ImageStore;
use edm_runtime::protocol::Protocol;
use edm_servo_head::backup::Keeper;
use edm_servo_head::canopen::drive::{BLANK, DEVICE, Drive, Identity, Lost};
use edm_servo_head::canopen::{BusSettings, Node, NodeId};
use edm_servo_head::head::Status;
use edm_servo_head::settings::{SettingError, Settings};
use edm_servo_head::technology::Pulse;
use edm_servo_head::units::TICK_HZ;
use rtic_core::Mutex;

/// A head on the bus.
pub struct Head {
    /// The machine and the process.
    pub process: Process,
    pub(crate) core: Core,
    pub(crate) receive: Receive<Pc>,
    pub(crate) transmit: Transmit<Pc>,
    pub(crate) protocol: Alone<&'static mut Protocol<Pc>>,
    pub(crate) idle: Idle<Pc>,
    kept: Kept,
    /// What its generator is set to, as a row of a technology table says.
    pulse: Pulse,
}

/// What a head is when its power comes back.
#[derive(Clone)]
struct Kept {
    settings: Settings,
    id: (Option<NodeId>, u32),
    store: Store,
    battery: Battery,
    self_test: SelfTest,
}

/// Data that tasks share, without preemption.
pub(crate) struct Alone<T>(pub T);

impl<T> Mutex for Alone<T> {
    type T = T;
    fn lock<R>(&mut self, f: impl FnOnce(&mut T) -> R) -> R {
        f(&mut self.0)
    }
}

impl Head {
    /// A head that has just been switched on: node-ID when none is stored, serial number.
    ///
    /// # Errors
    /// When the values do not fit together.
    pub fn new(setup: &Setup, id: (Option<NodeId>, u32), seed: u64, store: Store) -> Result<Head, String> {
        // The virtual head's commissioning counts as passed: it needs an axis without a workpiece.
        let settings = Settings { commissioned: true, ..setup.head };
        let mut process = Process::new(setup.process, seed).map_err(|error| setup.refusal(error))?;
        process.schedule(&setup.events);
        let head = Head::of(process, settings, id, store, SelfTest::PASSED);
        let head = head.map_err(|error| setup.refusal(error))?;
        head.complain();
        Ok(head)
    }

    /// A head on this process. Settings and node-ID apply when nothing is stored; serial number and result of the self-test
    /// are the board's.
    ///
    /// # Errors
    /// When the settings do not fit together.
    pub fn of(
        process: Process,
        settings: Settings,
        id: (Option<NodeId>, u32),
        store: Store,
        self_test: SelfTest,
    ) -> Result<Head, SettingError> {
        let battery = store.battery();
        Head::switched_on(process, Kept { settings, id, store, battery, self_test })
    }

    /// The power is cut for some seconds: the bridge coasts, pulses are off. What is stored and what the memory with a cell keeps is there
    /// afterwards, the process goes on.
    ///
    /// # Errors
    /// When the settings do not fit together.
    pub fn cut_power(self, seconds: f64) -> Result<Head, SettingError> {
        let Head { mut process, kept, .. } = self;
        for _ in 0..(seconds * f64::from(TICK_HZ)) as u64 {
            process.advance(Output::Coast, false);
        }
        Head::switched_on(process, kept)
    }

    /// The memory with a cell.
    pub fn battery(&self) -> &Battery {
        &self.kept.battery
    }

    fn switched_on(process: Process, kept: Kept) -> Result<Head, SettingError> {
        let Kept { settings, id: (node, serial), store, battery, self_test } = kept.clone();
        // For as long as the program runs, as on the chip.
        let record = Box::leak(Box::new(BLANK));
        let build = concat!("virtual ", env!("CARGO_PKG_VERSION"));
        let identity = Identity { build, self_test, ..Identity::default() };
        let drive = Box::leak(Box::new(Drive::new(settings, identity, record)?));
        // The head begins with what the drive says then, which is what was stored if that can be.
        let ports = Ports::leak();
        ports.self_test.set(self_test);
        let (buffer, image) = (Box::leak(Box::new([0; BUFFER])), Box::leak(Box::default()));
        let mut image_store = ImageStore::new(store, buffer, image, Part(ports));
        let image = image_store.load();
        let bus = image.bus().unwrap_or(BusSettings::at_1_mbit(node));
        let node = Box::leak(Box::new(Node::new(&DEVICE, bus, serial)));
        Part(ports).note(&Note::Loaded(drive.restart(settings, image)));
        Part(ports).note(&Note::booted(drive.boot(node, image)));
        let mut keeper = Keeper::new(battery);
        drive.recall(keeper.load());
        drive.started();
        show(ports, &process);
        let (core, others) = Core::on(ports, drive.active());
        let [sync, others_of_node @ ..] = node.identifiers();
        edm_hal_shim::can::Filters::listen(&mut Part(ports), sync, &others_of_node);
        let Others { host, idle, receive, transmit } = others;
        let protocol = Alone(host.protocol(leak(), node, drive, &settings));
        let idle = idle.idle(Part(ports), image_store, keeper, Memory::default());
        Ok(Head { process, core, receive, transmit, protocol, idle, kept, pulse: Pulse::default() })
    }

    /// What the head knows after the last tick.
    pub fn status(&self) -> &Status {
        self.core.status()
    }

    /// Its node-ID now, if it has one.
    pub fn node_id(&self) -> Option<NodeId> {
        self.protocol().node().bus().node
    }

    /// Bit rate that its controller has, bit/s.
    pub fn bit_rate(&self) -> u32 {
        self.core.ports.bit_rate.get()
    }

    /// The protocol.
    pub fn protocol(&self) -> &Protocol<Pc> {
        self.protocol.0
    }

    /// Whether the generator may pulse after the last tick.
    pub fn pulses(&self) -> bool {
        self.core.ports.pulses.get()
    }

    /// Output of the bridge in the last tick.
    pub fn drive(&self) -> Output {
        self.core.ports.drive.get()
    }

    /// A frame has come.
    pub fn receive(&mut self, frame: &Frame) {
        if let Some(inbox) = self.core.ports.arrives(frame) {
            self.receive.frames(inbox);
        }
        self.wanted();
    }

    /// One servo tick: takes the frames that have come since the last, appends those to be sent.
    pub fn tick<'a>(&mut self, came: impl Iterator<Item = &'a Frame>, sent: &mut Vec<Frame>) {
        came.for_each(|frame| self.receive(frame));
        let supervised = self.core.tick(&mut self.process);
        self.wanted();
        if supervised {
            // Whatever sets a generator on the bus does it within a millisecond.
            let pulse = self.protocol().drive().pulse();
            if std::mem::replace(&mut self.pulse, pulse) != pulse {
                self.process.set_generator(&pulse);
            }
            self.idle.round(&mut self.protocol);
            self.wanted();
            self.complain();
        }
        sent.extend(self.core.ports.outbox.borrow_mut().drain(..));
    }

    /// Runs requested tasks: transmission before the protocol, by their priorities.
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

    /// Prints what went wrong.
    fn complain(&self) {
        for note in self.core.ports.notes.borrow_mut().drain(..) {
            let what = match note {
                Note::StoreUnreadable => "the stored settings cannot be read and are not used".into(),
                Note::Loaded(report) if !report.is_whole() => report.to_string(),
                Note::BootRefused(error) => format!("communication: {error:?}"),
                Note::NotStored => "the settings could not be stored".into(),
                Note::Lost(Lost { frames, events, ticks, blocks, unseen: [high, low], rings }) => format!(
                    "lost since the start: {frames} frames, {events} events, {ticks} servo ticks, {blocks} blocks; \
                     thousands of pulses without an edge of a comparator: {high} high, {low} low; blocks with a ringing gate: {rings}"
                ),
                _ => continue,
            };
            match self.node_id() {
                Some(id) => eprintln!("node {}: {what}", id.get()),
                None => eprintln!("unconfigured head: {what}"),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_hal_shim::store::Storage as _;
    use edm_servo_head::canopen::Group;
    use edm_servo_head::stored::{LoadReport, Outcome, StoredImage};
    use embedded_can::{Frame as _, StandardId};
    use std::fs;
    use std::path::Path;

    /// A head that has just been switched on, with what is stored in a folder.
    fn switched_on(folder: &Path) -> Head {
        let store = Store::new(Some(folder), "node-5").unwrap();
        Head::new(&Setup::load("default").unwrap(), (NodeId::new(5), 5), 1, store).unwrap()
    }

    /// Where a folder has what its head has stored: everything.
    fn stored_in(folder: &Path) -> std::path::PathBuf {
        let mut head = switched_on(folder);
        assert_eq!(head.protocol().drive().loaded(), LoadReport::default());
        let save = [0x23, 0x10, 0x10, 1, b's', b'a', b'v', b'e'];
        let frame = Frame::new(StandardId::new(0x605).unwrap(), &save).unwrap();
        let mut sent = Vec::new();
        head.tick([frame].iter(), &mut sent);
        for _ in 0..200 {
            head.tick([].iter(), &mut sent);
        }
        let answer = sent.iter().find(|frame| frame.id() == StandardId::new(0x585).unwrap().into());
        assert_eq!(answer.map(|frame| frame.data()[0]), Some(0x60), "{sent:?}");
        folder.join("node-5.stored")
    }

    #[test]
    fn a_file_has_the_bytes_that_a_chip_has_in_its_flash() {
        let folder = tempfile::tempdir().unwrap();
        let file = fs::read(stored_in(folder.path())).unwrap();
        let head = switched_on(folder.path());
        assert_eq!(head.protocol().drive().loaded().outcome, Outcome::Newest);
        let mut image = StoredImage::NOTHING;
        image.keep(Group::All, head.protocol().drive(), head.protocol().node()).unwrap();
        assert_eq!(image.bytes(), file);
    }

    #[test]
    fn whichever_bit_of_the_file_flips_the_defaults_are_in_force_and_no_commissioning_counts() {
        let folder = tempfile::tempdir().unwrap();
        let path = stored_in(folder.path());
        let good = fs::read(&path).unwrap();
        let mut image = StoredImage::NOTHING;
        for bit in 0..8 * good.len() {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            // As read from a file, without the time that files take.
            let outcome = image.load(Store::memory(Some(bad)).load(&mut [0; BUFFER]).unwrap());
            assert_eq!(outcome, Outcome::Damaged, "bit {bit}");
        }
        for bit in [0, 20, 8 * good.len() - 1] {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            fs::write(&path, &bad).unwrap();
            let head = switched_on(folder.path());
            assert_eq!(head.protocol().drive().loaded().outcome, Outcome::Damaged);
            assert!(!head.protocol().drive().settings().commissioned);
        }
        fs::write(&path, &good).unwrap();
        assert!(switched_on(folder.path()).protocol().drive().settings().commissioned);
    }
}

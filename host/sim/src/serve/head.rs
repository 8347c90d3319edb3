//! One virtual head: machine, control core, CANopen drive, and what it keeps when its power is cut.
//!
//! Frames and orders are dealt with in every servo tick, before the tick itself: a SYNC acts in the tick that it came
//! before. What the drive does once a millisecond, it does here as well.

use super::store::Store;
use crate::bore::Setup;
use crate::machine::Machine;
use edm_bus::Frame;
use edm_hal_shim::store::Loaded;
use edm_servo_head::canopen::drive::{BLANK, DEVICE, Drive, Identity, Order};
use edm_servo_head::canopen::{self, Abort, Node, NodeId, Time};
use edm_servo_head::head::Reason;
use edm_servo_head::settings::Settings;
use edm_servo_head::stored::{Full, LoadReport, StoredImage};
use edm_servo_head::units::TICK_HZ;
use embedded_can::{Frame as _, Id, StandardId};

const TICKS_PER_MS: u64 = TICK_HZ as u64 / 1000;
const TICK_US: u64 = 1_000_000 / TICK_HZ as u64;
/// Ticks from a reset by the host to boot-up. Hosts begin to wait for it after they have sent the reset, and miss one that
/// comes at once.
const START_UP: u64 = 50 * TICKS_PER_MS;

/// A head on the bus.
pub struct Head {
    machine: Machine,
    drive: Drive,
    node: Node,
    store: Store,
    /// What is stored, while it is read or written.
    image: Box<StoredImage>,
    /// Settings of the scenario, for a store that is empty.
    settings: Settings,
    ticks: u64,
    /// The node is reset, and boots at this tick.
    boots: Option<u64>,
}

impl Head {
    /// A head that has just been switched on.
    ///
    /// # Errors
    /// When the values do not fit together.
    pub fn new(setup: &Setup, id: NodeId, seed: u64, store: Store) -> Result<Head, String> {
        // The virtual head's guided check counts as passed: it needs an axis without a workpiece.
        let settings = Settings { commissioned: true, ..setup.head };
        let refusal = |error| setup.refusal(error);
        let mut machine = Machine::new(&setup.process, &settings, seed).map_err(refusal)?;
        machine.process.schedule(&setup.events);
        let identity = Identity { reset_cause: 0, build: concat!("virtual ", env!("CARGO_PKG_VERSION")) };
        // For as long as the program runs, as on the chip.
        let record = Box::leak(Box::new(BLANK));
        let drive = Drive::new(settings, identity, record).map_err(refusal)?;
        let node = Node::new(&DEVICE, id, id.get().into());
        let image = Box::default();
        let mut head = Head { machine, drive, node, store, image, settings, ticks: 0, boots: None };
        head.restart();
        head.boot();
        Ok(head)
    }

    /// The machine behind the head.
    pub fn machine(&mut self) -> &mut Machine {
        &mut self.machine
    }

    /// One servo tick: takes the frames that have come since the last, appends those to be sent.
    pub fn tick<'a>(&mut self, came: impl Iterator<Item = &'a Frame>, sent: &mut Vec<Frame>) {
        let now = Time(self.ticks * TICK_US);
        let whole = self.ticks.is_multiple_of(TICKS_PER_MS);
        if whole {
            self.observe();
        }
        if self.boots.take_if(|at| *at <= self.ticks).is_some() {
            self.boot();
        }
        for frame in came.filter_map(from_bus) {
            // What the filters of a controller would let through.
            self.machine.host_alive |= self.node.identifiers().contains(&frame.id());
            self.node.receive(&frame, now, &mut self.drive);
        }
        self.node.synchronised(now, &mut self.drive);
        if whole {
            self.node.poll(now, &mut self.drive);
            self.drive.poll(now, &mut self.node);
        }
        while let Some(order) = self.drive.take() {
            if !self.carry_out(order) {
                break;
            }
        }
        while let Some(frame) = self.node.take() {
            sent.extend(to_bus(&frame));
        }
        self.machine.tick();
        self.ticks += 1;
        if self.ticks.is_multiple_of(TICKS_PER_MS) {
            self.machine.host_alive = false;
        }
    }

    fn observe(&mut self) {
        self.drive.observe(self.machine.head.status());
        while let Some(change) = self.machine.head.next_change() {
            self.drive.changed(change);
            if let (Reason::CheckEnded, Some(result)) = (change.reason, self.machine.head.check_result()) {
                self.drive.checked(result);
            }
        }
    }

    /// Does what the drive wants done; false when that has to wait for another tick.
    fn carry_out(&mut self, order: Order) -> bool {
        match order {
            Order::Command(command) => {
                let result = self.machine.head.command(command);
                self.drive.answered(command, result);
            }
            Order::Configure => {
                if self.machine.configure(self.drive.active()).is_err() {
                    self.drive.configure_again();
                    return false;
                }
            }
            Order::Raise(fault) => self.machine.head.raise(fault),
            Order::Store(group) => {
                let result = self.change(|image, drive, node| image.keep(group, drive, node));
                self.drive.kept(&mut self.node, result);
            }
            Order::Restore(group) => {
                let result = self.change(|image, _, _| {
                    image.forget(group);
                    Ok(())
                });
                self.drive.kept(&mut self.node, result);
            }
            Order::ResetNode => {
                self.restart();
                self.boots = Some(self.ticks + START_UP);
            }
            Order::ResetCommunication => self.boots = Some(self.ticks + START_UP),
        }
        true
    }

    fn change(
        &mut self,
        change: impl FnOnce(&mut StoredImage, &Drive, &Node) -> Result<(), Full>,
    ) -> Result<(), Abort> {
        let leave = self.machine.head.give_leave().map_err(|_| Abort::DeviceState)?;
        self.read();
        let changed = change(&mut self.image, &self.drive, &self.node).map_err(|_| Abort::OutOfMemory);
        let result = changed.and_then(|()| {
            self.store.save(self.image.bytes()).map_err(|error| {
                self.complain(&error.to_string());
                Abort::Hardware
            })
        });
        self.machine.head.end_leave(leave);
        result
    }

    /// Reads what is stored.
    fn read(&mut self) {
        let stored = self.store.load();
        let found = match &stored {
            Ok(Some(image)) => Loaded::Newest(image),
            Ok(None) => Loaded::Nothing,
            Err(error) => {
                self.complain(&error.to_string());
                Loaded::Damaged
            }
        };
        self.image.load(found);
    }

    fn restart(&mut self) {
        self.read();
        let report = self.drive.restart(self.settings, &self.image);
        self.tell(report);
    }

    fn boot(&mut self) {
        self.read();
        match self.drive.boot(&mut self.node, &self.image) {
            Ok(report) => self.tell(report),
            Err(error) => self.complain(&format!("communication: {error:?}")),
        }
    }

    /// Says what of the stored image is not in force.
    fn tell(&self, report: LoadReport) {
        if !report.is_whole() {
            self.complain(&report.to_string());
        }
    }

    fn complain(&self, what: &str) {
        eprintln!("node {}: {what}", self.node.id().get());
    }
}

/// Remote frames and 29-bit identifiers mean nothing to a node.
fn from_bus(frame: &Frame) -> Option<canopen::Frame> {
    let Id::Standard(id) = frame.id() else { return None };
    if frame.is_remote_frame() { None } else { canopen::Frame::new(id.as_raw(), frame.data()) }
}

fn to_bus(frame: &canopen::Frame) -> Option<Frame> {
    Frame::new(StandardId::new(frame.id())?, frame.data())
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_servo_head::canopen::Group;
    use edm_servo_head::settings::Declared;
    use edm_servo_head::stored::Outcome;
    use std::fs;
    use std::path::Path;

    /// A head that has just been switched on, with what is stored in a folder.
    fn switched_on(folder: &Path) -> Head {
        let store = Store::new(Some(folder), 5).unwrap();
        Head::new(&Setup::load("default").unwrap(), NodeId::new(5).unwrap(), 1, store).unwrap()
    }

    /// Where a folder has what its head has stored: everything.
    fn stored_in(folder: &Path) -> std::path::PathBuf {
        let mut head = switched_on(folder);
        assert_eq!(head.drive.loaded(), LoadReport::default());
        head.change(|image, drive, node| image.keep(Group::All, drive, node)).unwrap();
        folder.join("node-5.stored")
    }

    #[test]
    fn a_file_has_the_bytes_that_a_chip_has_in_its_flash() {
        let folder = tempfile::tempdir().unwrap();
        let file = fs::read(stored_in(folder.path())).unwrap();
        let head = switched_on(folder.path());
        assert_eq!(head.drive.loaded().outcome, Outcome::Newest);
        let mut image = StoredImage::NOTHING;
        image.keep(Group::All, &head.drive, &head.node).unwrap();
        assert_eq!(image.bytes(), file);
    }

    #[test]
    fn whichever_bit_of_the_file_flips_the_defaults_are_in_force_and_no_guided_check_counts() {
        let folder = tempfile::tempdir().unwrap();
        let path = stored_in(folder.path());
        let good = fs::read(&path).unwrap();
        let mut head = switched_on(folder.path());
        for bit in 0..8 * good.len() {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            // As read from a file, without the time that files take.
            head.store = Store::Memory(Some(bad));
            head.read();
            assert_eq!(head.image.outcome(), Outcome::Damaged, "bit {bit}");
        }
        for bit in [0, 20, 8 * good.len() - 1] {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            fs::write(&path, &bad).unwrap();
            let head = switched_on(folder.path());
            assert_eq!(head.drive.loaded().outcome, Outcome::Damaged);
            assert!(!head.drive.settings().commissioned);
        }
        fs::write(&path, &good).unwrap();
        assert!(switched_on(folder.path()).drive.settings().commissioned);
    }

    #[test]
    fn a_file_of_0_1_0_is_in_force_with_every_setting() {
        let folder = tempfile::tempdir().unwrap();
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/0.1.0");
        fs::copy(fixtures.join("node-5-changed.stored"), folder.path().join("node-5.stored")).unwrap();
        let head = switched_on(folder.path());
        assert_eq!(head.drive.loaded().outcome, Outcome::Newest);
        let list = fs::read_to_string(fixtures.join("node-5-changed.csv")).unwrap();
        let mut compared = 0;
        for (place, (index, sub)) in Settings::ADDRESSES.iter().enumerate() {
            let Some(line) = list.lines().find(|line| line.starts_with(&format!("0x{index:04X},{sub},"))) else {
                continue;
            };
            let word = u32::from_str_radix(line.rsplit(',').next().unwrap(), 16).unwrap();
            assert_eq!(head.drive.settings().word(place), Some(word), "{line}");
            compared += 1;
        }
        assert_eq!(compared, 84);
    }
}

//! One virtual head: machine, control core, CANopen drive, and what it keeps when its power is cut.
//!
//! Frames and orders are dealt with in every servo tick, before the tick itself: a SYNC acts in the tick that it came
//! before. What the drive does once a millisecond, it does here as well.

use super::store::Store;
use crate::bore::Setup;
use crate::machine::Machine;
use edm_bus::Frame;
use edm_servo_head::canopen::drive::{BLANK, DEVICE, Drive, Identity, Kept, Order};
use edm_servo_head::canopen::{self, Abort, Node, NodeId, Time};
use edm_servo_head::head::Reason;
use edm_servo_head::settings::Settings;
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
        let mut head = Head { machine, drive, node, store, settings, ticks: 0, boots: None };
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
                let result = self.change(|kept, drive, node| kept.keep(group, drive, node));
                self.node.answer(result, &mut self.drive);
            }
            Order::Restore(group) => {
                let result = self.change(|kept, _, _| kept.forget(group));
                self.node.answer(result, &mut self.drive);
            }
            Order::ResetNode => {
                self.restart();
                self.boots = Some(self.ticks + START_UP);
            }
            Order::ResetCommunication => self.boots = Some(self.ticks + START_UP),
        }
        true
    }

    fn change(&mut self, change: impl FnOnce(&mut Kept, &Drive, &Node)) -> Result<(), Abort> {
        let leave = self.machine.head.give_leave().map_err(|_| Abort::DeviceState)?;
        let mut kept = self.kept();
        change(&mut kept, &self.drive, &self.node);
        let result = self.store.save(&kept).map_err(|error| {
            self.complain(&error.to_string());
            Abort::Hardware
        });
        self.machine.head.end_leave(leave);
        result
    }

    fn kept(&self) -> Kept {
        self.store.load().unwrap_or_else(|error| {
            self.complain(&error.to_string());
            Kept::NOTHING
        })
    }

    fn restart(&mut self) {
        let kept = self.kept();
        if let Err(error) = self.drive.restart(self.settings, kept.application()) {
            self.complain(&format!("the stored settings are refused: {error}"));
        }
    }

    fn boot(&mut self) {
        let kept = self.kept();
        if let Err(error) = self.node.boot(kept.communication(), &mut self.drive) {
            self.complain(&format!("the stored communication parameters are refused: {error:?}"));
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

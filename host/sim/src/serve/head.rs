//! One virtual head: machine, control core, CANopen node.

use super::store::Store;
use crate::bore::Setup;
use crate::machine::Machine;
use edm_bus::Frame;
use edm_servo_head::canopen::{
    self, Abort, Device, Dictionary, Entry, Event, Group, Node, NodeId, PDOS, PdoDefault, Place, Request, Time,
};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::TICK_HZ;
use embedded_can::{Frame as _, Id, StandardId};

const TICKS_PER_MS: u64 = TICK_HZ as u64 / 1000;
const TICK_US: u64 = 1_000_000 / TICK_HZ as u64;

const DEVICE: Device = Device {
    device_type: 402,
    name: "EDM servo head",
    hardware: "virtual",
    software: env!("CARGO_PKG_VERSION"),
    vendor: 0,
    product: 1,
    revision: 1,
    heartbeat: 1000,
    receive: [PdoDefault::UNUSED; PDOS],
    transmit: [PdoDefault::UNUSED; PDOS],
};

/// Interim: no objects.
#[derive(Default)]
struct Objects {
    events: Vec<Event>,
    requests: Vec<Request>,
}

impl Dictionary for Objects {
    fn entry(&self, _: u16, _: u8) -> Result<Entry, Abort> {
        Err(Abort::NoObject)
    }
    fn read(&self, _: Place, _: &mut [u8]) -> Result<usize, Abort> {
        Err(Abort::Unsupported)
    }
    fn write(&mut self, _: Place, _: &[u8]) -> Result<(), Abort> {
        Err(Abort::Unsupported)
    }
    fn request(&mut self, request: Request) -> Result<(), Abort> {
        self.requests.push(request);
        Ok(())
    }
    fn event(&mut self, event: Event) {
        self.events.push(event);
    }
}

/// A head on the bus.
pub struct Head {
    machine: Machine,
    node: Node,
    objects: Objects,
    store: Store,
    ticks: u64,
}

impl Head {
    /// A head that has just been switched on.
    ///
    /// # Errors
    /// When the values do not fit together.
    pub fn new(setup: &Setup, id: NodeId, seed: u64, store: Store) -> Result<Head, String> {
        // The virtual head's guided check counts as passed: it needs an axis without a workpiece.
        let settings = Settings { commissioned: true, ..setup.head };
        let mut machine = Machine::new(&setup.process, &settings, seed).map_err(|error| setup.refusal(error))?;
        machine.process.schedule(&setup.events);
        let mut head = Head {
            machine,
            node: Node::new(&DEVICE, id, id.get().into()),
            objects: Objects::default(),
            store,
            ticks: 0,
        };
        head.boot();
        Ok(head)
    }

    fn boot(&mut self) {
        let _ = self.node.boot(self.store.load().as_deref(), &mut self.objects);
    }

    /// One servo tick; frames that came since the last, and those to be sent.
    pub fn tick<'a>(&mut self, came: impl Iterator<Item = &'a Frame>, sent: &mut Vec<Frame>) {
        let now = Time(self.ticks * TICK_US);
        for frame in came.filter_map(from_bus) {
            self.node.receive(&frame, now, &mut self.objects);
        }
        self.node.synchronised(now, &mut self.objects);
        if self.ticks.is_multiple_of(TICKS_PER_MS) {
            self.node.poll(now, &mut self.objects);
        }
        for event in std::mem::take(&mut self.objects.events) {
            if matches!(event, Event::ResetNode | Event::ResetCommunication) {
                self.boot();
            }
        }
        for request in std::mem::take(&mut self.objects.requests) {
            let image = self.node.image();
            let done = match request {
                Request::Store(Group::All | Group::Communication) => self.store.save(&image),
                Request::Restore(Group::All | Group::Communication) => self.store.clear(),
                _ => Ok(()),
            };
            self.node.answer(done.map_err(|_| Abort::Hardware), &mut self.objects);
        }
        while let Some(frame) = self.node.take() {
            sent.extend(to_bus(&frame));
        }
        self.machine.tick();
        self.ticks += 1;
    }

    /// The machine behind the head.
    pub fn machine(&mut self) -> &mut Machine {
        &mut self.machine
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

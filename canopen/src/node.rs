//! The node: frames and time in, frames out.

use super::communication::CommunicationObjects;
use super::device::{ALL, CONSUMERS, Device, Direction, INVALID, PDOS};
use super::emergency::{Cause, Emergency};
use super::heartbeat::{Change, HEARTBEAT};
use super::lss::{self, BusSettings, Slave, Todo};
use super::parameters::{self, Parameters};
use super::pdo::Taken;
use super::sdo::{REQUEST, Server};
use super::space::Space;
use super::sync::{Pulse, Sync};
use super::{Abort, Dictionary, Event, Frame, Group, NmtState, NodeId, ObjectHandle, Record, Request, Restored, Time};

/// Identifier of network management.
const NMT: u16 = 0;
/// Identifiers that a node listens to at the most.
pub const IDENTIFIERS: usize = 4 + PDOS + CONSUMERS;

/// What a node could not boot with. It runs all the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BootError {
    /// The device's own defaults: they map what its dictionary does not have. Nothing is mapped.
    Defaults,
}

/// The controller of the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Controller {
    /// Frames were lost since it was asked last.
    pub overrun: bool,
    /// Events between tasks of the device were lost since it was asked last.
    pub events: bool,
    /// It is error passive: nobody acknowledges, or the wire is bad.
    pub passive: bool,
    /// It has left the bus, and comes back by itself.
    pub bus_off: bool,
}

/// Milliseconds without trouble of the controller after which its errors are gone. A wire to earth takes the controller off the bus
/// and lets it back every 1.4 ms (at 1 Mbit/s): that is one error, not hundreds.
const WELL_MS: u8 = 20;

/// A CANopen node.
///
/// Nothing in it waits. Whoever owns it calls [`receive`](Self::receive) with each frame, [`poll`](Self::poll) once a
/// millisecond, [`synchronised`](Self::synchronised) before a tick that takes set points, and sends what
/// [`take`](Self::take) yields. After a reset, and at the start, [`boot`](Self::boot) lets it continue.
#[derive(Clone, Debug)]
pub struct Node {
    objects: CommunicationObjects,
    server: Server,
    lss: Slave,
    /// Boot-up has not left yet: nothing may overtake it.
    booting: bool,
    /// A frame has come since the start.
    met: bool,
    /// Milliseconds without trouble of the controller.
    well: u8,
}

impl Node {
    /// A node that waits to be booted, and, without a node-ID, for one. `serial`: 1018h:4.
    pub fn new(device: &'static Device, settings: BusSettings, serial: u32) -> Self {
        Self {
            objects: CommunicationObjects::new(device, settings.node.unwrap_or(NodeId::FIRST), serial),
            server: Server::default(),
            lss: Slave::new(device, serial, settings),
            booting: false,
            met: false,
            well: 0,
        }
    }

    /// Boots a node that waits for it: with the stored parameters of the communication objects, if there are any, and else
    /// with the defaults. Boot-up leaves next, and the node is pre-operational. Stored identifiers contain the node-ID: the
    /// parameters are those of this node, or not to be given.
    ///
    /// An unconfigured node continues to wait.
    ///
    /// A value that cannot be gives way to its default. A PDO that has lost a value so, or maps what the dictionary does not
    /// have, is put out of use: bytes would go where the host does not mean them to.
    ///
    /// # Errors
    /// The node has booted, but not with what was asked.
    pub fn boot(
        &mut self,
        stored: Option<&mut dyn Iterator<Item = Record>>,
        dictionary: &mut dyn Dictionary,
    ) -> Result<Restored, BootError> {
        let waits = self.objects.state == NmtState::Initialising && !self.lss.is_deaf();
        let Some(id) = self.lss.active().node.filter(|_| waits) else {
            return Ok(Restored::default());
        };
        self.objects.id = id;
        let defaults = Parameters::new(self.objects.device, id.get());
        let mut parameters = defaults;
        let restored = stored.map(|values| self.restored(&mut parameters, values, dictionary)).unwrap_or_default();
        let adopted = self.objects.adopt(&parameters, dictionary).map_err(|_| BootError::Defaults);
        self.booting = true;
        self.server.restart(&mut Space { objects: &mut self.objects, dictionary });
        self.objects.out.clear();
        if let Some(boot_up) = Frame::new(id.cob(HEARTBEAT), &[NmtState::Initialising as u8]) {
            self.objects.out.put(boot_up);
        }
        self.enter(NmtState::PreOperational, dictionary);
        adopted.map(|()| restored)
    }

    /// Replaces defaults by stored values.
    fn restored(
        &self,
        parameters: &mut Parameters,
        values: &mut dyn Iterator<Item = Record>,
        dictionary: &dyn Dictionary,
    ) -> Restored {
        let mut spoiled = [false; 2 * PDOS];
        let mut restored = parameters.load(values, &mut spoiled);
        for ((direction, number), spoiled) in ALL.iter().copied().zip(spoiled) {
            let maps = self.objects.maps(parameters, direction, number, dictionary);
            if !maps {
                let first = if direction == Direction::Receive { 0x1600 } else { 0x1A00 };
                restored.defaulted.add(first + number, 0);
            }
            if let Some(pdo) = parameters.pdo_mut(direction, number).filter(|_| spoiled || !maps) {
                (pdo.id, pdo.count) = (pdo.id | INVALID, 0);
            }
        }
        restored
    }

    /// Takes a frame that came at `at`: the time stamp of its interrupt.
    pub fn receive(&mut self, frame: &Frame, at: Time, dictionary: &mut dyn Dictionary) {
        let (state, id, data) = (self.objects.state, frame.id(), frame.data());
        if self.lss.is_deaf() {
            return;
        }
        if id == lss::REQUEST {
            return self.layer_setting(data, at, dictionary);
        }
        if state == NmtState::Initialising {
            return;
        }
        self.met = true;
        if id == NMT {
            return self.command(data, dictionary);
        }
        if let (HEARTBEAT, [content]) = (id & !0x7F, data) {
            let node = (id & 0x7F) as u8;
            let change = self.objects.consumer.heard(&self.objects.parameters, node, content & 0x7F, at);
            return self.heartbeat(change, dictionary);
        }
        if state == NmtState::Stopped {
            return;
        }
        if Sync::is_mine(&self.objects.parameters, id) {
            self.sync(data, at, dictionary);
        } else if id == self.objects.id.cob(REQUEST) {
            self.server.receive(data, at, &mut Space { objects: &mut self.objects, dictionary });
        } else if state == NmtState::Operational {
            self.process_data(id, data, at, dictionary);
        }
    }

    /// Does what time demands: heartbeats, event timers, time-outs, emergencies, segments of a long transfer.
    pub fn poll(&mut self, now: Time, dictionary: &mut dyn Dictionary) {
        if self.lss.poll(now) {
            self.reset(Event::ResetCommunication, dictionary);
        }
        let booting = self.booting && self.objects.out.holds(self.objects.id.cob(HEARTBEAT));
        if core::mem::replace(&mut self.booting, booting) && !booting {
            // Boot-up is the first heartbeat; the next comes a period later.
            self.objects.producer.sent(self.objects.parameters.heartbeat, now);
        }
        if self.objects.state == NmtState::Initialising || booting {
            return;
        }
        while let Some(change) = self.objects.consumer.poll(&self.objects.parameters, now) {
            self.heartbeat(Some(change), dictionary);
        }
        let objects = &mut self.objects;
        let period = objects.parameters.heartbeat;
        if let Some(frame) = objects.producer.poll(period, objects.id, objects.state, now)
            && objects.out.refresh(frame)
        {
            objects.producer.sent(period, now);
        }
        if objects.state == NmtState::Stopped {
            return;
        }
        if objects.state == NmtState::Operational {
            self.poll_process_data(now, dictionary);
        }
        let objects = &mut self.objects;
        objects.emergency.poll(&objects.parameters, now, &mut objects.out);
        self.server.poll(now, &mut Space { objects, dictionary });
    }

    /// Applies the synchronous RPDOs that the last SYNC has made valid, if it came no later than `tick`; its time stamp.
    pub fn synchronised(&mut self, tick: Time, dictionary: &mut dyn Dictionary) -> Option<Time> {
        let time = self.objects.sync.due(tick)?;
        self.objects.receive.iter_mut().for_each(|pdo| pdo.apply(dictionary));
        Some(time)
    }

    /// What the next SYNC will write to the object at `place`, if it changes no other object; little end first. For who can
    /// act on a SYNC before this node has heard of it.
    pub fn ahead(&self, place: ObjectHandle, dictionary: &dyn Dictionary) -> Option<[u8; 4]> {
        let mut value = None;
        for pdo in &self.objects.receive {
            pdo.ahead(place, dictionary, &mut value)?;
        }
        value
    }

    /// Bytes of a SYNC: 1 with a counter.
    pub fn sync_length(&self) -> u8 {
        Sync::length(&self.objects.parameters)
    }

    /// The frame to be sent next. Call it when there is room for it.
    pub fn take(&mut self) -> Option<Frame> {
        self.objects.out.take()
    }

    /// Ends a [`Request`] about a group of objects. Too late is no harm: the host has given up, or has asked for something else.
    pub fn answer(&mut self, group: Group, result: Result<(), Abort>, dictionary: &mut dyn Dictionary) {
        if group != Group::Bus {
            self.server.answer(result, &mut Space { objects: &mut self.objects, dictionary });
        } else if let Some(answer) = self.lss.stored(result).filter(|_| !self.lss.is_deaf()) {
            self.objects.out.put(answer);
        }
    }

    /// The part of an update that [`Update`](super::Update) asks to be taken: its place in the update and its bytes, whole words.
    /// `None`: whoever sent it has given up.
    pub fn piece(&self) -> Option<(u32, &[u8])> {
        self.server.piece()
    }

    /// What 1F56h:1 reads: by which the program that runs is known.
    pub fn set_program(&mut self, id: u32) {
        self.objects.program = id;
    }

    /// What 1F57h:1 reads (CiA 302-3): bit 0 in progress, bits 1 to 7 an error.
    pub fn set_flash(&mut self, status: u32) {
        self.objects.flash = status;
    }

    /// Begins anew, as when a host resets the node.
    pub fn begin_anew(&mut self, dictionary: &mut dyn Dictionary) {
        self.reset(Event::ResetNode, dictionary);
    }

    /// The value written last, [`Written::Later`](super::Written::Later), is in force or was refused. Too late is no harm.
    pub fn written(&mut self, result: Result<(), Abort>, dictionary: &mut dyn Dictionary) {
        self.server.written(result, &mut Space { objects: &mut self.objects, dictionary });
    }

    /// Reports an error of the device: code (CiA 301 table 26, CiA 402 table 4), bits of the error register, five bytes of
    /// detail. It lasts until [`emergency_over`](Self::emergency_over).
    pub fn emergency(&mut self, code: u16, register: u8, detail: [u8; 5]) {
        self.objects.emergency.device(code, register, detail);
    }

    /// An error of the device is gone. `register`: bits of the error register for those that remain, 0 for none.
    pub fn emergency_over(&mut self, register: u8) {
        self.objects.emergency.device_well(register);
    }

    /// How the controller of the bus is, once a millisecond if there is one. Until a frame has been received the node may be
    /// alone, which is no error.
    pub fn controller(&mut self, controller: Controller) {
        if self.met {
            let emergency = &mut self.objects.emergency;
            emergency.set(Cause::Overrun, controller.overrun);
            emergency.set(Cause::Events, controller.events);
            let trouble = controller.passive || controller.bus_off;
            self.well = if trouble { 0 } else { self.well.saturating_add(1) };
            for (cause, present) in [(Cause::Passive, controller.passive), (Cause::BusOff, controller.bus_off)] {
                if present {
                    emergency.raise(cause);
                } else if self.well >= WELL_MS {
                    emergency.clear(cause);
                }
            }
        }
    }

    /// State of network management.
    pub fn state(&self) -> NmtState {
        self.objects.state
    }

    /// The identifiers that mean something to this node, for the filters of the controller: SYNC, network management, SDO
    /// requests, layer setting, RPDOs, heartbeats that are watched. What is not in use is network management once more.
    pub fn identifiers(&self) -> [u16; IDENTIFIERS] {
        let parameters = &self.objects.parameters;
        let receive = parameters.receive.iter().filter(|pdo| pdo.valid()).map(|pdo| pdo.id as u16 & 0x7FF);
        let watched = parameters.consumers.iter().filter_map(|value| parameters::entry(*value));
        let heartbeats = watched.map(|(node, _)| HEARTBEAT | u16::from(node & 0x7F));
        let mut identifiers = [NMT; IDENTIFIERS];
        let own = [parameters.sync_id as u16 & 0x7FF, NMT, lss::REQUEST, self.objects.id.cob(REQUEST)];
        for (slot, id) in identifiers.iter_mut().zip(own.into_iter().chain(receive).chain(heartbeats)) {
            *slot = id;
        }
        identifiers
    }

    /// How the node is reached: its node-ID, if it has one, and the bit rate that the controller is to have.
    pub fn bus(&self) -> BusSettings {
        self.lss.active()
    }

    /// The same as a host has configured it: in force with the next reset, and what [`Group::Bus`] stores.
    pub fn configured(&self) -> BusSettings {
        self.lss.pending()
    }

    /// Visits the parameters of the communication objects that are to be stored.
    pub fn parameters(&self, visit: &mut dyn FnMut(Record)) {
        self.objects.parameters.store(visit);
    }

    /// A layer setting service (CiA 305).
    fn layer_setting(&mut self, data: &[u8], at: Time, dictionary: &mut dyn Dictionary) {
        let (answer, todo) = self.lss.receive(data, at);
        if let Some(answer) = answer {
            self.objects.out.put(answer);
        }
        match todo {
            Todo::Nothing => {}
            Todo::Store => {
                if let Err(refused) = dictionary.request(Request::Store(Group::Bus)) {
                    self.answer(Group::Bus, Err(refused), dictionary);
                }
            }
            // What was wrong meanwhile is reported when it has booted.
            Todo::Begin => {
                self.lss.reset();
                dictionary.event(Event::ResetCommunication);
            }
            // Whoever commands the head is about to lose it.
            Todo::Activate => {
                if self.objects.state != NmtState::Initialising {
                    self.enter(NmtState::Stopped, dictionary);
                }
                self.quiet(dictionary);
            }
        }
    }

    /// Network management (CiA 301 7.2.8.3.1): a command for this node or for all.
    fn command(&mut self, data: &[u8], dictionary: &mut dyn Dictionary) {
        let &[command, node] = data else { return };
        if node != 0 && node != self.objects.id.get() {
            return;
        }
        match command {
            1 => self.enter(NmtState::Operational, dictionary),
            2 => self.enter(NmtState::Stopped, dictionary),
            128 => self.enter(NmtState::PreOperational, dictionary),
            129 => self.reset(Event::ResetNode, dictionary),
            130 => self.reset(Event::ResetCommunication, dictionary),
            _ => {}
        }
    }

    fn enter(&mut self, state: NmtState, dictionary: &mut dyn Dictionary) {
        if state == self.objects.state {
            return;
        }
        self.objects.state = state;
        self.objects.restart_process_data();
        if state == NmtState::Stopped {
            self.server.stop(&mut Space { objects: &mut self.objects, dictionary });
        }
        self.objects.producer.now();
        dictionary.event(Event::State(state));
    }

    fn reset(&mut self, event: Event, dictionary: &mut dyn Dictionary) {
        self.quiet(dictionary);
        self.lss.reset();
        // Nobody could reach a device that goes on without a node-ID.
        let event = if self.lss.active().node.is_none() { Event::ResetNode } else { event };
        if event == Event::ResetNode {
            self.objects.emergency = Emergency::default();
        }
        dictionary.event(event);
    }

    /// Says nothing more until it boots.
    fn quiet(&mut self, dictionary: &mut dyn Dictionary) {
        self.objects.restart();
        self.server.stop(&mut Space { objects: &mut self.objects, dictionary });
    }

    fn heartbeat(&mut self, change: Option<Change>, dictionary: &mut dyn Dictionary) {
        match change {
            Some(Change::Lost(entry, node)) => {
                self.objects.emergency.raise(Cause::Heartbeat(entry));
                dictionary.event(Event::HeartbeatLost { node });
                // Error behaviour, 1029h:1 (CiA 301 7.5.2.32).
                match self.objects.parameters.behaviour {
                    0 if self.objects.state == NmtState::Operational => {
                        self.enter(NmtState::PreOperational, dictionary)
                    }
                    2 => self.enter(NmtState::Stopped, dictionary),
                    _ => {}
                }
            }
            Some(Change::Back(entry)) => self.objects.emergency.clear(Cause::Heartbeat(entry)),
            None => {}
        }
    }

    fn sync(&mut self, data: &[u8], now: Time, dictionary: &mut dyn Dictionary) {
        let objects = &mut self.objects;
        let Pulse::Good(counter) = Sync::judge(&objects.parameters, data) else {
            objects.emergency.raise(Cause::SyncLength);
            return;
        };
        objects.emergency.clear(Cause::SyncLength);
        objects.emergency.clear(Cause::SyncLost);
        if objects.state != NmtState::Operational {
            return;
        }
        objects.sync.came(now);
        objects.receive.iter_mut().for_each(|pdo| pdo.synchronise());
        let register = objects.emergency.register();
        for (pdo, parameters) in objects.transmit.iter_mut().zip(&objects.parameters.transmit) {
            pdo.synchronise(parameters, counter, register, now, dictionary, &mut objects.out);
        }
    }

    fn process_data(&mut self, id: u16, data: &[u8], now: Time, dictionary: &mut dyn Dictionary) {
        let objects = &mut self.objects;
        let open = objects.sync.window_open(&objects.parameters, now);
        for ((number, pdo), parameters) in (0..).zip(&mut objects.receive).zip(&objects.parameters.receive) {
            let taken = pdo.take(parameters, id, data, now, open, dictionary);
            if taken != Taken::NotMine {
                objects.emergency.set(Cause::Short(number), taken == Taken::Short);
                objects.emergency.set(Cause::Long(number), taken == Taken::Long);
            }
            if matches!(taken, Taken::Long | Taken::Exact) {
                objects.emergency.clear(Cause::Late(number));
            }
        }
    }

    fn poll_process_data(&mut self, now: Time, dictionary: &mut dyn Dictionary) {
        let objects = &mut self.objects;
        if objects.sync.lost(&objects.parameters, now) {
            objects.emergency.raise(Cause::SyncLost);
            dictionary.event(Event::SyncLost);
        }
        for (pdo, receive) in (0..).zip(&mut objects.receive) {
            if receive.late(now) {
                objects.emergency.raise(Cause::Late(pdo));
                dictionary.event(Event::ReceiveTimeout { pdo });
            }
        }
        let register = objects.emergency.register();
        for (pdo, parameters) in objects.transmit.iter_mut().zip(&objects.parameters.transmit) {
            pdo.poll(parameters, register, now, dictionary, &mut objects.out);
        }
    }
}

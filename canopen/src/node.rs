//! The node: frames and time in, frames out.

use super::area::Area;
use super::device::{Device, PDOS};
use super::emergency::{Cause, Emergency};
use super::heartbeat::{self, Change, HEARTBEAT};
use super::parameters::{CONSUMERS, IMAGE, Parameters};
use super::pdo::Taken;
use super::rolled::{rolled, rolled_mut};
use super::sdo::{REQUEST, Server};
use super::space::Space;
use super::sync::{Pulse, Sync};
use super::{Abort, Dictionary, Event, Frame, NmtState, NodeId, Place, Time};

/// Identifier of network management.
const NMT: u16 = 0;
/// Identifiers that a node listens to at the most.
pub const IDENTIFIERS: usize = 3 + PDOS + CONSUMERS;

/// What a node could not boot with. It runs all the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BootError {
    /// The stored parameters: of another version or node-ID, or with a value that cannot be. The defaults are in force.
    Stored,
    /// The device's own defaults: they map what its dictionary does not have. Nothing is mapped.
    Defaults,
}

/// The controller of the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Controller {
    /// Frames were lost since it was asked last.
    pub overrun: bool,
    /// It is error passive: nobody acknowledges, or the wire is bad.
    pub passive: bool,
    /// It has left the bus, and comes back by itself.
    pub bus_off: bool,
}

/// A CANopen node.
///
/// Nothing in it waits. Whoever owns it calls [`receive`](Self::receive) with each frame, [`poll`](Self::poll) once a
/// millisecond, [`synchronised`](Self::synchronised) before a tick that takes set points, and sends what
/// [`take`](Self::take) yields. After a reset, and at the start, [`boot`](Self::boot) lets it go on.
#[derive(Clone, Debug)]
pub struct Node {
    area: Area,
    server: Server,
    /// Boot-up has not left yet: nothing may overtake it.
    booting: bool,
    /// A frame has come since the start.
    met: bool,
}

impl Node {
    /// A node that waits to be booted. `serial`: 1018h:4.
    pub fn new(device: &'static Device, id: NodeId, serial: u32) -> Self {
        Self { area: Area::new(device, id, serial), server: Server::default(), booting: false, met: false }
    }

    /// Boots a node that waits for it: with the stored parameters of the communication area, if there are any, and else
    /// with the defaults. Boot-up leaves next, and the node is pre-operational.
    ///
    /// # Errors
    /// The node has booted, but not with what was asked.
    #[inline(never)]
    pub fn boot(&mut self, stored: Option<&[u8]>, dictionary: &mut dyn Dictionary) -> Result<(), BootError> {
        if self.area.state != NmtState::Initialising {
            return Ok(());
        }
        let defaults = Parameters::new(self.area.device, self.area.id.get());
        let loaded = stored.map(|image| {
            let mut loaded = defaults;
            loaded.load(image, self.area.id).ok_or(BootError::Stored)?;
            self.area.adopt(&loaded, dictionary).map_err(|_| BootError::Stored)
        });
        let result = match loaded {
            Some(Ok(())) => Ok(()),
            None | Some(Err(_)) => {
                let adopted = self.area.adopt(&defaults, dictionary).map_err(|_| BootError::Defaults);
                adopted.and(loaded.unwrap_or(Ok(())))
            }
        };
        self.booting = true;
        self.area.out.clear();
        if let Some(boot_up) = Frame::new(self.area.id.cob(HEARTBEAT), &[NmtState::Initialising as u8]) {
            self.area.out.put(boot_up);
        }
        self.enter(NmtState::PreOperational, dictionary);
        result
    }

    /// Takes a frame that came at `at`: the time stamp of its interrupt.
    #[inline(never)]
    pub fn receive(&mut self, frame: &Frame, at: Time, dictionary: &mut dyn Dictionary) {
        let (state, id, data) = (self.area.state, frame.id(), frame.data());
        if state == NmtState::Initialising {
            return;
        }
        self.met = true;
        if id == NMT {
            return self.command(data, dictionary);
        }
        if let (HEARTBEAT, [content]) = (id & !0x7F, data) {
            let node = (id & 0x7F) as u8;
            let change = self.area.consumer.heard(&self.area.parameters, node, content & 0x7F, at);
            return self.heartbeat(change, dictionary);
        }
        if state == NmtState::Stopped {
            return;
        }
        if Sync::is_mine(&self.area.parameters, id) {
            self.sync(data, at, dictionary);
        } else if id == self.area.id.cob(REQUEST) {
            self.server.receive(data, at, &mut Space { area: &mut self.area, dictionary });
        } else if state == NmtState::Operational {
            self.process_data(id, data, at, dictionary);
        }
    }

    /// Does what time demands: heartbeats, event timers, time-outs, emergencies, segments of a long transfer.
    #[inline(never)]
    pub fn poll(&mut self, now: Time, dictionary: &mut dyn Dictionary) {
        let booting = self.booting && self.area.out.holds(self.area.id.cob(HEARTBEAT));
        if core::mem::replace(&mut self.booting, booting) && !booting {
            // Boot-up is the first heartbeat; the next comes a period later.
            self.area.producer.sent(self.area.parameters.heartbeat, now);
        }
        if self.area.state == NmtState::Initialising || booting {
            return;
        }
        while let Some(change) = self.area.consumer.poll(&self.area.parameters, now) {
            self.heartbeat(Some(change), dictionary);
        }
        let area = &mut self.area;
        let period = area.parameters.heartbeat;
        if let Some(frame) = area.producer.poll(period, area.id, area.state, now)
            && area.out.refresh(frame)
        {
            area.producer.sent(period, now);
        }
        if area.state == NmtState::Stopped {
            return;
        }
        if area.state == NmtState::Operational {
            self.poll_process_data(now, dictionary);
        }
        let area = &mut self.area;
        area.emergency.poll(&area.parameters, now, &mut area.out);
        self.server.poll(now, &mut Space { area, dictionary });
    }

    /// Applies the synchronous RPDOs that the last SYNC has made valid, if it came no later than `tick`; its time stamp.
    #[inline(never)]
    pub fn synchronised(&mut self, tick: Time, dictionary: &mut dyn Dictionary) -> Option<Time> {
        let time = self.area.sync.due(tick)?;
        rolled_mut(&mut self.area.receive).iter_mut().for_each(|pdo| pdo.apply(dictionary));
        Some(time)
    }

    /// What the next SYNC will write to the object at `place`, if it changes no other object; little end first. For who can
    /// act on a SYNC before this node has heard of it.
    #[inline(never)]
    pub fn ahead(&self, place: Place, dictionary: &dyn Dictionary) -> Option<[u8; 4]> {
        let mut value = None;
        for pdo in rolled(&self.area.receive) {
            pdo.ahead(place, dictionary, &mut value)?;
        }
        value
    }

    /// Bytes of a SYNC: 1 with a counter.
    pub fn sync_length(&self) -> u8 {
        Sync::length(&self.area.parameters)
    }

    /// The frame to be sent next. Call it when there is room for it.
    pub fn take(&mut self) -> Option<Frame> {
        self.area.out.take()
    }

    /// Ends a [`Request`](super::Request). Too late is no harm: the host has given up, or has asked for something else.
    pub fn answer(&mut self, result: Result<(), Abort>, dictionary: &mut dyn Dictionary) {
        self.server.answer(result, &mut Space { area: &mut self.area, dictionary });
    }

    /// Reports an error of the device: code (CiA 301 table 26, CiA 402 table 4), bits of the error register, five bytes of
    /// detail. It lasts until [`emergency_over`](Self::emergency_over).
    pub fn emergency(&mut self, code: u16, register: u8, detail: [u8; 5]) {
        self.area.emergency.device(code, register, detail);
    }

    /// The device has no error any more.
    pub fn emergency_over(&mut self) {
        self.area.emergency.device_well();
    }

    /// How the controller of the bus is, once a millisecond if there is one. Until somebody has been heard the node may be
    /// alone, which is no error.
    #[inline(never)]
    pub fn controller(&mut self, controller: Controller) {
        if self.met {
            let emergency = &mut self.area.emergency;
            emergency.set(Cause::Overrun, controller.overrun);
            emergency.set(Cause::Passive, controller.passive);
            emergency.set(Cause::BusOff, controller.bus_off);
        }
    }

    /// State of network management.
    pub fn state(&self) -> NmtState {
        self.area.state
    }

    /// The identifiers that mean something to this node, for the filters of the controller: SYNC, network management, SDO
    /// requests, RPDOs, heartbeats that are watched. What is not in use is network management once more.
    #[inline(never)]
    pub fn identifiers(&self) -> [u16; IDENTIFIERS] {
        let parameters = &self.area.parameters;
        let receive = rolled(&parameters.receive).iter().filter(|pdo| pdo.valid()).map(|pdo| pdo.id as u16 & 0x7FF);
        let watched = rolled(&parameters.consumers).iter().filter_map(|value| heartbeat::entry(*value));
        let heartbeats = watched.map(|(node, _)| HEARTBEAT | u16::from(node & 0x7F));
        let mut identifiers = [NMT; IDENTIFIERS];
        let own = [parameters.sync_id as u16 & 0x7FF, NMT, self.area.id.cob(REQUEST)];
        for (slot, id) in identifiers.iter_mut().zip(own.into_iter().chain(receive).chain(heartbeats)) {
            *slot = id;
        }
        identifiers
    }

    /// Node-ID.
    pub fn id(&self) -> NodeId {
        self.area.id
    }

    /// Period of SYNC that the host has announced in 1006h, us; 0: none.
    pub fn sync_period_us(&self) -> u32 {
        self.area.parameters.period
    }

    /// The parameters of the communication area as they are to be stored.
    #[inline(never)]
    pub fn image(&self) -> [u8; IMAGE] {
        self.area.parameters.image(self.area.id)
    }

    /// Network management (CiA 301 7.2.8.3.1): a command for this node or for all.
    #[inline(never)]
    fn command(&mut self, data: &[u8], dictionary: &mut dyn Dictionary) {
        let &[command, node] = data else { return };
        if node != 0 && node != self.area.id.get() {
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

    #[inline(never)]
    fn enter(&mut self, state: NmtState, dictionary: &mut dyn Dictionary) {
        if state == self.area.state {
            return;
        }
        self.area.state = state;
        self.area.restart_process_data();
        if state == NmtState::Stopped {
            self.server.stop(&mut Space { area: &mut self.area, dictionary });
        }
        self.area.producer.now();
        dictionary.event(Event::State(state));
    }

    #[inline(never)]
    fn reset(&mut self, event: Event, dictionary: &mut dyn Dictionary) {
        self.area.restart();
        if event == Event::ResetNode {
            self.area.emergency = Emergency::default();
        }
        self.server.stop(&mut Space { area: &mut self.area, dictionary });
        dictionary.event(event);
    }

    #[inline(never)]
    fn heartbeat(&mut self, change: Option<Change>, dictionary: &mut dyn Dictionary) {
        match change {
            Some(Change::Lost(entry, node)) => {
                self.area.emergency.raise(Cause::Heartbeat(entry));
                dictionary.event(Event::HeartbeatLost { node });
                // Error behaviour, 1029h:1 (CiA 301 7.5.2.32).
                match self.area.parameters.behaviour {
                    0 if self.area.state == NmtState::Operational => self.enter(NmtState::PreOperational, dictionary),
                    2 => self.enter(NmtState::Stopped, dictionary),
                    _ => {}
                }
            }
            Some(Change::Back(entry)) => self.area.emergency.clear(Cause::Heartbeat(entry)),
            None => {}
        }
    }

    #[inline(never)]
    fn sync(&mut self, data: &[u8], now: Time, dictionary: &mut dyn Dictionary) {
        let area = &mut self.area;
        let Pulse::Good(counter) = Sync::judge(&area.parameters, data) else {
            area.emergency.raise(Cause::SyncLength);
            return;
        };
        area.emergency.clear(Cause::SyncLength);
        area.emergency.clear(Cause::SyncLost);
        if area.state != NmtState::Operational {
            return;
        }
        area.sync.came(now);
        rolled_mut(&mut area.receive).iter_mut().for_each(|pdo| pdo.synchronise());
        let register = area.emergency.register();
        for (pdo, parameters) in rolled_mut(&mut area.transmit).iter_mut().zip(&area.parameters.transmit) {
            pdo.synchronise(parameters, counter, register, now, dictionary, &mut area.out);
        }
    }

    #[inline(never)]
    fn process_data(&mut self, id: u16, data: &[u8], now: Time, dictionary: &mut dyn Dictionary) {
        let area = &mut self.area;
        let open = area.sync.window_open(&area.parameters, now);
        for ((number, pdo), parameters) in (0..).zip(rolled_mut(&mut area.receive)).zip(&area.parameters.receive) {
            let taken = pdo.take(parameters, id, data, now, open, dictionary);
            if taken != Taken::NotMine {
                area.emergency.set(Cause::Short(number), taken == Taken::Short);
                area.emergency.set(Cause::Long(number), taken == Taken::Long);
            }
            if matches!(taken, Taken::Long | Taken::Exact) {
                area.emergency.clear(Cause::Late(number));
            }
        }
    }

    #[inline(never)]
    fn poll_process_data(&mut self, now: Time, dictionary: &mut dyn Dictionary) {
        let area = &mut self.area;
        if area.sync.lost(&area.parameters, now) {
            area.emergency.raise(Cause::SyncLost);
            dictionary.event(Event::SyncLost);
        }
        for (pdo, receive) in (0..).zip(rolled_mut(&mut area.receive)) {
            if receive.late(now) {
                area.emergency.raise(Cause::Late(pdo));
                dictionary.event(Event::ReceiveTimeout { pdo });
            }
        }
        let register = area.emergency.register();
        for (pdo, parameters) in rolled_mut(&mut area.transmit).iter_mut().zip(&area.parameters.transmit) {
            pdo.poll(parameters, register, now, dictionary, &mut area.out);
        }
    }
}

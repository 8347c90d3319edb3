//! Layer setting services (CiA 305 version 3.0.0): a host gives a node its node-ID and bit rate over the bus itself.
//!
//! A node without a node-ID is *unconfigured*: it has not booted, and answers only these services. A node-ID that was
//! configured comes into force with the next reset of communication; an unconfigured node resets itself when it is switched
//! back to waiting. A bit rate comes into force when it is activated.

use super::device::Device;
use super::{Abort, Frame, NodeId, Time};

/// Identifier of what the host asks.
pub(super) const REQUEST: u16 = 0x7E5;
/// Identifier of the answers.
const ANSWER: u16 = 0x7E4;
/// The node-ID of an unconfigured node.
const UNCONFIGURED: u8 = 255;
/// Table of bit timings that is meant: that of CiA 301.
const CIA_TABLE: u8 = 0;
/// Error codes of *configure*: out of range; of *store*: the medium, and one of our own, in the byte behind it.
const OUT_OF_RANGE: u8 = 1;
const MEDIUM: u8 = 2;
const SPECIFIC: u8 = 255;
/// Our own reason not to store: the device is enabled.
const ENABLED: u8 = 1;
/// `BitCheck` of a fast scan that begins.
const BEGIN: u8 = 128;

/// Bit rates, by their index in the table of CiA 301 (CiA 305 table 2). The others do not divide the controller's clock or are
/// too slow for a servo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum BitRate {
    /// 1 Mbit/s.
    Kbit1000 = 0,
    /// 500 kbit/s.
    Kbit500 = 2,
    /// 250 kbit/s.
    Kbit250 = 3,
    /// 125 kbit/s.
    Kbit125 = 4,
}

impl BitRate {
    /// Every one, fastest first.
    pub const ALL: [BitRate; 4] = [Self::Kbit1000, Self::Kbit500, Self::Kbit250, Self::Kbit125];

    /// By index in the table of CiA 301.
    pub fn from_index(index: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|rate| *rate as u8 == index)
    }

    /// bit/s.
    pub const fn hz(self) -> u32 {
        match self {
            Self::Kbit1000 => 1_000_000,
            Self::Kbit500 => 500_000,
            Self::Kbit250 => 250_000,
            Self::Kbit125 => 125_000,
        }
    }

    /// By bit/s; `None` for a rate that is not among these.
    pub const fn from_hz(hz: u32) -> Option<Self> {
        match hz {
            1_000_000 => Some(Self::Kbit1000),
            500_000 => Some(Self::Kbit500),
            250_000 => Some(Self::Kbit250),
            125_000 => Some(Self::Kbit125),
            _ => None,
        }
    }
}

/// How a node is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BusSettings {
    /// Its number; `None` while nobody has given it one.
    pub node: Option<NodeId>,
    /// Bit rate of the bus.
    pub bit_rate: BitRate,
}

impl BusSettings {
    /// On a bus of 1 Mbit/s.
    pub const fn at_1_mbit(node: Option<NodeId>) -> Self {
        Self { node, bit_rate: BitRate::Kbit1000 }
    }
}

/// What is to be done in addition to the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Todo {
    Nothing,
    /// Store what is configured; [`Slave::stored`] says how it ended.
    Store,
    /// An unconfigured node has its node-ID and may begin.
    Begin,
    /// Be silent, and change the bit rate.
    Activate,
}

/// A change of bit rate under way: silence for a delay, then the new rate, then silence for the same again.
#[derive(Clone, Copy, Debug)]
struct Change {
    begun: Time,
    delay_us: u64,
}

/// The slave.
#[derive(Clone, Debug)]
pub(super) struct Slave {
    /// Vendor, product, revision, serial number: 1018h.
    identity: [u32; 4],
    configuring: bool,
    /// Parts of a selective switch, and of an identification, that were ours one after the other.
    selected: u8,
    identified: u8,
    /// Part that a fast scan asks for.
    scanned: u8,
    active: BusSettings,
    pending: BusSettings,
    change: Option<Change>,
    storing: bool,
}

fn le([_, a, b, c, d, ..]: [u8; 8]) -> u32 {
    u32::from_le_bytes([a, b, c, d])
}

fn answer(command: u8, [a, b, c, d]: [u8; 4]) -> Frame {
    Frame::full(ANSWER, [command, a, b, c, d, 0, 0, 0])
}

/// Goes on to the next of `parts` parts when this one, `at` from 0, follows on the last and is ours.
fn follows(reached: &mut u8, at: u8, ours: bool) -> u8 {
    *reached = if ours && *reached >= at { at.wrapping_add(1) } else { 0 };
    *reached
}

impl Slave {
    pub fn new(device: &Device, serial: u32, settings: BusSettings) -> Self {
        Self {
            identity: [device.vendor, device.product, device.revision, serial],
            configuring: false,
            selected: 0,
            identified: 0,
            scanned: 0,
            active: settings,
            pending: settings,
            change: None,
            storing: false,
        }
    }

    /// In force.
    pub fn active(&self) -> BusSettings {
        self.active
    }

    /// In force after the next reset, and what is stored.
    pub fn pending(&self) -> BusSettings {
        self.pending
    }

    /// The bit rate changes: the node has neither ears nor voice.
    pub fn is_deaf(&self) -> bool {
        self.change.is_some()
    }

    /// Reset of communication: the node-ID that was configured is in force, and the slave waits.
    pub fn reset(&mut self) {
        self.active.node = self.pending.node;
        (self.configuring, self.selected, self.identified, self.storing) = (false, 0, 0, false);
    }

    /// Takes a request, 8 bytes long. An answer may come with what is to be done.
    pub fn receive(&mut self, data: &[u8], at: Time) -> (Option<Frame>, Todo) {
        let Ok(request) = <[u8; 8]>::try_from(data) else { return (None, Todo::Nothing) };
        let [command, first, second, ..] = request;
        let value = le(request);
        let part = |at: u8| self.identity.get(usize::from(at)).copied().unwrap_or(0);
        let mut todo = Todo::Nothing;
        let reply = match command {
            // Switch state global.
            0x04 => {
                todo = self.switch(first);
                None
            }
            // Switch state selective: vendor, product, revision, serial number.
            0x40..=0x43 => {
                let at = command & 3;
                let ours = value == part(at);
                let all = follows(&mut self.selected, at, ours) == 4;
                self.configuring |= all;
                all.then(|| answer(0x44, [0; 4]))
            }
            // Identify: vendor, product, revision from and to, serial number from and to.
            0x46..=0x4B => {
                let (at, ours) = match command {
                    0x46 => (0, value == part(0)),
                    0x47 => (1, value == part(1)),
                    0x48 => (2, value <= part(2)),
                    0x49 => (3, value >= part(2)),
                    0x4A => (4, value <= part(3)),
                    _ => (5, value >= part(3)),
                };
                (follows(&mut self.identified, at, ours) == 6).then(|| answer(0x4F, [0; 4]))
            }
            // Identify unconfigured.
            0x4C => self.active.node.is_none().then(|| answer(0x50, [0; 4])),
            0x51 => self.scan(request),
            _ if !self.configuring => None,
            0x11 => Some(answer(command, [self.configure_node(first), 0, 0, 0])),
            0x13 => Some(answer(command, [self.configure_rate(first, second), 0, 0, 0])),
            0x15 => {
                let delay_us = 1000 * u64::from(u16::from_le_bytes([first, second]));
                self.change = Some(Change { begun: at, delay_us });
                todo = Todo::Activate;
                None
            }
            0x17 => {
                // One that is under way answers for both.
                todo = if self.storing { Todo::Nothing } else { Todo::Store };
                self.storing = true;
                None
            }
            // Inquire vendor, product, revision, serial number.
            0x5A..=0x5D => Some(answer(command, part(command - 0x5A).to_le_bytes())),
            0x5E => Some(answer(command, [self.active.node.map_or(UNCONFIGURED, NodeId::get), 0, 0, 0])),
            _ => None,
        };
        (reply, todo)
    }

    fn switch(&mut self, mode: u8) -> Todo {
        match mode {
            0 => {
                (self.configuring, self.selected) = (false, 0);
                let begins = self.active.node.is_none() && self.pending.node.is_some();
                if begins { Todo::Begin } else { Todo::Nothing }
            }
            1 => {
                self.configuring = true;
                Todo::Nothing
            }
            _ => Todo::Nothing,
        }
    }

    fn configure_node(&mut self, id: u8) -> u8 {
        let node = NodeId::new(id);
        if node.is_none() && id != UNCONFIGURED {
            return OUT_OF_RANGE;
        }
        self.pending.node = node;
        0
    }

    fn configure_rate(&mut self, table: u8, index: u8) -> u8 {
        let Some(bit_rate) = BitRate::from_index(index).filter(|_| table == CIA_TABLE) else { return OUT_OF_RANGE };
        self.pending.bit_rate = bit_rate;
        0
    }

    /// A step of a fast scan (CiA 305 6.7): an unconfigured node answers while the bits asked for are its own. The node that
    /// answers for the last bits is the one that is configured.
    fn scan(&mut self, request: [u8; 8]) -> Option<Frame> {
        let [_, _, _, _, _, bit, part, next] = request;
        if self.active.node.is_some() || self.configuring {
            return None;
        }
        if bit == BEGIN {
            self.scanned = 0;
            return Some(answer(0x4F, [0; 4]));
        }
        let ours = *self.identity.get(usize::from(part)).filter(|_| part == self.scanned)?;
        let mask = u32::MAX.checked_shl(bit.into())?;
        if (ours ^ le(request)) & mask != 0 {
            return None;
        }
        self.scanned = next;
        self.configuring |= bit == 0 && next < part;
        Some(answer(0x4F, [0; 4]))
    }

    /// How storing has ended.
    pub fn stored(&mut self, result: Result<(), Abort>) -> Option<Frame> {
        let codes = match result {
            Ok(()) => [0, 0, 0, 0],
            Err(Abort::DeviceState) => [SPECIFIC, ENABLED, 0, 0],
            Err(_) => [MEDIUM, 0, 0, 0],
        };
        core::mem::take(&mut self.storing).then(|| answer(0x17, codes))
    }

    /// Continues a change of the bit rate; returns whether it has ended.
    pub fn poll(&mut self, now: Time) -> bool {
        let Some(Change { begun, delay_us }) = self.change else { return false };
        if now >= begun.after(delay_us) {
            self.active.bit_rate = self.pending.bit_rate;
        }
        let over = now >= begun.after(2 * delay_us);
        self.change.take_if(|_| over).is_some()
    }
}

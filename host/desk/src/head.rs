//! One head: identity, values by address, state machine (CiA 402), monitoring in both directions.

use crate::bus::{BEAT, Bus, SILENCE};
use crate::sdo::{Address, Sdo, SdoError};
use crate::sheet::{DeviceId, Object, Sheet, Value};
use crate::{Failure, words};
use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long a node may take to say that it is there.
const THERE: Duration = Duration::from_millis(250);
/// How long a state of the drive may take.
const STATE: Duration = Duration::from_secs(3);
/// The longest homing.
const HOMING: Duration = Duration::from_secs(60);
/// Homing at the present position.
const HERE: i64 = 35;
/// The longest search for the surface.
const SEARCH: Duration = Duration::from_secs(60);
/// Polling period of a wait.
const LOOK: Duration = Duration::from_millis(10);

/// Objects that are used by their meaning. Their addresses never move (docs/canopen.md).
pub mod at {
    use super::Address;
    /// What kind of device it is.
    pub const DEVICE_TYPE: Address = Address(0x1000, 0);
    /// Stores settings and profile.
    pub const STORE_APPLICATION: Address = Address(0x1010, 3);
    /// Period of the head's heartbeat, ms.
    pub const PRODUCER: Address = Address(0x1017, 0);
    /// Serial number.
    pub const SERIAL: Address = Address(0x1018, 4);
    /// State of the head.
    pub const STATE: Address = Address(0x2000, 1);
    /// Active fault.
    pub const FAULT: Address = Address(0x2000, 2);
    /// Why the state changed last.
    pub const REASON: Address = Address(0x2000, 3);
    /// Why a command was refused last.
    pub const REFUSAL: Address = Address(0x2000, 4);
    /// Absolute positions are valid.
    pub const HOMED: Address = Address(0x2000, 5);
    /// Commands refused, modulo 256.
    pub const REFUSALS: Address = Address(0x2000, 7);
    /// Set points are reached through the gap.
    pub const ERODE: Address = Address(0x2001, 1);
    /// Pulses off, hold.
    pub const HOLD: Address = Address(0x2001, 2);
    /// Starts the guided check.
    pub const CHECK: Address = Address(0x2001, 3);
    /// How that ended.
    pub const CHECK_RESULT: Address = Address(0x2001, 4);
    /// Value that the guided check measured where it contradicts a setting, and the range allowed, in thousandths.
    pub const MEASURED: [Address; 3] = [Address(0x2002, 3), Address(0x2002, 4), Address(0x2002, 5)];
    /// Where the electrode touched the work, counts.
    pub const TOUCHED: Address = Address(0x2001, 6);
    /// Setting that another one conflicts with.
    pub const REFUSED_SETTING: Address = Address(0x2002, 1);
    /// Rule that it has to satisfy, in words.
    pub const REFUSED_RULE: Address = Address(0x2002, 2);
    /// What ended the last erosion.
    pub const STOPPED_BY: Address = Address(0x2003, 3);
    /// Segments that still fit in the path.
    pub const SPACE: Address = Address(0x2004, 4);
    /// Number of the segment under way, counted as those that were appended.
    pub const SEGMENT: Address = Address(0x2004, 5);
    /// Path coordinate, um.
    pub const PATH: Address = Address(0x2004, 6);
    /// Velocity that the gap requests.
    pub const FEED: Address = Address(0x2004, 7);
    /// Gap voltage.
    pub const GAP: Address = Address(0x2005, 1);
    /// Gap voltage to keep.
    pub const SETPOINT: Address = Address(0x2005, 5);
    /// Open-circuit voltage.
    pub const OPEN: Address = Address(0x2005, 6);
    /// Retreats from a short.
    pub const SHORTS: Address = Address(0x2006, 1);
    /// Whether the levels of pulses fit.
    pub const LEVELS: Address = Address(0x2013, 16);
    /// Deepest position of the last erosion.
    pub const DEEPEST: Address = Address(0x2006, 4);
    /// Quality of the gap voltage.
    pub const GAP_QUALITY: Address = Address(0x2005, 3);
    /// Motor current.
    pub const MOTOR_CURRENT: Address = Address(0x2007, 2);
    /// Illegal transitions of the encoder.
    pub const ILLEGAL: Address = Address(0x2008, 1);
    /// A part of a path segment: end 1 to 3 (down, X, Y), centre 4 and 5, nm; shape 6, options 7.
    pub const fn piece(part: u8) -> Address {
        Address(0x200E, part)
    }
    /// Appends it; 0 takes note of a refusal.
    pub const COMMIT: Address = Address(0x200E, 8);
    /// Why one was refused.
    pub const PIECE_REFUSED: Address = Address(0x200E, 9);
    /// Segments appended since power-on.
    pub const APPENDED: Address = Address(0x200E, 10);
    /// Set points of X and Y, nm.
    pub const BESIDE: [Address; 2] = [Address(0x200E, 12), Address(0x200E, 13)];
    /// The head's program, in words.
    pub const BUILD: Address = Address(0x2009, 2);
    /// Self-test at the start.
    pub const SELF_TEST: Address = Address(0x2009, 3);
    /// End of the previous run.
    pub const LAST_END: Address = Address(0x2009, 4);
    /// Outcome of loading the stored image.
    pub const STORED: Address = Address(0x200B, 1);
    /// Frames received faster than processed.
    pub const FRAMES_LOST: Address = Address(0x200D, 1);
    /// Starts the search for the surface of the work.
    pub const FIND: Address = Address(0x2011, 1);
    /// How that ended.
    pub const FOUND: Address = Address(0x2011, 3);
    /// The guided check has passed.
    pub const COMMISSIONED: Address = Address(0x210C, 1);
    /// Controlword.
    pub const CONTROLWORD: Address = Address(0x6040, 0);
    /// Statusword.
    pub const STATUSWORD: Address = Address(0x6041, 0);
    /// Mode of operation.
    pub const MODE: Address = Address(0x6060, 0);
    /// Position from home, counts, whatever the datum.
    pub const INTERNAL_POSITION: Address = Address(0x6063, 0);
    /// Position, counts.
    pub const POSITION: Address = Address(0x6064, 0);
    /// Target position, counts.
    pub const TARGET: Address = Address(0x607A, 0);
    /// Velocity of moves, counts/s.
    pub const PROFILE_VELOCITY: Address = Address(0x6081, 0);
    /// Position of the place that homing finds, with the sign changed, counts.
    pub const HOME_OFFSET: Address = Address(0x607C, 0);
    /// Farthest position that a set point may have, counts from home.
    pub const LIMIT_MAX: Address = Address(0x607D, 2);
    /// Surface that the hole under the electrode is measured from, counts; [`super::NO_SURFACE`].
    pub const KEPT_SURFACE: Address = Address(0x2011, 11);
    /// Time of the newest erosion since power-on, ms.
    pub const ERODING_TIME: Address = Address(0x2006, 3);
    /// Position of a host's 0 from home, counts.
    pub const DATUM: Address = Address(0x2011, 7);
    /// Voltage of the motor's supply.
    pub const BUS_VOLTAGE: Address = Address(0x6079, 0);
    /// Whether a hole is kept, and waits.
    pub const KEPT_STATE: Address = Address(0x201A, 1);
    /// Goes on with a hole that waits.
    pub const GO_ON: Address = Address(0x201A, 2);
    /// Why it was not gone on with.
    pub const GO_ON_REFUSED: Address = Address(0x201A, 3);
    /// Depth of that hole, and the one it was to have, counts.
    pub const KEPT_DEPTH: Address = Address(0x201A, 4);
    /// See [`KEPT_DEPTH`].
    pub const KEPT_TARGET: Address = Address(0x201A, 5);
    /// Row of a technology table that it was in, from 1; 0 none.
    pub const KEPT_ROW: Address = Address(0x201A, 7);
    /// A part of a technology table.
    pub const fn technology(sub: u8) -> Address {
        Address(0x201C, sub)
    }
    /// Takes it into use.
    pub const TABLE_USE: Address = technology(2);
    /// Why it was not, and the row that is wrong.
    pub const TABLE_REFUSED: [Address; 2] = [technology(3), technology(4)];
    /// Row under way, or to begin with.
    pub const TABLE_ROW: Address = technology(5);
    /// How far it is.
    pub const TABLE_STATE: Address = technology(6);
    /// The generator is set for this row.
    pub const GENERATOR_SET: Address = technology(19);
    /// Encoder counts ...
    pub const INCREMENTS: Address = Address(0x608F, 1);
    /// ... in so many millimetres.
    pub const MILLIMETRES: Address = Address(0x608F, 2);
    /// Homing method.
    pub const HOMING_METHOD: Address = Address(0x6098, 0);
    /// Contacts, by bits.
    pub const INPUTS: Address = Address(0x60FD, 0);
}

/// What [`Head::place_to_measure`] does while the head moves, in words.
pub const MOVES: &str = "moves to its place, pulses off";
/// Why an activity ends whose head somebody else has stopped.
pub const DISABLED: &str = "another program has disabled the head";
/// The head keeps no surface of a hole.
pub const NO_SURFACE: i64 = i32::MIN as i64;

/// A hole waits to be gone on with, 201Ah:1.
pub const WAITS: i64 = 1;

/// States of 2000h:1.
pub mod state {
    /// The loop is open, pulses are off.
    pub const DISABLED: u8 = 0;
    /// The guided check runs.
    pub const COMMISSIONING: u8 = 1;
    /// Enabled, at rest, pulses off.
    pub const READY: u8 = 2;
    /// Moves to the work, with pulses.
    pub const SEEKING: u8 = 3;
    /// The gap leads.
    pub const ERODING: u8 = 4;
    /// Back from a short.
    pub const RETREATING: u8 = 5;
    /// The path has ended.
    pub const DONE: u8 = 6;
    /// Stopped, pulses off.
    pub const HOLDING: u8 = 7;
    /// A fault is active.
    pub const FAULT: u8 = 8;
    /// A host leads, with the feed that the gap allows.
    pub const GUIDING: u8 = 11;
    /// The encoder is tested.
    pub const PROVING: u8 = 12;
    /// Out of the work and back, to flush.
    pub const JUMPING: u8 = 13;
    /// States in which the feed that the gap requests is valid.
    pub const LED: [u8; 5] = [SEEKING, ERODING, RETREATING, GUIDING, JUMPING];
}

/// State of a search for the surface, 2011h:3.
mod search {
    pub const UNDER_WAY: i64 = 1;
    pub const FOUND: i64 = 2;
}

/// Bits of the statusword.
pub mod status {
    /// The target has been reached.
    pub const REACHED: u16 = 1 << 10;
    /// A set point has been taken; homing attained.
    pub const TAKEN: u16 = 1 << 12;
    /// Homing error.
    pub const ERROR: u16 = 1 << 13;
    /// State bits.
    pub const MASK: u16 = 0x6F;
}

/// Identity of a head.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identity {
    /// Node-ID.
    pub node: u8,
    /// Name of the product.
    pub name: String,
    /// Board.
    pub hardware: String,
    /// Version of its program.
    pub software: String,
    /// Serial number.
    pub serial: u32,
    /// Revision of its objects.
    pub revision: u32,
}

impl Identity {
    /// That of a head which nobody has asked: its node-ID alone.
    pub fn unread(node: u8) -> Identity {
        let name = String::new();
        Identity { node, name: name.clone(), hardware: name.clone(), software: name, serial: 0, revision: 0 }
    }
}

/// Called again and again while something is waited for; an error ends the wait.
pub type Tick<'a> = &'a mut dyn FnMut() -> Result<(), Failure>;

/// A head on the bus, whose description file is at hand.
#[derive(Clone)]
pub struct Head {
    /// The bus.
    pub bus: Bus,
    /// Its values.
    pub sdo: Sdo,
    /// Node-ID.
    pub node: u8,
    /// What its objects mean.
    pub sheet: Arc<Sheet>,
    /// Who it is.
    pub identity: Identity,
}

impl Head {
    /// Identifies the device at a node-ID.
    ///
    /// # Errors
    /// When there is no answer, another device, or one that this description file does not describe.
    pub fn open(bus: &Bus, node: u8, sheet: &Arc<Sheet>) -> Result<Head, Failure> {
        let sdo = Sdo::new(bus, node);
        let kind = match sdo.probe(at::DEVICE_TYPE, THERE * 4) {
            Err(SdoError::Silent(..)) => {
                let connection = bus.connection();
                return Err(Failure::BadInput(format!(
                    "node {node}: no answer at {connection}; `edm-desk heads` lists the nodes that answer"
                )));
            }
            answer => unsigned(&answer?),
        };
        if kind & 0xFFFF != 402 {
            let what = format!("not a servo drive (device profile {})", kind & 0xFFFF);
            return Err(Failure::BadInput(format!("node {node}: {what}: this program does not use it")));
        }
        let part = |sub| sdo.read(Address(0x1018, sub)).map(|bytes| unsigned(&bytes));
        let device_id = DeviceId { vendor: part(1)?, product: part(2)?, revision: part(3)? };
        let known = sheet.device_id;
        if (device_id.vendor, device_id.product) != (known.vendor, known.product) {
            return Err(Failure::BadInput(format!(
                "node {node}: another device (vendor {:X}h, product {:X}h); the description file is of {} (vendor {:X}h, product {:X}h): give the file of this device with --eds",
                device_id.vendor, device_id.product, sheet.product, known.vendor, known.product
            )));
        }
        if device_id.revision != known.revision {
            return Err(Failure::BadInput(format!(
                "node {node}: its objects are revision {}, the description file is of revision {}: give the file of its firmware with --eds",
                device_id.revision, known.revision
            )));
        }
        let text = |index| -> Result<String, SdoError> {
            Ok(String::from_utf8_lossy(&sdo.read(Address(index, 0))?).into_owned())
        };
        let identity = Identity {
            node,
            name: text(0x1008)?,
            hardware: text(0x1009)?,
            software: text(0x100A)?,
            serial: unsigned(&sdo.read(at::SERIAL)?),
            revision: device_id.revision,
        };
        Ok(Head { bus: bus.clone(), sdo, node, sheet: sheet.clone(), identity })
    }

    /// A whole number.
    ///
    /// # Errors
    /// Those of the transfer.
    pub fn whole(&self, address: Address) -> Result<i64, SdoError> {
        let bytes = self.sdo.read(address)?;
        let object = self.sheet.get(address).cloned().map(|object| Object { choices: Default::default(), ..object });
        match object.and_then(|object| object.decode(&bytes)) {
            Some(Value::Whole(number)) => Ok(number),
            Some(Value::Flag(flag)) => Ok(flag.into()),
            _ => Err(SdoError::Garbled(self.node, address)),
        }
    }

    /// A number in its unit.
    ///
    /// # Errors
    /// Those of the transfer.
    pub fn number(&self, address: Address) -> Result<f64, SdoError> {
        let bytes = self.sdo.read(address)?;
        let number = self.sheet.get(address).and_then(|object| object.number(&bytes));
        number.ok_or(SdoError::Garbled(self.node, address))
    }

    /// Writes a whole number, as long as its object is.
    ///
    /// # Errors
    /// Those of the transfer.
    pub fn set(&self, address: Address, number: i64) -> Result<(), SdoError> {
        let bytes = self.sheet.get(address).and_then(|object| object.encode(&Value::Whole(number)));
        self.sdo.write(address, &bytes.ok_or(SdoError::Garbled(self.node, address))?)
    }

    /// Encoder counts in a millimetre.
    ///
    /// # Errors
    /// Those of the transfer.
    pub fn counts_per_mm(&self) -> Result<f64, SdoError> {
        Ok(self.whole(at::INCREMENTS)? as f64 / (self.whole(at::MILLIMETRES)? as f64).max(1.0))
    }

    /// The value of a setting, in its unit.
    ///
    /// # Errors
    /// Those of the transfer.
    pub fn setting(&self, key: &str) -> Result<f64, Failure> {
        let object = self.sheet.setting(key).map_err(Failure::Failed)?;
        Ok(self.number(object.address)?)
    }

    /// Where the head is, and the end of its stroke or the software limit before it, counts. A head without a home is where
    /// homing on the spot puts it.
    ///
    /// # Errors
    /// Those of the transfers.
    pub fn room(&self) -> Result<(i64, i64), Failure> {
        let homed = self.whole(at::HOMED)? != 0;
        // Homing takes the datum away.
        let datum = if homed { self.whole(at::DATUM)? } else { 0 };
        let here = if homed { self.whole(at::POSITION)? } else { -self.whole(at::HOME_OFFSET)? };
        let stroke = self.setting("axis.stroke_um")? / 1000.0 * self.counts_per_mm()?;
        Ok((here, (stroke as i64).min(self.whole(at::LIMIT_MAX)?) - datum))
    }

    /// From now on head and program monitor each other by heartbeats.
    ///
    /// # Errors
    /// When the head already monitors four others, or refuses.
    pub fn arm(&self) -> Result<Armed<'_>, Failure> {
        let (mine, mut free) = (u32::from(self.bus.claim_host()), None);
        for sub in 1..=4 {
            let watch = unsigned(&self.sdo.read(Address(0x1016, sub))?);
            if watch >> 16 == mine || watch & 0xFFFF == 0 && free.is_none() {
                free = Some(Address(0x1016, sub));
            }
            if watch >> 16 == mine {
                break;
            }
        }
        let Some(slot) = free else {
            return Err(Failure::Failed(format!("node {}: it already monitors four other hosts (1016h)", self.node)));
        };
        let beat = self.whole(at::PRODUCER)?;
        self.bus.keep_alive(SILENCE);
        self.sdo.write(slot, &(mine << 16 | SILENCE.as_millis() as u32).to_le_bytes())?;
        // Before anything is enabled. Without it a link that is lost within the first period would never be missed.
        self.bus.beat();
        self.set(at::PRODUCER, BEAT.as_millis() as i64)?;
        self.bus.send(0, &[1, self.node]);
        Ok(Armed { head: self, slot, beat })
    }

    /// Closes the loop where the head is.
    ///
    /// # Errors
    /// Why it refuses, in words.
    pub fn enable(&self, tick: Tick<'_>) -> Result<(), Failure> {
        let before = self.whole(at::REFUSALS)?;
        self.set(at::MODE, 1)?;
        for (word, state) in [(0x06, 0x21), (0x07, 0x23), (0x0F, 0x27)] {
            self.set(at::CONTROLWORD, word)?;
            let reached = self.wait(STATE, tick, |head| {
                head.refused(before)?;
                Ok(head.status()? & status::MASK == state)
            })?;
            if !reached {
                return Err(Failure::Failed(format!("not enabled within {} s", STATE.as_secs())));
            }
        }
        Ok(())
    }

    /// Starts the guided check; it runs when this returns.
    ///
    /// # Errors
    /// Why it refuses, in words.
    pub fn begin_check(&self, tick: Tick<'_>) -> Result<(), Failure> {
        let before = self.whole(at::REFUSALS)?;
        self.set(at::CHECK, 1)?;
        let begun = self.wait(STATE, tick, |head| {
            head.refused(before)?;
            Ok(matches!(head.whole(at::STATE)? as u8, state::COMMISSIONING | state::PROVING))
        })?;
        if begun { Ok(()) } else { Err(Failure::Failed(format!("not started within {} s", STATE.as_secs()))) }
    }

    /// Takes the place where the head rests for home.
    ///
    /// # Errors
    /// When it refuses, or a fault comes.
    pub fn home_here(&self, tick: Tick<'_>) -> Result<(), Failure> {
        let method = self.whole(at::HOMING_METHOD)?;
        self.set(at::HOMING_METHOD, HERE)?;
        let homed = self.home_as_set(tick);
        self.set(at::HOMING_METHOD, method)?;
        homed
    }

    /// Takes a home in the way that is set in the head (6098h), by default where it is. A home at the work would be another one in each hole.
    ///
    /// # Errors
    /// When it refuses, or finds none.
    pub fn home(&self, tick: Tick<'_>) -> Result<(), Failure> {
        match self.whole(at::HOMING_METHOD)? {
            ..0 => self.home_here(tick),
            _ => self.home_as_set(tick),
        }
    }

    fn home_as_set(&self, tick: Tick<'_>) -> Result<(), Failure> {
        let before = self.whole(at::REFUSALS)?;
        self.set(at::MODE, 6)?;
        self.set(at::CONTROLWORD, 0x0F)?;
        self.set(at::CONTROLWORD, 0x1F)?;
        let homed = self.wait(HOMING, tick, |head| {
            head.refused(before)?;
            let word = head.status()?;
            if word & status::ERROR != 0 {
                return Err(Failure::Failed("homing: no reference found".into()));
            }
            head.enabled()?;
            Ok(word & status::TAKEN != 0 && head.whole(at::HOMED)? == 1)
        })?;
        self.set(at::CONTROLWORD, 0x0F)?;
        self.set(at::MODE, 1)?;
        if homed { Ok(()) } else { Err(Failure::Failed(format!("not homed within {} s", HOMING.as_secs()))) }
    }

    /// Goes on with the hole that waits, by what was touched last, once the head has come to rest; gives its surface, counts.
    ///
    /// # Errors
    /// Why its place is not known.
    pub fn go_on(&self, touched: u8, tick: Tick<'_>) -> Result<i64, Failure> {
        /// 201Ah:3: the head is not at rest.
        const NOT_AT_REST: i64 = 12;
        let mut refused = None;
        self.wait(STATE, tick, |head| {
            let Err(error) = head.set(at::GO_ON, touched.into()) else {
                refused = None;
                return Ok(true);
            };
            let why = head.whole(at::GO_ON_REFUSED)?;
            refused = Some((why, error));
            Ok(why != NOT_AT_REST)
        })?;
        if let Some((why, error)) = refused {
            let names = self.sheet.get(at::GO_ON_REFUSED).map(|object| object.names()).unwrap_or_default();
            let why = names.get(&why).filter(|_| why != 0).cloned().unwrap_or_else(|| error.to_string());
            return Err(Failure::Failed(format!("the hole is not gone on with: {why}")));
        }
        Ok(self.whole(at::KEPT_SURFACE)?)
    }

    /// Gives a set point of profile position; it has been taken when this returns.
    ///
    /// # Errors
    /// When it refuses, or a fault comes.
    pub fn start(&self, counts: i64, tick: Tick<'_>) -> Result<(), Failure> {
        let before = self.whole(at::REFUSALS)?;
        self.set(at::TARGET, counts)?;
        self.set(at::CONTROLWORD, 0x0F)?;
        let over = self.wait(STATE, tick, |head| Ok(head.status()? & status::TAKEN == 0))?;
        self.set(at::CONTROLWORD, 0x1F)?;
        let taken = self.wait(STATE, tick, |head| {
            head.refused(before)?;
            Ok(head.status()? & status::TAKEN != 0)
        })?;
        self.set(at::CONTROLWORD, 0x0F)?;
        if over && taken { Ok(()) } else { Err(Failure::Failed("the head did not accept the set point".into())) }
    }

    /// Place where the head measures itself, counts: `at_mm` below home, or where the head is; nothing moves.
    ///
    /// # Errors
    /// When it is not within the travel, with room above for the length of the setting `travel`; those of the transfers.
    pub fn place(&self, at_mm: Option<f64>, travel: &str) -> Result<i64, Failure> {
        let (per_mm, (here, end)) = (self.counts_per_mm()?, self.room()?);
        let needs = self.setting(travel)? / 1000.0;
        let (mm, end_mm) = (at_mm.unwrap_or(here as f64 / per_mm), end as f64 / per_mm);
        if !(needs..=end_mm).contains(&mm) {
            let help = if at_mm.is_none() { "; `--at MM` goes to another place first, pulses off" } else { "" };
            return Err(Failure::BadInput(format!(
                "at {mm:.3} mm: must be from {needs:.3} mm, the room that {travel} needs above, to {end_mm:.3} mm{help}"
            )));
        }
        Ok(at_mm.map_or(here, |mm| (mm * per_mm).round() as i64))
    }

    /// Enables and homes it, and takes it to its [`Head::place`] to measure itself. `moving` is called while it moves.
    ///
    /// # Errors
    /// Those of [`Head::place`], [`Head::enable`], [`Head::home_here`] and [`Head::move_to`].
    pub fn place_to_measure(
        &self,
        at_mm: Option<f64>,
        travel: &str,
        tick: Tick<'_>,
        moving: Tick<'_>,
    ) -> Result<(), Failure> {
        self.enable(tick)?;
        if self.whole(at::HOMED)? == 0 {
            self.home_here(tick)?;
        }
        let target = self.place(at_mm, travel)?;
        if self.room()?.0 == target {
            return Ok(());
        }
        self.move_to(target, &mut || {
            tick()?;
            moving()
        })
    }

    /// Goes there, pulses off.
    ///
    /// # Errors
    /// When it refuses, or a fault comes, or it takes longer than a minute.
    pub fn move_to(&self, counts: i64, tick: Tick<'_>) -> Result<(), Failure> {
        let before = self.whole(at::REFUSALS)?;
        self.start(counts, tick)?;
        let there = self.wait(Duration::from_secs(60), tick, |head| {
            head.refused(before)?;
            head.enabled()?;
            Ok(head.status()? & status::REACHED != 0)
        })?;
        if there { Ok(()) } else { Err(Failure::Failed("the target was not reached within a minute".into())) }
    }

    /// Searches the surface of the work by touching it, pulses off; gives its position, counts.
    ///
    /// # Errors
    /// When it refuses, a fault comes, or there is no surface.
    pub fn find_surface(&self, tick: Tick<'_>) -> Result<i64, Failure> {
        let before = self.whole(at::REFUSALS)?;
        self.set(at::FIND, 1)?;
        // What is there before is the outcome of the last search.
        let began = self.wait(STATE, tick, |head| {
            head.refused(before)?;
            Ok(head.whole(at::FOUND)? == search::UNDER_WAY)
        })?;
        let over = began
            && self.wait(SEARCH, tick, |head| {
                head.enabled()?;
                Ok(head.whole(at::FOUND)? != search::UNDER_WAY)
            })?;
        let outcome = self.whole(at::FOUND)?;
        if over && outcome == search::FOUND {
            return Ok(self.whole(at::TOUCHED)?);
        }
        let names = self.sheet.get(at::FOUND).map(|object| object.names()).unwrap_or_default();
        let what =
            if over { names.get(&outcome).map_or("no answer", String::as_str) } else { "the search did not end" };
        let help = "check work, SENSE and GAP leads, or give the surface position";
        Err(Failure::Failed(format!("the surface was not found: {what}; {help}")))
    }

    /// Pulses off, hold, loop open; says what the head is then. The hold ends a guided check as well.
    ///
    /// # Errors
    /// When that failed: stop the head at the machine.
    pub fn stop(&self) -> Result<String, Failure> {
        // Each is tried, whatever the other said: disabling alone switches pulses off as well.
        let held = (0..3).find_map(|_| self.set(at::HOLD, 1).ok());
        let mut last = None;
        for _ in 0..3 {
            match self.set(at::CONTROLWORD, 0) {
                Ok(()) => last = None,
                Err(error) => {
                    last = Some(error);
                    continue;
                }
            }
            let begun = Instant::now();
            while begun.elapsed() < STATE {
                match self.whole(at::STATE).map(|state| state as u8) {
                    Ok(state::DISABLED) => return Ok("the head is disabled, pulses are off".into()),
                    Ok(state::FAULT) => {
                        let fault = words::fault_line(self.whole(at::FAULT).unwrap_or(0) as u8);
                        return Ok(format!("the head has a fault, pulses are off: {fault}"));
                    }
                    Ok(_) => std::thread::sleep(LOOK),
                    Err(error) => {
                        last = Some(error);
                        break;
                    }
                }
            }
        }
        let why = last.map_or("it does not stop".into(), |error| error.to_string());
        let held = if held.is_some() { "; it has the command to hold" } else { "" };
        Err(Failure::Failed(format!("the head may still be enabled, switch it off at the machine: {why}{held}")))
    }

    /// Resets a fault whose cause is gone, and acknowledges what was not in force at the start; false when there was no fault.
    ///
    /// # Errors
    /// Why the head keeps it.
    pub fn reset(&self) -> Result<bool, Failure> {
        let fault = self.whole(at::FAULT)? != 0;
        let before = self.whole(at::REFUSALS)?;
        self.set(at::CONTROLWORD, 0)?;
        self.set(at::CONTROLWORD, 0x80)?;
        let end = Instant::now() + STATE;
        while Instant::now() < end {
            self.refused(before)?;
            if self.whole(at::STATE)? as u8 != state::FAULT {
                self.set(at::CONTROLWORD, 0)?;
                return Ok(fault);
            }
            std::thread::sleep(LOOK);
        }
        Err(Failure::Failed(format!("the fault is still active: {}", words::fault_line(self.whole(at::FAULT)? as u8))))
    }

    /// Stores settings and profile, not the monitoring of this program.
    ///
    /// # Errors
    /// Why the head does not.
    pub fn store(&self) -> Result<(), Failure> {
        Ok(self.sdo.write(at::STORE_APPLICATION, b"save")?)
    }

    /// An error when the head has refused a command since this count of refusals.
    ///
    /// # Errors
    /// Why, in words.
    pub(crate) fn refused(&self, before: i64) -> Result<(), Failure> {
        if self.whole(at::REFUSALS)? == before {
            return Ok(());
        }
        let words = words::refusal(self.whole(at::REFUSAL)? as u8);
        Err(Failure::Failed(format!("the head refuses: {}; {}", words.name, words.advice)))
    }

    /// The statusword, as it is now.
    ///
    /// # Errors
    /// Those of the transfer.
    pub fn status(&self) -> Result<u16, SdoError> {
        Ok(self.whole(at::STATUSWORD)? as u16)
    }

    /// Waits until it is so; `false` when the time is over. An error when a fault comes.
    fn wait(
        &self,
        time: Duration,
        tick: Tick<'_>,
        mut so: impl FnMut(&Head) -> Result<bool, Failure>,
    ) -> Result<bool, Failure> {
        let end = Instant::now() + time;
        while Instant::now() < end {
            tick()?;
            self.healthy()?;
            if so(self)? {
                return Ok(true);
            }
            std::thread::sleep(LOOK);
        }
        Ok(false)
    }

    /// An error when the head is disabled: what this program has enabled, somebody else has stopped.
    ///
    /// # Errors
    /// That; those of the transfer.
    pub fn enabled(&self) -> Result<(), Failure> {
        if self.whole(at::STATE)? as u8 == state::DISABLED { Err(Failure::Failed(DISABLED.into())) } else { Ok(()) }
    }

    /// An error when a fault is active.
    ///
    /// # Errors
    /// The fault, what the head does about it and what a person can do.
    pub fn healthy(&self) -> Result<(), Failure> {
        match self.whole(at::FAULT)? as u8 {
            0 => Ok(()),
            fault => Err(Failure::Failed(words::fault_line(fault))),
        }
    }
}

/// A head that monitors this program. Dropping it ends this program's heartbeat: a head that is still enabled retreats.
pub struct Armed<'a> {
    head: &'a Head,
    slot: Address,
    beat: i64,
}

impl Armed<'_> {
    /// Ends the monitoring by a head that is disabled or in a fault; any other head keeps it.
    pub fn disarm(self) {
        if let Ok(state::DISABLED | state::FAULT) = self.head.whole(at::STATE).map(|state| state as u8) {
            // Otherwise the head would monitor a host that may not return, and report it as lost when it is enabled.
            let _ = self.head.sdo.write(self.slot, &[0; 4]);
            let _ = self.head.set(at::PRODUCER, self.beat);
        }
    }
}

impl Drop for Armed<'_> {
    fn drop(&mut self) {
        self.head.bus.keep_alive(Duration::ZERO);
    }
}

/// Up to four bytes as an unsigned number.
pub(crate) fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().take(4).rev().fold(0, |value, byte| value << 8 | u32::from(*byte))
}

/// Nodes that answer, with their device type (1000h:0); 0 where nothing but answers to others, or an abort, was heard.
pub fn scan(bus: &Bus) -> BTreeMap<u8, u32> {
    /// Upload of 1000h:0.
    const ASK: [u8; 8] = [0x40, 0x00, 0x10, 0, 0, 0, 0, 0];
    let mut nodes = BTreeMap::new();
    let mut take = |node, answer: [u8; 8]| match answer {
        [0x43, 0x00, 0x10, 0, a, b, c, d] => _ = nodes.insert(node, u32::from_le_bytes([a, b, c, d])),
        // It is there, whatever it says.
        _ => _ = nodes.entry(node).or_insert(0),
    };
    // Nobody waits for a turn while holding others: a node that is silent would keep all of them from being stopped.
    let turns: Vec<_> = (1..=127).map(|node| (node, bus.turn_now(node))).collect();
    turns.iter().filter_map(|(_, turn)| turn.as_ref()).for_each(|turn| turn.say(ASK));
    let (end, mut busy) = (Instant::now() + THERE, Vec::new());
    for (node, turn) in &turns {
        let Some(turn) = turn else {
            busy.push(*node);
            continue;
        };
        // Another program that talks to the node is answered in between.
        while let Some(answer) = turn.hear(end.saturating_duration_since(Instant::now())) {
            take(*node, answer);
            if answer[1..4] == ASK[1..4] {
                break;
            }
        }
    }
    drop(turns);
    for node in busy {
        if let Some(turn) = bus.turn(node) {
            turn.say(ASK);
            if let Some(answer) = turn.hear(THERE) {
                take(node, answer);
            }
        }
    }
    nodes
}

//! SDO client (CiA 301 7.2.4): reads and writes the dictionary of a node.
//!
//! A value of up to four bytes goes in one frame, a longer one in segments, a domain by blocks, as does what is written and
//! longer than [`SEGMENTED`]. A refused or interrupted transfer changes nothing.

use crate::bus::{Bus, Turn};
use crate::words;
use std::cell::Cell;
use std::fmt::{self, Display, Formatter};
use std::str::FromStr;
use std::time::{Duration, Instant};

/// How long a server may take; storing may stall the head for half a second.
const PATIENCE: Duration = Duration::from_secs(2);
/// A transfer by blocks that has not advanced for so long has ended, whatever is heard.
const STALLED: Duration = Duration::from_millis(500);
/// Times that a read is begun anew when it was disturbed.
const TRIES: u32 = 8;
/// Silence within a block after which missing segments are requested again.
const GAP: Duration = Duration::from_millis(200);
/// The longest value that is written in segments, bytes.
pub const SEGMENTED: usize = 28;
/// Nothing that a head has is longer, bytes.
const LONGEST: usize = 1 << 20;
/// Segments in a block that is read.
const BLOCK: u8 = 127;
const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_XMODEM);

/// Where a value is: index and sub-index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address(pub u16, pub u8);

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Address, String> {
        let (index, sub) = text.split_once(':').unwrap_or((text, "0"));
        let index = u16::from_str_radix(index.trim_end_matches(['h', 'H']), 16).ok();
        let sub = sub.parse().ok();
        index.zip(sub).map(|(index, sub)| Address(index, sub)).ok_or_else(|| "must be as 2005:1 or 6041".into())
    }
}

impl Display for Address {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Address(index, sub) = self;
        write!(f, "{index:04X}h:{sub}")
    }
}

/// Why a transfer did not succeed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SdoError {
    /// The node has refused, with this code.
    Refused(Address, u32),
    /// The node does not answer.
    Silent(u8, Address),
    /// The connection to the bus is lost.
    Lost(String),
    /// The node's answers do not make a transfer.
    Garbled(u8, Address),
}

impl Display for SdoError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            SdoError::Refused(address, code) => write!(f, "{address} refused: {}", words::abort(*code)),
            SdoError::Silent(node, address) => {
                write!(f, "node {node} does not answer ({address}): check its power, bit rate and node-ID")
            }
            SdoError::Lost(connection) => {
                write!(
                    f,
                    "{connection}: connection to the bus lost: check adapter, cable and the program at the other end"
                )
            }
            SdoError::Garbled(node, address) => {
                write!(f, "node {node} answers {address} with an invalid SDO: is another program using this node?")
            }
        }
    }
}

/// Aborts of the client.
mod abort {
    pub const TOGGLE: u32 = 0x0503_0000;
    pub const TIMED_OUT: u32 = 0x0504_0000;
    pub const COMMAND: u32 = 0x0504_0001;
    pub const CRC: u32 = 0x0504_0004;
    pub const OUT_OF_MEMORY: u32 = 0x0504_0005;
}

/// The SDO server of a node, from outside.
#[derive(Clone)]
pub struct Sdo {
    bus: Bus,
    node: u8,
}

impl Sdo {
    /// That of a node.
    pub fn new(bus: &Bus, node: u8) -> Sdo {
        Sdo { bus: bus.clone(), node }
    }

    /// Reads a value, in one frame or in segments.
    ///
    /// # Errors
    /// When the node refuses or does not answer.
    pub fn read(&self, address: Address) -> Result<Vec<u8>, SdoError> {
        // Another program that talks to the same server ends a transfer in segments: a new one is answered.
        for tried in 1..TRIES {
            match self.probe(address, PATIENCE) {
                // Two programs that try again at once meet again: each waits for a time of its own.
                Err(SdoError::Garbled(..) | SdoError::Refused(_, abort::TOGGLE | abort::COMMAND)) => {
                    std::thread::sleep(tried * Duration::from_millis(3 + u64::from(std::process::id() % 11)));
                }
                done => return done,
            }
        }
        self.probe(address, PATIENCE)
    }

    /// Whether there is a node at all: as [`Sdo::read`], but with so much patience.
    ///
    /// # Errors
    /// When the node refuses or does not answer.
    pub fn probe(&self, address: Address, patience: Duration) -> Result<Vec<u8>, SdoError> {
        let talk = self.talk(address, patience)?;
        let answer = talk.ask(request(0x40, address, [0; 4]))?;
        talk.upload(answer)
    }

    /// Reads a value by blocks, as is best for a long one.
    ///
    /// # Errors
    /// When the node refuses or does not answer.
    pub fn read_block(&self, address: Address) -> Result<Vec<u8>, SdoError> {
        let talk = self.talk(address, PATIENCE)?;
        let answer = talk.ask(request(0xA4, address, [BLOCK, 0, 0, 0]))?;
        if answer[0] & 0xE0 == 0x40 {
            // A server may choose the ordinary way.
            return talk.upload(answer);
        }
        if answer[0] & 0xE1 != 0xC0 || !addressed(answer, address) {
            return Err(talk.give_up(abort::COMMAND));
        }
        let checked = answer[0] & 0x04 != 0;
        let mut value = Vec::new();
        talk.turn.say([0xA3, 0, 0, 0, 0, 0, 0, 0]);
        let (mut complete, mut quiet) = (false, 0);
        let mut advanced = Instant::now();
        while !complete {
            let mut segment = 0;
            loop {
                match talk.turn.hear(GAP) {
                    None if quiet > 4 => return Err(talk.silence()),
                    // Lost ones are sent again from the one that is confirmed.
                    None => {
                        quiet += 1;
                        break;
                    }
                    // An abort: no segment has the number 0.
                    Some([0x80, .., a, b, c, d]) => {
                        return Err(SdoError::Refused(address, u32::from_le_bytes([a, b, c, d])));
                    }
                    Some([command, data @ ..]) => {
                        let number = command & 0x7F;
                        quiet = 0;
                        if number == segment + 1 {
                            advanced = Instant::now();
                            segment = number;
                            value.extend_from_slice(&data);
                            complete = command & 0x80 != 0;
                        }
                        if value.len() > LONGEST {
                            return Err(talk.give_up(abort::OUT_OF_MEMORY));
                        }
                        // Another program has ended the transfer, and what is heard are the answers to it.
                        if advanced.elapsed() > STALLED {
                            return Err(talk.give_up(abort::COMMAND));
                        }
                        if number == BLOCK || command & 0x80 != 0 {
                            break;
                        }
                    }
                }
            }
            talk.turn.say([0xA2, segment, BLOCK, 0, 0, 0, 0, 0]);
        }
        let [command, low, high, ..] = talk.hear()?;
        if command & 0xE1 != 0xC1 {
            return Err(talk.give_up(abort::COMMAND));
        }
        let empty = usize::from(command >> 2 & 7);
        value.truncate(value.len().saturating_sub(empty));
        if checked && CRC.checksum(&value) != u16::from_le_bytes([low, high]) {
            return Err(talk.give_up(abort::CRC));
        }
        talk.turn.say([0xA1, 0, 0, 0, 0, 0, 0, 0]);
        Ok(value)
    }

    /// Writes a value, the way that suits its length.
    ///
    /// # Errors
    /// When the node refuses or does not answer; the value is then as it was.
    pub fn write(&self, address: Address, value: &[u8]) -> Result<(), SdoError> {
        match value.len() {
            1..=4 => self.write_at_once(address, value),
            0..=SEGMENTED => self.write_segments(address, value),
            _ => self.write_block(address, value),
        }
    }

    fn write_at_once(&self, address: Address, value: &[u8]) -> Result<(), SdoError> {
        let talk = self.talk(address, PATIENCE)?;
        let mut data = [0; 4];
        data.iter_mut().zip(value).for_each(|(to, from)| *to = *from);
        let answer = talk.ask(request(0x23 | (4 - value.len() as u8) << 2, address, data))?;
        if answer[0] == 0x60 && addressed(answer, address) { Ok(()) } else { Err(talk.give_up(abort::COMMAND)) }
    }

    /// Writes a value of any length in segments.
    ///
    /// # Errors
    /// When the node refuses or does not answer.
    pub fn write_segments(&self, address: Address, value: &[u8]) -> Result<(), SdoError> {
        let talk = self.talk(address, PATIENCE)?;
        let answer = talk.ask(request(0x21, address, (value.len() as u32).to_le_bytes()))?;
        if answer[0] != 0x60 || !addressed(answer, address) {
            return Err(talk.give_up(abort::COMMAND));
        }
        let count = value.len().div_ceil(7).max(1);
        for place in 0..count {
            let part = value.get(7 * place..(7 * place + 7).min(value.len())).unwrap_or(&[]);
            let toggle = (place as u8 & 1) << 4;
            let last = u8::from(place + 1 == count);
            let answer = talk.ask(segment(toggle | (7 - part.len() as u8) << 1 | last, part))?;
            if answer[0] != 0x20 | toggle {
                return Err(talk.give_up(abort::TOGGLE));
            }
        }
        Ok(())
    }

    /// Writes a value of any length by blocks.
    ///
    /// # Errors
    /// When the node refuses or does not answer.
    pub fn write_block(&self, address: Address, value: &[u8]) -> Result<(), SdoError> {
        self.write_block_with(address, value, &mut |_| {})
    }

    /// The same, and says after each block how many bytes the node has.
    ///
    /// # Errors
    /// When the node refuses or does not answer.
    pub fn write_block_with(&self, address: Address, value: &[u8], on: &mut dyn FnMut(usize)) -> Result<(), SdoError> {
        let talk = self.talk(address, PATIENCE)?;
        let answer = talk.ask(request(0xC6, address, (value.len() as u32).to_le_bytes()))?;
        if answer[0] & 0xFB != 0xA0 || !addressed(answer, address) {
            return Err(talk.give_up(abort::COMMAND));
        }
        let checked = answer[0] & 0x04 != 0;
        let count = value.len().div_ceil(7).max(1);
        let (mut done, mut block) = (0, usize::from(answer[4]));
        while done < count {
            let end = (done + block.clamp(1, 127)).min(count);
            for place in done..end {
                let part = value.get(7 * place..(7 * place + 7).min(value.len())).unwrap_or(&[]);
                let last = if place + 1 == count { 0x80 } else { 0 };
                talk.turn.say(segment(last | (place - done + 1) as u8, part));
            }
            let [command, taken, next, ..] = talk.hear()?;
            if command != 0xA2 || usize::from(taken) > end - done {
                return Err(talk.give_up(abort::COMMAND));
            }
            done += usize::from(taken);
            block = usize::from(next);
            on((7 * done).min(value.len()));
        }
        let sum = if checked { CRC.checksum(value).to_le_bytes() } else { [0; 2] };
        let empty = (7 * count - value.len()).min(7) as u8;
        match talk.ask(segment(0xC1 | empty << 2, &sum))?[0] {
            0xA1 => Ok(()),
            _ => Err(talk.give_up(abort::COMMAND)),
        }
    }

    fn talk(&self, address: Address, patience: Duration) -> Result<Talk<'_>, SdoError> {
        let turn = self.bus.turn(self.node).ok_or(SdoError::Silent(self.node, address))?;
        Ok(Talk { sdo: self, turn, address, patience, begun: Cell::new(false) })
    }
}

/// A transfer in progress.
struct Talk<'a> {
    sdo: &'a Sdo,
    turn: Turn<'a>,
    address: Address,
    patience: Duration,
    /// The first answer has come.
    begun: Cell<bool>,
}

impl Talk<'_> {
    fn ask(&self, request: [u8; 8]) -> Result<[u8; 8], SdoError> {
        if self.sdo.bus.lost() {
            return Err(SdoError::Lost(self.sdo.bus.connection()));
        }
        self.turn.say(request);
        self.hear()
    }

    /// The next answer. One that carries another address is to another client: it is passed over, but for an abort in the
    /// middle of a transfer, which has ended that of this client, too.
    fn hear(&self) -> Result<[u8; 8], SdoError> {
        let end = Instant::now() + self.patience;
        while let Some(answer) = self.turn.hear(end.saturating_duration_since(Instant::now())) {
            let [command, .., a, b, c, d] = answer;
            let ours = addressed(answer, self.address);
            match command {
                0x80 if ours => return Err(SdoError::Refused(self.address, u32::from_le_bytes([a, b, c, d]))),
                0x80 if self.begun.get() => return Err(SdoError::Garbled(self.sdo.node, self.address)),
                // Answers that carry an address: upload, download, block download, block upload.
                0x40..=0x60 | 0x80 | 0xA0 | 0xA4 | 0xC0 | 0xC2 | 0xC4 | 0xC6 if !ours => {}
                _ => {
                    self.begun.set(true);
                    return Ok(answer);
                }
            }
        }
        Err(self.silence())
    }

    fn silence(&self) -> SdoError {
        self.turn.say(request(0x80, self.address, abort::TIMED_OUT.to_le_bytes()));
        if self.sdo.bus.lost() {
            return SdoError::Lost(self.sdo.bus.connection());
        }
        SdoError::Silent(self.sdo.node, self.address)
    }

    fn give_up(&self, code: u32) -> SdoError {
        self.turn.say(request(0x80, self.address, code.to_le_bytes()));
        SdoError::Garbled(self.sdo.node, self.address)
    }

    /// What follows the answer to an upload's request.
    fn upload(&self, answer: [u8; 8]) -> Result<Vec<u8>, SdoError> {
        let [command, _, _, _, data @ ..] = answer;
        if command & 0xE0 != 0x40 || !addressed(answer, self.address) {
            return Err(self.give_up(abort::COMMAND));
        }
        if command & 0x02 != 0 {
            let length = if command & 0x01 != 0 { 4 - usize::from(command >> 2 & 3) } else { 4 };
            return Ok(data[..length].to_vec());
        }
        let announced = (command & 0x01 != 0).then_some(u32::from_le_bytes(data) as usize);
        let mut value = Vec::new();
        let mut toggle = 0;
        loop {
            let [command, data @ ..] = self.ask([0x60 | toggle, 0, 0, 0, 0, 0, 0, 0])?;
            if command & 0xF0 != toggle {
                return Err(self.give_up(abort::TOGGLE));
            }
            value.extend_from_slice(&data[..7 - usize::from(command >> 1 & 7)]);
            if value.len() > LONGEST {
                return Err(self.give_up(abort::OUT_OF_MEMORY));
            }
            if command & 0x01 != 0 {
                // Another client's segments, if the length is another.
                let whole = announced.is_none_or(|length| length == value.len());
                return if whole { Ok(value) } else { Err(SdoError::Garbled(self.sdo.node, self.address)) };
            }
            toggle ^= 0x10;
        }
    }
}

fn request(command: u8, Address(index, sub): Address, [a, b, c, d]: [u8; 4]) -> [u8; 8] {
    let [low, high] = index.to_le_bytes();
    [command, low, high, sub, a, b, c, d]
}

fn addressed([_, low, high, sub, ..]: [u8; 8], address: Address) -> bool {
    Address(u16::from_le_bytes([low, high]), sub) == address
}

fn segment(command: u8, part: &[u8]) -> [u8; 8] {
    let mut frame = [0; 8];
    frame[0] = command;
    frame[1..].iter_mut().zip(part).for_each(|(to, from)| *to = *from);
    frame
}

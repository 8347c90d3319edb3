//! The frames of a bus in a file, as `candump -L` writes them, and what they say.
//!
//! The first line names the description file by its CRC-32: values of another one would get wrong names. A recording is read without a
//! bus, or its hosts are played to a bus: a virtual head then gets the same commands at the same times.

use crate::Failure;
use crate::bus::{Bus, lock};
use crate::sdo::Address;
use crate::sheet::{Sheet, Value};
use crate::{head::at, words};
use edm_bus::Frame;
use edm_bus::mailbox::Mailbox;
use embedded_can::{Frame as _, Id};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Period at which what was heard goes to the file.
const WRITTEN: Duration = Duration::from_millis(200);
/// Name of the interface in the file.
const INTERFACE: &str = "can0";
/// What the first line begins with.
const HEADER: &str = "# edm-desk, description file ";

/// Writes every frame of a bus to a file, from now until this is dropped.
pub struct Recording {
    file: Arc<Mutex<BufWriter<File>>>,
    frames: Arc<Mutex<u64>>,
    _tap: edm_bus::Port,
    mailbox: Arc<Mailbox>,
}

impl Recording {
    /// Begins. An existing file gets more lines.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn begin(bus: &Bus, sheet: &Sheet, path: &Path) -> Result<Recording, Failure> {
        let refused = |why: std::io::Error| Failure::BadInput(format!("{}: {why}", path.display()));
        let mut file = File::options().create(true).append(true).open(path).map_err(refused)?;
        writeln!(file, "{HEADER}{:08X}", sheet.fingerprint).map_err(refused)?;
        let file = Arc::new(Mutex::new(BufWriter::new(file)));
        let (tap, mailbox) = bus.tap();
        let frames = Arc::new(Mutex::new(0));
        let (weak, heard, count) = (Arc::downgrade(&file), mailbox.clone(), frames.clone());
        thread::spawn(move || {
            let mut taken = Vec::new();
            let mut flushed = Instant::now();
            loop {
                heard.wait(Instant::now() + WRITTEN);
                let Some(file) = weak.upgrade() else { return };
                heard.take(&mut taken);
                *lock(&count) += taken.len() as u64;
                let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
                let mut file = lock(&file);
                // A disk that is full is no reason to end anything.
                for frame in taken.drain(..) {
                    let _ = writeln!(file, "{}", line(now, &frame));
                }
                if flushed.elapsed() >= WRITTEN {
                    let _ = file.flush();
                    flushed = Instant::now();
                }
            }
        });
        Ok(Recording { file, frames, _tap: tap, mailbox })
    }

    /// Frames so far.
    pub fn frames(&self) -> u64 {
        *lock(&self.frames)
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        self.mailbox.ring();
        let _ = lock(&self.file).flush();
    }
}

/// A frame as `candump -L` writes it.
fn line(time: Duration, frame: &Frame) -> String {
    let id = match frame.id() {
        Id::Standard(id) => format!("{:03X}", id.as_raw()),
        Id::Extended(id) => format!("{:08X}", id.as_raw()),
    };
    let mut text = format!("({}.{:06}) {INTERFACE} {id}#", time.as_secs(), time.subsec_micros());
    if frame.is_remote_frame() {
        text.push('R');
    }
    // A string takes everything.
    for byte in frame.data() {
        let _ = write!(text, "{byte:02X}");
    }
    text
}

/// A frame of a recording.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// When it was heard, s since 1970.
    pub at_s: f64,
    /// Identifier of 11 bits; longer ones are none of CANopen.
    pub id: u16,
    /// Content.
    pub data: Vec<u8>,
}

/// Reads a recording: those of `candump -L` as well, which name no description file.
///
/// # Errors
/// What is wrong, with its line; a description file that is not `sheet`'s.
pub fn read(text: &str, sheet: &Sheet) -> Result<Vec<Recorded>, String> {
    let mut frames = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        if let Some(name) = line.strip_prefix(HEADER)
            && name.trim() != format!("{:08X}", sheet.fingerprint)
        {
            return Err(format!(
                "line {number}: recorded with description file {}, this one is {:08X}: give that one with --eds",
                name.trim(),
                sheet.fingerprint
            ));
        }
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let frame = one(line).ok_or_else(|| format!("line {number}: must be as (1732614000.123456) can0 181#4002"))?;
        frames.extend(frame);
    }
    Ok(frames)
}

/// A line; one with a longer identifier or of a remote frame has no frame of CANopen.
fn one(line: &str) -> Option<Option<Recorded>> {
    let mut parts = line.split_whitespace();
    let at_s = parts.next()?.strip_prefix('(')?.strip_suffix(')')?.parse().ok()?;
    let (id, data) = parts.nth(1)?.split_once('#')?;
    if id.len() == 8 || data.starts_with('R') {
        return Some(None);
    }
    let id = u16::from_str_radix(id, 16).ok().filter(|id| *id < 0x800)?;
    let bytes = data.as_bytes().chunks(2);
    let byte = |two: &[u8]| u8::from_str_radix(std::str::from_utf8(two).ok().filter(|two| two.len() == 2)?, 16).ok();
    let data: Option<Vec<u8>> = bytes.map(byte).collect();
    Some(Some(Recorded { at_s, id, data: data.filter(|data| data.len() <= 8)? }))
}

/// What a frame has said.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Said {
    /// Time since the first frame, s.
    pub at_s: f64,
    /// Node-ID; 0 for all.
    pub node: u8,
    /// In words.
    pub what: String,
}

/// Reads what frames say, one after the other.
pub struct Reader<'a> {
    sheet: &'a Sheet,
    began: Option<f64>,
    /// By node and address: what was said last.
    last: BTreeMap<(u8, Address), Vec<u8>>,
    /// By node: what a host writes and is not answered yet.
    written: BTreeMap<u8, (Address, Option<Vec<u8>>)>,
    network: BTreeMap<u8, u8>,
}

impl<'a> Reader<'a> {
    /// Of heads that this describes.
    pub fn new(sheet: &'a Sheet) -> Reader<'a> {
        let (last, written, network) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        Reader { sheet, began: None, last, written, network }
    }

    /// What the next frame says; nothing of one that says what was said before.
    pub fn take(&mut self, frame: &Recorded) -> Vec<Said> {
        let began = *self.began.get_or_insert(frame.at_s);
        let node = (frame.id & 0x7F) as u8;
        let what = match (frame.id, frame.data.as_slice()) {
            (0, [command, to, ..]) => return vec![Said { at_s: frame.at_s - began, node: *to, what: nmt(*command) }],
            (0x81..=0xFF, [low, high, ..]) => {
                let code = u16::from_le_bytes([*low, *high]);
                vec![format!("emergency {code:04X}h: {}", words::emergency(code))]
            }
            (0x181..=0x1FF | 0x281..=0x2FF | 0x381..=0x3FF | 0x481..=0x4FF, data) => {
                self.process_data(frame.id, node, data)
            }
            (0x601..=0x67F, data) => {
                self.request(node, data);
                Vec::new()
            }
            (0x581..=0x5FF, data) => self.answer(node, data).into_iter().collect(),
            (0x701..=0x77F, [state]) if self.network.insert(node, *state) != Some(*state) => {
                vec![format!("network: {}", words::network(*state))]
            }
            _ => Vec::new(),
        };
        what.into_iter().map(|what| Said { at_s: frame.at_s - began, node, what }).collect()
    }

    /// A process data object: changes of state, of the fault and of what was refused.
    fn process_data(&mut self, id: u16, node: u8, mut data: &[u8]) -> Vec<String> {
        let number = (id >> 8) - 1;
        let mut said = Vec::new();
        for sub in 1..=8 {
            let entry = Address(0x1A00 + number, sub);
            let default = self.sheet.get(entry).and_then(|object| object.default.as_ref());
            let entry = match (self.last.get(&(node, entry)), default) {
                (Some(bytes), _) => bytes.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte)),
                (None, Some(Value::Whole(entry))) => *entry as u32,
                _ => break,
            };
            let address = Address((entry >> 16) as u16, (entry >> 8) as u8);
            let Some((bytes, rest)) = data.split_at_checked((entry & 0xFF) as usize / 8) else { break };
            if bytes.is_empty() {
                break;
            }
            data = rest;
            let new = self.last.insert((node, address), bytes.to_vec());
            let (now, before) =
                (bytes.first().copied().unwrap_or_default(), new.and_then(|bytes| bytes.first().copied()));
            if before == Some(now) {
                continue;
            }
            match address {
                at::STATE => {
                    let names = self.sheet.get(address).map(|object| object.names()).unwrap_or_default();
                    said.push(names.get(&now.into()).cloned().unwrap_or_else(|| format!("state {now}")));
                }
                at::FAULT if now != 0 => said.push(words::fault_line(now)),
                at::REFUSALS if before.is_some() => {
                    let number = self.last.get(&(node, at::REFUSAL)).and_then(|bytes| bytes.first().copied());
                    let words = words::refusal(number.unwrap_or_default());
                    said.push(format!("refused: {}; {}", words.name, words.advice));
                }
                _ => {}
            }
        }
        said
    }

    /// A host's request to the SDO server of a node: what it writes.
    fn request(&mut self, node: u8, data: &[u8]) {
        let [command, low, high, sub, value @ ..] = data else { return };
        let address = Address(u16::from_le_bytes([*low, *high]), *sub);
        match command {
            // Expedited, with its size.
            0x23 | 0x27 | 0x2B | 0x2F => {
                let size = 4 - usize::from(command >> 2 & 3);
                self.written.insert(node, (address, value.get(..size).map(<[u8]>::to_vec)));
            }
            // In segments or blocks: its bytes are not put together here.
            0x21 | 0xC2 | 0xC6 => {
                self.written.insert(node, (address, None));
            }
            _ => {}
        }
    }

    /// The answer: whether it was written.
    fn answer(&mut self, node: u8, data: &[u8]) -> Option<String> {
        let [command, _, _, _, rest @ ..] = data else { return None };
        let said = |address: Address| self.sheet.get(address).map_or(address.to_string(), |object| object.key.clone());
        match command {
            0x60 | 0xA4 | 0xA0 => {
                let (address, bytes) = self.written.remove(&node)?;
                let Some(bytes) = bytes else { return Some(format!("a host writes {}", said(address))) };
                let object = self.sheet.get(address);
                let value =
                    object.and_then(|object| object.decode(&bytes)).map_or("?".into(), |value| value.to_string());
                let unit = object.map_or("", |object| object.unit.as_str());
                let new = self.last.insert((node, address), bytes.clone()) != Some(bytes);
                new.then(|| format!("a host writes {} = {value} {unit}", said(address)).trim_end().to_owned())
            }
            0x80 => {
                let (address, _) = self.written.remove(&node)?;
                let code = u32::from_le_bytes(rest.try_into().ok()?);
                Some(format!("a host is refused to write {}: {}", said(address), words::abort(code)))
            }
            _ => None,
        }
    }
}

/// A command of the network management (CiA 301 7.2.8.2.1).
fn nmt(command: u8) -> String {
    let name = match command {
        0x01 => "start",
        0x02 => "stop",
        0x80 => "enter pre-operational",
        0x81 => "reset node",
        0x82 => "reset communication",
        _ => return format!("network command {command:02X}h"),
    };
    format!("network command: {name}")
}

/// Sends what hosts have sent in a recording, at the same distances in time; gives the number of frames.
pub fn play(frames: &[Recorded], bus: &Bus, mut tick: impl FnMut() -> bool) -> usize {
    // Who answers SDO is a node; all other heartbeats are of hosts.
    let nodes: Vec<u16> =
        frames.iter().filter(|frame| frame.id & 0x780 == 0x580).map(|frame| frame.id & 0x7F).collect();
    let of_host = |frame: &&Recorded| match frame.id {
        0 | 0x80 | 0x100 | 0x7E5 => true,
        id @ 0x701..=0x77F => !nodes.contains(&(id & 0x7F)),
        id => matches!(id & 0x780, 0x200 | 0x300 | 0x400 | 0x500 | 0x600) && id & 0x7F != 0,
    };
    let Some(first) = frames.first().map(|frame| frame.at_s) else { return 0 };
    let (began, mut sent) = (Instant::now(), 0);
    for frame in frames.iter().filter(of_host) {
        let due = began + Duration::from_secs_f64((frame.at_s - first).clamp(0.0, 1e7));
        while let Some(left) = due.checked_duration_since(Instant::now()) {
            if !tick() {
                return sent;
            }
            thread::sleep(left.min(Duration::from_millis(50)));
        }
        bus.send(frame.id, &frame.data);
        sent += 1;
    }
    sent
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_can::{ExtendedId, StandardId};

    fn frame(id: u16, data: &[u8]) -> Frame {
        Frame::new(StandardId::new(id).unwrap(), data).unwrap()
    }

    #[test]
    fn a_frame_reads_as_it_was_written_and_what_candump_writes_is_read() {
        let sheet = Sheet::own().unwrap();
        let text = line(Duration::from_micros(1_732_614_000_000_042), &frame(0x181, &[0x40, 2]));
        assert_eq!(text, "(1732614000.000042) can0 181#4002");
        let extended = Frame::new(ExtendedId::new(0x1234).unwrap(), &[1]).unwrap();
        let remote = Frame::new_remote(StandardId::new(0x701).unwrap(), 0).unwrap();
        let lines = [text, line(Duration::ZERO, &extended), line(Duration::ZERO, &remote), "# said by hand".into()];
        let frames = read(&lines.join("\n"), &sheet).unwrap();
        assert_eq!((frames.len(), frames[0].id, frames[0].data.as_slice()), (1, 0x181, &[0x40, 2][..]));
        for (text, part) in [
            ("(1.0) can0 181#402", "line 1: must be as"),
            ("(1.0) can0 FFF#40", "line 1: must be as"),
            ("(1.0) can0 181#00\n1.0 can0 181#00", "line 2: must be as"),
            ("# edm-desk, description file 00000000", "line 1: recorded with description file 00000000, this one is "),
        ] {
            let why = read(text, &sheet).unwrap_err();
            assert!(why.starts_with(part), "{why}");
        }
    }

    #[test]
    fn states_emergencies_and_who_writes_what_are_said_once() {
        let sheet = Sheet::own().unwrap();
        let mut reader = Reader::new(&sheet);
        let mut said = Vec::new();
        for (second, id, data) in [
            (0.0, 0x701, &[5][..]),
            (0.1, 0x701, &[5]),
            (0.2, 0x381, &[0, 0, 0, 0, 0, 0, 4, 1]),
            (0.3, 0x381, &[9, 0, 0, 0, 0, 0, 4, 1]),
            // gap.setpoint_v = 60, taken; again, taken; and one that is refused.
            (0.4, 0x601, &[0x23, 0, 0x21, 16, 0, 0, 0x70, 0x42]),
            (0.5, 0x581, &[0x60, 0, 0x21, 16, 0, 0, 0, 0]),
            (0.4, 0x601, &[0x23, 0, 0x21, 16, 0, 0, 0x70, 0x42]),
            (0.5, 0x581, &[0x60, 0, 0x21, 16, 0, 0, 0, 0]),
            (0.6, 0x601, &[0x2B, 0x40, 0x60, 0, 0x0F, 0]),
            (0.7, 0x581, &[0x80, 0x40, 0x60, 0, 0x22, 0, 0, 8]),
            (0.8, 0, &[0x81, 1]),
        ] {
            let frame = Recorded { at_s: 100.0 + second, id, data: data.to_vec() };
            said.extend(reader.take(&frame).into_iter().map(|said| (said.node, said.what)));
        }
        let text: Vec<String> = said.iter().map(|(node, what)| format!("{node}: {what}")).collect();
        assert_eq!(text[..2], ["1: network: operational", "1: eroding"]);
        assert_eq!(text[2], "1: a host writes gap.setpoint_v = 60 V");
        assert!(text[3].starts_with("1: a host is refused to write Controlword: not in the present state"), "{text:?}");
        assert_eq!(text[4..], ["1: network command: reset node"]);
    }
}

//! socketcand: CAN over TCP in messages between angle brackets.
//!
//! The server greets with `< hi >`; the client opens a bus by any name and asks for raw mode, each answered with `< ok >`;
//! then frames pass: `< send 123 2 1 ff >` to the bus, `< frame 123 1700000000.000000 01FF >` from it. An identifier of
//! three digits has 11 bits, one of eight has 29. There are no requests for data in this protocol.

use crate::Frame;
use crate::client::{Outgoing, Protocol};
use crate::frame::identifier;
use embedded_can::{Frame as _, Id};
use std::fmt::Write;
use std::time::Duration;

/// The longest message: `send`, 29-bit identifier, length and 8 bytes, with room for more blanks than usual.
const LONGEST: usize = 128;
/// Bytes that may wait for the server's greeting.
const EARLY: usize = 1 << 14;
const OK: &[u8] = b"< ok >";
/// Time between the answer to `rawmode` and the first frame: clients read the answer without looking for its end, and a
/// frame glued to it would be taken for a wrong answer.
const SETTLE: Duration = Duration::from_millis(20);

/// How far the conversation has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Mode {
    #[default]
    NoBus,
    /// A bus is open; frames can be sent.
    Open,
    /// Frames come as well.
    Raw,
}

/// A conversation with a client of socketcand.
#[derive(Debug, Default)]
pub struct Socketcand {
    mode: Mode,
    /// The message so far, behind its opening bracket.
    message: Option<Vec<u8>>,
}

/// Takes a byte; the message that it ends, if it does.
fn whole(message: &mut Option<Vec<u8>>, byte: u8) -> Option<String> {
    match (byte, &mut *message) {
        (b'<', _) => *message = Some(Vec::new()),
        (b'>', _) => return message.take().map(|message| String::from_utf8_lossy(&message).into_owned()),
        (byte, Some(message)) if message.len() <= LONGEST => message.push(byte),
        _ => {}
    }
    None
}

impl Protocol for Socketcand {
    fn greeting(&self) -> &'static str {
        "< hi >"
    }

    fn receive(&mut self, bytes: &[u8], out: &mut Outgoing, frames: &mut Vec<Frame>) {
        for &byte in bytes {
            if let Some(message) = whole(&mut self.message, byte) {
                self.command(&message, out, frames);
            }
        }
    }

    fn frame(&mut self, frame: &Frame, now: Duration, out: &mut Outgoing) {
        if self.mode == Mode::Raw && !frame.is_remote_frame() {
            out.put(message(frame, now).as_bytes());
        }
    }

    fn hang_up(&mut self) {
        *self = Socketcand::default();
    }
}

impl Socketcand {
    fn command(&mut self, message: &str, out: &mut Outgoing, frames: &mut Vec<Frame>) {
        let words: Vec<&str> = message.split_ascii_whitespace().take(12).collect();
        match (self.mode, words.as_slice()) {
            _ if message.len() > LONGEST => out.put(b"< error message too long >"),
            (_, ["echo"]) => out.put(b"< echo >"),
            (Mode::NoBus, ["open", _]) => {
                self.mode = Mode::Open;
                out.put(OK);
            }
            (Mode::NoBus, _) => out.put(b"< error no bus is open >"),
            (_, ["rawmode"]) => {
                self.mode = Mode::Raw;
                out.put(OK);
                out.pause(SETTLE);
            }
            (_, ["bcmmode"]) => {
                self.mode = Mode::Open;
                out.put(OK);
            }
            (_, ["send", id, length, data @ ..]) => match frame(id, length, data) {
                Some(frame) => frames.push(frame),
                None => out.put(b"< error no such frame >"),
            },
            _ => out.put(b"< error unknown command >"),
        }
    }
}

/// The calling side: a program that joins a bus behind a server of socketcand.
#[derive(Debug)]
pub struct Caller {
    bus: String,
    /// Answers still missing before frames pass.
    steps: u8,
    message: Option<Vec<u8>>,
    /// What was to be sent before that.
    early: Vec<u8>,
}

impl Caller {
    /// Opens the bus of this name, as the server calls it.
    pub fn new(bus: &str) -> Caller {
        Caller { bus: bus.into(), steps: 3, message: None, early: Vec::new() }
    }

    fn answered(&mut self, message: &str, out: &mut Outgoing, frames: &mut Vec<Frame>) {
        let words: Vec<&str> = message.split_ascii_whitespace().take(12).collect();
        match (self.steps, words.as_slice()) {
            (3, ["hi"]) => out.put(format!("< open {} >", self.bus).as_bytes()),
            (2, ["ok"]) => out.put(b"< rawmode >"),
            (1, ["ok"]) => out.put(&std::mem::take(&mut self.early)),
            (0, ["frame", id, _time, data @ ..]) => {
                frames.extend(came(id, &data.concat()));
                return;
            }
            _ => return,
        }
        self.steps -= 1;
    }
}

impl Protocol for Caller {
    fn receive(&mut self, bytes: &[u8], out: &mut Outgoing, frames: &mut Vec<Frame>) {
        for &byte in bytes {
            if let Some(message) = whole(&mut self.message, byte) {
                self.answered(&message, out, frames);
            }
        }
    }

    fn frame(&mut self, frame: &Frame, _: Duration, out: &mut Outgoing) {
        // There are no requests for data in this protocol.
        if frame.is_remote_frame() {
            return;
        }
        let mut text = format!("< send {} {}", digits(frame.id()), frame.dlc());
        for byte in frame.data() {
            // A string takes everything.
            let _ = write!(text, " {byte:02X}");
        }
        text += " >";
        if self.steps == 0 {
            out.put(text.as_bytes());
        } else if self.early.len() < EARLY {
            self.early.extend_from_slice(text.as_bytes());
        }
    }

    fn hang_up(&mut self) {
        self.message = None;
    }
}

/// A frame from the words of `frame`: data without blanks.
fn came(id: &str, data: &str) -> Option<Frame> {
    let pairs: Option<Vec<&str>> = (0..data.len().div_ceil(2)).map(|at| data.get(2 * at..2 * at + 2)).collect();
    let pairs = pairs?;
    frame(id, &format!("{:x}", pairs.len()), &pairs)
}

fn digits(id: Id) -> String {
    match id {
        Id::Standard(id) => format!("{:03X}", id.as_raw()),
        Id::Extended(id) => format!("{:08X}", id.as_raw()),
    }
}

/// A frame from the words of `send`.
fn frame(id: &str, length: &str, data: &[&str]) -> Option<Frame> {
    let extended = match id.len() {
        1..=3 => false,
        8 => true,
        _ => return None,
    };
    let number = |word: &str| u32::from_str_radix(word, 16).ok().filter(|_| !word.starts_with('+'));
    let id = identifier(number(id)?, extended)?;
    let bytes: Option<Vec<u8>> = data.iter().map(|word| u8::try_from(number(word)?).ok()).collect();
    let bytes = bytes?;
    (number(length)? as usize == bytes.len()).then(|| Frame::new(id, &bytes)).flatten()
}

fn message(frame: &Frame, now: Duration) -> String {
    let id = digits(frame.id());
    let mut message = format!("< frame {id} {}.{:06} ", now.as_secs(), now.subsec_micros());
    for byte in frame.data() {
        // A string takes everything.
        let _ = write!(message, "{byte:02X}");
    }
    message + " >"
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_can::{ExtendedId, StandardId};
    use proptest::prelude::*;

    fn say(client: &mut Socketcand, text: &[u8]) -> (String, Vec<Frame>) {
        let (mut out, mut frames) = (Outgoing::default(), Vec::new());
        client.receive(text, &mut out, &mut frames);
        (String::from_utf8(out.bytes().to_vec()).unwrap(), frames)
    }

    fn raw() -> Socketcand {
        let mut client = Socketcand::default();
        assert_eq!(say(&mut client, b"< open can0 >< rawmode >").0, "< ok >< ok >");
        client
    }

    #[test]
    fn a_bus_is_opened_and_then_frames_pass() {
        let mut client = Socketcand::default();
        assert_eq!(client.greeting(), "< hi >");
        let frame = Frame::new(StandardId::new(0x181).unwrap(), &[1, 0xFF]).unwrap();
        let mut out = Outgoing::default();
        assert_eq!(say(&mut client, b"< send 123 0 >").0, "< error no bus is open >");
        assert_eq!(say(&mut client, b"< open can0 >").0, "< ok >");
        client.frame(&frame, Duration::ZERO, &mut out);
        assert_eq!(out.bytes(), b"", "no frames before raw mode");
        assert_eq!(say(&mut client, b"< rawmode >").0, "< ok >");
        client.frame(&frame, Duration::new(12, 34_000), &mut out);
        assert_eq!(out.bytes(), b"< frame 181 12.000034 01FF >");
    }

    #[test]
    fn a_frame_without_data_and_one_with_a_long_identifier() {
        let mut out = Outgoing::default();
        let mut client = raw();
        client.frame(&Frame::new(ExtendedId::new(0x81).unwrap(), &[]).unwrap(), Duration::ZERO, &mut out);
        client.frame(&Frame::new_remote(StandardId::MAX, 8).unwrap(), Duration::ZERO, &mut out);
        assert_eq!(out.bytes(), b"< frame 00000081 0.000000  >", "and no request for data");
    }

    #[test]
    fn frames_are_sent_without_an_answer() {
        let standard = StandardId::new(0x601).unwrap();
        for (text, frame) in [
            (&b"< send 601 8 40 0 10 0 0 0 0 0 >"[..], Frame::new(standard, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]).unwrap()),
            (b"< send 601 0  >", Frame::new(standard, &[]).unwrap()),
            (b"<send 601 1 FF>", Frame::new(standard, &[255]).unwrap()),
            (b"< send 00000601 1 1 >", Frame::new(ExtendedId::new(0x601).unwrap(), &[1]).unwrap()),
        ] {
            assert_eq!(say(&mut raw(), text), (String::new(), vec![frame]));
        }
    }

    #[test]
    fn what_is_no_frame_or_no_command_is_an_error_and_sends_nothing() {
        for text in [
            "< send 800 0 >",
            "< send 601 1 >",
            "< send 601 0 1 >",
            "< send 601 9 1 2 3 4 5 6 7 8 9 >",
            "< send 601 1 100 >",
            "< send 601 1 +1 >",
            "< send +1 1 1 >",
            "< send 0601 1 1 >",
            "< send 20000000 1 1 >",
            "< send g 1 1 >",
            "< send >",
            "< >",
            "< subscribe 0 0 123 >",
            "< send 601 F 1 2 3 4 5 6 7 8 9 a b c d e f >",
        ] {
            let (answer, frames) = say(&mut raw(), text.as_bytes());
            assert!(answer.starts_with("< error ") && frames.is_empty(), "{text}: {answer}");
        }
    }

    #[test]
    fn a_message_without_an_end_takes_no_memory() {
        let mut client = raw();
        assert_eq!(say(&mut client, &[b'<'; 1000]).0, "");
        assert_eq!(say(&mut client, &[b'x'; 1_000_000]).0, "");
        assert!(client.message.as_ref().unwrap().capacity() <= 2 * LONGEST);
        assert_eq!(say(&mut client, b">< echo >").0, "< error message too long >< echo >");
    }

    #[test]
    fn both_sides_understand_each_other_and_nothing_sent_early_is_lost() {
        let (mut caller, mut server) = (Caller::new("can0"), Socketcand::default());
        let frames = [
            Frame::new(StandardId::new(0x601).unwrap(), &[0x40, 0, 0x10, 0, 0, 0, 0, 0xFF]).unwrap(),
            Frame::new(ExtendedId::new(0x81).unwrap(), &[]).unwrap(),
        ];
        let mut out = Outgoing::default();
        caller.frame(&frames[0], Duration::ZERO, &mut out);
        assert_eq!(out.bytes(), b"", "the server has not greeted");
        let (mut said, mut sent) = (server.greeting().to_owned(), Vec::new());
        while !said.is_empty() {
            let mut out = Outgoing::default();
            caller.receive(said.as_bytes(), &mut out, &mut Vec::new());
            let (answer, came) = say(&mut server, out.bytes());
            sent.extend(came);
            said = answer;
        }
        let mut out = Outgoing::default();
        caller.frame(&frames[1], Duration::ZERO, &mut out);
        sent.extend(say(&mut server, out.bytes()).1);
        assert_eq!(sent, frames);
        let (mut back, mut came) = (Outgoing::default(), Vec::new());
        frames.iter().for_each(|frame| server.frame(frame, Duration::new(1, 2000), &mut back));
        caller.receive(back.bytes(), &mut Outgoing::default(), &mut came);
        assert_eq!(came, frames);
    }

    #[test]
    fn a_server_that_sends_nonsense_is_no_frame() {
        for text in
            ["< frame 181 1.0 0 >", "< frame 181 1.0 xx >", "< frame 181 >", "< frame 181 1.0 112233445566778899 >"]
        {
            let mut caller = Caller { steps: 0, ..Caller::new("can0") };
            let mut frames = Vec::new();
            caller.receive(text.as_bytes(), &mut Outgoing::default(), &mut frames);
            assert_eq!(frames, [], "{text}");
        }
    }

    proptest! {
        #[test]
        fn whatever_a_client_says_an_answer_is_well_formed(text in proptest::collection::vec(prop_oneof![any::<u8>(), Just(b'<'), Just(b'>'), Just(b' ')], 0..300)) {
            let (answer, frames) = say(&mut raw(), &text);
            prop_assert!(frames.len() <= text.iter().filter(|byte| **byte == b'>').count());
            prop_assert_eq!(answer.matches('<').count(), answer.matches('>').count());
        }
    }
}

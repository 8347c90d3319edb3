//! slcan: CAN over a serial line, as Lawicel's adapters, CANable and `slcand` speak it.
//!
//! A command is a letter, its arguments in hex, and a carriage return. The answer is a carriage return for yes, BEL (7) for
//! no; a frame to be sent is answered with `z` or, with a 29-bit identifier, `Z`.
//!
//! | command | means |
//! | --- | --- |
//! | `O`, `L`, `C` | open, open to listen only, close; never refused, and what waits unread is dropped |
//! | `S0` to `S9`, `sxxyy` | bit rate: taken, and without effect on a bus that has none |
//! | `tiiildd..`, `Tiiiiiiiildd..` | a frame with an 11-bit or a 29-bit identifier, length, data; the same from the bus |
//! | `riiil`, `Riiiiiiiil` | the same as a request for data |
//! | `V`, `N`, `F`, `Z0` | version, serial number, status flags, no time stamps |

use crate::Frame;
use crate::client::{Outgoing, Protocol};
use crate::frame::identifier;
use embedded_can::{Frame as _, Id};
use std::time::Duration;

/// The longest command: `T`, identifier, length, 8 bytes.
const LONGEST: usize = 1 + 8 + 1 + 16;
const YES: &[u8] = b"\r";
const NO_ANSWER: u8 = 7;
const NO: &[u8] = &[NO_ANSWER];

/// Whether frames pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Channel {
    #[default]
    Closed,
    Listening,
    Open,
}

/// A conversation in slcan.
#[derive(Debug, Default)]
pub struct Slcan {
    channel: Channel,
    line: Vec<u8>,
}

impl Protocol for Slcan {
    fn receive(&mut self, bytes: &[u8], out: &mut Outgoing, frames: &mut Vec<Frame>) {
        for &byte in bytes {
            match byte {
                b'\r' => {
                    let line = std::mem::take(&mut self.line);
                    self.command(&line, out, frames);
                }
                // Some clients end a line with both.
                b'\n' if self.line.is_empty() => {}
                // One byte more than the longest command is enough to refuse it.
                byte if self.line.len() <= LONGEST => self.line.push(byte),
                _ => {}
            }
        }
    }

    fn frame(&mut self, frame: &Frame, _: Duration, out: &mut Outgoing) {
        if self.channel != Channel::Closed {
            out.put(line(frame).as_bytes());
        }
    }

    fn hang_up(&mut self) {
        *self = Slcan::default();
    }
}

impl Slcan {
    fn command(&mut self, line: &[u8], out: &mut Outgoing, frames: &mut Vec<Frame>) {
        match line {
            b"" | b"Z0" | [b'S', b'0'..=b'9'] => out.put(YES),
            [b's', register @ ..] if register.len() == 4 && hex(register).is_some() => out.put(YES),
            b"O" | b"L" | b"C" => {
                if self.channel != Channel::Closed {
                    // A serial port does not tell that one client has gone and another come, but the new one begins so. It
                    // does not want what the old one has left behind.
                    out.drop_waiting();
                }
                self.channel = match line {
                    b"O" => Channel::Open,
                    b"L" => Channel::Listening,
                    _ => Channel::Closed,
                };
                out.put(YES);
            }
            b"V" => out.put(b"V1010\r"),
            b"N" => out.put(b"N0000\r"),
            b"F" => out.put(b"F00\r"),
            _ => match frame(line) {
                Some(frame) if self.channel == Channel::Open => {
                    out.put(if frame.is_extended() { b"Z\r" } else { b"z\r" });
                    frames.push(frame);
                }
                _ => out.put(NO),
            },
        }
    }
}

/// The calling side: a program that joins a bus behind an adapter, or behind a server of [`Slcan`].
#[derive(Debug)]
pub struct Caller {
    greeting: &'static str,
    line: Vec<u8>,
}

impl Caller {
    /// Opens the channel at this bit rate, bit/s; `None` when no letter of slcan stands for it.
    pub fn new(bit_rate: u32) -> Option<Caller> {
        // The empty line ends what a caller before may have left; the adapter may be open still.
        let greeting = match bit_rate {
            1_000_000 => "\rC\rS8\rO\r",
            500_000 => "\rC\rS6\rO\r",
            250_000 => "\rC\rS5\rO\r",
            125_000 => "\rC\rS4\rO\r",
            _ => return None,
        };
        Some(Caller { greeting, line: Vec::new() })
    }
}

impl Protocol for Caller {
    fn greeting(&self) -> &'static str {
        self.greeting
    }

    fn receive(&mut self, bytes: &[u8], _: &mut Outgoing, frames: &mut Vec<Frame>) {
        for &byte in bytes {
            match byte {
                // Answers end alike, and are no frames.
                b'\r' | NO_ANSWER => frames.extend(frame(&std::mem::take(&mut self.line))),
                byte if self.line.len() <= LONGEST => self.line.push(byte),
                _ => {}
            }
        }
    }

    fn frame(&mut self, frame: &Frame, _: Duration, out: &mut Outgoing) {
        out.put(line(frame).as_bytes());
    }

    fn hang_up(&mut self) {
        self.line.clear();
    }
}

/// A frame from its line, without the carriage return.
fn frame(line: &[u8]) -> Option<Frame> {
    let (letter, rest) = line.split_first()?;
    let extended = letter.is_ascii_uppercase();
    let (id, rest) = rest.split_at_checked(if extended { 8 } else { 3 })?;
    let (length, data) = rest.split_first()?;
    let id = identifier(hex(id)?, extended)?;
    let length = usize::from(length.checked_sub(b'0').filter(|length| *length <= 8)?);
    match letter.to_ascii_lowercase() {
        b't' if data.len() == 2 * length => {
            let bytes: Option<Vec<u8>> = data.chunks_exact(2).map(|pair| hex(pair).map(|byte| byte as u8)).collect();
            Frame::new(id, &bytes?)
        }
        b'r' if data.is_empty() => Frame::new_remote(id, length),
        _ => None,
    }
}

/// Up to eight hexadecimal digits, and nothing else.
fn hex(digits: &[u8]) -> Option<u32> {
    digits.iter().try_fold(0u32, |value, digit| Some(value << 4 | char::from(*digit).to_digit(16)?))
}

fn line(frame: &Frame) -> String {
    let letter = match (frame.is_remote_frame(), frame.is_extended()) {
        (false, false) => 't',
        (false, true) => 'T',
        (true, false) => 'r',
        (true, true) => 'R',
    };
    let mut line = String::with_capacity(LONGEST + 1);
    line.push(letter);
    line += &match frame.id() {
        Id::Standard(id) => format!("{:03X}", id.as_raw()),
        Id::Extended(id) => format!("{:08X}", id.as_raw()),
    };
    line += &frame.dlc().to_string();
    for byte in frame.data() {
        line += &format!("{byte:02X}");
    }
    line.push('\r');
    line
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_can::{ExtendedId, StandardId};
    use proptest::prelude::*;

    /// What is answered, and what goes to the bus.
    fn say(slcan: &mut Slcan, text: &[u8]) -> (Vec<u8>, Vec<Frame>) {
        let (mut out, mut frames) = (Outgoing::default(), Vec::new());
        slcan.receive(text, &mut out, &mut frames);
        (out.bytes().to_vec(), frames)
    }

    fn open() -> Slcan {
        let mut slcan = Slcan::default();
        assert_eq!(say(&mut slcan, b"O\r").0, YES);
        slcan
    }

    #[test]
    fn opening_closing_and_the_bit_rate_are_always_granted() {
        let mut slcan = Slcan::default();
        for command in ["C\r", "S6\r", "s031C\r", "\r", "O\r", "O\r", "L\r", "Z0\r", "C\r", "C\r"] {
            assert_eq!(say(&mut slcan, command.as_bytes()), (YES.to_vec(), vec![]), "{command:?}");
        }
        assert_eq!(say(&mut slcan, b"V\rN\rF\r").0, b"V1010\rN0000\rF00\r");
    }

    #[test]
    fn a_frame_is_sent_and_acknowledged_by_the_kind_of_its_identifier() {
        let mut slcan = open();
        let standard = StandardId::new(0x60A).unwrap();
        let extended = ExtendedId::new(0x1234_5678).unwrap();
        for (line, answer, frame) in [
            (&b"t60A2F00f\r"[..], b"z\r", Frame::new(standard, &[0xF0, 0x0F]).unwrap()),
            (b"t60A0\r", b"z\r", Frame::new(standard, &[]).unwrap()),
            (
                b"T1234567881122334455667788\r",
                b"Z\r",
                Frame::new(extended, &[0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88]).unwrap(),
            ),
            (b"r60A8\r", b"z\r", Frame::new_remote(standard, 8).unwrap()),
            (b"R123456780\r", b"Z\r", Frame::new_remote(extended, 0).unwrap()),
        ] {
            assert_eq!(say(&mut slcan, line), (answer.to_vec(), vec![frame]));
        }
    }

    #[test]
    fn a_frame_of_the_bus_reads_as_it_would_be_sent() {
        for line in ["t60A2F00F\r", "t7FF0\r", "T1FFFFFFF10A\r", "r0008\r", "R123456780\r"] {
            let (_, frames) = say(&mut open(), line.as_bytes());
            let mut out = Outgoing::default();
            let mut slcan = open();
            slcan.frame(&frames[0], Duration::ZERO, &mut out);
            assert_eq!(out.bytes(), line.as_bytes());
        }
    }

    #[test]
    fn a_closed_channel_neither_sends_nor_shows_frames_and_one_that_listens_does_not_send() {
        let frame = frame(b"t1230").unwrap();
        for (opened, shown) in [(&b"C\r"[..], false), (b"L\r", true)] {
            let mut slcan = open();
            say(&mut slcan, opened);
            assert_eq!(say(&mut slcan, b"t1230\r"), (NO.to_vec(), vec![]));
            let mut out = Outgoing::default();
            slcan.frame(&frame, Duration::ZERO, &mut out);
            assert_eq!(!out.bytes().is_empty(), shown);
        }
    }

    #[test]
    fn a_new_client_gets_nothing_that_the_old_one_has_not_read() {
        for begins in ["C\r", "O\r"] {
            let mut slcan = open();
            let (mut out, mut frames) = (Outgoing::default(), Vec::new());
            slcan.frame(&frame(b"t1230").unwrap(), Duration::ZERO, &mut out);
            slcan.receive(begins.as_bytes(), &mut out, &mut frames);
            assert_eq!(out.bytes(), YES);
        }
    }

    #[test]
    fn what_is_no_command_gets_bel_and_nothing_else() {
        for line in [
            &b"t8000\r"[..],
            b"t12\r",
            b"t123\r",
            b"t1239\r",
            b"t1231\r",
            b"t12310\r",
            b"t1231000\r",
            b"t12310g\r",
            b"t1231 1\r",
            b"t+120\r",
            b"T200000000\r",
            b"T1234567\r",
            b"r12300\r",
            b"r1239\r",
            b"q\r",
            b"S\r",
            b"S55\r",
            b"s12\r",
            b"s12g4\r",
            b"o\r",
            b"OO\r",
            b"Z1\r",
            b"d1230\r",
            b"\x00\r",
            b"\xFF\xFE\r",
            b"t\xFF230\r",
        ] {
            assert_eq!(say(&mut open(), line), (NO.to_vec(), vec![]), "{}", line.escape_ascii());
        }
    }

    #[test]
    fn a_line_may_come_in_pieces_and_many_at_once() {
        let mut slcan = open();
        assert_eq!(say(&mut slcan, b"t12"), (vec![], vec![]));
        let (answer, frames) = say(&mut slcan, b"30\rt1240\r\nt125");
        assert_eq!((answer, frames.len()), (b"z\rz\r".to_vec(), 2));
    }

    #[test]
    fn a_line_without_an_end_takes_no_memory_and_is_refused_once() {
        let mut slcan = open();
        assert_eq!(say(&mut slcan, &[b't'; 1_000_000]), (vec![], vec![]));
        assert!(slcan.line.capacity() < 100);
        assert_eq!(say(&mut slcan, b"\rt1230\r").0, b"\x07z\r");
    }

    #[test]
    fn both_sides_understand_each_other() {
        let (mut caller, mut server) = (Caller::new(1_000_000).unwrap(), Slcan::default());
        assert_eq!(say(&mut server, caller.greeting().as_bytes()).0, [YES; 4].concat());
        let frame = Frame::new(ExtendedId::new(0x1234567).unwrap(), &[1, 0xAB]).unwrap();
        let mut out = Outgoing::default();
        caller.frame(&frame, Duration::ZERO, &mut out);
        let (answer, sent) = say(&mut server, out.bytes());
        assert_eq!(sent, [frame]);
        let mut back = Outgoing::default();
        server.frame(&frame, Duration::ZERO, &mut back);
        let mut came = Vec::new();
        for byte in [&answer, NO, back.bytes()].concat() {
            caller.receive(&[byte], &mut Outgoing::default(), &mut came);
        }
        assert_eq!(came, [frame], "and no answer is taken for a frame");
        assert!(Caller::new(800_000).is_none());
    }

    #[test]
    fn an_adapter_that_never_ends_its_line_takes_no_memory() {
        let mut caller = Caller::new(500_000).unwrap();
        let mut frames = Vec::new();
        caller.receive(&[b't'; 100_000], &mut Outgoing::default(), &mut frames);
        assert!(caller.line.capacity() < 100 && frames.is_empty());
    }

    proptest! {
        #[test]
        fn whatever_a_client_says_every_line_has_one_answer(text in proptest::collection::vec(prop_oneof![any::<u8>(), Just(b'\r'), Just(b't'), Just(b'1')], 0..200)) {
            prop_assume!(!text.iter().any(|byte| b"CLO".contains(byte)));
            let (answer, frames) = say(&mut open(), &text);
            let answers = answer.iter().filter(|byte| matches!(byte, b'\r' | 7)).count();
            prop_assert_eq!(answers, text.iter().filter(|byte| **byte == b'\r').count());
            prop_assert!(frames.len() <= answers);
        }
    }
}

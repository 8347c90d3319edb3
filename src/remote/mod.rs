//! Commands and reports as CAN frames: the least by which a host can run a head.
//!
//! The identifiers are those of the pre-defined connection set (CiA 301 7.3.5), so that the head can share a bus with
//! CANopen nodes; `n` is the node's number.
//!
//! | identifier | direction | content |
//! | --- | --- | --- |
//! | 0x200 + n | to the head | command, 3 bytes of 0, argument: nm, signed, little-endian; the argument may be left out |
//! | 0x280 + n | from the head | answer: command, 0 when carried out, else why not |
//! | 0x180 + n | from the head | state, fault + 1 or 0, gap voltage in 0.1 V (i16), position in counts (i32) |
//! | 0x700 + n | from the head | heartbeat (CiA 301 7.2.8.3.2): 0 at start, then 5, operational |

use crate::head::{Command, Refused, Status};
use crate::units::Nanometres;

/// Identifier of commands, less the node.
pub const COMMAND: u16 = 0x200;
/// Identifier of answers, less the node.
pub const ANSWER: u16 = 0x280;
/// Identifier of reports, less the node.
pub const REPORT: u16 = 0x180;
/// Identifier of heartbeats, less the node.
pub const HEARTBEAT: u16 = 0x700;
/// Heartbeat content at start.
pub const BOOT_UP: u8 = 0;
/// Heartbeat content of a running node.
pub const OPERATIONAL: u8 = 5;

/// What a host asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Request {
    /// A command to the head.
    Command(Command),
    /// Store the settings, with the result of the guided check.
    Store,
}

/// The request in a frame; `None` for a number that is none.
pub fn request(data: &[u8]) -> Option<Request> {
    let argument = || data.get(4..8).and_then(|bytes| bytes.try_into().ok()).map(i32::from_le_bytes);
    let length = || argument().map(|nm| Nanometres(nm.into()));
    let command = match data.first()? {
        1 => Some(Command::Enable),
        2 => Some(Command::Disable),
        3 => length().map(Command::SetHome),
        4 => length().map(Command::MoveTo),
        5 => length().map(Command::MoveBy),
        6 => Some(Command::Start),
        7 => Some(Command::Hold),
        8 => Some(Command::Commission),
        9 => Some(Command::ResetFault),
        10 => return Some(Request::Store),
        _ => None,
    };
    command.map(Request::Command)
}

/// The heartbeat: with the first report and then with every tenth.
#[derive(Clone, Copy, Debug, Default)]
pub struct Heartbeat {
    started: bool,
    reports: u8,
}

impl Heartbeat {
    /// Content of the heartbeat that goes with this report, when one does.
    pub fn with_report(&mut self) -> Option<u8> {
        let due = self.reports == 0;
        self.reports = if self.reports >= 9 { 0 } else { self.reports.wrapping_add(1) };
        let content = if self.started { OPERATIONAL } else { BOOT_UP };
        self.started = true;
        due.then_some(content)
    }
}

/// The answer to a command, by the command's number.
pub fn answer(number: u8, result: Result<(), Refused>) -> [u8; 2] {
    let code = match result {
        Ok(()) => 0,
        Err(Refused::State(_)) => 1,
        Err(Refused::NotCommissioned) => 2,
        Err(Refused::NotHomed) => 3,
        Err(Refused::OutOfTravel { .. }) => 4,
        Err(Refused::NoLength) => 5,
        Err(Refused::QueueFull) => 6,
        Err(Refused::NoPath) => 7,
        Err(Refused::StillFaulty(_)) => 8,
        Err(Refused::Storing) => 9,
        Err(Refused::NotStored) => 10,
    };
    [number, code]
}

/// The answer to a number that is no command.
pub const fn unknown(number: u8) -> [u8; 2] {
    [number, 0xFF]
}

/// The report of a status. What does not fit saturates.
pub fn report(status: &Status) -> [u8; 8] {
    // A cast from a float saturates.
    let gap = ((status.gap.filtered.0 * 10.0) as i16).to_le_bytes();
    let position = status.position.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
    let [a, b, c, d] = position.to_le_bytes();
    let fault = status.fault.map_or(0, |fault| fault as u8 + 1);
    [status.state as u8, fault, gap[0], gap[1], a, b, c, d]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::head::{Fault, State};
    use crate::units::Volts;

    #[test]
    fn each_number_is_its_command() {
        let all = [
            Command::Enable,
            Command::Disable,
            Command::SetHome(Nanometres(-1_000_000)),
            Command::MoveTo(Nanometres(-1_000_000)),
            Command::MoveBy(Nanometres(-1_000_000)),
            Command::Start,
            Command::Hold,
            Command::Commission,
            Command::ResetFault,
        ];
        for (number, expected) in (1u8..).zip(all) {
            let mut data = [number, 0, 0, 0, 0, 0, 0, 0];
            data[4..].copy_from_slice(&(-1_000_000i32).to_le_bytes());
            assert_eq!(request(&data), Some(Request::Command(expected)));
        }
    }

    #[test]
    fn a_frame_that_is_no_command_gives_none() {
        for data in [&[][..], &[0], &[11], &[4], &[4, 0, 0, 0, 1, 2, 3], &[255; 8]] {
            assert_eq!(request(data), None, "{data:?}");
        }
        assert_eq!(request(&[1]), Some(Request::Command(Command::Enable)));
        assert_eq!(request(&[10]), Some(Request::Store));
    }

    #[test]
    fn the_first_heartbeat_says_boot_up_and_every_tenth_report_brings_another() {
        let mut heartbeat = Heartbeat::default();
        let sent: Vec<_> = (0..21).filter_map(|report| Some((report, heartbeat.with_report()?))).collect();
        assert_eq!(sent, [(0, BOOT_UP), (10, OPERATIONAL), (20, OPERATIONAL)]);
    }

    #[test]
    fn a_report_says_state_fault_voltage_and_position() {
        let mut status = Status { state: State::Eroding, position: -2, ..Status::default() };
        status.gap.filtered = Volts(60.0);
        assert_eq!(report(&status), [4, 0, 0x58, 0x02, 0xFE, 0xFF, 0xFF, 0xFF]);
        status.fault = Some(Fault::PersistentShort);
        status.gap.filtered = Volts(1e9);
        status.position = i64::MAX;
        assert_eq!(report(&status)[1..], [1, 0xFF, 0x7F, 0xFF, 0xFF, 0xFF, 0x7F]);
    }

    #[test]
    fn an_answer_repeats_the_number_and_says_why_not() {
        assert_eq!(answer(6, Ok(())), [6, 0]);
        assert_eq!(answer(6, Err(Refused::NoPath)), [6, 7]);
        assert_eq!(answer(4, Err(Refused::State(State::Fault))), [4, 1]);
    }
}

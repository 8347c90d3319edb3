//! States, faults, refusals and aborts in words, with advice.
//!
//! The numbers and their names are those of the core (`src/canopen/drive/codes.rs`, `src/head/fault.rs`) and of edm-describe;
//! the advice is here alone.

use edm_servo_head::canopen::drive::{FINDINGS, LOSSES, REASONS, REFUSALS, WAIT, error_code};
use edm_servo_head::head::{Contradiction, Fault, Finding};

/// A word for it, and what to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Words {
    /// What it is called.
    pub name: &'static str,
    /// What to do; empty when there is nothing.
    pub advice: &'static str,
}

/// A fault by its number in 2000h:2; `None` for 0 and for one that this program does not know.
pub fn fault(number: u8) -> Option<Fault> {
    Fault::ALL.get(usize::from(number.checked_sub(1)?)).copied()
}

/// What a fault is called, what the head has done, and what to do.
pub fn fault_line(number: u8) -> String {
    match fault(number) {
        _ if number == 0 => "none".into(),
        None => format!("fault {number}, unknown to this program: the head is newer"),
        Some(fault) => format!("{}: pulses off, {}; {}", fault.name(), fault.reaction().name(), remedy(fault)),
    }
}

/// What to do about a fault.
pub const fn remedy(fault: Fault) -> &'static str {
    match fault {
        Fault::PersistentShort => "remove a carbon bridge or a chip from the gap, flush, then reset",
        Fault::PersistentArc => "flush more, lengthen the off-time or raise gap.setpoint_v, clean the spot, then reset",
        Fault::GapSignalInvalid => "check the gap divider, its converter and the wires between them, then reset",
        Fault::OpenCircuitLow => {
            "the open gap reads less than gap.open_min_v: check that the generator is on, its voltage, and the gap leads at electrode and \
             work, or lower gap.open_min_v; then reset"
        }
        Fault::GapReversed => "swap the gap leads at electrode and work, or change gap.reversed, then reset",
        Fault::BurningUnclear => {
            "sparks burn above 0.55 of the open circuit, and the comparator cannot tell them from it: raise the open-circuit voltage of the \
             generator, check electrode and work, then reset"
        }
        Fault::GateMissing => "check that the generator is on, check the gate line, then reset",
        Fault::DielectricNotOk => "check level, flow and temperature of the dielectric, then reset",
        Fault::HostSilent => {
            "the program or the cable between it and the head was lost; check the position of the electrode, then reset"
        }
        Fault::LowerLimit => "end of travel: check stroke and depth, move up after the reset",
        Fault::UpperLimit => "end of travel: move down after the reset",
        Fault::BothLimits => "a wire of the limit switches is broken; move the head manually",
        Fault::FollowingError => "check whether something holds the head, and gains and mass; then reset",
        Fault::EncoderLost => {
            "check cable, scale and reading head of the encoder; the head tests the encoder again after the reset"
        }
        Fault::PolarityWrong => "motor or encoder has the wrong direction: run the guided check again",
        Fault::BusSag => "check the 48 V supply and its fuse, then reset",
        Fault::EmergencyStop => "remove the cause, release the emergency stop, then reset",
        Fault::OverCurrent => "check for a shorted coil or cable, then reset",
        Fault::BridgeFault => "check for a shorted coil or a hot bridge, then reset",
        Fault::PlanLate => "the firmware was too slow: report it with the log",
        Fault::Contact => "the electrode touched the work with pulses off: check for obstacles, then reset",
        Fault::LiveLost => "the live circuit switched off: check U501 and U502, restart the board",
        Fault::LiveStuck => "the live circuit does not switch off: do not use the head before it is repaired",
        Fault::ClockLost => "report it with the log, restart the board",
        Fault::ReflexLost => "check the gate line to PB7 and the gap current, then reset",
        Fault::UnpermittedPulses => "switch the generator off at its own switch: it does not obey the enable line",
        Fault::SelfTestFailed => "2009h:3 has the failed part of the self-test; program the board again",
        Fault::SupplyLow => "check the 3.3 V supply",
        Fault::SettingsDamaged => "memory was corrupted: restart the board; if it happens again, replace the board",
        Fault::StepsNotFollowed => {
            "2016h:5 says why; have the host step slower, or check its direction line, then reset"
        }
        Fault::DriveSignalLost => "check the wires of motor current and bus voltage",
    }
}

/// Why a command was refused, by its number in 2000h:4.
pub fn refusal(number: u8) -> Words {
    let name = match number {
        WAIT => "too many commands waiting",
        _ => {
            REFUSALS.iter().find(|(known, _)| *known == number).map_or("a reason unknown to this program", |row| row.1)
        }
    };
    let advice = match number {
        1 => "wait until the head is at rest, or stop it first",
        2 => "run the guided check (docs/bring-up.md, step 10)",
        3 => "home the head first",
        4 => "choose a target inside the stroke and the software limits",
        5 => "the head is already at the target",
        6 => "wait until a segment is done",
        7 => "set a target first",
        8 => "remove the cause, then reset the fault again",
        9 => "wait a second",
        11 => "enable once, so that the head can test the encoder",
        12 => "wait for the end of the path, or clear it",
        13 => "fit the sense supply and set contact.below_v, or give the surface position",
        14 => "wait until the head is at rest, then reset",
        15..=17 => "send a shorter or a consistent path segment",
        18 => "set feed.structure = path",
        19 => "lower jump.height_um, or start deeper",
        21 => "lower touch.first_mm_s",
        22 => "stop the steps for 10 ms first",
        WAIT => "send fewer commands at a time",
        _ => "",
    };
    Words { name, advice }
}

/// What the guided check has found, by its number in 2001h:4.
pub fn finding(number: u8) -> &'static str {
    FINDINGS.iter().find(|(known, _)| *known == number).map_or("a finding unknown to this program", |row| row.1)
}

/// What that means and what to do; `stroke` is what it measured, counts, `found` what contradicts a setting.
pub fn finding_advice(number: u8, stroke: i64, found: Contradiction) -> String {
    let finding = match number {
        2 => Finding::NotAtRest,
        3 => Finding::NoMotion,
        4 => Finding::MotorReversed,
        5 => Finding::EncoderReversed,
        6 => Finding::NotAtUpperStop,
        7 => Finding::GapReversed,
        8 => Finding::NoOpenCircuit,
        9 => Finding::Stroke(stroke),
        10 => Finding::TooWeak,
        11 => Finding::Mass(found),
        12 => Finding::Counterbalance(found),
        13 => Finding::OpenCircuit(found),
        _ => return String::new(),
    };
    finding.to_string()
}

/// Why the state changed, by its number in 2000h:3.
pub fn reason(number: u8) -> &'static str {
    match number {
        0 => "",
        _ => REASONS.iter().find(|(known, _)| *known == number).map_or("a reason unknown to this program", |row| row.1),
    }
}

/// An error code of an emergency (603Fh).
pub fn emergency(code: u16) -> String {
    if code == 0 {
        return "no error active".into();
    }
    let faults: Vec<String> = Fault::ALL
        .iter()
        .filter(|fault| error_code(**fault).0 == code)
        .map(|fault| format!("{}: {}; {}", fault.name(), fault.reaction().name(), remedy(*fault)))
        .collect();
    let node = edm_describe::errors().find(|(known, _)| *known == code).map(|(_, text)| text.to_owned());
    let loss = LOSSES.iter().find(|((known, _), _)| *known == code).map(|(_, text)| (*text).to_owned());
    let all: Vec<String> = faults.into_iter().chain(node).chain(loss).collect();
    if all.is_empty() { format!("error {code:04X}h, unknown to this program") } else { all.join(", or ") }
}

/// Why an SDO was refused (CiA 301 7.2.4.3.17), and what to do.
pub fn abort(code: u32) -> String {
    let text = match code {
        0x0503_0000 => "segments out of order; try again",
        0x0504_0000 => "the transfer took too long; try again",
        0x0504_0001 => "the node does not know this command",
        0x0504_0002..=0x0504_0004 => "the block transfer was disturbed; try again",
        0x0504_0005 => "longer than the memory of the node",
        0x0601_0000 => "this access is not possible",
        0x0601_0001 => "write only",
        0x0601_0002 => "read only",
        0x0602_0000 | 0x0609_0011 => "the head has no such object: its firmware is older than the description file",
        0x0604_0041 => "the object cannot be mapped to this PDO",
        0x0604_0042 => "the mapped objects are longer than a PDO",
        0x0604_0043 => "it conflicts with another value",
        0x0606_0000 => "the hardware failed, for example the memory",
        0x0607_0010 | 0x0607_0012 | 0x0607_0013 => "wrong length for this object",
        0x0609_0030 => "value not allowed",
        0x0609_0031 => "the value is too high",
        0x0609_0032 => "the value is too low",
        0x0800_0000 => "the head refuses without a reason",
        0x0800_0020 => "the value cannot be stored",
        0x0800_0021 => "too many saves, which wear the memory: wait a minute; nothing was saved",
        0x0800_0022 => "not in the present state: stop or disable the head first",
        0x0800_0024 => "there is nothing to read",
        _ => return format!("abort {code:08X}h"),
    };
    format!("{text} (abort {code:08X}h)")
}

/// State of the network management in a heartbeat (CiA 301 7.2.8.3.2).
pub fn network(state: u8) -> &'static str {
    match state & 0x7F {
        0 => "booting",
        4 => "stopped",
        5 => "operational",
        127 => "pre-operational",
        _ => "unknown",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_servo_head::canopen::Abort;

    #[test]
    fn every_fault_and_refusal_has_words_and_something_to_do() {
        for (number, fault) in (1..).zip(Fault::ALL) {
            let line = fault_line(number);
            assert!(line.starts_with(fault.name()) && line.ends_with(remedy(*fault)), "{line}");
            assert!(emergency(error_code(*fault).0).contains(fault.name()));
        }
        assert!(fault_line(200).contains("newer"));
        for number in REFUSALS.iter().map(|row| row.0).chain([WAIT]) {
            assert!(!refusal(number).advice.is_empty(), "{number}");
        }
        for (number, text) in FINDINGS {
            assert!(
                finding(*number) == *text && !finding_advice(*number, 11_000, Contradiction::default()).is_empty(),
                "{number}"
            );
        }
        let found = Contradiction { measured: 2200, least: 2050, most: 2350 };
        let advice = |number| finding_advice(number, 11_000, found);
        assert!(advice(9).contains("11000 counts") && advice(4).contains("motor.reversed"));
        assert!(advice(12).contains("axis.counterbalance_n measures 2.200, and may be set from 2.050 to 2.350"));
        for (code, text) in edm_describe::errors() {
            assert!(emergency(code).contains(text));
        }
    }

    #[test]
    fn every_abort_that_a_head_can_give_has_words() {
        use Abort::*;
        for abort_code in [
            Toggle,
            TimedOut,
            Command,
            BlockSize,
            SequenceNumber,
            Crc,
            OutOfMemory,
            Unsupported,
            WriteOnly,
            ReadOnly,
            NoObject,
            NotMappable,
            PdoLength,
            Incompatible,
            Hardware,
            Length,
            LengthTooHigh,
            LengthTooLow,
            NoSubIndex,
            InvalidValue,
            ValueTooHigh,
            ValueTooLow,
            General,
            NotStored,
            LocalControl,
            DeviceState,
            NoData,
        ] {
            assert!(!abort(abort_code.code()).starts_with("abort"), "{abort_code:?}");
        }
    }
}

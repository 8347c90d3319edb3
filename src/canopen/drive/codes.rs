//! Numbers for what the head says in words: error codes of faults, reasons, refusals, findings.

use crate::head::{Fault, Finding, Reason, Refused};
use crate::path;
use crate::stored::Outcome;

/// Bits of the error register (CiA 301 7.5.2.2).
mod register {
    pub const GENERIC: u8 = 1 << 0;
    pub const CURRENT: u8 = 1 << 1;
    pub const VOLTAGE: u8 = 1 << 2;
    pub const COMMUNICATION: u8 = 1 << 4;
    pub const PROFILE: u8 = 1 << 5;
    pub const MANUFACTURER: u8 = 1 << 7;
}

/// Error code (CiA 301 table 26, IEC 61800-7-201 table of error codes; FF00h on: the process) and the bits of the error
/// register.
pub const fn error_code(fault: Fault) -> (u16, u8) {
    use register::{COMMUNICATION, CURRENT, GENERIC, MANUFACTURER, PROFILE, VOLTAGE};
    let (code, bits) = match fault {
        Fault::PersistentShort => (0xFF01, MANUFACTURER),
        Fault::PersistentArc => (0xFF02, MANUFACTURER),
        Fault::GapSignalInvalid => (0xFF03, MANUFACTURER),
        Fault::GateMissing => (0xFF04, MANUFACTURER),
        Fault::DielectricNotOk => (0xFF05, MANUFACTURER),
        // Life guard or heartbeat.
        Fault::HostSilent => (0x8130, COMMUNICATION),
        // Reference limit.
        Fault::LowerLimit | Fault::UpperLimit => (0x8612, PROFILE),
        Fault::BothLimits => (0xFF06, MANUFACTURER),
        // Following error.
        Fault::FollowingError => (0x8611, PROFILE),
        // Incremental sensor 1.
        Fault::EncoderLost => (0x7305, PROFILE),
        // Motor error or commutation malfunction.
        Fault::PolarityWrong => (0x7122, PROFILE),
        // DC link under-voltage.
        Fault::BusSag => (0x3220, VOLTAGE),
        // External error.
        Fault::EmergencyStop => (0x9000, 0),
        // Continuous over-current, output side.
        Fault::OverCurrent => (0x2310, CURRENT),
        // Power section.
        Fault::BridgeFault => (0x5400, CURRENT),
        Fault::PlanLate => (0xFF07, MANUFACTURER),
        Fault::Contact => (0xFF08, MANUFACTURER),
        Fault::LiveLost => (0xFF09, MANUFACTURER),
        Fault::ClockLost => (0xFF0A, MANUFACTURER),
        Fault::LiveStuck => (0xFF0B, MANUFACTURER),
        Fault::ReflexLost => (0xFF0C, MANUFACTURER),
        Fault::UnpermittedPulses => (0xFF0D, MANUFACTURER),
        Fault::SettingsDamaged => (0xFF0E, MANUFACTURER),
        Fault::DriveSignalLost => (0xFF0F, MANUFACTURER),
        Fault::SelfTestFailed => (0xFF10, MANUFACTURER),
        Fault::OpenCircuitLow => (0xFF11, MANUFACTURER),
        Fault::GapReversed => (0xFF12, MANUFACTURER),
        Fault::StepsNotFollowed => (0xFF13, MANUFACTURER),
        Fault::BurningUnclear => (0xFF14, MANUFACTURER),
        // Supply, low voltage.
        Fault::SupplyLow => (0x5110, VOLTAGE),
    };
    (code, bits | GENERIC)
}

/// Loss of parameters, and parameter error (IEC 61800-7-201, table of error codes).
const LOSS: (u16, u8) = (0x6310, register::GENERIC | register::PROFILE);
const DEFAULTED: (u16, u8) = (0x6320, register::GENERIC | register::PROFILE);

/// Error code and bits of the error register for what was lost of what is stored. `defaulted`: single values.
pub const fn loss(outcome: Outcome, defaulted: bool) -> Option<(u16, u8)> {
    match outcome {
        Outcome::Older | Outcome::Damaged | Outcome::Unknown => Some(LOSS),
        Outcome::Nothing | Outcome::Newest if defaulted => Some(DEFAULTED),
        Outcome::Nothing | Outcome::Newest => None,
    }
}

/// Error codes of what was lost, bits of the error register, and what they mean.
#[cfg(not(target_os = "none"))]
pub const LOSSES: &[((u16, u8), &str)] = &[
    (
        LOSS,
        "an older image or the defaults are in force: the newest image is damaged, incomplete, or of an unknown version",
    ),
    (
        DEFAULTED,
        "defaults are in force instead of stored values that are missing, out of range, or in conflict with others",
    ),
];

/// 2000h:4: more orders than can wait.
pub const WAIT: u8 = 20;

/// 2000h:9, in addition to what [`Missed`](crate::motion::Missed) numbers.
pub const HOMING_REFUSED: u8 = 5;

macro_rules! numbered {
    ($(#[$doc:meta])* $function:ident($type:ty) $names:ident { $($pattern:pat => $number:literal $name:literal,)+ }) => {
        $(#[$doc])*
        pub const fn $function(value: $type) -> u8 {
            match value { $($pattern => $number,)+ }
        }

        /// What the numbers mean.
        #[cfg(not(target_os = "none"))]
        pub const $names: &[(u8, &str)] = &[$(($number, $name),)+];
    };
}

numbered! {
    /// 2000h:3.
    reason(Reason) REASONS {
        Reason::Enabled => 1 "enabled",
        Reason::Disabled => 2 "disabled",
        Reason::Started => 3 "started",
        Reason::Held => 4 "held",
        Reason::CommissioningStarted => 5 "commissioning started",
        Reason::CommissioningEnded => 6 "commissioning ended",
        Reason::WorkFound => 7 "work found",
        Reason::Short => 8 "short",
        Reason::GapRecovered => 9 "gap recovered",
        Reason::PathEnd => 10 "end of the path",
        Reason::Fault(_) => 11 "fault",
        Reason::FaultReset => 12 "fault reset",
        Reason::Positioned => 13 "move begun",
        Reason::Arrived => 14 "target reached",
        Reason::HomingStarted => 15 "homing started",
        Reason::Homed => 16 "homed",
        Reason::NotHomed => 17 "no reference found",
        Reason::ProofStarted => 18 "encoder test started",
        Reason::Touched => 19 "requested contact",
        Reason::Jumped => 20 "jump begun",
        Reason::Returned => 21 "back from a jump",
        Reason::SparkedOut => 22 "end of the path, discharges are rare",
        Reason::SparkOutTime => 23 "end of the path, spark-out time over",
        Reason::BrokenThrough => 24 "broken through",
        Reason::Lifted => 25 "lifted out of the work",
        Reason::NotTouched => 26 "no surface found",
        Reason::PathStop => 27 "a stop on the path",
        Reason::JumpedLow => 28 "jump begun, lower than jump.height_um: no room above",
        Reason::StrokeEnd => 29 "end of the stroke: the coarse axis is asked for",
        Reason::Carried => 30 "carried on by the coarse axis",
        Reason::CarryRefused => 31 "the host refused to move the coarse axis",
        Reason::IdentificationStarted => 32 "identification started",
        Reason::Identified => 33 "identified",
        Reason::TuningStarted => 34 "tuning started",
        Reason::Tuned => 35 "response measured",
    }
}

numbered! {
    /// 2000h:4.
    refused(Refused) REFUSALS {
        Refused::State(_) => 1 "not in this state",
        Refused::NotCommissioned => 2 "commissioning has not passed",
        Refused::NotHomed => 3 "not homed",
        Refused::OutOfTravel { .. } => 4 "outside the travel",
        Refused::Path(path::Refused::NoLength) => 5 "the move has no length",
        Refused::Path(path::Refused::QueueFull) => 6 "queue full",
        Refused::NoPath => 7 "nothing queued",
        Refused::StillFaulty(_) => 8 "the cause of a fault is still there",
        Refused::Storing => 9 "settings are being stored",
        // 10 has been "settings could not be stored" and means nothing else.
        Refused::Doubted(_) => 11 "after a fault of the encoder the head has to be enabled first",
        Refused::PathActive => 12 "a path is active or queued",
        Refused::NoSense => 13 "no sense supply is fitted",
        Refused::Reacting(_) => 14 "the reaction to a fault still moves the head",
        Refused::Path(path::Refused::TooFar { .. }) => 15 "farther than 1073 mm from where the path begins",
        Refused::Path(path::Refused::Radius { .. }) => 16 "a radius outside 0.01 to 536 mm",
        Refused::Path(path::Refused::Inconsistent { .. }) => 17 "start and end of an arc have different distances from its centre",
        Refused::Alone => 18 "other axes move only with feed.structure = path",
        Refused::NoRoom { .. } => 19 "a jump, an identification or a tuning higher than the room above",
        // 20 is `WAIT`.
        Refused::StepsCome => 22 "steps come already",
        Refused::TooFast { .. } => 21 "a touch faster than contact.approach_mm_s",
    }
}

numbered! {
    /// 2001h:4.
    finding(Finding) FINDINGS {
        Finding::NotAtRest => 2 "not at rest",
        Finding::NoMotion => 3 "no motion",
        Finding::MotorReversed => 4 "motor reversed",
        Finding::EncoderReversed => 5 "encoder reversed",
        Finding::NotAtUpperStop => 6 "not at the upper stop",
        Finding::GapReversed => 7 "gap leads swapped",
        Finding::NoOpenCircuit => 8 "no open-circuit voltage",
        Finding::Stroke(_) => 9 "stroke differs from the setting",
        Finding::TooWeak => 10 "commission.duty_limit is hardly more than friction",
        Finding::Mass(_) => 11 "mass differs from the setting",
        Finding::Counterbalance(_) => 12 "counterbalance differs from the setting",
        Finding::OpenCircuit(_) => 13 "open-circuit voltage differs from the setting",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_has_a_code_and_the_generic_bit() {
        for fault in Fault::ALL {
            let (code, bits) = error_code(*fault);
            assert!(code != 0 && bits & 1 == 1, "{}", fault.name());
        }
    }
}

//! Every object of the drive that is not a setting, one declaration each.
//!
//! Positions are encoder counts, positive toward the work; velocities counts/s, accelerations counts/s^2. `*` in the access
//! column of docs/objects.md marks what 1010h stores.

use super::Row;

macro_rules! objects {
    ($($index:literal $object:literal {
        $($sub:literal $item:ident: $kind:ident, $access:ident, $mapping:ident, $range:expr, $default:expr, $unit:literal, $store:ident, $name:literal;)+
    })+) => {
        /// What an object is.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u16)]
        pub enum Item {
            $($(#[doc = $name] $item,)+)+
        }

        /// The rows, by rising index and sub-index.
        pub(super) const TABLE: &[Row] = &[$($(
            Row::new($index, $sub, Item::$item, kind!($kind), access!($access), mapping!($mapping), &$range, $default, store!($store), ($object, $name, $unit)),
        )+)+];
    };
}

macro_rules! kind {
    (u8) => {
        crate::canopen::DataType::Unsigned8
    };
    (u16) => {
        crate::canopen::DataType::Unsigned16
    };
    (u32) => {
        crate::canopen::DataType::Unsigned32
    };
    (i8) => {
        crate::canopen::DataType::Integer8
    };
    (i16) => {
        crate::canopen::DataType::Integer16
    };
    (i32) => {
        crate::canopen::DataType::Integer32
    };
    (text) => {
        crate::canopen::DataType::VisibleString
    };
    (domain) => {
        crate::canopen::DataType::Domain
    };
}

macro_rules! access {
    (ro) => {
        crate::canopen::Access::ReadOnly
    };
    (rw) => {
        crate::canopen::Access::ReadWrite
    };
    (wo) => {
        crate::canopen::Access::WriteOnly
    };
}

macro_rules! mapping {
    (no) => {
        crate::canopen::Mapping::No
    };
    (rx) => {
        crate::canopen::Mapping::Receive
    };
    (tx) => {
        crate::canopen::Mapping::Transmit
    };
    (both) => {
        crate::canopen::Mapping::Both
    };
}

macro_rules! store {
    (store) => {
        true
    };
    (live) => {
        false
    };
}

/// The whole range of 32 bits with a sign.
const I32: (i64, i64) = (i32::MIN as i64, i32::MAX as i64);
/// The whole range of 32 bits.
const U32: (i64, i64) = (0, u32::MAX as i64);
/// The whole range of 16 bits.
const U16: (i64, i64) = (0, u16::MAX as i64);
/// The whole range of a byte.
const U8: (i64, i64) = (0, u8::MAX as i64);
const I8: (i64, i64) = (i8::MIN as i64, i8::MAX as i64);
const I16: (i64, i64) = (i16::MIN as i64, i16::MAX as i64);
/// Number of a signal of the scope, or none.
const SIGNAL: (i64, i64) = (0, crate::scope::Signal::LAST as i64);
/// A ramp or a velocity of nothing would never end.
const RATE: (i64, i64) = (1, i32::MAX as i64);

objects! {
    0x2000 "Head" {
        1 HeadState: u8, ro, tx, U8, 0, "", live, "State: 0 disabled, 1 commissioning, 2 ready, 3 seeking, 4 eroding, 5 retreating, 6 done, 7 holding position, 8 fault, 9 positioning, 10 homing, 11 guiding, 12 proving, 13 jumping, 14 lifting, 15 touching, 16 inching, 17 identifying";
        2 HeadFault: u8, ro, tx, U8, 0, "", live, "Fault: from 1 in the order of docs/objects.md; 0 none";
        3 HeadReason: u8, ro, tx, U8, 0, "", live, "Reason: why the state changed last, as numbered in docs/objects.md; 0 no change yet";
        4 HeadRefusal: u8, ro, tx, U8, 0, "", live, "Refusal: why the last command was refused, as numbered in docs/objects.md; 0 none was";
        5 HeadHomed: u8, ro, tx, (0, 1), 0, "", live, "Homed: absolute positions are valid";
        6 HeadFirst: u8, ro, tx, U8, 0, "", live, "First fault: the fault that started the reaction; differs from 2000h:2 when a second fault has escalated it";
        7 Refusals: u8, ro, tx, U8, 0, "", live, "Refusals: commands refused, modulo 256, since power-on; TPDO 1 reports each at once";
        8 Guidance: u8, ro, tx, (0, 4), 0, "", live, "Guidance: state of a guided motion: 0 not guided, 1 follows the host, 2 at rest at the host's set point, 3 retreats from a short or returns, 4 has braked because the next set point is late";
        9 HomingError: u8, ro, tx, (0, 5), 0, "", live, "Homing error: why the last homing failed: 1 no reference within 1.2 times the stroke, 2 the axis would be outside the travel, 3 the axis met an obstacle, 4 electrode and work touched, 5 refused for the reason in 2000h:4; 0 no failure";
        10 ServoTime: u32, ro, tx, U32, 0, "ns", live, "Servo time: of the newest status; wraps; the time stamps of the touch probes are of the same clock";
    }
    0x2001 "EDM control" {
        1 ErodeEnable: u8, rw, rx, (0, 2), 0, "", live, "Erode: 1 set points are appended to the path, and the feed law moves along it; 2 set points are followed with pulses on, and the host uses the feed of 2004h:7 or 8; 0 pulses off";
        2 ErodeHold: u8, wo, rx, (0, 1), 0, "", live, "Hold: 1 switches pulses off and holds the position";
        3 Commission: u8, wo, no, (0, 1), 0, "", live, "Commissioning: 1 starts it, while disabled; 0 ends it without a result";
        4 CheckResult: u8, ro, no, U8, 0, "", live, "Commissioning result: 0 none yet, 1 passed, from 2 a finding as numbered in docs/objects.md";
        5 Touch: u8, rw, rx, (0, 1), 0, "", live, "Touch: 1 a move in profile position ends at the contact with the work, goes back by retreat.clearance_um, and has then reached its target; 0 a contact is a fault";
        6 Touched: i32, ro, tx, I32, 0, "counts", live, "Touched: position of the newest requested contact";
        7 Jump: u8, wo, rx, (0, 1), 0, "", live, "Jump: 1 moves an eroding head out of the hole by jump.height_um and back, with pulses off";
        8 HostFeed: u32, rw, rx, (0, 1_000_000), 0, "um/s", live, "Host's feed: that 1000 in 2004h:8 stand for; 0 feed.max_um_s";
    }
    0x2002 "Refused setting" {
        1 RefusedSetting: u32, ro, no, U32, 0, "", live, "Setting: index times 256 and sub-index of the setting that was refused";
        2 RefusedRule: text, ro, no, U8, 0, "", live, "Rule: that the setting must satisfy";
        3 RefusedMeasured: i32, ro, no, I32, 0, "", live, "Measured: value that the guided check measured where it contradicts the setting, in thousandths of the unit; else 0";
        4 RefusedLeast: i32, ro, no, I32, 0, "", live, "Least: value allowed after that, in thousandths of the unit";
        5 RefusedMost: i32, ro, no, I32, 0, "", live, "Most: value allowed after that, in thousandths of the unit";
    }
    0x2003 "Stop conditions" {
        1 StopTime: u32, rw, no, U32, 0, "ms", store, "Time limit: of an erosion; 0 unlimited";
        2 StopRetreats: u16, rw, no, U16, 0, "", store, "Retreat limit: most long retreats in an erosion; 0 unlimited";
        3 StoppedBy: u8, ro, tx, (0, 7), 0, "", live, "Stopped by: what ended the last erosion: 1 depth, 2 time, 3 long retreats, 4 break-through, 5 depth or stop and discharges that became rare, 6 depth or stop and the time of the spark-out, 7 a stop on the path; 0 something else";
    }
    0x2004 "Path queue" {
        1 QueueAppend: i32, wo, rx, I32, 0, "counts", live, "Append: a straight line to this position";
        2 QueueAppendBy: i32, wo, rx, I32, 0, "counts", live, "Append by: a straight line of this length";
        3 QueueClear: u8, wo, no, (0, 1), 0, "", live, "Clear: 1 clears the queue";
        4 QueueSpace: u16, ro, tx, U16, 0, "", live, "Space left: segments that still fit";
        5 QueueSegment: u32, ro, tx, U32, 0, "", live, "Segment: number of the current one, counted since power-on";
        6 PathCoordinate: i32, ro, tx, I32, 0, "um", live, "Path coordinate";
        7 PathFeed: i32, ro, tx, I32, 0, "um/s", live, "Signed feed: velocity along the path that the gap requests";
        8 AdaptiveFeed: i16, ro, tx, (-1000, 1000), 0, "per mille", live, "Adaptive feed: velocity along the path that the gap allows a host in guided motion, as a share of 2001h:8; negative is a retreat; never positive while the head itself moves";
    }
    0x2005 "Gap" {
        1 GapVoltage: i16, ro, tx, I16, 0, "0.01 V", live, "Voltage: after the filters";
        2 GapBlock: i16, ro, tx, I16, 0, "0.01 V", live, "Block voltage: before the filters";
        3 GapQuality: u8, ro, tx, (0, 5), 0, "", live, "Quality: 0 missing, 1 valid, 2 no gate, 3 saturated, 4 reversed, 5 unclear";
        4 GapShort: u16, ro, tx, U16, 0, "50 us", live, "Short: duration of the present short";
        5 GapSetpoint: i16, ro, tx, I16, 0, "0.01 V", live, "Setpoint: voltage to keep";
        6 GapOpen: i16, ro, tx, I16, 0, "0.01 V", live, "Open-circuit voltage: measured when the seek began";
    }
    0x2006 "Erosion counters" {
        1 Shorts: u32, ro, tx, U32, 0, "", live, "Shorts: retreats from a short since power-on";
        2 LongRetreats: u32, ro, tx, U32, 0, "", live, "Long retreats: more than 5 um, since power-on";
        3 ErodingTime: u32, ro, tx, U32, 0, "ms", live, "Eroding time: of the current or last erosion";
        4 Deepest: i32, ro, tx, I32, 0, "counts", live, "Deepest position: of that erosion";
        5 Jumps: u32, ro, tx, U32, 0, "", live, "Jumps: since power-on";
        6 LateSetPoints: u32, ro, tx, U32, 0, "", live, "Late set points: for which a guided head has braked, since power-on";
    }
    0x2007 "Drive" {
        1 Duty: i16, ro, tx, (-10_000, 10_000), 0, "0.01 %", live, "Duty: positive toward the work";
        2 Current: i16, ro, tx, I16, 0, "mA", live, "Motor current";
        3 Saturated: u8, ro, tx, (0, 1), 0, "", live, "Saturated: the duty is at its limit";
        4 CurrentReduced: u8, ro, tx, (0, 1), 0, "", live, "Current reduced: the winding is hot";
    }
    0x2008 "Encoder health" {
        1 Illegal: u32, ro, tx, U32, 0, "", live, "Illegal transitions: since power-on";
        2 EmfDifference: i32, ro, tx, I32, 0, "counts/s", live, "Back-EMF difference: velocity from the back-EMF minus velocity from the encoder";
    }
    0x2009 "Build" {
        1 ResetCause: u32, ro, no, U32, 0, "", live, "Reset cause: as the chip reports it";
        2 BuildId: text, ro, no, U8, 0, "", live, "Build";
        3 SelfTest: u8, ro, no, U8, 0, "", live, "Self-test: what has failed at the start, by bits: 0 the image was never sealed, 1 the flash differs from the sealed image, 2 pins could not be locked, 3 the brown-out reset is not at level 3; 0 passed";
        4 LastEnd: u8, ro, no, (0, 5), 0, "", live, "Last end: how the previous run ended: 0 unknown or power loss, 1 panic, 2 hard fault, 3 an interrupt without a handler (failure of the crystal), 4 a task stopped, 5 the stack reached its guard";
    }
    0x200A "Task timers" {
        1 GapLast: u32, ro, no, U32, 0, "ns", live, "Gap task last";
        2 GapMost: u32, ro, no, U32, 0, "ns", live, "Gap task longest";
        3 GapLoad: u16, ro, no, (0, 10_000), 0, "0.01 %", live, "Gap task load";
        4 ServoLast: u32, ro, no, U32, 0, "ns", live, "Servo tick last";
        5 ServoMost: u32, ro, no, U32, 0, "ns", live, "Servo tick longest";
        6 ServoLoad: u16, ro, no, (0, 10_000), 0, "0.01 %", live, "Servo tick load";
        7 SupervisionLast: u32, ro, no, U32, 0, "ns", live, "Supervision last";
        8 SupervisionMost: u32, ro, no, U32, 0, "ns", live, "Supervision longest";
        9 SupervisionLoad: u16, ro, no, (0, 10_000), 0, "0.01 %", live, "Supervision load";
        10 ProtocolLast: u32, ro, no, U32, 0, "ns", live, "Protocol last";
        11 ProtocolMost: u32, ro, no, U32, 0, "ns", live, "Protocol longest";
        12 ProtocolLoad: u16, ro, no, (0, 10_000), 0, "0.01 %", live, "Protocol load";
        13 PlanLast: u32, ro, no, U32, 0, "ns", live, "Plan last";
        14 PlanMost: u32, ro, no, U32, 0, "ns", live, "Plan longest";
        15 PlanLoad: u16, ro, no, (0, 10_000), 0, "0.01 %", live, "Plan load";
    }
    0x200B "Stored image" {
        1 StoredOutcome: u8, ro, tx, (0, 4), 0, "", live, "Outcome: of loading at the last reset: 0 nothing stored, 1 newest image in force, 2 older image in force because the newest is damaged or incomplete, 3 defaults because the image is damaged, 4 defaults because the image has an unknown version";
        2 StoredSkipped: u16, ro, no, U16, 0, "", live, "Skipped: values of objects that this program does not have";
        3 StoredSkippedFirst: u32, ro, no, U32, 0, "", live, "First skipped: index times 256 and sub-index; 0 none";
        4 StoredDefaulted: u16, ro, no, U16, 0, "", live, "Defaulted: values that were missing, out of range, or in conflict with others; their defaults are in force";
        5 StoredDefaultedFirst: u32, ro, no, U32, 0, "", live, "First defaulted: index times 256 and sub-index; 0 none";
    }
    0x200C "Configuration" {
        1 GenerationNewest: u32, ro, tx, U32, 0, "", live, "Newest: accepted changes of settings since power-on; differs from the ones below until the tasks run it";
        2 GenerationServo: u32, ro, tx, U32, 0, "", live, "Servo tick: generation that it runs";
        3 GenerationGap: u32, ro, tx, U32, 0, "", live, "Gap task: generation that it runs";
        4 GenerationSupervision: u32, ro, tx, U32, 0, "", live, "Supervision: generation that it runs";
        5 GuardedChange: u32, ro, tx, U32, 0, "", live, "Last guarded change: number of changes of guarded settings while the head is enabled, modulo 256, times 2^24, plus index times 256 plus sub-index of the last one; bit 14 of the statusword toggles with each";
    }
    0x200D "Lost" {
        1 LostFrames: u32, ro, tx, U32, 0, "", live, "Frames: received faster than they were processed, since power-on";
        2 LostEvents: u32, ro, tx, U32, 0, "", live, "Events: between tasks, faster than they were processed, since power-on";
        3 LostTicks: u32, ro, tx, U32, 0, "", live, "Servo ticks: missing by the clock while the head was enabled, since power-on";
        4 LostBlocks: u32, ro, tx, U32, 0, "", live, "Blocks of conversions: missing, or not processed in time, since power-on";
        5 UnseenHigh: u32, ro, tx, U32, 0, "", live, "High comparator: thousands of consecutive pulses for which it has shown no edge, since power-on";
        6 UnseenLow: u32, ro, tx, U32, 0, "", live, "Low comparator: the same";
        7 GateRings: u32, ro, tx, U32, 0, "", live, "Gate rings: blocks of 50 us in which the gate closed more than 7 times, since power-on; pulses have no pause until it rests";
    }
    0x200E "Path segment" {
        1 SegmentDown: i32, rw, rx, I32, 0, "nm", live, "Down: end along the head's axis";
        2 SegmentX: i32, rw, rx, I32, 0, "nm", live, "X: end along X";
        3 SegmentY: i32, rw, rx, I32, 0, "nm", live, "Y: end along Y";
        4 SegmentCentre1: i32, rw, rx, I32, 0, "nm", live, "Centre 1: of an arc, from its start, along the first axis of its plane";
        5 SegmentCentre2: i32, rw, rx, I32, 0, "nm", live, "Centre 2: the same along the second axis";
        6 SegmentShape: u8, rw, rx, (0, 6), 0, "", live, "Shape: 0 line; arcs: 1 in X-Y from X toward Y, 2 back; 3 in down-X from down toward X, 4 back; 5 in Y-down from Y toward down, 6 back; an end at the start in the plane makes a whole turn";
        7 SegmentOptions: u8, rw, rx, (0, 7), 0, "", live, "Options: by bits: 0 the end is relative to the end of the segment before, 1 no retreat passes its start, 2 an erosion ends at its end, and the next start continues there";
        8 SegmentCommit: u8, wo, rx, (0, 1), 0, "", live, "Commit: 1 appends the segment written since the last commit: sub-indices 1, 2, 3, 6 and 7, for an arc 4 and 5 as well; 0 discards it and clears the refusal";
        9 SegmentRefused: u8, ro, tx, U8, 0, "", live, "Refused: why a commit was refused; later ones are refused until 0 is written to 200Eh:8: as numbered in docs/objects.md for 2000h:4, 252 the path was restarted and the appended segments are gone, 253 the commit before has no answer yet, 254 not enabled, 255 incomplete or a value written twice; 0 none was refused";
        10 SegmentsAppended: u32, ro, tx, U32, 0, "", live, "Appended: segments since power-on";
        11 RetreatBound: u8, ro, tx, (0, 3), 0, "", live, "Retreat ended by: what ended a retreat since the erosion began: 1 the oldest segment in memory, 2 the set distance, 3 a mark; 0 nothing; kept after a fault";
        12 SetpointX: i32, ro, tx, I32, 0, "nm", live, "Set point X: for the drive of that axis";
        13 SetpointY: i32, ro, tx, I32, 0, "nm", live, "Set point Y: the same";
    }
    0x200F "Pulse classes" {
        1 PulsesOpen: u8, ro, tx, (0, 200), 0, "", live, "Open: share of all pulses of the last 176 to 200 ms that did not ignite, 0.5 %";
        2 PulsesSpark: u8, ro, tx, (0, 200), 0, "", live, "Spark: share of the pulses that were sparks, 0.5 %";
        3 PulsesArc: u8, ro, tx, (0, 200), 0, "", live, "Arc: share of the pulses that were arcs, 0.5 %";
        4 PulsesShort: u8, ro, tx, (0, 200), 0, "", live, "Short: share of the pulses that were shorts, 0.5 %";
        5 PulsesNone: u8, ro, tx, (0, 200), 0, "", live, "No pulse: share of the milliseconds without a pulse, 0.5 %";
        6 PulsesUncertain: u8, ro, tx, (0, 200), 0, "", live, "Uncertain: share of the pulses that could not be classified, 0.5 %";
    }
    0x2010 "Scope" {
        1 ScopeSignal1: u32, rw, no, U32, 0, "", live, "Signal 1: index times 256 and sub-index of an object of up to 32 bits; 0 none";
        2 ScopeSignal2: u32, rw, no, U32, 0, "", live, "Signal 2";
        3 ScopeSignal3: u32, rw, no, U32, 0, "", live, "Signal 3";
        4 ScopeSignal4: u32, rw, no, U32, 0, "", live, "Signal 4";
        5 ScopeDecimation: u16, rw, no, (1, 60_000), 1, "ms", live, "Decimation: time from one sample to the next";
        6 ScopeTrigger: u8, rw, no, (0, 3), 0, "", live, "Trigger: 0 at once, 1 signal 1 rises to the level, 2 falls to it, 3 first change of signal 1";
        7 ScopeLevel: i32, rw, no, I32, 0, "", live, "Trigger level";
        8 ScopeArm: u8, rw, no, (0, 1), 0, "", live, "Arm: 1 arms, 0 stops";
        9 ScopeState: u8, ro, tx, (0, 3), 0, "", live, "State: 0 idle, 1 waits for the trigger, 2 records, 3 full";
        10 ScopeCount: u16, ro, no, U16, 0, "", live, "Count: samples recorded";
        11 ScopeData: domain, ro, no, U8, 0, "", live, "Data: samples of signals 1 to 4, 32 bits each, little-endian";
    }
    0x2011 "Surface" {
        1 SearchStart: u8, wo, rx, (0, 1), 0, "", live, "Find: 1 starts a search: the head touches the work twice with pulses off and goes back by touch.back_um; 2001h:6 is the position found";
        2 SearchReach: i32, rw, rx, (0, i32::MAX as i64), 0, "counts", live, "Reach: largest distance of the search; 0 to the end of the travel";
        3 SearchOutcome: u8, ro, tx, (0, 5), 0, "", live, "Outcome: 0 not requested, 1 in progress, 2 found, 3 nothing within reach, 4 the gap still reads as a contact after going back, 5 aborted";
        4 SearchOvershoot: u32, ro, tx, U32, 0, "counts", live, "Overshoot: largest distance of the axis past the position found";
        5 SurfaceIs: u8, wo, no, (1, 4), 1, "", live, "What was touched: 1 the work: it has the position of sub-index 6; 2 the reference, by a new electrode; 3 the reference again: wear is measured; 4 the same, and positions refer to the worn face";
        6 SurfacePosition: i32, rw, no, (-1_000_000_000, 1_000_000_000), 0, "counts", live, "Position: assigned to the surface";
        7 DatumOffset: i32, ro, tx, I32, 0, "counts", live, "Datum: position of a host's zero from home, 6063h minus 6064h; 0 after homing and after a reset of the node";
        8 Wear: i32, ro, tx, I32, 0, "counts", live, "Wear: of the electrode since its first touch of the reference";
        9 Travel: i32, ro, tx, I32, 0, "counts", live, "Electrode travel: in the newest hole, from where the gap first reached its set point to the deepest position";
        10 HoleDepth: i32, ro, tx, I32, 0, "counts", live, "Hole depth: electrode travel minus the wear measured since the hole was begun";
        11 KeptSurface: i32, rw, no, I32, -2_147_483_648, "counts", live, "Kept surface: from which the hole under the electrode is measured, written by a host; -2147483648 none, as after homing, a lost home and a reset of the node";
    }
    0x2012 "Gap senses" {
        1 GapError: i16, ro, tx, I16, 0, "0.01 V", live, "Gap error: of gap.controlled, that the feed law acts on; positive in a wide gap";
        2 HazardRate: u32, ro, tx, U32, 0, "1/s", live, "Hazard: ignitions a second of waiting, of the pulses of the last gap.memory_ms; 0 not known";
        3 HazardDeviation: u16, ro, tx, U16, 0, "0.1 %", live, "Hazard, standard deviation: of the hazard; 0 not known";
        4 GapByCharging: u16, ro, tx, U16, 0, "0.01 um", live, "Distance: gap by charging time and gap.charging_c3 to c0; 0 not known";
        5 ChargingInside: u8, ro, tx, (0, 2), 0, "", live, "Distance, validity: 0 no pulse was seen to charge, 1 within what the polynomial holds for, 2 beyond it: the distance is the nearest end";
        6 SparkRate: u32, ro, tx, U32, 0, "1/s", live, "Spark frequency: at most 13 over the time since the newest spark; 0 none or not known";
        7 SparksMissing: u8, ro, tx, (0, 2), 0, "", live, "Sparks missing: 0 no, 1 none for longer than 13 of their mean periods, 2 no pulses";
        8 PulseAge: u16, ro, tx, U16, 0, "ms", live, "Pulse age: time since the newest pulse; 65535 longer, or none yet";
        9 MainsFrequency: u16, ro, tx, U16, 0, "0.01 Hz", live, "Notch frequency";
        10 MainsLocked: u8, ro, tx, (0, 1), 0, "", live, "Notch follows: 1 there is hum that it follows; 0 none, or gap.follow_mains is off";
        11 CountOpen: u32, ro, tx, U32, 0, "", live, "Open pulses: since power-on, modulo 2^32; the same for those below";
        12 CountSpark: u32, ro, tx, U32, 0, "", live, "Sparks";
        13 CountArc: u32, ro, tx, U32, 0, "", live, "Arcs";
        14 CountShort: u32, ro, tx, U32, 0, "", live, "Shorts";
        15 CountUncertain: u32, ro, tx, U32, 0, "", live, "Uncertain pulses";
        16 DelaysTake: u8, wo, no, (1, 1), 1, "", live, "Take: 1 copies the ignition delays since the last time to sub-index 17";
        17 DelaysTaken: domain, ro, no, U8, 0, "", live, "Ignition delays: 32 counts of 32 bits, little-endian; bin 0 up to 96 clock cycles of 168 MHz (0.57 us), then two bins an octave, ending at 128, 192, 256, 384, ...; the last without an end";
        18 Pauses: u32, ro, tx, U32, 0, "", live, "Pauses: of generator.pause_*, begun since power-on, modulo 2^31";
    }
    0x2013 "Teach-in" {
        1 TeachIn: u8, wo, no, (0, 2), 0, "", live, "Teach-in: 1 starts it, 0 ends it, 2 applies its proposal: gap.open_v, gap.spark_v, gap.arc_below_v, gap.short_v and gap.noise_v become sub-indices 10 to 14, all or none; 2002h says why not";
        2 TeachLeast: u16, rw, no, (0, 3600), 60, "s", live, "Least time: of the third step";
        3 TeachStep: u8, ro, tx, (0, 6), 0, "", live, "Step: 0 not started, 1 touch: waits for a contact with pulses off, 2 open circuit: waits for pulses across an open gap that begin to spark, 3 sparking, 4 levels are proposed, 5 applied, 6 ended without levels";
        4 TeachWhy: u8, ro, tx, (0, 5), 0, "", live, "Why not: 1 ended by the host, 2 no pulses are seen: the generator has no gate line, 3 too few pulses burned long enough to be measured, 4 no open-circuit voltage, 5 the proposal was refused; 0 nothing is wrong";
        5 TeachPulses: u32, ro, tx, U32, 0, "", live, "Pulses: that burned and were measured";
        6 TeachNeeded: u32, ro, no, U32, 10_000, "", live, "Pulses needed";
        7 TeachTime: u16, ro, tx, U16, 0, "s", live, "Time: of the third step, with pulses";
        8 TeachContact: u8, ro, no, (0, 4), 0, "", live, "Contact: 0 not yet, 1 no sense supply is fitted, 2 left out, 3 passed, 4 more than 1.5 V in contact: gap.zero_code is wrong";
        9 TeachContactVoltage: i16, ro, no, I16, 0, "0.01 V", live, "Contact voltage";
        10 TaughtOpen: u16, ro, no, U16, 0, "0.01 V", live, "Open circuit: proposed for gap.open_v; 0 none";
        11 TaughtSpark: u16, ro, no, U16, 0, "0.01 V", live, "Spark: proposed for gap.spark_v";
        12 TaughtArc: u16, ro, no, U16, 0, "0.01 V", live, "Arc boundary: proposed for gap.arc_below_v";
        13 TaughtShort: u16, ro, no, U16, 0, "0.01 V", live, "Short boundary: proposed for gap.short_v";
        14 TaughtNoise: u16, ro, no, U16, 0, "0.01 V", live, "Noise: proposed for gap.noise_v";
        15 TaughtApart: u16, ro, no, U16, 0, "", live, "Separation: distance of arcs and sparks in tenths of the standard deviation of what they burned at; 0 no arcs were seen, and 0.7 of a spark's voltage is assumed for them";
        16 LevelsFit: u8, ro, tx, (0, 5), 0, "", live, "Levels of the settings: 0 not known yet, 1 fit, 2 do not fit, 3 another divider of the gap voltage, 4 another supply of the generator, 5 burning cannot be told from the open circuit; pulses are told by what was learned";
        17 ArcsUndelayed: u8, ro, tx, U8, 255, "%", live, "Arcs: estimated share of the burning pulses that waited for less than gap.arc_delay_us; 255 not known";
        18 ArcsUndelayedError: u8, ro, tx, U8, 255, "%", live, "Arcs: standard error of that share";
    }
    0x2014 "Inch-worm" {
        1 InchState: u8, ro, tx, (0, 5), 0, "", live, "State: 0 the coarse axis is not needed, 1 the head touches the bottom or goes up, 2 asks the host to move the coarse axis to 2014h:3, 3 looks for the bottom or goes back to it, 4 late: no answer in inch.patience_s, or held, 5 contradiction: what the host said, or the bottom, is farther than inch.tolerance_um from what was asked";
        2 InchAsks: u8, ro, tx, (0, 1), 0, "", live, "Asks: 1 while the host is to move the coarse axis to 2014h:3; the same as bit 15 of the statusword";
        3 CarryTo: i32, ro, tx, I32, 0, "counts", live, "Carry to: distance from its place at the home, positive toward the work, to which the coarse axis is to carry the head";
        4 CoarsePlace: i32, rw, both, I32, 0, "counts", live, "Coarse axis: where it is by the scale of the host, from its place at the home; a host writes it as the answer, or while the head rests";
        5 CarryAnswer: u8, rw, rx, (0, 2), 0, "", live, "Answer: a change to 1 says that the coarse axis has moved to 2014h:3, a change to 2 that it has not and will not; 0 before the next answer";
        6 Carried: i32, ro, tx, I32, 0, "counts", live, "Carried: distance by which it has carried the head, as the head counts it";
        7 Inches: u32, ro, tx, U32, 0, "", live, "Moves: of the coarse axis after which the head went on, since power-on";
        8 InchError: i32, ro, tx, I32, 0, "counts", live, "Error: of the newest move that a touch of the bottom has measured, positive too far";
    }
    0x2016 "Step and direction" {
        1 StepCount: i32, ro, tx, I32, 0, "", live, "Steps: counted since power-on, those toward the work less the others; wraps";
        2 StepRate: i32, ro, tx, I32, 0, "1/s", live, "Rate: steps a second, of the last 10 ms";
        3 StepTurns: u32, ro, tx, U32, 0, "", live, "Turns within a step: changes of direction while a step was active, since power-on; the step counts as it began";
        4 StepsLost: u32, ro, tx, U32, 0, "", live, "Lost: times that the direction changed faster than is followed, 62 times in 250 us, since power-on";
        5 StepsUnfollowed: u8, ro, tx, (0, 4), 0, "", live, "Not followed: why the steps, which mode -1 was to follow or record, are not: 1 they came faster than the axis may go, 2 their direction was lost, 3 they turned while the path queue was full, 4 the path that they record leads out of the travel; 0 they are, or were not asked for";
        6 StepsTaken: u8, ro, tx, (0, 1), 0, "", live, "Ready: 1 the head follows or records steps and has room for more; the same as the output line";
    }
    0x2017 "Path place" {
        1 PathPlace: i32, rw, rx, I32, 0, "nm", live, "Place: set point of this axis from another head that leads a path, 200Eh:12 or 13 there, received in a PDO of that head; followed at SYNC in cyclic synchronous position, instead of 607Ah";
        2 PathOrigin: i32, rw, no, I32, 0, "nm", live, "Origin: position of this axis at which that set point is 0";
    }
    0x2018 "Identification" {
        1 Identify: u8, wo, no, (0, 2), 0, "", live, "Identification: 1 starts it, while the homed head holds its position: it moves up by identify.travel_um at the most, and back; 0 ends it and holds; 2, while disabled, makes the newest result settings of axis.*, all or none; 2002h says why not";
        2 IdentifyStep: u8, ro, tx, (0, 8), 0, "", live, "Step: 0 not started, 1 rises, 2 strokes with steps of voltage, 3 strokes for the motor constant, 4 strokes for mass and friction, 5 pushes from rest, 6 returns, 7 finished, 8 ended without a result";
        3 IdentifyWhy: u8, ro, tx, (0, 4), 0, "", live, "Why not: 1 ended by the host, 2 a fault, or disabled, 3 the motion does not show what it is to show, 4 the settings were refused; 0 nothing is wrong";
        4 FoundResistance: u32, ro, no, U32, 0, "mohm", live, "Resistance: of the winding, for axis.resistance_ohm; 0 none was found";
        5 FoundResistanceOff: u32, ro, no, U32, 0, "mohm", live, "Resistance uncertainty";
        6 FoundInductance: u32, ro, no, U32, 0, "uH", live, "Inductance: of the winding, for axis.inductance_mh";
        7 FoundInductanceOff: u32, ro, no, U32, 0, "uH", live, "Inductance uncertainty";
        8 FoundConstant: u32, ro, no, U32, 0, "mN/A", live, "Force constant: for axis.force_constant_n_a";
        9 FoundConstantOff: u32, ro, no, U32, 0, "mN/A", live, "Force constant uncertainty";
        10 FoundMass: u32, ro, no, U32, 0, "mg", live, "Mass: that moves, for axis.mass_kg";
        11 FoundMassOff: u32, ro, no, U32, 0, "mg", live, "Mass uncertainty";
        12 FoundBreakaway: u32, ro, no, U32, 0, "mN", live, "Breakaway: force beyond the net weight that begins to move the head, for axis.breakaway_n";
        13 FoundBreakawayOff: u32, ro, no, U32, 0, "mN", live, "Breakaway uncertainty";
        14 FoundSliding: u32, ro, no, U32, 0, "mN", live, "Sliding friction";
        15 FoundSlidingOff: u32, ro, no, U32, 0, "mN", live, "Sliding friction uncertainty";
        16 FoundCounterbalance: i32, ro, no, I32, 0, "mN", live, "Counterbalance: lifting force where the identification began, for axis.counterbalance_n";
        17 FoundCounterbalanceOff: u32, ro, no, U32, 0, "mN", live, "Counterbalance uncertainty";
    }
    0x2019 "Fast scope" {
        1 FastSignal1: u8, rw, no, SIGNAL, 0, "", live, "Signal 1: number as in docs/objects.md; 0 none";
        2 FastSignal2: u8, rw, no, SIGNAL, 0, "", live, "Signal 2: the same; none behind the first 0 is recorded";
        3 FastSignal3: u8, rw, no, SIGNAL, 0, "", live, "Signal 3";
        4 FastSignal4: u8, rw, no, SIGNAL, 0, "", live, "Signal 4";
        5 FastSignal5: u8, rw, no, SIGNAL, 0, "", live, "Signal 5";
        6 FastSignal6: u8, rw, no, SIGNAL, 0, "", live, "Signal 6";
        7 FastSignal7: u8, rw, no, SIGNAL, 0, "", live, "Signal 7";
        8 FastSignal8: u8, rw, no, SIGNAL, 0, "", live, "Signal 8";
        9 FastEvery: u16, rw, no, (1, 20_000), 1, "50 us", live, "Period: time from one sample to the next";
        10 FastTrigger: u8, rw, no, (0, 5), 0, "", live, "Trigger: 0 at once, 1 a signal rises to the level, 2 falls to it, 3 the state changes, 4 a fault, 5 a short retreats, by the reflex or by its duration";
        11 FastSource: u8, rw, no, (1, 8), 1, "", live, "Trigger signal: which of the signals is compared with the level";
        12 FastLevel: i32, rw, no, I32, 0, "", live, "Trigger level: counted in steps of that signal";
        13 FastBefore: u8, rw, no, (0, 100), 50, "%", live, "Before: share of the record from before the trigger";
        14 FastArm: u8, rw, no, (0, 1), 0, "", live, "Arm: 1 arms, 0 ends the record with what there is";
        15 FastState: u8, ro, tx, (0, 3), 0, "", live, "State: 0 nothing recorded, 1 waits for the trigger, 2 records, 3 complete; kept over a reset without loss of power";
        16 FastData: domain, ro, no, U8, 0, "", live, "Record: little-endian words of 32 bits: mark and version 43530001h; bytes: signals, cause (trigger plus 1, 0 stopped), fault, 0; numbers of signals 1 to 4, 5 to 8; period; samples; sample of the trigger from the oldest on; servo tick of the trigger; then the samples, the oldest first";
        17 Snapshots: u32, ro, tx, U32, 0, "", live, "Snapshots: number of the last one, which is taken at each fault; kept over a reset without loss of power";
        18 SnapshotData: domain, ro, no, U8, 0, "", live, "Last snapshot: 128 samples of eight signals, one every 2 ms, 75 % before the fault; in the form of sub-index 16";
    }
    0x201A "Kept hole" {
        1 KeptState: u8, ro, tx, (0, 3), 0, "", live, "State: 0 no hole is kept, 1 a hole from before a reset, a power cut or a new home waits to be gone on with, 2 the hole under way is kept, 3 the record of a hole is damaged";
        2 GoOn: u8, wo, no, (0, 3), 0, "", live, "Go on: with the hole that waits, after homing and a search of 2011h:1: 1 what was touched is its bottom, 2 the surface of the work beside it, 3 the reference; then 2011h:11 is its surface; 0 gives it up";
        3 GoOnRefused: u8, ro, tx, (0, 13), 0, "", live, "Refused: why the last attempt to go on was refused: 0 it was not, 1 no hole waits, 2 the record is damaged, 3 not homed, 4 homed by another method or offset, 5 other settings of the encoder, 6 the encoder was lost in the hole, 7 nothing was touched since homing, 8 the home is no index mark: the bottom alone does not place the hole, 9 touched above what is kept, 10 touched deeper than gap or wear explain, 11 no reference was touched before, 12 the head is not at rest, 13 the coarse axis (2014h:6) is not where it was";
        4 KeptDepth: i32, ro, tx, I32, 0, "counts", live, "Depth: deepest place of the electrode below the surface of the kept hole";
        5 KeptTarget: i32, ro, no, I32, 0, "counts", live, "Target: the newest one below that surface";
        6 KeptPath: i32, ro, no, I32, 0, "um", live, "Path coordinate: the newest in the hole";
        7 KeptRow: u16, rw, no, U16, 0, "", live, "Row: of a technology table, as the host numbers it; kept with the hole under way";
        8 KeptHome: i8, ro, no, I8, 0, "", live, "Homing method: by which its counts were found";
        9 KeptHeadState: u8, ro, no, U8, 0, "", live, "State of the head: the newest in the hole, as 2000h:1";
        10 WorkOn: u32, ro, no, U32, 0, "s", live, "Operating time: under power, over all power cuts";
        11 WorkEroding: u32, ro, no, U32, 0, "s", live, "Eroding time: of all erosions";
        12 WorkPulses: u32, ro, no, U32, 0, "1000", live, "Pulses: thousands";
        13 WorkArcs: u32, ro, no, U32, 0, "1000", live, "Arcs: thousands";
        14 WorkShorts: u32, ro, no, U32, 0, "1000", live, "Shorts: thousands";
        15 WorkHoles: u32, ro, no, U32, 0, "", live, "Holes: erosions that ended at their depth or broke through";
    }
    0x201B "Tuning" {
        1 Tune: u8, wo, no, (0, 1), 0, "", live, "Tuning: 1 measures the frequency response of the loop, while the homed head holds its position: it moves up by tune.travel_um at the most, and back; 0 ends it and holds; 2002h says why not";
        2 TuneStep: u8, ro, tx, (0, 5), 0, "", live, "Step: 0 not started, 1 rises, 2 measures, 3 returns, 4 finished, 5 ended without all points";
        3 TuneWhy: u8, ro, tx, (0, 3), 0, "", live, "Why not: 1 ended by the host, 2 a fault, or disabled, 3 a frequency does not show in the motion; 0 nothing is wrong";
        4 TunePoints: u8, ro, tx, (0, 32), 0, "", live, "Points: measured so far";
        5 TuneData: domain, ro, no, U8, 0, "", live, "Response: each point as eight little-endian REAL32: frequency, Hz; amplitude of the sine, duty; the loop opened at the duty, -C/U: real and imaginary part, deviation; velocity of the head to a duty of 1, mm/s: the same";
    }
    0x201C "Technology" {
        1 TechnologyRows: u8, ro, no, (0, 8), 0, "", live, "Rows: of the table that was written";
        2 TechnologyUse: u8, rw, no, (0, 1), 0, "", live, "Use: 1 has the table checked, a row a millisecond, and takes it into use: sub-index 6 leaves 1, and set points of profile position with 2001h:1 = 1 are then depths of holes that are made row after row; 0 takes it out of use, and rows may be written";
        3 TechnologyWhy: u8, ro, no, (0, 5), 0, "", live, "Refused: why it was not taken into use: 1 it has no row, 2 the row does not end deeper than the one before, 3 a setting that may not change at any time while the head is enabled, 4 a value out of the range of its setting, 5 settings that contradict each other; 2002h has setting and rule; 0 it was not refused";
        4 TechnologyWrongRow: u8, ro, no, (0, 8), 0, "", live, "Refused row: the first that is wrong";
        5 TechnologyRow: u8, rw, tx, (0, 8), 0, "", live, "Row: under way, or that the next set point begins with; a host may write it while no row is under way; 0 no table is in use";
        6 TechnologyState: u8, ro, tx, (0, 9), 0, "", live, "State: 0 no table is in use, 1 is checked, 2 waits for a set point, 3 the settings of the row come into force, pulses off, 4 waits for sub-index 19, pulses off, 5 erodes to the depth of the row, 6 every row is done, 7 interrupted by a hold, a halt, a stop or a fault: what starts the erosion again goes on with the row, 8 the generator did not answer within technology.answer_s, 9 the settings of the row contradict those changed since";
        7 RowBegin: u8, wo, no, (1, 8), 1, "", live, "Begin: a row of this number; those behind it are gone; the sub-indices below belong to it; only out of use";
        8 RowSetting: u32, rw, no, U32, 0, "", live, "Setting: index times 256 and sub-index of one that the row has, of those that may change at any time; 12 a row at the most";
        9 RowValue: u32, wo, no, U32, 0, "", live, "Value: of that setting, the bits as in its object; adds it to the row";
        10 RowLeaves: u32, rw, no, (0, 1_000_000_000), 0, "nm", live, "Leaves: height above the depth of the hole at which the row ends; less than that of the row before";
        11 RowOnTime: u32, rw, no, (0, 10_000_000), 0, "ns", live, "On-time: that the generator is to be set to; 0 not said; the same for the three below";
        12 RowOffTime: u32, rw, no, (0, 10_000_000), 0, "ns", live, "Off-time";
        13 RowCurrent: u32, rw, no, (0, 1_000_000), 0, "mA", live, "Current: of a discharge";
        14 RowPolarity: u8, rw, no, (0, 2), 0, "", live, "Polarity: of the electrode: 1 negative, 2 positive";
        15 PulseOnTime: u32, ro, tx, U32, 0, "ns", live, "Generator on-time: of the row of sub-index 5, for whatever sets the generator; 0 not said, or no table is in use";
        16 PulseOffTime: u32, ro, tx, U32, 0, "ns", live, "Generator off-time: the same";
        17 PulseCurrent: u32, ro, tx, U32, 0, "mA", live, "Generator current: the same";
        18 PulsePolarity: u8, ro, tx, (0, 2), 0, "", live, "Generator polarity: the same, 1 electrode negative, 2 positive";
        19 GeneratorAnswer: u8, rw, rx, (0, 8), 0, "", live, "Generator is set: for the row of this number; 0 when a row begins; waited for if technology.answer_s is not 0";
    }
    0x6007 "Abort connection option code" { 0 AbortOption: i16, rw, no, (0, 3), 1, "", store, "Abort connection option code: reaction to the loss of the host: 0 none, 1 fault, 2 disable voltage, 3 quick stop"; }
    0x603F "Error code" { 0 ErrorCode: u16, ro, tx, U16, 0, "", live, "Error code"; }
    0x6040 "Controlword" { 0 Controlword: u16, rw, rx, U16, 0, "", live, "Controlword"; }
    0x6041 "Statusword" { 0 Statusword: u16, ro, tx, U16, 0, "", live, "Statusword"; }
    0x605A "Quick stop option code" { 0 QuickStopOption: i16, rw, no, (0, 6), 6, "", store, "Quick stop option code"; }
    0x605B "Shutdown option code" { 0 ShutdownOption: i16, rw, no, (0, 1), 1, "", store, "Shutdown option code"; }
    0x605C "Disable operation option code" { 0 DisableOption: i16, rw, no, (0, 1), 1, "", store, "Disable operation option code"; }
    0x605D "Halt option code" { 0 HaltOption: i16, rw, no, (1, 2), 1, "", store, "Halt option code"; }
    0x605E "Fault reaction option code" { 0 FaultOption: i16, rw, no, (-1, -1), -1, "", live, "Fault reaction option code"; }
    0x6060 "Modes of operation" { 0 Mode: i8, rw, rx, (-1, 9), 0, "", live, "Modes of operation: -1 steps of a host, 0 none, 1 profile position, 3 profile velocity, 6 homing, 7 interpolated position, 8 cyclic synchronous position, 9 cyclic synchronous velocity"; }
    0x6061 "Modes of operation display" { 0 ModeDisplay: i8, ro, tx, (-1, 9), 0, "", live, "Modes of operation display: -1 steps of a host, 0 none, 1 profile position, 3 profile velocity, 6 homing, 7 interpolated position, 8 cyclic synchronous position, 9 cyclic synchronous velocity"; }
    0x6062 "Position demand value" { 0 PositionDemand: i32, ro, tx, I32, 0, "counts", live, "Position demand value"; }
    0x6063 "Position actual internal value" { 0 PositionInternal: i32, ro, tx, I32, 0, "counts", live, "Position actual internal value"; }
    0x6064 "Position actual value" { 0 PositionActual: i32, ro, tx, I32, 0, "counts", live, "Position actual value"; }
    0x6065 "Following error window" { 0 FollowingWindow: u32, rw, no, U32, 200, "counts", live, "Following error window"; }
    0x6066 "Following error time out" { 0 FollowingTime: u16, rw, no, U16, 10, "ms", live, "Following error time out"; }
    0x6067 "Position window" { 0 PositionWindow: u32, rw, no, U32, 2, "counts", store, "Position window"; }
    0x6068 "Position window time" { 0 PositionTime: u16, rw, no, U16, 5, "ms", store, "Position window time"; }
    0x606B "Velocity demand value" { 0 VelocityDemand: i32, ro, tx, I32, 0, "counts/s", live, "Velocity demand value"; }
    0x606C "Velocity actual value" { 0 VelocityActual: i32, ro, tx, I32, 0, "counts/s", live, "Velocity actual value: below 3000 counts/s calculated from the counts of the last 20 ms"; }
    0x606D "Velocity window" { 0 VelocityWindow: u16, rw, no, U16, 1000, "counts/s", store, "Velocity window"; }
    0x606E "Velocity window time" { 0 VelocityTime: u16, rw, no, U16, 5, "ms", store, "Velocity window time"; }
    0x606F "Velocity threshold" { 0 VelocityThreshold: u16, rw, no, U16, 1000, "counts/s", store, "Velocity threshold"; }
    0x6075 "Motor rated current" { 0 RatedCurrent: u32, ro, no, U32, 0, "mA", live, "Motor rated current: continuous"; }
    0x6077 "Torque actual value" { 0 TorqueActual: i16, ro, tx, I16, 0, "per mille", live, "Torque actual value: force of the motor, of that at 6075h; positive toward the work"; }
    0x6078 "Current actual value" { 0 CurrentActual: i16, ro, tx, I16, 0, "per mille", live, "Current actual value: of 6075h; positive toward the work"; }
    0x6079 "DC link circuit voltage" { 0 BusVoltage: u32, ro, tx, U32, 0, "mV", live, "DC link circuit voltage"; }
    0x607A "Target position" { 0 TargetPosition: i32, rw, rx, I32, 0, "counts", live, "Target position"; }
    0x607B "Position range limit" {
        1 RangeMin: i32, ro, no, I32, -2_147_483_648, "counts", live, "Min position range limit: positions do not wrap";
        2 RangeMax: i32, ro, no, I32, 2_147_483_647, "counts", live, "Max position range limit: the same";
    }
    0x607C "Home offset" { 0 HomeOffset: i32, rw, no, I32, 0, "counts", store, "Home offset: the position of the reference found is minus this"; }
    0x607D "Software position limit" {
        1 LimitMin: i32, rw, no, I32, -2_147_483_648, "counts", store, "Min position limit";
        2 LimitMax: i32, rw, no, I32, 2_147_483_647, "counts", store, "Max position limit";
    }
    0x607F "Max profile velocity" { 0 MaxVelocity: u32, ro, no, U32, 100_000, "counts/s", live, "Max profile velocity"; }
    0x6081 "Profile velocity" { 0 ProfileVelocity: u32, rw, rx, RATE, 10_000, "counts/s", store, "Profile velocity"; }
    0x6083 "Profile acceleration" { 0 ProfileAcceleration: u32, rw, rx, RATE, 1_000_000, "counts/s^2", store, "Profile acceleration"; }
    0x6084 "Profile deceleration" { 0 ProfileDeceleration: u32, rw, rx, RATE, 1_000_000, "counts/s^2", store, "Profile deceleration"; }
    0x6085 "Quick stop deceleration" { 0 QuickStopDeceleration: u32, rw, rx, RATE, 5_000_000, "counts/s^2", store, "Quick stop deceleration"; }
    0x6086 "Motion profile type" { 0 ProfileType: i16, rw, no, (0, 0), 0, "", live, "Motion profile type"; }
    0x608F "Position encoder resolution" {
        1 EncoderIncrements: u32, ro, no, U32, 1_000_000, "counts", live, "Encoder increments";
        2 EncoderRevolutions: u32, ro, no, U32, 1000, "mm", live, "Motor revolutions: a revolution is a millimetre";
    }
    0x6091 "Gear ratio" {
        1 GearMotor: u32, ro, no, U32, 1, "", live, "Motor revolutions";
        2 GearShaft: u32, ro, no, U32, 1, "", live, "Shaft revolutions";
    }
    0x6092 "Feed constant" {
        1 FeedCounts: u32, ro, no, U32, 1_000_000, "counts", live, "Feed";
        2 FeedRevolutions: u32, ro, no, U32, 1000, "mm", live, "Shaft revolutions";
    }
    0x6098 "Homing method" { 0 HomingMethod: i8, rw, no, (-1, 37), 35, "", store, "Homing method: -1 contact with the work, 1 and 2 index mark off the upper or the lower limit switch, 17 and 18 edge of these, 33 and 34 next index mark upward or downward, 35 and 37 present position"; }
    0x6099 "Homing speeds" {
        1 HomingFast: u32, rw, no, RATE, 5000, "counts/s", store, "Speed during search for switch";
        2 HomingSlow: u32, rw, no, RATE, 1000, "counts/s", store, "Speed during search for zero";
    }
    0x609A "Homing acceleration" { 0 HomingAcceleration: u32, rw, no, RATE, 1_000_000, "counts/s^2", store, "Homing acceleration"; }
    0x60B0 "Position offset" { 0 PositionOffset: i32, rw, rx, I32, 0, "counts", live, "Position offset: added to a set point of cyclic synchronous position"; }
    0x60B1 "Velocity offset" { 0 VelocityOffset: i32, rw, rx, I32, 0, "counts/s", live, "Velocity offset: of a set point of cyclic synchronous velocity"; }
    0x60B2 "Torque offset" { 0 TorqueOffset: i16, rw, rx, (-1000, 1000), 0, "per mille", live, "Torque offset: force of the motor in addition to that of the loops, of 6075h, while set points of a cyclic mode are followed; positive toward the work"; }
    0x60B8 "Touch probe function" { 0 ProbeFunction: u16, rw, rx, U16, 0, "", live, "Touch probe function: by bits, those of probe 2 eight higher: 0 on, 1 every edge instead of the first, 2 and 3 source (0 contact sense, 1 index mark, 2 as in 60D0h), 4 records where the source begins, 5 where it ends; a change rearms the probe"; }
    0x60B9 "Touch probe status" { 0 ProbeStatus: u16, ro, tx, U16, 0, "", live, "Touch probe status: by bits, those of probe 2 eight higher: 0 on, 1 a beginning is recorded, 2 an end is recorded, 6 and 7 toggle with each of them when every edge is recorded"; }
    0x60BA "Touch probe position 1 positive value" { 0 ProbeBegun1: i32, ro, tx, I32, 0, "counts", live, "Touch probe position 1 positive value: where its source began"; }
    0x60BB "Touch probe position 1 negative value" { 0 ProbeEnded1: i32, ro, tx, I32, 0, "counts", live, "Touch probe position 1 negative value: where its source ended"; }
    0x60BC "Touch probe position 2 positive value" { 0 ProbeBegun2: i32, ro, tx, I32, 0, "counts", live, "Touch probe position 2 positive value: where its source began"; }
    0x60BD "Touch probe position 2 negative value" { 0 ProbeEnded2: i32, ro, tx, I32, 0, "counts", live, "Touch probe position 2 negative value: where its source ended"; }
    0x60C1 "Interpolation data record" { 1 IpData: i32, rw, rx, I32, 0, "counts", live, "Set point"; }
    0x60C2 "Interpolation time period" {
        1 IpPeriod: u8, rw, no, (1, 255), 1, "", store, "Interpolation time units";
        2 IpExponent: i8, rw, no, (-4, 0), -3, "", store, "Interpolation time index: power of ten, s";
    }
    0x60C4 "Interpolation data configuration" {
        1 IpMost: u32, ro, no, U32, 32, "", live, "Maximum buffer size";
        2 IpSize: u32, rw, no, (32, 32), 32, "", live, "Actual buffer size";
        3 IpOrganisation: u8, rw, no, (0, 0), 0, "", live, "Buffer organisation: first in, first out";
        4 IpPosition: u16, ro, tx, U16, 0, "", live, "Buffer position: set points waiting";
        5 IpRecord: u8, rw, no, (4, 4), 4, "", live, "Size of data record";
        6 IpClear: u8, wo, no, (0, 1), 0, "", live, "Buffer clear: 0 discards all set points";
    }
    0x60C5 "Max acceleration" { 0 MaxAcceleration: u32, rw, no, RATE, 2_147_483_647, "counts/s^2", store, "Max acceleration: upper limit of 6083h and 609Ah"; }
    0x60C6 "Max deceleration" { 0 MaxDeceleration: u32, rw, no, RATE, 2_147_483_647, "counts/s^2", store, "Max deceleration: upper limit of 6084h; does not apply to a quick stop"; }
    0x60D0 "Touch probe source" {
        1 ProbeSource1: i16, rw, no, (-1, 5), 1, "", store, "Source of probe 1: if 60B8h selects it: 1 contact sense, 5 index mark, -1 discharge";
        2 ProbeSource2: i16, rw, no, (-1, 5), 5, "", store, "Source of probe 2: the same";
    }
    0x60D1 "Touch probe time stamp 1 positive value" { 0 ProbeTimeBegun1: u32, ro, tx, U32, 0, "ns", live, "Touch probe time stamp 1 positive value: when its source began: the servo tick, by the clock of 2000h:10"; }
    0x60D2 "Touch probe time stamp 1 negative value" { 0 ProbeTimeEnded1: u32, ro, tx, U32, 0, "ns", live, "Touch probe time stamp 1 negative value: when its source ended"; }
    0x60D3 "Touch probe time stamp 2 positive value" { 0 ProbeTimeBegun2: u32, ro, tx, U32, 0, "ns", live, "Touch probe time stamp 2 positive value: when its source began"; }
    0x60D4 "Touch probe time stamp 2 negative value" { 0 ProbeTimeEnded2: u32, ro, tx, U32, 0, "ns", live, "Touch probe time stamp 2 negative value: when its source ended"; }
    0x60D5 "Touch probe 1 positive edge counter" { 0 ProbeCountBegun1: u16, ro, tx, U16, 0, "", live, "Touch probe 1 positive edge counter: beginnings recorded since it was armed"; }
    0x60D6 "Touch probe 1 negative edge counter" { 0 ProbeCountEnded1: u16, ro, tx, U16, 0, "", live, "Touch probe 1 negative edge counter: ends recorded since it was armed"; }
    0x60D7 "Touch probe 2 positive edge counter" { 0 ProbeCountBegun2: u16, ro, tx, U16, 0, "", live, "Touch probe 2 positive edge counter: the same"; }
    0x60D8 "Touch probe 2 negative edge counter" { 0 ProbeCountEnded2: u16, ro, tx, U16, 0, "", live, "Touch probe 2 negative edge counter: the same"; }
    0x60E3 "Supported homing methods" {
        1 HomingMethod1: i8, ro, no, I8, -1, "", live, "Homing method 1: contact with the work";
        2 HomingMethod2: i8, ro, no, I8, 1, "", live, "Homing method 2: index mark below the upper limit switch";
        3 HomingMethod3: i8, ro, no, I8, 2, "", live, "Homing method 3: index mark above the lower limit switch";
        4 HomingMethod4: i8, ro, no, I8, 17, "", live, "Homing method 4: edge of the upper limit switch";
        5 HomingMethod5: i8, ro, no, I8, 18, "", live, "Homing method 5: edge of the lower limit switch";
        6 HomingMethod6: i8, ro, no, I8, 33, "", live, "Homing method 6: next index mark upward";
        7 HomingMethod7: i8, ro, no, I8, 34, "", live, "Homing method 7: next index mark downward";
        8 HomingMethod8: i8, ro, no, I8, 35, "", live, "Homing method 8: present position";
        9 HomingMethod9: i8, ro, no, I8, 37, "", live, "Homing method 9: the same";
    }
    0x60F2 "Positioning option code" { 0 PositioningOption: u16, rw, no, (0, 2), 0, "", store, "Positioning option code: reference of a relative set point of profile position: 0 the target before it, 1 the position demand value, 2 the position actual value"; }
    0x60F4 "Following error actual value" { 0 FollowingError: i32, ro, tx, I32, 0, "counts", live, "Following error actual value"; }
    0x60FC "Position demand internal value" { 0 DemandInternal: i32, ro, tx, I32, 0, "counts", live, "Position demand internal value"; }
    0x60FD "Digital inputs" { 0 DigitalInputs: u32, ro, tx, U32, 0, "", live, "Digital inputs: 0 upper limit, 1 lower limit; 16 emergency stop, 17 dielectric, 18 bridge fault, 19 supply low, 20 electrode and work touch, with pulses off"; }
    0x60FE "Digital outputs" {
        1 PhysicalOutputs: u32, ro, tx, U32, 0, "", live, "Physical outputs: 16 pulses are allowed, 17 the loop is closed, 18 the coarse axis is asked for, 19 steps are taken";
        2 OutputMask: u32, ro, no, U32, 0, "", live, "Bit mask: outputs that a host may set: none";
    }
    0x60FF "Target velocity" { 0 TargetVelocity: i32, rw, rx, I32, 0, "counts/s", live, "Target velocity"; }
    0x6502 "Supported drive modes" { 0 SupportedModes: u32, ro, no, U32, 0x101E5, "", live, "Supported drive modes: bit 16 is mode -1"; }
    0x67FE "Version number" { 0 ProfileVersion: u32, ro, no, U32, 0x0003_0000, "", live, "Version number: of the drive profile, by bytes from the second highest on: 3.0.0, that of IEC 61800-7-201:2007"; }
}

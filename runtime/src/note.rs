//! Messages of a head to its operator, in addition to the objects that a host reads: the log of the chip, or the console of a
//! PC.

use crate::board::Pulse;
use edm_servo_head::canopen::BootError;
use edm_servo_head::canopen::drive::Lost;
use edm_servo_head::head::{Change, Finding, Report, Status};
use edm_servo_head::stored::LoadReport;

/// Something worth a line.
#[expect(
    clippy::large_enum_variant,
    reason = "the status is noted once a second and passed by reference; nothing keeps one"
)]
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Note {
    /// The head has changed its state.
    Changed(Change),
    /// Commissioning has ended.
    Checked(Result<Report, Finding>),
    /// The watchdog did not take another time-out.
    WatchdogStuck,
    /// The thresholds of the reflex were refused; the old ones are in force.
    ThresholdsRefused,
    /// Something was lost: so much since power-up.
    Lost(Lost),
    /// Nothing was ever stored.
    NothingStored,
    /// What is stored cannot be read: the defaults run.
    StoreUnreadable,
    /// What became of what was stored.
    Loaded(LoadReport),
    /// The node could not boot with what it was to.
    BootRefused(BootError),
    /// Settings were stored.
    Stored,
    /// Settings could not be stored; the ones before are still there.
    NotStored,
    /// How the head is, once a second.
    Status(Status),
    /// What the reflex has seen, once a second.
    Pulses(Pulse),
}

impl Note {
    /// How a node has booted.
    pub fn booted(result: Result<LoadReport, BootError>) -> Note {
        match result {
            Ok(report) => Note::Loaded(report),
            Err(error) => Note::BootRefused(error),
        }
    }
}

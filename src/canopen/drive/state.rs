//! The state machine (IEC 61800-7-201, finite state automaton): what a controlword asks for, and what a statusword shows.

/// State of the drive. The value is its pattern in the statusword.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u16)]
pub enum State {
    /// Waits for shutdown.
    SwitchOnDisabled = 0x40,
    /// Ready to switch on.
    ReadyToSwitchOn = 0x21,
    /// Switched on; the head is disabled.
    SwitchedOn = 0x23,
    /// The loop is closed, the mode acts.
    OperationEnabled = 0x27,
    /// A quick stop brakes, or has braked and holds.
    QuickStopActive = 0x07,
    /// The head's reaction to a fault moves it.
    FaultReactionActive = 0x0F,
    /// The reaction is over.
    Fault = 0x08,
}

/// What the controlword asks for, apart from a fault reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Open the loop at once.
    DisableVoltage,
    /// Brake.
    QuickStop,
    /// To ready to switch on.
    Shutdown,
    /// To switched on: from below switch on, from above disable operation.
    SwitchOn,
    /// To operation enabled.
    EnableOperation,
}

/// Bits of the controlword.
pub mod control {
    /// New set-point; homing start; interpolation enable.
    pub const START: u16 = 1 << 4;
    /// Change set immediately.
    pub const IMMEDIATELY: u16 = 1 << 5;
    /// The set-point is relative.
    pub const RELATIVE: u16 = 1 << 6;
    /// Fault reset.
    pub const RESET: u16 = 1 << 7;
    /// Halt.
    pub const HALT: u16 = 1 << 8;
}

/// Bits of the statusword.
pub mod status {
    /// Voltage enabled.
    pub const VOLTAGE: u16 = 1 << 4;
    /// Warning.
    pub const WARNING: u16 = 1 << 7;
    /// Remote: the controlword is processed.
    pub const REMOTE: u16 = 1 << 9;
    /// Target reached.
    pub const REACHED: u16 = 1 << 10;
    /// Internal limit active.
    pub const LIMITED: u16 = 1 << 11;
    /// Of the mode: set-point acknowledge, speed zero, homing attained, interpolation active, drive follows.
    pub const MODE_12: u16 = 1 << 12;
    /// Of the mode: following error, homing error.
    pub const MODE_13: u16 = 1 << 13;
    /// The manufacturer's: turns over with each change of a guarded setting, which a TPDO reports at once.
    pub const GUARDED: u16 = 1 << 14;
    /// The manufacturer's: the host is asked to move the coarse axis.
    pub const ASKS: u16 = 1 << 15;
}

/// Whether a bit has risen.
pub fn rises(before: u16, now: u16, bit: u16) -> bool {
    now & !before & bit != 0
}

/// Whether the controlword halts.
pub fn halts(word: u16) -> bool {
    word & control::HALT != 0
}

impl Request {
    /// The request of a controlword (table of command coding).
    pub fn of(control: u16) -> Request {
        if control & 0x02 == 0 {
            Request::DisableVoltage
        } else if control & 0x04 == 0 {
            Request::QuickStop
        } else if control & 0x01 == 0 {
            Request::Shutdown
        } else if control & 0x08 == 0 {
            Request::SwitchOn
        } else {
            Request::EnableOperation
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_coded_as_in_the_standard() {
        for (control, request) in [
            (0x00, Request::DisableVoltage),
            (0x0D, Request::DisableVoltage),
            (0x02, Request::QuickStop),
            (0x0B, Request::QuickStop),
            (0x06, Request::Shutdown),
            (0x0E, Request::Shutdown),
            (0x07, Request::SwitchOn),
            (0x0F, Request::EnableOperation),
            (0x1F, Request::EnableOperation),
        ] {
            assert_eq!(Request::of(control), request, "{control:#x}");
        }
    }

    #[test]
    fn states_are_told_apart_by_the_masks_of_the_standard() {
        use State::*;
        for (state, mask, pattern) in [
            (SwitchOnDisabled, 0x4F, 0x40),
            (ReadyToSwitchOn, 0x6F, 0x21),
            (SwitchedOn, 0x6F, 0x23),
            (OperationEnabled, 0x6F, 0x27),
            (QuickStopActive, 0x6F, 0x07),
            (FaultReactionActive, 0x4F, 0x0F),
            (Fault, 0x4F, 0x08),
        ] {
            assert_eq!(state as u16 & mask, pattern);
        }
    }
}

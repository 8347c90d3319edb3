//! What a program may do to a head that another one moves; the table is in docs/desk.md, "Two programs".

use crate::Failure;
use crate::head::{Head, at, state};
use crate::sdo::Address;
use edm_servo_head::head::State;
use std::time::{Duration, Instant};

/// Longest stop of a motion that a program has just ended.
const STOPS: Duration = Duration::from_millis(500);
/// Polling period while a head stops.
const LOOK: Duration = Duration::from_millis(10);

/// What a command does to a head.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Deed {
    /// Reads values and records.
    Reads,
    /// Makes a head safer: STOP, pulses off, quick stop, disabling. Never refused.
    Stops,
    /// Changes what a head keeps.
    Sets,
    /// Moves a head, resets its fault, or gives it another program.
    Moves,
}

impl Deed {
    /// Deed of writing an object, least significant byte first.
    pub fn of_writing(address: Address, bytes: &[u8]) -> Deed {
        /// Controlword: what "operation enabled" needs; a set point; halt.
        const ENABLED: u8 = 0x0F;
        const SET_POINT: u8 = 0x10;
        const HALT: u8 = 1;
        let stops = match (address, bytes) {
            (at::CONTROLWORD, &[low, high, ..]) => low & ENABLED != ENABLED || high & HALT != 0 && low & SET_POINT == 0,
            (at::HOLD, &[what, ..]) => what != 0,
            (at::ERODE, &[what, ..]) => what == 0,
            _ => false,
        };
        if stops { Deed::Stops } else { Deed::Moves }
    }

    /// Whether a head in this state is left to the program that moves it.
    fn disturbs(self, now: u8) -> bool {
        match self {
            Deed::Reads | Deed::Stops => false,
            Deed::Sets => !matches!(now, state::DISABLED | state::FAULT | state::READY),
            Deed::Moves => !matches!(now, state::DISABLED | state::FAULT),
        }
    }
}

impl Head {
    /// Whether this program, which does not move the head, may do that to it. Nothing is changed.
    ///
    /// # Errors
    /// When another program moves the head, and it does not end within the time that a stop takes; those of the transfer.
    pub fn may(&self, deed: Deed) -> Result<(), Failure> {
        let begun = Instant::now();
        loop {
            // What disturbs nobody needs no answer.
            if deed <= Deed::Stops {
                return Ok(());
            }
            let now = self.whole(at::STATE)? as u8;
            if !deed.disturbs(now) {
                return Ok(());
            }
            if begun.elapsed() > STOPS {
                let name = State::ALL.get(usize::from(now)).map_or("enabled", |state| state.name());
                return Err(Failure::BadInput(format!(
                    "node {}: the head is {name}, for another program: let that end, or stop the head first (`edm-desk stop`)",
                    self.node
                )));
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Whether this program may move the head now: nobody else does, and no fault is active. Nothing is changed.
    ///
    /// # Errors
    /// Those of [`Head::may`]; the fault.
    pub fn free(&self) -> Result<(), Failure> {
        self.may(Deed::Moves)?;
        self.healthy().map_err(|fault| Failure::Failed(format!("fault active, reset it first: {fault}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_takes_a_head_out_of_operation_is_never_refused() {
        let control = |word: u16| Deed::of_writing(at::CONTROLWORD, &word.to_le_bytes());
        for (what, word) in
            [("disable voltage", 0), ("quick stop", 0x82), ("shutdown", 6), ("disable operation", 7), ("halt", 0x10F)]
        {
            assert_eq!(control(word), Deed::Stops, "{what}");
        }
        for (what, word) in [("enable operation", 0x0F), ("set point", 0x1F), ("halt and set point", 0x11F)] {
            assert_eq!(control(word), Deed::Moves, "{what}");
        }
        assert_eq!(Deed::of_writing(at::HOLD, &[1]), Deed::Stops);
        assert_eq!(Deed::of_writing(at::HOLD, &[0]), Deed::Moves);
        assert_eq!(Deed::of_writing(at::ERODE, &[1]), Deed::Moves);
        assert_eq!(Deed::of_writing(at::ERODE, &[0]), Deed::Stops);
        assert_eq!(Deed::of_writing(at::CONTROLWORD, &[]), Deed::Moves);
        for now in 0..State::ALL.len() as u8 {
            assert!(!Deed::Reads.disturbs(now) && !Deed::Stops.disturbs(now));
        }
        assert!(Deed::Sets.disturbs(state::ERODING) && Deed::Sets.disturbs(state::HOLDING));
        assert!(!Deed::Sets.disturbs(state::READY) && Deed::Moves.disturbs(state::READY));
        assert!(!Deed::Moves.disturbs(state::DISABLED) && !Deed::Moves.disturbs(state::FAULT));
    }
}

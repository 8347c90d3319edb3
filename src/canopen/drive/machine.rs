//! How controlword and head move the state machine.

use super::state::{Request, State, control, halts, rises, status};
use super::{Drive, Order, codes};
use crate::canopen::objects::Item;
use crate::head::{self, Command, Fault, Inch, Refused};

/// Longest braking that is waited for, and coasting after a reaction, ms.
const PATIENCE: u16 = 1000;
/// Shortest time that a fault's reaction shows, ms.
const REACTION: u16 = 20;

impl Drive {
    /// A controlword has come.
    pub(super) fn control_word(&mut self, word: u16) {
        let before = core::mem::replace(&mut self.control, word);
        if rises(before, word, control::RESET) {
            // Acknowledged, in any state: the next loading reports it again.
            self.loss = None;
        }
        if self.state == State::Fault && rises(before, word, control::RESET) {
            self.command(Command::ResetFault);
        }
        if matches!(self.state, State::Fault | State::FaultReactionActive) {
            return;
        }
        let request = Request::of(word);
        if word != before && matches!(request, Request::DisableVoltage | Request::QuickStop) {
            self.end_commissioning();
        }
        self.transition(request);
        self.mode_word(before, word);
    }

    fn transition(&mut self, request: Request) {
        use State::{OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
        match (self.state, request) {
            (SwitchOnDisabled, Request::Shutdown) => self.state = ReadyToSwitchOn,
            (ReadyToSwitchOn, Request::SwitchOn) => self.state = SwitchedOn,
            (ReadyToSwitchOn | SwitchedOn, Request::EnableOperation) => {
                self.state = SwitchedOn;
                if self.refuses_steps() {
                    self.refuses(codes::refused(Refused::StepsCome));
                } else if !self.enabling {
                    self.enabling = self.command(Command::Enable);
                }
            }
            (SwitchedOn, Request::Shutdown) => self.leave(ReadyToSwitchOn, 0),
            (ReadyToSwitchOn | SwitchedOn, Request::DisableVoltage | Request::QuickStop) => {
                self.leave(SwitchOnDisabled, 0);
            }
            (OperationEnabled, Request::Shutdown) => {
                self.leave(ReadyToSwitchOn, self.value(Item::ShutdownOption));
            }
            (OperationEnabled, Request::SwitchOn) => self.leave(SwitchedOn, self.value(Item::DisableOption)),
            (OperationEnabled | QuickStopActive, Request::DisableVoltage) => self.leave(SwitchOnDisabled, 0),
            (OperationEnabled, Request::QuickStop) => self.quick_stop(),
            // Transition 16, where the option code says that the quick stop stays.
            (QuickStopActive, Request::EnableOperation) if self.value(Item::QuickStopOption) >= 5 => {
                self.state = OperationEnabled;
                self.enter_mode();
            }
            // Back to the mode before the axis has stopped for another state.
            (OperationEnabled, Request::EnableOperation) => self.leaving = None,
            _ => {}
        }
    }

    fn quick_stop(&mut self) {
        let option = self.value(Item::QuickStopOption);
        self.state = State::QuickStopActive;
        self.elapsed = 0;
        match option {
            0 => self.leave(State::SwitchOnDisabled, 0),
            1 | 5 => self.brake(Item::ProfileDeceleration),
            _ => self.brake(Item::QuickStopDeceleration),
        }
        if matches!(option, 1 | 2) {
            self.leaving = Some(State::SwitchOnDisabled);
        }
    }

    /// Leaves operation: at once with option 0, else when the axis rests.
    fn leave(&mut self, to: State, option: i32) {
        self.set_points.forget();
        if option == 0 {
            if self.is_enabled() {
                self.command(Command::Disable);
            }
            self.enabling = false;
            self.state = to;
            self.leaving = None;
        } else {
            self.brake(Item::ProfileDeceleration);
            self.elapsed = 0;
            self.leaving = Some(to);
        }
    }

    /// Comes to rest on the ramp of an object.
    #[inline(never)]
    pub(super) fn brake(&mut self, deceleration: Item) {
        self.set_points.forget();
        self.follow = None;
        let deceleration = self.acceleration(deceleration);
        self.command(Command::Brake(deceleration));
    }

    /// A fault of the head becomes one of the drive, and goes with it.
    pub(super) fn watch_fault(&mut self) {
        if self.status.state == head::State::Fault {
            self.alarm = self.status.fault;
            match self.state {
                State::Fault => {}
                State::FaultReactionActive => {
                    self.elapsed = self.elapsed.saturating_add(1);
                    let stands = self.elapsed >= REACTION && self.standing() || self.elapsed >= PATIENCE;
                    // A dead encoder always stands; in the next state a host may reset.
                    if stands && !self.status.reacting {
                        self.state = State::Fault;
                    }
                }
                _ => {
                    self.state = State::FaultReactionActive;
                    self.elapsed = 0;
                    self.enabling = false;
                    self.leaving = None;
                    self.set_points.forget();
                    self.follow = None;
                    self.set(Item::ErodeEnable, 0);
                }
            }
        } else if matches!(self.state, State::Fault | State::FaultReactionActive) && self.fresh {
            self.alarm = None;
            self.state = State::SwitchOnDisabled;
        }
    }

    /// Follows the head, whose status is newer than every command.
    pub(super) fn follow_head(&mut self) {
        let closed = self.status.state.follows();
        // While the encoder proves itself nothing is decided yet.
        if self.enabling && self.status.state != head::State::Proving {
            self.enabling = false;
            if closed {
                self.state = State::OperationEnabled;
                self.enter_mode();
            }
        }
        if let Some(to) = self.leaving {
            self.elapsed = self.elapsed.saturating_add(1);
            if self.standing() || self.elapsed >= PATIENCE {
                self.leaving = None;
                self.command(Command::Disable);
                self.state = to;
            }
        } else if !closed && matches!(self.state, State::OperationEnabled | State::QuickStopActive) {
            self.state = State::SwitchOnDisabled;
        }
    }

    /// The statusword.
    pub(super) fn status_bits(&self) -> u16 {
        let mut word = self.state as u16 | status::REMOTE;
        if self.status.bus >= self.active.head.supervise.bus_min {
            word |= status::VOLTAGE;
        }
        if self.status.current_reduced || self.status.cramped || self.loss.is_some() || self.teach.does_not_fit() {
            word |= status::WARNING;
        }
        if matches!(self.status.inch, Inch::Late | Inch::Contradicts) {
            word |= status::WARNING;
        }
        if self.status.inch == Inch::Asks {
            word |= status::ASKS;
        }
        if self.guarded >> 24 & 1 != 0 {
            word |= status::GUARDED;
        }
        if self.status.saturated || self.status.approaching || self.set_points.limited {
            word |= status::LIMITED;
        }
        word | self.mode_bits()
    }

    /// Whether the loop is closed, or about to be.
    pub(super) fn is_enabled(&self) -> bool {
        self.enabling || matches!(self.state, State::OperationEnabled | State::QuickStopActive)
    }

    /// The host is gone (CiA 402-2, 6007h): it has left operational, stopped or reset the node, or a watch on it has ended.
    pub(super) fn host_lost(&mut self) {
        match self.value(Item::AbortOption) {
            0 => {}
            // It moves the head, with pulses at last, and no loop is closed that could do anything better than that.
            _ if self.is_commissioning() => self.end_commissioning(),
            // Nobody is there any more to see that the loop closes.
            _ if self.enabling => self.leave(State::SwitchOnDisabled, 0),
            2 if self.is_enabled() => self.leave(State::SwitchOnDisabled, 0),
            3 if self.state == State::OperationEnabled => self.quick_stop(),
            2 | 3 => {}
            _ if self.status.state.follows() => {
                self.order(Order::Raise(Fault::HostSilent));
            }
            _ => {}
        }
    }

    /// Whether the mode acts.
    pub(super) fn acts(&self) -> bool {
        self.state == State::OperationEnabled && self.leaving.is_none()
    }

    /// Whether the mode acts and is not halted.
    pub(super) fn moves(&self) -> bool {
        self.acts() && !halts(self.control)
    }

    /// The deceleration of halt.
    pub(super) fn halt(&mut self) {
        let ramp =
            if self.value(Item::HaltOption) == 2 { Item::QuickStopDeceleration } else { Item::ProfileDeceleration };
        self.brake(ramp);
    }

    /// Starts commissioning.
    pub(super) fn commission(&mut self) -> bool {
        let free = self.status.state == head::State::Disabled && !self.enabling;
        let ordered = free && self.command(Command::Commission);
        self.commissioning |= ordered;
        ordered
    }

    /// Ends commissioning, without a result, if it is under way.
    pub(super) fn end_commissioning(&mut self) {
        if self.is_commissioning() {
            self.command(Command::Disable);
        }
    }

    fn is_commissioning(&self) -> bool {
        let proves = self.status.state == head::State::Proving && !self.enabling;
        self.commissioning || proves || self.status.state == head::State::Commissioning
    }
}

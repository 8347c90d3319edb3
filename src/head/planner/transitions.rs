//! From one state to another, and where the path begins after it.

use super::{Planner, Touching};
use crate::head::positioning::HomingState;
use crate::head::state::{Change, Reason, State};
use crate::path::Path;
use crate::units::{Fixed, MicrometresPerSecond};
use core::ops::DerefMut;

impl<P: DerefMut<Target = Path>> Planner<P> {
    #[inline(never)]
    pub(super) fn enter(&mut self, state: State, reason: Reason) {
        self.changes.push(Change { tick: self.status.tick, from: self.status.state, to: state, reason });
        if !matches!(
            state,
            State::Positioning | State::Homing | State::Jumping | State::Inching | State::Touching | State::Identifying
        ) {
            self.end_positioning();
        }
        if !matches!(state, State::Guiding | State::Retreating) {
            self.guide = None;
        }
        if !matches!(state, State::Ready | State::Done) && !state.works() {
            self.recorder = None;
        }
        self.status.state = state;
        self.entered = self.status.tick;
        if state == State::Disabled {
            // Broken off, or at their end.
            (self.commissioning, self.proof) = (None, None);
        }
        self.status.feed = MicrometresPerSecond(match state {
            State::Seeking => self.config.seek.velocity.0,
            State::Retreating | State::Lifting => -self.config.retreat.velocity.0,
            _ => 0.0,
        });
        match state {
            // Out of the work, whatever bounds a working retreat.
            State::Lifting => self.route.free_retreat(),
            State::Fault => {}
            _ => self.route.set_retreat(self.config.retreat.limit),
        }
    }

    pub(super) fn reset_loop(&mut self) {
        self.resets = self.resets.wrapping_add(1);
    }

    /// Ends axis positioning: the path begins where the set point is.
    pub(super) fn end_positioning(&mut self) {
        (self.touching, self.status.approaching) = (Touching::No, false);
        self.break_off_search();
        self.stepper = None;
        let beside = self.positioning.take().is_some() | self.jump.take().is_some() | self.search.take().is_some();
        let beside = beside | self.end_carrying() | self.break_off_measurement();
        if beside || self.status.state == State::Guiding {
            if self.status.homing == HomingState::Runs {
                self.status.homing = HomingState::No;
            }
            let here = self.segment().from;
            self.restart_path_at(here);
        }
    }

    /// The path begins where the axis is; a retreat past the beginning leads straight up.
    pub(super) fn restart_path(&mut self) {
        self.restart_path_at(Fixed::whole(self.status.position));
    }

    /// The path begins at a set point.
    pub(super) fn restart_path_at(&mut self, here: Fixed) {
        let axis = &self.config.axis;
        let escape = Fixed::whole((axis.escape.0 * axis.counts_per_um) as i64);
        let top = if self.status.homed { axis.counts(self.travel().0) } else { here.minus(escape) };
        self.route.restart(here, top);
        self.good = Fixed(0);
        self.status.setpoint = here;
    }
}

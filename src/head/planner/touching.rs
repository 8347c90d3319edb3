//! The search for a surface: what may begin one, and how the planner continues it.

use super::Planner;
use crate::head::command::Refused;
use crate::head::reaction::Motion;
use crate::head::state::{Reason, State};
use crate::head::touch::{Bounds, Felt, Next, Search, Touching};
use crate::motion::{Profile, TrajectorySegment};
use crate::path::Path;
use crate::units::{Fixed, MicrometresPerSecond, Nanometres};
use core::ops::DerefMut;

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// Looks for a surface no farther away than `reach`; 0 is the whole travel.
    pub(super) fn find_surface(&mut self, state: State, reach: Nanometres) -> Result<(), Refused> {
        if !matches!(state, State::Ready | State::HoldingPosition | State::Done) {
            return Err(Refused::State(state));
        }
        // The rest of a hole would be lost: what is positioned ends the path. Done, there is none, wherever the lift has led.
        if state != State::Done && !self.route.at_end() {
            return Err(Refused::PathActive);
        }
        if !self.config.contact.sensed {
            return Err(Refused::NoSense);
        }
        let (touch, axis) = (self.config.touch, &self.config.axis);
        let approach = self.config.contact.approach;
        if touch.first.0 > approach.0 {
            let um = |velocity: f32| MicrometresPerSecond(velocity / axis.counts_per_um);
            return Err(Refused::TooFast { velocity: um(touch.first.0), most: um(approach.0) });
        }
        // A head without a home may look for as long as its travel, and go back as far.
        let (min, max) = self.travel();
        let (here, length) = (self.segment().from, axis.counts(Nanometres(max.0.saturating_sub(min.0))));
        let (top, bottom) = match self.status.homed {
            true => (axis.counts(min), axis.counts(max)),
            false => (here.minus(length), here.plus(length)),
        };
        let end = if reach.0 == 0 { bottom } else { here.plus(axis.counts(reach)) };
        if reach.0 < 0 || end > bottom || end <= here {
            let nm = |counts: Fixed| Nanometres(counts.round().saturating_mul(axis.nm_per_count));
            return Err(Refused::OutOfTravel { target: nm(end), min: nm(here), max: nm(bottom) });
        }
        let acceleration = self.counts2(self.config.acceleration);
        let bounds = Bounds { end: end.round(), top: top.round(), off_limit: axis.off_limit };
        self.search = Some(Touching::new(touch, acceleration, bounds));
        (self.status.search, self.status.overshoot) = (Search::Runs, 0);
        self.enter(State::Touching, Reason::Positioned);
        Ok(())
    }

    /// Something else comes between.
    pub(super) fn break_off_search(&mut self) {
        if self.status.search == Search::Runs {
            self.status.search = Search::BrokenOff;
        }
    }

    /// Goes on with a search.
    pub(super) fn touch_on(&mut self) -> Motion {
        let from = self.segment();
        let gone = Fixed(from.travel.0.wrapping_mul(self.ticks.into()));
        let mut profile = Profile::along(TrajectorySegment { from: Fixed(from.from.0.wrapping_sub(gone.0)), ..from });
        let felt = Felt {
            position: self.status.position,
            touches: self.now.short || self.status.gap.touches,
            upper: self.now.safety.upper_limit,
            lower: self.now.safety.lower_limit,
        };
        let next = self.search.as_mut().map(|search| {
            let next = search.plan(&mut profile, &felt, self.ticks);
            (next, search.overshoot())
        });
        let ended = match next {
            Some((Next::Moves(segment), _)) => return Motion::Axis(self.approach(segment)),
            Some((Next::Ends(search, found), overshoot)) => {
                (self.status.search, self.status.overshoot) = (search, overshoot);
                self.status.touched = found.unwrap_or(self.status.touched);
                found.is_some()
            }
            None => false,
        };
        // It may have gone back into the edge of the switch.
        self.upper_limit_excused = self.now.safety.upper_limit;
        self.enter(State::Ready, if ended { Reason::Touched } else { Reason::NotTouched });
        Motion::Axis(TrajectorySegment { from: self.segment().from, ..TrajectorySegment::default() })
    }
}

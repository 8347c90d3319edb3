//! Identification and tuning: what may begin one, and how the planner continues it.

use super::Planner;
use crate::head::Status;
use crate::head::command::Refused;
use crate::head::fault::Fault;
use crate::head::identify::{Demand, Identify, Seen, Summed};
use crate::head::reaction::Motion;
use crate::head::state::{Reason, State};
use crate::head::tune::{Point, Tune};
use crate::motion::TrajectorySegment;
use crate::path::Path;
use crate::units::{Fixed, Nanometres, TICK_S};
use core::ops::DerefMut;

/// What a head shows that measures itself.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Evidence {
    /// A stage of an identification is over.
    Stage(Summed),
    /// A frequency of a tuning is.
    Point(Point),
}

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// Measures motor, mass and friction, within the travel above the head.
    pub(super) fn identify(&mut self, state: State) -> Result<(), Refused> {
        let here = self.measures_from(state, self.config.identify.travel)?;
        self.identify = Some(Identify::new(&self.config.identify, here, &self.watched.row));
        self.enter(State::Identifying, Reason::IdentificationStarted);
        Ok(())
    }

    /// Measures the response of the loop, within the travel above the head.
    pub(super) fn tune(&mut self, state: State) -> Result<(), Refused> {
        let here = self.measures_from(state, self.config.tune.travel)?;
        self.tune = Some(Tune::new(&self.config.tune, here, self.status.late_plans));
        self.enter(State::Identifying, Reason::TuningStarted);
        Ok(())
    }

    /// Where the head rests, if it may measure itself within so many counts above.
    fn measures_from(&self, state: State, travel: i64) -> Result<Fixed, Refused> {
        if !matches!(state, State::Ready | State::HoldingPosition | State::Done) {
            return Err(Refused::State(state));
        }
        if state != State::Done && !self.route.at_end() {
            return Err(Refused::PathActive);
        }
        if !self.status.homed {
            return Err(Refused::NotHomed);
        }
        self.refuse_hazard(false)?;
        if self.now.safety.upper_limit {
            return Err(Refused::StillFaulty(Fault::UpperLimit));
        }
        let axis = &self.config.axis;
        let here = self.segment().from;
        let (height, free) = (Fixed::whole(travel), here.minus(axis.counts(self.travel().0)));
        if free < height {
            let nm = |counts: Fixed| Nanometres(counts.round().saturating_mul(axis.nm_per_count));
            return Err(Refused::NoRoom { height: nm(height), free: nm(free) });
        }
        Ok(here)
    }

    /// Whether the head measures itself.
    pub(super) fn measures(&self) -> bool {
        self.identify.is_some() || self.tune.is_some()
    }

    /// Something else comes between; whether there was something to measure.
    pub(super) fn break_off_measurement(&mut self) -> bool {
        self.identify.take().is_some() | self.tune.take().is_some()
    }

    /// What has been shown in the newest plan, once.
    pub fn evidence(&mut self) -> Option<Evidence> {
        if let Some(tune) = &mut self.tune {
            return tune.take().map(Evidence::Point);
        }
        self.identify.as_mut().and_then(Identify::take).map(Evidence::Stage)
    }

    /// Goes on with an identification or a tuning.
    pub(super) fn identify_on(&mut self) -> Motion {
        if self.awaited(self.status.following.abs()).is_none() {
            return self.react();
        }
        let from = self.segment();
        let Status { position, velocity, duty, saturated, following, late_plans: late, .. } = self.status;
        let seen = Seen { from, position, velocity, duty, saturated, following, ticks: self.ticks, late };
        let demand = match (&mut self.identify, &mut self.tune) {
            (Some(identify), _) => identify.plan(&self.config.identify, &seen, &self.watched.row),
            (_, Some(tune)) => tune.plan(&self.config.tune, &seen),
            _ => Demand::End,
        };
        match demand {
            Demand::Follow(segment, duty) => {
                let gain = (segment.velocity.0 - from.velocity.0) / (self.ticks as f32 * TICK_S);
                Motion::Jump(segment, duty + self.config.axis.plant.accelerating(gain))
            }
            Demand::Duty(duty) => {
                if self.status.closed {
                    // Whatever comes between closes the loop where the axis is then.
                    self.restart_path();
                }
                Motion::Duty(duty)
            }
            Demand::Stuck => {
                self.raise(Fault::EncoderLost);
                self.react()
            }
            Demand::End => {
                let reason = if self.tune.is_some() { Reason::Tuned } else { Reason::Identified };
                self.enter(State::Ready, reason);
                Motion::Axis(TrajectorySegment { from: self.segment().from, ..TrajectorySegment::default() })
            }
        }
    }
}

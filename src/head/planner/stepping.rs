//! Steps of a host as the set point of the axis.

use super::Planner;
use crate::head::command::{Command, Refused};
use crate::head::fault::Fault;
use crate::head::positioning::{Task, When};
use crate::head::state::State;
use crate::head::steps::{Recorder, Stepper, Unfollowed};
use crate::motion::TrajectorySegment;
use crate::path::{self, AHEAD, Path};
use crate::units::{Fixed, Nanometres, TICK_S, TICKS_PER_MS};
use core::ops::DerefMut;

/// Segments waiting at which the host is to hold, and below which it may go on.
const HOLDS: u16 = AHEAD as u16 / 4 * 3;
const GOES_ON: u16 = AHEAD as u16 / 2;

/// Ticks without a step after which a host rests.
const RESTS: u32 = 10 * TICKS_PER_MS;

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// A host has stepped, positive toward the work, since the step before. Between [`begin`](Planner::begin) and
    /// [`plan`](Planner::plan).
    pub fn step(&mut self, steps: i32) {
        if steps != 0 {
            self.unstepped = 0;
        }
        if let Some(stepper) = &mut self.stepper {
            stepper.take(steps, &self.config.step);
        }
        let corner = self.recorder.as_mut().and_then(|recorder| recorder.take(steps, &self.config.step));
        if let Some(corner) = corner
            && let Err(refused) = self.queue_steps(corner)
        {
            self.leave_steps(left_for(refused));
        }
    }

    /// Which way the steps of a host went is not known any more.
    pub fn lose_steps(&mut self) {
        if self.stepper.is_some() || self.recorder.is_some() {
            self.leave_steps(Unfollowed::Lost);
        }
    }

    fn leave_steps(&mut self, why: Unfollowed) {
        self.status.unfollowed = why;
        self.raise(Fault::StepsNotFollowed);
    }

    /// Follows steps from here on, or within other bounds.
    pub(super) fn follow_steps(&mut self, state: State, least: Nanometres, most: Nanometres) -> Result<(), Refused> {
        let (min, max) = self.travel();
        let counts = |to: Nanometres| {
            let to = if self.status.homed { to.max(min).min(max) } else { to };
            self.config.axis.counts(to)
        };
        let bounds = (counts(least), counts(most));
        if let Some(stepper) = &mut self.stepper {
            stepper.bounds = bounds;
            return Ok(());
        }
        if !matches!(state, State::Ready | State::HoldingPosition | State::Done) {
            return Err(Refused::State(state));
        }
        if self.unstepped < RESTS {
            return Err(Refused::StepsCome);
        }
        self.status.unfollowed = Unfollowed::No;
        let here = self.segment().from;
        self.take_up(State::Positioning, Task::Follow { to: here, due: self.now.tick });
        self.stepper = Some(Stepper::new(here, bounds));
        Ok(())
    }

    /// The steps of a host become path from here on.
    pub(super) fn begin_record(&mut self, state: State) -> Result<(), Refused> {
        if !matches!(state, State::Ready | State::HoldingPosition | State::Done) {
            return Err(Refused::State(state));
        }
        if !self.status.homed {
            return Err(Refused::NotHomed);
        }
        if self.unstepped < RESTS {
            return Err(Refused::StepsCome);
        }
        self.status.unfollowed = Unfollowed::No;
        self.recorder = Some(Recorder::new(self.route.end()));
        Ok(())
    }

    /// The path goes on to where the steps have led.
    fn queue_steps(&mut self, end: Fixed) -> Result<(), Refused> {
        match self.queue(self.status.state, end) {
            Ok(()) | Err(Refused::Path(path::Refused::NoLength)) => {
                if let Some(recorder) = &mut self.recorder {
                    recorder.queue(end);
                }
                Ok(())
            }
            refused => refused,
        }
    }

    /// What steps have led to becomes path, and the head goes along it. Once a plan.
    pub(super) fn record_steps(&mut self) {
        if self.recorder.is_none() {
            (self.status.records, self.status.takes_steps) = (false, self.stepper.is_some());
            return;
        }
        let due = self.recorder.as_mut().and_then(|recorder| recorder.due(&self.config.step, self.ticks));
        if let Some(end) = due
            && let Err(refused) = self.queue_steps(end)
            && left_for(refused) == Unfollowed::Beyond
        {
            self.leave_steps(Unfollowed::Beyond);
        }
        self.status.records = self.recorder.is_some();
        let waiting = self.route.waiting();
        let room = waiting < if self.status.takes_steps { HOLDS } else { GOES_ON };
        self.status.takes_steps = self.stepper.is_some() || self.status.records && room;
        let rests = matches!(self.status.state, State::Ready | State::HoldingPosition | State::Done);
        if self.status.records && rests && !self.route.at_end() {
            // One that is not allowed to start now is asked again with the next plan.
            let _: Result<(), Refused> = self.command(Command::Start);
        }
    }

    /// Where the steps lead, and whether a bound keeps the axis from there.
    pub(super) fn lead_by_steps(&mut self, when: When) -> Option<(Fixed, bool)> {
        let (to, held) = self.stepper.as_ref()?.place(&self.config.step);
        self.positioning = Some(Task::Follow { to, due: when.now.wrapping_add(self.config.step.smooth) });
        Some((to, held))
    }

    /// Whether the set point stays so far behind the steps, beyond what its time constant makes, that they are not followed any more.
    pub(super) fn falls_behind(&mut self, to: Fixed, segment: &TrajectorySegment) -> bool {
        let constant = segment.velocity.0.abs() * (self.config.step.smooth as f32 * TICK_S);
        let behind = to.minus(segment.from).to_f32().abs() > constant + self.config.supervise.following;
        if behind {
            self.leave_steps(Unfollowed::TooFast);
        }
        behind
    }
}

/// Why steps whose path was refused are not recorded any more.
fn left_for(refused: Refused) -> Unfollowed {
    match refused {
        Refused::OutOfTravel { .. } | Refused::Path(path::Refused::TooFar { .. }) => Unfollowed::Beyond,
        _ => Unfollowed::Overrun,
    }
}

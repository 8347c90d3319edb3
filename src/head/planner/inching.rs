//! The inch-worm: asks for the coarse axis at the end of the stroke, and goes on when that has moved.

use super::Planner;
use super::states::REST;
use crate::feed::After;
use crate::head::command::Refused;
use crate::head::inch::{Carry, Inch, Inching, Phase, SeenBy};
use crate::head::positioning::MotionLimits;
use crate::head::reaction::Motion;
use crate::head::state::{Reason, State};
use crate::head::touch::{Bounds, Felt, Next, Touching};
use crate::motion::{Profile, TrajectorySegment};
use crate::path::Path;
use crate::units::{CountsPerSecond, Fixed, MicrometresPerSecond, Nanometres, smaller};
use core::ops::DerefMut;

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// Upper and lower end of the travel, where the coarse axis has carried it.
    #[inline(never)]
    pub(super) fn travel(&self) -> (Nanometres, Nanometres) {
        let axis = &self.config.axis;
        let by = self.status.carried.saturating_mul(axis.nm_per_count);
        let (top, bottom) = axis.travel;
        (Nanometres(top.0.saturating_add(by)), Nanometres(bottom.0.saturating_add(by)))
    }

    /// Where a path may lead: below the travel as well, if a coarse axis carries the head on.
    pub(super) fn reach(&self) -> (Nanometres, Nanometres) {
        let (top, bottom) = self.travel();
        (top, if self.config.inch.step > 0 { Nanometres(i64::MAX) } else { bottom })
    }

    /// The head is at the top of a travel that has been carried into the hole: its path goes on above, and it cannot.
    pub(super) fn is_spent(&self) -> bool {
        self.status.carried > 0 && self.at_top()
    }

    /// The stroke ends here, and the path does not.
    pub(super) fn stroke_ends(&self) -> bool {
        let inch = &self.config.inch;
        if inch.step == 0 || !self.status.homed || !self.route.is_at_front() {
            return false;
        }
        let bottom = self.config.axis.counts(self.travel().1);
        let left = bottom.minus(Fixed::whole(self.status.position));
        let beyond = self.route.end() > bottom;
        let reserve = if beyond { inch.reserve } else { inch.reserve.wrapping_div(2) };
        !self.route.at_end() && left <= Fixed::whole(reserve)
    }

    /// Begins to ask for the coarse axis.
    pub(super) fn begin_inch(&mut self) {
        let here = self.segment().from;
        let float = self.route.s().minus(Fixed::whole(self.config.jump.float.into()));
        let from = self.status.position;
        let phase = match self.config.inch.seen {
            SeenBy::Touch => {
                let bottom = self.config.axis.counts(self.travel().1).round();
                Phase::Finds(
                    self.bottom_search(bottom.min(from.saturating_add(self.config.inch.reserve)), here.round()),
                )
            }
            SeenBy::Word => Phase::Rises(self.waiting_place(from)),
        };
        let seeks = self.status.state == State::Seeking;
        self.inch = Some(Inching {
            phase,
            bottom: None,
            felt: None,
            waits_at: self.waiting_place(from),
            float,
            seeks,
            ends: None,
        });
        self.status.inch = Inch::Prepares;
        self.enter(State::Inching, Reason::StrokeEnd);
    }

    /// Above the bottom, or where the erosion has got to, by step and clearance; not above the travel.
    fn waiting_place(&self, from: i64) -> i64 {
        let top = self.config.axis.counts(self.travel().0).round();
        let inch = &self.config.inch;
        from.saturating_sub(inch.step).saturating_sub(inch.clearance).max(top)
    }

    /// A search for the bottom that ends at `end`.
    fn bottom_search(&self, end: i64, top: i64) -> Touching {
        let acceleration = self.counts2(self.config.acceleration);
        let bounds = Bounds { end, top: top.min(self.status.position), off_limit: self.config.axis.off_limit };
        let top = bounds.top.saturating_sub(self.config.touch.back.into());
        Touching::new(self.config.touch, acceleration, Bounds { top, ..bounds })
    }

    /// Whether a contact is looked for.
    pub(super) fn feels(&self) -> bool {
        match self.inch.as_ref().map(|inch| &inch.phase) {
            Some(Phase::Finds(search) | Phase::Checks(search)) => search.approaches(),
            _ => false,
        }
    }

    /// The head waits for the coarse axis, which has carried it on into the work.
    pub(super) fn is_run_into(&self) -> bool {
        let waits = matches!(self.inch, Some(Inching { phase: Phase::Asks(_) | Phase::Waits, .. }));
        waits && self.status.gap.touches
    }

    /// The host says what the coarse axis has done.
    pub(super) fn carry(&mut self, state: State, carry: Carry) -> Result<(), Refused> {
        let to = match carry {
            Carry::To(to) => Some(self.config.axis.counts(to).round()),
            Carry::AsAsked => Some(self.status.carry_to),
            Carry::Refused => None,
        };
        let Some(inch) = &self.inch else {
            // At rest it may go anywhere, back above all: the path begins anew.
            let rests = matches!(state, State::Disabled | State::Ready | State::HoldingPosition | State::Done);
            return match to.filter(|_| rests && carry != Carry::AsAsked) {
                None => Err(Refused::State(state)),
                Some(_) if !self.status.homed => Err(Refused::NotHomed),
                Some(to) => {
                    self.move_with(to.saturating_sub(self.status.coarse), to);
                    // It has never been here.
                    self.cleared = self.status.position;
                    if state == State::Disabled {
                        self.restart_path();
                    } else {
                        self.restart_path_at(self.segment().from);
                    }
                    Ok(())
                }
            };
        };
        if !matches!(inch.phase, Phase::Asks(_) | Phase::Waits) {
            return Err(Refused::State(state));
        }
        let config = self.config.inch;
        let phase = match to {
            None => {
                if let Some(inch) = &mut self.inch {
                    inch.ends = inch.ends.or(Some(Reason::CarryRefused));
                }
                Phase::Returns
            }
            Some(to) if to.abs_diff(self.status.carry_to) > config.tolerance.unsigned_abs() => {
                self.status.inch = Inch::Contradicts;
                self.set_phase(Phase::Waits);
                return Ok(());
            }
            Some(to) => match inch.bottom {
                None => {
                    self.move_with(to.saturating_sub(self.status.coarse), to);
                    self.status.inches = self.status.inches.wrapping_add(1);
                    Phase::Returns
                }
                // The counts are still those before the move.
                Some(bottom) => {
                    let step = to.saturating_sub(self.status.coarse);
                    let expected = bottom.round().saturating_sub(step);
                    self.status.carry_to = to;
                    let search = self.bottom_search(expected.saturating_add(config.tolerance), self.status.position);
                    Phase::Checks(search)
                }
            },
        };
        self.status.inch = Inch::Returns;
        self.set_phase(phase);
        Ok(())
    }

    /// The host is asked once more, of a head that waits for it.
    pub(super) fn ask_again(&mut self) -> bool {
        let waits = matches!(self.inch, Some(Inching { phase: Phase::Waits, ends: None, .. }));
        if waits {
            self.status.inch = Inch::Asks;
            self.set_phase(Phase::Asks(0));
        }
        waits
    }

    /// The erosion is not to go on. Whether the coarse axis still moves only the host knows: a head that has asked waits for its
    /// answer.
    pub(super) fn hold_inch(&mut self) -> bool {
        let Some(inch) = &mut self.inch else { return false };
        inch.ends = inch.ends.or(Some(Reason::Held));
        match inch.phase {
            Phase::Finds(_) | Phase::Rises(_) => inch.phase = Phase::Returns,
            Phase::Asks(_) => inch.phase = Phase::Waits,
            _ => {}
        }
        self.status.inch = match inch.phase {
            Phase::Returns => Inch::Returns,
            Phase::Waits if self.status.inch == Inch::Asks => Inch::Late,
            _ => self.status.inch,
        };
        true
    }

    /// The coarse axis has carried the head by so many counts, to `to` by its own scale: the same place of the hole has the same
    /// position again.
    fn move_with(&mut self, by: i64, to: i64) {
        let cleared = self.cleared;
        self.move_origin(self.status.position.saturating_add(by));
        self.cleared = cleared;
        self.status.carried = self.status.carried.saturating_add(by);
        (self.status.coarse, self.status.carry_to) = (to, to);
    }

    fn set_phase(&mut self, phase: Phase) {
        if let Some(inch) = &mut self.inch {
            inch.phase = phase;
        }
    }

    /// Positions are those of a new home: what has carried the head before is in it.
    pub(super) fn forget_carrying(&mut self) {
        (self.status.carried, self.status.coarse, self.status.carry_to) = (0, 0, 0);
        self.carried_rest = Fixed(0);
    }

    /// Something else comes between; whether there was anything.
    pub(super) fn end_carrying(&mut self) -> bool {
        self.status.inch = Inch::No;
        self.inch.take().is_some()
    }

    /// Goes on with it.
    pub(super) fn inch_on(&mut self) -> Motion {
        let from = self.segment();
        let Some(inch) = self.inch else {
            self.enter(State::HoldingPosition, Reason::Held);
            return self.along(REST);
        };
        let stands = Motion::Axis(TrajectorySegment { from: from.from, ..TrajectorySegment::default() });
        match inch.phase {
            Phase::Finds(mut search) => match self.feel(&mut search) {
                Next::Moves(segment) => {
                    self.set_phase(Phase::Finds(search));
                    Motion::Axis(self.approach(segment))
                }
                Next::Ends(_, None) => {
                    let ends = inch.ends.or(Some(Reason::NotTouched));
                    self.inch = Some(Inching { phase: Phase::Returns, ends, ..inch });
                    self.status.inch = Inch::Returns;
                    stands
                }
                Next::Ends(_, Some(at)) => {
                    let (waits_at, bottom) = (self.waiting_place(at), self.inch.and_then(|inch| inch.felt));
                    self.inch = Some(Inching { phase: Phase::Rises(waits_at), bottom, waits_at, ..inch });
                    stands
                }
            },
            Phase::Rises(to) => {
                let motion = self.go(Fixed::whole(to), self.config.retreat.velocity);
                if self.is_there(&motion, Fixed::whole(to)) {
                    self.status.carry_to = self.status.coarse.saturating_add(self.config.inch.step);
                    self.status.inch = Inch::Asks;
                    self.set_phase(Phase::Asks(0));
                }
                motion
            }
            Phase::Asks(ticks) => {
                let ticks = ticks.saturating_add(self.ticks);
                if ticks >= self.config.inch.patience {
                    self.status.inch = Inch::Late;
                    self.set_phase(Phase::Waits);
                } else {
                    self.set_phase(Phase::Asks(ticks));
                }
                stands
            }
            Phase::Waits => stands,
            Phase::Checks(mut search) => match self.feel(&mut search) {
                Next::Moves(segment) => {
                    self.set_phase(Phase::Checks(search));
                    Motion::Axis(self.approach(segment))
                }
                Next::Ends(_, found) => {
                    self.check(&inch, found.and(self.inch.and_then(|inch| inch.felt)));
                    // In the counts after it.
                    Motion::Axis(TrajectorySegment { from: self.segment().from, ..TrajectorySegment::default() })
                }
            },
            Phase::Backs(to) => {
                let motion = self.go(Fixed::whole(to), self.config.retreat.velocity);
                if self.is_there(&motion, Fixed::whole(to)) {
                    self.set_phase(Phase::Waits);
                }
                motion
            }
            Phase::Returns => {
                self.route.go_back_to(inch.float);
                let axis = &self.config.axis;
                // What the host said of the coarse axis may be wrong.
                let approach = self.config.contact.approach.0 / axis.counts_per_um;
                let velocity = MicrometresPerSecond(smaller(approach, self.config.retreat.velocity.0));
                let to = self.route.setpoint();
                let motion = self.go(to, velocity);
                if self.is_there(&motion, to) {
                    self.end_inch(&inch);
                    return self.along(REST);
                }
                motion
            }
        }
    }

    /// The bottom was touched, or not, after the move.
    fn check(&mut self, inch: &Inching, found: Option<Fixed>) {
        let asked = self.status.carry_to.saturating_sub(self.status.coarse);
        let moved = match (inch.bottom, found) {
            (Some(before), Some(now)) => Some(before.minus(now)),
            _ => None,
        };
        match moved.filter(|moved| moved.round().abs_diff(asked) <= self.config.inch.tolerance.unsigned_abs()) {
            Some(exact) => {
                let all = exact.plus(self.carried_rest);
                let moved = all.round();
                self.carried_rest = all.minus(Fixed::whole(moved));
                self.status.inch_error = moved.saturating_sub(asked);
                self.move_with(moved, self.status.carry_to);
                self.status.inches = self.status.inches.wrapping_add(1);
                self.set_phase(Phase::Returns);
            }
            None => {
                self.status.inch = Inch::Contradicts;
                self.set_phase(Phase::Backs(inch.waits_at));
            }
        }
    }

    fn end_inch(&mut self, inch: &Inching) {
        self.inch = None;
        self.status.inch = Inch::No;
        match inch.ends {
            Some(reason) => self.enter(State::HoldingPosition, reason),
            None if inch.seeks => self.enter(State::Seeking, Reason::Carried),
            None => {
                self.enter(State::Eroding, Reason::Carried);
                self.lead(After::Jump);
            }
        }
    }

    fn feel(&mut self, search: &mut Touching) -> Next {
        let felt = Felt {
            position: self.status.position,
            touches: self.now.short || self.status.gap.touches,
            upper: self.now.safety.upper_limit,
            lower: self.now.safety.lower_limit,
        };
        let (mut profile, before) = (self.profile(), search.found());
        let next = search.plan(&mut profile, &felt, self.ticks);
        if before != search.found()
            && let Some(inch) = &mut self.inch
        {
            inch.felt = Some(self.status.setpoint);
        }
        next
    }

    /// The set point, as at the plan before.
    fn profile(&self) -> Profile {
        let from = self.segment();
        let gone = Fixed(from.travel.0.wrapping_mul(self.ticks.into()));
        Profile::along(TrajectorySegment { from: Fixed(from.from.0.wrapping_sub(gone.0)), ..from })
    }

    /// Moves to a place, and waits where the axis does not follow.
    fn go(&mut self, to: Fixed, velocity: MicrometresPerSecond) -> Motion {
        let acceleration = self.config.acceleration;
        let ramp = self.ramp(&MotionLimits { velocity, acceleration, deceleration: acceleration });
        let segment = self.profile().toward(to, &ramp, self.ticks);
        let following = self.status.following;
        let Some(pace) = self.awaited(following.copysign(following * segment.velocity.0)) else { return self.react() };
        let slowed = segment.at(CountsPerSecond(segment.velocity.0 * pace));
        Motion::Axis(self.approach(if pace < 1.0 { slowed } else { segment }))
    }

    /// Set point and axis have got there.
    fn is_there(&self, motion: &Motion, to: Fixed) -> bool {
        let rests = matches!(motion, Motion::Axis(segment) if segment.travel == Fixed(0) && segment.from == to);
        rests && self.now.segment.velocity.0 == 0.0
    }
}

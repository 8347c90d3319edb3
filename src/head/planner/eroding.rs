//! Seek, erosion, and the end of it.

use super::Planner;
use super::states::REST;
use crate::feed::{After, Motion as Moves, View};
use crate::gap::Quality;
use crate::gap::controlled::{Controlled, GapVoltage, Sensed, Variable};
use crate::head::config::{Config, Structure};
use crate::head::ends::{Ends, Place};
use crate::head::fault::Fault;
use crate::head::reaction::Motion;
use crate::head::rhythm::Rhythm;
use crate::head::state::{Reason, State};
use crate::path::Path;
use crate::units::{Fixed, Micrometres, MicrometresPerSecond, TICKS_PER_MS, Volts, larger};
use core::ops::DerefMut;

/// Jumps for arcs, one after the other, after which arcs that are still there stay.
const ARC_JUMPS: u8 = 3;

impl<P: DerefMut<Target = Path>> Planner<P> {
    pub(super) fn seek(&mut self) {
        self.watch_short(State::Seeking);
        if self.status.state != State::Seeking || self.is_stopped() {
            return;
        }
        let gap = self.status.gap;
        let Some(open) = self.open.volts() else {
            self.open.observe(&gap, self.ticks);
            return;
        };
        self.status.open_circuit = open;
        if open < self.config.seek.open_min {
            self.raise(Fault::OpenCircuitLow);
            return;
        }
        let valid = gap.quality == Quality::Valid;
        if valid && gap.filtered.0 < open.0 * self.config.seek.threshold {
            if self.route.found_work() {
                (self.status.found, self.meets) = (self.status.position, true);
            }
            (self.good, self.eroded, self.ends) = (self.route.s(), 0, Ends::default());
            (self.arc_jumps, self.status.cramped, self.rhythm) = (0, false, Rhythm::default());
            if self.config.structure == Structure::SingleLoop {
                self.reset_loop();
            }
            self.enter(State::Eroding, Reason::WorkFound);
            self.lead(|_| After::Start);
        } else if let Some(reason) = self.reached().filter(|_| self.arrived()) {
            self.end(reason);
        } else if self.stroke_ends() {
            self.begin_inch();
        }
    }

    pub(super) fn erode(&mut self) -> Motion {
        if let Some(reason) = self.ended() {
            self.end(reason);
            return self.along(REST);
        }
        if self.stroke_ends() {
            self.begin_inch();
            return self.inch_on();
        }
        if self.jump_is_due() && self.begin_jump(false).is_ok() {
            return self.jump_on();
        }
        let arcs = self.watched.arcs;
        match arcs {
            // Jumps have not helped.
            Some(true) if self.arc_jumps >= ARC_JUMPS => {
                self.raise(Fault::PersistentArc);
                return self.react();
            }
            Some(true) if self.begin_jump(false).is_ok() => {
                self.arc_jumps = self.arc_jumps.saturating_add(1);
                return self.jump_on();
            }
            Some(false) => self.arc_jumps = 0,
            _ => {}
        }
        let (error, unknown) = self.gap_error();
        let (wanted, blind) = match self.config.structure {
            // In every tick, and not in every plan.
            Structure::SingleLoop => (REST, false),
            _ => self.feed(error),
        };
        if self.is_blind(unknown || blind) {
            self.raise(Fault::GapSignalInvalid);
            return self.react();
        }
        if self.meets && self.status.gap.quality == Quality::Valid && error.0 <= 0.0 {
            (self.status.found, self.meets) = (self.status.position, false);
        }
        match self.config.structure {
            Structure::SingleLoop => Motion::Gap(self.status.gap_setpoint),
            structure => {
                let wanted = self.hastened(wanted);
                self.status.feed = wanted;
                if structure == Structure::Path { self.along(wanted) } else { Motion::Velocity(wanted) }
            }
        }
    }

    /// Why the erosion is over, if it is.
    fn ended(&mut self) -> Option<Reason> {
        let Config { ends, .. } = &self.config;
        let deep = |from: Fixed| self.route.is_at_front() && self.route.s().minus(self.route.work()) > from;
        let reached = self.reached().filter(|_| self.ends.spark_out() || self.arrived());
        let place = match (reached, ends.through) {
            (Some(reason), _) => Place::End(reason),
            (None, from) if from > 0 && deep(Fixed::whole(from.into())) => Place::Deep,
            _ => Place::Known,
        };
        let gap = (self.status.gap.quality == Quality::Valid).then_some(self.status.gap.filtered);
        self.ends.plan(ends, place, gap, self.status.open_circuit, self.ticks)
    }

    /// The erosion is over: out of the work, or at rest where it is.
    fn end(&mut self, reason: Reason) {
        self.lifts_to = self.route.s().minus(Fixed::whole(self.config.ends.lift.into()));
        let lifts = self.config.ends.lift > 0;
        if lifts && self.config.structure != Structure::Path {
            // The loop is closed over the axis from here on.
            self.reset_loop();
        }
        self.route.pass_stop();
        self.enter(if lifts { State::Lifting } else { State::Done }, reason);
    }

    /// Goes on with the lift after the end.
    pub(super) fn lift_on(&mut self) -> Motion {
        if self.route.s() > self.lifts_to && !self.route.at_beginning() && !self.is_spent() {
            return self.along(MicrometresPerSecond(-self.config.retreat.velocity.0));
        }
        if self.now.along.0 == 0.0 {
            self.enter(State::Done, Reason::Lifted);
        }
        self.along(REST)
    }

    /// What of the path's ends is reached.
    fn reached(&self) -> Option<Reason> {
        match () {
            () if self.route.at_end() => Some(Reason::PathEnd),
            () if self.route.at_stop() => Some(Reason::PathStop),
            () => None,
        }
    }

    /// The axis is on the count that the path asks for.
    fn arrived(&self) -> bool {
        self.status.position == self.route.setpoint().round()
    }

    /// Path velocity that the law wants, within its limits, and whether it is blind.
    pub(super) fn feed(&mut self, error: Volts) -> (MicrometresPerSecond, bool) {
        let place = self.place();
        let way = place.minus(self.looked).to_f32();
        self.looked = place;
        let moved = if self.leads() { way } else { way / self.config.axis.counts_per_um };
        let view = View {
            error,
            gap: &self.status.gap,
            senses: &self.status.senses,
            motion: Moves { place: self.route.s(), moved: Micrometres(moved), velocity: self.now.along },
            ticks: self.ticks,
        };
        let answer = self.law.act(&self.config.law, &view);
        self.generator = answer.generator;
        let wanted = self.config.limits.clamp(answer.velocity);
        (MicrometresPerSecond(self.changeover.value(Some(wanted.0), self.config.transfer)), answer.blind)
    }

    /// The feed law moves along the path.
    fn leads(&self) -> bool {
        self.config.structure == Structure::Path && self.status.state != State::Guiding
    }

    /// Where the head is for the law.
    pub(super) fn place(&self) -> Fixed {
        if self.leads() { self.route.s() } else { Fixed::whole(self.status.position) }
    }

    /// Gap error that the head acts on. A reading that is not valid is no reason to move, and neither is a set point that is a share
    /// of a voltage not measured yet. And whether the controlled variable is unknown beside a good reading.
    pub(super) fn gap_error(&mut self) -> (Volts, bool) {
        let status = &mut self.status;
        let setpoint = status.gap_setpoint;
        let valid = status.gap.quality == Quality::Valid;
        let sensed =
            Sensed { gap: &status.gap, senses: &status.senses, setpoint: (setpoint.0 > 0.0).then_some(setpoint) };
        let raw = if valid { self.config.controlled.error(&sensed) } else { None };
        let error = self.transfer.value(raw.map(|volts| volts.0), self.config.transfer);
        status.gap_error = Volts(error);
        // A set point that is a share is not unknown: it is measured at each seek.
        let unknown = valid && raw.is_none() && self.config.controlled != Controlled::GapVoltage(GapVoltage);
        (self.status.gap_error, unknown)
    }

    /// What the law needs has been unknown for longer than a gap reading may be bad, which the supervision watches: a head that
    /// stands still would not show it.
    pub(super) fn is_blind(&mut self, now: bool) -> bool {
        let valid = self.status.gap.quality == Quality::Valid;
        self.unknown = if now && valid { self.unknown.saturating_add(self.ticks) } else { 0 };
        self.unknown > self.config.supervise.gap_ms.saturating_mul(TICKS_PER_MS)
    }

    /// Far behind the last good place, and with nothing in the way, the head goes as fast as it came back.
    fn hastened(&self, wanted: MicrometresPerSecond) -> MicrometresPerSecond {
        let behind = self.good.minus(self.route.s());
        let fast = behind > Fixed::whole(self.config.jump.float.into()) && wanted.0 >= self.config.limits.feed.0;
        if fast { MicrometresPerSecond(larger(self.config.retreat.velocity.0, wanted.0)) } else { wanted }
    }
}

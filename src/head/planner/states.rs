//! What each state does, and when it is left.

use super::Planner;
use crate::feed::{After, Generator};
use crate::head::commissioning::Demand;
use crate::head::config::Config;
use crate::head::fault::{Fault, Reaction};
use crate::head::proof::{Goal, Outcome};
use crate::head::reaction::Motion;
use crate::head::state::{Reason, State};
use crate::path::Path;
use crate::units::{MicrometresPerSecond, TICKS_PER_MS};
use core::ops::DerefMut;

/// At rest.
pub(super) const REST: MicrometresPerSecond = MicrometresPerSecond(0.0);
/// Servo ticks that a bridge of debris has to tear or burn away where a retreat ends: 100 ms, ten mean lives (assumed,
/// docs/process-model.md).
const BRIDGE: u32 = 100 * TICKS_PER_MS;

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// State transitions, then the motion of the state and whether it needs pulses.
    pub(super) fn decide(&mut self) -> (Motion, bool) {
        self.generator = Generator::FREE;
        self.upper_limit_excused &= self.now.safety.upper_limit;
        match self.status.state {
            State::Seeking => self.seek(),
            State::Eroding => self.watch_short(State::Eroding),
            State::Guiding => self.watch_short(State::Guiding),
            State::Retreating => self.end_retreat(),
            _ => {}
        }
        let motion = match self.status.state {
            State::Disabled => Motion::Coast,
            // Whatever was raised: nothing moves while the processor may stall.
            State::Fault if self.write_permitted => Motion::Coast,
            State::Commissioning => return self.run_commissioning(),
            State::Proving => self.run_proof(),
            State::Ready | State::Done | State::HoldingPosition => self.along(REST),
            State::Positioning | State::Homing => self.position_axis(),
            State::Jumping => self.jump_on(),
            State::Inching => self.inch_on(),
            State::Touching => self.touch_on(),
            State::Identifying => self.identify_on(),
            State::Lifting => self.lift_on(),
            State::Seeking if self.open.volts().is_none() => self.along(REST),
            State::Seeking => self.along(self.config.seek.velocity),
            State::Eroding => self.erode(),
            State::Guiding => self.guide(),
            State::Retreating => {
                self.refer();
                self.along(MicrometresPerSecond(-self.config.retreat.velocity.0))
            }
            State::Fault => self.react(),
        };
        // The state of now: a path that ended in this plan has ended its pulses too.
        (motion, self.status.state.pulses() && !self.generator.closed)
    }

    pub(super) fn along(&self, velocity: MicrometresPerSecond) -> Motion {
        Motion::Path(velocity, self.full_window())
    }

    fn run_proof(&mut self) -> Motion {
        let Some(proof) = &mut self.proof else { return Motion::Coast };
        match proof.plan(&self.config, self.status.position, self.now.safety.upper_limit, self.ticks) {
            Outcome::Push(duty) => Motion::Duty(duty),
            Outcome::Hold => {
                if !self.status.closed {
                    self.reset_loop();
                    self.restart_path();
                }
                self.along(REST)
            }
            Outcome::Proved(goal) => {
                self.doubt = None;
                self.proof = None;
                self.descents = 0;
                match goal {
                    Goal::Ready => self.close_loop(),
                    Goal::Commissioning => self.begin_commissioning(),
                }
                self.along(REST)
            }
            // The lift is a push of the same sign: where that goes the wrong way there is none.
            Outcome::Failed(Fault::PolarityWrong) => {
                self.react_with(Fault::PolarityWrong, Reaction::Coast);
                Motion::Coast
            }
            Outcome::Failed(fault) => {
                let descended = proof.is_descending() && !self.now.safety.upper_limit;
                self.descents = self.descents.saturating_add(descended.into());
                self.raise(fault);
                self.react()
            }
        }
    }

    fn run_commissioning(&mut self) -> (Motion, bool) {
        let Some(commissioning) = &mut self.commissioning else { return (Motion::Coast, false) };
        let status = &self.status;
        let Config { commissioning: config, axis, .. } = &self.config;
        let seen = (status.position, status.duty);
        let (wish, result) = commissioning.plan(config, &axis.plant, seen, &status.gap, self.ticks);
        if let Some(result) = result {
            self.adopt(Config { commissioned: result.is_ok(), ..self.config });
            self.commissioned = Some(result);
            self.commissioning = None;
            self.enter(State::Disabled, Reason::CommissioningEnded);
            return (Motion::Coast, false);
        }
        match wish {
            Demand::Duty(duty) => (Motion::Duty(duty), false),
            Demand::Pulses => (Motion::Duty(0.0), true),
            Demand::Stroke(velocity, window) => (Motion::Stroke(velocity, window), false),
        }
    }

    /// The fast path to a retreat: the reflex has begun one, or the unfiltered gap was shorted for a set time.
    pub(super) fn watch_short(&mut self, from: State) {
        if self.now.short || self.status.gap.short_ticks >= self.config.retreat.trigger {
            self.retreat = (from, self.status.position);
            self.cornered = self.status.tick;
            self.good = self.good.max(self.route.s());
            if !self.now.short && self.ready_to_escape() {
                self.route.escape(self.route.s(), self.escape);
            }
            self.enter(State::Retreating, Reason::Short);
            if let Some(guide) = &mut self.guide {
                guide.part();
            }
        }
    }

    fn end_retreat(&mut self) {
        let (back_to, began) = self.retreat;
        let gone = match self.route.off() {
            // Sideways the axis need not move.
            Some(off) => (off.to_f32() * self.config.axis.counts_per_um) as i64,
            None => began.saturating_sub(self.status.position),
        };
        let shorted = self.status.gap.short_ticks > 0;
        let clear = gone >= self.config.retreat.clearance || self.route.at_beginning() || self.is_spent();
        if !shorted && clear {
            self.enter(back_to, Reason::GapRecovered);
            self.lead(After::Retreat);
            return;
        }
        if !(self.route.is_exhausted() || self.is_spent()) {
            self.cornered = self.status.tick;
        }
        let since = |tick: u32| self.status.tick.wrapping_sub(tick);
        if shorted && (since(self.entered) > self.config.retreat.persistent || since(self.cornered) > BRIDGE) {
            self.raise(Fault::PersistentShort);
        }
    }
}

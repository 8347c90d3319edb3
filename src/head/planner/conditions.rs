//! What a contact, an open switch, a set point mean in the present state: conditions that a plan gives the servo ticks.

use super::{Planner, Touching};
use crate::gap::Quality;
use crate::head::Status;
use crate::head::config::Config;
use crate::head::follow::LEAD;
use crate::head::plan::{Hazards, Touch};
use crate::head::positioning::{Task, When};
use crate::head::probe::{Source, Wanted};
use crate::head::state::State;
use crate::head::touch;
use crate::path::Path;
use crate::units::{CountsPerSecond, Fixed, PLAN_TICKS, TICK_S, Volts};
use core::ops::DerefMut;

/// Share of the open-circuit voltage from which on a gap is open: discharges are rare.
const OPEN: f32 = 0.8;

/// Height above the lowest place so far from which a head on its way up has shown its film, um.
const AWAY_UM: f32 = 20.0;

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// The head is known to be below the upper end of its travel: no stop is in its way.
    pub(super) fn is_free(&self) -> bool {
        self.status.homed && !self.at_top()
    }

    /// The gap of a head that feeds or positions is open; one that goes back has left the work.
    pub(super) fn is_open(&self) -> bool {
        let Status { state, gap, open_circuit, .. } = &self.status;
        match state {
            State::Seeking | State::Eroding => gap.quality == Quality::Valid && gap.filtered.0 >= OPEN * open_circuit.0,
            // Not while identifying: what holds the head by its settings is what is in question.
            State::Positioning => !gap.touches,
            State::Retreating | State::Lifting | State::Fault => {
                let above = self.cleared.saturating_sub(self.status.position);
                above as f32 > AWAY_UM * self.config.axis.counts_per_um
            }
            _ => false,
        }
    }

    /// The head stands at the upper end of its travel, perhaps against its stop.
    pub(super) fn at_top(&self) -> bool {
        // The travel begins at 0, and the coarse axis takes it along.
        let own = self.status.position.saturating_sub(self.status.carried);
        self.status.homed && own <= self.config.axis.off_limit
    }

    /// What a contact means now.
    pub(super) fn touch(&self) -> Touch {
        match self.status.state {
            State::Positioning | State::Homing if self.touching == Touching::Asked => Touch::End,
            State::Homing if self.looks_for_home() => Touch::End,
            State::Inching if self.feels() => Touch::End,
            State::Positioning | State::Homing | State::Jumping | State::Inching | State::Identifying => Touch::Fault,
            State::Touching if self.search.as_ref().is_some_and(touch::Touching::approaches) => Touch::End,
            _ => Touch::Ignored,
        }
    }

    /// Which safety inputs are a hazard in the present state.
    pub(super) fn hazards(&self) -> Hazards {
        let state = self.status.state;
        Hazards {
            any: state != State::Disabled,
            // Commissioning drives from stop to stop, homing looks for the switches, and to a search for the work the lower one is
            // the end of the travel: one open limit is where they turn.
            limits: !matches!(state, State::Commissioning | State::Homing | State::Touching),
            // The proof may push the head up to its switch, and then begins there.
            upper: !self.upper_limit_excused && state != State::Proving,
            dielectric: state.pulses(),
        }
    }

    /// Largest velocity toward the work with pulses off: as much as comes down to the approach by the acceleration of the path
    /// where the axis has not been yet.
    pub(super) fn toward(&self, from: Fixed) -> CountsPerSecond {
        let Config { contact, acceleration, axis, .. } = &self.config;
        let clear = Fixed::whole(self.cleared).minus(from).to_f32();
        if self.touching != Touching::No || clear <= 0.0 {
            return contact.approach;
        }
        let slowing = 2.0 * acceleration.0 * axis.counts_per_um * clear;
        CountsPerSecond(libm::sqrtf(contact.approach.0 * contact.approach.0 + slowing))
    }

    /// What the touch probes wait for.
    pub(super) fn wanted(&self) -> Wanted {
        let on = self.probes.iter().any(|probe| probe.source != Source::Off);
        let discharge = Volts(self.status.open_circuit.0 * self.config.seek.threshold);
        Wanted { on, probes: self.probes, discharge }
    }

    /// Whether a reference is looked for, and not yet gone back from.
    pub(super) fn looks_for_home(&self) -> bool {
        matches!(&self.positioning, Some(Task::Home(homing, _)) if homing.looks())
    }

    /// Whether the supervision has found something in the way of a reference that is looked for.
    pub(super) fn is_blocked(&self) -> bool {
        let since = self.watched.tick.wrapping_sub(self.entered).cast_signed() > 0;
        self.watched.blocked && since && self.looks_for_home()
    }

    /// Whether the set point of the loop is the path's.
    pub(super) fn follows_path(&self) -> bool {
        let beside = self.positioning.is_some() || self.jump.is_some() || self.search.is_some() || self.inch.is_some();
        let beside = beside || self.measures();
        !beside && self.status.state != State::Guiding
    }

    /// Whether a set point that a SYNC releases is followed at once: not where the head leads.
    pub(super) fn follows_set_points(&self) -> bool {
        match &self.guide {
            Some(guide) => self.status.state == State::Guiding && guide.is_together(),
            None => self.may_position(self.status.state).is_ok(),
        }
    }

    /// Largest change of velocity of a guided head from a plan to the next.
    pub(super) fn slew(&self) -> CountsPerSecond {
        let Config { acceleration, axis, .. } = &self.config;
        let guided = acceleration.0 * axis.counts_per_um * (PLAN_TICKS as f32 * TICK_S);
        CountsPerSecond(if self.guide.is_some() { guided } else { f32::INFINITY })
    }

    /// Tick after which the set point under way is reached, or was.
    pub(super) fn due(&self) -> u32 {
        match self.guide.as_ref().map(|guide| &guide.task).or(self.positioning.as_ref()) {
            Some(Task::Follow { due, .. }) => *due,
            _ => self.now.tick,
        }
    }

    /// When the plan comes into force.
    pub(super) fn when(&self) -> When {
        When { now: self.now.tick.wrapping_add(LEAD.wrapping_sub(1)), ticks: self.ticks }
    }
}

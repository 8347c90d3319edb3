//! What a plan holds ready for the servo ticks: the motions after a short, a fault, a lost encoder.

use super::Planner;
use crate::head::config::Escape;
use crate::head::reaction::upward;
use crate::head::route::Bounds;
use crate::head::state::State;
use crate::head::trajectory::{Follow, Trajectory};
use crate::motion::TrajectorySegment;
use crate::path::Path;
use crate::servo::Window;
use crate::units::{CountsPerSecond, Fixed, MicrometresPerSecond, Nanometres, TICK_S};
use core::ops::DerefMut;

impl<P: DerefMut<Target = Path>> Planner<P> {
    pub(super) fn bounds(&self) -> Bounds {
        let upper_limit = self.now.safety.upper_limit || self.is_spent();
        Bounds { acceleration: self.config.acceleration, upper_limit, ticks: self.ticks }
    }

    pub(super) fn ready_retreat(&self, current: Window) -> Trajectory {
        if self.status.state == State::Guiding {
            // Beside the path, and straight up.
            let up = if self.now.safety.upper_limit { 0.0 } else { -self.slew().0 };
            let travel = Fixed::short(up * TICK_S);
            let segment = TrajectorySegment { velocity: CountsPerSecond(up), travel, ..TrajectorySegment::default() };
            return Trajectory::axis(&segment, self.full_window().and(current));
        }
        let (up, window) = (-self.config.retreat.velocity.0, self.full_window().and(current));
        if let Some(escape) = self.leaves_path() {
            let up = if self.bounds().upper_limit { 0.0 } else { up };
            return self.route.ready_escape(MicrometresPerSecond(up), escape.down, &self.bounds(), window);
        }
        self.route.ready(MicrometresPerSecond(up), &self.bounds(), window)
    }

    /// What a short would take the head off its path by, now.
    fn leaves_path(&self) -> Option<Escape> {
        let escape = self.config.retreat.escape?;
        let erodes = matches!(self.status.state, State::Seeking | State::Eroding) && self.route.off().is_none();
        erodes.then_some(escape)
    }

    /// Whether a short would begin an escape. Where that leads, not above the travel, is remembered.
    pub(super) fn ready_to_escape(&mut self) -> bool {
        let Some(Escape { by, .. }) = self.leaves_path() else { return false };
        let [up, ..] = by.map(i64::from);
        let (Nanometres(top), _) = self.travel();
        let here = self.route.setpoint().round().saturating_mul(self.config.axis.nm_per_count);
        let room = top.saturating_sub(here).min(0);
        self.escape = if self.status.homed && up < room {
            let share = room as f32 / up as f32;
            by.map(|nm| (nm as f32 * share) as i32)
        } else {
            by
        };
        true
    }

    /// For two ticks: what is open stays open, a positioning continues, what follows the path slows down.
    pub(super) fn ready_stop(&self, trajectory: &Trajectory, current: Window) -> Trajectory {
        let window = self.ready_window(self.config.axis.duty_limit, current);
        match trajectory.follow {
            Follow::Setpoint if self.follows_path() => {
                let stop = self.route.ready(MicrometresPerSecond(0.0), &self.bounds(), window);
                Trajectory { upward: true, ..stop }
            }
            Follow::Setpoint => Trajectory { window, upward: true, ..*trajectory },
            _ => Trajectory::COAST,
        }
    }

    /// Duties of a fault's reaction with so much force.
    pub(super) fn ready_window(&self, force: f32, current: Window) -> Window {
        upward(&self.config, force).and(current)
    }

    pub(super) fn ready_lift(&self) -> Trajectory {
        let barred = self.status.current_reduced || self.now.safety.upper_limit;
        if barred || self.status.state == State::Disabled {
            Trajectory::COAST
        } else {
            Trajectory::duty(self.config.lift.duty, self.full_window())
        }
    }
}

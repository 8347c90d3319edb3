//! The way along the path: where the plan in force will be, and how fast it may continue from there.

use super::estimate::Estimate;
use super::trajectory::{Follow, Trajectory};
use crate::feed::Limiter;
use crate::path::{AXES, BESIDE_NM, Bound, Path, Piece, Refused};
use crate::servo::Window;
use crate::units::{
    CountsPerSecond, Fixed, Micrometres, MicrometresPerSecond, MicrometresPerSecond2, PLAN_TICKS, TICK_S, larger,
};
use core::ops::DerefMut;

/// The path with its limits. `P` owns it.
#[derive(Debug)]
pub(super) struct Route<P> {
    path: P,
    limiter: Limiter,
    /// Times that the path has begun anew.
    begun: u32,
    /// Path coordinate where the work was found.
    work: Option<Fixed>,
    /// What has ended a working retreat.
    ended: Option<Bound>,
}

/// What bounds a motion along the path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub acceleration: MicrometresPerSecond2,
    /// Upward motion is blocked.
    pub upper_limit: bool,
    /// Ticks since the plan before.
    pub ticks: u32,
}

impl<P: DerefMut<Target = Path>> Route<P> {
    pub fn new(mut path: P, nm_per_count: i64, retreat: Fixed) -> Route<P> {
        path.set_retreat(retreat);
        let mut route = Route { path, limiter: Limiter::default(), begun: 0, work: None, ended: None };
        route.scale(nm_per_count);
        route
    }

    /// Sets what a count of the head's axis is, for a path that is begun anew from now on.
    pub fn scale(&mut self, nm_per_count: i64) {
        self.path.scale([nm_per_count, BESIDE_NM, BESIDE_NM]);
    }

    /// Goes to where the follower will be when this plan comes into force.
    pub fn reconcile(&mut self, now: &Estimate) {
        if now.paths == self.begun {
            let off = now.path_then.minus(self.path.s());
            self.path.step(off);
            if off.0 < 0 && self.at_beginning() && self.path.is_bounded() {
                self.ended = Some(self.path.bound());
            }
            self.limiter.go_on_from(now.along);
        }
    }

    /// Leaves the path at a coordinate where it was, for a line to so many nm away.
    pub fn escape(&mut self, at: Fixed, by: [i32; AXES]) {
        let by_then = at.minus(self.path.s());
        self.path.step(by_then);
        self.path.escape(by);
    }

    /// How far off the path an escape is, um.
    pub fn off(&self) -> Option<Fixed> {
        self.path.off()
    }

    /// The beginning of an escape that leads along its line by `down` counts of the axis in each um, prepared for later.
    pub fn ready_escape(&self, wanted: MicrometresPerSecond, down: f32, bounds: &Bounds, window: Window) -> Trajectory {
        let far = || Micrometres(f32::INFINITY);
        let along = Limiter::default().limit(wanted, bounds.acceleration, PLAN_TICKS, far, far);
        let velocity = CountsPerSecond(along.0 * down);
        let travel = Fixed::short(velocity.0 * TICK_S);
        Trajectory {
            follow: Follow::Setpoint,
            window,
            velocity,
            along,
            advance: along.per_tick(),
            travel,
            ..Trajectory::COAST
        }
    }

    /// Times that the path has begun anew.
    pub fn begun(&self) -> u32 {
        self.begun
    }

    /// Begins anew at a set point of the head's axis, where the others are; a retreat past the beginning leads to `top`.
    pub fn restart(&mut self, here: Fixed, top: Fixed) {
        let [_, x, y] = self.path.setpoint();
        self.path.restart([here, x, y], [top.min(here), x, y]);
        self.begun = self.begun.wrapping_add(1);
        self.limiter.stop();
        self.work = None;
    }

    /// Appends a straight line.
    pub fn push_line(&mut self, to: Fixed) -> Result<(), Refused> {
        let [_, x, y] = self.path.end();
        self.path.push_line([to, x, y])
    }

    /// Appends a piece.
    pub fn append(&mut self, piece: &Piece) -> Result<(), Refused> {
        self.path.append(piece)
    }

    /// How far up and down a piece leads the head, nm.
    pub fn extent(&self, piece: &Piece) -> Result<(i64, i64), Refused> {
        self.path.extent(piece)
    }

    /// Where the last segment ends, nm.
    pub fn end_nm(&self) -> [i64; AXES] {
        self.path.end_nm()
    }

    /// Set points of X and Y, um.
    pub fn beside(&self) -> [Fixed; 2] {
        let [_, x, y] = self.path.setpoint();
        [x, y]
    }

    /// What has ended a working retreat: the newest since it was forgotten.
    pub fn ended(&self) -> Option<Bound> {
        self.ended
    }

    /// Nothing is left to retrace, and that is not for a mark, in front of which more waits.
    pub fn is_exhausted(&self) -> bool {
        self.at_beginning() && !(self.path.is_bounded() && self.path.bound() == Bound::Mark)
    }

    /// Other axes go along.
    pub fn leads_beside(&self) -> bool {
        self.path.leads_beside()
    }

    /// Forgets what has ended the retreats before.
    pub fn forget_bound(&mut self) {
        self.ended = None;
    }

    /// Goes back to a coordinate while the axis is elsewhere, or as far as a retreat may.
    pub fn go_back_to(&mut self, s: Fixed) {
        let back = s.minus(self.path.s());
        if back.0 < 0 {
            self.path.step(back);
        }
    }

    /// How far a retreat may go behind the furthest point.
    pub fn set_retreat(&mut self, retreat: Fixed) {
        self.path.set_retreat(retreat);
    }

    /// A retreat may go as far as there is path.
    pub fn free_retreat(&mut self) {
        self.path.free_retreat();
    }

    /// The work has been found here, unless it was found before. Whether that is new.
    pub fn found_work(&mut self) -> bool {
        let new = self.work.is_none();
        self.work = self.work.or(Some(self.path.s()));
        new
    }

    /// Path coordinate of the work; of the beginning before it was found.
    pub fn work(&self) -> Fixed {
        self.work.unwrap_or(Fixed(0))
    }

    /// Path coordinate, um.
    pub fn s(&self) -> Fixed {
        self.path.s()
    }

    /// Set point there, counts.
    pub fn setpoint(&self) -> Fixed {
        let [setpoint, ..] = self.path.setpoint();
        setpoint
    }

    /// Where the last segment ends, counts.
    pub fn end(&self) -> Fixed {
        let [end, ..] = self.path.end();
        end
    }

    pub fn at_end(&self) -> bool {
        self.path.at_end()
    }

    /// Whether a stop on the path is reached.
    pub fn at_stop(&self) -> bool {
        self.path.at_stop()
    }

    /// The stop that is reached is over.
    pub fn pass_stop(&mut self) {
        self.path.pass_stop();
    }

    /// The head has never been farther.
    pub fn is_at_front(&self) -> bool {
        self.path.is_at_front()
    }

    /// Nothing is left to retrace.
    pub fn at_beginning(&self) -> bool {
        self.path.left_behind().0 <= 0.0
    }

    pub fn waiting(&self) -> u16 {
        self.path.waiting() as u16
    }

    /// A velocity along the path, inside acceleration and stopping distance.
    pub fn along(&mut self, wanted: MicrometresPerSecond, bounds: &Bounds, window: Window) -> Trajectory {
        let along = self.limited(wanted, bounds);
        self.trajectory(along, window)
    }

    /// The same, prepared for later: nothing is remembered of it.
    pub fn ready(&self, wanted: MicrometresPerSecond, bounds: &Bounds, window: Window) -> Trajectory {
        let mut limiter = self.limiter;
        let along = limit(&mut limiter, &self.path, wanted, &Bounds { ticks: PLAN_TICKS, ..*bounds });
        self.trajectory(along, window)
    }

    /// A velocity of the axis as the path has it at this place, without a position loop.
    pub fn velocity(&mut self, wanted: MicrometresPerSecond, bounds: &Bounds, window: Window) -> Trajectory {
        let [direction, ..] = self.path.direction();
        let along = self.limited(wanted, bounds);
        Trajectory { along, ..Trajectory::velocity(CountsPerSecond(along.0 * direction), window) }
    }

    /// The head stands, or moves off the path.
    pub fn stop(&mut self) {
        self.limiter.stop();
    }

    /// Without a position loop the path coordinate follows the axis, so that closing the loop makes no jump.
    pub fn follow_axis(&mut self, at: Fixed) {
        // Others would go along, while the head is pushed or falls.
        if self.path.leads_beside() {
            return;
        }
        let [direction, ..] = self.path.direction();
        if direction != 0.0 {
            let off = at.minus(self.setpoint()).to_f32();
            self.path.step(Fixed::short(off / direction));
        }
    }

    fn limited(&mut self, wanted: MicrometresPerSecond, bounds: &Bounds) -> MicrometresPerSecond {
        limit(&mut self.limiter, &self.path, wanted, bounds)
    }

    fn trajectory(&self, along: MicrometresPerSecond, window: Window) -> Trajectory {
        // One step of 2^-24 um more, so that the last one reaches the end, where the path holds it.
        let more = i64::from(along.0 > 0.0) - i64::from(along.0 < 0.0);
        let advance = along.per_tick().near(Fixed(more));
        let [travel, ..] = self.path.travel(advance);
        let [direction, ..] = self.path.direction();
        let velocity = CountsPerSecond(along.0 * direction);
        Trajectory { follow: Follow::Setpoint, window, velocity, along, advance, travel, ..Trajectory::COAST }
    }
}

/// An open upper limit is never run into.
fn limit(limiter: &mut Limiter, path: &Path, wanted: MicrometresPerSecond, bounds: &Bounds) -> MicrometresPerSecond {
    let wanted = if bounds.upper_limit { MicrometresPerSecond(larger(wanted.0, 0.0)) } else { wanted };
    let a = bounds.acceleration;
    limiter.limit(wanted, bounds.acceleration, bounds.ticks, || path.ahead(a), || path.behind(a))
}

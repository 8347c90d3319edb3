//! Follow: every servo tick continues the trajectory in force, and acts at once on what is urgent.
//!
//! The [`Follower`] runs at the servo tick and the [`Planner`](super::Planner) below it, so neither waits for the other:
//!
//! ```text
//! tick       T                 T+1               T+2 = T + LEAD            T+5 = T + PLAN_TICKS, or CALM_TICKS
//! follow     hands over an     follows           the plan of T comes       hands over the next estimate
//!            estimate                            into force
//! plan                 plans: some 20 us
//! ```
//!
//! A plan that is not there when its tick has come is *late*: the trajectory continues in a straight line, and when that lasts
//! the head coasts. Something urgent (a short, a safety input, a reported fault, a set point released by SYNC) is acted on in its
//! own tick, by what the plan in force has made ready for it; the plan under way, which does not know of it, is discarded by its
//! *generation*, and an estimate is handed over in the same tick.
//!
//! Between two plans the set point moves in a straight line, at the velocity of the plan and in the direction of the
//! segment under way. The next plan sets it back on the path, from which it can have departed only at a joint.

use super::estimate::{Estimate, Estimator};
use super::plan::{Plan, Touch};
use super::probe::{Here, Probes};
use super::supervise::Measured;
use super::tick::{SetPoint, TickInput, TickOutput};
use super::trajectory::{Follow, Trajectory};
use super::{Fault, positioning};
use crate::encoder::Mark;
use crate::gap::{GapReading, Quality};
use crate::kept::{Kept, parts};
use crate::servo::{AxisLoop, Gains, Output, Pid, PidGains};
use crate::units::{
    CountsPerSecond, Fixed, MicrometresPerSecond, PLAN_TICKS, TICK_HZ, TICK_S, TICKS_PER_MS, Volts, rare, smaller,
    within, within_either,
};
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::safety::SafetyInputs;

/// Ticks from an estimate to the plan that is made of it coming into force.
pub const LEAD: u32 = 2;
/// Late plans in a row that are a fault: 1 ms.
const LATE: u32 = TICKS_PER_MS / PLAN_TICKS;

/// A head that the encoder shows rising faster than this may be braked, counts/s. Below, an edge is a millisecond old: a dead
/// encoder shows its last velocity no longer.
const RISING: f32 = -1000.0;

/// What the follower runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowConfig {
    /// Gains of the cascade.
    pub gains: Gains,
    /// Gains of the loop without a cascade, duty per volt.
    pub single: PidGains,
    /// The encoder counts down toward the work.
    pub encoder_reversed: bool,
    /// A positive duty moves away from the work.
    pub motor_reversed: bool,
    /// Ticks of uninterrupted short before the retreat begins.
    pub trigger: u32,
}

parts!(it: FollowConfig { gains, single, encoder_reversed, motor_reversed, trigger } by
    [it.gains],
    [it.single],
    [it.encoder_reversed, it.motor_reversed, it.trigger],
);

/// The part of a head that runs in every servo tick.
#[derive(Debug)]
pub struct Follower {
    config: FollowConfig,
    kept: Kept<FollowConfig>,
    /// [`Drive::FULL`], negative for a reversed motor.
    full: f32,
    estimator: Estimator,
    axis: AxisLoop,
    single: Pid,
    following: f32,
    duty: f32,
    saturated: bool,
    tick: u32,
    /// In force: what is followed, path coordinate and set point are those of the newest tick.
    plan: Plan,
    /// Of the newest estimate; the tick in which its plan comes into force, if it is awaited; the next estimate's.
    generation: u32,
    due: Option<u32>,
    next: u32,
    /// Plans that were late: since the start, and in a row.
    late: u32,
    in_a_row: u32,
    /// Somebody wants something of the planner, which is at work.
    asked: bool,
    /// That, or an unsafe input in the tick before.
    attentive: bool,
    /// For the estimate of this tick.
    short: bool,
    /// Where the newest retreat that was an escape has left the path.
    left: Option<Fixed>,
    reported: Option<Fault>,
    doubt: Option<Fault>,
    set_point: Option<SetPoint>,
    /// The same in the estimate before: what a late planner has not read is said again.
    said: (bool, [Option<Fault>; 2], Option<SetPoint>),
    /// Safety inputs of the tick before.
    safety: SafetyInputs,
    probes: Probes,
}

impl Follower {
    /// A disabled head.
    #[inline(always)]
    pub fn new(config: FollowConfig) -> Follower {
        Follower {
            config,
            kept: Kept::NEW,
            full: full(&config),
            estimator: Estimator::new(config.encoder_reversed),
            axis: AxisLoop::default(),
            single: Pid::default(),
            following: 0.0,
            duty: 0.0,
            saturated: false,
            tick: 0,
            plan: Plan::DISABLED,
            generation: 0,
            due: None,
            next: 1,
            late: 0,
            in_a_row: 0,
            asked: false,
            attentive: false,
            short: false,
            left: None,
            reported: None,
            doubt: None,
            set_point: None,
            said: (false, [None; 2], None),
            safety: SafetyInputs::default(),
            probes: Probes::default(),
        }
    }

    /// Runs another configuration. The loop keeps its integrator, which is a duty: no bump.
    pub fn configure(&mut self, config: &FollowConfig) {
        self.estimator.wire(config.encoder_reversed);
        self.full = full(config);
        self.config = *config;
        self.kept = Kept::NEW;
    }

    /// Looks at a part of the configuration: false once it has changed by itself.
    #[inline]
    pub fn is_intact(&mut self) -> bool {
        self.kept.agrees(&self.config)
    }

    /// Whether the next tick wants the gap voltage.
    #[inline]
    pub fn wants_gap(&self) -> bool {
        self.plan.trajectory.follow == Follow::Gap
    }

    /// Whether the next tick wants to know of the sources of the touch probes.
    #[inline]
    pub fn probes(&self) -> bool {
        self.plan.probes.on
    }

    /// Number of the newest tick, wrapping.
    pub fn number(&self) -> u32 {
        self.tick
    }

    /// Whether the next tick is neither to hand over nor to begin, unless something urgent comes.
    pub fn is_next_plain(&self) -> bool {
        let tick = self.tick.wrapping_add(1);
        self.next != tick && self.due != Some(tick)
    }

    /// Measured position, counts.
    pub fn position(&self) -> i64 {
        self.estimator.position()
    }

    /// Measured velocity.
    pub fn velocity(&self) -> CountsPerSecond {
        self.estimator.velocity()
    }

    /// Set point less position, counts.
    pub fn following(&self) -> f32 {
        self.following
    }

    /// Duty of the newest tick, positive toward the work.
    pub fn duty(&self) -> f32 {
        self.duty
    }

    /// It is at its limit.
    pub fn is_saturated(&self) -> bool {
        self.saturated
    }

    /// Code of the motor current above mid-scale.
    pub fn current_code(&self) -> i32 {
        self.estimator.sums().newest
    }

    /// A short that is a reason to retreat: by the reflex, or by its duration.
    #[inline]
    pub fn is_shorted(&self, input: &TickInput) -> bool {
        input.reflex | (input.short_ticks >= self.config.trigger)
    }

    /// What is in force.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// What is followed.
    pub fn trajectory(&self) -> &Trajectory {
        &self.plan.trajectory
    }

    /// One servo tick. `planned` gives the plan of an estimate, if it is there.
    #[inline]
    pub fn tick<'a>(&mut self, input: &TickInput, planned: impl FnOnce(u32) -> Option<&'a Plan>) -> TickOutput {
        self.tick = self.tick.wrapping_add(1);
        let mut begins = false;
        if self.due.is_some_and(|due| due == self.tick) {
            self.due = None;
            begins = true;
            match planned(self.generation) {
                Some(plan) => {
                    self.begin(plan);
                    if self.plan.trajectory.follow != Follow::Setpoint {
                        self.following = 0.0;
                    }
                }
                None => self.miss(),
            }
        }
        self.estimator.tick(&input.encoder, input.drive);
        if self.plan.probes.on {
            self.probe(input);
        }
        let mut hands_over = self.tick == self.next;
        // One test for a tick in which there is nothing.
        let shorted = self.is_shorted(input);
        if shorted | input.touches | input.asked | input.safety.is_some() | self.attentive {
            hands_over |= self.is_urgent(input, shorted);
        }
        let drive = self.follow(input.gap);
        if hands_over {
            self.generation = self.generation.wrapping_add(1);
            self.due = Some(self.tick.wrapping_add(LEAD));
            self.next = self.tick.wrapping_add(PLAN_TICKS);
        }
        TickOutput { drive, pulses: self.plan.pulses, hands_over, begins }
    }

    /// A plan comes into force.
    #[inline(never)]
    fn begin(&mut self, plan: &Plan) {
        if plan.resets != self.plan.resets {
            self.axis.reset();
            self.single.reset();
        }
        if plan.offset != self.plan.offset {
            let by = plan.offset.wrapping_sub(self.plan.offset);
            self.estimator.shift(by);
            self.probes.shift(by);
        }
        if plan.probes.on | self.plan.probes.on {
            self.probes.want(&plan.probes);
        }
        self.plan = *plan;
        self.next = self.tick.wrapping_sub(LEAD).wrapping_add(plan.ticks);
        self.in_a_row = 0;
    }

    /// The touch probes look.
    #[cold]
    #[inline(never)]
    fn probe(&mut self, input: &TickInput) {
        let here = Here {
            tick: self.tick,
            position: self.estimator.position(),
            marked: self.estimator.position_at(input.sight.mark.count),
            pulses: self.plan.pulses,
            touches: input.touches,
        };
        self.probes.tick(&self.plan.probes, &input.sight, &here);
    }

    /// The plan of this tick is not there.
    #[cold]
    fn miss(&mut self) {
        self.late = self.late.wrapping_add(1);
        self.in_a_row = self.in_a_row.saturating_add(1);
        if self.in_a_row >= LATE {
            self.fault(Fault::PlanLate);
            self.report_fault(Fault::PlanLate);
        }
    }

    /// Whether there is more than a short, or a contact, that the state does not care for, and it is urgent.
    #[cold]
    fn is_urgent(&mut self, input: &TickInput, shorted: bool) -> bool {
        let touches = input.touches && self.plan.touch != Touch::Ignored;
        let concerns = (shorted && self.plan.retreat.is_some()) | touches;
        (concerns | input.asked | input.safety.is_some() | self.attentive) && self.urgent(input, shorted)
    }

    /// Whether what has come cannot wait for the next estimate.
    fn urgent(&mut self, input: &TickInput, shorted: bool) -> bool {
        let mut urgent = false;
        if let Some(fault) = input.reported {
            self.fault(fault);
            self.report_fault(fault);
            urgent = true;
        }
        let safety = input.safety.unwrap_or_default();
        if safety != self.safety {
            self.safety = safety;
            urgent = true;
        }
        if let Some(fault) = self.plan.hazards.hazard(&safety) {
            urgent |= self.fault(fault);
        }
        if shorted && let Some(retreat) = self.plan.retreat.take() {
            self.left = self.plan.escapes.then_some(self.plan.path);
            self.plan.trajectory = retreat;
            self.plan.set_points = false;
            self.short = true;
            urgent = true;
        }
        if input.touches && self.plan.trajectory.velocity.0 > 0.0 {
            urgent |= self.touch();
        }
        if let Some(point) = input.set_point {
            if self.plan.set_points {
                self.follow_to(point);
            }
            self.set_point = Some(point);
            urgent = true;
        }
        // Whoever asks is not that urgent: a plan under way is not discarded for it.
        self.asked |= input.asked;
        let asks = self.asked && self.due.is_none();
        self.asked &= !(asks | urgent);
        self.attentive = self.asked | input.safety.is_some();
        urgent | asks
    }

    /// Acts on a fault; whether that is more than what is done already.
    fn fault(&mut self, fault: Fault) -> bool {
        let Some((reaction, trajectory)) = self.plan.answer(fault) else { return false };
        self.plan.reaction = Some(reaction);
        self.plan.fault = Some(fault);
        self.plan.pulses = false;
        self.plan.retreat = None;
        self.plan.set_points = false;
        self.plan.closed &= trajectory.follow == Follow::Setpoint;
        self.plan.trajectory = trajectory;
        self.axis.reset();
        true
    }

    /// The next estimate reports a fault, or a stronger one; and one that casts doubt on the encoder, which a stronger one must
    /// not hide.
    fn report_fault(&mut self, fault: Fault) {
        if fault.doubts_encoder() && self.doubt != Some(Fault::EncoderLost) {
            self.doubt = Some(fault);
        }
        if self.reported.is_none_or(|reported| reported.reaction() < fault.reaction()) {
            self.reported = Some(fault);
        }
    }

    /// Electrode and work touch: nothing presses on from this tick on.
    fn touch(&mut self) -> bool {
        match core::mem::take(&mut self.plan.touch) {
            Touch::Ignored => return false,
            Touch::Fault => {
                self.fault(Fault::Contact);
                self.report_fault(Fault::Contact);
            }
            Touch::End => {
                self.plan.trajectory = self.plan.stop;
                self.plan.set_points = false;
                self.short = true;
                self.axis.reset();
            }
        }
        (self.plan.trajectory.velocity, self.plan.trajectory.travel) = (CountsPerSecond(0.0), Fixed(0));
        true
    }

    /// The set point of a SYNC, from this tick on.
    fn follow_to(&mut self, point: SetPoint) {
        // This tick goes on along it already.
        let before = self.tick.wrapping_sub(1);
        let due = positioning::due(self.plan.due, before, point.ticks);
        let left = positioning::until(due, before).max(PLAN_TICKS);
        let distance = point.counts.minus(self.plan.setpoint).to_f32();
        let limit = self.config.gains.velocity_limit().0;
        let velocity = within_either(distance / left as f32 * TICK_HZ as f32, limit);
        let (now, slew) = (self.plan.trajectory.velocity.0, self.plan.slew.0);
        let velocity = smaller(within(velocity, now - slew, now + slew), self.plan.toward.0);
        self.plan.trajectory.velocity = CountsPerSecond(velocity);
        self.plan.trajectory.travel = Fixed::short(velocity * TICK_S);
        (self.plan.trajectory.advance, self.plan.trajectory.along) = (Fixed(0), MicrometresPerSecond(0.0));
    }

    /// Carries the trajectory out for one tick.
    #[inline]
    fn follow(&mut self, gap: Option<Volts>) -> Drive {
        let (plan, gains) = (&mut self.plan, &self.config.gains);
        let trajectory = &plan.trajectory;
        let velocity = self.estimator.velocity();
        let duty = if trajectory.follow == Follow::Setpoint {
            plan.path = plan.path.near(trajectory.advance);
            plan.setpoint = plan.setpoint.near(trajectory.travel);
            self.following = plan.setpoint.from(self.estimator.at());
            let mut window = trajectory.window;
            if trajectory.upward {
                rare();
                if velocity.0 >= RISING {
                    window.high = smaller(window.high, gains.holding());
                }
            }
            self.axis.follow(gains, self.following, trajectory.velocity, trajectory.duty, velocity, window)
        } else {
            rare();
            match trajectory.follow {
                Follow::Nothing | Follow::Setpoint => {
                    (self.duty, self.saturated) = (0.0, false);
                    self.axis.reset();
                    return Drive::Coast;
                }
                Follow::Velocity => self.axis.run(gains, trajectory.velocity, velocity, trajectory.window),
                Follow::Duty => Output::new(trajectory.duty, trajectory.window),
                Follow::Gap => {
                    // What is not valid is no reason to move.
                    let error = gap.map_or(0.0, |gap| gap.0 - trajectory.gap.0);
                    self.single.update(&self.config.single, error, gains.holding(), trajectory.window)
                }
            }
        };
        self.duty = duty.value;
        self.saturated = duty.limited;
        // A duty is a share: it fits.
        let code = (duty.value * self.full) as i32;
        self.estimator.applied(code);
        Drive::Duty(code as i16)
    }

    /// The estimate before was not read, and is overwritten by that of this tick.
    #[cold]
    pub fn unread(&mut self) {
        let (short, faults, set_point) = self.said;
        self.short |= short;
        faults.into_iter().flatten().for_each(|fault| self.report_fault(fault));
        self.set_point = self.set_point.or(set_point);
    }

    /// Writes the estimate of this tick, which has wanted to hand one over; `quality` is that of the reading now.
    #[inline(never)]
    pub fn estimate(&mut self, to: &mut Estimate, reading: &GapReading, quality: Quality, newest: &Mark) {
        // One field after the other: a whole estimate would be put together beside it, and copied.
        let Estimate {
            generation,
            tick,
            path,
            setpoint,
            path_then,
            segment,
            along,
            position,
            offset,
            paths,
            velocity,
            following,
            duty,
            saturated,
            gap,
            mark,
            marked,
            probes,
            safety,
            short,
            left,
            reported,
            doubt,
            set_point,
            late,
        } = to;
        *generation = self.generation;
        *tick = self.tick;
        *path = self.plan.path;
        *setpoint = self.plan.setpoint;
        // The tick that brings the plan goes on along the trajectory already.
        let later = |fixed: Fixed| Fixed(fixed.0.wrapping_mul((LEAD - 1).into()));
        *path_then = self.plan.path.near(later(self.plan.trajectory.advance));
        segment.from = self.plan.setpoint.near(later(self.plan.trajectory.travel));
        segment.travel = self.plan.trajectory.travel;
        let follows = self.plan.trajectory.follow == Follow::Setpoint;
        segment.velocity = if follows { self.plan.trajectory.velocity } else { CountsPerSecond(0.0) };
        *along = self.plan.trajectory.along;
        *position = self.estimator.position();
        *offset = self.plan.offset;
        *paths = self.plan.paths;
        *velocity = self.estimator.velocity();
        *following = self.following;
        *duty = self.duty;
        *saturated = self.saturated;
        *gap = GapReading { quality, ..*reading };
        *mark = *newest;
        *marked = if self.plan.homes { self.estimator.position_at(newest.count) } else { 0 };
        *probes = *self.probes.latched();
        *safety = self.safety;
        *short = core::mem::take(&mut self.short);
        *left = if *short { self.left } else { None };
        *reported = self.reported.take();
        *doubt = self.doubt.take();
        // Not taken: it would be put together beside both, and copied.
        *set_point = self.set_point;
        self.set_point = None;
        self.said = (*short, [*reported, *doubt], *set_point);
        *late = self.late;
    }

    /// Writes what the supervision judges.
    #[inline(never)]
    pub fn measured(&self, to: &mut Measured, input: &TickInput, reading: &GapReading, quality: Quality) {
        *to = Measured {
            tick: self.tick,
            state: self.plan.state,
            closed: self.plan.closed,
            rests: self.plan.trajectory.follow == Follow::Setpoint && self.plan.trajectory.travel == Fixed(0),
            free: self.plan.free,
            open: self.plan.open,
            homes: self.plan.homes,
            pulses: self.plan.pulses && self.plan.state.pulses(),
            trusts: self.plan.trusts,
            following: self.following,
            velocity: self.estimator.velocity(),
            duty: self.duty,
            saturated: self.saturated,
            quality,
            code: reading.code,
            counts: reading.pulses,
            permitted: self.plan.pulses,
            short: input.short_ticks >= TICKS_PER_MS,
            sums: *self.estimator.sums(),
            bus: input.drive.bus_voltage,
        };
    }

    /// What is measured and followed, for a report of every tick.
    pub fn report(&self, status: &mut super::Status) {
        status.tick = self.tick;
        status.position = self.estimator.position();
        status.velocity = self.estimator.velocity();
        status.setpoint = self.plan.setpoint;
        status.following = self.following;
        status.path = self.plan.path;
        status.duty = self.duty;
        status.saturated = self.saturated;
    }
}

fn full(config: &FollowConfig) -> f32 {
    let full = f32::from(Drive::FULL);
    if config.motor_reversed { -full } else { full }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::head::Reaction;
    use crate::kept::Parts;
    use crate::settings::Settings;

    /// Ticks until an estimate is handed over, with `input` in the first; gives what it reports of short, fault and set point. Nobody
    /// has read the one before where it is `unread`.
    fn handed(follower: &mut Follower, unread: bool, input: TickInput) -> (bool, Option<Fault>, Option<SetPoint>) {
        let mut estimate = Estimate::default();
        let (mut input, quiet) = (input, TickInput::default());
        while !follower.tick(&input, |_| None).hands_over {
            input = quiet;
        }
        if unread {
            follower.unread();
        }
        follower.estimate(&mut estimate, &GapReading::default(), Quality::Valid, &Mark::default());
        (estimate.short, estimate.reported, estimate.set_point)
    }

    #[test]
    fn what_an_estimate_tells_is_told_again_until_somebody_has_read_it() {
        let reported = |fault| TickInput { reported: Some(fault), asked: true, ..TickInput::default() };
        let config = Settings::default().build().unwrap().head.follow();
        let mut follower = Follower::new(config);
        let point = |ticks| Some(SetPoint { ticks, ..SetPoint::default() });
        follower.plan.retreat = Some(Trajectory::COAST);
        let short = TickInput { set_point: point(20), reflex: true, ..TickInput::default() };
        assert_eq!(handed(&mut follower, false, TickInput { asked: true, ..short }), (true, None, point(20)));
        assert_eq!(
            handed(&mut follower, true, reported(Fault::OverCurrent)),
            (true, Some(Fault::OverCurrent), point(20))
        );
        // The stronger fault, the newer set point.
        assert!(Fault::HostSilent.reaction() < Fault::OverCurrent.reaction());
        let newer = TickInput { set_point: point(40), ..reported(Fault::HostSilent) };
        assert_eq!(handed(&mut follower, true, newer), (true, Some(Fault::OverCurrent), point(40)));
        // Read.
        assert_eq!(handed(&mut follower, false, TickInput::default()), (false, None, None));
    }

    #[test]
    fn of_two_faults_in_a_tick_the_stronger_is_told() {
        let mut follower = Follower::new(Settings::default().build().unwrap().head.follow());
        (0..LATE).for_each(|_| follower.miss());
        assert!(Fault::HostSilent.reaction() < Fault::PlanLate.reaction());
        let weaker = TickInput { reported: Some(Fault::HostSilent), ..TickInput::default() };
        assert_eq!(handed(&mut follower, false, weaker).1, Some(Fault::PlanLate));
    }

    #[test]
    fn a_doubt_in_the_encoder_is_told_beside_a_stronger_fault_until_somebody_has_read_it() {
        for fault in [Fault::EncoderLost, Fault::PolarityWrong, Fault::FollowingError] {
            let mut follower = Follower::new(Settings::default().build().unwrap().head.follow());
            let reported = TickInput { reported: Some(fault), asked: true, ..TickInput::default() };
            assert_eq!(handed(&mut follower, false, reported).1, Some(fault));
            let mut estimate = Estimate::default();
            for _ in 0..5 {
                (0..LATE).for_each(|_| follower.miss());
                follower.unread();
                follower.estimate(&mut estimate, &GapReading::default(), Quality::Valid, &Mark::default());
            }
            assert_eq!((estimate.reported.map(Fault::reaction), estimate.doubt), (Some(Reaction::Coast), Some(fault)));
        }
    }

    #[test]
    fn a_configuration_that_changes_by_itself_is_seen_and_one_that_is_given_is_not() {
        let config = Settings::default().build().unwrap().head.follow();
        let other = FollowConfig { trigger: config.trigger + 7, ..config };
        let mut follower = Follower::new(config);
        let looks = |follower: &mut Follower| (0..=FollowConfig::PARTS).filter(|_| !follower.is_intact()).count();
        assert_eq!(looks(&mut follower), 0);
        follower.configure(&other);
        assert_eq!(looks(&mut follower), 0);
        follower.config.trigger ^= 1 << 30;
        assert!(looks(&mut follower) > 0);
        follower.configure(&config);
        assert_eq!(looks(&mut follower), 0);
        follower.config.motor_reversed ^= true;
        assert!(looks(&mut follower) > 0);
    }
}

//! The modes: how set points become commands, and what bits 10, 12 and 13 of the statusword mean.
//!
//! Erosion is no mode of its own: while 2001h:1 is 1, the set points of profile position, cyclic synchronous position and
//! interpolated position become segments of the path, along which the gap leads. While it is 2 they are followed with pulses on,
//! and the host goes by the feed that the gap asks for.

use super::state::{control, halts, rises, status};
use super::{Drive, STANDING, SetPoint, codes};
use crate::canopen::objects::{Decoded, Item};
use crate::canopen::{Abort, Node, Time};
use crate::head::{self, Command, Guidance, Home, HomingState, MotionLimits, Refused};
use crate::motion::Method;
use crate::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres, TICK_HZ};
use heapless::Deque;

/// Set points that interpolated position can buffer: 60C4h:1.
const BUFFER: usize = 32;

/// Mode of operation. The number is that of 6060h.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Mode {
    /// None.
    #[default]
    None = 0,
    /// Profile position.
    ProfilePosition = 1,
    /// Profile velocity.
    ProfileVelocity = 3,
    /// Homing.
    Homing = 6,
    /// Interpolated position.
    Interpolated = 7,
    /// Cyclic synchronous position.
    CyclicPosition = 8,
    /// Cyclic synchronous velocity.
    CyclicVelocity = 9,
}

impl Mode {
    fn from_number(number: i64) -> Option<Mode> {
        Some(match number {
            0 => Mode::None,
            1 => Mode::ProfilePosition,
            3 => Mode::ProfileVelocity,
            6 => Mode::Homing,
            7 => Mode::Interpolated,
            8 => Mode::CyclicPosition,
            9 => Mode::CyclicVelocity,
            _ => return None,
        })
    }
}

/// Set points on their way.
#[derive(Clone, Debug, Default)]
pub struct SetPoints {
    /// Target under way, or reached.
    target: Option<i32>,
    /// Target to go to next.
    next: Option<i32>,
    /// Set-point acknowledge.
    acknowledged: bool,
    /// The newest was refused: the head is at no target.
    missed: bool,
    /// The head has not yet come to the target under way.
    moving: bool,
    /// Milliseconds within the window.
    within: u16,
    /// Homing was asked for and refused.
    homing_refused: bool,
    /// Homing was asked for in this mode.
    homing_asked: bool,
    /// A set point was cut off at a limit.
    pub(super) limited: bool,
    /// Erosion begins when the head has come to rest; then what was given last meanwhile.
    begins: bool,
    then: Option<i32>,
    buffer: Deque<i32, BUFFER>,
    /// Where the set points of cyclic synchronous velocity have led, nm times ticks in a second.
    led: Option<i64>,
    /// When the next set point is due.
    due: Option<Time>,
}

impl SetPoints {
    /// The head has been told to do something else.
    pub fn forget(&mut self) {
        self.next = None;
        (self.moving, self.missed) = (false, false);
        self.buffer.clear();
        (self.due, self.led) = (None, None);
        (self.begins, self.then) = (false, None);
    }

    /// The head will not home.
    pub fn refused_homing(&mut self) {
        self.homing_refused = true;
    }

    /// The head is not at its target and yet where it should be: it has touched the work, or was lifted out of it.
    pub fn clear_target(&mut self) {
        self.target = None;
    }

    /// Set points waiting.
    pub fn waiting(&self) -> u16 {
        self.buffer.len() as u16
    }
}

impl Drive {
    /// 6060h.
    pub(super) fn set_mode(&mut self, number: i64) -> Result<(), Abort> {
        let mode = Mode::from_number(number).ok_or(Abort::InvalidValue)?;
        if mode == Mode::Homing && self.refuses_homing().is_some() {
            return Err(Abort::DeviceState);
        }
        if mode != self.mode {
            let begins = self.set_points.begins;
            if self.acts() && (self.mode != Mode::None || self.status.state == head::State::Touching) {
                // Pulses stop with the mode that wanted them.
                if self.status.state.works() {
                    self.set(Item::ErodeEnable, 0);
                }
                self.halt();
            }
            self.mode = mode;
            self.set_points = SetPoints::default();
            self.enter_mode();
            // Set points of the new mode wait until the axis stands.
            let waits = self.erodes() && self.status.state == head::State::Positioning;
            self.set_points.begins = self.moves() && mode != Mode::ProfileVelocity && (begins || waits);
        }
        Ok(())
    }

    /// The mode begins to act, or goes on.
    pub(super) fn enter_mode(&mut self) {
        self.set_points.forget();
        if !self.moves() {
            return;
        }
        match self.mode {
            Mode::ProfileVelocity => self.run(),
            // A host that has said nothing yet wants no motion.
            Mode::CyclicPosition => self.set(Item::TargetPosition, self.position()),
            Mode::CyclicVelocity => self.set(Item::TargetVelocity, 0),
            _ => {}
        }
    }

    /// The bits of the controlword that belong to the mode.
    pub(super) fn mode_word(&mut self, before: u16, word: u16) {
        if !self.acts() {
            return;
        }
        let starts = rises(before, word, control::START);
        let ends = rises(word, before, control::START);
        if rises(before, word, control::HALT) {
            // The target stays, to be gone on with.
            let target = self.set_points.target;
            self.halt();
            self.set_points.target = target;
            return;
        }
        if rises(word, before, control::HALT) {
            match (self.mode, self.set_points.target) {
                (Mode::ProfilePosition, Some(target)) if !starts => self.go(target),
                (Mode::ProfileVelocity, _) => self.run(),
                _ => {}
            }
        }
        match self.mode {
            Mode::ProfilePosition if starts => self.new_set_point(word),
            Mode::ProfilePosition if word & control::START == 0 => {
                self.set_points.acknowledged &= self.set_points.next.is_some();
            }
            Mode::Homing if starts => self.home(),
            Mode::Homing if ends && self.is_homing() => self.brake(Item::ProfileDeceleration),
            Mode::Interpolated if starts && self.erodes() => {
                self.command(Command::Start);
            }
            Mode::Interpolated if ends => self.halt(),
            _ => {}
        }
    }

    /// Profile position: a new set-point.
    fn new_set_point(&mut self, word: u16) {
        if self.set_points.next.is_some() {
            return;
        }
        if self.status.state == head::State::Touching {
            self.refuses(codes::refused(Refused::State(self.status.state)));
            self.set_points.missed = true;
            return;
        }
        let given = self.value(Item::TargetPosition);
        let target = if word & control::RELATIVE != 0 {
            let from = match (self.value(Item::PositioningOption), self.set_points.target) {
                (0, Some(target)) => target,
                (1, _) => self.host_position(self.status.setpoint.round()),
                _ => self.position(),
            };
            from.saturating_add(given)
        } else {
            given
        };
        (self.set_points.acknowledged, self.set_points.missed) = (true, false);
        if self.set_points.moving && word & control::IMMEDIATELY == 0 && !self.erodes() {
            self.set_points.next = Some(target);
        } else if !halts(word) {
            self.go(target);
        } else {
            self.set_points.target = Some(target);
        }
    }

    /// Goes to a target.
    fn go(&mut self, target: i32) {
        let target = self.within_limits(target);
        self.set_points.target = Some(target);
        self.set_points.within = 0;
        let sent = if self.erodes() {
            self.erode_to(target)
        } else {
            let limits = self.motion_limits(self.value(Item::ProfileVelocity));
            let to = self.place(target);
            // With pulses on a contact is a short.
            let touches = self.value(Item::Touch) == 1 && !self.guides();
            self.command(if touches { Command::Touch(to, limits) } else { Command::Position(to, limits) })
        };
        self.set_points.moving = sent;
    }

    /// Appends to the path, and goes along it.
    fn erode_to(&mut self, target: i32) -> bool {
        if self.set_points.begins {
            self.set_points.then = Some(target);
            return true;
        }
        self.command(Command::MoveTo(self.place(target))) && self.command(Command::Start)
    }

    /// Profile velocity: toward the limit of its direction.
    fn run(&mut self) {
        let velocity = self.value(Item::TargetVelocity);
        (self.set_points.within, self.set_points.begins) = (0, false);
        if velocity == 0 {
            self.brake(Item::ProfileDeceleration);
            return;
        }
        let (low, high) = self.limits();
        let target = if velocity > 0 { high } else { low };
        let limits = self.motion_limits(velocity.saturating_abs());
        self.command(Command::Position(self.place(target), limits));
    }

    /// Why no reference may be looked for, as far as the drive knows: set points become path, or pulses are on.
    fn refuses_homing(&self) -> Option<Refused> {
        if self.status.state.works() {
            return Some(Refused::State(self.status.state));
        }
        (self.value(Item::ErodeEnable) != 0).then_some(Refused::PathActive)
    }

    /// Homing starts.
    fn home(&mut self) {
        self.set_points.homing_asked = true;
        self.set_points.homing_refused = false;
        if let Some(refused) = self.refuses_homing() {
            self.refuses(codes::refused(refused));
            self.set_points.homing_refused = true;
            return;
        }
        let Some(method) = Method::from_number(self.value(Item::HomingMethod) as i8) else {
            self.set_points.homing_refused = true;
            return;
        };
        let home = Home {
            method,
            fast: self.velocity(self.value(Item::HomingFast)),
            slow: self.velocity(self.value(Item::HomingSlow)),
            acceleration: self.acceleration(Item::HomingAcceleration),
            at: self.nanometres(self.value(Item::HomeOffset).saturating_neg()),
        };
        // A new reference begins where the axis is at rest.
        self.command(Command::Home(home));
    }

    /// Set points are followed with pulses on.
    pub(super) fn guides(&self) -> bool {
        self.value(Item::ErodeEnable) == 2
    }

    /// 607Ah has been written.
    pub(super) fn target_written(&mut self, target: i32) -> Result<(), Abort> {
        if self.mode != Mode::CyclicPosition || !self.moves() {
            return Ok(());
        }
        let target = self.within_limits(target);
        self.set_points.target = Some(target);
        if self.erodes() {
            return if self.erode_to(target) { Ok(()) } else { Err(Abort::DeviceState) };
        }
        self.follow_to(target);
        Ok(())
    }

    fn follow_to(&mut self, target: i32) {
        self.fresh = false;
        self.follow = Some(self.following(target));
    }

    fn following(&self, target: i32) -> SetPoint {
        SetPoint { to: self.place(target), ticks: self.period() }
    }

    /// What the next SYNC makes of 607Ah.
    pub(super) fn set_point_at_sync(&self, node: &Node) -> Option<SetPoint> {
        const TARGET: Decoded = Decoded::Row(Item::TargetPosition as u16);
        if self.mode != Mode::CyclicPosition || !self.moves() || self.erodes() {
            return None;
        }
        let target = i32::from_le_bytes(node.ahead(TARGET.place(), self)?);
        Some(self.following(self.clamped(target)))
    }

    /// Whether 60FFh may be written: it would be followed, and not while the head works.
    pub(super) fn may_run(&self, changes: bool) -> Result<(), Abort> {
        let set_point = changes && self.mode == Mode::ProfileVelocity || self.mode == Mode::CyclicVelocity;
        let runs = set_point && self.moves();
        if runs && self.status.state.works() && !self.guides() { Err(Abort::DeviceState) } else { Ok(()) }
    }

    /// 60FFh has been written.
    pub(super) fn velocity_written(&mut self, before: i32) {
        match self.mode {
            _ if !self.moves() => {}
            Mode::ProfileVelocity if before != self.value(Item::TargetVelocity) => self.run(),
            Mode::CyclicVelocity => self.follow_velocity(),
            _ => {}
        }
    }

    /// Cyclic synchronous velocity: a set point as far on as it leads in a period.
    fn follow_velocity(&mut self) {
        let velocity = self.value(Item::TargetVelocity).saturating_add(self.value(Item::VelocityOffset));
        let (nm_per_count, second) = (self.active.head.axis.nm_per_count, i64::from(TICK_HZ));
        let (ticks, (low, high)) = (self.period(), self.limits());
        let here = self.status.setpoint.round().saturating_mul(nm_per_count).saturating_mul(second);
        let way = i64::from(velocity).saturating_mul(nm_per_count).saturating_mul(ticks.into());
        let wanted = self.set_points.led.unwrap_or(here).saturating_add(way);
        let bound = |counts: i32| self.place(counts).0.saturating_mul(second);
        let led = wanted.max(bound(low)).min(bound(high));
        (self.set_points.limited, self.set_points.led) = (led != wanted, Some(led));
        self.fresh = false;
        self.follow = Some(SetPoint { to: Nanometres(led.wrapping_div(second)), ticks });
    }

    /// 60C1h:1 has been written.
    pub(super) fn data_written(&mut self, target: i32) -> Result<(), Abort> {
        if self.mode != Mode::Interpolated {
            return Ok(());
        }
        let target = self.within_limits(target);
        if self.erodes() && self.acts() {
            let sent =
                !self.set_points.begins && self.queue_space() > 0 && self.command(Command::MoveTo(self.place(target)));
            if sent && self.control & control::START != 0 {
                self.command(Command::Start);
            }
            return if sent { Ok(()) } else { Err(Abort::DeviceState) };
        }
        self.set_points.buffer.push_back(target).map_err(|_| Abort::DeviceState)
    }

    /// Forgets the buffered set points.
    pub(super) fn clear_buffer(&mut self) {
        self.set_points.buffer.clear();
    }

    /// Whether 2001h:1 may be written: a host may guide only where set points are followed, and not out of an erosion.
    pub(super) fn may_erode(&self, enable: i64) -> Result<(), Abort> {
        let followed = !matches!(self.mode, Mode::None | Mode::ProfileVelocity | Mode::Homing)
            && !self.is_homing()
            && self.status.state != head::State::Touching;
        let erodes = self.erodes() && self.status.state.works();
        if enable == 2 && !self.guides() && (!self.moves() || !followed || erodes) {
            return Err(Abort::DeviceState);
        }
        Ok(())
    }

    /// 2001h:1 has been written.
    pub(super) fn erode_written(&mut self, before: i32) {
        let enable = self.value(Item::ErodeEnable);
        let works = self.status.state.works();
        match enable {
            // Nothing to end.
            0 if before == 0 && !works => {}
            0 => {
                (self.follow, self.set_points.begins, self.set_points.then) = (None, false, None);
                if works || !self.fresh {
                    self.command(Command::Hold);
                }
            }
            1 => {
                let positions = matches!(self.status.state, head::State::Positioning | head::State::Touching);
                let positions = positions || self.follow.take().is_some();
                self.set_points.begins = self.moves() && (positions || before == 2);
                self.set_points.then = None;
                if self.set_points.begins {
                    self.command(Command::Hold);
                } else if self.moves() {
                    self.command(Command::Start);
                }
            }
            _ if before == 2 => {}
            _ => {
                (self.set_points.begins, self.set_points.then) = (false, None);
                self.command(Command::Guide);
            }
        }
    }

    /// 2001h:1 says that a host guides the head only while it does.
    pub(super) fn watch_guiding(&mut self) {
        if self.fresh && self.guides() && self.status.guidance == Guidance::No {
            self.set(Item::ErodeEnable, 0);
        }
    }

    /// Interpolated position: the next set point, when it is due.
    pub(super) fn interpolate(&mut self, now: Time) {
        let active = self.mode == Mode::Interpolated && self.moves() && self.control & control::START != 0;
        if !active || self.erodes() {
            self.set_points.due = None;
            return;
        }
        let due = *self.set_points.due.get_or_insert(now);
        if now < due {
            return;
        }
        if let Some(target) = self.set_points.buffer.pop_front() {
            let period = u64::from(self.period()).saturating_mul(1_000_000 / u64::from(TICK_HZ));
            self.set_points.due = Some(Time(due.0.saturating_add(period)));
            self.set_points.target = Some(target);
            self.follow_to(target);
        } else {
            self.set_points.due = None;
        }
    }

    /// What the status says of the set points, once a millisecond.
    pub(super) fn watch_mode(&mut self) {
        let state = self.status.state;
        let busy = match self.status.guidance {
            Guidance::No => state.works() || state.positions(),
            guidance => guidance != Guidance::Rests,
        };
        if self.fresh && !busy && self.set_points.moving {
            self.set_points.moving = false;
            if let Some(next) = self.set_points.next.take() {
                self.go(next);
                self.set_points.acknowledged = self.control & control::START != 0;
            }
        }
        if self.fresh && !busy && self.moves() && core::mem::take(&mut self.set_points.begins) {
            match (self.value(Item::ErodeEnable), self.set_points.then.take()) {
                (1, Some(target)) => self.erode_to(target),
                (1, None) => self.command(Command::Start),
                _ => false,
            };
        }
        let (inside, time) = match self.mode {
            Mode::ProfileVelocity => {
                let off = self.status.velocity.0 - self.value(Item::TargetVelocity) as f32;
                (off.abs() <= self.value(Item::VelocityWindow) as f32, Item::VelocityTime)
            }
            _ => {
                let target = self.set_points.target.unwrap_or(self.position());
                let off = i64::from(self.position()).saturating_sub(target.into()).saturating_abs();
                let inside = off <= i64::from(self.value(Item::PositionWindow) as u32);
                let stands = !self.set_points.moving && state != head::State::Touching;
                (inside && stands && self.fresh, Item::PositionTime)
            }
        };
        self.set_points.within = if inside { self.set_points.within.saturating_add(1) } else { 0 };
        if self.set_points.within > self.value(time) as u16 {
            // Stays so until the window is left.
            self.set_points.within = u16::MAX;
        }
    }

    /// Bits 10, 12 and 13 of the statusword.
    pub(super) fn mode_bits(&self) -> u16 {
        let bit = |bit: u16, set: bool| if set { bit } else { 0 };
        if !self.acts() && self.state != super::State::QuickStopActive {
            return 0;
        }
        let set_points = &self.set_points;
        let still = self.status.velocity.0.abs() < STANDING;
        let reached = if halts(self.control) { still } else { set_points.within == u16::MAX };
        let following = self.status.following.abs() > self.active.head.supervise.following;
        match self.mode {
            Mode::None => 0,
            Mode::ProfilePosition => {
                bit(status::REACHED, reached && !set_points.missed)
                    | bit(status::MODE_12, set_points.acknowledged)
                    | bit(status::MODE_13, following)
            }
            Mode::ProfileVelocity => {
                let zero = self.status.velocity.0.abs() < self.value(Item::VelocityThreshold) as f32;
                bit(status::REACHED, reached) | bit(status::MODE_12, zero)
            }
            Mode::Homing => self.homing_bits(still),
            Mode::Interpolated => {
                let active = self.moves() && self.control & control::START != 0;
                let reached = reached && set_points.buffer.is_empty();
                bit(status::REACHED, reached) | bit(status::MODE_12, active)
            }
            Mode::CyclicPosition | Mode::CyclicVelocity => {
                let leads = self.erodes() || matches!(self.status.guidance, Guidance::Leads | Guidance::Waits);
                let following = following && self.mode == Mode::CyclicPosition;
                bit(status::MODE_12, self.moves() && !leads) | bit(status::MODE_13, following)
            }
        }
    }

    /// Why homing has failed: 2000h:9.
    pub(super) fn homing_error(&self) -> u8 {
        match self.status.homing {
            _ if self.set_points.homing_refused => codes::HOMING_REFUSED,
            HomingState::Failed(missed) => missed as u8,
            HomingState::No | HomingState::Runs | HomingState::Done => 0,
        }
    }

    /// In progress 0; interrupted or not started 10; attained 10 and 12; failed 10 and 13.
    fn homing_bits(&self, still: bool) -> u16 {
        if !self.set_points.homing_asked {
            let known = if self.status.homed { status::MODE_12 } else { 0 };
            return status::REACHED | known;
        }
        if self.set_points.homing_refused {
            return status::REACHED | status::MODE_13;
        }
        match self.status.homing {
            _ if !self.fresh => 0,
            HomingState::Runs => 0,
            HomingState::Done if still => status::REACHED | status::MODE_12,
            HomingState::Done => status::MODE_12,
            HomingState::Failed(_) if still => status::REACHED | status::MODE_13,
            HomingState::Failed(_) => status::MODE_13,
            HomingState::No => status::REACHED,
        }
    }

    /// Mode that acts: 6061h.
    pub(super) fn mode_number(&self) -> i64 {
        self.mode as i64
    }

    /// Software limits and travel, which are reckoned from the home, as positions of a host, counts.
    fn limits(&self) -> (i32, i32) {
        let (min, max) = (self.value(Item::LimitMin).into(), self.value(Item::LimitMax).into());
        let (min, max) = if self.status.homed {
            let axis = &self.active.head.axis;
            let counts = |nm: Nanometres| nm.0.checked_div(axis.nm_per_count).unwrap_or(0);
            (counts(axis.travel.0).max(min), counts(axis.travel.1).min(max))
        } else {
            (min, max)
        };
        (self.host_position(min), self.host_position(max))
    }

    fn within_limits(&mut self, target: i32) -> i32 {
        let inside = self.clamped(target);
        self.set_points.limited = inside != target;
        inside
    }

    fn clamped(&self, target: i32) -> i32 {
        let (min, max) = self.limits();
        target.max(min).min(max)
    }

    /// The cycle of 60C2h, servo ticks.
    fn period(&self) -> u32 {
        let (units, exponent) = (self.value(Item::IpPeriod) as u32, self.value(Item::IpExponent));
        let divisor = 10u32.saturating_pow(exponent.unsigned_abs());
        units.saturating_mul(TICK_HZ).checked_div(divisor).unwrap_or(0).max(1)
    }

    /// A length.
    pub(super) fn nanometres(&self, counts: i32) -> Nanometres {
        Nanometres(i64::from(counts).saturating_mul(self.active.head.axis.nm_per_count))
    }

    fn um_per_count(&self) -> f32 {
        self.active.head.axis.nm_per_count as f32 * 1e-3
    }

    fn velocity(&self, counts: i32) -> MicrometresPerSecond {
        MicrometresPerSecond(counts as f32 * self.um_per_count())
    }

    /// An acceleration, or a deceleration, of an object, within 60C5h and 60C6h.
    pub(super) fn acceleration(&self, item: Item) -> MicrometresPerSecond2 {
        let most = match item {
            Item::ProfileAcceleration | Item::HomingAcceleration => self.value(Item::MaxAcceleration),
            Item::ProfileDeceleration => self.value(Item::MaxDeceleration),
            _ => i32::MAX,
        };
        MicrometresPerSecond2(self.value(item).min(most) as f32 * self.um_per_count())
    }

    fn motion_limits(&self, velocity: i32) -> MotionLimits {
        MotionLimits {
            velocity: self.velocity(velocity),
            acceleration: self.acceleration(Item::ProfileAcceleration),
            deceleration: self.acceleration(Item::ProfileDeceleration),
        }
    }
}

//! The modes: how set points become commands, and what bits 10, 12 and 13 of the statusword mean.
//!
//! Erosion is no mode of its own: while 2001h:1 is 1, the set points of profile position, cyclic synchronous position and
//! interpolated position become segments of the path, along which the gap leads. While it is 2 they are followed with pulses on,
//! and the host goes by the feed that the gap asks for.

mod erode_enable;
mod homing;
mod limits;
mod profile_position;
mod stepping;
mod streams;
mod velocity;

use super::state::{control, halts, rises, status};
use super::{Drive, STANDING};
use crate::canopen::objects::Item;
use crate::canopen::{Abort, Time};
use crate::head::{self, Command, Guidance};
use heapless::Deque;

/// Set points that interpolated position can buffer: 60C4h:1.
const BUFFER: usize = 32;

/// Mode of operation. The number is that of 6060h.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(i8)]
pub enum Mode {
    /// Follows the steps of a host.
    Steps = -1,
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
            -1 => Mode::Steps,
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
    /// The head has not yet reached the target under way.
    moving: bool,
    /// Milliseconds within the window.
    within: u16,
    /// Homing was asked for and refused.
    homing_refused: bool,
    /// Homing was asked for in this mode.
    homing_asked: bool,
    /// A set point was cut off at a limit.
    pub(super) limited: bool,
    /// Erosion begins when the head rests, with the newest target given until then.
    begins: bool,
    then: Option<i32>,
    buffer: Deque<i32, BUFFER>,
    /// Force that the head has been told to add, N; kept where set points are forgotten.
    push: f32,
    /// Where the set points of cyclic synchronous velocity have led, nm times ticks in a second.
    led: Option<i64>,
    /// When the next set point is due.
    due: Option<Time>,
    /// Limits that the head has been told to follow steps within.
    bounds: Option<(i32, i32)>,
    /// It is to be told as soon as the axis rests.
    steps_due: bool,
}

impl SetPoints {
    /// The head has another command now.
    pub fn forget(&mut self) {
        self.next = None;
        (self.moving, self.missed) = (false, false);
        self.buffer.clear();
        (self.due, self.led, self.bounds) = (None, None, None);
        self.steps_due = false;
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

    /// Rows of a table lead to a target.
    pub fn lead_to(&mut self, target: i32) {
        (self.moving, self.target, self.within) = (true, Some(target), 0);
    }

    /// They have led here.
    pub fn led_to(&mut self, target: i32) {
        self.target = Some(target);
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
            if mode == Mode::Steps {
                // They are followed with pulses off.
                self.set(Item::ErodeEnable, 0);
            }
            if self.acts() && (self.mode != Mode::None || self.status.state == head::State::Touching) {
                // Pulses stop with the mode that wanted them.
                if self.status.state.works() {
                    self.set(Item::ErodeEnable, 0);
                }
                self.halt();
            }
            self.mode = mode;
            self.set_points = SetPoints { push: self.set_points.push, ..SetPoints::default() };
            self.enter_mode();
            // Set points of the new mode wait until the axis stands.
            let waits = self.erodes() && self.status.state == head::State::Positioning;
            self.set_points.begins = self.moves() && mode != Mode::ProfileVelocity && (begins || waits);
        }
        Ok(())
    }

    /// The mode begins to act, or continues.
    pub(super) fn enter_mode(&mut self) {
        self.set_points.forget();
        self.push();
        if !self.moves() {
            return;
        }
        match self.mode {
            Mode::ProfileVelocity => self.run(),
            Mode::Steps => self.set_points.steps_due = true,
            // A host that has said nothing yet wants no motion.
            Mode::CyclicPosition => {
                let target = self.position().saturating_sub(self.value(Item::PositionOffset));
                self.set(Item::TargetPosition, target);
            }
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
                (Mode::Steps, _) => self.set_points.steps_due = true,
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

    /// What the status says of the set points, once a millisecond.
    pub(super) fn watch_mode(&mut self) {
        self.watch_steps();
        let state = self.status.state;
        let busy = match self.status.guidance {
            Guidance::No => state.works() || state.positions(),
            guidance => guidance != Guidance::Rests,
        } || self.technology.is_busy();
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
            Mode::Steps => {
                bit(status::MODE_12, self.follows_steps() || self.status.records) | bit(status::MODE_13, following)
            }
            Mode::Interpolated => {
                let active = self.moves() && self.control & control::START != 0;
                let reached = reached && set_points.buffer.is_empty();
                bit(status::REACHED, reached) | bit(status::MODE_12, active)
            }
            Mode::CyclicPosition | Mode::CyclicVelocity => {
                let leads = self.erodes() || matches!(self.status.guidance, Guidance::Leads | Guidance::Waits);
                // One that waits for its coarse axis follows nobody.
                let leads = leads || self.status.state == head::State::Inching;
                let following = following && self.mode == Mode::CyclicPosition;
                bit(status::MODE_12, self.moves() && !leads) | bit(status::MODE_13, following)
            }
        }
    }

    /// Mode that acts: 6061h.
    pub(super) fn mode_number(&self) -> i64 {
        self.mode as i64
    }
}

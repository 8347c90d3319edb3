//! What the inputs say: position and velocity in every tick, the drive and the encoder's plausibility once a millisecond.

use super::config::Axis;
use super::machine::Head;
use super::{Fault, State, TickInput};
use crate::encoder::{MarkCheck, Plausibility, Position, Velocity};
use crate::path::Path;
use crate::servo::Drawn;
use crate::units::{ADC_FULL_SCALE, Amps, CountsPerSecond, Seconds, TICK_S, TICKS_PER_MS, Volts};
use core::mem::take;
use core::ops::DerefMut;
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::RawCount;

/// Code of no current.
const MID_SCALE: i32 = ADC_FULL_SCALE.div_ceil(2) as i32;
/// Time between two looks, and the share of a tick in it.
const MILLISECOND: Seconds = Seconds(TICKS_PER_MS as f32 * TICK_S);
const PER_TICK: f32 = 1.0 / TICKS_PER_MS as f32;

/// What follows the encoder.
#[derive(Debug)]
pub(super) struct Tracking {
    pub(super) position: Position,
    velocity: Velocity,
    plausibility: Plausibility,
    marks: MarkCheck,
    /// Count of the newest reading, as it came.
    seen: u32,
    /// Count at the look before.
    count: u32,
}

/// Sums over the ticks since the look before.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    /// Current codes above mid-scale, and their squares.
    current: i32,
    squares: u32,
    /// Duties as given to the bridge.
    pub(super) duty: i32,
}

impl<P: DerefMut<Target = Path>> Head<P> {
    /// Position, velocity, and the sums of what the drive draws.
    #[inline]
    pub(super) fn measure(&mut self, input: &TickInput) {
        let raw = input.encoder.raw;
        // In most ticks of an eroding head there is nothing new.
        match self.tracking.as_mut().filter(|tracking| tracking.seen == raw.count) {
            Some(tracking) if tracking.velocity.holds(raw) => {}
            Some(tracking) => self.status.velocity = tracking.velocity.tick(raw),
            None => self.track(input),
        }
        // Twelve bits: twenty squares stay within 32.
        let current = i32::from(input.drive.motor_current).wrapping_sub(MID_SCALE);
        self.sums.current = self.sums.current.wrapping_add(current);
        self.sums.squares = self.sums.squares.wrapping_add(current.wrapping_mul(current).cast_unsigned());
    }

    /// A new count, or the first.
    #[cold]
    fn track(&mut self, input: &TickInput) {
        let axis = &self.config.axis;
        let raw = as_wired(axis, input.encoder.raw);
        let tracking = self.tracking.get_or_insert_with(|| Tracking {
            position: Position::new(raw),
            velocity: Velocity::new(raw, axis.clock_hz),
            plausibility: Plausibility::new(axis.plausibility, input.encoder.illegal),
            marks: MarkCheck::new(axis.marks),
            seen: 0,
            count: raw.count,
        });
        tracking.seen = input.encoder.raw.count;
        self.status.position = tracking.position.update(raw);
        self.at = tracking.position.fixed();
        self.status.velocity = tracking.velocity.tick(raw);
    }

    /// Current, bus voltage, and what follows from them. (The first look comes too early for its sums. The head coasts.)
    pub(super) fn look_at_drive(&mut self, input: &TickInput) {
        let axis = &self.config.axis;
        let sign = if axis.motor_reversed { -1.0 } else { 1.0 };
        let amps = sign * axis.amps_per_code.0;
        let sums = take(&mut self.sums);
        let end = Amps((i32::from(input.drive.motor_current) - MID_SCALE) as f32 * amps);
        self.status.current = end;
        self.status.bus = Volts(f32::from(input.drive.bus_voltage) * axis.bus_per_code.0);

        self.guard.update(&axis.current, sums.squares as f32 * PER_TICK * (amps * amps), MILLISECOND);
        self.status.current_reduced = self.guard.reduced();

        let Some(tracking) = &mut self.tracking else { return };
        let count = as_wired(axis, input.encoder.raw).count;
        let moved = count.wrapping_sub(tracking.count).cast_signed();
        tracking.count = count;
        let drawn = Drawn {
            over: MILLISECOND,
            duty: sums.duty as f32 * PER_TICK * (sign / f32::from(Drive::FULL)),
            mean: Amps(sums.current as f32 * PER_TICK * amps),
            end,
            bus: self.status.bus,
            encoder: CountsPerSecond(moved as f32 * (1.0 / MILLISECOND.0)),
        };
        self.status.back_emf.update(&axis.plant, &drawn);
    }

    /// Whether the encoder can be believed.
    pub(super) fn look_at_encoder(&mut self, input: &TickInput) {
        let axis = &self.config.axis;
        let Some(tracking) = &mut self.tracking else { return };
        let illegal = input.encoder.illegal;
        self.status.illegal_transitions = illegal;
        let watch = input.watch.map(|watch| as_wired(axis, watch));
        let counters = tracking.plausibility.look(as_wired(axis, input.encoder.raw), watch, illegal);
        let scale = tracking.marks.update(input.encoder.mark);
        let judged = self.status.closed || self.status.state == State::Proving;
        if (counters.is_err() || scale.is_err()) && judged {
            self.raise(Fault::EncoderLost);
        }
    }
}

/// A count that grows toward the work, whichever way the encoder is wired.
#[inline]
fn as_wired(axis: &Axis, raw: RawCount) -> RawCount {
    if axis.encoder_reversed {
        RawCount { count: raw.count.wrapping_neg(), toward_work: !raw.toward_work, ..raw }
    } else {
        raw
    }
}

//! Supervision at 1 kHz: what no single tick can judge.
//!
//! Whatever closes a loop over the encoder is judged alike, in every state: work, axis positioning, the strokes of the
//! commissioning, and the reaction to another fault.

use super::{Fault, State, Status};
use crate::gap::Quality;
use crate::units::{Amps, CountsPerSecond, TICKS_PER_MS, Volts};

/// Limits of the supervision. Times are in ms, which is its period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest following error, counts.
    pub following: f32,
    /// For so long.
    pub following_ms: u32,
    /// Velocity against a saturated duty that means a wrong polarity.
    pub runaway: CountsPerSecond,
    /// Largest difference between encoder velocity and the one that the back-EMF tells.
    pub velocity: CountsPerSecond,
    /// Share of the winding's resistive drop by which the back-EMF may be wrong.
    pub resistance: f32,
    /// For so long.
    pub encoder_ms: u32,
    /// Bad gap reading for so long while pulses are allowed.
    pub gap_ms: u32,
    /// Silence of the host; 0 means that no host is expected.
    pub host_ms: u32,
    /// Bus voltage to work with.
    pub bus_min: Volts,
    /// Motor current that no loop should let happen.
    pub current_max: Amps,
    /// For so long.
    pub current_ms: u32,
}

/// Counts milliseconds of one condition without interruption.
#[derive(Clone, Copy, Debug, Default)]
struct Lasting(u32);

impl Lasting {
    fn longer_than(&mut self, ms: u32, condition: bool) -> bool {
        self.0 = if condition { self.0.saturating_add(1) } else { 0 };
        self.0 > ms
    }
}

/// State of the supervision.
#[derive(Debug, Default)]
pub struct Supervisor {
    following: Lasting,
    runaway: Lasting,
    encoder: Lasting,
    gap: Lasting,
    gate: Lasting,
    host: Lasting,
    current: Lasting,
}

impl Supervisor {
    /// Ticks between two calls of [`Supervisor::tick`].
    pub const PERIOD: u32 = TICKS_PER_MS;

    /// Judges the newest status; `host_alive` tells of a life sign since the last call. Gives the most urgent new fault.
    pub fn tick(&mut self, limits: &Limits, status: &Status, host_alive: bool) -> Option<Fault> {
        let follows = status.state.follows();
        let closed = status.closed;
        let quality = status.gap.quality;
        let pulses = status.state.pulses();

        let bus = closed && status.bus.0 < limits.bus_min.0;
        let current = self.current.longer_than(limits.current_ms, status.current.0.abs() > limits.current_max.0);
        let encoder = self.contradicts(limits, status);
        let against = status.saturated && status.duty * status.velocity.0 < -limits.runaway.0 * status.duty.abs();
        // An open-loop lift that goes down: the polarity is wrong as well.
        let lifts = status.state == State::Fault && !closed && status.duty < 0.0;
        let sinks = lifts && status.velocity.0 > limits.runaway.0;
        let runaway = self.runaway.longer_than(limits.following_ms, closed && against || sinks);
        let following = self.following.longer_than(limits.following_ms, closed && off(limits, status));
        let gap = self.gap.longer_than(
            limits.gap_ms,
            pulses && matches!(quality, Quality::Missing | Quality::Saturated | Quality::Reversed),
        );
        let gate = self.gate.longer_than(limits.gap_ms, pulses && quality == Quality::NoGate);
        let silent = self.host.longer_than(limits.host_ms, follows && !host_alive) && limits.host_ms > 0;

        [
            (current, Fault::OverCurrent),
            (bus, Fault::BusSag),
            (runaway, Fault::PolarityWrong),
            (encoder, Fault::EncoderLost),
            (following, Fault::FollowingError),
            (gap, Fault::GapSignalInvalid),
            (gate, Fault::GateMissing),
            (silent, Fault::HostSilent),
        ]
        .into_iter()
        .find_map(|(happens, fault)| happens.then_some(fault))
    }

    /// An encoder that stands still while the winding generates, or the reverse, is not believed.
    fn contradicts(&mut self, limits: &Limits, status: &Status) -> bool {
        let allowed = limits.velocity.0 + limits.resistance * status.back_emf.resistive().0;
        let differs = status.back_emf.difference().0.abs() > allowed;
        self.encoder.longer_than(limits.encoder_ms, status.closed && differs)
    }
}

/// The axis is too far from its setpoint. A fault's reaction does not push a head down that has risen by itself: there only
/// one that is too far down counts.
fn off(limits: &Limits, status: &Status) -> bool {
    let following = if status.state == State::Fault { -status.following } else { status.following.abs() };
    following > limits.following
}

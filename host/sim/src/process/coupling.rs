//! What the edge of a discharge couples into lines that do not carry it: the encoder's, the gap's and the bus's converters.
//!
//! A discharge begins within nanoseconds at amperes beside the cables of the head. A conversion that it meets is off by some
//! volts either way; receivers of the encoder may show a pulse on A and B together, which is no count and two illegal
//! transitions. A line that is cut shows every discharge, and of two that are A alone, as if the scale trembled by a count. All levels are assumed;
//! without them nothing is drawn.

use super::lines::CYCLES_PER_US;
use super::model::Stretch;
use super::random::{Cause, Random};
use super::{Cable, Installation, Sensors};
use edm_hal_shim::encoder::Levels;
use edm_process::Edge;
use edm_servo_head::units::ADC_FULL_SCALE;
use rand::RngExt;

/// Core cycles of a coupled pulse, 100 ns.
const PULSE: u32 = 17;
/// Current that rises by this begins a discharge, A.
const RISES: f64 = 0.05;
/// Time between conversions, us.
const CONVERSION_US: f64 = 2.0;

/// State of the coupling.
#[derive(Clone, Debug)]
pub struct Coupling {
    /// Codes by which a conversion of the gap, and of the bus, is off at the most.
    gap: f64,
    bus: f64,
    /// Chance of a pulse on the encoder's lines.
    edges: f64,
    random: Random,
}

impl Coupling {
    /// As strong as the surroundings say.
    pub fn new(p: &Installation, seed: u64) -> Coupling {
        Coupling {
            gap: f64::from(p.spark_gap / p.volts_per_code),
            bus: f64::from(p.spark_bus / p.bus_per_code),
            edges: p.spark_edges.into(),
            random: Cause::Coupling.stream(seed),
        }
    }

    /// Disturbs what a tick that began at `from` (us) and at the count `clock` has shown under these stretches, the oldest first.
    /// The encoder had the levels `before` at its beginning; this is its cable.
    pub fn disturb(
        &mut self,
        sensors: &mut Sensors,
        (from, clock): (f64, u32),
        (before, cable): (Levels, Cable),
        stretches: &[Stretch],
    ) {
        if self.gap == 0.0 && self.bus == 0.0 && self.edges == 0.0 {
            return;
        }
        for (was, now) in stretches.iter().zip(stretches.iter().skip(1)) {
            if now.from < from || !discharges(&was.amps, &now.amps) {
                continue;
            }
            let [gap, bus, hit]: [f64; 3] = self.random.random();
            let us = now.from - from;
            if let Some(code) = sensors.block.codes.get_mut((us / CONVERSION_US) as usize) {
                *code = off(*code, self.gap * (2.0 * gap - 1.0));
            }
            sensors.drive.bus_voltage = off(sensors.drive.bus_voltage, self.bus * (2.0 * bus - 1.0));
            let cut = cable.a_cut || cable.b_cut;
            if hit < self.edges || cut && self.edges > 0.0 {
                let hit = (!cut || cable.a_cut, !cut || !cable.a_cut);
                pulse(sensors, clock, (us * CYCLES_PER_US) as u32, (before, hit));
            }
        }
    }
}

/// Whether a discharge begins where this current follows that one.
pub fn discharges(was: &Edge, now: &Edge) -> bool {
    now.from.max(now.to) >= was.to + RISES
}

/// A code that is off by so much.
fn off(code: u16, by: f64) -> u16 {
    (f64::from(code) + by).round().clamp(0.0, f64::from(ADC_FULL_SCALE)) as u16
}

/// A pulse on A, on B, or on both, so many cycles after the clock, unless an edge comes within it.
fn pulse(sensors: &mut Sensors, clock: u32, at: u32, (before, (on_a, on_b)): (Levels, (bool, bool))) {
    let age = |time: u32| time.wrapping_sub(clock);
    let place = sensors.edges.partition_point(|(time, _)| age(*time) < at);
    let level = place.checked_sub(1).and_then(|last| sensors.edges.get(last)).map_or(before, |(_, levels)| *levels);
    if sensors.edges.get(place).is_none_or(|(time, _)| age(*time) > at + PULSE) {
        let hit = Levels { a: level.a ^ on_a, b: level.b ^ on_b, ..level };
        let time = clock.wrapping_add(at);
        sensors.edges.splice(place..place, [(time, hit), (time.wrapping_add(PULSE), level)]);
    }
}

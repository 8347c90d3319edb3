//! A second opinion on velocity: the winding's back-EMF.
//!
//! duty * bus = R i + L di/dt + K v, averaged over some ticks, gives v without the encoder. It is a coarse figure (R changes
//! with temperature, currents are quantised), low-passed over 20 ms, but it distinguishes an axis that moves from one that does
//! not, which is what a dead encoder hides. Each tick's duty and current have to be in the averages: the winding's L/R is a
//! quarter of a millisecond.

use super::Plant;
use crate::units::{Amps, CountsPerSecond, Seconds, Volts};

/// Time constant of the low-pass, s.
const SMOOTHING_S: f32 = 20e-3;

/// Estimator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BackEmf {
    current: f32,
    difference: f32,
    resistive: f32,
}

/// What was measured over some ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveMeans {
    /// How long, short against 20 ms.
    pub over: Seconds,
    /// Mean of the duties that were in force.
    pub duty: f32,
    /// Mean of the currents.
    pub mean: Amps,
    /// Current at the end.
    pub end: Amps,
    /// Bus voltage.
    pub bus: Volts,
    /// Mean velocity by the encoder.
    pub encoder: CountsPerSecond,
}

impl BackEmf {
    /// Takes what was measured since the last time.
    pub fn update(&mut self, plant: &Plant, drawn: &DriveMeans) {
        let per_volt = plant.counts_per_m / plant.force_constant;
        let inductive = plant.inductance_h * (drawn.end.0 - self.current) / drawn.over.0;
        self.current = drawn.end.0;
        let resistive = plant.resistance_ohm * drawn.mean.0;
        let velocity = (drawn.duty * drawn.bus.0 - resistive - inductive) * per_volt;
        let share = drawn.over.0 * (1.0 / SMOOTHING_S);
        self.difference += share * (velocity - drawn.encoder.0 - self.difference);
        self.resistive += share * ((resistive * per_volt).abs() - self.resistive);
    }

    /// Velocity by back-EMF less velocity by encoder.
    pub fn difference(&self) -> CountsPerSecond {
        CountsPerSecond(self.difference)
    }

    /// What the resistive drop amounts to as a velocity: an error of the resistance is that share of it.
    pub fn resistive(&self) -> CountsPerSecond {
        CountsPerSecond(self.resistive)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::axis::PLANT;
    use crate::units::{TICK_HZ, TICK_S};

    /// Drives a winding that moves at `speed` (m/s) with a square wave of duty; the encoder says `seen`. The estimator looks
    /// every `ticks`.
    fn after(ticks: u32, speed: f32, seen: f32) -> BackEmf {
        let mut emf = BackEmf::default();
        let mut amps = 0.0f32;
        for _ in 0..TICK_HZ / 40 {
            for half in 0..40 / ticks {
                let (mut duties, mut currents) = (0.0, 0.0);
                for tick in 0..ticks {
                    let duty = if half * ticks + tick < 20 { 0.4 } else { -0.2 };
                    let before = amps;
                    for _ in 0..50 {
                        amps += (duty * 48.0 - 12.4 * amps - 7.5 * speed) / 3e-3 * TICK_S / 50.0;
                    }
                    duties += duty;
                    currents += 0.5 * (before + amps);
                }
                let n = ticks as f32;
                emf.update(
                    &PLANT,
                    &DriveMeans {
                        over: Seconds(n * TICK_S),
                        duty: duties / n,
                        mean: Amps(currents / n),
                        end: Amps(amps),
                        bus: Volts(48.0),
                        encoder: CountsPerSecond(seen * 1e6),
                    },
                );
            }
        }
        emf
    }

    #[test]
    fn an_honest_encoder_agrees_with_the_back_emf_through_switching() {
        for ticks in [1, 20] {
            for speed in [-0.3, 0.0, 0.1] {
                let difference = after(ticks, speed, speed).difference().0;
                assert!(difference.abs() < 5e3, "{difference} at {speed} m/s, every {ticks} ticks");
            }
        }
    }

    #[test]
    fn a_dead_encoder_is_off_by_the_whole_velocity() {
        for ticks in [1, 20] {
            assert!((after(ticks, 0.1, 0.0).difference().0 - 1e5).abs() < 5e3);
        }
    }
}

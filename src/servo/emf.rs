//! A second opinion on velocity: the winding's back-EMF.
//!
//! duty * bus = R i + L di/dt + K v, averaged over each tick, gives v without the encoder. It is a coarse figure (R changes
//! with temperature, currents are quantised), low-passed over 20 ms, but it tells an axis that moves from one that does
//! not, which is what a dead encoder hides.

use super::Plant;
use crate::units::{Amps, CountsPerSecond, TICK_HZ, TICK_S, Volts};

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

impl BackEmf {
    /// Takes the duty of the last tick, the bus voltage, the current at its end, and the encoder's velocity.
    pub fn update(&mut self, plant: &Plant, duty: f32, bus: Volts, current: Amps, encoder: CountsPerSecond) {
        let per_volt = plant.counts_per_m / plant.force_constant;
        let mean = 0.5 * (current.0 + self.current);
        let inductive = plant.inductance_h * (current.0 - self.current) * TICK_HZ as f32;
        self.current = current.0;
        let resistive = plant.resistance_ohm * mean;
        let velocity = (duty * bus.0 - resistive - inductive) * per_volt;
        const SHARE: f32 = TICK_S / SMOOTHING_S;
        self.difference += SHARE * (velocity - encoder.0 - self.difference);
        self.resistive += SHARE * ((resistive * per_volt).abs() - self.resistive);
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
    use crate::units::Newtons;

    const PLANT: Plant = Plant {
        mass_kg: 0.2,
        resistance_ohm: 12.4,
        inductance_h: 3e-3,
        force_constant: 7.5,
        bus: Volts(48.0),
        counterbalance: Newtons(2.2),
        counts_per_m: 1e6,
    };

    /// Drives a winding that moves at `speed` (m/s) with a square wave of duty; the encoder says `seen`.
    fn after(speed: f32, seen: f32) -> BackEmf {
        let mut emf = BackEmf::default();
        let mut amps = 0.0f32;
        for tick in 0..TICK_HZ {
            let duty = if tick / 40 % 2 == 0 { 0.4 } else { -0.2 };
            for _ in 0..50 {
                amps += (duty * 48.0 - 12.4 * amps - 7.5 * speed) / 3e-3 * TICK_S / 50.0;
            }
            emf.update(&PLANT, duty, Volts(48.0), Amps(amps), CountsPerSecond(seen * 1e6));
        }
        emf
    }

    #[test]
    fn an_honest_encoder_agrees_with_the_back_emf_through_switching() {
        for speed in [-0.3, 0.0, 0.1] {
            assert!(after(speed, speed).difference().0.abs() < 5e3, "{:?}", after(speed, speed));
        }
    }

    #[test]
    fn a_dead_encoder_is_off_by_the_whole_velocity() {
        assert!((after(0.1, 0.0).difference().0 - 1e5).abs() < 5e3);
    }
}

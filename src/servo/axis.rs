//! The cascade of one axis: position error -> velocity -> duty.
//!
//! Plant, with x positive toward the work (\[R\] sections 6.1 and 7.2; K stands for both the force and the back-EMF
//! constant, equal in SI units): i = (v - K x') / (R + L s), m x'' = K i + m g - F_counterbalance - friction.
//!
//! Gains by pole placement on the current-fed mass: a duty of one gives the acceleration a = K V / (R m), so a velocity
//! bandwidth w takes w / a of duty per unit of velocity error. The winding's L/R (0.24 ms) and the tick bound w from above:
//! 1000 rad/s leaves 70 degrees.

use super::{Output, Pid, PidGains, Window};
use crate::units::{Amps, CountsPerSecond, Newtons, TICK_S, Volts, larger, smaller, within_either};
use core::f32::consts::TAU;

/// Standard gravity, m/s^2.
pub const GRAVITY: f32 = 9.80665;

/// The axis as built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plant {
    /// Moving mass with electrode, kg.
    pub mass_kg: f32,
    /// Winding resistance, ohm.
    pub resistance_ohm: f32,
    /// Winding inductance, H.
    pub inductance_h: f32,
    /// Force constant, N/A; the back-EMF constant in V/(m/s) is the same number.
    pub force_constant: f32,
    /// Bus voltage the duty is a share of.
    pub bus: Volts,
    /// Force that lifts the de-energised head.
    pub counterbalance: Newtons,
    /// Encoder counts per metre.
    pub counts_per_m: f32,
}

impl Plant {
    /// Duty that gives a force at standstill.
    pub fn duty(&self, force: Newtons) -> f32 {
        force.0 * self.resistance_ohm / (self.force_constant * self.bus.0)
    }

    /// Duty that gives an acceleration, counts/s^2.
    pub fn accelerating(&self, acceleration: f32) -> f32 {
        self.duty(Newtons(self.mass_kg * acceleration / self.counts_per_m))
    }

    /// Weight less counterbalance, positive toward the work.
    pub fn net_weight(&self) -> Newtons {
        Newtons(self.weight().0 - self.counterbalance.0)
    }

    /// Weight of the moving mass.
    pub fn weight(&self) -> Newtons {
        Newtons(self.mass_kg * GRAVITY)
    }

    /// Duty per velocity that cancels the back-EMF, per count/s.
    pub fn back_emf(&self) -> f32 {
        self.force_constant / (self.bus.0 * self.counts_per_m)
    }

    /// Velocity at which a shorted winding has this current.
    pub fn generating(&self, current: Amps) -> CountsPerSecond {
        CountsPerSecond(-current.0 * self.resistance_ohm / self.force_constant * self.counts_per_m)
    }

    /// Duties that keep the current within `limit` at a velocity.
    pub fn current_window(&self, limit: Amps, velocity: CountsPerSecond) -> Window {
        let emf = self.back_emf() * velocity.0;
        let share = limit.0 * self.resistance_ohm / self.bus.0;
        Window { low: smaller(emf - share, 0.0), high: larger(emf + share, 0.0) }
    }
}

/// What a person tunes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tuning {
    /// Bandwidth of the velocity loop, Hz.
    pub velocity_hz: f32,
    /// Bandwidth of the position loop, Hz.
    pub position_hz: f32,
    /// Time in which the integrator of the velocity loop equals its proportional part, s.
    pub integral_time_s: f32,
    /// Largest velocity that a position error may ask for.
    pub velocity: CountsPerSecond,
}

/// What the tick runs.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Gains {
    /// Velocity per position error, 1/s.
    position: f32,
    /// Largest velocity command of the position error, counts/s.
    velocity_limit: f32,
    velocity: PidGains,
    back_emf: f32,
    /// Duty that holds the net weight; negative (up) without a counterbalance.
    holding: f32,
}

impl Gains {
    /// Gains for a plant.
    pub fn build(plant: &Plant, tuning: &Tuning) -> Gains {
        let acceleration = plant.force_constant * plant.bus.0 / (plant.resistance_ohm * plant.mass_kg);
        let p = TAU * tuning.velocity_hz / (acceleration * plant.counts_per_m);
        Gains {
            position: TAU * tuning.position_hz,
            velocity_limit: tuning.velocity.0,
            velocity: PidGains {
                p,
                i: p / tuning.integral_time_s * TICK_S,
                d: 0.0,
                integral_error: tuning.velocity.0,
                integral: 1.0,
            },
            back_emf: plant.back_emf(),
            holding: -plant.duty(plant.net_weight()),
        }
    }

    /// Largest velocity that is asked of the loop.
    pub fn velocity_limit(&self) -> CountsPerSecond {
        CountsPerSecond(self.velocity_limit)
    }

    /// Position error, counts, of which the proportional parts of both loops alone make a duty.
    pub fn error_of(&self, duty: f32) -> f32 {
        duty / (self.position * self.velocity.p)
    }

    /// Duty that brings an axis of this velocity to another one, by the proportional part of its loop alone.
    pub fn nearing(&self, wanted: CountsPerSecond, velocity: CountsPerSecond) -> f32 {
        self.holding + self.back_emf * wanted.0 + self.velocity.p * (wanted.0 - velocity.0)
    }

    /// Duty under which nothing but its friction holds an axis of this velocity, counts/s: that of the net weight and of the back-EMF.
    pub fn against(&self, velocity: f32) -> f32 {
        self.holding + self.back_emf * velocity
    }

    /// Duty that holds the net weight.
    pub fn holding(&self) -> f32 {
        self.holding
    }
}

/// State of the cascade.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AxisLoop {
    velocity: Pid,
}

impl AxisLoop {
    /// Duty that follows a position: `error` in counts, `feed` the setpoint's own velocity, `push` the duty that its
    /// acceleration takes, `velocity` the measured one.
    #[inline]
    pub fn follow(
        &mut self,
        gains: &Gains,
        error: f32,
        feed: CountsPerSecond,
        push: f32,
        velocity: CountsPerSecond,
        window: Window,
    ) -> Output {
        let correction = within_either(gains.position * error, gains.velocity_limit);
        let wanted = correction + feed.0;
        let offset = gains.holding + gains.back_emf * wanted + push;
        self.velocity.update_pi(&gains.velocity, wanted - velocity.0, offset, window)
    }

    /// Duty that keeps a velocity.
    #[inline]
    pub fn run(&mut self, gains: &Gains, wanted: CountsPerSecond, velocity: CountsPerSecond, window: Window) -> Output {
        let offset = gains.holding + gains.back_emf * wanted.0;
        self.velocity.update_pi(&gains.velocity, wanted.0 - velocity.0, offset, window)
    }

    /// Clears the integrator: at enable, and in the reaction to a following error.
    pub fn reset(&mut self) {
        self.velocity.reset();
    }
}

/// The actuator of \[R\], without counterbalance.
#[cfg(test)]
pub(super) const PLANT: Plant = Plant {
    mass_kg: 0.2,
    resistance_ohm: 12.4,
    inductance_h: 3e-3,
    force_constant: 7.5,
    bus: Volts(48.0),
    counterbalance: Newtons(0.0),
    counts_per_m: 1e6,
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_counterbalance_the_holding_duty_lifts() {
        let tuning =
            Tuning { velocity_hz: 100.0, position_hz: 20.0, integral_time_s: 0.05, velocity: CountsPerSecond(1e5) };
        let holding = Gains::build(&PLANT, &tuning).holding();
        // 1.961 N at 7.5 N/A is 0.2615 A, 3.242 V, 6.75 % of 48 V.
        assert!((holding + 0.06755).abs() < 1e-4, "{holding}");
        let balanced = Plant { counterbalance: Newtons(2.2), ..PLANT };
        assert!(Gains::build(&balanced, &tuning).holding() > 0.0);
    }

    #[test]
    fn a_shorted_winding_shows_by_its_current_how_it_moves() {
        // 0.1 m/s toward the work makes 0.75 V against it: 60.5 mA.
        let velocity = PLANT.generating(Amps(-0.75 / 12.4)).0;
        assert!((velocity - 1e5).abs() < 1.0, "{velocity}");
    }

    #[test]
    fn the_current_window_moves_with_the_back_emf_and_always_allows_zero() {
        let still = PLANT.current_window(Amps(1.0), CountsPerSecond(0.0));
        assert!((still.high - 12.4 / 48.0).abs() < 1e-6 && (still.low + 12.4 / 48.0).abs() < 1e-6);
        // 1 m/s toward the work generates 7.5 V: 19.9 V of drive gives the same ampere.
        let down = PLANT.current_window(Amps(1.0), CountsPerSecond(1e6));
        assert!((down.high - 19.9 / 48.0).abs() < 1e-6 && (down.low + 4.9 / 48.0).abs() < 1e-6);
        let fast = PLANT.current_window(Amps(1.0), CountsPerSecond(3e6));
        assert_eq!(fast.low, 0.0);
    }
}

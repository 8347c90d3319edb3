//! Friction of an axis that reverses: what holds it does not turn round at once.
//!
//! Dry friction is elastic before it slides (Dahl, *A solid friction model*, 1968): over a length of presliding it goes from the
//! whole force against one direction to the whole force against the other, dF/dx = (F_c - F sgn x') / x_p. The duty that
//! overcomes it follows the *set point* by the same law, so it is no feedback, and cannot make a loop hunt by itself.

use crate::units::{Fixed, within_either};

/// How much of it is compensated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Duty against the friction of steady sliding.
    pub duty: f32,
    /// Lengths of presliding in a count.
    pub per_count: f32,
}

/// State of the friction under an axis that is where its set point is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Presliding {
    /// Share of the friction that opposes motion toward the work, -1 to 1.
    bent: f32,
}

impl Presliding {
    /// Duty after so much travel of the set point, counts.
    pub fn travel(&mut self, config: &Config, travel: Fixed) -> f32 {
        let lengths = within_either(travel.to_f32() * config.per_count, 1.0);
        self.bent += lengths - self.bent * lengths.abs();
        self.bent * config.duty
    }

    /// Nothing is known of it.
    pub fn forget(&mut self) {
        self.bent = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: Config = Config { duty: 0.02, per_count: 1.0 / 0.7 };

    fn go(friction: &mut Presliding, step: f64, counts: f64) -> f32 {
        let mut duty = 0.0;
        for _ in 0..(counts / step.abs()) as u32 {
            duty = friction.travel(&CONFIG, Fixed((step * Fixed::whole(1).0 as f64) as i64));
        }
        duty
    }

    #[test]
    fn a_reversal_turns_it_round_over_the_length_of_presliding() {
        for way in [1.0f64, -1.0] {
            let mut friction = Presliding::default();
            let whole = go(&mut friction, 0.001 * way, 5.0);
            assert!((f64::from(whole) * way - 0.02).abs() < 1e-4, "{whole}");
            // Dahl: F = F_c (1 - 2 exp(-x / x_p)) after a reversal.
            let turned = go(&mut friction, -0.001 * way, 0.7);
            let wanted = -way * 0.02 * (1.0 - 2.0 * (-1.0f64).exp());
            assert!((f64::from(turned) - wanted).abs() < 1e-4, "{turned}, not {wanted}");
        }
    }

    #[test]
    fn it_never_gives_more_than_it_is_set_to_however_far_the_set_point_goes() {
        let mut friction = Presliding::default();
        for travel in [0.3f64, 1e9, -1e9, 0.6, -0.1, 5.0, -5.0, 0.0] {
            let duty = friction.travel(&CONFIG, Fixed((travel * Fixed::whole(1).0 as f64) as i64));
            assert!(duty.abs() <= CONFIG.duty, "{travel}: {duty}");
        }
        friction.forget();
        assert_eq!(friction.travel(&CONFIG, Fixed(0)), 0.0);
    }
}

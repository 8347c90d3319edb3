//! Position as a surrogate for the gap (\[R\] sections 6.6.1, 6.7.3 and 6.8): the loop can be tried on the real actuator
//! without a spark.
//!
//! An imagined workpiece surface, WSH(t) = h0 + integral of max(0, C - k |gap error|) dt, moves away as it is "eroded",
//! slower the further the gap is from right. The reading is the setpoint plus a slope times the distance by which the gap
//! is too wide, plus uniform noise.

use super::{GapReading, Quality};
use crate::units::{Fixed, Micrometres, MicrometresPerSecond, Volts};

/// The imagined process.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Reading when the gap is right.
    pub setpoint: Volts,
    /// Reading of a gap that is far too wide.
    pub open: Volts,
    /// Volts per um of gap error.
    pub slope: f32,
    /// Largest erosion rate, C.
    pub erosion: MicrometresPerSecond,
    /// Erosion lost per um of gap error, k, in 1/s.
    pub worsening: f32,
    /// Amplitude of the noise, either way.
    pub noise: Volts,
}

/// State of the imagined process.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Surrogate {
    /// Where the gap would be right, um.
    surface: Fixed,
    random: u32,
}

impl Surrogate {
    /// Process whose gap is right at `surface`, um along the axis; `seed` starts the noise.
    pub fn new(surface: Fixed, seed: u32) -> Surrogate {
        Surrogate { surface, random: seed }
    }

    /// Reading for this tick, from the position in um.
    pub fn update(&mut self, config: &Config, position: Fixed) -> GapReading {
        let error = self.surface.minus(position).to_f32();
        let rate = (config.erosion.0 - config.worsening * error.abs()).max(0.0);
        self.surface = self.surface.plus(MicrometresPerSecond(rate).per_tick());
        // Numerical Recipes' quick generator: noise, not a secret.
        self.random = self.random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let noise = self.random.cast_signed() as f32 * (config.noise.0 / i32::MAX as f32);
        let volts = Volts((config.setpoint.0 + config.slope * error + noise).max(0.0).min(config.open.0));
        GapReading { filtered: volts, block: volts, mean: volts, quality: Quality::Valid, ..GapReading::default() }
    }

    /// Where the gap would be right.
    pub fn surface(&self) -> Micrometres {
        Micrometres(self.surface.to_f32())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: Config = Config {
        setpoint: Volts(60.0),
        open: Volts(100.0),
        slope: 1.0,
        erosion: MicrometresPerSecond(4.0),
        worsening: 0.5,
        noise: Volts(0.0),
    };

    fn after_a_second(config: &Config, gap_error: f32) -> f32 {
        let mut process = Surrogate::new(Fixed::whole(2000), 1);
        for _ in 0..crate::units::TICK_HZ {
            let position = process.surface.minus(Fixed::short(gap_error));
            process.update(config, position);
        }
        process.surface().0 - 2000.0
    }

    #[test]
    fn the_surface_recedes_at_full_rate_only_while_the_gap_is_right() {
        assert!((after_a_second(&CONFIG, 0.0) - 4.0).abs() < 0.02);
        assert!((after_a_second(&CONFIG, 4.0) - 2.0).abs() < 0.02);
        assert!((after_a_second(&CONFIG, -4.0) - 2.0).abs() < 0.02);
        assert_eq!(after_a_second(&CONFIG, 9.0), 0.0, "it never comes back");
    }

    #[test]
    fn the_reading_rises_with_the_gap_and_stays_between_zero_and_open() {
        let mut process = Surrogate::new(Fixed::whole(2000), 1);
        let mut read = |position| process.update(&CONFIG, Fixed::whole(position)).filtered.0;
        assert_eq!([read(1990), read(2010), read(1000), read(3000)], [70.0, 50.0, 100.0, 0.0]);
    }

    #[test]
    fn the_noise_fills_its_amplitude_and_has_no_bias() {
        let config = Config { noise: Volts(0.5), erosion: MicrometresPerSecond(0.0), ..CONFIG };
        let mut process = Surrogate::new(Fixed::whole(2000), 7);
        let (mut sum, mut most) = (0.0f32, 0.0f32);
        for _ in 0..20_000 {
            let off = process.update(&config, Fixed::whole(2000)).filtered.0 - 60.0;
            sum += off;
            most = most.max(off.abs());
        }
        assert!((sum / 20_000.0).abs() < 0.01);
        assert!(most > 0.49 && most <= 0.5001);
    }
}

//! Gap by charging time: what whole ticks of the clock make of it.
//!
//! Gate and clock know nothing of each other: where in a tick a pulse begins is drawn evenly, and the capture is the number
//! of edges of the clock until tau later. The true gap is that of \[X\]'s polynomial itself: its own repeats, 1.2 um at 80
//! um, are no part of this.

use edm_servo_head::gap::charging::Material;
use edm_servo_head::units::CLOCK_HZ;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Rms and largest error of a single capture, and of the mean of sixteen, um.
pub const BOUNDS: [(f64, f64); 2] = [(0.35, 0.75), (0.1, 0.3)];
/// Captures of a mean.
const CAPTURES: u16 = 16;
/// From one gap to the next, tenths of a um, from 10 to 80 um.
const GAPS: std::ops::RangeInclusive<u32> = 100..=800;

/// Errors over 10 to 80 um in steps of 0.1 um.
pub struct Errors {
    /// Rms and largest of single captures, um; sixteen at each gap.
    pub single: (f64, f64),
    /// Of the means of these.
    pub mean16: (f64, f64),
    /// Rms and largest difference of a polynomial that was fitted to 15 known steps, 16 captures each, from the one that made
    /// them.
    pub fitted: (f64, f64),
    /// Gaps, each once.
    pub gaps: usize,
}

fn polynomial(material: &Material, tau: f64) -> f64 {
    material.coefficients().into_iter().fold(0.0, |sum, coefficient| sum * tau + f64::from(coefficient))
}

/// Time constant of a gap, us: the polynomial falls all the way.
fn tau(gap_um: f64) -> f64 {
    let (mut low, mut high) = (0.4, 1.8);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if polynomial(&Material::SILICON, middle) > gap_um { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

fn capture(gap_um: f64, random: &mut Xoshiro256PlusPlus) -> u32 {
    let begin: f64 = random.random();
    (begin + tau(gap_um) * f64::from(CLOCK_HZ) * 1e-6) as u32
}

fn rms_max(errors: &[f64]) -> (f64, f64) {
    let squares: f64 = errors.iter().map(|error| error * error).sum();
    ((squares / errors.len() as f64).sqrt(), errors.iter().fold(0.0, |most, error| error.abs().max(most)))
}

/// Measures.
///
/// # Errors
/// When the known steps make no polynomial.
pub fn measure() -> Result<Errors, String> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(13);
    // At the ends of the range a capture may lie a tick beyond it.
    let [a, b, c, d] = Material::SILICON.coefficients();
    let material = Material::new([a, b, c, d], 0.4, 1.8).map_err(|error| error.to_string())?;
    let gap =
        |ticks: u32, captures: u16| material.of_captures(ticks, captures).map_or(f64::NAN, |it| f64::from(it.gap.0));
    let (mut single, mut mean16, mut fitted) = (vec![], vec![], vec![]);
    for tenths in GAPS {
        let known = f64::from(tenths) / 10.0;
        let ticks: Vec<u32> = (0..CAPTURES).map(|_| capture(known, &mut random)).collect();
        single.extend(ticks.iter().map(|ticks| gap(*ticks, 1) - known));
        mean16.push(gap(ticks.iter().sum(), CAPTURES) - known);
    }
    let steps: Vec<(f32, f32)> = (10..=80)
        .step_by(5)
        .map(|um| {
            let ticks: u32 = (0..CAPTURES).map(|_| capture(f64::from(um), &mut random)).sum();
            (ticks as f32 / f32::from(CAPTURES) * 1e6 / CLOCK_HZ as f32, um as f32)
        })
        .collect();
    let made = Material::fit(&steps).map_err(|unfit| unfit.to_string())?;
    for tenths in GAPS {
        let known = f64::from(tenths) / 10.0;
        fitted.push(f64::from(made.gap(tau(known) as f32).gap.0) - known);
    }
    Ok(Errors { single: rms_max(&single), mean16: rms_max(&mean16), fitted: rms_max(&fitted), gaps: mean16.len() })
}

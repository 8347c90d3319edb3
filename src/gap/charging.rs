//! Gap by the time that it takes to charge (\[X\] section 2).
//!
//! Before it breaks down a gap is a capacitor: its voltage rises as U (1 - exp(-t/tau)), and tau is the time from 0 to 0.63 U.
//! A comparator and a capture of the core clock take it. The gap is a polynomial of the third degree in tau (\[X\] equation 9),
//! whose coefficients are those of a material, a fluid and an electrode: [`Material::fit`] makes them of steps of known gap.
//!
//! A capture is whole ticks of 5.95 ns. Gate and clock know nothing of each other, so the number of ticks is one of the two
//! nearest and right on average: the mean of several captures is finer than a tick. The repeats of \[X\] at the same gap span
//! far more, 0.01 us or 1.2 um at 80 um (table 2): what is stated here of ticks is what the timer adds, not what a gap can be
//! known to.

use crate::dsp::{OutOfRange, in_range};
use crate::units::{CLOCK_HZ, Micrometres, within};

/// Terms of the polynomial.
const TERMS: usize = 4;
/// Longest time constant, us: that of a third degree is wild beyond.
const LONGEST_US: f32 = 100.0;
/// Places at which a fit is looked at for whether it falls.
const PLACES: u8 = 32;

/// Gap by time constant, for one material.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Material {
    /// um / us^3, um / us^2, um / us, um.
    pub coefficients: [f32; TERMS],
    /// Shortest and longest time constant for which it holds, us.
    pub shortest: f32,
    /// See [`shortest`](Material::shortest).
    pub longest: f32,
}

/// A gap, and whether the time constant is one of those that the polynomial was made from; beyond, the gap is that of the
/// nearest.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Charged {
    /// Gap.
    pub gap: Micrometres,
    /// It lies within what was calibrated.
    pub inside: bool,
}

/// Why steps of known gap make no polynomial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CalibrationError {
    /// There are fewer than four time constants that differ.
    TooFew,
    /// A step is no number, or its time constant is not from 0 to 100 us.
    Step,
    /// The gap would not fall everywhere as the time constant rises.
    NotFalling,
}

impl core::fmt::Display for CalibrationError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            CalibrationError::TooFew => "calibration: at least 4 steps with different time constants are needed",
            CalibrationError::Step => "calibration: a time constant must be from 0 to 100 us and a gap a number",
            CalibrationError::NotFalling => "calibration: the gap must fall as the time constant rises",
        })
    }
}

impl core::error::Error for CalibrationError {}

impl Material {
    /// 10 mm copper on p-type silicon, 10 to 80 um (\[X\] equation 9).
    pub const SILICON: Material =
        Material { coefficients: [-50.4, 190.6, -281.6, 182.6], shortest: 0.52, longest: 1.66 };

    /// Polynomial with these coefficients (um / us^3 first), for time constants in between.
    pub fn new(coefficients: [f32; TERMS], shortest: f32, longest: f32) -> Result<Material, OutOfRange> {
        for coefficient in coefficients {
            in_range("coefficient of the gap (um / us^n)", coefficient, -1e6, 1e6)?;
        }
        let longest = in_range("longest time constant (us)", longest, 0.0, LONGEST_US)?;
        Ok(Material {
            coefficients,
            shortest: in_range("shortest time constant (us)", shortest, 0.0, longest)?,
            longest,
        })
    }

    /// um / us^3, um / us^2, um / us, um.
    pub fn coefficients(&self) -> [f32; TERMS] {
        self.coefficients
    }

    /// Gap by time constant, us.
    #[inline]
    pub fn gap(&self, tau_us: f32) -> Charged {
        let tau = within(tau_us, self.shortest, self.longest);
        let [cube, square, line, constant] = self.coefficients;
        Charged { gap: Micrometres(((cube * tau + square) * tau + line) * tau + constant), inside: tau == tau_us }
    }

    /// Gap by so many captures, whose ticks of the core clock make this sum; `None` without one.
    pub fn of_captures(&self, ticks: u32, captures: u16) -> Option<Charged> {
        const US: f32 = 1e6 / CLOCK_HZ as f32;
        (captures > 0).then(|| self.gap(ticks as f32 * US / f32::from(captures)))
    }

    /// Least squares over steps of known gap, each (time constant in us, gap in um); not for a tick.
    ///
    /// The time constants are first brought to -1..=1: as they are, the powers are so alike that f32 could not tell them apart.
    pub fn fit(steps: &[(f32, f32)]) -> Result<Material, CalibrationError> {
        let (mut shortest, mut longest) = (f32::INFINITY, f32::NEG_INFINITY);
        for (tau, gap) in steps {
            if !((0.0..=LONGEST_US).contains(tau) && gap.is_finite()) {
                return Err(CalibrationError::Step);
            }
            (shortest, longest) = (shortest.min(*tau), longest.max(*tau));
        }
        let (middle, half) = (0.5 * (longest + shortest), 0.5 * (longest - shortest));
        if half.is_nan() || half < 1e-3 {
            return Err(CalibrationError::TooFew);
        }
        let mut rows = [[0.0; TERMS + 1]; TERMS];
        for (tau, gap) in steps {
            let x = (tau - middle) / half;
            let powers = [1.0, x, x * x, x * x * x];
            for (row, factor) in rows.iter_mut().zip(powers) {
                let products = powers.iter().chain([gap]).map(|other| factor * other);
                row.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
            }
        }
        let [c0, c1, c2, c3] = solve(rows, 1e-5 * steps.len() as f32).ok_or(CalibrationError::TooFew)?;
        // In (tau - middle) / half, then in tau.
        let (c1, c2, c3) = (c1 / half, c2 / (half * half), c3 / (half * half * half));
        let coefficients = [
            c3,
            c2 - 3.0 * c3 * middle,
            c1 - 2.0 * c2 * middle + 3.0 * c3 * middle * middle,
            c0 - c1 * middle + c2 * middle * middle - c3 * middle * middle * middle,
        ];
        let falls = (0..=PLACES).all(|place| {
            let away = half * (f32::from(place) / f32::from(PLACES / 2) - 1.0);
            c1 + away * (2.0 * c2 + away * 3.0 * c3) < 0.0
        });
        if falls { Ok(Material { coefficients, shortest, longest }) } else { Err(CalibrationError::NotFalling) }
    }
}

/// Gauss's elimination, which needs no exchange of rows where the matrix is one of squares; `None` when a pivot is below `least`.
fn solve(mut rows: [[f32; TERMS + 1]; TERMS], least: f32) -> Option<[f32; TERMS]> {
    for k in 0..TERMS {
        let pivot = *rows.get(k)?;
        let divisor = *pivot.get(k)?;
        if divisor.is_nan() || divisor < least {
            return None;
        }
        for (i, row) in rows.iter_mut().enumerate() {
            let factor = *row.get(k)? / divisor;
            if i != k {
                row.iter_mut().zip(&pivot).for_each(|(value, above)| *value -= factor * above);
            }
        }
    }
    let mut solution = [0.0; TERMS];
    for (k, (x, row)) in solution.iter_mut().zip(&rows).enumerate() {
        *x = row.get(TERMS)? / row.get(k)?;
    }
    Some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_polynomial_is_that_of_the_source_as_far_as_its_two_agree() {
        // tau = beta(gap) / gap, equation 8, from which equation 9 differs by up to 0.8 um, and by 2.1 um at 80.
        for um in 10..=80u8 {
            let um = f32::from(um);
            let tau = (((0.0002044 * um - 0.03767) * um + 2.282) * um - 2.74) / um;
            let charged = Material::SILICON.gap(tau);
            let differs = if um <= 75.0 { 0.8 } else { 2.2 };
            assert!((charged.gap.0 - um).abs() < differs && charged.inside, "{um} um, {tau} us: {charged:?}");
        }
        assert!(Material::SILICON.gap(0.52).gap.0 > 80.0 && Material::SILICON.gap(1.66).gap.0 < 10.0);
    }

    #[test]
    fn beyond_what_was_calibrated_the_nearest_is_given_and_said_so() {
        for (tau, nearest) in [(0.1, 0.52), (2.0, 1.66), (f32::NAN, 0.52), (f32::INFINITY, 1.66)] {
            let charged = Material::SILICON.gap(tau);
            assert_eq!((charged.gap, charged.inside), (Material::SILICON.gap(nearest).gap, false), "{tau}");
        }
    }

    #[test]
    fn captures_are_averaged() {
        assert_eq!(Material::SILICON.of_captures(0, 0), None);
        let one = Material::SILICON.of_captures(168, 1).unwrap();
        assert_eq!((one, Material::SILICON.of_captures(16 * 168, 16)), (Material::SILICON.gap(1.0), Some(one)));
    }

    #[test]
    fn the_table_of_the_source_gives_its_polynomial_within_what_its_repeats_span() {
        // [X] table 2: gap, three repeats of tau.
        let table = [
            (10.0, [1.62, 1.63, 1.64]),
            (15.0, [1.58, 1.57, 1.57]),
            (20.0, [1.51, 1.52, 1.49]),
            (25.0, [1.37, 1.39, 1.36]),
            (30.0, [1.23, 1.22, 1.24]),
            (35.0, [1.1, 1.13, 1.12]),
            (40.0, [1.02, 1.05, 1.04]),
            (45.0, [0.95, 0.93, 0.94]),
            (50.0, [0.86, 0.88, 0.87]),
            (55.0, [0.78, 0.77, 0.77]),
            (60.0, [0.71, 0.72, 0.70]),
            (65.0, [0.66, 0.65, 0.65]),
            (70.0, [0.61, 0.62, 0.60]),
            (75.0, [0.57, 0.58, 0.57]),
            (80.0, [0.54, 0.55, 0.54]),
        ];
        let steps: Vec<(f32, f32)> = table.iter().flat_map(|(gap, taus)| taus.map(|tau| (tau, *gap))).collect();
        let fitted = Material::fit(&steps).unwrap();
        for (tau, _) in steps {
            let (ours, theirs) = (fitted.gap(tau).gap.0, Material::SILICON.gap(tau).gap.0);
            assert!((ours - theirs).abs() < 1.2, "{tau} us: {ours} for {theirs}");
        }
    }

    #[test]
    fn steps_that_make_no_polynomial_are_refused() {
        let line = |taus: &[f32]| taus.iter().map(|tau| (*tau, 100.0 - 50.0 * tau)).collect::<Vec<_>>();
        assert_eq!(Material::fit(&[]), Err(CalibrationError::TooFew));
        assert_eq!(Material::fit(&line(&[1.0; 20])), Err(CalibrationError::TooFew));
        assert_eq!(Material::fit(&line(&[0.5, 1.0, 1.5, 1.5])), Err(CalibrationError::TooFew));
        assert!(Material::fit(&line(&[0.5, 1.0, 1.2, 1.5])).is_ok());
        assert_eq!(Material::fit(&[(f32::NAN, 1.0)]), Err(CalibrationError::Step));
        assert_eq!(Material::fit(&[(1.0, f32::INFINITY)]), Err(CalibrationError::Step));
        let rising = [(0.5, 10.0), (0.8, 20.0), (1.1, 30.0), (1.4, 40.0)];
        assert_eq!(Material::fit(&rising), Err(CalibrationError::NotFalling));
    }

    proptest! {
        #[test]
        fn a_fit_finds_the_polynomial_that_its_steps_are_of(
            scale in 0.5f32..3.0, stretch in 0.5f32..2.0, count in 8usize..40,
        ) {
            let [a, b, c, d] = Material::SILICON.coefficients();
            let known = [a * scale / stretch.powi(3), b * scale / stretch.powi(2), c * scale / stretch, d * scale];
            let known = Material::new(known, 0.54 * stretch, 1.63 * stretch).unwrap();
            let tau = |i: usize| (0.54 + 1.09 * i as f32 / (count - 1) as f32) * stretch;
            let steps: Vec<(f32, f32)> = (0..count).map(|i| (tau(i), known.gap(tau(i)).gap.0)).collect();
            let fitted = Material::fit(&steps).unwrap();
            for (tau, gap) in steps {
                prop_assert!((fitted.gap(tau).gap.0 - gap).abs() < 0.01 * scale, "{} us: {:?} for {}", tau, fitted.gap(tau), gap);
            }
        }

        #[test]
        fn no_steps_make_it_fail(steps: Vec<(f32, f32)>) {
            if let Ok(material) = Material::fit(&steps) {
                prop_assert!(material.gap(1.0).gap.0.is_finite());
            }
        }
    }
}

//! The discrete Fourier transform of one length, a power of two.
//!
//! Radix 2, decimated in time. A library's transform chooses among the vector instructions that the computer has, so that last
//! digits would depend on it; and it was more than half of what this package took to build.

use std::f64::consts::TAU;

/// A complex number.
type Complex = (f64, f64);

/// Tables and room for one length.
#[derive(Debug)]
pub struct Fourier {
    /// Half a turn in equal steps, clockwise.
    turns: Vec<Complex>,
    values: Vec<Complex>,
}

impl Fourier {
    /// For so many values, a power of two of at least 2.
    pub fn new(length: usize) -> Fourier {
        debug_assert!(length.is_power_of_two() && length >= 2, "{length}");
        let angle = |i| -TAU * i as f64 / length as f64;
        let turns = (0..length / 2).map(|i| (angle(i).cos(), angle(i).sin())).collect();
        Fourier { turns, values: vec![(0.0, 0.0); length] }
    }

    /// The spectrum of real values: sum of x(n) exp(-2 pi i k n / N) for every k.
    pub fn transform(&mut self, input: &[f64]) -> &[Complex] {
        let length = self.values.len();
        let unused = usize::BITS - length.trailing_zeros();
        for (i, value) in self.values.iter_mut().enumerate() {
            *value = (input.get(i.reverse_bits() >> unused).copied().unwrap_or(0.0), 0.0);
        }
        let mut half = 1;
        while half < length {
            for pair in self.values.chunks_exact_mut(2 * half) {
                let (evens, odds) = pair.split_at_mut(half);
                let turns = self.turns.iter().step_by(length / 2 / half);
                for ((even, odd), turn) in evens.iter_mut().zip(odds).zip(turns) {
                    let turned = (odd.0 * turn.0 - odd.1 * turn.1, odd.0 * turn.1 + odd.1 * turn.0);
                    *odd = (even.0 - turned.0, even.1 - turned.1);
                    *even = (even.0 + turned.0, even.1 + turned.1);
                }
            }
            half *= 2;
        }
        &self.values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spectrum_is_the_sum_that_defines_it() {
        for length in [2, 4, 64, 1024] {
            let input: Vec<f64> = (0..length).map(|i| ((i * i + 3 * i) % 17) as f64 - 8.0).collect();
            let mut fourier = Fourier::new(length);
            for (k, (re, im)) in fourier.transform(&input).iter().enumerate() {
                let turn = |i| -TAU * (i * k % length) as f64 / length as f64;
                let sum = |part: fn(f64) -> f64| input.iter().enumerate().map(|(i, x)| x * part(turn(i))).sum::<f64>();
                let (cosines, sines) = (sum(f64::cos), sum(f64::sin));
                assert!((re - cosines).abs() < 1e-9 && (im - sines).abs() < 1e-9, "{k} of {length}");
            }
        }
    }
}

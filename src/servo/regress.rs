//! Least squares over many rows, as sums that grow by whole numbers.
//!
//! A row is y = a . x + residual with up to [`WIDTH`] regressors. Counts and codes are whole numbers, so the sums of their products
//! are exact in 64 bits, whatever their order: nothing is lost by cancellation while they grow. They are solved once, in double
//! precision, outside of every tick.

/// Regressors of a row at the most.
pub const WIDTH: usize = 5;
/// Products of two of them.
const PAIRS: usize = WIDTH * (WIDTH + 1) / 2;

/// Normal equations. With |y| and |x| below 2^23 they hold 100 000 rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Normal {
    rows: u32,
    square: i64,
    with: [i64; WIDTH],
    pairs: [i64; PAIRS],
}

/// Coefficients with their standard deviations, as far as the residuals of the rows show them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fit {
    /// Coefficients; 0 for a regressor that was left out.
    pub value: [f64; WIDTH],
    /// Standard deviation of each, for residuals that do not depend on each other.
    pub deviation: [f64; WIDTH],
}

impl Normal {
    /// No row.
    pub const NONE: Normal = Normal { rows: 0, square: 0, with: [0; WIDTH], pairs: [0; PAIRS] };

    /// Adds a row.
    pub fn take(&mut self, y: i64, x: &[i64; WIDTH]) {
        self.rows = self.rows.saturating_add(1);
        self.square = self.square.wrapping_add(y.wrapping_mul(y));
        for (with, x) in self.with.iter_mut().zip(x) {
            *with = with.wrapping_add(x.wrapping_mul(y));
        }
        let products = x.iter().enumerate().flat_map(|(row, a)| x.iter().take(row + 1).map(move |b| (a, b)));
        for (pair, (a, b)) in self.pairs.iter_mut().zip(products) {
            *pair = pair.wrapping_add(a.wrapping_mul(*b));
        }
    }

    /// Rows so far.
    pub fn rows(&self) -> u32 {
        self.rows
    }

    /// The fit by the regressors that are `used`; `None` where the rows do not tell them apart.
    pub fn fit(&self, used: [bool; WIDTH]) -> Option<Fit> {
        let count = used.iter().filter(|used| **used).count();
        if (self.rows as usize) <= count {
            return None;
        }
        // Each regressor has a mean square of one then: what is left in a pivot is the share that the others do not explain.
        let mut scale = [0.0; WIDTH];
        let mut matrix = [[0.0; 2 * WIDTH]; WIDTH];
        for (row, scale) in scale.iter_mut().enumerate() {
            let square = self.pair(row, row);
            *scale = if used[row] && square > 0.0 { 1.0 / libm::sqrt(square) } else { 0.0 };
        }
        for row in 0..WIDTH {
            for column in 0..WIDTH {
                matrix[row][column] = self.pair(row, column) * scale[row] * scale[column];
            }
            if scale[row] == 0.0 {
                if used[row] {
                    return None;
                }
                matrix[row][row] = 1.0;
            }
            matrix[row][WIDTH + row] = 1.0;
        }
        // Gauss and Jordan: the matrix is positive definite, so that its diagonal has the pivots.
        for pivot in 0..WIDTH {
            let by = matrix[pivot][pivot];
            if by.is_nan() || by < LEAST {
                return None;
            }
            matrix[pivot].iter_mut().for_each(|entry| *entry /= by);
            let lead = matrix[pivot];
            for (row, entries) in matrix.iter_mut().enumerate() {
                let factor = entries[pivot];
                if row != pivot {
                    entries.iter_mut().zip(&lead).for_each(|(entry, lead)| *entry -= factor * lead);
                }
            }
        }
        let mut fit = Fit::default();
        let mut explained = 0.0;
        for row in 0..WIDTH {
            let sum = |column: usize| matrix[row][WIDTH + column] * scale[column] * self.with[column] as f64;
            fit.value[row] = (0..WIDTH).map(sum).sum::<f64>() * scale[row];
            explained += fit.value[row] * self.with[row] as f64;
        }
        let left = (self.square as f64 - explained).max(0.0) / (self.rows as usize - count) as f64;
        for row in 0..WIDTH {
            fit.deviation[row] = libm::sqrt(left * matrix[row][WIDTH + row]) * scale[row];
        }
        Some(fit)
    }

    fn pair(&self, a: usize, b: usize) -> f64 {
        let (low, high) = (a.min(b), a.max(b));
        self.pairs.get(high * (high + 1) / 2 + low).copied().unwrap_or(0) as f64
    }
}

/// Share of a regressor that has to be left when the others have explained what they can.
const LEAST: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;

    /// A row of regressors that hang together a little, and noise of +-`noise`.
    fn rows(noise: i64, count: u32) -> Normal {
        let mut normal = Normal::NONE;
        let mut seed = 1u32;
        let mut random = |most: i64| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            i64::from(seed >> 8) % (2 * most + 1) - most
        };
        for _ in 0..count {
            let a = random(40_000);
            let x = [a, random(2000), a / 3000 + random(50), random(100_000), 1];
            let y =
                70 * x[0] - 900 * x[1] + 30_000 * x[2] + 2 * x[3] - 12_345 + if noise > 0 { random(noise) } else { 0 };
            normal.take(y, &x);
        }
        normal
    }

    #[test]
    fn what_has_no_noise_is_found_exactly() {
        let fit = rows(0, 2000).fit([true; WIDTH]).unwrap();
        for (value, truth) in fit.value.iter().zip([70.0, -900.0, 30_000.0, 2.0, -12_345.0]) {
            assert!((value - truth).abs() < truth.abs() * 1e-5, "{value} is not {truth}");
        }
    }

    #[test]
    fn the_deviation_is_that_of_the_noise() {
        // Uniform over +-60000: 34641 rms; the intercept of n rows has that over the root of n.
        let fit = rows(60_000, 4000).fit([true; WIDTH]).unwrap();
        assert!((fit.deviation[4] / (34_641.0 / 4000f64.sqrt()) - 1.0).abs() < 0.1, "{}", fit.deviation[4]);
        for ((value, truth), deviation) in
            fit.value.iter().zip([70.0, -900.0, 30_000.0, 2.0, -12_345.0]).zip(fit.deviation)
        {
            assert!((value - truth).abs() < 4.0 * deviation && deviation > 0.0, "{value}, {truth} +- {deviation}");
        }
    }

    #[test]
    fn a_regressor_that_is_left_out_is_zero_and_one_that_says_nothing_is_refused() {
        let mut normal = Normal::NONE;
        (1..100).for_each(|n| normal.take(3 * n, &[n, 2 * n, 0, 0, 1]));
        assert_eq!(normal.fit([true, true, false, false, true]), None, "twice the same");
        assert_eq!(normal.fit([true, false, true, false, true]), None, "always zero");
        let fit = normal.fit([true, false, false, false, true]).unwrap();
        assert!((fit.value[0] - 3.0).abs() < 1e-9 && fit.value[4].abs() < 1e-6 && fit.value[1] == 0.0, "{fit:?}");
        assert_eq!(Normal::NONE.fit([true, false, false, false, false]), None);
    }
}

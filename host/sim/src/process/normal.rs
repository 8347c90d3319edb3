//! Normal noise from a table of quantiles.
//!
//! A conversion's noise ends in a code, tenths of its deviation apart: [`QUANTILES`] equally likely values instead of a
//! continuum do not show there. Twelve random bits choose one, so that five come out of a word; drawing the same from an
//! exact distribution took a quarter of a simulation's time. The largest is 3.7 deviations, the deviation exactly one.

use super::random::Random;
use edm_hal_shim::gap::BLOCK;
use rand::Rng;
use std::array;
use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::sync::LazyLock;

/// Bits that choose a quantile.
const BITS: u32 = 12;
/// Values to choose from.
const QUANTILES: usize = 1 << BITS;
/// Values out of one word.
const PER_WORD: usize = 5;

static TABLE: LazyLock<Box<[f32; QUANTILES]>> = LazyLock::new(table);

/// Independent values for a block, of mean 0 and deviation 1.
pub fn block(random: &mut Random) -> [f32; BLOCK] {
    const { assert!(BLOCK.is_multiple_of(PER_WORD) && PER_WORD * BITS as usize <= 64) };
    let table = &**TABLE;
    let mut values = [0.0; BLOCK];
    for five in values.as_chunks_mut::<PER_WORD>().0 {
        *five = of_word(table, random.next_u64());
    }
    values
}

/// Two of them, at the price of two: the stream continues as after a block.
pub fn pair(random: &mut Random) -> [f32; 2] {
    let [first, second, ..] = of_word(&TABLE, random.next_u64());
    for _ in 1..BLOCK / PER_WORD {
        random.next_u64();
    }
    [first, second]
}

/// Leaves out a [`pair`].
pub fn skip_pair(random: &mut Random) {
    for _ in 0..BLOCK / PER_WORD {
        random.next_u64();
    }
}

/// One of them.
pub fn one(random: &mut Random) -> f32 {
    TABLE[random.next_u64() as usize % QUANTILES]
}

fn of_word(table: &[f32; QUANTILES], word: u64) -> [f32; PER_WORD] {
    array::from_fn(|k| table[(word >> (BITS as usize * k)) as usize % QUANTILES])
}

/// The middles of equally likely classes, scaled to a deviation of one.
fn table() -> Box<[f32; QUANTILES]> {
    let mut upper = [0.0f64; QUANTILES / 2];
    let mut x = 0.0f64;
    for (k, value) in upper.iter_mut().enumerate() {
        // Newton from the quantile before; above the median the distribution bends the way that lets it converge.
        let tail = 0.5 - (k as f64 + 0.5) / QUANTILES as f64;
        for _ in 0..8 {
            let density = (-0.5 * x * x).exp() / (2.0 * PI).sqrt();
            x += (0.5 * libm::erfc(x * FRAC_1_SQRT_2) - tail) / density;
        }
        *value = x;
    }
    let deviation = (upper.iter().map(|x| x * x).sum::<f64>() / upper.len() as f64).sqrt();
    let mut table = Box::new([0.0; QUANTILES]);
    for (k, x) in upper.iter().enumerate() {
        let value = (x / deviation) as f32;
        table[QUANTILES / 2 + k] = value;
        table[QUANTILES / 2 - 1 - k] = -value;
    }
    table
}

#[cfg(test)]
mod tests {
    use super::super::random::Cause;
    use super::*;

    #[test]
    fn the_table_is_that_of_the_normal_distribution() {
        let table = table();
        assert!(table.is_sorted());
        let moment = |power: i32| table.iter().map(|x| f64::from(*x).powi(power)).sum::<f64>() / QUANTILES as f64;
        assert!(moment(1).abs() < 1e-9 && (moment(2) - 1.0).abs() < 1e-6 && moment(3).abs() < 1e-9);
        // Of the normal distribution 3; what is beyond the last class is missing.
        assert!((moment(4) - 3.0).abs() < 0.03, "{}", moment(4));
        // Tabulated quantiles.
        for (share, quantile) in [(0.75, 0.674_490), (0.9, 1.281_552), (0.975, 1.959_964), (0.999, 3.090_232)] {
            let found = table[(share * QUANTILES as f64) as usize];
            assert!((found - quantile).abs() < 0.03, "{share}: {found}");
        }
    }

    #[test]
    fn values_of_a_block_scatter_by_one_and_know_nothing_of_each_other() {
        let mut random = Cause::FrontEnd.stream(1);
        let values: Vec<f64> = (0..8000).flat_map(|_| block(&mut random)).map(f64::from).collect();
        let n = values.len() as f64;
        assert!((values.iter().sum::<f64>() / n).abs() < 0.01);
        assert!((values.iter().map(|x| x * x).sum::<f64>() / n - 1.0).abs() < 0.01);
        for lag in 1..=BLOCK {
            let together = values.iter().zip(&values[lag..]).map(|(a, b)| a * b).sum::<f64>() / n;
            assert!(together.abs() < 0.01, "lag {lag}: {together}");
        }
    }
}

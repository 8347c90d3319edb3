//! The filter chain in f32 against `scipy.signal` in f64, on the vectors of tests/vectors/make.py.

use edm_hal_shim::gap::BLOCK;
use edm_servo_head::dsp::chain::{Config, State};
use edm_servo_head::units::Hertz;

/// Largest difference from the reference that is allowed, converter codes rms.
pub const BOUND: f64 = 0.01;
/// Ticks from one value of the reference to the next.
const STRIDE: usize = 20;

const CASES: &str = include_str!("../../vectors/cases.csv");
const EXPECTED: &[u8] = include_bytes!("../../vectors/expected.f64");
const TONES: &[u8] = include_bytes!("../../vectors/tones.sums");
const PULSES: &[u8] = include_bytes!("../../vectors/pulses.sums");

/// A signal, how it is filtered, and what comes out by the reference.
pub struct Case {
    /// As cases.csv has it: signal, corner, mains frequency, Q, second harmonic.
    pub name: &'static str,
    /// How it is filtered.
    pub config: Config,
    input: Vec<f32>,
    expected: Vec<f64>,
}

fn words<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [u8; N]> {
    bytes.as_chunks().0.iter().copied()
}

/// Every case of the vectors.
pub fn cases() -> Vec<Case> {
    let expected: Vec<f64> = words(EXPECTED).map(f64::from_le_bytes).collect();
    let per_case = expected.len() / CASES.lines().count();
    let of_line = |(name, expected): (&'static str, &[f64])| {
        let field: Vec<&str> = name.split(',').collect();
        let number = |i: usize| field[i].parse::<f32>().expect("a number in cases.csv");
        let sums = if field[0] == "tones" { TONES } else { PULSES };
        Case {
            name,
            config: Config {
                corner: Hertz(number(1)),
                mains: Hertz(number(2)),
                notch_q: number(3),
                second_harmonic: number(4) != 0.0,
                follow: false,
            },
            input: words(sums).map(|sum| u32::from_le_bytes(sum) as f32 / BLOCK as f32).collect(),
            expected: expected.to_vec(),
        }
    };
    CASES.lines().zip(expected.chunks_exact(per_case)).map(of_line).collect()
}

impl Case {
    /// Rms difference from the reference when it is filtered by `config`, codes, start-up from zero included.
    pub fn error(&self, config: Config) -> f64 {
        let coefficients = config.build().expect("a configuration of cases.csv");
        let mut state = State::default();
        let output: Vec<f32> = self.input.iter().map(|&x| state.tick(&coefficients, x)).collect();
        let at_stride = output.iter().skip(STRIDE - 1).step_by(STRIDE).map(|&y| f64::from(y));
        assert_eq!(at_stride.len(), self.expected.len());
        let squares: f64 = at_stride.zip(&self.expected).map(|(y, e)| (y - e).powi(2)).sum();
        (squares / self.expected.len() as f64).sqrt()
    }
}

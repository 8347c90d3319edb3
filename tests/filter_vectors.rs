//! The f32 filter chain against `scipy.signal` in f64, on the vectors of tests/vectors/make.py.

use edm_hal_shim::gap::BLOCK;
use edm_servo_head::dsp::chain::{Config, State};
use edm_servo_head::units::Hertz;

const STRIDE: usize = 20;
/// Converter codes, rms.
const BOUND: f64 = 0.01;

struct Case {
    name: String,
    config: Config,
    input: Vec<f32>,
    expected: Vec<f64>,
}

fn vectors(file: &str) -> Vec<u8> {
    std::fs::read(format!("{}/tests/vectors/{file}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn cases() -> Vec<Case> {
    let expected: Vec<f64> =
        vectors("expected.f64").chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect();
    let list = String::from_utf8(vectors("cases.csv")).unwrap();
    let per_case = expected.len() / list.lines().count();
    let of_line = |(line, expected): (&str, &[f64])| {
        let field: Vec<&str> = line.split(',').collect();
        let number = |i: usize| field[i].parse::<f32>().unwrap();
        let sums = vectors(&format!("{}.sums", field[0]));
        Case {
            name: line.to_owned(),
            config: Config {
                corner: Hertz(number(1)),
                mains: Hertz(number(2)),
                notch_q: number(3),
                second_harmonic: number(4) != 0.0,
            },
            input: sums
                .chunks_exact(4)
                .map(|b| u32::from_le_bytes(b.try_into().unwrap()) as f32 / BLOCK as f32)
                .collect(),
            expected: expected.to_vec(),
        }
    };
    list.lines().zip(expected.chunks_exact(per_case)).map(of_line).collect()
}

/// Rms difference from the reference, codes, start-up from zero included.
fn error(case: &Case, config: Config) -> f64 {
    let coefficients = config.build().unwrap();
    let mut state = State::default();
    let output: Vec<f32> = case.input.iter().map(|&x| state.tick(&coefficients, x)).collect();
    let at_stride: Vec<f64> = output.iter().skip(STRIDE - 1).step_by(STRIDE).map(|&y| f64::from(y)).collect();
    assert_eq!(at_stride.len(), case.expected.len());
    let squares: f64 = at_stride.iter().zip(&case.expected).map(|(y, e)| (y - e).powi(2)).sum();
    (squares / case.expected.len() as f64).sqrt()
}

#[test]
fn every_case_agrees_with_the_reference_within_a_hundredth_of_a_code() {
    let cases = cases();
    assert_eq!(cases.len(), 18);
    for case in &cases {
        let error = error(case, case.config);
        println!("{:30} {error:.5} codes rms", case.name);
        assert!(error <= BOUND, "{}: {error} codes rms", case.name);
    }
}

#[test]
fn the_vectors_would_tell_a_corner_that_is_a_thousandth_off() {
    for case in &cases() {
        let corner = case.config.corner.0;
        let corner = Hertz(if corner < 2000.0 { corner * 1.001 } else { corner / 1.001 });
        let error = error(case, Config { corner, ..case.config });
        assert!(error > BOUND, "{}: {error} codes rms", case.name);
    }
}

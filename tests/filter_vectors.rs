//! The f32 filter chain against `scipy.signal` in f64, on the vectors of tests/vectors/make.py.

#[path = "gates/gap/filter.rs"]
mod filter;

use edm_servo_head::dsp::chain::Config;
use edm_servo_head::units::Hertz;
use filter::{BOUND, cases};

#[test]
fn every_case_agrees_with_the_reference_within_a_hundredth_of_a_code() {
    let cases = cases();
    assert_eq!(cases.len(), 18);
    for case in &cases {
        let error = case.error(case.config);
        println!("{:30} {error:.5} codes rms", case.name);
        assert!(error <= BOUND, "{}: {error} codes rms", case.name);
    }
}

#[test]
fn the_vectors_would_tell_a_corner_that_is_a_thousandth_off() {
    for case in &cases() {
        let corner = case.config.corner.0;
        let corner = Hertz(if corner < 2000.0 { corner * 1.001 } else { corner / 1.001 });
        let error = case.error(Config { corner, ..case.config });
        assert!(error > BOUND, "{}: {error} codes rms", case.name);
    }
}

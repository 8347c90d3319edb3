//! Samples through the gap filter: the same on the chip and in the test that runs it.

use crate::gap_filter::{Coefficients, State};

/// Runs steps, noise and silence through a filter of each of three corners, and gives a checksum over every output and every
/// value of state.
pub fn checksum(tick: impl Fn(&[Coefficients; 3], &mut [State; 3], f32) -> f32) -> u32 {
    let section = |g: f32, k: f32| Coefficients { r: g + k, b: g / (1.0 + g * (g + k)), g };
    let mut sum = 0x811c_9dc5_u32;
    let mut add = |value: f32| sum = (sum ^ value.to_bits()).wrapping_mul(0x0100_0193);
    // 20, 200 and 2000 Hz behind 20 kHz; a notch at 50 Hz.
    for g in [0.003_141_6, 0.031_426, 0.324_92] {
        let c = [section(g, 1.847_759), section(g, 0.765_366_9), section(0.007_854, 0.4)];
        let mut sections = [State::default(); 3];
        let mut random = 1_u32;
        for sample in 0..3000 {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let x = match sample / 500 % 3 {
                0 => (random >> 20) as f32,
                1 => 3000.04,
                _ => 0.0,
            };
            add(tick(&c, &mut sections, x));
            sections.iter().for_each(|s| [s.band, s.low, s.lost].into_iter().for_each(&mut add));
        }
    }
    sum
}

//! A recording as the head's converter would have seen it: blocks of 12-bit codes and gates at 500 kS/s.

use super::recording::Recording;
use edm_hal_shim::edges::gate_mask;
use edm_hal_shim::gap::{BLOCK, GapBlock};
use edm_servo_head::units::{ADC_FULL_SCALE, ADC_HZ, CLOCK_HZ};

/// Of a step of the recording: what is nearer to a sample is that sample, and not a mean of it and a second one.
const ROUNDING: f64 = 1e-6;

/// Core cycles a second, and from the beginning of a block to the middle of its first conversion.
const CLOCK: f64 = CLOCK_HZ as f64;
const MIDDLE: f64 = (GapBlock::SPACING - GapBlock::APERTURE / 2) as f64;

/// How volts become codes.
#[derive(Clone, Copy, Debug)]
pub struct Scale {
    /// Code of 0 V.
    pub zero: f32,
    /// Volts per code.
    pub volts_per_code: f32,
}

/// How the gate is known.
#[derive(Clone, Copy, Debug)]
pub enum Gate {
    /// It was recorded, or nothing is known of it: then every conversion is gated, as on a head without the wire.
    AsRecorded,
    /// Open while the voltage is at least so much either way (V), or the current, where it was recorded (A).
    Above(f32, f32),
}

/// Cuts a recording into the blocks that the converter would have made of it; what does not fill one is left out. The
/// comparators switch at `thresholds` (V), the high one and the low one; no edge is finer than a step of the recording. Conversions are gated as on the head, by the edges,
/// and not where a conversion is made of two samples and the gate is closed at one.
pub fn blocks(
    recording: &Recording,
    scale: Scale,
    gate: Gate,
    [high, low]: [f64; 2],
) -> impl Iterator<Item = GapBlock> {
    let open = open(recording, gate);
    let steps = recording.rate / f64::from(ADC_HZ);
    let last = recording.gap_v.len() - 1;
    // A rate reckoned from times that are rounded is off by less than this.
    let conversions = (last as f64 / steps + 1e-3) as usize + 1;
    // Samples from the beginning of a block to the middle of its first conversion.
    let ahead = (MIDDLE / CLOCK * recording.rate).ceil() as usize;
    (0..conversions / BLOCK).map(move |block| {
        let mut made = GapBlock::EMPTY;
        let mut whole = 0;
        for (i, code) in made.codes.iter_mut().enumerate() {
            let at = ((block * BLOCK + i) as f64 * steps).min(last as f64);
            let at = if (at - at.round()).abs() < ROUNDING { at.round() } else { at };
            let (before, behind) = (at.floor() as usize, at.ceil() as usize);
            let share = (at - at.floor()) as f32;
            let volts = recording.gap_v[before] * (1.0 - share) + recording.gap_v[behind] * share;
            *code = (scale.zero + volts / scale.volts_per_code).round().clamp(0.0, ADC_FULL_SCALE.into()) as u16;
            whole |= u32::from(open[before] && open[behind]) << i;
        }
        let begin = block * BLOCK;
        let cycles =
            |sample: f64| ((sample - begin as f64 * steps) / recording.rate * CLOCK + MIDDLE).round().max(0.0) as u16;
        let from = (begin as f64 * steps).ceil() as usize;
        let to = (((begin + BLOCK) as f64 * steps).ceil() as usize).min(last + 1);
        let over = |sample: usize, threshold: f64| f64::from(recording.gap_v[sample].abs()) > threshold;
        let above = |sample: usize| over(sample, high);
        // The first sample of all has none before it: what is open or high then was so before.
        made.gate_was_open = open[from.saturating_sub(1)];
        made.was_high = above(from.saturating_sub(1));
        for sample in from.max(1)..to {
            let at = cycles(sample as f64 - 0.5);
            if open[sample] != open[sample - 1] {
                made.gate_edges.push(at);
            }
            if above(sample) != above(sample - 1) {
                made.high_edges.push(at);
            }
            made.low_rises = made.low_rises.wrapping_add((over(sample, low) && !over(sample - 1, low)).into());
        }
        made.above_low = over(to.max(1) - 1, low);
        // The apertures of the first and the last conversion reach beyond the samples of the block.
        let (first, end) = (from.saturating_sub(ahead + 1), (to + ahead).min(last + 1));
        let mut edges = (first + 1..end)
            .filter(|sample| open[*sample] != open[sample - 1])
            .map(|sample| cycles(sample as f64 - 0.5))
            .peekable();
        let inside: Vec<u16> = std::iter::from_fn(|| edges.next_if(|at| u32::from(*at) <= GapBlock::CYCLES)).collect();
        made.gate = whole & gate_mask(open[first], &inside, edges.next().map_or(u32::MAX, u32::from));
        made
    })
}

fn open(recording: &Recording, gate: Gate) -> Vec<bool> {
    match (gate, &recording.gate) {
        (Gate::AsRecorded, Some(gate)) => gate.clone(),
        (Gate::AsRecorded, None) => vec![true; recording.gap_v.len()],
        (Gate::Above(volts, amps), _) => {
            let flows = |n: usize| recording.gap_i.as_ref().is_some_and(|gap_i| gap_i[n].abs() >= amps);
            recording.gap_v.iter().enumerate().map(|(n, v)| v.abs() >= volts || flows(n)).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCALE: Scale = Scale { zero: 410.0, volts_per_code: 0.1 };

    fn recording(rate: f64, volts: impl Fn(f64) -> f32, open: impl Fn(f64) -> bool, seconds: f64) -> Recording {
        let times: Vec<f64> = (0..=(seconds * rate).round() as usize).map(|n| n as f64 / rate).collect();
        Recording {
            start_s: 0.0,
            rate,
            gap_v: times.iter().map(|t| volts(*t)).collect(),
            gap_i: None,
            gate: Some(times.iter().map(|t| open(*t)).collect()),
        }
    }

    #[test]
    fn a_ramp_is_the_same_ramp_whatever_it_was_sampled_at() {
        for rate in [1e4, 3.3e5, 5e5, 1e6, 7.7e6, 1e7] {
            let ramp = recording(rate, |t| (t * 1e5) as f32, |_| true, 1e-3);
            let blocks: Vec<GapBlock> = blocks(&ramp, SCALE, Gate::AsRecorded, [70.0, 20.0]).collect();
            assert!((19..=20).contains(&blocks.len()), "{rate}: {}", blocks.len());
            for (n, code) in blocks.iter().flat_map(|block| block.codes).enumerate() {
                assert!((f64::from(code) - 410.0 - 2.0 * n as f64).abs() <= 1.0, "{rate}, {n}: {code}");
            }
        }
    }

    #[test]
    fn a_conversion_that_an_edge_of_the_gate_falls_into_is_not_gated() {
        // Open from 10 to 30 us: at 10 MS/s the conversion at 10 us is nearer to the edge than it takes, at 30 us as well.
        let fast = recording(1e7, |_| 0.0, |t| (10.05e-6..30.05e-6).contains(&t), 5e-5);
        let block = blocks(&fast, SCALE, Gate::AsRecorded, [70.0, 20.0]).next().unwrap();
        assert_eq!(block.gate, 0b111_1111_1100_0000);
    }

    #[test]
    fn a_recording_without_a_gate_is_gated_throughout_or_where_there_is_voltage_or_current() {
        let volts = |t: f64| if t < 20e-6 { -40.0 } else { 0.0 };
        let mut none = recording(5e5, volts, |_| false, 5e-5);
        none.gate = None;
        none.gap_i = Some((0..none.gap_v.len()).map(|n| if (10..15).contains(&n) { 5.0 } else { 0.0 }).collect());
        let gate = |how| blocks(&none, SCALE, how, [70.0, 20.0]).next().unwrap().gate;
        assert_eq!(gate(Gate::AsRecorded), GapBlock::ALL);
        assert_eq!(gate(Gate::Above(20.0, 1.0)), (1 << 15) - 1);
        assert_eq!(gate(Gate::Above(20.0, 10.0)), (1 << 10) - 1);
    }
}

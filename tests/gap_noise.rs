//! What chance and mains hum leave of the gap voltage: the floor that control is judged against.

use edm_hal_shim::gap::{BLOCK, GapBlock};
use edm_servo_head::gap::voltage::Config;
use edm_servo_head::gap::{GapSource, Quality, Voltage};
use edm_servo_head::units::{ADC_HZ, TICK_HZ};
use rand::SeedableRng;
use rand_distr::{Distribution, Exp1, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::TAU;

/// 100 V until ignition, 40 V burning, nothing in off-time; the ignition delay is exponential.
struct Pulses {
    period: f64,
    on: f64,
    mean_delay: f64,
    rng: Xoshiro256PlusPlus,
    start: f64,
    delay: f64,
    /// Sum of the mean on-time voltages, and how many.
    truth: (f64, f64),
}

impl Pulses {
    fn new(hz: f64, on_share: f64, mean_delay_share: f64, seed: u64) -> Self {
        // A little off the nominal frequency: 100 kHz exactly would meet the 500 kS/s at the same five phases for ever.
        let period = 1.001_37 / hz;
        let on = on_share / hz;
        let rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        Self { period, on, mean_delay: mean_delay_share * on, rng, start: -period, delay: 0.0, truth: (0.0, 0.0) }
    }

    /// Gap voltage and gate at a time, s; times only ever grow.
    fn at(&mut self, t: f64) -> (f64, bool) {
        while t >= self.start + self.period {
            self.start += self.period;
            let drawn: f64 = Exp1.sample(&mut self.rng);
            self.delay = (drawn * self.mean_delay).min(self.on);
            self.truth.0 += 40.0 + 60.0 * self.delay / self.on;
            self.truth.1 += 1.0;
        }
        let phase = t - self.start;
        (
            if phase >= self.on {
                0.0
            } else if phase < self.delay {
                100.0
            } else {
                40.0
            },
            phase < self.on,
        )
    }
}

/// Filtered readings over `seconds`, after 1 s to settle, V.
fn filtered(config: Config, seconds: f64, mut gap: impl FnMut(f64) -> (f64, bool)) -> Vec<f64> {
    let mut source = Voltage::new(config.build().unwrap());
    let ticks = (f64::from(TICK_HZ) * (1.0 + seconds)) as usize;
    let tick = |tick: usize| {
        let mut block = GapBlock { codes: [0; BLOCK], gate: 0, ..GapBlock::EMPTY };
        for i in 0..BLOCK {
            let (volts, on) = gap((tick * BLOCK + i) as f64 / f64::from(ADC_HZ));
            block.codes[i] = (f64::from(config.zero_code) + volts / f64::from(config.volts_per_code)).round() as u16;
            block.gate |= u32::from(on) << i;
        }
        let reading = source.update(Some(&block));
        assert!(tick == 0 || reading.quality == Quality::Valid);
        f64::from(reading.filtered.0)
    };
    (0..ticks).map(tick).skip(TICK_HZ as usize).collect()
}

fn mean_and_rms(x: &[f64]) -> (f64, f64) {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    (mean, (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt())
}

/// The floor of docs/decisions.md, gated average with the default filters. Operating point: mean ignition delay a
/// quarter of the on-time, on-time 80 %, which puts the mean at 54.7 V.
#[test]
fn chance_alone_scatters_the_reading_by_the_published_floor() {
    for (hz, floor, seconds) in [(1_000.0, 8.1, 30.0), (5_000.0, 3.7, 20.0), (100_000.0, 0.84, 5.0)] {
        let mut pulses = Pulses::new(hz, 0.8, 0.25, 7);
        let (mean, rms) = mean_and_rms(&filtered(Config::default(), seconds, |t| pulses.at(t)));
        println!("{hz:6} Hz: mean {mean:.2} V, {rms:.3} V rms");
        assert!((rms / floor - 1.0).abs() < 0.15, "{hz} Hz: {rms} V rms instead of {floor}");
        let truth = pulses.truth.0 / pulses.truth.1;
        assert!((mean - truth).abs() < 0.5, "{hz} Hz: mean {mean} V instead of {truth} V");
    }
}

#[test]
fn the_gated_mean_is_that_of_the_pulses_at_any_on_time() {
    for (hz, on_share) in [(1_000.0, 0.5), (5_000.0, 0.5), (5_000.0, 0.2), (20_000.0, 0.5), (40_000.0, 0.8)] {
        let mut pulses = Pulses::new(hz, on_share, 0.25, 11);
        let (mean, _) = mean_and_rms(&filtered(Config::default(), 10.0, |t| pulses.at(t)));
        let truth = pulses.truth.0 / pulses.truth.1;
        assert!((mean - truth).abs() < 0.5, "{hz} Hz, on-time {on_share}: mean {mean} V instead of {truth} V");
    }
}

/// Hum of 1 V amplitude on 55 V and 0.5 V rms of noise, whose frequency swings by `drift` Hz every 10 s.
fn hum(drift: f64, gate: impl Fn(f64) -> bool) -> f64 {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(50);
    let hum = move |t: f64| {
        let phase = TAU * 50.0 * t - drift * 10.0 * (TAU * t / 10.0).cos();
        let noise: f64 = StandardNormal.sample(&mut rng);
        (55.0 + phase.sin() + 0.5 * noise, gate(t))
    };
    mean_and_rms(&filtered(Config::default(), 20.0, hum)).1
}

#[test]
fn mains_hum_of_1_v_that_drifts_by_0_2_hz_leaves_less_than_20_mv_rms() {
    let still = hum(0.0, |_| true);
    let drifting = hum(0.2, |_| true);
    let gated = hum(0.2, |t| t * 5000.0 % 1.0 < 0.8);
    println!("{:.1} mV still, {:.1} mV drifting, {:.1} mV gated", still * 1e3, drifting * 1e3, gated * 1e3);
    // Noise alone leaves 0.5 V / 5 * sqrt(2 * 180 Hz / 20 kHz) = 13 mV; drift adds 1 V / 50 / 2 = 10 mV.
    assert!(still < 0.015, "{still} V");
    assert!(drifting < 0.020 && drifting > still, "{drifting} V");
    assert!(gated < 0.025, "{gated} V");
}

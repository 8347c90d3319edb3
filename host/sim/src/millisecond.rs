//! Samples gathered into milliseconds.
//!
//! Code that runs for 20 000 samples a second must be cheap: a sample is added to the running [`Millisecond`], and all
//! else works on whole milliseconds.

use crate::process::Pulses;
use crate::run::Sample;
use edm_servo_head::gap::pulses::Counts;
use edm_servo_head::gap::senses::Senses;
use edm_servo_head::units::{TICK_HZ, TICKS_PER_MS};
use std::f64::consts::{PI, SQRT_2};

/// Motion faster than this is vibration, Hz; slower motion is searched for lines.
pub const VIBRATION_HZ: f64 = 50.0;

/// What the head was about, the more disturbing the higher.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// The feed law leads; control is monitored.
    Eroding,
    /// Anything else that is no disturbance: ready, done, holding.
    #[default]
    Idle,
    /// On the way to the work.
    Seeking,
    /// Going back from a short.
    Retreating,
    /// A fault reaction runs.
    Fault,
}

impl Phase {
    /// From the name of a state in reports.
    pub fn of(state: &str) -> Phase {
        match state {
            "eroding" => Phase::Eroding,
            "seeking" => Phase::Seeking,
            "retreating" => Phase::Retreating,
            "fault" => Phase::Fault,
            _ => Phase::Idle,
        }
    }
}

/// A signal over one millisecond.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Mean of the ticks.
    pub mean: f64,
    /// Smallest tick.
    pub min: f64,
    /// Largest tick.
    pub max: f64,
}

impl Span {
    const NONE: Span = Span { mean: 0.0, min: f64::INFINITY, max: f64::NEG_INFINITY };

    /// Takes a tick; until the last of them the mean is a sum.
    fn add(&mut self, x: f64) {
        self.mean += x;
        // Without a branch: noise takes one in five of them the other way.
        self.min = if x < self.min { x } else { self.min };
        self.max = if x > self.max { x } else { self.max };
    }
}

/// The samples of one millisecond.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Millisecond {
    /// Time of the first tick, s.
    pub t_s: f64,
    /// The most disturbing of its ticks' phases.
    pub phase: Phase,
    /// Electrode, um.
    pub position_um: Span,
    /// Set points of X and Y at the last tick, um.
    pub beside_um: [f64; 2],
    /// Workpiece surface at the last tick, um.
    pub surface_um: f64,
    /// Gap, um.
    pub gap_um: Span,
    /// Gap voltage as measured, V.
    pub gap_v: Span,
    /// Filtered gap voltage, V.
    pub filtered_v: Span,
    /// Mean square of the filtered gap voltage, V^2.
    pub filtered_square: f64,
    /// Gap voltage to keep, V.
    pub setpoint_v: f64,
    /// Duty.
    pub duty: Span,
    /// Mean square of the electrode's velocity above [`VIBRATION_HZ`], um^2/s^2.
    pub vibration_square: f64,
    /// Length the electrode has lost at the last tick, um.
    pub wear_um: f64,
    /// Debris of the front gap at the last tick, in 5 % by volume.
    pub debris: f64,
    /// Mean damage by arcs at the last tick.
    pub damage: f64,
    /// Largest force between electrode and work, N.
    pub contact_n: f64,
    /// Largest force of the film, whichever way, N.
    pub film_n: f64,
    /// Mean square of the electrode's velocity, um^2/s^2.
    pub velocity_square: f64,
    /// What became of the pulses until the last tick.
    pub pulses: Pulses,
    /// What the head takes them for until the last tick.
    pub counts: Counts,
    /// What it takes the gap for at the last tick.
    pub senses: Senses,
}

impl Millisecond {
    pub(crate) fn new(t_s: f64) -> Millisecond {
        Millisecond {
            t_s,
            phase: Phase::Eroding,
            position_um: Span::NONE,
            beside_um: [0.0; 2],
            surface_um: 0.0,
            gap_um: Span::NONE,
            gap_v: Span::NONE,
            filtered_v: Span::NONE,
            filtered_square: 0.0,
            setpoint_v: 0.0,
            duty: Span::NONE,
            vibration_square: 0.0,
            wear_um: 0.0,
            debris: 0.0,
            damage: 0.0,
            contact_n: 0.0,
            film_n: 0.0,
            velocity_square: 0.0,
            pulses: Pulses::default(),
            counts: Counts::default(),
            senses: Senses::NONE,
        }
    }

    fn add(&mut self, sample: &Sample, phase: Phase, vibration: f64) {
        let filtered = f64::from(sample.filtered_v);
        self.phase = self.phase.max(phase);
        self.position_um.add(sample.position_um);
        self.gap_um.add(sample.gap_um);
        self.gap_v.add(f64::from(sample.gap_v));
        self.filtered_v.add(filtered);
        self.filtered_square += filtered * filtered;
        self.duty.add(f64::from(sample.duty));
        self.vibration_square += vibration * vibration;
        self.contact_n = self.contact_n.max(sample.contact_n);
        self.film_n = self.film_n.max(sample.film_n.abs());
        self.velocity_square += sample.velocity_um_s * sample.velocity_um_s;
    }

    /// Makes means of the sums, and takes from the last tick what is of that alone.
    fn finish(mut self, last: &Sample) -> Millisecond {
        let spans = [&mut self.position_um, &mut self.gap_um, &mut self.gap_v, &mut self.filtered_v, &mut self.duty];
        for span in spans {
            span.mean /= f64::from(TICKS_PER_MS);
        }
        self.filtered_square /= f64::from(TICKS_PER_MS);
        self.vibration_square /= f64::from(TICKS_PER_MS);
        self.velocity_square /= f64::from(TICKS_PER_MS);
        (self.beside_um, self.surface_um) = (last.beside_um, last.surface_um);
        self.setpoint_v = f64::from(last.setpoint_v);
        (self.wear_um, self.debris, self.damage) = (last.wear_um, last.debris, last.damage);
        (self.pulses, self.counts, self.senses) = (last.pulses, last.counts, last.senses);
        self
    }
}

/// Takes from a velocity what is slower than [`VIBRATION_HZ`]: a Butterworth high-pass of second order.
#[derive(Debug)]
struct HighPass {
    /// Of the two samples before.
    feedback: [f64; 2],
    gain: f64,
    /// What the next samples get of those before them.
    state: [f64; 2],
}

impl Default for HighPass {
    fn default() -> Self {
        // Bilinear transform of s^2 / (s^2 + sqrt(2) s + 1).
        let k = (PI * VIBRATION_HZ / f64::from(TICK_HZ)).tan();
        let gain = 1.0 / (1.0 + SQRT_2 * k + k * k);
        HighPass { feedback: [2.0 * (k * k - 1.0) * gain, (1.0 - SQRT_2 * k + k * k) * gain], gain, state: [0.0; 2] }
    }
}

impl HighPass {
    fn next(&mut self, x: f64) -> f64 {
        let [a1, a2] = self.feedback;
        let y = self.gain * x + self.state[0];
        self.state = [self.state[1] - 2.0 * self.gain * x - a1 * y, self.gain * x - a2 * y];
        y
    }
}

/// Gathers samples into milliseconds.
#[derive(Debug, Default)]
pub struct Gatherer {
    running: Option<Millisecond>,
    ticks: u32,
    state: &'static str,
    phase: Phase,
    vibration: HighPass,
}

impl Gatherer {
    /// Takes a sample and gives a millisecond when it is whole.
    pub fn add(&mut self, sample: &Sample) -> Option<Millisecond> {
        // Comparing the address first spares reading the name at every tick.
        if !std::ptr::eq(self.state, sample.state) {
            self.state = sample.state;
            self.phase = Phase::of(sample.state);
        }
        let running = self.running.get_or_insert_with(|| Millisecond::new(sample.t_s));
        running.add(sample, self.phase, self.vibration.next(sample.velocity_um_s));
        self.ticks += 1;
        if self.ticks < TICKS_PER_MS {
            return None;
        }
        self.ticks = 0;
        self.running.take().map(|running| running.finish(sample))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(tick: u32, state: &'static str) -> Sample {
        Sample {
            t_s: f64::from(tick) / 20_000.0,
            position_um: f64::from(tick),
            setpoint_um: 0.0,
            velocity_um_s: 0.0,
            surface_um: f64::from(tick) * 2.0,
            gap_um: f64::from(tick),
            gap_v: tick as f32,
            filtered_v: 3.0,
            setpoint_v: 55.0,
            duty: -0.1,
            state,
            film_n: -2.0,
            ..Sample::default()
        }
    }

    #[test]
    fn twenty_ticks_make_a_millisecond_of_mean_and_extremes() {
        let mut gatherer = Gatherer::default();
        let whole: Vec<_> = (0..45).filter_map(|tick| gatherer.add(&sample(tick, "eroding"))).collect();
        assert_eq!(whole.len(), 2);
        let second = whole[1];
        assert!((second.position_um.mean - 29.5).abs() < 1e-9);
        assert_eq!((second.position_um.min, second.position_um.max, second.surface_um), (20.0, 39.0, 78.0));
        assert_eq!((second.t_s, second.phase), (0.001, Phase::Eroding));
        assert!((second.filtered_square - 9.0).abs() < 1e-9);
        assert_eq!(second.film_n, 2.0);
    }

    #[test]
    fn vibration_is_motion_above_its_corner() {
        let rms = |hz: f64| {
            let mut gatherer = Gatherer::default();
            let mut squares = Vec::new();
            for tick in 0..40_000 {
                let t = f64::from(tick) / f64::from(TICK_HZ);
                let velocity_um_s = 3.0 + 1000.0 * SQRT_2 * (2.0 * PI * hz * t).sin();
                let moving = Sample { velocity_um_s, ..sample(tick, "eroding") };
                squares.extend(gatherer.add(&moving).map(|ms| ms.vibration_square));
            }
            (squares[1000..].iter().sum::<f64>() / 1000.0).sqrt()
        };
        // 1 / sqrt(1 + (50 / f)^4).
        for (hz, expected) in
            [(5.0, 10.0), (17.0, 115.0), (50.0, 707.1), (100.0, 970.1), (400.0, 1000.0), (3000.0, 1000.0)]
        {
            assert!((rms(hz) - expected).abs() < 5.0, "{hz} Hz: {}", rms(hz));
        }
    }

    #[test]
    fn one_disturbed_tick_disturbs_its_millisecond() {
        for (state, phase) in [
            ("eroding", Phase::Eroding),
            ("done", Phase::Idle),
            ("seeking", Phase::Seeking),
            ("retreating", Phase::Retreating),
            ("fault", Phase::Fault),
        ] {
            let mut gatherer = Gatherer::default();
            let mut take = |tick| gatherer.add(&sample(tick, if tick == 7 { state } else { "eroding" }));
            let whole: Vec<_> = (0..40).filter_map(&mut take).collect();
            assert_eq!((whole[0].phase, whole[1].phase), (phase, Phase::Eroding), "{state}");
        }
    }
}

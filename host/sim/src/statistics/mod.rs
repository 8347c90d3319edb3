//! The figures by which control is evaluated.
//!
//! *Monitored* is the time in which the feed law leads undisturbed: state eroding, later than [`START_MS`] after eroding
//! first began, and at least [`SETTLE_MS`] after anything else (seek, retreat, fault) ended. Windows are laid back to
//! back into monitored time; one that a disturbance cuts short is dropped whole. All this is taken from milliseconds, so
//! its cost does not show.
//!
//! Chance alone scatters the filtered voltage (docs/decisions.md, "Process model"): control is evaluated by means over
//! [`VOLTAGE_MS`] and by position.

mod cycles;
mod fourier;
mod lines;
mod retreats;

pub use cycles::Cycles;
pub use lines::{Line, Lines};
pub use retreats::Retreats;

use crate::millisecond::{Millisecond, Phase, Span};

/// First eroding that is not monitored, ms: start-up.
pub const START_MS: u32 = 2000;
/// Time after a disturbance that is not monitored, ms: three time constants of the 40 to 60 Hz notch (16 ms each).
pub const SETTLE_MS: u32 = 50;
/// Window of the gap-voltage means, ms.
pub const VOLTAGE_MS: u32 = 100;
/// Window of the electrode's peak-to-peak, ms.
pub const SWING_MS: usize = 500;

/// Decides which time is monitored.
#[derive(Debug, Default)]
struct Monitoring {
    eroding_ms: Option<u32>,
    undisturbed_ms: u32,
}

impl Monitoring {
    fn monitored(&mut self, phase: Phase) -> bool {
        let eroding = phase == Phase::Eroding;
        if eroding || self.eroding_ms.is_some() {
            self.eroding_ms = Some(self.eroding_ms.map_or(0, |ms| ms.saturating_add(1)));
        }
        self.undisturbed_ms = if eroding { self.undisturbed_ms.saturating_add(1) } else { 0 };
        self.undisturbed_ms > SETTLE_MS && self.eroding_ms.is_some_and(|ms| ms >= START_MS)
    }
}

/// Mean and scatter of a signal.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    n: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    fn add(&mut self, x: f64) {
        self.add_known(x, x * x);
    }

    fn add_known(&mut self, mean: f64, mean_square: f64) {
        self.n += 1.0;
        self.sum += mean;
        self.squares += mean_square;
    }

    fn merge(&mut self, other: &Moments) {
        self.n += other.n;
        self.sum += other.sum;
        self.squares += other.squares;
    }

    fn mean(&self) -> Option<f64> {
        (self.n > 0.0).then(|| self.sum / self.n)
    }

    fn deviation(&self) -> Option<f64> {
        let mean = self.mean()?;
        Some((self.squares / self.n - mean * mean).max(0.0).sqrt())
    }

    fn rms(&self) -> Option<f64> {
        (self.n > 0.0).then(|| (self.squares / self.n).sqrt())
    }
}

/// Sums over one voltage window.
#[derive(Clone, Copy, Debug, Default)]
struct Window {
    ms: u32,
    gap_v: Moments,
    error_v: Moments,
    setpoint_v: Moments,
    filtered_v: Moments,
    gap_um: Moments,
    vibration: Moments,
    velocity: Moments,
    duty: Duty,
}

/// Milliseconds by the largest duty in them, in hundredths of full duty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Duty([u32; 101]);

impl Default for Duty {
    fn default() -> Self {
        Duty([0; 101])
    }
}

impl Duty {
    fn add(&mut self, duty: Span) {
        let largest = duty.max.max(-duty.min);
        if let Some(ms) = self.0.get_mut((largest * 100.0).round() as usize) {
            *ms += 1;
        }
    }

    fn merge(&mut self, other: &Duty) {
        self.0.iter_mut().zip(other.0).for_each(|(ms, other)| *ms += other);
    }

    /// Share of the milliseconds in which the duty reached a limit; `None` when there are none.
    pub fn at_limit(&self, limit: f64) -> Option<f64> {
        let sum = |of: &[u32]| of.iter().map(|ms| f64::from(*ms)).sum::<f64>();
        let (all, at) = (sum(&self.0), sum(self.0.get((limit * 100.0).round() as usize..)?));
        (all > 0.0).then_some(at / all)
    }
}

/// Figures in the making.
#[derive(Debug)]
pub struct Statistics {
    monitoring: Monitoring,
    window: Window,
    /// Whole windows: sums over monitored ticks, and the error of each window's mean.
    monitored: Window,
    window_errors: Moments,
    swing: Vec<(f64, f64, f64)>,
    swings: Vec<f64>,
    lines: Lines,
    retreats: Retreats,
    cycles: Cycles,
    eroding_ms: u64,
    /// Milliseconds since the work was first met, but for seeks, and those until the end of what was last machined.
    since_ms: u64,
    machining_ms: u64,
    /// Debris and damage while eroding; contact and film always.
    sums: (f64, f64),
    most: (f64, f64),
}

/// Figures of a run; `None` without monitored time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    /// Mean gap voltage, V.
    pub gap_v_mean: Option<f64>,
    /// Mean of the gap voltage to keep, V.
    pub setpoint_v: Option<f64>,
    /// Deviation of the 100 ms means from the set point, V rms.
    pub gap_v_rms_error: Option<f64>,
    /// Scatter of the filtered gap voltage about its mean, V rms.
    pub filtered_v_rms: Option<f64>,
    /// Mean gap, um.
    pub gap_um_mean: Option<f64>,
    /// Scatter of the gap about its mean, um rms.
    pub gap_um_rms: Option<f64>,
    /// Position ripple: median over 0.5 s windows of the electrode's peak-to-peak motion without feed, um.
    pub position_pp_um: Option<f64>,
    /// Strongest tone of the electrode's motion between 5 and 50 Hz.
    pub line: Option<Line>,
    /// Velocity of the electrode above 50 Hz, mm/s rms.
    pub vibration_mm_s: Option<f64>,
    /// Velocity of the electrode, mm/s rms.
    pub velocity_mm_s: Option<f64>,
    /// Largest duties.
    pub duty: Duty,
    /// Time in which the feed law led, s.
    pub eroding_s: f64,
    /// Time from the first pulse at the work to the end of the last eroding, s: with retreats, jumps and holds between, without seeks.
    pub machining_s: f64,
    /// Backward moves of the electrode by more than 5 um.
    pub long_retreats: u64,
    /// Share of cycles of 100 ms that were short.
    pub short_cycle_ratio: Option<f64>,
    /// Shorts of whole milliseconds.
    pub shorts: u64,
    /// Those from which the electrode moved back by more than 5 um before they ended.
    pub long_retreats_shorted: u64,
    /// Mean debris of the front gap while the feed law leads, in 5 % by volume.
    pub debris: Option<f64>,
    /// Mean damage of the surfaces by arcs, likewise.
    pub damage: Option<f64>,
    /// Largest force between electrode and work, N.
    pub contact_n: f64,
    /// Largest force of the dielectric's film, N.
    pub film_n: f64,
}

impl Default for Statistics {
    fn default() -> Self {
        Self::new()
    }
}

impl Statistics {
    /// Nothing seen yet.
    pub fn new() -> Statistics {
        Statistics {
            monitoring: Monitoring::default(),
            window: Window::default(),
            monitored: Window::default(),
            window_errors: Moments::default(),
            swing: Vec::with_capacity(SWING_MS),
            swings: Vec::new(),
            lines: Lines::new(),
            retreats: Retreats::default(),
            cycles: Cycles::default(),
            eroding_ms: 0,
            since_ms: 0,
            machining_ms: 0,
            sums: (0.0, 0.0),
            most: (0.0, 0.0),
        }
    }

    /// Takes the newest millisecond.
    pub fn add(&mut self, ms: &Millisecond) {
        self.retreats.add(ms);
        self.cycles.add(ms);
        if ms.phase == Phase::Eroding {
            self.eroding_ms += 1;
            self.sums = (self.sums.0 + ms.debris, self.sums.1 + ms.damage);
        }
        let machines = matches!(ms.phase, Phase::Eroding | Phase::Retreating);
        if machines || (self.since_ms > 0 && ms.phase != Phase::Seeking) {
            self.since_ms += 1;
        }
        if machines {
            self.machining_ms = self.since_ms;
        }
        self.most = (self.most.0.max(ms.contact_n), self.most.1.max(ms.film_n));
        if self.monitoring.monitored(ms.phase) {
            self.voltage(ms);
            self.position(ms);
            self.lines.add(ms.position_um.mean);
        } else {
            self.window = Window::default();
            self.swing.clear();
            self.lines.interrupt();
        }
    }

    fn voltage(&mut self, ms: &Millisecond) {
        let window = &mut self.window;
        window.ms += 1;
        window.gap_v.add(ms.gap_v.mean);
        window.error_v.add(ms.gap_v.mean - ms.setpoint_v);
        window.setpoint_v.add(ms.setpoint_v);
        window.filtered_v.add_known(ms.filtered_v.mean, ms.filtered_square);
        window.gap_um.add(ms.gap_um.mean);
        window.vibration.add_known(0.0, ms.vibration_square);
        window.velocity.add_known(0.0, ms.velocity_square);
        window.duty.add(ms.duty);
        if window.ms == VOLTAGE_MS {
            let window = std::mem::take(window);
            self.window_errors.add(window.error_v.mean().unwrap_or_default());
            self.monitored.gap_v.merge(&window.gap_v);
            self.monitored.setpoint_v.merge(&window.setpoint_v);
            self.monitored.filtered_v.merge(&window.filtered_v);
            self.monitored.gap_um.merge(&window.gap_um);
            self.monitored.vibration.merge(&window.vibration);
            self.monitored.velocity.merge(&window.velocity);
            self.monitored.duty.merge(&window.duty);
        }
    }

    fn position(&mut self, ms: &Millisecond) {
        self.swing.push((ms.position_um.min, ms.position_um.mean, ms.position_um.max));
        if self.swing.len() == SWING_MS {
            let line = lines::trend(self.swing.iter().map(|(_, mean, _)| *mean));
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for ((min, _, max), trend) in self.swing.iter().zip(line) {
                low = low.min(min - trend);
                high = high.max(max - trend);
            }
            self.swing.clear();
            self.swings.push(high - low);
        }
    }

    /// The figures so far.
    pub fn figures(&self) -> Figures {
        let mean = |sum: f64| (self.eroding_ms > 0).then(|| sum / self.eroding_ms as f64);
        Figures {
            gap_v_mean: self.monitored.gap_v.mean(),
            setpoint_v: self.monitored.setpoint_v.mean(),
            gap_v_rms_error: self.window_errors.rms(),
            filtered_v_rms: self.monitored.filtered_v.deviation(),
            gap_um_mean: self.monitored.gap_um.mean(),
            gap_um_rms: self.monitored.gap_um.deviation(),
            position_pp_um: median(self.swings.clone()),
            line: self.lines.strongest(),
            vibration_mm_s: self.monitored.vibration.rms().map(|um_s| um_s * 1e-3),
            velocity_mm_s: self.monitored.velocity.rms().map(|um_s| um_s * 1e-3),
            duty: self.monitored.duty,
            eroding_s: self.eroding_ms as f64 * 1e-3,
            machining_s: self.machining_ms as f64 * 1e-3,
            long_retreats: self.retreats.count(),
            short_cycle_ratio: self.cycles.short_ratio(),
            shorts: self.cycles.shorts(),
            long_retreats_shorted: self.cycles.long_retreats(),
            debris: mean(self.sums.0),
            damage: mean(self.sums.1),
            contact_n: self.most.0,
            film_n: self.most.1,
        }
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let upper = *values.get(values.len() / 2)?;
    let lower = *values.get(values.len().saturating_sub(1) / 2)?;
    Some((lower + upper) / 2.0)
}

#[cfg(test)]
mod tests;

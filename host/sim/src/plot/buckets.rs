//! A run of any length in memory of a fixed size: when the columns are full, neighbours are joined.

use crate::millisecond::{Millisecond, Phase, Span};
use edm_servo_head::gap::likelihood::Hazard;

/// Phases that are shaded, in the order of [`Bucket::share`].
pub(super) const SHADED: [Phase; 4] = [Phase::Idle, Phase::Seeking, Phase::Retreating, Phase::Fault];

/// What the head knows of the gap in some of the milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Known {
    /// For how many of them, ms.
    ms: f64,
    /// Its mean in those.
    pub value: f64,
    /// Standard deviation that the head gives it, mean as well.
    pub deviation: f64,
}

impl Known {
    fn of(known: Option<(f32, f32)>) -> Known {
        known.map_or(Known::default(), |(value, deviation)| Known {
            ms: 1.0,
            value: value.into(),
            deviation: deviation.into(),
        })
    }

    fn join(&self, later: &Known) -> Known {
        let ms = self.ms + later.ms;
        let mean = |a: f64, b: f64| if ms > 0.0 { (a * self.ms + b * later.ms) / ms } else { 0.0 };
        Known { ms, value: mean(self.value, later.value), deviation: mean(self.deviation, later.deviation) }
    }

    /// Known for some of the time.
    pub fn is_known(&self) -> bool {
        self.ms > 0.0
    }
}

/// Some milliseconds in one column.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bucket {
    /// Middle of its time, s.
    pub t_s: f64,
    ms: f64,
    pub position_um: Span,
    pub surface_um: f64,
    pub gap_um: Span,
    pub gap_v: Span,
    pub filtered_v: Span,
    pub setpoint_v: f64,
    pub duty: Span,
    pub debris: f64,
    pub damage: f64,
    /// Hazard of ignition, 1/ms.
    pub hazard: Known,
    /// Gap by charging time, um, where the head was calibrated for it.
    pub distance: Known,
    /// Sparks a millisecond.
    pub frequency: Known,
    /// Share of its time in each of [`SHADED`].
    pub share: [f64; 4],
}

impl From<&Millisecond> for Bucket {
    fn from(ms: &Millisecond) -> Self {
        Bucket {
            t_s: ms.t_s + 0.0005,
            ms: 1.0,
            position_um: ms.position_um,
            surface_um: ms.surface_um,
            gap_um: ms.gap_um,
            gap_v: ms.gap_v,
            filtered_v: ms.filtered_v,
            setpoint_v: ms.setpoint_v,
            duty: ms.duty,
            debris: ms.debris,
            damage: ms.damage,
            hazard: Known::of(
                ms.senses.hazard.map(|Hazard { rate, variance }| (rate * 1e-3, rate * 1e-3 * variance.sqrt())),
            ),
            distance: Known::of(
                ms.senses.distance.filter(|charged| charged.inside).map(|charged| (charged.gap.0, 0.0)),
            ),
            frequency: Known::of(ms.senses.frequency.map(|rate| (rate * 1e-3, 0.0))),
            share: SHADED.map(|phase| f64::from(phase == ms.phase)),
        }
    }
}

impl Bucket {
    fn join(&self, later: &Bucket) -> Bucket {
        let ms = self.ms + later.ms;
        let mean = |a: f64, b: f64| (a * self.ms + b * later.ms) / ms;
        let span = |a: Span, b: Span| Span { mean: mean(a.mean, b.mean), min: a.min.min(b.min), max: a.max.max(b.max) };
        let mut share = self.share;
        for (share, later) in share.iter_mut().zip(later.share) {
            *share = mean(*share, later);
        }
        Bucket {
            t_s: mean(self.t_s, later.t_s),
            ms,
            position_um: span(self.position_um, later.position_um),
            surface_um: mean(self.surface_um, later.surface_um),
            gap_um: span(self.gap_um, later.gap_um),
            gap_v: span(self.gap_v, later.gap_v),
            filtered_v: span(self.filtered_v, later.filtered_v),
            setpoint_v: later.setpoint_v,
            duty: span(self.duty, later.duty),
            debris: mean(self.debris, later.debris),
            damage: mean(self.damage, later.damage),
            hazard: self.hazard.join(&later.hazard),
            distance: self.distance.join(&later.distance),
            frequency: self.frequency.join(&later.frequency),
            share,
        }
    }

    /// Start and end, s.
    pub fn time(&self) -> (f64, f64) {
        (self.t_s - self.ms * 0.0005, self.t_s + self.ms * 0.0005)
    }

    /// Eroding for more than half of its time.
    pub fn eroding(&self) -> bool {
        self.share.iter().sum::<f64>() < 0.5
    }
}

/// Columns of equal time.
#[derive(Debug)]
pub(super) struct Buckets {
    columns: usize,
    width_ms: f64,
    full: Vec<Bucket>,
    running: Option<Bucket>,
}

impl Buckets {
    /// At most `2 * columns` and, in a run that is long enough, at least `columns`.
    pub fn new(columns: usize) -> Buckets {
        Buckets { columns, width_ms: 1.0, full: Vec::with_capacity(2 * columns), running: None }
    }

    pub fn add(&mut self, newest: &Bucket) {
        let running = self.running.map_or(*newest, |running| running.join(newest));
        if running.ms < self.width_ms {
            self.running = Some(running);
            return;
        }
        self.running = None;
        self.full.push(running);
        if self.full.len() == 2 * self.columns {
            self.full = self.full.chunks_exact(2).map(|pair| pair[0].join(&pair[1])).collect();
            self.width_ms *= 2.0;
        }
    }

    /// Every column, the last one as far as it has come.
    pub fn all(&self) -> Vec<Bucket> {
        self.full.iter().copied().chain(self.running).collect()
    }
}

/// Means over a window; the window doubles when the columns are full.
#[derive(Debug)]
pub(super) struct Means {
    columns: usize,
    window_ms: u32,
    sum: f64,
    ms: u32,
    full: Vec<(f64, f64)>,
}

impl Means {
    pub fn new(window_ms: u32, columns: usize) -> Means {
        Means { columns, window_ms, sum: 0.0, ms: 0, full: Vec::with_capacity(2 * columns) }
    }

    pub fn add(&mut self, t_s: f64, x: f64) {
        self.sum += x;
        self.ms += 1;
        if self.ms < self.window_ms {
            return;
        }
        self.full.push((t_s + 0.001 - f64::from(self.ms) * 0.0005, self.sum / f64::from(self.ms)));
        (self.sum, self.ms) = (0.0, 0);
        if self.full.len() == 2 * self.columns {
            let join = |pair: &[(f64, f64)]| ((pair[0].0 + pair[1].0) / 2.0, (pair[0].1 + pair[1].1) / 2.0);
            self.full = self.full.chunks_exact(2).map(join).collect();
            self.window_ms *= 2;
        }
    }

    /// Middle of each window, s, and its mean.
    pub fn all(&self) -> &[(f64, f64)] {
        &self.full
    }

    /// Length of the windows, ms.
    pub fn window_ms(&self) -> u32 {
        self.window_ms
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(i: u32) -> Bucket {
        let x = f64::from(i);
        let span = Span { mean: x, min: x - 1.0, max: x + 1.0 };
        Bucket::from(&Millisecond {
            phase: if i.is_multiple_of(2) { Phase::Eroding } else { Phase::Seeking },
            position_um: span,
            surface_um: x,
            gap_um: span,
            gap_v: span,
            filtered_v: span,
            setpoint_v: x,
            duty: span,
            ..Millisecond::new(x / 1000.0)
        })
    }

    #[test]
    fn a_run_of_any_length_fills_between_one_and_two_times_the_columns() {
        for length in [1u32, 19, 20, 21, 39, 40, 1000, 12_345] {
            let mut buckets = Buckets::new(10);
            (0..length).for_each(|i| buckets.add(&ms(i)));
            let all = buckets.all();
            assert!(all.len() <= 20 && (all.len() >= 10 || all.len() == length as usize), "{length}: {}", all.len());
            assert!(all[0].time().0.abs() < 1e-9);
            assert!((all[all.len() - 1].time().1 - f64::from(length) / 1000.0).abs() < 1e-9);
        }
    }

    #[test]
    fn joined_columns_keep_extremes_means_and_shares() {
        let joined = ms(0).join(&ms(1)).join(&ms(2).join(&ms(3)));
        assert_eq!((joined.gap_um.min, joined.gap_um.mean, joined.gap_um.max), (-1.0, 1.5, 4.0));
        assert_eq!(joined.share, [0.0, 0.5, 0.0, 0.0]);
        assert_eq!(joined.surface_um, 1.5);
    }

    #[test]
    fn what_is_not_known_all_the_time_is_the_mean_of_when_it_is() {
        let known = |value, deviation| Known::of(Some((value, deviation)));
        let joined = known(4.0, 1.0).join(&Known::of(None)).join(&known(1.0, 0.0).join(&known(1.0, 2.0)));
        assert_eq!((joined.value, joined.deviation, joined.is_known()), (2.0, 1.0, true));
        let unknown = Known::of(None).join(&Known::of(None));
        assert_eq!((unknown.is_known(), unknown.value), (false, 0.0));
    }

    #[test]
    fn means_keep_their_place_when_their_window_doubles() {
        let mut means = Means::new(10, 5);
        (0..250).for_each(|i| means.add(f64::from(i) / 1000.0, f64::from(i)));
        assert_eq!(means.window_ms(), 40);
        for (t_s, mean) in means.all() {
            assert!((t_s * 1000.0 - (mean + 0.5)).abs() < 1e-6, "{t_s} {mean}");
        }
    }
}

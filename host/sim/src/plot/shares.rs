//! What the head takes the pulses for: shares of all pulses, window by window.

use crate::millisecond::Millisecond;
use edm_servo_head::gap::pulses::{Class, Counts};

/// Classes, from the bottom of the panel to its top.
pub(super) const STACKED: [Class; 5] = [Class::Spark, Class::Open, Class::Uncertain, Class::Arc, Class::Short];

/// Pulses of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    /// Start and end, s.
    pub time: (f64, f64),
    /// Of each of [`STACKED`].
    pulses: [u64; STACKED.len()],
}

impl Window {
    fn join(&self, later: &Window) -> Window {
        let mut pulses = self.pulses;
        pulses.iter_mut().zip(later.pulses).for_each(|(sum, pulses)| *sum += pulses);
        Window { time: (self.time.0, later.time.1), pulses }
    }

    /// Shares of all pulses, %; `None` without a pulse.
    pub fn percent(&self) -> Option<[f64; STACKED.len()]> {
        let all: u64 = self.pulses.iter().sum();
        (all > 0).then(|| self.pulses.map(|pulses| 100.0 * pulses as f64 / all as f64))
    }
}

/// A run of any length in memory of a fixed size: when there are too many windows, neighbours are joined.
#[derive(Debug)]
pub(super) struct Shares {
    most: usize,
    window_ms: u32,
    /// Start of the window under way, and the newest millisecond: its end, and the counts until there.
    begin: Option<(f64, Counts)>,
    newest: (f64, Counts),
    ms: u32,
    full: Vec<Window>,
}

impl Shares {
    /// Windows of so many ms, at most `most` of them.
    pub fn new(window_ms: u32, most: usize) -> Shares {
        let newest = (0.0, Counts::default());
        Shares { most, window_ms, begin: None, newest, ms: 0, full: Vec::with_capacity(most) }
    }

    /// Takes the newest millisecond.
    pub fn add(&mut self, ms: &Millisecond) {
        let end = ms.t_s + 0.001;
        self.newest = (end, ms.counts);
        // The counts are those at the end: what came before the first millisecond's end is of no window.
        if self.begin.is_none() {
            self.begin = Some(self.newest);
            return;
        }
        self.ms += 1;
        if self.ms < self.window_ms {
            return;
        }
        self.full.extend(self.running());
        (self.begin, self.ms) = (Some(self.newest), 0);
        if self.full.len() == self.most {
            self.full = self.full.chunks_exact(2).map(|pair| pair[0].join(&pair[1])).collect();
            self.window_ms *= 2;
        }
    }

    /// What has come since the last full window.
    fn running(&self) -> Option<Window> {
        let ((from, then), (to, now)) = (self.begin?, self.newest);
        let new = now.since(&then);
        (self.ms > 0).then(|| Window { time: (from, to), pulses: STACKED.map(|class| new.class(class).into()) })
    }

    /// Every window, the last one as far as it has come.
    pub fn all(&self) -> Vec<Window> {
        self.full.iter().copied().chain(self.running()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::ms;
    use super::*;
    use crate::millisecond::Phase;

    /// Milliseconds with 3 sparks and an open pulse each, and a pause from 400 to 600.
    fn shares(length: u32) -> Shares {
        let mut shares = Shares::new(100, 8);
        let mut counts = Counts { classes: [u32::MAX - 7; 6], ..Counts::default() };
        for i in 0..length {
            if !(400..600).contains(&i) {
                counts.classes[Class::Spark as usize] = counts.class(Class::Spark).wrapping_add(3);
                counts.classes[Class::Open as usize] = counts.class(Class::Open).wrapping_add(1);
            }
            shares.add(&Millisecond { counts, ..ms(i, Phase::Eroding) });
        }
        shares
    }

    #[test]
    fn shares_are_of_all_pulses_and_a_window_without_one_has_none() {
        let shares = shares(731);
        let percents: Vec<_> = shares.all().iter().map(Window::percent).collect();
        let sparks = Some([75.0, 25.0, 0.0, 0.0, 0.0]);
        assert_eq!(percents, [sparks, sparks, sparks, sparks, None, sparks, sparks, sparks]);
    }

    #[test]
    fn a_long_run_has_longer_windows_and_loses_no_pulse() {
        let shares = shares(3201);
        assert_eq!(shares.all().len(), 4);
        assert!(shares.all().iter().all(|window| (window.time.1 - window.time.0 - 0.8).abs() < 1e-9));
        assert_eq!(shares.all().iter().map(|window| window.pulses.iter().sum::<u64>()).sum::<u64>(), 3000 * 4);
        assert!((shares.all()[3].time.1 - 3.201).abs() < 1e-9);
    }
}

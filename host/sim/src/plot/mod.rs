//! The run as a picture: SVG, the whole run on the left, one second of eroding on the right; a path, if there was one, next to
//! them.
//!
//! The panels share the time: depth, gap voltage, what the head senses of the pulses, gap, debris with damage, duty. Time that is not eroding is shaded. What is drawn is
//! gathered during the run, in memory that does not grow with it (`buckets`): a band from smallest to largest
//! tick, so that nothing short is lost, and a line of means.

mod buckets;
mod figure;
mod figures;
pub(crate) mod panels;
mod shares;
mod sheet;
mod track;

use crate::millisecond::{Millisecond, Phase};
use crate::report::Report;
use buckets::{Bucket, Buckets, Means};
use edm_gcode::Program;
pub use figure::{Curve, Figure};
use shares::Shares;
use std::ops::Range;
use track::Track;

/// Columns of the whole run: about one a pixel.
const COLUMNS: usize = 900;
/// Length of the close-up, ms.
const CLOSE_UP_MS: usize = 1000;
/// Eroding before the first close-up, ms: past the start-up that the figures leave out too.
const CLOSE_UP_FROM_MS: u64 = 2000;
/// Window of the plotted means, ms.
const MEAN_MS: u32 = crate::statistics::VOLTAGE_MS;

/// Windows of the shares of pulses, ms, and at most so many of them; in the close-up.
const SHARES_MS: u32 = 100;
const SHARES: usize = 600;
const CLOSE_SHARES_MS: u32 = 50;

/// What a picture is drawn from.
#[derive(Debug)]
pub struct Picture {
    run: Buckets,
    means: Means,
    shares: Shares,
    close_up: CloseUp,
    track: Track,
}

impl Default for Picture {
    fn default() -> Self {
        Picture {
            run: Buckets::new(COLUMNS),
            means: Means::new(MEAN_MS, COLUMNS),
            shares: Shares::new(SHARES_MS, SHARES),
            close_up: CloseUp::default(),
            track: Track::default(),
        }
    }
}

impl Picture {
    /// Takes the newest millisecond.
    pub fn add(&mut self, ms: &Millisecond) {
        self.run.add(&Bucket::from(ms));
        self.means.add(ms.t_s, ms.gap_v.mean);
        self.shares.add(ms);
        self.close_up.add(ms);
        self.track.add(ms);
    }

    /// Draws the SVG; a path as well, from above and from the side.
    pub fn draw(&self, report: &Report, title: &str, path: Option<&Program>) -> Result<String, String> {
        sheet::draw(self, report, title, path).map_err(|error| format!("the plot could not be drawn: {error}"))
    }
}

/// Draws panels over one time as SVG, under a title and a line that says more.
pub(crate) fn panels(title: &str, more: &str, time: &Range<f64>, panels: &[panels::Panel]) -> Result<String, String> {
    sheet::panels(title, more, time, panels).map_err(|error| format!("the plot could not be drawn: {error}"))
}

/// Draws figures beside and below each other as SVG, under a title and a line that says more.
///
/// # Errors
/// When they cannot be drawn.
pub fn figures(title: &str, more: &str, of: &[Figure]) -> Result<String, String> {
    figures::draw(title, more, of).map_err(|error| format!("the figures could not be drawn: {error}"))
}

/// An undisturbed second of eroding. A later one replaces it each time the eroding before it has doubled, so that it ends
/// up in the later half of a run of unknown length.
#[derive(Debug, Default)]
struct CloseUp {
    eroding_ms: u64,
    from_ms: u64,
    running: Vec<Millisecond>,
    kept: Vec<Millisecond>,
}

impl CloseUp {
    fn add(&mut self, ms: &Millisecond) {
        if ms.phase != Phase::Eroding {
            self.running.clear();
            return;
        }
        self.eroding_ms += 1;
        if self.eroding_ms <= self.from_ms.max(CLOSE_UP_FROM_MS) {
            return;
        }
        self.running.push(*ms);
        if self.running.len() == CLOSE_UP_MS {
            std::mem::swap(&mut self.running, &mut self.kept);
            self.running.clear();
            self.from_ms = 2 * self.eroding_ms;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::millisecond::Span;

    pub(super) fn ms(i: u32, phase: Phase) -> Millisecond {
        let span = Span { mean: 1.0, min: 0.0, max: 2.0 };
        Millisecond {
            phase,
            position_um: span,
            surface_um: 1.0,
            gap_um: span,
            gap_v: span,
            filtered_v: span,
            filtered_square: 1.0,
            setpoint_v: 55.0,
            duty: span,
            ..Millisecond::new(f64::from(i) / 1000.0)
        }
    }

    fn close_up(length: u32, phase: impl Fn(u32) -> Phase) -> Option<(f64, usize)> {
        let mut close_up = CloseUp::default();
        for i in 0..length {
            close_up.add(&ms(i, phase(i)));
        }
        Some((close_up.kept.first()?.t_s, close_up.kept.len()))
    }

    #[test]
    fn the_close_up_is_a_whole_second_past_the_start_up() {
        assert_eq!(close_up(2999, |_| Phase::Eroding), None);
        assert_eq!(close_up(3000, |_| Phase::Eroding), Some((2.0, 1000)));
    }

    #[test]
    fn the_close_up_moves_on_with_the_run() {
        for length in [10_000, 50_000, 100_000] {
            let (at, n) = close_up(length, |_| Phase::Eroding).unwrap();
            assert_eq!(n, 1000);
            assert!(at > 0.4 * f64::from(length) / 1000.0, "{at} s of {length} ms");
        }
    }

    #[test]
    fn the_close_up_is_undisturbed() {
        let disturbed = |i: u32| if i.is_multiple_of(800) { Phase::Retreating } else { Phase::Eroding };
        assert_eq!(close_up(20_000, disturbed), None);
        let (at, _) = close_up(5000, |i| if i == 2500 { Phase::Retreating } else { Phase::Eroding }).unwrap();
        assert_eq!(at, 2.501);
    }
}

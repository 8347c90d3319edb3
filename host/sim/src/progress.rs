//! Progress bar on stderr: shown at once, silent where stderr is no terminal.

use crate::run::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Shows how deep the hole is, or how far along its path the head.
#[derive(Debug)]
pub struct Bar {
    bar: ProgressBar,
    target_mm: f64,
}

impl Bar {
    /// Draws an empty bar at once; draws nothing when `quiet` or when stderr is no terminal.
    pub fn new(target_mm: f64, quiet: bool) -> Bar {
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let style = ProgressStyle::with_template("  {wide_bar} {percent:>3} %  {msg}");
        let bar = ProgressBar::with_draw_target(Some(steps(target_mm)), target);
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_message("simulation starts");
        bar.tick();
        Bar { bar, target_mm }
    }

    /// Moves the bar; drawn 20 times a second at most.
    pub fn show(&self, progress: &Progress) {
        if self.bar.is_hidden() {
            return;
        }
        let Progress { sim_time_s, done_mm, state } = progress;
        let target = self.target_mm;
        self.bar.set_message(format!("{state}, {:.3} of {target} mm, {sim_time_s:.0} s simulated", done_mm.max(0.0)));
        self.bar.set_position(steps(*done_mm));
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// Shows how many runs of a sweep are done.
#[derive(Debug)]
pub struct Runs(ProgressBar);

impl Runs {
    /// Draws a bar with so many runs, some of them done before; nothing when stderr is no terminal.
    pub fn new(runs: usize, before: usize) -> Runs {
        let style = ProgressStyle::with_template("  {wide_bar} {pos} of {len} runs, {eta} left  {msg}");
        let bar = ProgressBar::with_draw_target(Some(runs as u64), ProgressDrawTarget::stderr());
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_position(before as u64);
        // The time left is that of the runs that are still to be made.
        bar.reset_eta();
        bar.tick();
        Runs(bar)
    }

    /// One more is done.
    pub fn finished(&self, label: &str) {
        self.0.set_message(label.to_owned());
        self.0.inc(1);
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        self.0.finish_and_clear();
    }
}

/// Micrometres, the bar's steps.
fn steps(mm: f64) -> u64 {
    (mm * 1000.0).round() as u64
}

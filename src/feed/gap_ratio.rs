//! Gap ratio: PI on the shares of open, short and arcing pulses of a period (control by gap-state ratios, as sinkers have it).
//!
//! The error is the share of open pulses above its set point, less a weight times the shares of shorts and arcs: a wide gap opens
//! pulses, a narrow or dirty one shorts and arcs them, and what sparks is in order. No gains are published with structure and
//! units; these are chosen here.

use super::period::Pulses;
use super::{Answer, FeedLaw, View};
use crate::gap::pulses::Class;
use crate::units::{MicrometresPerSecond, TICK_S, within};

/// Numbers of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GapRatio {
    /// Share of open pulses to keep, 0..=1.
    open: f32,
    /// Weight of shorts and arcs.
    weight: f32,
    /// Path velocity of an error of one.
    gain: MicrometresPerSecond,
    /// Change of velocity in a period at an error of one, um/s, and the most that it adds up to.
    integral: f32,
    most: f32,
    /// Period, servo ticks.
    period: u32,
}

/// What the law remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ratios {
    pulses: Pulses,
    integral: f32,
    /// Until the end of the period.
    answer: Answer,
}

impl GapRatio {
    /// Law that keeps a share of `open` pulses, counts shorts and arcs by `weight`, and moves at `gain` for an error of one; in
    /// `integral` seconds the integral part has grown as large, at a lasting error. Period in servo ticks, at least one.
    pub fn new(open: f32, weight: f32, gain: MicrometresPerSecond, integral: f32, period: u32) -> GapRatio {
        let period = period.max(1);
        let step = if integral > 0.0 { gain.0 * period as f32 * TICK_S / integral } else { 0.0 };
        GapRatio { open, weight, gain, integral: step, most: gain.0, period }
    }
}

impl FeedLaw for GapRatio {
    type State = Ratios;
    const NEEDS_PULSES: bool = true;

    fn act(&self, state: &mut Ratios, view: &View<'_>) -> Answer {
        let Some(new) = state.pulses.ended(self.period, view.ticks, &view.gap.pulses) else {
            return state.answer;
        };
        let total = new.total();
        if total == 0 {
            // What is not known is no reason to move.
            state.answer = Answer::BLIND;
            return state.answer;
        }
        let share = |class| new.class(class) as f32 / total as f32;
        let error = share(Class::Open) - self.open - self.weight * (share(Class::Short) + share(Class::Arc));
        state.integral = within(state.integral + self.integral * error, -self.most, self.most);
        state.answer = Answer::feed(self.gain.0 * error + state.integral);
        state.answer
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feed::Pulsed;

    /// Velocities at the ends of periods of such pulses: open, spark, arc, short.
    fn velocities(integral: f32, periods: &[[u32; 4]]) -> Vec<f32> {
        let law = GapRatio::new(0.2, 2.0, MicrometresPerSecond(100.0), integral, 200);
        let (mut state, mut pulsed) = (Ratios::default(), Pulsed::default());
        pulsed.act(&law, &mut state, 5);
        let mut velocities = Vec::new();
        for [open, spark, arc, short] in periods {
            pulsed.add([*open, *spark, *arc, *short, 0, 0]);
            velocities.push((0..40).map(|_| pulsed.act(&law, &mut state, 5).velocity.0).last().unwrap());
        }
        velocities
    }

    fn close(found: &[f32], expected: &[f32]) {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{found:?}, not {expected:?}");
    }

    #[test]
    fn open_pulses_feed_shorts_and_arcs_retreat() {
        close(&velocities(0.0, &[[100, 0, 0, 0]]), &[80.0]);
        close(&velocities(0.0, &[[20, 80, 0, 0]]), &[0.0]);
        close(&velocities(0.0, &[[20, 60, 10, 10]]), &[-40.0]);
        close(&velocities(0.0, &[[0, 0, 0, 100]]), &[-220.0]);
    }

    #[test]
    fn an_error_that_lasts_grows_to_the_gain_and_no_further() {
        // 80 um/s, and a tenth of it more with each period.
        close(&velocities(0.1, &[[100, 0, 0, 0]; 3]), &[88.0, 96.0, 104.0]);
        let found = velocities(0.1, &[[100, 0, 0, 0]; 100]);
        close(&found[99..], &[180.0]);
    }

    #[test]
    fn a_period_without_pulses_stands() {
        close(&velocities(0.1, &[[100, 0, 0, 0], [0; 4]]), &[88.0, 0.0]);
    }
}

//! Pulse counts: once a period, what the pulses of the period were decides between a step forward, a step back and none (\[G\]: FC,
//! feed control).
//!
//! Shorts from a share on: back. Else enough discharges: hold. Else mostly open: forward. None of these is abnormal: pulses are
//! closed for a while. \[G\] publishes the share of shorts, the number of discharges, step and period; the share of open pulses and
//! the length of the closure are chosen here.

use super::period::Pulses;
use super::{Answer, FeedLaw, Generator, View};
use crate::gap::pulses::{Class, Counts};
use crate::units::{Micrometres, TICK_S};

/// Numbers of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PulseCounts {
    /// Velocity of a step: its length over the period, um/s.
    rate: f32,
    /// Period, servo ticks.
    period: u32,
    /// Shares of all pulses from which the period was short, or open; 0..=1.
    short: f32,
    open: f32,
    /// Discharges from which the head holds.
    discharges: u32,
    /// Servo ticks for which pulses are closed.
    closure: u32,
}

/// What a period was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Verdict {
    /// Enough discharges.
    #[default]
    Hold,
    /// Open.
    Feed,
    /// Shorted.
    Retreat,
    /// Nothing of these: little discharges, and what else there is does not say why.
    Abnormal,
}

/// What the law remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counting {
    pulses: Pulses,
    velocity: f32,
    /// Servo ticks for which pulses are still closed.
    closed: u32,
}

impl PulseCounts {
    /// Law that goes `step` in a period of `period` servo ticks (at least one), and closes the pulses for `closure` of them. Shares
    /// of short and open pulses 0..=1.
    pub fn new(step: Micrometres, period: u32, [short, open]: [f32; 2], discharges: u32, closure: u32) -> PulseCounts {
        let period = period.max(1);
        PulseCounts { rate: step.0 / (period as f32 * TICK_S), period, short, open, discharges, closure }
    }

    fn verdict(&self, new: &Counts) -> Verdict {
        let total = new.total() as f32;
        if total == 0.0 {
            // Nothing was allowed, or the generator is at rest: the supervision knows.
            Verdict::Hold
        } else if new.shorted() as f32 >= self.short * total {
            Verdict::Retreat
        } else if new.discharged() >= self.discharges {
            Verdict::Hold
        } else if new.class(Class::Open) as f32 >= self.open * total {
            Verdict::Feed
        } else {
            Verdict::Abnormal
        }
    }

    /// As the law, and at the end of a period what it was and its pulses.
    pub(super) fn count(&self, state: &mut Counting, view: &View<'_>) -> (Answer, Option<(Verdict, Counts)>) {
        state.closed = state.closed.saturating_sub(view.ticks);
        let ended = state.pulses.ended(self.period, view.ticks, &view.gap.pulses);
        let judged = ended.map(|new| (self.verdict(&new), new));
        if let Some((verdict, _)) = judged {
            state.velocity = match verdict {
                Verdict::Feed => self.rate,
                Verdict::Retreat => -self.rate,
                Verdict::Hold | Verdict::Abnormal => 0.0,
            };
            if verdict == Verdict::Abnormal {
                state.closed = self.closure;
            }
        }
        let generator = Generator { closed: state.closed > 0, ..Generator::FREE };
        (Answer { generator, ..Answer::feed(state.velocity) }, judged)
    }
}

impl FeedLaw for PulseCounts {
    type State = Counting;
    const NEEDS_PULSES: bool = true;

    fn act(&self, state: &mut Counting, view: &View<'_>) -> Answer {
        self.count(state, view).0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feed::Pulsed;

    fn law() -> PulseCounts {
        PulseCounts::new(Micrometres(1.0), 2000, [0.9, 0.5], 150, 200)
    }

    /// Velocity, and whether pulses are closed, after a period of so many pulses: open, spark, arc, short, none, uncertain.
    fn after(classes: [u32; 6]) -> (f32, bool) {
        after_ignited(classes, 0)
    }

    fn after_ignited(classes: [u32; 6], ignited: u32) -> (f32, bool) {
        let (law, mut state, mut pulsed) = (law(), Counting::default(), Pulsed::default());
        pulsed.act(&law, &mut state, 5);
        pulsed.add(classes);
        pulsed.gap.pulses.ignited += ignited;
        // Those that ignited were charged.
        pulsed.gap.pulses.unclear = pulsed.gap.pulses.unclear.saturating_sub(ignited);
        let answers: Vec<_> = (0..400).map(|_| pulsed.act(&law, &mut state, 5)).collect();
        assert!(answers[..399].iter().all(|answer| *answer == Answer::feed(0.0)), "decided before the period was over");
        (answers[399].velocity.0.round(), answers[399].generator.closed)
    }

    #[test]
    fn shorts_go_before_discharges_and_these_before_open_pulses() {
        assert_eq!(after([0, 500, 0, 9500, 0, 0]), (-10.0, false));
        assert_eq!(after([1000, 150, 0, 8850, 0, 0]), (0.0, false));
        assert_eq!(after([9851, 149, 0, 0, 0, 0]), (10.0, false));
        // Brief pulses: those with a delay are discharges, the others shorts.
        assert_eq!(after([9850, 100, 0, 0, 0, 50]), (10.0, false));
        assert_eq!(after_ignited([9850, 100, 0, 0, 0, 50], 150), (0.0, false));
        assert_eq!(after([1000, 0, 0, 0, 0, 9000]), (-10.0, false));
        assert_eq!(after([0; 6]), (0.0, false));
    }

    #[test]
    fn what_is_neither_closes_the_pulses_for_a_while() {
        let (law, mut state, mut pulsed) = (law(), Counting::default(), Pulsed::default());
        pulsed.act(&law, &mut state, 5);
        pulsed.add([2000, 50, 3000, 4000, 0, 0]);
        let closed = (0..800).filter(|_| pulsed.act(&law, &mut state, 5).generator.closed).count();
        // 10 ms of plans of 0.25 ms.
        assert_eq!(closed, 40);
    }
}

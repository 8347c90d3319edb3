//! Pulse control: as [`PulseCounts`], and a longer off-time while the feed goes one way and shorts are frequent (\[G\]: FPCC,
//! feed-pulse collaborative control).
//!
//! The mean direction is f = (1 - w) sum of w^m d(k - m) over the periods, d = 1 for a step forward, -1 back, 0 none; the mean share
//! of shorts that of the last N periods. Where |f| and the share are above their thresholds, the off-time is doubled for a while.
//! \[G\] publishes the doubling, 6 to 12 us; w, N, the thresholds and the time are chosen here.

use super::pulse_counts::{Counting, PulseCounts, Verdict};
use super::{After, Answer, FeedLaw, Generator, View};
use crate::gap::pulses::Counts;
use crate::units::Seconds;

/// Most periods over which the share of shorts is averaged.
pub const PERIODS: usize = 16;

/// Numbers of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PulseControl {
    /// The feed.
    counts: PulseCounts,
    /// w, 0..1, and N, up to [`PERIODS`].
    weight: f32,
    periods: u8,
    /// Thresholds of direction and share of shorts, 0..=1.
    direction: f32,
    shorts: f32,
    /// Off-time while they are exceeded.
    off_time: Seconds,
    /// Servo ticks for which it lasts after that.
    time: u32,
}

/// What the law remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Collaborating {
    counting: Counting,
    direction: f32,
    /// Shares of shorts of the last periods, the oldest at `oldest`.
    shares: [f32; PERIODS],
    oldest: u8,
    /// Servo ticks for which the off-time is still long.
    long: u32,
}

impl PulseControl {
    /// Feed control with pulse control: weight of the periods before 0..1, mean of `periods` shares of shorts, thresholds of direction
    /// and share 0..=1, off-time, and the servo ticks for which it lasts.
    pub fn new(
        counts: PulseCounts,
        weight: f32,
        periods: usize,
        [direction, shorts]: [f32; 2],
        off_time: Seconds,
        time: u32,
    ) -> PulseControl {
        PulseControl { counts, weight, periods: periods.clamp(1, PERIODS) as u8, direction, shorts, off_time, time }
    }

    /// A period is over.
    fn ended(&self, state: &mut Collaborating, verdict: Verdict, new: &Counts) {
        let direction = match verdict {
            Verdict::Feed => 1.0,
            Verdict::Retreat => -1.0,
            Verdict::Hold | Verdict::Abnormal => 0.0,
        };
        state.direction = self.weight * state.direction + (1.0 - self.weight) * direction;
        let total = new.total();
        let share = if total > 0 { new.shorted() as f32 / total as f32 } else { 0.0 };
        let periods = self.periods.max(1);
        if let Some(oldest) = state.shares.get_mut(usize::from(state.oldest)) {
            *oldest = share;
        }
        state.oldest = if state.oldest.wrapping_add(1) < periods { state.oldest.wrapping_add(1) } else { 0 };
        let mean = state.shares.iter().take(periods.into()).sum::<f32>() / f32::from(periods);
        if state.direction.abs() > self.direction && mean > self.shorts {
            state.long = self.time;
        }
    }
}

impl FeedLaw for PulseControl {
    type State = Collaborating;
    const NEEDS_PULSES: bool = true;
    const ASKS_OFF_TIME: bool = true;

    fn act(&self, state: &mut Collaborating, view: &View<'_>) -> Answer {
        state.long = state.long.saturating_sub(view.ticks);
        let (answer, judged) = self.counts.count(&mut state.counting, view);
        if let Some((verdict, new)) = judged {
            self.ended(state, verdict, &new);
        }
        let off_time = if state.long > 0 { self.off_time } else { Seconds(0.0) };
        Answer { generator: Generator { off_time, ..answer.generator }, ..answer }
    }

    /// A retreat or a jump begins another period, and forgets none of those before.
    fn resume(&self, state: &mut Collaborating, after: After) {
        let before = *state;
        *state = Collaborating::default();
        if matches!(after, After::Retreat(_) | After::Jump(_)) {
            *state = Collaborating { counting: Counting::default(), ..before };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feed::Pulsed;
    use crate::units::Micrometres;

    fn law(periods: usize) -> PulseControl {
        let counts = PulseCounts::new(Micrometres(1.0), 2000, [0.9, 0.5], 150, 200);
        PulseControl::new(counts, 0.5, periods, [0.6, 0.5], Seconds(12e-6), 3000)
    }

    /// Off-times at the ends of periods of such pulses: open, spark, arc, short.
    fn off_times(law: &PulseControl, periods: &[[u32; 4]]) -> Vec<f32> {
        let (mut state, mut pulsed) = (Collaborating::default(), Pulsed::default());
        pulsed.act(law, &mut state, 5);
        let mut off_times = Vec::new();
        for [open, spark, arc, short] in periods {
            pulsed.add([*open, *spark, *arc, *short, 0, 0]);
            let last = (0..400).map(|_| pulsed.act(law, &mut state, 5)).last();
            off_times.push(last.unwrap().generator.off_time.0 * 1e6);
        }
        off_times
    }

    const SHORT: [u32; 4] = [0, 0, 0, 1000];
    const SPARKS: [u32; 4] = [500, 500, 0, 0];

    #[test]
    fn retreats_with_many_shorts_make_the_off_time_long_for_its_time() {
        // |f| is 0.5, 0.75: above 0.6 from the second one on; then 0.375. It lasts for a period and a half.
        assert_eq!(off_times(&law(2), &[SHORT, SHORT, SPARKS, SPARKS]), [0.0, 12.0, 12.0, 0.0]);
    }

    #[test]
    fn a_retreat_forgets_no_period_and_a_new_start_all() {
        let (law, mut state) = (law(2), Collaborating { long: 100, direction: 0.5, ..Collaborating::default() });
        law.resume(&mut state, After::Retreat(Micrometres(1.0)));
        assert_eq!((state.long, state.direction), (100, 0.5));
        law.resume(&mut state, After::Start);
        assert_eq!((state.long, state.direction), (0, 0.0));
    }

    #[test]
    fn one_direction_without_shorts_and_shorts_without_a_direction_change_nothing() {
        assert_eq!(off_times(&law(2), &[[1000, 0, 0, 0]; 4]), [0.0; 4]);
        assert_eq!(off_times(&law(2), &[[0, 200, 0, 800]; 4]), [0.0; 4]);
    }

    #[test]
    fn the_share_of_shorts_is_the_mean_of_the_last_periods() {
        let periods = [SHORT, SHORT, SHORT, SPARKS];
        // Of four periods: 0.25, 0.5, 0.75.
        assert_eq!(off_times(&law(4), &periods), [0.0, 0.0, 12.0, 12.0]);
        assert_eq!(off_times(&law(99), &periods), [0.0; 4]);
    }
}

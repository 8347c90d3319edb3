//! Observed gap: estimates the gap from ignitions, waiting times and the head's own motion, and keeps it. Our own law.
//!
//! A gap g ignites at a hazard r = r0 (g0 / g)^3 (docs/gap-sensing.md; the power is that of the process model, fitted there). Pulses
//! that waited for W together and ignited n times have the log-likelihood n ln r - r W: its slope by g is (r W - n) 3 / g, its
//! information r W (3 / g)^2. Between two looks the gap changes by what the head moves, which it knows, and by what is eroded and by
//! debris, which it does not: a second state w, um/s. That is a Kalman filter with a Poisson measurement (extended, one step of Fisher
//! scoring; Fahrmeir, Posterior mode estimation by extended Kalman filtering, JASA 1992). So one ignition moves a sure estimate by
//! little and an unsure one by much, which is all that "how fast may it act" asks.
//!
//! A pulse that burned from the beginning has ignited without waiting: shorts and arcs show a narrow gap. After a retreat the gap is
//! as wide as the way back from where it was bridged.
//!
//! The velocity is w + k (g - m g0 - c s), s the standard deviation of the estimate: unsure, it keeps further away.
//!
//! **What bridges cost decides how narrow is best.** At a rate of sparks that goes with g^-3 and one of bridges that goes with g^-6 (as
//! in the process model), each of which costs a retreat and the way back, most is removed where the time lost is half of all; a
//! little less costs next to nothing and spares arcs and wear. So m grows while the head is on its way back from a retreat, and shrinks
//! while it keeps the gap, in the proportion at which the allowed share of the time is lost: a proportional count of lost
//! milliseconds, and no model of bridges. m is 1 where there are hardly any.

use super::period::Pulses;
use super::{After, Answer, FeedLaw, View};
use crate::gap::pulses::Class;
use crate::units::{CLOCK_HZ, Micrometres, TICK_S, TICKS_PER_MS, larger, smaller, within};
use micromath::F32Ext as Approximate;

/// Servo ticks between two looks: the millisecond.
const PERIOD: u32 = TICKS_PER_MS;
/// Seconds of that.
const T: f32 = PERIOD as f32 * TICK_S;
/// Range of the estimate, over the gap to keep.
const RANGE: (f32, f32) = (0.1, 4.0);
/// Largest erosion or drift, um/s.
const DRIFT: f32 = 200.0;
/// Standard deviations in the beginning: of the gap over the gap to keep, and of the drift, um/s.
const UNSURE: f32 = 0.5;
const DRIFTS: f32 = 20.0;
/// Most information of a look, over one over the variance: what is all but certain is not, for the model is not.
const MOST: f32 = 10.0;
/// How fast the gap to keep is made wider, 1/s, and to how many times the one that is set.
const WIDENING: f32 = 0.2;
const WIDEST: f32 = 2.5;

/// Numbers of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ObservedGap {
    /// Gap to keep, um, and the ignitions in a clock tick of waiting there.
    gap: f32,
    hazard: f32,
    /// Velocity for a um too much, 1/s.
    gain: f32,
    /// Standard deviations that are kept away further.
    caution: f32,
    /// Change of the variances in a look: of the gap, um^2, and of the drift, um^2/s^2.
    noise: [f32; 2],
    /// Share of the time that may be lost on the way back from retreats.
    lost: f32,
}

/// What the law remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Estimate {
    pulses: Pulses,
    /// Way since the last look, um.
    way: f32,
    /// Gap, um; 0: it begins.
    gap: f32,
    /// Drift, um/s.
    drift: f32,
    /// Variances of gap and drift, and their covariance.
    gaps: f32,
    drifts: f32,
    both: f32,
    /// By what the gap to keep is more than m = 1.
    wider: f32,
    /// On the way back from a retreat.
    returning: bool,
    /// Until the next look.
    answer: Answer,
}

impl ObservedGap {
    /// Law that keeps a `gap` in which waiting pulses ignite `hazard` times a second, with `gain` 1/s, `caution` standard deviations
    /// away, for a gap that wanders by `gap_noise` um and a drift that does by `drift_noise` um/s in the root of a second, and that
    /// is kept wider where more than the share `lost` of the time is lost after retreats.
    pub fn new(
        gap: Micrometres,
        hazard: f32,
        gain: f32,
        caution: f32,
        [gap_noise, drift_noise]: [f32; 2],
        lost: f32,
    ) -> ObservedGap {
        ObservedGap {
            gap: larger(gap.0, 1.0),
            hazard: hazard / CLOCK_HZ as f32,
            gain,
            caution,
            noise: [gap_noise * gap_noise * T, drift_noise * drift_noise * T],
            lost,
        }
    }

    /// A gap that is known by so much.
    fn begin(&self, state: &mut Estimate, gap: f32, deviation: f32) {
        state.gap = within(gap, RANGE.0 * self.gap, RANGE.1 * self.gap);
        (state.gaps, state.both) = (deviation * deviation, 0.0);
    }

    /// The gap to keep, um: wider the more of the time is lost on the way back to it.
    fn kept(&self, state: &mut Estimate) -> f32 {
        let kept = self.gap * (1.0 + state.wider);
        state.returning &= state.gap > kept;
        let rate = if state.returning { 1.0 - self.lost } else { -self.lost };
        state.wider = within(state.wider + WIDENING * T * rate, 0.0, WIDEST - 1.0);
        kept
    }

    /// A millisecond goes by.
    fn predict(&self, state: &mut Estimate, moved: f32) {
        state.gap += state.drift * T - moved;
        state.gaps += T * (2.0 * state.both + T * state.drifts) + self.noise[0];
        state.both += T * state.drifts;
        state.drifts = smaller(state.drifts + self.noise[1], DRIFTS * DRIFTS);
        state.gaps = smaller(state.gaps, self.gap * self.gap);
    }

    /// Pulses that waited, core cycles, and ignited.
    fn correct(&self, state: &mut Estimate, waited: f32, ignited: f32) {
        let gap = within(state.gap, RANGE.0 * self.gap, RANGE.1 * self.gap);
        let narrow = self.gap / gap;
        let expected = self.hazard * narrow * narrow * narrow * waited;
        let slope = 3.0 / gap;
        // Where more ignited than expected, the expectation was no measure of what is known.
        let information = larger(expected, ignited) * slope * slope;
        let information = smaller(information, MOST / larger(state.gaps, 1e-3));
        let shrink = 1.0 / (1.0 + state.gaps * information);
        let score = within(
            (expected - ignited) * slope * shrink,
            -gap / larger(state.gaps, 1e-3),
            gap / larger(state.gaps, 1e-3),
        );
        state.gap = within(gap + state.gaps * score, RANGE.0 * self.gap, RANGE.1 * self.gap);
        state.drift = within(state.drift + state.both * score, -DRIFT, DRIFT);
        state.drifts = larger(state.drifts - state.both * state.both * information * shrink, 0.01);
        state.gaps *= shrink;
        state.both *= shrink;
    }
}

impl FeedLaw for ObservedGap {
    type State = Estimate;
    const NEEDS_PULSES: bool = true;

    fn act(&self, state: &mut Estimate, view: &View<'_>) -> Answer {
        state.way += view.motion.moved.0;
        let Some(new) = state.pulses.ended(PERIOD, view.ticks, &view.gap.pulses) else {
            return state.answer;
        };
        if state.gap == 0.0 {
            self.begin(state, self.gap, UNSURE * self.gap);
            state.drifts = DRIFTS * DRIFTS;
        }
        let moved = core::mem::take(&mut state.way);
        self.predict(state, moved);
        let burned = if view.senses.hazard.is_some() {
            new.class(Class::Short).wrapping_add(new.class(Class::Arc))
        } else {
            // None is charged for long: a short, or no comparator that shows when pulses ignite.
            new.shorted().wrapping_add(new.class(Class::Arc))
        };
        if view.senses.hazard.is_none() && burned == 0 {
            state.answer = Answer::BLIND;
            return state.answer;
        }
        let ignited = new.ignited.wrapping_add(burned.min(new.total().wrapping_sub(new.charged)));
        self.correct(state, new.waited as f32, ignited as f32);
        let away = self.kept(state) + self.caution * Approximate::sqrt(state.gaps);
        state.answer = Answer::feed(state.drift + self.gain * (state.gap - away));
        state.answer
    }

    fn resume(&self, state: &mut Estimate, after: After) {
        // What is eroded goes on.
        let Estimate { drift, drifts, wider, .. } = *state;
        *state = Estimate::default();
        if let After::Retreat(behind) | After::Jump(behind) = after {
            (state.drift, state.drifts, state.wider) = (drift, larger(drifts, 1.0), wider);
            state.returning = matches!(after, After::Retreat(_));
            let gap = if matches!(after, After::Retreat(_)) { behind.0 } else { self.gap + behind.0 };
            self.begin(state, gap, UNSURE * self.gap);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feed::Pulsed;
    use crate::gap::likelihood::Hazard;
    use proptest::prelude::*;

    fn law() -> ObservedGap {
        ObservedGap::new(Micrometres(36.0), 12_600.0, 20.0, 0.0, [5.0, 20.0], 0.5)
    }

    /// A gap that ignites by chance, seen in milliseconds of 10 pulses of up to 100 us; its true width, um, after each.
    fn run(ms: u32, mut gap: f32, removal: f32) -> (Vec<f32>, Estimate) {
        let (law, mut state, mut pulsed) = (law(), Estimate::default(), Pulsed::default());
        pulsed.senses.hazard = Some(Hazard { rate: 1.0, variance: 1.0 });
        let mut seed = 3u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((seed >> 40) as f32 + 0.5) / (1 << 24) as f32
        };
        let mut gaps = Vec::new();
        for _ in 0..ms {
            for _ in 0..10 {
                let rate = 12_600.0 * (36.0 / gap).powi(3);
                let delay = -random().ln() / rate;
                let ignited = delay < 1e-4;
                pulsed.add([u32::from(!ignited), u32::from(ignited), 0, 0, 0, 0]);
                pulsed.gap.pulses.charged += 1;
                pulsed.gap.pulses.ignited += u32::from(ignited);
                pulsed.gap.pulses.waited += (delay.min(1e-4) * CLOCK_HZ as f32) as u32;
            }
            for _ in 0..4 {
                let velocity = within(pulsed.act(&law, &mut state, 5).velocity.0, -2000.0, 300.0);
                pulsed.moved = velocity * 5.0 * TICK_S;
                gap += removal * 5.0 * TICK_S - pulsed.moved;
            }
            gaps.push(gap);
        }
        (gaps, state)
    }

    #[test]
    fn a_gap_is_found_and_kept_while_it_erodes() {
        for (from, removal) in [(60.0, 0.0), (20.0, 0.0), (36.0, 10.0)] {
            let (gaps, state) = run(3000, from, removal);
            let late = &gaps[1000..];
            let mean = late.iter().sum::<f32>() / late.len() as f32;
            let rms = (late.iter().map(|gap| (gap - 36.0).powi(2)).sum::<f32>() / late.len() as f32).sqrt();
            assert!((mean - 36.0).abs() < 1.0 && rms < 2.5, "from {from}, {removal} um/s: {mean}, {rms} rms");
            assert!((state.drift - removal).abs() < 6.0, "{removal}: {}", state.drift);
        }
    }

    #[test]
    fn its_variance_is_that_of_its_errors() {
        let (law, mut state, mut pulsed) = (ObservedGap { gain: 0.0, ..law() }, Estimate::default(), Pulsed::default());
        pulsed.senses.hazard = Some(Hazard { rate: 1.0, variance: 1.0 });
        let mut random = 1u32;
        let (mut squares, mut variances, mut n) = (0.0f32, 0.0f32, 0.0f32);
        for ms in 0..20_000 {
            // Ignitions of a gap of 36 um by chance: as many as a Poisson count of mean 6.3 has, by thinning 40 looks.
            let ignited = (0..40)
                .filter(|_| {
                    random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (random >> 8) as f32 / ((1 << 24) as f32) < 6.3 / 40.0
                })
                .count() as u32;
            pulsed.add([10, ignited, 0, 0, 0, 0]);
            pulsed.gap.pulses.charged += 10 + ignited;
            pulsed.gap.pulses.ignited += ignited;
            pulsed.gap.pulses.waited += CLOCK_HZ / 2000;
            for _ in 0..4 {
                pulsed.act(&law, &mut state, 5);
            }
            if ms > 1000 {
                squares += (state.gap - 36.0).powi(2);
                variances += state.gaps;
                n += 1.0;
            }
        }
        let ratio = squares / variances;
        assert!((0.1..1.2).contains(&ratio), "errors {} um^2, said to be {}", squares / n, variances / n);
    }

    #[test]
    fn shorts_and_arcs_are_ignitions_without_a_delay() {
        let gap_after = |classes: [u32; 6], charged: u32| {
            let (law, mut state, mut pulsed) = (law(), Estimate::default(), Pulsed::default());
            pulsed.senses.hazard = Some(Hazard { rate: 1.0, variance: 1.0 });
            for _ in 0..20 {
                pulsed.add(classes);
                pulsed.gap.pulses.charged += charged;
                pulsed.gap.pulses.waited += charged * CLOCK_HZ / 10_000;
                for _ in 0..4 {
                    pulsed.act(&law, &mut state, 5);
                }
            }
            state.gap
        };
        assert!(gap_after([10, 0, 0, 0, 0, 0], 10) > 40.0);
        assert!(gap_after([5, 0, 5, 0, 0, 0], 5) < gap_after([5, 0, 0, 0, 0, 0], 5));
        assert!(gap_after([0, 0, 0, 10, 0, 0], 0) < 20.0);
    }

    #[test]
    fn after_a_retreat_the_gap_is_as_wide_as_the_way_back() {
        let (law, mut state) = (law(), Estimate::default());
        law.resume(&mut state, After::Retreat(Micrometres(12.0)));
        assert_eq!(state.gap, 12.0);
        law.resume(&mut state, After::Jump(Micrometres(20.0)));
        assert_eq!(state.gap, 56.0);
    }

    #[test]
    fn where_bridges_cost_more_than_their_share_of_the_time_the_gap_is_kept_wider() {
        // Ways back of so many milliseconds, one every 100 ms.
        let kept = |back: u32| {
            let (law, mut state) = (law(), Estimate::default());
            for _ in 0..1000 {
                law.resume(&mut state, After::Retreat(Micrometres(120.0)));
                for ms in 0..100 {
                    state.gap = if ms < back { 120.0 } else { 30.0 };
                    law.kept(&mut state);
                }
            }
            law.kept(&mut state)
        };
        assert_eq!(kept(30), 36.0);
        assert!((36.0..37.0).contains(&kept(50)), "{}", kept(50));
        assert!(kept(60) > 36.0 * WIDEST * 0.99, "{}", kept(60));
        // Another law, or another start, begins with the gap that is set.
        let (law, mut state) = (law(), Estimate { wider: 1.0, ..Estimate::default() });
        law.resume(&mut state, After::Start);
        assert_eq!(law.kept(&mut state), 36.0);
    }

    #[test]
    fn a_short_that_lasts_is_a_narrow_gap_and_not_a_blind_law() {
        let (law, mut state, mut pulsed) = (law(), Estimate::default(), Pulsed::default());
        for _ in 0..20 {
            // Too brief to tell, and never charged.
            pulsed.add([0, 0, 0, 0, 0, 10]);
            for _ in 0..4 {
                pulsed.act(&law, &mut state, 5);
            }
        }
        assert!(!state.answer.blind && state.answer.velocity.0 < 0.0 && state.gap < 20.0, "{state:?}");
    }

    #[test]
    fn without_a_comparator_it_is_blind_and_stands() {
        let (law, mut state, pulsed) = (law(), Estimate::default(), Pulsed::default());
        let answers: Vec<_> = (0..8).map(|_| pulsed.act(&law, &mut state, 5)).collect();
        assert_eq!(answers[4], Answer::BLIND);
    }

    proptest! {
        #[test]
        fn no_pulses_make_it_fail(looks: Vec<(u16, u16, u32, f32)>) {
            let (law, mut state, mut pulsed) = (law(), Estimate::default(), Pulsed::default());
            pulsed.senses.hazard = Some(Hazard { rate: 1.0, variance: 1.0 });
            for (ignited, short, waited, moved) in looks {
                pulsed.add([0, ignited.into(), 0, short.into(), 0, 0]);
                pulsed.gap.pulses.charged += u32::from(ignited);
                pulsed.gap.pulses.ignited += u32::from(ignited);
                pulsed.gap.pulses.waited = pulsed.gap.pulses.waited.wrapping_add(waited);
                pulsed.moved = within(moved, -100.0, 100.0);
                let velocity = pulsed.act(&law, &mut state, 20).velocity.0;
                prop_assert!(velocity.is_finite() && velocity.abs() < 1e4);
                prop_assert!(state.gaps >= 0.0 && state.drifts >= 0.0);
            }
        }
    }
}

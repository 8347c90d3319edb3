//! Minimum variance: keeps the gap distance that the charging time shows, by a model of the gap that it identifies while it works
//! (\[X\] sections 3 and 4).
//!
//! Model of order 2: y(k) = -a1 y(k-1) - a2 y(k-2) + b0 du(k-1) + b1 du(k-2), y the gap, du the *move* of the electrode toward the work
//! in a period: regressed on the absolute position, as printed, it diverges. Recursive least squares with forgetting,
//! K = P h / (l + h'P h), theta += K (y - h'theta), P = (P - K h'P) / l, keep a1, a2, b0, b1; the move that makes the expected gap
//! the set point is du(k) = (r + a1 y(k) + a2 y(k-1) - b1 du(k-1)) / b0.
//!
//! What keeps it from blowing up: the covariance is bounded; b0 stays in a range below 0, for a move toward the work closes the gap,
//! and |b1| <= 0.9 |b0|, so that the moves do not swing; without excitation nothing is learned; set point and gap are held
//! in 10..80 um, a move forward in 40 um, as published.

use super::period::Period;
use super::{After, Answer, FeedLaw, View};
use crate::units::{Micrometres, TICK_S, within};

/// Range of gaps, um: that of the charging curve.
const RANGE: (f32, f32) = (10.0, 80.0);
/// Longest move toward the work, um.
const FORWARD: f32 = 40.0;
/// Longest move away from it, um: the range.
const BACKWARD: f32 = 80.0;
/// Range of b0: a move closes the gap by itself, 1; erosion and a model that errs make other values of it.
const B0: (f32, f32) = (-3.0, -0.3);
/// |b1| over |b0|, at most.
const ZERO: f32 = 0.9;
/// Largest |a1| and |a2|: poles within a circle of 1.4.
const POLES: [f32; 2] = [2.0, 1.0];
/// Sum of the moves of two periods, um, from which something is learned.
const EXCITES: f32 = 0.5;
/// Covariance at the beginning, of a1, a2, b0, b1; and the sum of variances that it is kept below.
const DOUBT: [f32; 4] = [1e-3, 1e-3, 0.1, 0.1];
const MOST: f32 = 10.0;

/// Numbers of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MinimumVariance {
    /// Gap to keep, um.
    setpoint: f32,
    /// Forgetting factor, 0.9..=1.
    forgetting: f32,
    /// Period, servo ticks, and s.
    period: u32,
    seconds: f32,
}

impl MinimumVariance {
    /// Law that keeps a gap, held in 10..=80 um, with a forgetting factor of 0.9..=1 and a period in servo ticks, at least one.
    pub fn new(setpoint: Micrometres, forgetting: f32, period: u32) -> MinimumVariance {
        let period = period.max(1);
        MinimumVariance {
            setpoint: within(setpoint.0, RANGE.0, RANGE.1),
            forgetting: within(forgetting, 0.9, 1.0),
            period,
            seconds: period as f32 * TICK_S,
        }
    }
}

type Vector = [f32; 4];

/// The model, and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Model {
    /// a1, a2, b0, b1.
    theta: Vector,
    covariance: [Vector; 4],
}

impl Default for Model {
    /// A move closes the gap, and nothing else changes it.
    fn default() -> Model {
        let mut covariance = [[0.0; 4]; 4];
        for (row, (line, doubt)) in covariance.iter_mut().zip(DOUBT).enumerate() {
            if let Some(variance) = line.get_mut(row) {
                *variance = doubt;
            }
        }
        Model { theta: [-1.0, 0.0, -1.0, 0.0], covariance }
    }
}

fn dot(a: &Vector, b: &Vector) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

impl Model {
    /// Learns of a gap `y` that followed on `h`.
    fn learn(&mut self, h: &Vector, y: f32, forgetting: f32) {
        let ph = self.covariance.each_ref().map(|row| dot(row, h));
        let gain = 1.0 / (forgetting + dot(h, &ph));
        let error = y - dot(h, &self.theta);
        let k = ph.map(|p| p * gain);
        let theta: Vector = core::array::from_fn(|n| self.theta[n] + k[n] * error);
        let mut trace = 0.0;
        let mut covariance = self.covariance;
        for (n, row) in covariance.iter_mut().enumerate() {
            for (m, p) in row.iter_mut().enumerate() {
                // From either side, so that it stays symmetric.
                let product = if n <= m { k[n & 3] * ph[m & 3] } else { k[m & 3] * ph[n & 3] };
                *p = (*p - product) / forgetting;
                trace += if n == m { *p } else { 0.0 };
            }
        }
        if trace > MOST {
            let scale = MOST / trace;
            covariance.iter_mut().flatten().for_each(|p| *p *= scale);
        }
        let sound =
            covariance.iter().enumerate().all(|(n, row)| row[n & 3] > 0.0) && theta.iter().all(|x| x.is_finite());
        if !sound {
            *self = Model::default();
            return;
        }
        let b0 = within(theta[2], B0.0, B0.1);
        let b1 = within(theta[3], ZERO * b0, -ZERO * b0);
        let [a1, a2] = POLES;
        self.theta = [within(theta[0], -a1, a1), within(theta[1], -a2, a2), b0, b1];
        self.covariance = covariance;
    }

    /// The move that makes the next gap the set point.
    fn moves(&self, setpoint: f32, y: f32, before: f32, moved: f32) -> f32 {
        let [a1, a2, b0, b1] = self.theta;
        (setpoint + a1 * y + a2 * before - b1 * moved) / b0
    }
}

/// What the law remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tuning {
    model: Model,
    period: Period,
    /// Way in the period so far, um.
    way: f32,
    /// Gaps of the two periods before, the newest first, and the moves in them.
    gaps: [Option<f32>; 2],
    moves: [f32; 2],
    /// Until the end of the period.
    answer: Answer,
}

impl FeedLaw for MinimumVariance {
    type State = Tuning;
    const NEEDS_PULSES: bool = true;

    fn act(&self, state: &mut Tuning, view: &View<'_>) -> Answer {
        state.way += view.motion.moved.0;
        if !state.period.begins(self.period, view.ticks) {
            return state.answer;
        }
        let moved = core::mem::take(&mut state.way);
        let Some(charged) = view.senses.distance else {
            (state.gaps, state.answer) = ([None; 2], Answer::BLIND);
            return state.answer;
        };
        let y = within(charged.gap.0, RANGE.0, RANGE.1);
        let [before, earlier] = state.gaps;
        let [moved_before, _] = state.moves;
        if let ([Some(before), Some(earlier)], true) = ([before, earlier], charged.inside)
            && moved.abs() + moved_before.abs() > EXCITES
        {
            state.model.learn(&[-before, -earlier, moved, moved_before], y, self.forgetting);
        }
        let wanted = state.model.moves(self.setpoint, y, before.unwrap_or(y), moved);
        (state.gaps, state.moves) = ([Some(y), before], [moved, moved_before]);
        state.answer = Answer::feed(within(wanted, -BACKWARD, FORWARD) / self.seconds);
        state.answer
    }

    /// The model is that of the gap, whatever came between; what it was made of is another gap's.
    fn resume(&self, state: &mut Tuning, after: After) {
        let model = if after == After::Start { Model::default() } else { state.model };
        *state = Tuning { model, ..Tuning::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feed::Pulsed;
    use crate::gap::charging::Charged;
    use proptest::prelude::*;

    /// True gaps, um, at the ends of so many periods of 0.1 s, with a set point for each and noise of 1 um (sum of uniform ones).
    fn follow(setpoints: impl Iterator<Item = f32>, removal: f32) -> Vec<(f32, f32)> {
        let (mut state, mut pulsed) = (Tuning::default(), Pulsed::default());
        let (mut gap, mut seed) = (60.0f32, 1u32);
        let mut noise = || {
            let mut uniform = || {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (seed >> 8) as f32 / (1 << 24) as f32 - 0.5
            };
            (0..12).map(|_| uniform()).sum::<f32>()
        };
        let mut gaps = Vec::new();
        for setpoint in setpoints {
            let law = MinimumVariance::new(Micrometres(setpoint), 0.98, 2000);
            let charged = Charged { gap: Micrometres(gap + noise()), inside: true };
            pulsed.senses.distance = Some(charged);
            for _ in 0..400 {
                let velocity = pulsed.act(&law, &mut state, 5).velocity.0;
                pulsed.moved = velocity * 5.0 * TICK_S;
                gap += removal * 5.0 * TICK_S - pulsed.moved;
            }
            gaps.push((setpoint, gap));
        }
        gaps
    }

    fn rms(gaps: &[(f32, f32)]) -> f32 {
        (gaps.iter().map(|(setpoint, gap)| (setpoint - gap).powi(2)).sum::<f32>() / gaps.len() as f32).sqrt()
    }

    #[test]
    fn constant_square_and_sine_set_points_are_followed_after_two_seconds() {
        for removal in [0.0, 3.0] {
            let constant = follow((0..300).map(|_| 50.0), removal);
            let square = follow((0..300).map(|n| if n / 50 % 2 == 0 { 40.0 } else { 60.0 }), removal);
            let sine = follow((0..300).map(|n| 50.0 + 10.0 * (n as f32 * 0.1).sin()), removal);
            for (name, gaps) in [("constant", constant), ("square", square), ("sine", sine)] {
                assert!(rms(&gaps[20..]) < 2.3, "{name}, removal {removal}: {} um", rms(&gaps[20..]));
            }
        }
    }

    #[test]
    fn without_excitation_nothing_is_learned() {
        let (mut state, mut pulsed) = (Tuning::default(), Pulsed::default());
        let law = MinimumVariance::new(Micrometres(50.0), 0.98, 5);
        pulsed.senses.distance = Some(Charged { gap: Micrometres(50.0), inside: true });
        for _ in 0..1000 {
            pulsed.act(&law, &mut state, 5);
        }
        assert_eq!(state.model, Model::default());
    }

    #[test]
    fn a_gap_that_is_not_known_is_blind_and_stands() {
        let (mut state, pulsed) = (Tuning::default(), Pulsed::default());
        let law = MinimumVariance::new(Micrometres(50.0), 0.98, 5);
        assert_eq!(pulsed.act(&law, &mut state, 5), Answer::BLIND);
    }

    fn survives(model: &Model) {
        let [a1, a2, b0, b1] = model.theta;
        assert!(a1.abs() <= 2.0 && a2.abs() <= 1.0 && (-3.0..=-0.3).contains(&b0), "{model:?}");
        assert!(b1.abs() <= 0.9 * b0.abs() + 1e-6, "{model:?}");
        let trace: f32 = (0..4).map(|n| model.covariance[n][n]).sum();
        assert!((0..4).all(|n| model.covariance[n][n] > 0.0) && trace <= 10.001, "{model:?}");
    }

    #[test]
    fn ten_million_steps_of_any_input_in_range_leave_the_model_sound_and_the_moves_short() {
        let mut seed = 7u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 40) as f32 / (1 << 24) as f32
        };
        let (mut state, mut pulsed) = (Tuning::default(), Pulsed::default());
        let mut law = MinimumVariance::new(Micrometres(50.0), 0.98, 1);
        let (mut kind, mut gap, mut wanted) = (0, 50.0f32, 0.0f32);
        for step in 0..10_000_000 {
            if step % 1000 == 0 {
                kind = (random() * 7.0) as u32;
                law = MinimumVariance::new(Micrometres(10.0 + 70.0 * random()), 0.9 + 0.1 * random(), 1);
            }
            let y = |x: f32| 10.0 + 70.0 * x;
            let noise = random() - 0.5;
            (gap, pulsed.moved) = match kind {
                // Anything; one end or the other; the same again and again; almost no move, with noise.
                0 => (y(random()), 120.0 * random() - 80.0),
                1 => (y(random().round()), if random() < 0.5 { 40.0 } else { -80.0 }),
                2 => (50.0, 0.6),
                3 => (10.0 + 3.0 * noise, 0.5 * random()),
                // A gap that follows the moves, one that a move widens, and one that hardly answers.
                4 => (gap - wanted + noise, wanted),
                5 => (gap + 3.0 * wanted + noise, wanted),
                _ => (gap - 0.02 * wanted + noise, wanted),
            };
            gap = within(gap, RANGE.0, RANGE.1);
            let known = random() < 0.99;
            pulsed.senses.distance = known.then_some(Charged { gap: Micrometres(gap), inside: random() < 0.99 });
            wanted = pulsed.act(&law, &mut state, 1).velocity.0 * TICK_S;
            assert!((-80.01..=40.01).contains(&wanted), "step {step}: a move of {wanted} um");
            survives(&state.model);
        }
        // And it has learned on the way.
        assert_ne!(state.model, Model::default());
    }

    proptest! {
        #[test]
        fn no_senses_make_it_fail(gaps: Vec<f32>, moved: f32) {
            let (mut state, mut pulsed) = (Tuning::default(), Pulsed::default());
            let law = MinimumVariance::new(Micrometres(50.0), 0.98, 5);
            pulsed.moved = within(moved, -100.0, 100.0);
            for gap in gaps {
                pulsed.senses.distance = Some(Charged { gap: Micrometres(gap), inside: true });
                let velocity = pulsed.act(&law, &mut state, 5).velocity.0;
                prop_assert!(velocity.is_finite());
                survives(&state.model);
            }
        }
    }
}

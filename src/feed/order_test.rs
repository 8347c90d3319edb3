//! Order test: finds the order of the model that the gap needs, as a commissioning step before `minimum_variance` (\[X\] section 3).
//!
//! While this law leads, the electrode steps by an inverse M-sequence of 0 and 10 um, one step a period of 100 ms, about a place that
//! follows the erosion slowly. An inverse M-sequence is an M-sequence of which every other bit is turned over: its mean is zero, and
//! it excites all frequencies. Over L = 100 periods the products of the last gaps y and steps u are summed,
//!
//! ```text
//! H(n) = sum h h',  h = [y(k-1), u(k-1), .. y(k-n), u(k-n)],   DR(n) = det H(n) / det H(n+1)
//! ```
//!
//! A model of order n explains y(k-1) by n older pairs; with one pair more than that, H is singular but for noise. So the determinant
//! ratio DR rises last at the order (Woodside, Automatica 7, 1971, 727). H is decomposed into L D L': det H(n) is the product of the first
//! 2 n of D, so one decomposition gives all ratios.
//!
//! The result stays until the law is begun again. Then the head stands at its place, which goes on to follow the erosion.

use super::period::Period;
use super::{Answer, FeedLaw, View};
use crate::units::{Micrometres, TICK_S, TICKS_PER_MS, larger, within};

/// Largest order that is told from a larger one.
pub const MOST: usize = 3;
/// Pairs of the largest matrix, and its size.
const PAIRS: usize = MOST + 1;
const SIZE: usize = 2 * PAIRS;
/// Periods before the first sum: the gap has to be there, and the history has to be full.
const SETTLES: u16 = 16;
/// Periods that are summed.
pub const PERIODS: u16 = 100;
/// Period, servo ticks.
const PERIOD: u32 = 100 * TICKS_PER_MS;
/// Step, um.
const STEP: f32 = 10.0;
/// Rise that is one: noise alone makes up to two (simulated; chosen).
const RISES: f32 = 3.0;
/// Share of a gap that is off which the place follows in a period.
const FOLLOWS: f32 = 0.05;
/// Share by which a mean follows in a period.
const MEAN: f32 = 0.06;

/// Numbers of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OrderTest {
    /// Gap about which it steps, um.
    pub setpoint: Micrometres,
}

/// What was found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Order {
    /// Order, 1 to 3; 0 before the test is over.
    pub order: u8,
    /// DR(n) over DR(n - 1) for the orders, the first over DR(0) = 1 / det H(1).
    pub rises: [f32; MOST],
    /// Periods that were summed so far.
    pub periods: u16,
}

/// What the test remembers.
#[derive(Clone, Copy, Debug)]
pub struct Testing {
    period: Period,
    done: u16,
    /// M-sequence of 127 bits, and whether the next bit is turned over.
    bits: u8,
    turned: bool,
    /// Step of now, 0 or 1, and way in the period, um.
    up: bool,
    mean: Option<f32>,
    /// y and u, the newest pair first.
    history: [f32; SIZE],
    /// Upper half of H, row by row.
    sums: [f32; SIZE * (SIZE + 1) / 2],
    answer: Answer,
    found: Order,
}

impl Default for Testing {
    fn default() -> Testing {
        Testing {
            period: Period::default(),
            done: 0,
            bits: 0x7F,
            turned: false,
            up: false,
            mean: None,
            history: [0.0; SIZE],
            sums: [0.0; SIZE * (SIZE + 1) / 2],
            answer: Answer::default(),
            found: Order::default(),
        }
    }
}

impl Testing {
    /// What was found so far.
    pub fn found(&self) -> &Order {
        &self.found
    }

    /// Next bit of the inverse M-sequence: x^7 + x^6 + 1.
    fn bit(&mut self) -> bool {
        let bit = (self.bits >> 6 ^ self.bits >> 5) & 1;
        self.bits = (self.bits << 1 | bit) & 0x7F;
        self.turned = !self.turned;
        (bit == 1) != self.turned
    }

    fn sum(&mut self) {
        let history = self.history;
        let mut sums = self.sums.iter_mut();
        for (n, x) in history.iter().enumerate() {
            for (y, sum) in history.iter().skip(n).zip(&mut sums) {
                *sum += x * y;
            }
        }
    }

    /// H of the largest order.
    fn matrix(&self) -> [[f32; SIZE]; SIZE] {
        let mut matrix = [[0.0; SIZE]; SIZE];
        let mut sums = self.sums.iter();
        for (n, row) in matrix.iter_mut().enumerate() {
            // What is below the diagonal nobody reads.
            row.iter_mut().skip(n).zip(&mut sums).for_each(|(place, sum)| *place = *sum);
        }
        matrix
    }

    /// Order by the sums.
    fn judge(&mut self) {
        let pivots = pivots(self.matrix());
        let pair = |n: usize| pivots.get(2 * n).copied().unwrap_or(0.0) * pivots.get(2 * n + 1).copied().unwrap_or(0.0);
        // DR(n) = 1 / (pair n); it rises by the pair before over the pair.
        self.found.rises = core::array::from_fn(|n| pair(n) / larger(pair(n + 1), f32::MIN_POSITIVE));
        let last = self.found.rises.iter().rposition(|rise| *rise >= RISES);
        self.found.order = last.map_or(1, |n| n as u8 + 1);
    }
}

/// D of L D L', of the upper half of a symmetric matrix.
fn pivots(mut m: [[f32; SIZE]; SIZE]) -> [f32; SIZE] {
    let mut pivots = [0.0; SIZE];
    for (n, place) in pivots.iter_mut().enumerate() {
        let Some(row) = m.get(n).copied() else { break };
        let pivot = larger(row.get(n).copied().unwrap_or(0.0), f32::MIN_POSITIVE);
        *place = pivot;
        for (below, line) in m.iter_mut().enumerate().skip(n + 1) {
            let factor = row.get(below).copied().unwrap_or(0.0) / pivot;
            for (x, above) in line.iter_mut().zip(row) {
                *x -= factor * above;
            }
        }
    }
    pivots
}

impl FeedLaw for OrderTest {
    type State = Testing;
    const NEEDS_PULSES: bool = true;

    fn act(&self, state: &mut Testing, view: &View<'_>) -> Answer {
        if !state.period.begins(PERIOD, view.ticks) {
            return state.answer;
        }
        let Some(charged) = view.senses.distance else {
            state.answer = Answer::BLIND;
            return state.answer;
        };
        let gap = charged.gap.0;
        let mean = state.mean.map_or(gap, |mean| mean + MEAN * (gap - mean));
        state.mean = Some(mean);
        let runs = state.found.periods < PERIODS;
        let step = if state.up { 0.5 * STEP } else { -0.5 * STEP };
        let mut history = [gap - mean, step, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        history.iter_mut().skip(2).zip(state.history).for_each(|(place, before)| *place = before);
        state.history = history;
        if state.done < SETTLES {
            state.done += 1;
        } else if runs {
            state.sum();
            state.found.periods += 1;
            if state.found.periods == PERIODS {
                state.judge();
            }
        }
        // An upper step is a narrow gap. The place follows the mean.
        let up = runs && state.bit();
        let stepped = (f32::from(u8::from(up)) - f32::from(u8::from(state.up))) * STEP;
        state.up = up;
        let follows = within(FOLLOWS * (mean - self.setpoint.0), -1.0, 1.0);
        state.answer = Answer::feed((stepped + follows) / (PERIOD as f32 * TICK_S));
        state.answer
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feed::Pulsed;
    use crate::gap::charging::Charged;

    /// Tests a gap whose distance from its mean is y(k) = a1 y(k-1) + a2 y(k-2) + b u(k-1) + b2 u(k-2), with noise of such a size.
    fn test([a1, a2]: [f32; 2], [b1, b2]: [f32; 2], noise: f32, seed: u32) -> Order {
        let (law, mut state, mut pulsed) =
            (OrderTest { setpoint: Micrometres(40.0) }, Testing::default(), Pulsed::default());
        let mut random = seed;
        let (mut y, mut u) = ([0.0f32; 2], [0.0f32; 2]);
        let mut place = 0.0f32;
        for _ in 0..130 {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let error = noise * ((random >> 8) as f32 / (1 << 24) as f32 - 0.5) * 3.46;
            let gap = Micrometres(40.0 + y[0] + error);
            pulsed.senses.distance = Some(Charged { gap, inside: true });
            for _ in 0..400 {
                place += pulsed.act(&law, &mut state, 5).velocity.0 * 5.0 * TICK_S;
            }
            u = [place, u[0]];
            y = [a1 * y[0] + a2 * y[1] + b1 * u[0] + b2 * u[1], y[0]];
        }
        *state.found()
    }

    #[test]
    fn the_order_of_a_gap_is_found() {
        for seed in 1..=10 {
            assert_eq!(
                test([0.5, 0.0], [-0.5, 0.0], 0.2, seed).order,
                1,
                "{:?}",
                test([0.5, 0.0], [-0.5, 0.0], 0.2, seed)
            );
            let second = test([1.2, -0.5], [-0.5, -0.3], 0.2, seed);
            assert_eq!(second.order, 2, "{second:?}");
        }
    }

    #[test]
    fn the_sequence_is_of_zero_mean_and_as_long_as_it_has_to_be() {
        let mut testing = Testing::default();
        let bits: Vec<bool> = (0..254).map(|_| testing.bit()).collect();
        assert_eq!(bits.iter().filter(|bit| **bit).count(), 127);
        assert!((1..254).all(|shift| (0..254).any(|n| bits[n] != bits[(n + shift) % 254])));
    }

    #[test]
    fn a_gap_that_is_not_known_is_blind() {
        let (law, mut state) = (OrderTest { setpoint: Micrometres(40.0) }, Testing::default());
        assert_eq!(Pulsed::default().act(&law, &mut state, 5), Answer::BLIND);
    }
}

//! Edges of gate and comparators, for the head's block and for the wires of the modelled chip.

use super::model::Stretch;
use edm_hal_shim::gap::{Edges, GapBlock};

/// Shares of the open-circuit voltage at which the comparators switch.
pub const THRESHOLDS: [f64; 2] = [0.7, 0.2];
/// Core cycles of a microsecond.
pub(super) const CYCLES_PER_US: f64 = 168.0;
/// A conversion of the process model sees the gap 2 k + 1 us after the block began; that of a chip has the middle of its aperture
/// 276 + 336 k cycles after.
const OFFSET: f64 = 276.0 - CYCLES_PER_US;

/// When a voltage that tends from `initial` to `volts` crosses a threshold, in time constants, and whether it is above from then
/// on; when it never does, how it is from the beginning.
pub fn crossing(initial: f64, volts: f64, threshold: f64) -> (f64, bool) {
    let (from, to) = (initial.abs() > threshold, volts.abs() > threshold);
    if from == to {
        return (0.0, to);
    }
    (((volts.abs() - initial.abs()) / (volts.abs() - threshold)).ln(), to)
}

/// The lines of gate and comparators.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lines {
    gate: bool,
    high: bool,
    low: bool,
}

impl Lines {
    /// Puts the edges of the tick that begins at `from` (us) into its block, under the stretches that touch it, the oldest first; the
    /// comparators switch at `thresholds` (V), the high one and the low one.
    pub fn see(
        &mut self,
        block: &mut GapBlock,
        from: f64,
        stretches: &[Stretch],
        thresholds: [f64; 2],
        gate_lost: bool,
    ) {
        (block.gate_was_open, block.was_high) = (self.gate, self.high);
        let end = from + f64::from(GapBlock::CYCLES) / CYCLES_PER_US;
        for (k, now) in stretches.iter().enumerate() {
            let push = |edges: &mut Edges, at: f64| edges.push(((at - from) * CYCLES_PER_US + OFFSET).max(0.0) as u16);
            // Cheaper than `max` and `min`, which have an answer for what is no number.
            let begins = if now.from > from { now.from } else { from };
            let gate = now.gate.0 < now.gate.1 && !gate_lost;
            if gate != self.gate {
                self.gate = gate;
                push(&mut block.gate_edges, begins);
            }
            let tends = now.volts.abs();
            let [high, low] = thresholds;
            if (tends > high) == self.high && (tends > low) == self.low {
                continue;
            }
            let ends = stretches.get(k + 1).map_or(end, |next| next.from);
            let crosses = |threshold: f64, was: bool| {
                let (constants, level) = crossing(now.initial, now.volts, threshold);
                let crosses = now.from + constants * now.rise;
                let at = if crosses > begins { crosses } else { begins };
                (level != was && at < ends && at < end).then_some(at)
            };
            if let Some(at) = crosses(high, self.high) {
                self.high = !self.high;
                push(&mut block.high_edges, at);
            }
            if crosses(low, self.low).is_some() {
                self.low = !self.low;
                block.low_rises = block.low_rises.wrapping_add(self.low.into());
            }
        }
        block.above_low = self.low;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_come_at_their_times_and_levels_go_on_from_block_to_block() {
        let mut lines = Lines::default();
        let off =
            |from, initial| Stretch { from, volts: 0.0, initial, rise: 1.0, gate: (from, from), ..Stretch::default() };
        let on = |from, volts, initial| Stretch {
            from,
            volts,
            initial,
            rise: 1.0,
            gate: (10.0, 70.0),
            ..Stretch::default()
        };
        let mut block = GapBlock::EMPTY;
        lines.see(&mut block, 0.0, &[off(-9.0, 0.0), on(10.0, 100.0, 0.0)], [70.0, 20.0], false);
        let cycles = |us: f64| (us * 168.0 + 108.0) as u16;
        assert_eq!((block.gate_was_open, block.was_high), (false, false));
        assert_eq!(block.gate_edges.times(), [cycles(10.0)]);
        // 100 V in one microsecond: 70 V after 1.2.
        assert_eq!(block.high_edges.times(), [cycles(10.0 - 0.3f64.ln())]);
        let mut next = GapBlock::EMPTY;
        let stretches = [on(10.0, 100.0, 0.0), on(60.0, 40.0, 100.0), off(70.0, 40.0)];
        lines.see(&mut next, 50.0, &stretches, [70.0, 20.0], false);
        assert_eq!((next.gate_was_open, next.was_high), (true, true));
        assert_eq!(next.gate_edges.times(), [cycles(20.0)]);
        assert_eq!(next.high_edges.times(), [cycles(10.0 + 2f64.ln())]);
    }

    #[test]
    fn what_rises_slowly_crosses_in_the_block_in_which_it_does() {
        let mut lines = Lines::default();
        let slow =
            Stretch { from: 0.0, volts: 100.0, initial: 0.0, rise: 50.0, gate: (0.0, 500.0), ..Stretch::default() };
        let mut edges = vec![];
        for tick in 0..4 {
            let mut block = GapBlock::EMPTY;
            lines.see(&mut block, f64::from(tick) * 50.0, &[slow], [70.0, 20.0], false);
            edges.extend(
                block.high_edges.times().iter().map(|at| f64::from(tick) * 50.0 + (f64::from(*at) - 108.0) / 168.0),
            );
        }
        assert_eq!(edges.len(), 1);
        assert!((edges[0] + 50.0 * 0.3f64.ln()).abs() < 0.01, "{edges:?}");
    }
}

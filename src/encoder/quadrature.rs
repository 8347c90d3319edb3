//! X4 decoder, run by the edge interrupt or fed with edges and their times.
//!
//! Terms: the *phase* is the pair of levels of A and B; it goes through 00, A, AB, B and back to 00 while the axis moves
//! toward the work. A *transition* between neighbours in that ring is one count. A transition to the opposite phase is
//! *illegal*: two edges came before the first was served, or noise hit both lines. It moved by two counts one way or the
//! other and nobody knows which, so it is counted as illegal, leaves the count alone, and the decoder goes on from the
//! levels that are there (\[L\] section 3: state taken from the inputs at start, error state left for the present levels.
//! The table is derived from the ring above; the one printed there is wrong in a row).
//!
//! Served in time: each edge must be served before the next one. One spacing later it reads as illegal; two spacings later
//! it is a step the wrong way, which only the second counter or the index marks can see. The rate at which the interrupt
//! keeps this promise is the rated speed of the counter, in edges/s.
//!
//! Cost: [`Quadrature::edge`] has no loop, no lock, no division and takes its table from a register.

use super::index::{Mark, MarkLatch};
use edm_hal_shim::encoder::{Levels, RawCount};

/// Table entry of an illegal transition.
const ILLEGAL: i32 = -2;

/// Step for each pair of phases: rows from 00, A, B, AB; columns to 00, A, B, AB.
#[rustfmt::skip]
const STEPS: [i32; 16] = [
          0,       1,      -1, ILLEGAL,
         -1,       0, ILLEGAL,       1,
          1, ILLEGAL,       0,      -1,
    ILLEGAL,      -1,       1,       0,
];

/// [`STEPS`], two bits an entry: the values are all that two signed bits can hold.
const PACKED_STEPS: u32 = {
    let mut word = 0;
    let mut entry = 0;
    while entry < STEPS.len() {
        word |= (STEPS[entry] as u32 & 0b11) << (2 * entry);
        entry += 1;
    }
    word
};

fn phase(levels: Levels) -> u32 {
    u32::from(levels.a) | u32::from(levels.b) << 1
}

fn step(from: u32, to: u32) -> i32 {
    let entry = (from << 2 | to) & 0xF;
    // Up to the top and back down: the shift right carries the sign.
    ((PACKED_STEPS >> (2 * entry)) << 30) as i32 >> 30
}

/// Everything the decoder knows at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Snapshot {
    /// Count and times.
    pub raw: RawCount,
    /// Illegal transitions since the start, wrapping.
    pub illegal: u32,
    /// Newest index mark.
    pub mark: Mark,
}

/// Counts edges of A and B, and latches index marks.
#[derive(Clone, Debug)]
pub struct Quadrature {
    phase: u32,
    count: u32,
    last_edge: u32,
    toward_work: bool,
    illegal: u32,
    latch: MarkLatch,
}

impl Quadrature {
    /// Starts at count 0 from the levels that are there; `now` stands in for the time of the newest edge until one comes.
    pub fn new(levels: Levels, now: u32) -> Self {
        Quadrature {
            phase: phase(levels),
            count: 0,
            last_edge: now,
            toward_work: false,
            illegal: 0,
            latch: MarkLatch::new(levels.index),
        }
    }

    /// Takes the levels after an edge of A, B or the index line, at clock time `now`. Levels that have not changed are
    /// neither counted nor illegal: an interrupt that comes late finds its edge already served.
    #[inline]
    pub fn edge(&mut self, levels: Levels, now: u32) {
        let to = phase(levels);
        let step = step(self.phase, to);
        self.phase = to;
        match step {
            0 => self.latch.stay(levels.index),
            ILLEGAL => {
                self.illegal = self.illegal.wrapping_add(1);
                self.latch.lose(levels.index);
            }
            _ => {
                let toward_work = step > 0;
                self.latch.leave(self.count, toward_work, levels.index);
                self.count = self.count.wrapping_add_signed(step);
                self.last_edge = now;
                self.toward_work = toward_work;
            }
        }
    }

    /// Goes on from the levels that are there, after edges that were deliberately not served: neither counted nor illegal.
    pub fn resume(&mut self, levels: Levels) {
        self.phase = phase(levels);
        self.latch.lose(levels.index);
    }

    /// Everything known at clock time `now`, which is not before the newest edge.
    #[inline]
    pub fn snapshot(&self, now: u32) -> Snapshot {
        Snapshot {
            raw: RawCount { count: self.count, last_edge: self.last_edge, toward_work: self.toward_work, now },
            illegal: self.illegal,
            mark: self.latch.mark(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RING: [(bool, bool); 4] = [(false, false), (true, false), (true, true), (false, true)];

    fn at(position: i32) -> Levels {
        let (a, b) = RING[position.rem_euclid(4) as usize];
        Levels { a, b, index: false }
    }

    /// Count, time of the newest edge and illegal transitions.
    fn state(decoder: &Quadrature) -> (u32, u32, u32) {
        let Snapshot { raw, illegal, .. } = decoder.snapshot(0);
        (raw.count, raw.last_edge, illegal)
    }

    #[test]
    fn a_leads_b_toward_the_work_and_counts_up() {
        for start in 0..4 {
            let mut decoder = Quadrature::new(at(start), 0);
            decoder.edge(at(start + 1), 7);
            assert_eq!(decoder.snapshot(9).raw, RawCount { count: 1, last_edge: 7, toward_work: true, now: 9 });
            decoder.edge(at(start), 8);
            assert_eq!(decoder.snapshot(9).raw, RawCount { count: 0, last_edge: 8, toward_work: false, now: 9 });
            assert_eq!(decoder.snapshot(9).illegal, 0);
        }
    }

    #[test]
    fn the_state_at_start_comes_from_the_inputs() {
        for start in 0..4 {
            let mut decoder = Quadrature::new(at(start), 5);
            decoder.edge(at(start), 6);
            assert_eq!(state(&decoder), (0, 5, 0));
        }
    }

    #[test]
    fn a_double_transition_is_counted_as_illegal_and_decoding_goes_on_from_the_present_levels() {
        for start in 0..4 {
            let mut decoder = Quadrature::new(at(start), 0);
            decoder.edge(at(start + 2), 1);
            assert_eq!(state(&decoder), (0, 0, 1));
            decoder.edge(at(start + 3), 2);
            assert_eq!(state(&decoder), (1, 2, 1));
        }
    }

    #[test]
    fn edges_not_served_on_purpose_are_neither_counted_nor_illegal() {
        for missed in 0..4 {
            let mut decoder = Quadrature::new(at(0), 0);
            decoder.resume(at(missed));
            decoder.edge(at(missed + 1), 3);
            assert_eq!(state(&decoder), (1, 3, 0));
        }
    }

    #[test]
    fn an_edge_already_served_is_not_counted_twice() {
        let mut decoder = Quadrature::new(at(0), 0);
        decoder.edge(at(1), 1);
        decoder.edge(at(1), 2);
        assert_eq!(state(&decoder), (1, 1, 0));
    }

    #[test]
    fn the_count_wraps_below_zero_by_one_and_comes_back() {
        let mut decoder = Quadrature::new(at(0), 0);
        decoder.edge(at(-1), 1);
        assert_eq!(state(&decoder), (u32::MAX, 1, 0));
        decoder.edge(at(0), 2);
        assert_eq!(state(&decoder), (0, 2, 0));
    }
}

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
//! keeps this promise is the rated speed of the counter: 300 kcount/s, 3.3 us an edge, 560 cycles at 168 MHz.
//!
//! Cost, estimated, with reading the port and the clock, clearing the request, entry and exit: 80 cycles an edge, 160 near an
//! index mark (`host/fil/tests/chip/edges.rs`). No loop, no lock, no division, no look into a table, and one word of state beside
//! the count. The state that slower tasks read is kept in [`Shared`] and nowhere else, so there is nothing to copy.

use super::index::MarkLatch;
use super::shared::{Shared, Snapshot};
use core::borrow::Borrow;
use core::sync::atomic::Ordering::Relaxed;
use edm_hal_shim::encoder::Levels;

/// What a transition is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transition {
    None,
    Forth,
    Back,
    Illegal,
}

/// Each pair of phases: rows from 00, A, B, AB; columns to 00, A, B, AB.
#[rustfmt::skip]
const TRANSITIONS: [Transition; 16] = {
    use Transition::{Back, Forth, Illegal, None};
    [
           None,   Forth,    Back, Illegal,
           Back,    None, Illegal,   Forth,
          Forth, Illegal,    None,    Back,
        Illegal,    Back,   Forth,    None,
    ]
};

/// Bits of a phase. Behind them comes the bit of the index line in the levels, which is 0 in the state.
const PHASE_BITS: u32 = 2;
/// Above that bit the state keeps what the latch knows of the index line, mostly nothing.
const LATCH_BIT: u32 = PHASE_BITS + 1;

/// Phase and index line.
fn lines(levels: Levels) -> u32 {
    u32::from(levels.a) | u32::from(levels.b) << 1 | u32::from(levels.index) << PHASE_BITS
}

/// The phase in levels or state.
const fn phase(bits: u32) -> u32 {
    bits & ((1 << PHASE_BITS) - 1)
}

/// The transition from the phase in a state to another.
const fn transition(from: u32, to: u32) -> Transition {
    TRANSITIONS[(phase(from) << PHASE_BITS | phase(to)) as usize]
}

/// Whether one bit of two has changed, and none of those above.
const fn is_step(changed: u32) -> bool {
    changed.wrapping_sub(1) <= 1
}

/// Counts of a step: 1 forth, where B is now what A was, -1 back.
const fn count(from: u32, to: u32) -> i32 {
    1 - 2 * ((from ^ to >> 1) & 1).cast_signed()
}

// The two say of every pair of phases what the table says.
const _: () = {
    let mut pair = 0;
    while pair < 16 {
        let (from, to) = (pair >> PHASE_BITS, pair & 3);
        assert!(match transition(from, to) {
            Transition::Forth => is_step(from ^ to) && count(from, to) == 1,
            Transition::Back => is_step(from ^ to) && count(from, to) == -1,
            Transition::None => from == to,
            Transition::Illegal => !is_step(from ^ to) && from != to,
        });
        pair += 1;
    }
};

/// The state before an edge, and the lines after it.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    state: u32,
    to: u32,
}

impl Seen {
    /// A step, and no index mark near.
    #[inline(always)]
    pub fn is_plain(&self) -> bool {
        // The index line, and what the latch knows of it, lie above the phase.
        is_step(self.state ^ self.to)
    }
}

/// Counts edges of A and B, and latches index marks.
///
/// `S` is where the state is: a [`Shared`] of its own, or a reference to one that slower tasks read too.
#[derive(Debug)]
pub struct Quadrature<S = Shared>(S);

impl Quadrature {
    /// Starts at count 0 from the levels that are there; `now` stands in for the time of the newest edge until one comes.
    pub fn new(levels: Levels, now: u32) -> Self {
        Quadrature::on(Shared::new(), levels, now)
    }
}

impl<S: Borrow<Shared>> Quadrature<S> {
    /// As [`Quadrature::new`], with the state in `shared`, which was new until now and belongs to this decoder alone.
    pub fn on(shared: S, levels: Levels, now: u32) -> Self {
        shared.borrow().last_edge.store(now, Relaxed);
        let mut quadrature = Quadrature(shared);
        quadrature.resume(levels);
        quadrature
    }

    /// Takes the levels after an edge of A, B or the index line; `now` gives the clock time, once. Levels that have not changed
    /// are neither counted nor illegal: an interrupt that comes late finds its edge already served.
    #[inline(always)]
    pub fn edge(&mut self, levels: Levels, now: impl FnOnce() -> u32) {
        self.take(self.seen(levels), now);
    }

    /// The first half of [`Quadrature::edge`], which changes nothing: for an interrupt that decides in between whether it
    /// serves the edge.
    #[inline(always)]
    pub fn seen(&self, levels: Levels) -> Seen {
        Seen { state: self.0.borrow().state.load(Relaxed), to: lines(levels) }
    }

    /// The second half of [`Quadrature::edge`].
    #[inline(always)]
    pub fn take(&mut self, seen: Seen, now: impl FnOnce() -> u32) {
        if seen.is_plain() {
            self.step(seen, now);
        } else {
            self.unusual(seen.to, now(), seen.state);
        }
    }

    /// The same for what [`Seen::is_plain`].
    #[inline(always)]
    pub fn step(&mut self, Seen { state, to }: Seen, now: impl FnOnce() -> u32) {
        let shared = self.0.borrow();
        // In this order, and the clock read no sooner, it takes no register that would have to be saved; a load behind a load
        // takes one cycle.
        shared.state.store(to, Relaxed);
        let before = shared.count.load(Relaxed);
        shared.step(before, count(state, to), now());
    }

    /// An edge near an index mark, the same levels again, or an illegal transition.
    #[cold]
    fn unusual(&mut self, to: u32, now: u32, state: u32) {
        let shared = self.0.borrow();
        let changed = phase(state ^ to);
        let high = to >> PHASE_BITS & 1;
        let mut latch = MarkLatch::of(state >> LATCH_BIT);
        if is_step(changed) {
            let (before, step) = (shared.count.load(Relaxed), shared.newest_step.load(Relaxed));
            if let Some(mark) = latch.leave(before, step == 1, high) {
                shared.cross(mark, step == 1);
            }
            shared.step(before, count(state, to), now);
        } else if changed == 0 {
            latch.stay(high);
        } else {
            shared.illegal.store(shared.illegal.load(Relaxed).wrapping_add(1), Relaxed);
            latch = MarkLatch::new(high);
        }
        shared.state.store(phase(to) | latch.line() << LATCH_BIT, Relaxed);
    }

    /// Goes on from the levels that are there, after edges that were deliberately not served: neither counted nor illegal.
    pub fn resume(&mut self, levels: Levels) {
        let line = MarkLatch::new(levels.index.into()).line();
        self.0.borrow().state.store(phase(lines(levels)) | line << LATCH_BIT, Relaxed);
    }

    /// Everything known at clock time `now`, which is not before the newest edge.
    pub fn snapshot(&self, now: u32) -> Snapshot {
        self.0.borrow().read(|| now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_hal_shim::encoder::RawCount;

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
            decoder.edge(at(start + 1), || 7);
            assert_eq!(decoder.snapshot(9).raw, RawCount { count: 1, last_edge: 7, toward_work: true, now: 9 });
            decoder.edge(at(start), || 8);
            assert_eq!(decoder.snapshot(9).raw, RawCount { count: 0, last_edge: 8, toward_work: false, now: 9 });
            assert_eq!(decoder.snapshot(9).illegal, 0);
        }
    }

    #[test]
    fn the_state_at_start_comes_from_the_inputs() {
        for start in 0..4 {
            let mut decoder = Quadrature::new(at(start), 5);
            decoder.edge(at(start), || 6);
            assert_eq!(state(&decoder), (0, 5, 0));
        }
    }

    #[test]
    fn a_double_transition_is_counted_as_illegal_and_decoding_goes_on_from_the_present_levels() {
        for start in 0..4 {
            let mut decoder = Quadrature::new(at(start), 0);
            decoder.edge(at(start + 2), || 1);
            assert_eq!(state(&decoder), (0, 0, 1));
            decoder.edge(at(start + 3), || 2);
            assert_eq!(state(&decoder), (1, 2, 1));
        }
    }

    #[test]
    fn edges_not_served_on_purpose_are_neither_counted_nor_illegal() {
        for missed in 0..4 {
            let mut decoder = Quadrature::new(at(0), 0);
            decoder.resume(at(missed));
            decoder.edge(at(missed + 1), || 3);
            assert_eq!(state(&decoder), (1, 3, 0));
        }
    }

    #[test]
    fn a_mark_reached_by_an_illegal_transition_has_no_position_and_is_not_latched() {
        // A mark over counts 4 to 7, entered from 3: step by step, and by a double transition from 2.
        for (path, crossings) in [([1, 2, 3, 4, 5, 6, 7], 1), ([0, 1, 2, 4, 5, 6, 7], 0)] {
            let mut decoder = Quadrature::new(at(0), 0);
            for position in path {
                decoder.edge(Levels { index: (4..8).contains(&position), ..at(position) }, || 0);
            }
            assert_eq!(decoder.snapshot(0).mark.crossings, crossings);
        }
    }

    #[test]
    fn an_edge_already_served_is_not_counted_twice() {
        let mut decoder = Quadrature::new(at(0), 0);
        decoder.edge(at(1), || 1);
        decoder.edge(at(1), || 2);
        assert_eq!(state(&decoder), (1, 1, 0));
    }

    #[test]
    fn the_count_wraps_below_zero_by_one_and_comes_back() {
        let mut decoder = Quadrature::new(at(0), 0);
        decoder.edge(at(-1), || 1);
        assert_eq!(state(&decoder), (u32::MAX, 1, 0));
        decoder.edge(at(0), || 2);
        assert_eq!(state(&decoder), (0, 2, 0));
    }
}

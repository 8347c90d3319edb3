//! What crosses from the edge interrupt to slower tasks, without a lock.
//!
//! One core; the interrupt may pre-empt a reader at any instruction and always finishes before the reader goes on; the
//! reader never pre-empts the interrupt. So the writer is always consistent and only the reader has to notice that it was
//! interrupted. Counted edges have different times, so the time of the newest edge shows whether one came: the reader reads
//! it, the other values and the clock, and the time of the newest edge again. If it has moved, it reads once more.
//! (Illegal transitions do not move it. They stand alone, nothing has to match them.)
//!
//! Why a few attempts suffice: an attempt takes about 60 cycles, 0.35 us at 168 MHz. It fails however many edges came while
//! it was interrupted, so two failures in a row take two separate interruptions that both bring an edge. Edges at the rated
//! 300 kcount/s are 3.3 us apart, nine attempts; tasks between interrupt and reader, which could hide several edges, start
//! at most once a tick. That makes two failures, and the third attempt succeeds. If noise on the lines spoils all
//! [`ATTEMPTS`], the reader gets what the last one read: each value is one that the decoder had during that attempt, and
//! only their pairing may be off, by the edges of one attempt.

use super::index::Mark;
use crate::units::rare;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed, Ordering::SeqCst, compiler_fence};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::{EdgeCounter, RawCount};

/// Attempts at a consistent reading.
pub const ATTEMPTS: u32 = 4;

/// Everything a decoder knows at one instant.
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

/// State of one decoder, written by it alone and readable by slower tasks.
///
/// Loads and stores instead of atomic additions: there is one writer. The order of its stores does not matter, a reader sees
/// all stores of an interrupt or none.
#[derive(Debug, Default)]
pub struct Shared {
    pub(super) count: AtomicU32,
    /// Newest step, 1 or -1; 0 before the first.
    pub(super) newest_step: AtomicU32,
    pub(super) last_edge: AtomicU32,
    pub(super) illegal: AtomicU32,
    /// Phase and index line, for the decoder alone.
    pub(super) state: AtomicU32,
    mark_count: AtomicU32,
    /// Twice the crossings, and one if the newest went toward the work.
    mark_crossings: AtomicU32,
}

impl Shared {
    /// For a `static`.
    pub const fn new() -> Self {
        Shared {
            count: AtomicU32::new(0),
            newest_step: AtomicU32::new(0),
            last_edge: AtomicU32::new(0),
            illegal: AtomicU32::new(0),
            state: AtomicU32::new(0),
            mark_count: AtomicU32::new(0),
            mark_crossings: AtomicU32::new(0),
        }
    }

    /// A step of 1 or -1 from the count `before` at clock time `now`.
    #[inline(always)]
    pub(super) fn step(&self, before: u32, step: i32, now: u32) {
        self.count.store(before.wrapping_add_signed(step), Relaxed);
        self.newest_step.store(step as u32, Relaxed);
        self.last_edge.store(now, Relaxed);
    }

    /// A mark has been crossed.
    pub(super) fn cross(&self, count: u32, toward_work: bool) {
        let crossings = (self.mark_crossings.load(Relaxed) >> 1).wrapping_add(1);
        self.mark_count.store(count, Relaxed);
        self.mark_crossings.store(crossings << 1 | u32::from(toward_work), Relaxed);
    }

    /// Shows what another decoder has shown, for a replay; the one that this belongs to does not count meanwhile.
    #[cfg(not(target_os = "none"))]
    pub fn replay(&self, Snapshot { raw, illegal, mark }: &Snapshot) {
        self.count.store(raw.count, Relaxed);
        self.newest_step.store(if raw.toward_work { 1 } else { u32::MAX }, Relaxed);
        self.last_edge.store(raw.last_edge, Relaxed);
        self.illegal.store(*illegal, Relaxed);
        self.mark_count.store(mark.count, Relaxed);
        self.mark_crossings.store(mark.crossings << 1 | u32::from(mark.toward_work), Relaxed);
    }

    /// The newest state; `now` is asked for the time once per attempt, so that no edge lies between count and time.
    pub fn read(&self, now: impl FnMut() -> u32) -> Snapshot {
        self.read_interrupted(now, || {})
    }

    /// As [`Shared::read`], count and times alone: what every tick needs.
    #[inline]
    pub fn read_count(&self, now: impl FnMut() -> u32) -> RawCount {
        self.read_count_interrupted(now, || {})
    }

    /// The newest index mark. It is at the most as many attempts old as marks were crossed meanwhile: marks are far apart.
    #[inline]
    pub fn read_mark(&self) -> Mark {
        let mut mark = Mark::default();
        for _ in 0..ATTEMPTS {
            let crossings = load(&self.mark_crossings, &mut || {});
            let count = load(&self.mark_count, &mut || {});
            mark = Mark { count, toward_work: crossings & 1 != 0, crossings: crossings >> 1 };
            if load(&self.mark_crossings, &mut || {}) == crossings {
                break;
            }
        }
        mark
    }

    /// As [`Shared::read`]; `interrupt` runs wherever the edge interrupt could.
    fn read_interrupted(&self, mut now: impl FnMut() -> u32, mut interrupt: impl FnMut()) -> Snapshot {
        let mut snapshot = Snapshot::default();
        for _ in 0..ATTEMPTS {
            let last_edge = load(&self.last_edge, &mut interrupt);
            let mark_crossings = load(&self.mark_crossings, &mut interrupt);
            snapshot = Snapshot {
                mark: Mark {
                    count: load(&self.mark_count, &mut interrupt),
                    toward_work: mark_crossings & 1 != 0,
                    crossings: mark_crossings >> 1,
                },
                illegal: load(&self.illegal, &mut interrupt),
                raw: self.raw(last_edge, &mut now, &mut interrupt),
            };
            if load(&self.last_edge, &mut interrupt) == last_edge {
                break;
            }
        }
        snapshot
    }

    /// As [`Shared::read_count`]; `interrupt` runs wherever the edge interrupt could.
    #[inline]
    fn read_count_interrupted(&self, mut now: impl FnMut() -> u32, mut interrupt: impl FnMut()) -> RawCount {
        let mut raw = RawCount::default();
        for _ in 0..ATTEMPTS {
            let last_edge = load(&self.last_edge, &mut interrupt);
            raw = self.raw(last_edge, &mut now, &mut interrupt);
            if load(&self.last_edge, &mut interrupt) == last_edge {
                break;
            }
            rare();
        }
        raw
    }

    #[inline(always)]
    fn raw(&self, last_edge: u32, now: &mut impl FnMut() -> u32, interrupt: &mut impl FnMut()) -> RawCount {
        RawCount {
            count: load(&self.count, interrupt),
            toward_work: load(&self.newest_step, interrupt) == 1,
            last_edge,
            now: now(),
        }
    }
}

/// Loads in the order of the program. The hardware keeps it for its own interrupts; only the compiler needs a fence.
#[inline(always)]
fn load(value: &AtomicU32, interrupt: &mut impl FnMut()) -> u32 {
    compiler_fence(SeqCst);
    let loaded = value.load(Relaxed);
    interrupt();
    compiler_fence(SeqCst);
    loaded
}

/// The decoder as a counter that a slower task reads.
#[derive(Clone, Copy, Debug)]
pub struct DecoderCount<'a, C> {
    shared: &'a Shared,
    clock: C,
}

impl<'a, C: Clock> DecoderCount<'a, C> {
    /// `clock` must be the one that times the edges.
    pub fn new(shared: &'a Shared, clock: C) -> Self {
        DecoderCount { shared, clock }
    }

    /// The newest index mark.
    pub fn mark(&self) -> Mark {
        self.shared.read_mark()
    }

    /// Count and times, illegal transitions and newest mark, all of one instant.
    pub fn snapshot(&self) -> Snapshot {
        self.shared.read(|| self.clock.now())
    }
}

impl<C: Clock> EdgeCounter for DecoderCount<'_, C> {
    #[inline]
    fn read(&mut self) -> RawCount {
        self.shared.read_count(|| self.clock.now())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoder::Quadrature;
    use edm_hal_shim::encoder::Levels;

    /// Moves toward the work, an edge at each clock tick, so that every value belongs to one count alone.
    struct Machine<'a> {
        decoder: Quadrature<&'a Shared>,
        position: u32,
    }

    impl<'a> Machine<'a> {
        fn levels(position: u32) -> Levels {
            Levels { a: (position + 1) & 2 != 0, b: position & 2 != 0, index: position % 8 == 7 }
        }

        fn new(shared: &'a Shared) -> Self {
            Machine { decoder: Quadrature::on(shared, Self::levels(0), 0), position: 0 }
        }

        fn edge(&mut self) {
            self.position += 1;
            self.decoder.edge(Self::levels(self.position), || self.position);
        }
    }

    fn consistent(snapshot: Snapshot) -> bool {
        let Snapshot { raw, illegal, mark } = snapshot;
        // Latched when the count behind the mark is left.
        let crossings = raw.count / 8;
        raw.count == raw.last_edge
            && raw.toward_work == (raw.count > 0)
            && illegal == 0
            && mark == Mark { count: (crossings * 8).saturating_sub(1), toward_work: crossings > 0, crossings }
    }

    /// Loads of one attempt.
    const LOADS: u32 = 7;

    #[test]
    fn a_reading_is_consistent_wherever_the_interrupt_comes() {
        // Every point of the first attempt and every point of the second.
        for first in 0..LOADS {
            for second in 0..LOADS {
                for edges in 1..12 {
                    let shared = Shared::new();
                    let mut machine = Machine::new(&shared);
                    let mut loads = 0;
                    let snapshot = shared.read_interrupted(
                        || 77,
                        || {
                            if loads == first || loads == LOADS + second {
                                (0..edges).for_each(|_| machine.edge());
                            }
                            loads += 1;
                        },
                    );
                    assert!(consistent(snapshot), "{first} {second} {edges}: {snapshot:?}");
                    let too_late = first == LOADS - 1;
                    assert!(loads > LOADS || too_late, "the first attempt was good although edges came");
                    assert_eq!(snapshot.raw.now, 77);
                }
            }
        }
    }

    #[test]
    fn so_is_a_reading_of_the_count_alone() {
        const LOADS: u32 = 4;
        for first in 0..LOADS {
            for edges in 1..12 {
                let shared = Shared::new();
                let mut machine = Machine::new(&shared);
                let mut loads = 0;
                let raw = shared.read_count_interrupted(
                    || 77,
                    || {
                        if loads == first {
                            (0..edges).for_each(|_| machine.edge());
                        }
                        loads += 1;
                    },
                );
                assert_eq!((raw.last_edge, raw.toward_work), (raw.count, raw.count > 0), "{first} {edges}");
                assert_eq!(loads > LOADS, first < LOADS - 1);
            }
        }
    }

    #[test]
    fn edges_at_every_instruction_cannot_hold_the_reader() {
        let shared = Shared::new();
        let mut machine = Machine::new(&shared);
        let mut loads = 0;
        let snapshot = shared.read_interrupted(
            || 0,
            || {
                machine.edge();
                loads += 1;
            },
        );
        assert_eq!(loads, LOADS * ATTEMPTS);
        // Old by no more than the read itself.
        assert!(snapshot.raw.count > machine.position - LOADS && snapshot.raw.count <= machine.position);
        assert!(snapshot.raw.last_edge.abs_diff(snapshot.raw.count) < LOADS);
    }

    #[test]
    fn no_edge_lies_between_count_and_time_of_the_reading() {
        let shared = Shared::new();
        let mut machine = Machine::new(&shared);
        let mut asked = 0;
        let snapshot = shared.read(|| {
            asked += 1;
            if asked == 1 {
                machine.edge();
            }
            machine.position
        });
        assert_eq!((snapshot.raw.count, snapshot.raw.now, asked), (1, 1, 2));
    }

    #[test]
    fn a_slower_task_reads_the_decoder_as_an_edge_counter() {
        struct Stopped;
        impl Clock for Stopped {
            const HZ: u32 = 168_000_000;
            fn now(&self) -> u32 {
                9
            }
        }
        let shared = Shared::new();
        let mut machine = Machine::new(&shared);
        (0..8).for_each(|_| machine.edge());
        let mut counter = DecoderCount::new(&shared, Stopped);
        assert_eq!(counter.read(), RawCount { count: 8, last_edge: 8, toward_work: true, now: 9 });
        assert_eq!(counter.snapshot().mark.count, 7);
    }
}

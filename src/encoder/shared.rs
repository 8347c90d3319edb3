//! What crosses from the edge interrupt to slower tasks, without a lock.
//!
//! One core; the interrupt may pre-empt a reader at any instruction and always finishes before the reader goes on; the
//! reader never pre-empts the interrupt. So the writer is always consistent and only the reader has to notice that it was
//! interrupted: it reads the version, the values and the clock, and the version again. If the version has moved, an edge
//! came in between and it reads once more.
//!
//! Why a few attempts suffice: a read is about twenty instructions, 0.2 us at 168 MHz. One attempt fails however many edges
//! came while it was interrupted, so two failures in a row take two separate interruptions that both bring an edge. Edges
//! at the rated 300 kcount/s are 3.3 us apart, sixteen reads; tasks between interrupt and reader, which could hide several
//! edges, start at most once a tick. That makes two failures, and the third attempt succeeds. If noise on the lines spoils
//! [`ATTEMPTS`] attempts, the reader gets what the last one read: every value is one that the decoder published during
//! the read, and only their pairing may be off, by the edges of one read.

use super::index::Mark;
use super::quadrature::{Quadrature, Snapshot};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed, Ordering::SeqCst, compiler_fence};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::{EdgeCounter, RawCount};

/// Attempts at a consistent reading.
pub const ATTEMPTS: u32 = 4;

/// The mailbox between one decoder and its readers.
#[derive(Debug, Default)]
pub struct Shared {
    version: AtomicU32,
    count: AtomicU32,
    last_edge: AtomicU32,
    toward_work: AtomicU32,
    illegal: AtomicU32,
    mark_count: AtomicU32,
    mark_toward_work: AtomicU32,
    mark_crossings: AtomicU32,
}

impl Shared {
    /// Empty until the first [`Shared::publish`].
    pub const fn new() -> Self {
        Shared {
            version: AtomicU32::new(0),
            count: AtomicU32::new(0),
            last_edge: AtomicU32::new(0),
            toward_work: AtomicU32::new(0),
            illegal: AtomicU32::new(0),
            mark_count: AtomicU32::new(0),
            mark_toward_work: AtomicU32::new(0),
            mark_crossings: AtomicU32::new(0),
        }
    }

    /// Publishes the decoder's state: once at start, then from the edge interrupt alone.
    #[inline]
    pub fn publish(&self, decoder: &Quadrature) {
        // Order does not matter here, the reader sees all of these stores or none. Load and store instead of an atomic
        // addition: there is one writer.
        let Snapshot { raw, illegal, mark } = decoder.snapshot(0);
        self.version.store(self.version.load(Relaxed).wrapping_add(1), Relaxed);
        self.count.store(raw.count, Relaxed);
        self.last_edge.store(raw.last_edge, Relaxed);
        self.toward_work.store(raw.toward_work.into(), Relaxed);
        self.illegal.store(illegal, Relaxed);
        self.mark_count.store(mark.count, Relaxed);
        self.mark_toward_work.store(mark.toward_work.into(), Relaxed);
        self.mark_crossings.store(mark.crossings, Relaxed);
    }

    /// The newest state; `now` is asked for the time once per attempt, so that no edge lies between count and time.
    pub fn read(&self, now: impl FnMut() -> u32) -> Snapshot {
        self.read_interrupted(now, || {})
    }

    /// As [`Shared::read`]; `interrupt` runs wherever the edge interrupt could.
    #[inline]
    fn read_interrupted(&self, mut now: impl FnMut() -> u32, mut interrupt: impl FnMut()) -> Snapshot {
        let mut load = |value: &AtomicU32| {
            // The hardware keeps the order of loads for its own interrupts; the compiler has to be told.
            compiler_fence(SeqCst);
            let loaded = value.load(Relaxed);
            interrupt();
            compiler_fence(SeqCst);
            loaded
        };
        let mut snapshot = Snapshot::default();
        for _ in 0..ATTEMPTS {
            let version = load(&self.version);
            snapshot = Snapshot {
                raw: RawCount {
                    count: load(&self.count),
                    last_edge: load(&self.last_edge),
                    toward_work: load(&self.toward_work) != 0,
                    now: now(),
                },
                illegal: load(&self.illegal),
                mark: Mark {
                    count: load(&self.mark_count),
                    toward_work: load(&self.mark_toward_work) != 0,
                    crossings: load(&self.mark_crossings),
                },
            };
            if load(&self.version) == version {
                break;
            }
        }
        snapshot
    }
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

    /// Count and times, illegal transitions and newest mark, all of one instant.
    pub fn snapshot(&self) -> Snapshot {
        self.shared.read(|| self.clock.now())
    }
}

impl<C: Clock> EdgeCounter for DecoderCount<'_, C> {
    fn read(&mut self) -> RawCount {
        self.snapshot().raw
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_hal_shim::encoder::Levels;

    /// Moves toward the work, an edge at each clock tick, so that every value belongs to one count alone.
    struct Machine {
        decoder: Quadrature,
        position: u32,
    }

    impl Machine {
        fn levels(position: u32) -> Levels {
            Levels { a: (position + 1) & 2 != 0, b: position & 2 != 0, index: position % 8 == 7 }
        }

        fn new(shared: &Shared) -> Self {
            let decoder = Quadrature::new(Self::levels(0), 0);
            shared.publish(&decoder);
            Machine { decoder, position: 0 }
        }

        fn edge(&mut self, shared: &Shared) {
            self.position += 1;
            self.decoder.edge(Self::levels(self.position), self.position);
            shared.publish(&self.decoder);
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

    /// Loads of one attempt: seven values between two of the version.
    const LOADS: u32 = 9;

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
                                (0..edges).for_each(|_| machine.edge(&shared));
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
    fn edges_at_every_instruction_cannot_hold_the_reader() {
        let shared = Shared::new();
        let mut machine = Machine::new(&shared);
        let mut loads = 0;
        let snapshot = shared.read_interrupted(
            || 0,
            || {
                machine.edge(&shared);
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
                machine.edge(&shared);
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
        (0..8).for_each(|_| machine.edge(&shared));
        let mut counter = DecoderCount::new(&shared, Stopped);
        assert_eq!(counter.read(), RawCount { count: 8, last_edge: 8, toward_work: true, now: 9 });
        assert_eq!(counter.snapshot().mark.count, 7);
    }
}

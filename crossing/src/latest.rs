//! The newest value wins: configuration on its way to a task, status on its way back.
//!
//! Three *slots* hold values. One belongs to the writer, one to the reader, and one lies in the middle. The writer fills its
//! own and exchanges it with the middle one; the reader exchanges its own with the middle one when that is *fresh*. An
//! exchange is one atomic step, so neither side waits, no write is refused, and the reader's value is whole and stays put
//! until it asks for the next.
//!
//! Each value has a *generation*: 0 is the initial one, every write counts one further. The reader answers with a *verdict*
//! on a generation (in force, or refused), by which the writer knows what is run and not only what was written. The verdict
//! has to be one word, with one bit for the answer, so generations count modulo 2^31: after 2 147 483 647 comes 0. Compare
//! them for being equal.

use crate::preempt::point;
use crate::sync::{AtomicU8, AtomicU32, UnsafeCell, const_unless_loom};
use core::sync::atomic::Ordering::{AcqRel, Acquire, Relaxed, Release};

/// Generations before they begin anew, less one.
const GENERATIONS: u32 = u32::MAX >> 1;
/// In `middle`: which slot it is.
const INDEX: u8 = 0b011;
/// In `middle`: the writer has put it there, and the reader has not looked since.
const FRESH: u8 = 0b100;

/// Room for three values, empty until it is split. All zero until then, so that a static one takes no flash.
pub struct Latest<T> {
    slots: [Option<Slot<T>>; 3],
    shared: Shared,
}

/// What both sides may touch at any time.
struct Shared {
    middle: AtomicU8,
    verdict: AtomicU32,
}

/// A value of which one side at a time is the owner.
struct Slot<T> {
    index: u8,
    held: UnsafeCell<Held<T>>,
}

struct Held<T> {
    value: T,
    generation: u32,
}

/// The side that writes.
pub struct Writer<'a, T> {
    slots: [&'a Slot<T>; 3],
    shared: &'a Shared,
    free: &'a Slot<T>,
    generation: u32,
}

/// The side that reads.
pub struct Reader<'a, T> {
    slots: [&'a Slot<T>; 3],
    shared: &'a Shared,
    taken: &'a Slot<T>,
}

/// What a reader last said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// Of the value it speaks of.
    pub generation: u32,
    /// That value is in force; otherwise the reader has refused it and keeps the value before it.
    pub accepted: bool,
}

// SAFETY: a writer touches no value but that of its own slot, whose ownership passes with the exchanges of `middle`; so
// values are used by one thread at a time, which is what `T: Send` allows.
unsafe impl<T: Send> Send for Writer<'_, T> {}
// SAFETY: as for the writer.
unsafe impl<T: Send> Send for Reader<'_, T> {}

impl<T> Latest<T> {
    const_unless_loom! {
        /// With no value in it.
        pub const fn new() -> Latest<T> {
            Latest { slots: [None, None, None], shared: Shared { middle: AtomicU8::new(0), verdict: AtomicU32::new(0) } }
        }
    }

    /// Both sides, with the initial value at the reader's: generation 0, which counts as accepted.
    ///
    /// What an earlier split has left behind is dropped.
    pub fn split(&mut self, initial: T) -> (Writer<'_, T>, Reader<'_, T>)
    where
        T: Clone,
    {
        let [writers, middle, readers] = &mut self.slots;
        // The writer's and the middle one are never read before they are written, but must hold some value.
        let writers = &*writers.insert(Slot::new(0, initial.clone()));
        let middle = &*middle.insert(Slot::new(1, initial.clone()));
        let readers = &*readers.insert(Slot::new(2, initial));
        let slots = [writers, middle, readers];
        let shared = &self.shared;
        shared.middle.store(middle.index, Relaxed);
        shared.verdict.store(Verdict { generation: 0, accepted: true }.packed(), Relaxed);
        (Writer { slots, shared, free: writers, generation: 0 }, Reader { slots, shared, taken: readers })
    }
}

impl<T> Default for Latest<T> {
    fn default() -> Latest<T> {
        Latest::new()
    }
}

impl<T> Slot<T> {
    fn new(index: u8, value: T) -> Slot<T> {
        Slot { index, held: UnsafeCell::new(Held { value, generation: 0 }) }
    }

    /// The slot that was in the middle.
    #[inline(always)]
    fn of([first, second, third]: [&Self; 3], middle: u8) -> &Self {
        match middle & INDEX {
            0 => first,
            1 => second,
            _ => third,
        }
    }
}

impl<T> Writer<'_, T> {
    /// Lets `fill` write a value in place, then publishes it; gives its generation (1, 2, ... modulo 2^31).
    ///
    /// What `fill` finds is one of the values before, not always the last: what it does not write is left from then. If it
    /// panics nothing is published.
    #[inline]
    pub fn write(&mut self, fill: impl FnOnce(&mut T)) -> u32 {
        point();
        let generation = self.generation.wrapping_add(1) & GENERATIONS;
        self.free.held.with_mut(|held| {
            // SAFETY: the slot is the writer's until the exchange below, and `&mut self` makes this the only write.
            let held = unsafe { &mut *held };
            fill(&mut held.value);
            held.generation = generation;
        });
        point();
        // Release: the value goes with it. Acquire: the reader of the slot that comes back is done with it.
        let middle = self.shared.middle.swap(self.free.index | FRESH, AcqRel);
        self.free = Slot::of(self.slots, middle);
        self.generation = generation;
        point();
        generation
    }

    /// Whether the newest value published has not been taken yet. Once false it stays so until the next write.
    #[inline]
    pub fn is_unread(&self) -> bool {
        point();
        // Relaxed: nothing of the value is used.
        let unread = self.shared.middle.load(Relaxed) & FRESH != 0;
        point();
        unread
    }

    /// Generation of the newest value published.
    #[inline]
    pub fn generation(&self) -> u32 {
        self.generation
    }

    /// What the reader last said; at first that the initial value, generation 0, is in force.
    #[inline]
    pub fn verdict(&self) -> Verdict {
        point();
        let verdict = Verdict::unpacked(self.shared.verdict.load(Acquire));
        point();
        verdict
    }
}

impl<T> Reader<'_, T> {
    /// Whether there is a newer value than that of [`get`](Reader::get). Once true it stays so until the next refresh.
    #[inline]
    pub fn is_fresh(&self) -> bool {
        point();
        // Relaxed: the exchange that follows acquires the value.
        let fresh = self.shared.middle.load(Relaxed) & FRESH != 0;
        point();
        fresh
    }

    /// Takes the newest value if there is one; true when there was.
    #[inline]
    pub fn refresh(&mut self) -> bool {
        let fresh = self.is_fresh();
        if fresh {
            // Acquire: the value comes with it. Release: the slot that is given back is no longer read.
            let middle = self.shared.middle.swap(self.taken.index, AcqRel);
            self.taken = Slot::of(self.slots, middle);
            point();
        }
        fresh
    }

    /// The value taken last. It stays put until the next refresh.
    #[inline]
    pub fn get(&self) -> &T {
        // SAFETY: the slot is the reader's until the next exchange, which needs `&mut self`; nobody writes to it.
        self.taken.held.with(|held| unsafe { &(*held).value })
    }

    /// Generation of the value taken last.
    #[inline]
    pub fn generation(&self) -> u32 {
        // SAFETY: as in `get`.
        self.taken.held.with(|held| unsafe { (*held).generation })
    }

    /// Tells the writer that the value taken last is in force.
    ///
    /// Whatever this task wrote before is then seen by who has read the verdict.
    #[inline]
    pub fn accept(&mut self) {
        self.say(true);
    }

    /// Tells the writer that the value taken last will not run.
    #[inline]
    pub fn refuse(&mut self) {
        self.say(false);
    }

    #[inline(always)]
    fn say(&mut self, accepted: bool) {
        let verdict = Verdict { generation: self.generation(), accepted };
        point();
        self.shared.verdict.store(verdict.packed(), Release);
        point();
    }
}

impl Verdict {
    #[inline(always)]
    fn packed(self) -> u32 {
        self.generation << 1 | u32::from(self.accepted)
    }

    #[inline(always)]
    fn unpacked(word: u32) -> Verdict {
        Verdict { generation: word >> 1, accepted: word & 1 != 0 }
    }
}

//! One word that says everything: flags, words, counters.
//!
//! Whatever one side wrote before it stored is seen by the other once it has loaded that (release, acquire). Only `take` and
//! `swap` read and write in one step; all else is one load or one store, with no loop that an interrupt could make longer.

use crate::preempt::point;
use crate::sync::{AtomicBool, AtomicU32, const_unless_loom, own};
use core::sync::atomic::Ordering::{AcqRel, Acquire, Release};

/// Something has happened, or is so.
///
/// For an event any number of tasks [`set`](Flag::set) and one [`take`](Flag::take)s: several sets before it are one. If
/// data comes along with the event only one task sets: of several threads the taker sees what the last one wrote. (On one
/// core it sees what all wrote, but that is nothing a model could check.) For a state its one owner
/// [`store`](Flag::store)s, and anybody looks.
pub struct Flag(AtomicBool);

impl Flag {
    const_unless_loom! {
        /// A flag that is not set.
        pub const fn new() -> Flag {
            Flag(AtomicBool::new(false))
        }
    }

    /// Sets it. Any task.
    #[inline]
    pub fn set(&self) {
        self.store(true);
    }

    /// Clears it, whether it was set or not. For the task that takes or owns it: a set that comes in between is forgotten.
    #[inline]
    pub fn clear(&self) {
        self.store(false);
    }

    /// Clears it and says whether it was set. For the one task that the event is for.
    #[inline]
    pub fn take(&self) -> bool {
        // Mostly it is not set, and then a load is all. Nobody else clears it between load and swap.
        let set = self.is_set();
        if set {
            self.0.swap(false, Acquire);
            point();
        }
        set
    }

    /// Whether it is set. Any task.
    #[inline]
    pub fn is_set(&self) -> bool {
        point();
        let set = self.0.load(Acquire);
        point();
        set
    }

    /// Sets or clears it. For the one task whose state it is.
    #[inline]
    pub fn store(&self, set: bool) {
        point();
        self.0.store(set, Release);
        point();
    }
}

impl Default for Flag {
    fn default() -> Flag {
        Flag::new()
    }
}

/// A number of 32 bits, or what fits into one, always whole.
pub struct Word(AtomicU32);

impl Word {
    const_unless_loom! {
        /// This value.
        pub const fn new(value: u32) -> Word {
            Word(AtomicU32::new(value))
        }
    }

    /// The value. Any task.
    #[inline]
    pub fn load(&self) -> u32 {
        point();
        let value = self.0.load(Acquire);
        point();
        value
    }

    /// Another value. For the one task whose value it is, or for several where the last one counts.
    #[inline]
    pub fn store(&self, value: u32) {
        point();
        self.0.store(value, Release);
        point();
    }

    /// Another value; gives the one before. Any task: of what passes through swaps alone nothing is seen twice or missed.
    #[inline]
    pub fn swap(&self, value: u32) -> u32 {
        point();
        let before = self.0.swap(value, AcqRel);
        point();
        before
    }
}

impl Default for Word {
    fn default() -> Word {
        Word::new(0)
    }
}

/// How often something has happened, modulo 2^32.
pub struct Counter(AtomicU32);

impl Counter {
    const_unless_loom! {
        /// Never yet.
        pub const fn new() -> Counter {
            Counter(AtomicU32::new(0))
        }
    }

    /// Once more. For its one writer, or for several of the same priority: between two that interrupt each other counts
    /// would be lost.
    #[inline]
    pub fn increment(&self) {
        point();
        let count = own!(self.0).wrapping_add(1);
        self.0.store(count, Release);
        point();
    }

    /// The count. Any task.
    #[inline]
    pub fn read(&self) -> u32 {
        point();
        let count = self.0.load(Acquire);
        point();
        count
    }
}

impl Default for Counter {
    fn default() -> Counter {
        Counter::new()
    }
}

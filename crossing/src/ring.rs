//! Events, each of which counts: a ring from one task to another.
//!
//! An event that finds the ring full is dropped and counted as lost: what is sent is what is received and what is lost. Who
//! must not lose one asks for [`room`](Sender::room) first, which only grows until the next send.
//!
//! Two *places* count through the ring twice before they begin anew: where the sender writes next, and where the receiver
//! reads next. Equal places are an empty ring, places that are N apart a full one, so all N slots are used.

use crate::preempt::{self, point};
use crate::sync::{AtomicU32, AtomicUsize, UnsafeCell, const_unless_loom, own, vacant};
use core::mem::MaybeUninit;
use core::sync::atomic::Ordering::{Acquire, Relaxed, Release};

/// Room for N events; with a power of two a place is turned into a slot by one instruction. All zero at first, so that a static
/// one takes no flash.
pub struct Ring<T, const N: usize> {
    /// Filled from `front` to before `back`, vacant elsewhere.
    slots: [UnsafeCell<MaybeUninit<T>>; N],
    /// The place that the receiver reads next; the receiver's.
    front: AtomicUsize,
    /// The place that the sender writes next; the sender's.
    back: AtomicUsize,
    /// The sender's.
    lost: AtomicU32,
}

/// The side that sends.
pub struct Sender<'a, T, const N: usize> {
    ring: &'a Ring<T, N>,
}

/// The side that receives.
pub struct Receiver<'a, T, const N: usize> {
    ring: &'a Ring<T, N>,
}

// SAFETY: a sender touches vacant slots alone, a receiver filled ones; a slot passes from one to the other with `back` and
// `front`. So an event is used by one thread at a time, which is what `T: Send` allows.
unsafe impl<T: Send, const N: usize> Send for Sender<'_, T, N> {}
// SAFETY: as for the sender.
unsafe impl<T: Send, const N: usize> Send for Receiver<'_, T, N> {}

impl<T, const N: usize> Ring<T, N> {
    const_unless_loom! {
        /// An empty one. N is at least 1.
        pub const fn new() -> Ring<T, N> {
            const { assert!(N > 0 && N <= usize::MAX / 2, "a ring has at least one slot, and twice as many places") };
            Ring { slots: vacant(), front: AtomicUsize::new(0), back: AtomicUsize::new(0), lost: AtomicU32::new(0) }
        }
    }

    /// Both sides. Events of an earlier split that were not received are still there.
    pub fn split(&mut self) -> (Sender<'_, T, N>, Receiver<'_, T, N>) {
        (Sender { ring: self }, Receiver { ring: self })
    }

    /// The slot of a place; the remainder is less than N, and N is not 0.
    #[inline(always)]
    fn slot(&self, place: usize) -> &UnsafeCell<MaybeUninit<T>> {
        &self.slots[place % N]
    }

    /// The place behind this one.
    #[inline(always)]
    fn behind(place: usize) -> usize {
        if place == 2 * N - 1 { 0 } else { place + 1 }
    }

    /// Events between two places.
    #[inline(always)]
    fn between(front: usize, back: usize) -> usize {
        if back >= front { back - front } else { back + 2 * N - front }
    }
}

impl<T, const N: usize> Default for Ring<T, N> {
    fn default() -> Ring<T, N> {
        Ring::new()
    }
}

impl<T, const N: usize> Drop for Ring<T, N> {
    fn drop(&mut self) {
        let (_, mut receiver) = self.split();
        while receiver.receive().is_some() {}
    }
}

impl<T, const N: usize> Sender<'_, T, N> {
    /// Sends an event. When the ring is full it is dropped and counted.
    #[inline]
    pub fn send(&mut self, event: T) {
        preempt::sent();
        let room = self.room();
        let ring = self.ring;
        if room == 0 {
            preempt::lost();
            ring.lost.store(own!(ring.lost).wrapping_add(1), Relaxed);
        } else {
            let back = own!(ring.back);
            ring.slot(back).with_mut(|slot| {
                // SAFETY: there is room, so this slot is vacant: the receiver does not touch it before `back` has passed it,
                // and `&mut self` makes this the only send.
                let slot = unsafe { &mut *slot };
                slot.write(event);
            });
            // A hook that panics here leaves the event unsent, and never dropped.
            point();
            // Release: the event goes with it.
            ring.back.store(Ring::<T, N>::behind(back), Release);
        }
        point();
    }

    /// Events that fit now. It grows by itself, and shrinks by sending alone.
    #[inline]
    pub fn room(&self) -> usize {
        point();
        // Acquire: the receiver has taken what was in those slots.
        let front = self.ring.front.load(Acquire);
        point();
        N - Ring::<T, N>::between(front, own!(self.ring.back))
    }

    /// Everything sent has been received.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.room() == N
    }
}

impl<T, const N: usize> Receiver<'_, T, N> {
    /// The oldest event.
    #[inline]
    pub fn receive(&mut self) -> Option<T> {
        if self.is_empty() {
            return None;
        }
        let ring = self.ring;
        let front = own!(ring.front);
        // SAFETY: the ring is not empty, so this slot is filled, and the sender does not touch it before `front` has passed
        // it; that follows at once, so that the event is read out once.
        let event = ring.slot(front).with(|slot| unsafe { (*slot).assume_init_read() });
        // No point in between: a hook that panics would leave the event here and there, and the sender cannot distinguish reading
        // from what was before it. Release: the slot is no longer read.
        ring.front.store(Ring::<T, N>::behind(front), Release);
        preempt::received();
        point();
        Some(event)
    }

    /// The oldest event, where it is.
    #[inline]
    pub fn peek(&self) -> Option<&T> {
        if self.is_empty() {
            return None;
        }
        // SAFETY: the ring is not empty, so this slot is filled, and stays so until `receive`, which needs `&mut self`.
        Some(self.ring.slot(own!(self.ring.front)).with(|slot| unsafe { (*slot).assume_init_ref() }))
    }

    /// Nothing has been sent that was not received.
    #[inline]
    pub fn is_empty(&self) -> bool {
        point();
        // Acquire: the events come with it.
        let back = self.ring.back.load(Acquire);
        point();
        back == own!(self.ring.front)
    }

    /// Events lost since power-up, modulo 2^32.
    #[inline]
    pub fn lost(&self) -> u32 {
        point();
        let lost = self.ring.lost.load(Relaxed);
        point();
        lost
    }
}

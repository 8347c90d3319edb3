//! Every order of the steps of two threads, as far as the memory model of C11 allows (loom).
//!
//! `RUSTFLAGS="--cfg loom" cargo test -p edm-crossing --test model`
//!
//! loom watches every access to the values: one that is not ordered after the other side's ends the model, so a torn value
//! does not have to be looked for. What is asserted here comes on top of that. Each model also names all outcomes that there
//! are, and has to meet each of them: one that is hardly explored proves nothing.

#![cfg(loom)]

use edm_crossing::{Counter, Flag, Latest, Receiver, Ring, Sender, Word};
use loom::cell::UnsafeCell;
use loom::sync::Arc;
use loom::thread;
use std::collections::BTreeSet;
use std::fmt::Debug;
use std::sync::Mutex;

/// Runs a model in every order. The outcomes of the runs are these, no more and no less.
fn every_order<O>(outcomes: impl IntoIterator<Item = O>, run: impl Fn() -> O + Send + Sync + 'static)
where
    O: Ord + Debug + Send + 'static,
{
    let met = std::sync::Arc::new(Mutex::new(BTreeSet::new()));
    let meet = met.clone();
    loom::model(move || {
        let outcome = run();
        meet.lock().unwrap().insert(outcome);
    });
    assert_eq!(*met.lock().unwrap(), outcomes.into_iter().collect());
}

/// For the rest of the program, as a static on the chip.
fn forever<T>(value: T) -> &'static mut T {
    Box::leak(Box::new(value))
}

/// Data beside an atomic. loom ends the model where an access is not ordered after the other side's.
#[derive(Clone)]
struct Message(Arc<UnsafeCell<u32>>);

impl Message {
    fn new() -> Message {
        Message(Arc::new(UnsafeCell::new(0)))
    }

    fn write(&self, value: u32) {
        // SAFETY: loom has ended the model by now if another thread could be in there.
        self.0.with_mut(|message| unsafe { *message = value });
    }

    fn read(&self) -> u32 {
        // SAFETY: as for writing.
        self.0.with(|message| unsafe { *message })
    }
}

/// Both halves of a value say the same, unless it is torn.
type Pair = (u32, u32);

#[test]
fn a_reader_sees_whole_values_and_never_an_older_one() {
    const WRITES: u32 = 4;
    let never_back = (0..=WRITES).flat_map(|a| (a..=WRITES).flat_map(move |b| (b..=WRITES).map(move |c| [a, b, c])));
    every_order(never_back, || {
        let (mut writer, mut reader) = forever(Latest::<Pair>::new()).split((0, 0));
        let writing = thread::spawn(move || {
            for value in 1..=WRITES {
                let generation = writer.write(|pair| {
                    assert_eq!(pair.0, pair.1);
                    *pair = (value, value);
                });
                assert_eq!(generation, value);
            }
        });
        let mut before = 0;
        let seen = [(); 3].map(|()| {
            let changed = reader.refresh();
            assert_eq!(*reader.get(), (reader.generation(), reader.generation()));
            assert_eq!(changed, reader.generation() > before);
            before = reader.generation();
            before
        });
        writing.join().unwrap();
        reader.refresh();
        assert_eq!(*reader.get(), (WRITES, WRITES), "the last write is seen");
        assert!(!reader.is_fresh() && !reader.refresh());
        seen
    });
}

#[test]
fn a_value_stays_put_while_newer_ones_are_written() {
    every_order(0..=4, || {
        let (mut writer, mut reader) = forever(Latest::<Pair>::new()).split((0, 0));
        let writing = thread::spawn(move || {
            for value in 1..=4 {
                writer.write(|pair| *pair = (value, value));
            }
        });
        reader.refresh();
        let taken = *reader.get();
        thread::yield_now();
        assert_eq!(*reader.get(), taken);
        writing.join().unwrap();
        assert_eq!(*reader.get(), taken);
        taken.0
    });
}

#[test]
fn what_is_fresh_is_taken() {
    every_order([false, true], || {
        let (mut writer, mut reader) = forever(Latest::<Pair>::new()).split((0, 0));
        let writing = thread::spawn(move || {
            for value in 1..=3 {
                writer.write(|pair| *pair = (value, value));
            }
        });
        let fresh = reader.is_fresh();
        if fresh {
            assert!(reader.is_fresh());
            assert!(reader.refresh());
        }
        writing.join().unwrap();
        fresh
    });
}

#[test]
fn a_verdict_is_of_a_generation_that_was_published_and_what_it_stands_for_has_happened() {
    every_order(0..=2, || {
        let in_force = Message::new();
        let (mut writer, mut reader) = forever(Latest::<u32>::new()).split(0);
        let runs = in_force.clone();
        let reading = thread::spawn(move || {
            for _ in 0..2 {
                if reader.refresh() {
                    // Odd ones are refused.
                    if *reader.get() % 2 == 0 {
                        runs.write(*reader.get());
                        reader.accept();
                    } else {
                        reader.refuse();
                    }
                }
            }
        });
        let mut before = 0;
        for value in 1..=2 {
            writer.write(|slot| *slot = value);
            let verdict = writer.verdict();
            assert!((before..=value).contains(&verdict.generation));
            assert_eq!(verdict.accepted, verdict.generation % 2 == 0);
            before = verdict.generation;
        }
        if before == 2 {
            assert_eq!(in_force.read(), 2);
        }
        reading.join().unwrap();
        before
    });
}

/// Sends `sent` numbers through a ring of N while the other thread tries `attempts` times to receive; the books are right.
fn books_are_right<const N: usize>(sent: u32, attempts: u32) {
    let unavoidable = sent.saturating_sub(N as u32 + attempts);
    every_order(unavoidable..=sent - N as u32, move || {
        // loom counts these, so that one that is overwritten, doubled or forgotten is found.
        let (mut sender, mut receiver): (Sender<'_, Arc<u32>, N>, _) = forever(Ring::new()).split();
        // Begin where the places are about to start anew.
        for _ in 0..2 * N - 1 {
            sender.send(Arc::new(sent));
            assert!(receiver.receive().is_some());
        }
        let sending = thread::spawn(move || {
            for event in 0..sent {
                sender.send(Arc::new(event));
            }
        });
        let mut received = vec![];
        for _ in 0..attempts {
            take(&mut receiver, &mut received);
        }
        sending.join().unwrap();
        while take(&mut receiver, &mut received) {}
        assert!(received.is_sorted_by(|a, b| a < b), "{received:?} is not in order");
        assert_eq!(received.len() as u32 + receiver.lost(), sent);
        receiver.lost()
    });
}

fn take<const N: usize>(receiver: &mut Receiver<'_, Arc<u32>, N>, received: &mut Vec<u32>) -> bool {
    let Some(event) = receiver.receive() else {
        return false;
    };
    received.push(*event);
    true
}

#[test]
fn a_ring_of_one_loses_nothing_uncounted() {
    books_are_right::<1>(4, 3);
}

#[test]
fn a_ring_of_two_loses_nothing_uncounted() {
    books_are_right::<2>(5, 3);
}

#[test]
fn a_ring_of_three_loses_nothing_uncounted() {
    books_are_right::<3>(5, 2);
}

#[test]
fn the_count_of_lost_events_never_goes_back() {
    every_order([[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]], || {
        let (mut sender, receiver): (Sender<'_, u32, 1>, _) = forever(Ring::new()).split();
        let sending = thread::spawn(move || (0..3).for_each(|event| sender.send(event)));
        let lost = [receiver.lost(), receiver.lost()];
        sending.join().unwrap();
        assert_eq!(receiver.lost(), 2);
        lost
    });
}

#[test]
fn what_is_peeked_at_stays_and_is_received_next() {
    every_order([None, Some(0)], || {
        let (mut sender, mut receiver): (Sender<'_, u32, 1>, _) = forever(Ring::new()).split();
        let sending = thread::spawn(move || (0..3).for_each(|event| sender.send(event)));
        let seen = receiver.peek().copied();
        if seen.is_some() {
            assert_eq!(receiver.peek().copied(), seen);
            assert_eq!(receiver.receive(), seen);
        }
        sending.join().unwrap();
        seen
    });
}

#[test]
fn who_asks_for_room_loses_nothing() {
    every_order(2..=4, || {
        let (mut sender, mut receiver): (Sender<'_, u32, 2>, _) = forever(Ring::new()).split();
        let receiving = thread::spawn(move || {
            let received = [(); 2].map(|()| receiver.receive().is_some() as u32);
            (receiver, received.iter().sum::<u32>())
        });
        let mut sent = 0;
        for _ in 0..2 {
            for _ in 0..sender.room() {
                sender.send(sent);
                sent += 1;
            }
        }
        let (mut receiver, mut received) = receiving.join().unwrap();
        while receiver.receive().is_some() {
            received += 1;
        }
        assert!(sender.is_empty() && sender.room() == 2);
        assert_eq!((received, receiver.lost()), (sent, 0));
        sent
    });
}

/// Writes a message, then stores; who loads what was stored reads the message.
fn carries_a_message<A: Send + Sync + 'static>(new: fn() -> A, store: fn(&A), load: fn(&A) -> bool) {
    every_order([false, true], move || {
        let (atomic, message) = (Arc::new(new()), Message::new());
        let (stored, written) = (atomic.clone(), message.clone());
        let storing = thread::spawn(move || {
            written.write(7);
            store(&stored);
        });
        let early = load(&atomic);
        if early {
            assert_eq!(message.read(), 7);
        }
        storing.join().unwrap();
        early
    });
}

#[test]
fn what_was_written_before_an_atomic_was_stored_is_seen_by_who_loads_it() {
    carries_a_message(Flag::new, Flag::set, Flag::is_set);
    carries_a_message(Flag::new, Flag::set, Flag::take);
    carries_a_message(Counter::new, Counter::increment, |counter| counter.read() == 1);
    carries_a_message(Word::default, |word| word.store(1), |word| word.load() == 1);
    carries_a_message(Word::default, |word| assert_eq!(word.swap(1), 0), |word| word.load() == 1);
    carries_a_message(Word::default, |word| word.store(1), |word| word.swap(2) == 1);
}

#[test]
fn what_one_has_set_another_takes_once() {
    every_order([false, true], || {
        let flag = Arc::new(Flag::new());
        let set = flag.clone();
        let setting = thread::spawn(move || set.set());
        let early = flag.take();
        setting.join().unwrap();
        assert_eq!(flag.take(), !early);
        assert!(!flag.is_set());
        early
    });
}

// That the last of several events is never missed is shown in preempted.rs: loom 0.7 lets a load that follows the last set
// still see what an earlier `take` left, though that `take` read an earlier set, which C11 puts before the last one
// (tokio-rs/loom issue 282).

#[test]
fn two_may_set_a_flag() {
    every_order([false, true], || {
        let flag = Arc::new(Flag::new());
        let setting = [(); 2].map(|()| {
            let flag = flag.clone();
            thread::spawn(move || flag.set())
        });
        let early = flag.take();
        for thread in setting {
            thread.join().unwrap();
        }
        assert!(flag.take() || early);
        assert!(!flag.take());
        early
    });
}

#[test]
fn a_counter_of_one_writer_counts_all_and_never_back() {
    let never_back = (0..=3).flat_map(|early| (early..=3).map(move |later| (early, later)));
    every_order(never_back, || {
        let counter = Arc::new(Counter::new());
        let counts = counter.clone();
        let counting = thread::spawn(move || (0..3).for_each(|_| counts.increment()));
        let early = counter.read();
        let later = counter.read();
        counting.join().unwrap();
        assert_eq!(counter.read(), 3);
        (early, later)
    });
}

#[test]
fn what_passes_by_swaps_passes_once() {
    let all = [[0, 0], [1, 0], [0, 1], [2, 0], [0, 2], [1, 2]];
    every_order(all, || {
        let word = Arc::new(Word::new(0));
        let put = word.clone();
        let putting = thread::spawn(move || put.swap(1) + put.swap(2));
        let taken = [word.swap(0), word.swap(0)];
        let overwritten = putting.join().unwrap();
        assert_eq!(taken[0] + taken[1] + overwritten + word.load(), 3);
        taken
    });
}

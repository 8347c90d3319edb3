//! Every order of the steps of two threads, as far as the memory model of C11 allows (loom).
//!
//! `RUSTFLAGS="--cfg loom" cargo test -p edm-crossing --release --test model`
//!
//! loom watches every access to the values: one that is not ordered after the other side's ends the model, so a torn value
//! does not have to be looked for. What is asserted here comes on top of that.

#![cfg(loom)]

use edm_crossing::{Counter, Flag, Latest, Receiver, Ring, Sender, Word};
use loom::cell::UnsafeCell;
use loom::sync::Arc;
use loom::thread;

/// For the rest of the program, as a static on the chip.
fn forever<T>(value: T) -> &'static mut T {
    Box::leak(Box::new(value))
}

/// Both halves of a value say the same, unless it is torn.
type Pair = (u32, u32);

#[test]
fn a_reader_sees_whole_values_and_never_an_older_one() {
    loom::model(|| {
        let (mut writer, mut reader) = forever(Latest::<Pair>::new()).split((0, 0));
        let writing = thread::spawn(move || {
            for value in 1..=5 {
                let generation = writer.write(|pair| {
                    assert_eq!(pair.0, pair.1);
                    *pair = (value, value);
                });
                assert_eq!(generation, value);
            }
        });
        let mut seen = 0;
        for _ in 0..4 {
            let changed = reader.refresh();
            assert_eq!(*reader.get(), (reader.generation(), reader.generation()));
            assert_eq!(changed, reader.generation() > seen);
            assert!(reader.generation() >= seen);
            seen = reader.generation();
        }
        writing.join().unwrap();
        reader.refresh();
        assert_eq!(*reader.get(), (5, 5), "the last write is seen");
        assert!(!reader.is_fresh() && !reader.refresh());
    });
}

#[test]
fn a_value_stays_put_while_newer_ones_are_written() {
    loom::model(|| {
        let (mut writer, mut reader) = forever(Latest::<Pair>::new()).split((0, 0));
        let writing = thread::spawn(move || {
            for value in 1..=4 {
                writer.write(|pair| *pair = (value, value));
            }
        });
        reader.refresh();
        let before = *reader.get();
        thread::yield_now();
        assert_eq!(*reader.get(), before);
        writing.join().unwrap();
        assert_eq!(*reader.get(), before);
    });
}

#[test]
fn what_is_fresh_is_taken() {
    loom::model(|| {
        let (mut writer, mut reader) = forever(Latest::<Pair>::new()).split((0, 0));
        let writing = thread::spawn(move || {
            for value in 1..=2 {
                writer.write(|pair| *pair = (value, value));
            }
        });
        if reader.is_fresh() {
            assert!(reader.is_fresh());
            assert!(reader.refresh());
        }
        writing.join().unwrap();
    });
}

#[test]
fn a_verdict_is_of_a_generation_that_was_published_and_what_it_stands_for_has_happened() {
    loom::model(|| {
        let in_force = Arc::new(UnsafeCell::new(0));
        let (mut writer, mut reader) = forever(Latest::<u32>::new()).split(0);
        let runs = in_force.clone();
        let reading = thread::spawn(move || {
            for _ in 0..3 {
                if reader.refresh() {
                    // Odd ones are refused.
                    if *reader.get() % 2 == 0 {
                        runs.with_mut(|runs| unsafe { *runs = *reader.get() });
                        reader.accept();
                    } else {
                        reader.refuse();
                    }
                }
            }
        });
        let mut before = writer.verdict();
        assert!(before.generation > 0 || before.accepted);
        for value in 1..=4 {
            writer.write(|slot| *slot = value);
            let verdict = writer.verdict();
            assert!(verdict.generation <= writer.generation());
            assert!(verdict.generation >= before.generation);
            assert_eq!(verdict.accepted, verdict.generation % 2 == 0);
            before = verdict;
        }
        if before.accepted && before.generation == 4 {
            // Not a race: loom would say so.
            assert_eq!(in_force.with(|runs| unsafe { *runs }), 4);
        }
        reading.join().unwrap();
    });
}

/// Sends `sent` numbers through a ring of N while the other thread receives; whatever order, the books are right.
fn books_are_right<const N: usize>(sent: u32, attempts: u32) {
    loom::model(move || {
        // loom counts these, so that one that was overwritten, doubled or forgotten is found.
        let (mut sender, mut receiver): (Sender<'_, Arc<u32>, N>, _) = forever(Ring::new()).split();
        let sending = thread::spawn(move || {
            for event in 0..sent {
                sender.send(Arc::new(event));
            }
        });
        let mut received = vec![];
        let mut lost = 0;
        for _ in 0..attempts {
            take(&mut receiver, &mut received);
            assert!(receiver.lost() >= lost);
            lost = receiver.lost();
        }
        sending.join().unwrap();
        while take(&mut receiver, &mut received) {}
        {
            use std::sync::atomic::*;
            static C: AtomicU32 = AtomicU32::new(0);
            eprintln!("iter {} N {N} got {received:?}", C.fetch_add(1, Ordering::Relaxed));
        }
        assert!(received.is_sorted_by(|a, b| a < b), "{received:?} is not in order");
        assert_eq!(received.len() as u32 + receiver.lost(), sent);
        assert!(received.len() >= N.min(sent as usize), "the first N fit");
    });
}

fn take<const N: usize>(receiver: &mut Receiver<'_, Arc<u32>, N>, received: &mut Vec<u32>) -> bool {
    let Some(seen) = receiver.peek().map(|event| **event) else {
        return false;
    };
    let event = receiver.receive().expect("what was seen is there");
    assert_eq!(*event, seen);
    received.push(seen);
    true
}

#[test]
fn a_ring_of_one_loses_nothing_uncounted() {
    books_are_right::<1>(5, 4);
}

#[test]
fn a_ring_of_two_loses_nothing_uncounted() {
    books_are_right::<2>(7, 4);
}

#[test]
fn a_ring_of_three_loses_nothing_uncounted() {
    books_are_right::<3>(9, 4);
}

#[test]
fn who_asks_for_room_loses_nothing() {
    loom::model(|| {
        let (mut sender, mut receiver): (Sender<'_, u32, 2>, _) = forever(Ring::new()).split();
        let receiving = thread::spawn(move || {
            let mut received = 0;
            for _ in 0..3 {
                received += receiver.receive().is_some() as u32;
            }
            (receiver, received)
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
    });
}

#[test]
fn what_was_written_before_a_flag_was_set_is_seen_by_who_takes_it() {
    loom::model(|| {
        let flag = Arc::new(Flag::new());
        let message = Arc::new(UnsafeCell::new(0));
        let (set, written) = (flag.clone(), message.clone());
        let setting = thread::spawn(move || {
            written.with_mut(|message| unsafe { *message = 7 });
            set.set();
        });
        let early = flag.take();
        if early {
            assert_eq!(message.with(|message| unsafe { *message }), 7);
        }
        setting.join().unwrap();
        assert_eq!(flag.take(), !early, "once");
        assert!(!flag.is_set());
    });
}

// That the last of several events is never missed is shown in preempted.rs: loom 0.7 lets a load that follows the last set
// still see what an earlier `take` left, though that `take` read an earlier set and C11 puts it before the last one.

#[test]
fn two_may_set_a_flag() {
    loom::model(|| {
        let flag = Arc::new(Flag::new());
        let setting: Vec<_> = (0..2)
            .map(|_| {
                let flag = flag.clone();
                thread::spawn(move || flag.set())
            })
            .collect();
        let early = flag.take();
        for thread in setting {
            thread.join().unwrap();
        }
        assert!(flag.take() || early);
        assert!(!flag.take());
    });
}

#[test]
fn a_counter_of_one_writer_counts_all_and_never_back() {
    loom::model(|| {
        let counter = Arc::new(Counter::new());
        let counts = counter.clone();
        let counting = thread::spawn(move || {
            for _ in 0..3 {
                counts.increment();
            }
        });
        let early = counter.read();
        let later = counter.read();
        assert!(early <= later && later <= 3);
        counting.join().unwrap();
        assert_eq!(counter.read(), 3);
    });
}

#[test]
fn what_passes_by_swaps_passes_once() {
    loom::model(|| {
        let word = Arc::new(Word::new(0));
        let put = word.clone();
        let putting = thread::spawn(move || put.swap(1) + put.swap(2));
        let mut taken = word.swap(0) + word.swap(0);
        taken += putting.join().unwrap();
        assert_eq!(taken + word.load(), 3);
    });
}

#[test]
fn what_was_written_before_a_word_was_stored_is_seen_by_who_loads_it() {
    loom::model(|| {
        let word = Arc::new(Word::new(0));
        let message = Arc::new(UnsafeCell::new(0));
        let (stored, written) = (word.clone(), message.clone());
        let storing = thread::spawn(move || {
            written.with_mut(|message| unsafe { *message = 7 });
            stored.store(1);
        });
        if word.load() == 1 {
            assert_eq!(message.with(|message| unsafe { *message }), 7);
        }
        storing.join().unwrap();
    });
}

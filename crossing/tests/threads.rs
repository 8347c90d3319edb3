//! The crossings between real threads, and what does not depend on order.

#![cfg(not(loom))]

use edm_crossing::{Counter, Flag, Latest, Ring, Verdict, Word};
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;
use std::thread;

/// Few enough for an interpreter (Miri).
const ROUNDS: u32 = if cfg!(miri) { 200 } else { 200_000 };

#[test]
fn a_thread_reads_whole_values_and_never_an_older_one() {
    let mut latest = Latest::new();
    let (mut writer, mut reader) = latest.split([0; 16]);
    thread::scope(|scope| {
        scope.spawn(move || {
            for value in 1..=ROUNDS {
                assert_eq!(writer.write(|slot| slot.fill(value)), value);
                assert!(writer.verdict().generation <= value);
            }
        });
        let mut seen = 0;
        while seen < ROUNDS {
            let changed = reader.refresh();
            assert_eq!(*reader.get(), [reader.generation(); 16]);
            assert_eq!(changed, reader.generation() > seen);
            seen = reader.generation();
            reader.accept();
        }
    });
}

#[test]
fn two_threads_keep_the_books_of_a_ring() {
    let mut ring = Ring::<Box<u32>, 7>::new();
    let (mut sender, mut receiver) = ring.split();
    thread::scope(|scope| {
        let sending = scope.spawn(move || (0..ROUNDS).for_each(|event| sender.send(Box::new(event))));
        let (mut received, mut last) = (0, None);
        loop {
            let over = sending.is_finished();
            while let Some(event) = receiver.receive() {
                assert!(Some(*event) > last);
                last = Some(*event);
                received += 1;
            }
            if over {
                break;
            }
            thread::yield_now();
        }
        assert_eq!(received + receiver.lost(), ROUNDS);
    });
}

#[test]
fn the_initial_value_counts_as_accepted_and_a_verdict_is_of_the_value_taken() {
    let mut latest = Latest::new();
    let (mut writer, mut reader) = latest.split('a');
    assert_eq!((*reader.get(), reader.generation(), writer.generation()), ('a', 0, 0));
    assert_eq!(writer.verdict(), Verdict { generation: 0, accepted: true });
    assert!(!writer.is_unread() && !reader.is_fresh() && !reader.refresh());
    writer.write(|slot| *slot = 'b');
    writer.write(|slot| *slot = 'c');
    assert_eq!(writer.generation(), 2);
    reader.refuse();
    assert_eq!(writer.verdict(), Verdict { generation: 0, accepted: false });
    assert!(writer.is_unread() && reader.is_fresh() && reader.refresh() && !reader.refresh() && !writer.is_unread());
    assert_eq!((*reader.get(), reader.generation()), ('c', 2));
    reader.accept();
    assert_eq!(writer.verdict(), Verdict { generation: 2, accepted: true });
}

#[test]
fn a_second_split_begins_anew() {
    let mut latest = Latest::new();
    let (mut writer, mut reader) = latest.split(1);
    writer.write(|slot| *slot = 2);
    reader.refresh();
    reader.refuse();
    writer.write(|slot| *slot = 3);
    let (mut writer, mut reader) = latest.split(4);
    assert_eq!((writer.verdict(), reader.refresh()), (Verdict { generation: 0, accepted: true }, false));
    assert_eq!(writer.write(|slot| assert_eq!(*slot, 4)), 1);
    assert_eq!(*reader.get(), 4);
}

#[test]
fn a_fill_that_panics_publishes_nothing() {
    let mut latest = Latest::new();
    let (mut writer, mut reader) = latest.split(0);
    writer.write(|slot| *slot = 1);
    let broken = catch_unwind(AssertUnwindSafe(|| {
        writer.write(|slot| {
            *slot = 2;
            panic!("half way")
        })
    }));
    assert!(broken.is_err());
    assert!(reader.refresh());
    assert_eq!((*reader.get(), writer.generation()), (1, 1));
    assert_eq!(writer.write(|slot| *slot = 3), 2);
    assert!(reader.refresh());
    assert_eq!(*reader.get(), 3);
}

/// Counts itself.
struct Token(Rc<Cell<i32>>);

impl Token {
    fn new(alive: &Rc<Cell<i32>>) -> Token {
        alive.set(alive.get() + 1);
        Token(alive.clone())
    }
}

impl Clone for Token {
    fn clone(&self) -> Token {
        Token::new(&self.0)
    }
}

impl Drop for Token {
    fn drop(&mut self) {
        self.0.set(self.0.get() - 1);
    }
}

#[test]
fn every_value_of_a_latest_is_dropped_once() {
    let alive = Rc::new(Cell::new(0));
    let mut latest = Latest::new();
    for _ in 0..2 {
        let (mut writer, mut reader) = latest.split(Token::new(&alive));
        for _ in 0..5 {
            writer.write(|slot| *slot = Token::new(&alive));
            reader.refresh();
        }
        assert_eq!(alive.get(), 3);
    }
    drop(latest);
    assert_eq!(alive.get(), 0);
    drop(Latest::<Token>::new());
}

#[test]
fn every_event_of_a_ring_is_dropped_once_received_or_not() {
    for sent in 0..9 {
        for received in 0..=sent {
            let alive = Rc::new(Cell::new(0));
            let mut ring = Ring::<Token, 3>::new();
            let (mut sender, mut receiver) = ring.split();
            // Begin somewhere in the ring.
            for _ in 0..sent {
                sender.send(Token::new(&alive));
                drop(receiver.receive());
            }
            for _ in 0..sent {
                sender.send(Token::new(&alive));
            }
            assert_eq!(alive.get(), sent.min(3));
            for _ in 0..received {
                drop(receiver.receive());
            }
            assert_eq!(alive.get(), (sent.min(3) - received).max(0));
            drop(ring);
            assert_eq!(alive.get(), 0);
        }
    }
}

#[test]
fn all_slots_are_used_and_one_more_event_is_lost() {
    let mut ring = Ring::<u32, 5>::new();
    let (mut sender, mut receiver) = ring.split();
    for turn in 0..20 {
        for fits in (0..5).rev() {
            sender.send(fits);
            assert_eq!(sender.room(), fits as usize);
        }
        assert_eq!(receiver.lost(), turn);
        sender.send(9);
        assert_eq!((sender.room(), receiver.lost()), (0, turn + 1));
        for event in (0..5).rev() {
            assert_eq!(receiver.peek(), Some(&event));
            assert_eq!(receiver.receive(), Some(event));
        }
        assert!(receiver.peek().is_none() && receiver.receive().is_none());
        assert!(sender.is_empty() && receiver.is_empty());
        // Elsewhere next time.
        sender.send(7);
        assert!(!sender.is_empty() && !receiver.is_empty());
        assert_eq!(receiver.receive(), Some(7));
    }
}

#[test]
fn a_second_split_finds_the_events_of_the_first() {
    let mut ring = Ring::<u32, 2>::new();
    let (mut sender, _) = ring.split();
    (1..=3).for_each(|event| sender.send(event));
    let (sender, mut receiver) = ring.split();
    assert_eq!((sender.room(), receiver.lost()), (0, 1));
    assert_eq!([receiver.receive(), receiver.receive(), receiver.receive()], [Some(1), Some(2), None]);
}

#[test]
fn atomics_can_be_static_and_begin_at_nothing() {
    static FLAG: Flag = Flag::new();
    static WORD: Word = Word::new(3);
    static COUNTER: Counter = Counter::new();
    assert!(!FLAG.is_set() && !FLAG.take());
    FLAG.set();
    assert!(FLAG.is_set() && FLAG.take() && !FLAG.take());
    FLAG.store(true);
    FLAG.clear();
    assert!(!FLAG.is_set());
    assert_eq!((WORD.load(), WORD.swap(4)), (3, 3));
    WORD.store(WORD.load() + 1);
    assert_eq!(WORD.load(), 5);
    COUNTER.increment();
    assert_eq!(COUNTER.read(), 1);
}

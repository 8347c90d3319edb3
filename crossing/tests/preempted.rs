//! One task interrupts the other at every point of the crossing, as nested calls: what an interrupt is on one core.
//!
//! The lower task runs a script; at each of its points the upper one comes in or not. Every choice of points is tried.

#![cfg(not(loom))]

use edm_crossing::{Counter, Flag, Latest, Ring, preempt};
use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;

/// The most points of which every choice is tried.
const POINTS: u32 = if cfg!(miri) { 5 } else { 13 };

/// Runs `lower` with `upper` nested at those of its points whose bits are set in `choice`; gives the number of points.
fn interrupted(choice: u32, upper: impl Fn() + 'static, lower: impl FnOnce()) -> u32 {
    let passed = Rc::new(Cell::new(0));
    let inside = Cell::new(false);
    let count = passed.clone();
    let hook = move || {
        // A task does not interrupt itself.
        if inside.get() {
            return;
        }
        let point = count.replace(count.get() + 1);
        if point < POINTS && choice & 1 << point != 0 {
            inside.set(true);
            upper();
            inside.set(false);
        }
    };
    preempt::with(Rc::new(hook), lower);
    passed.get()
}

/// Both sides of a crossing live as long as the hook, and are freed.
struct Owned<T>(*mut T);

impl<T> Owned<T> {
    fn new(value: T) -> (Owned<T>, &'static mut T) {
        let place = Box::into_raw(Box::new(value));
        // SAFETY: freed by the drop of `Owned`, which each test does when the sides are gone.
        (Owned(place), unsafe { &mut *place })
    }
}

impl<T> Drop for Owned<T> {
    fn drop(&mut self) {
        // SAFETY: from `Box::into_raw`, once.
        drop(unsafe { Box::from_raw(self.0) });
    }
}

#[test]
fn a_reader_that_interrupts_the_writer_sees_whole_values_and_never_an_older_one() {
    for choice in 0..1 << POINTS {
        let (_owned, latest) = Owned::new(Latest::new());
        let (mut writer, mut reader) = latest.split([0_u32; 4]);
        let mut seen = 0;
        let reader = Rc::new(RefCell::new(move || {
            let changed = reader.refresh();
            assert_eq!(*reader.get(), [reader.generation(); 4]);
            assert_eq!(changed, reader.generation() > seen);
            seen = reader.generation();
            if seen % 2 == 0 {
                reader.accept()
            } else {
                reader.refuse()
            }
            seen
        }));
        let interrupt = reader.clone();
        let points = interrupted(
            choice,
            move || {
                interrupt.borrow_mut()();
            },
            || {
                for value in 1..=3 {
                    writer.write(|slot| {
                        slot[..2].fill(value);
                        preempt::point();
                        slot[2..].fill(value);
                    });
                }
            },
        );
        assert_eq!(points, 12);
        assert_eq!(reader.borrow_mut()(), 3);
        assert_eq!((writer.verdict().generation, writer.verdict().accepted), (3, false));
    }
}

#[test]
fn a_writer_that_interrupts_the_reader_is_never_refused_and_moves_nothing_under_it() {
    for choice in 0..1 << POINTS {
        let (_owned, latest) = Owned::new(Latest::new());
        let (mut writer, mut reader) = latest.split([0_u32; 4]);
        let writes = Rc::new(Cell::new(0));
        let count = writes.clone();
        let writer = RefCell::new(move || {
            count.set(count.get() + 1);
            assert_eq!(writer.write(|slot| slot.fill(count.get())), count.get());
            assert!(writer.verdict().generation < count.get());
        });
        interrupted(
            choice,
            move || writer.borrow_mut()(),
            || {
                for _ in 0..3 {
                    let before = writes.get();
                    reader.refresh();
                    let value = *reader.get();
                    assert_eq!(value, [reader.generation(); 4]);
                    assert!(value[0] >= before, "what was written before the refresh is seen by it");
                    preempt::point();
                    assert_eq!(*reader.get(), value);
                }
            },
        );
        reader.refresh();
        assert_eq!(*reader.get(), [writes.get(); 4]);
    }
}

#[test]
fn a_receiver_that_interrupts_the_sender_gets_all_in_order_or_counts() {
    for choice in 0..1 << POINTS {
        let (_owned, ring) = Owned::new(Ring::<Box<u32>, 2>::new());
        let (mut sender, mut receiver) = ring.split();
        let mut expected = 0;
        let receiver = Rc::new(RefCell::new(move || {
            while let Some(event) = receiver.receive() {
                assert!(*event >= expected);
                expected = *event + 1;
            }
            (expected, receiver.lost())
        }));
        let interrupt = receiver.clone();
        interrupted(
            choice,
            move || {
                interrupt.borrow_mut()();
            },
            || {
                (0..4).for_each(|event| sender.send(Box::new(event)));
            },
        );
        let (_, lost) = receiver.borrow_mut()();
        assert!(sender.is_empty());
        assert!(lost <= 2, "the first two fit: {lost} lost");
        assert!(choice != 0 || lost == 2);
    }
}

#[test]
fn a_sender_that_interrupts_the_receiver_loses_nothing_uncounted() {
    for choice in 0..1 << POINTS {
        let (_owned, ring) = Owned::new(Ring::<Box<u32>, 2>::new());
        let (mut sender, mut receiver) = ring.split();
        let sent = Rc::new(Cell::new(0));
        let count = sent.clone();
        let sender = RefCell::new(move || {
            let room = sender.room();
            sender.send(Box::new(count.replace(count.get() + 1)));
            assert_eq!(sender.room(), room.saturating_sub(1));
        });
        let mut received = vec![];
        interrupted(
            choice,
            move || sender.borrow_mut()(),
            || {
                for _ in 0..3 {
                    let seen = receiver.peek().map(|event| **event);
                    let event = receiver.receive().map(|event| *event);
                    assert!(seen.is_none() || seen == event);
                    received.extend(event);
                }
            },
        );
        received.extend(std::iter::from_fn(|| receiver.receive()).map(|event| *event));
        assert!(received.is_sorted_by(|a, b| a < b));
        assert_eq!(received.len() as u32 + receiver.lost(), sent.get());
    }
}

#[test]
fn a_flag_that_is_set_while_it_is_taken_is_taken_then_or_later() {
    for choice in 0..1 << POINTS {
        let (flag, events) = (Rc::new(Flag::new()), Rc::new(Counter::new()));
        let (set, happened) = (flag.clone(), events.clone());
        let mut handled = 0;
        let upper = move || {
            happened.increment();
            set.set();
        };
        interrupted(choice, upper, || {
            for _ in 0..2 {
                if flag.take() {
                    handled = events.read();
                }
            }
        });
        if flag.take() {
            handled = events.read();
        }
        assert_eq!(handled, events.read());
    }
}

/// Counts itself.
struct Event<'a> {
    number: u32,
    alive: &'a Cell<i32>,
}

impl Event<'_> {
    fn new(number: u32, alive: &Cell<i32>) -> Event<'_> {
        alive.set(alive.get() + 1);
        Event { number, alive }
    }
}

impl Drop for Event<'_> {
    fn drop(&mut self) {
        self.alive.set(self.alive.get() - 1);
    }
}

#[test]
fn a_hook_that_panics_leaves_the_crossings_whole_and_the_hook_before_it_in_place() {
    /// Panics at one point.
    fn bomb(at: u32) -> Rc<dyn Fn()> {
        let left = Cell::new(at);
        Rc::new(move || {
            if left.replace(left.get().wrapping_sub(1)) == 0 {
                panic!("in a hook");
            }
        })
    }

    let outer = Rc::new(Cell::new(0));
    let count = outer.clone();
    let outer_hook: Rc<dyn Fn()> = Rc::new(move || count.set(count.get() + 1));
    preempt::with(outer_hook, || {
        for at in 0..8 {
            let mut latest = Latest::new();
            let (mut writer, mut reader) = latest.split(Box::new(0));
            let alive = Cell::new(0);
            let mut ring = Ring::<Event<'_>, 2>::new();
            let (mut sender, mut receiver) = ring.split();
            (0..2).for_each(|number| sender.send(Event::new(number, &alive)));
            let attempts: [&mut dyn FnMut(); 4] = [
                &mut || {
                    writer.write(|slot| **slot += 1);
                },
                &mut || {
                    reader.refresh();
                },
                &mut || drop(receiver.receive()),
                &mut || sender.send(Event::new(2, &alive)),
            ];
            for attempt in attempts {
                let caught = catch_unwind(AssertUnwindSafe(|| preempt::with(bomb(at), attempt)));
                assert!(caught.is_ok() || at < 4, "no operation has more than four points");
                let before = outer.get();
                preempt::point();
                assert_eq!(outer.get(), before + 1);
            }
            let generation = writer.write(|slot| **slot = 9);
            assert_eq!(generation, writer.generation());
            assert!(reader.refresh());
            assert_eq!((**reader.get(), reader.generation()), (9, generation));
            let events: Vec<_> = std::iter::from_fn(|| receiver.receive()).map(|event| event.number).collect();
            assert!([&[0, 1][..], &[1], &[0, 1, 2], &[1, 2]].contains(&&events[..]), "{events:?}");
            assert!(
                alive.get() == 0 || alive.get() == 1 && !events.contains(&2),
                "only an event half sent is forgotten"
            );
        }
    });
}

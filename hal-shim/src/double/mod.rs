//! Doubles for tests: one small part for each piece of hardware, and [`Flaky`] to make it fail.
//!
//! Doubles are handles: a clone shares the state of the original, so that a test keeps one while the code under test owns
//! the other. Pins, PWM and buses have no doubles here: embedded-hal-mock has them.

pub mod can;
pub mod flash;
pub mod live;

use crate::clock::Clock;
use crate::encoder::{EdgeCounter, Levels, QuadratureLines, RawCount};
use crate::gap::{GapBlock, GapFrontEnd};
use crate::generator::Generator;
use crate::safety::{DriveCodes, DriveSense, Safety, SafetyInputs};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;

/// A script of readings: each read takes the next one, and the last one stays.
///
/// Reads as whatever its items are: [`Levels`] are encoder lines, [`RawCount`] an edge counter, `Option<GapBlock>` a gap
/// front end, [`SafetyInputs`] the safety inputs, [`DriveCodes`] the drive's converter.
#[derive(Clone, Debug)]
pub struct Script<T>(Rc<RefCell<VecDeque<T>>>);

impl<T: Copy> Script<T> {
    /// A script that reads `first` until something follows.
    pub fn new(first: T) -> Self {
        Script(Rc::new(RefCell::new(VecDeque::from([first]))))
    }

    /// Lets `items` follow.
    pub fn then(&self, items: impl IntoIterator<Item = T>) -> &Self {
        self.0.borrow_mut().extend(items);
        self
    }

    /// Forgets what was to follow and reads `item` from now on.
    pub fn set(&self, item: T) {
        let mut items = self.0.borrow_mut();
        items.clear();
        items.push_back(item);
    }

    fn next(&self) -> T {
        let mut items = self.0.borrow_mut();
        let item = items[0];
        if items.len() > 1 {
            items.pop_front();
        }
        item
    }
}

impl QuadratureLines for Script<Levels> {
    fn levels(&self) -> Levels {
        self.next()
    }
}

impl EdgeCounter for Script<RawCount> {
    fn read(&mut self) -> RawCount {
        self.next()
    }
}

impl GapFrontEnd for Script<Option<GapBlock>> {
    fn block(&mut self, block: &mut Option<GapBlock>) {
        *block = self.next();
    }
}

impl Safety for Script<SafetyInputs> {
    fn read(&mut self) -> SafetyInputs {
        self.next()
    }
}

impl DriveSense for Script<DriveCodes> {
    fn read(&mut self) -> DriveCodes {
        self.next()
    }

    fn stands(&mut self) -> bool {
        false
    }
}

/// Levels of A and B at a count: A leads B by a quarter period when the count rises.
pub fn quadrature(count: i64) -> Levels {
    let quarter = count.rem_euclid(4);
    Levels { a: quarter == 1 || quarter == 2, b: quarter >= 2, index: false }
}

/// A clock of `HZ` ticks per second that a test advances.
#[derive(Clone, Debug, Default)]
pub struct TestClock<const HZ: u32>(Rc<Cell<u32>>);

impl<const HZ: u32> TestClock<HZ> {
    /// A clock that reads `now`.
    pub fn at(now: u32) -> Self {
        TestClock(Rc::new(Cell::new(now)))
    }

    /// Lets `ticks` pass, wrapping.
    pub fn advance(&self, ticks: u32) {
        self.0.set(self.0.get().wrapping_add(ticks));
    }
}

impl<const HZ: u32> Clock for TestClock<HZ> {
    const HZ: u32 = HZ;
    fn now(&self) -> u32 {
        self.0.get()
    }
}

/// A pulse generator that remembers its commands. Starts as released hardware does: inhibited.
#[derive(Clone, Debug, Default)]
pub struct TestGenerator(Rc<Cell<(bool, Option<u32>)>>);

impl TestGenerator {
    /// Pulses are allowed.
    pub fn pulses(&self) -> bool {
        self.0.get().0
    }

    /// The off-time requested last, ns.
    pub fn off_time(&self) -> Option<u32> {
        self.0.get().1
    }
}

impl Generator for TestGenerator {
    fn set_pulses(&mut self, enabled: bool) {
        self.0.set((enabled, self.off_time()));
    }
    fn request_off_time(&mut self, off_ns: Option<u32>) {
        self.0.set((self.pulses(), off_ns));
    }
}

/// Hardware that fails when `fails` says so, asked once a call.
///
/// A gap front end loses the block, an edge counter freezes at its last reading.
pub struct Flaky<T, F, R = ()> {
    inner: T,
    fails: F,
    last: R,
}

impl<T, F: FnMut() -> bool, R: Default> Flaky<T, F, R> {
    /// Wraps `inner`.
    pub fn new(inner: T, fails: F) -> Self {
        Flaky { inner, fails, last: R::default() }
    }
}

impl<T: GapFrontEnd, F: FnMut() -> bool> GapFrontEnd for Flaky<T, F> {
    fn block(&mut self, block: &mut Option<GapBlock>) {
        // Taken from the converter either way: a lost block does not come back.
        self.inner.block(block);
        if (self.fails)() {
            *block = None;
        }
    }
}

impl<T: EdgeCounter, F: FnMut() -> bool> EdgeCounter for Flaky<T, F, RawCount> {
    fn read(&mut self) -> RawCount {
        let reading = self.inner.read();
        if !(self.fails)() {
            self.last = reading;
        }
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gap::BLOCK;

    #[test]
    fn a_script_plays_in_order_and_holds_its_last_item() {
        let codes = |motor_current| DriveCodes { motor_current, bus_voltage: 0 };
        let script = Script::new(codes(1));
        let mut drive = script.clone();
        assert_eq!(drive.read(), codes(1));
        assert_eq!(drive.read(), codes(1));
        script.then([codes(2), codes(3)]);
        assert_eq!([drive.read(), drive.read(), drive.read(), drive.read()].map(|c| c.motor_current), [1, 2, 3, 3]);
        script.then([codes(4)]).set(codes(5));
        assert_eq!(drive.read(), codes(5));
        assert_eq!(drive.read(), codes(5));
    }

    #[test]
    fn one_line_changes_a_count_and_a_leads_b_downward() {
        for count in -9i64..9 {
            let (here, next) = (quadrature(count), quadrature(count + 1));
            assert_eq!((here.a != next.a) as u8 + (here.b != next.b) as u8, 1, "{count}");
        }
        // A rises first.
        assert_eq!((quadrature(1).a, quadrature(1).b), (true, false));
        assert_eq!(quadrature(-4), quadrature(0));
    }

    #[test]
    fn the_clock_wraps_and_is_shared() {
        let clock = TestClock::<1000>::at(u32::MAX);
        let seen = clock.clone();
        clock.advance(2);
        assert_eq!(seen.now(), 1);
        assert_eq!(<TestClock<1000> as Clock>::HZ, 1000);
    }

    #[test]
    fn the_generator_starts_inhibited_and_keeps_both_requests_apart() {
        let seen = TestGenerator::default();
        let mut generator = seen.clone();
        assert!(!seen.pulses());
        generator.request_off_time(Some(40_000));
        generator.set_pulses(true);
        assert_eq!((seen.pulses(), seen.off_time()), (true, Some(40_000)));
        generator.request_off_time(None);
        assert_eq!((seen.pulses(), seen.off_time()), (true, None));
    }

    #[test]
    fn a_flaky_front_end_loses_the_block_for_good() {
        let block = |code| Some(GapBlock { codes: [code; BLOCK], gate: GapBlock::ALL, ..GapBlock::EMPTY });
        let script = Script::new(block(1));
        script.then([block(2), block(3), None]);
        let mut call = 0;
        let mut front = Flaky::new(script, move || {
            call += 1;
            call == 2
        });
        let mut next = || {
            let mut block = None;
            front.block(&mut block);
            block
        };
        assert_eq!([next(), next(), next(), next()], [block(1), None, block(3), None]);
    }

    #[test]
    fn a_flaky_counter_freezes() {
        let script = Script::new(RawCount { count: 1, last_edge: 1, toward_work: true, now: 1 });
        script.then([RawCount { count: 2, last_edge: 2, toward_work: true, now: 2 }]);
        let fails = Rc::new(Cell::new(false));
        let says = fails.clone();
        let mut counter = Flaky::new(script, move || says.get());
        assert_eq!(counter.read().count, 1);
        fails.set(true);
        assert_eq!(counter.read().count, 1);
        fails.set(false);
        assert_eq!(counter.read().count, 2);
    }
}

//! Pauses: additional off-time after a pulse, by what the pulse was.
//!
//! When the generator's gate closes, [`Watch::end`] takes the pulse for one of four [`Class`]es by what is known at that moment. The line
//! that allows pulses is then held back for the time of that class, and released by a timer. The gap task classifies the same pulse again
//! some 50 us later, with all its conversions; only that class is counted.
//!
//! The line has three kinds of masters. Reflex and stop switch it off at any moment. The servo task permits or forbids pulses, once a tick.
//! A pause only ever holds pulses back: its end switches the line on if the servo's newest decision permits pulses, and neither reflex nor
//! stop has acted since that decision's inputs were read ([`release`]). Otherwise the line stays off, and the servo's next decision
//! counts. The rules are written over [`Line`], so that a PC can interrupt them at every access.

use crate::board::{ADC, CORE_HZ, GAP_SAMPLING, TIMER1_HZ};
use crate::edges::{Seen, age};
use crate::gap::GapBlock;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// What a pulse is taken for when its gate closes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// Not ignited.
    Open,
    /// A discharge after a delay, or of a high voltage, or nothing shows what.
    Spark,
    /// A discharge without a delay, of a low voltage.
    Arc,
    /// Current without voltage, or ended by the reflex.
    Short,
}

/// How many classes there are.
pub const CLASSES: usize = 4;
/// Longest hold, core cycles: 1.2 ms.
pub const LONGEST: u32 = CORE_HZ / 1_000_000 * 1200;

/// Division of the clock of the timer that counts a pause, and core cycles of a count.
pub const PRESCALER: u32 = 1;
const COUNT: u32 = CORE_HZ / TIMER1_HZ * (PRESCALER + 1);
const _: () = assert!(LONGEST / COUNT <= 0xFFFF);
/// Core cycles from the end of a pulse until its pause is counted, and from the end of the count to the line (estimated).
const LAG: u32 = 200;

/// What a person set, in the units of the fast path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Core cycles from the end of a pulse of each class to the end of its pause, in the order of [`Class`], up to [`LONGEST`]; 0: no pause.
    pub hold: [u32; CLASSES],
    /// Codes of the gap voltage from which a pulse is no short, no arc, and has not ignited. With swapped leads, the codes up to which.
    pub levels: [u16; 3],
    /// The gap leads are swapped: a voltage makes the code smaller.
    pub reversed: bool,
    /// Core cycles after the opening of the gate in which the gap charges.
    pub blanking: u32,
    /// A feed law may ask for pauses: see [`Pauses::set_least`].
    pub asked: bool,
}

impl Config {
    /// No pause: nothing has to watch the pulses.
    pub const NONE: Config = Config { hold: [0; CLASSES], levels: [0; 3], reversed: false, blanking: 0, asked: false };

    /// Some class has a pause, or may have one.
    pub fn pauses(&self) -> bool {
        self.asked || self.hold != [0; CLASSES]
    }
}

/// The same where the fast path reads it. One slower task sets it, and another one the least pause.
pub struct Pauses {
    /// Reload of the timer for the longer of what is set and the least, so that the fast path calculates nothing.
    reload: [AtomicU32; CLASSES],
    set: [AtomicU32; CLASSES],
    least: AtomicU32,
    /// Times that either was changed.
    changes: AtomicU32,
    levels: [AtomicU32; 3],
    /// Turns a code over where the leads are swapped.
    turns: AtomicU32,
    blanking: AtomicU32,
}

impl Pauses {
    /// No pause.
    pub const fn new() -> Pauses {
        Pauses {
            reload: [const { AtomicU32::new(0) }; CLASSES],
            set: [const { AtomicU32::new(0) }; CLASSES],
            least: AtomicU32::new(0),
            changes: AtomicU32::new(0),
            levels: [const { AtomicU32::new(0) }; 3],
            turns: AtomicU32::new(0),
            blanking: AtomicU32::new(0),
        }
    }

    /// New values, from the next pulse on.
    pub fn set(&self, config: &Config) {
        let turns = if config.reversed { 0xFFF } else { 0 };
        self.turns.store(turns, Relaxed);
        for (level, code) in self.levels.iter().zip(config.levels) {
            level.store(u32::from(code) ^ turns, Relaxed);
        }
        self.blanking.store(config.blanking, Relaxed);
        self.set.iter().zip(config.hold).for_each(|(set, cycles)| set.store(cycles.min(LONGEST), Relaxed));
        self.combine();
    }

    /// Least pause of every class from the next pulse on, core cycles from the end of the pulse; 0: none. Nothing happens where the ends
    /// of pulses are not watched: [`Config::pauses`].
    pub fn set_least(&self, cycles: u32) {
        let cycles = cycles.min(LONGEST);
        if self.least.load(Relaxed) != cycles {
            self.least.store(cycles, Relaxed);
            self.combine();
        }
    }

    /// Whoever is interrupted by the other one combines again: its values were old. That happens once at most between two plans.
    fn combine(&self) {
        self.changes.store(self.changes.load(Relaxed).wrapping_add(1), Relaxed);
        for _ in 0..4 {
            let changes = self.changes.load(Relaxed);
            for (place, cycles) in self.reload.iter().zip(self.holds()) {
                let reload = if cycles == 0 { 0 } else { cycles.saturating_sub(LAG) / COUNT + 1 };
                place.store(reload, Relaxed);
            }
            if self.changes.load(Relaxed) == changes {
                break;
            }
        }
    }

    /// Core cycles from the end of a pulse of each class to the end of its pause; 0: none.
    pub fn holds(&self) -> [u32; CLASSES] {
        let least = self.least.load(Relaxed);
        self.set.each_ref().map(|set| set.load(Relaxed).max(least))
    }

    /// Reload of the timer that counts the pause after a pulse of this class; 0: none.
    #[inline(always)]
    pub fn reload(&self, class: Class) -> u32 {
        self.reload.get(class as usize).map_or(0, |reload| reload.load(Relaxed))
    }
}

impl Default for Pauses {
    fn default() -> Self {
        Pauses::new()
    }
}

/// What the front end shows at the end of a pulse. Times are counts of the edge timer.
pub trait Look {
    /// Place of the newest conversion of the gap voltage.
    fn newest(&self) -> u32;
    /// Code of the conversion before the one at a place.
    fn code_before(&self, place: u32) -> u16;
    /// Whether the gate is open, and whether the gap is above 70 % of the open-circuit voltage.
    fn gate_and_high(&self) -> [bool; 2];
    /// Pulses that the reflex has ended so far, wrapping.
    fn shorts(&self) -> u32;
    /// Edges of the high comparator so far, modulo any number.
    fn highs(&self) -> u32;
    /// When the newest of so many came.
    fn high_at(&self, highs: u32) -> u32;
    /// Edges of the gate so far, modulo any number. The edge that has just come is in its place: the entry of a task takes longer than
    /// that.
    fn gates(&self) -> u32;
    /// When the newest but one of so many came.
    fn opened(&self, gates: u32) -> u32;
    /// Which of these edges are so old that the edge timer may have wrapped since.
    fn seen(&self) -> Seen;
    /// Now.
    fn now(&self) -> u32;
}

/// Cycles from the closing of the gate until the time is read, at most: entry of the task and what it looks at before (estimated); what
/// would delay it further is the reflex, which knows the class, or a stop.
const LATE: u32 = 120;
/// Cycles between an edge of the high comparator and that of the gate within which they are one event: the gap falls with the gate.
const TOGETHER: u32 = 48;
/// Cycles of one converter clock.
const ADC_CYCLE: u32 = CORE_HZ / ADC.hz;
/// Cycles from the end of an aperture until its code is there.
const CONVERTS: u32 = (GAP_SAMPLING.conversion_cycles - GAP_SAMPLING.sample_cycles as u32) * ADC_CYCLE;
/// Cycles since the conversion before the newest began to sample, at most, and of doubt. The newest may have sampled after the gate closed,
/// where the task entered later than [`CONVERTS`].
const AGE: u32 = GapBlock::APERTURE + CONVERTS + 2 * GapBlock::SPACING + 6 * ADC_CYCLE;

/// What the fast path remembers of the pulse before.
#[derive(Clone, Copy, Debug, Default)]
pub struct Watch {
    shorts: u32,
    highs: u32,
}

impl Watch {
    /// Nothing seen yet.
    pub const fn new() -> Watch {
        Watch { shorts: 0, highs: 0 }
    }

    /// The gate has closed: what the pulse is taken for. `None` when it is open again: nothing may be held back then.
    #[inline(always)]
    pub fn end(&mut self, pauses: &Pauses, look: &impl Look) -> Option<Class> {
        let place = look.newest();
        let [open, high] = look.gate_and_high();
        let (shorts, highs) = (look.shorts(), look.highs());
        let (killed, crossed) = (shorts != self.shorts, highs != self.highs);
        (self.shorts, self.highs) = (shorts, highs);
        if open {
            return None;
        }
        if killed {
            return Some(Class::Short);
        }
        if high && crossed {
            return Some(Class::Open);
        }
        let (now, gates) = (look.now(), look.gates());
        // Both ages are right where the edge is not old.
        let on = age(now, look.opened(gates));
        if crossed {
            let seen = look.seen();
            // It had a delay where the edge came after the opening. Of two of which one is old that one came first.
            let delayed = if seen.high(highs) {
                seen.opened(gates) && seen.delayed()
            } else {
                let fell = age(now, look.high_at(highs));
                if fell < LATE + TOGETHER {
                    return Some(Class::Open);
                }
                fell <= on || seen.opened(gates)
            };
            if delayed {
                return Some(Class::Spark);
            }
        }
        if on < AGE + LATE + pauses.blanking.load(Relaxed) && !look.seen().opened(gates) {
            return Some(if high { Class::Open } else { Class::Spark });
        }
        // Without an edge a comparator that is high shows nothing, as where it is stuck.
        let code = u32::from(look.code_before(place)) ^ pauses.turns.load(Relaxed);
        let [short, arc, open] = pauses.levels.each_ref().map(|level| level.load(Relaxed));
        Some(if code < short {
            Class::Short
        } else if code < arc {
            Class::Arc
        } else if code < open {
            Class::Spark
        } else {
            Class::Open
        })
    }
}

/// Words that servo task and fast path share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Word {
    /// The servo's newest decision permits pulses: 1, else 0.
    Permitted,
    /// What had been forced when its inputs were read: the bridge.
    Bridge,
    /// The same: pulses.
    Pulses,
    /// Number of the newest pause: twice the number of those before it, and one more while it lasts, two when it is over.
    Pause,
}

/// The line that allows pulses, and what its masters know of each other. Accesses take effect in the order in which they are made.
pub trait Line {
    /// How often reflex and stop have acted so far: on the bridge, on pulses alone.
    fn forced(&self) -> [u32; 2];
    /// Lets pulses through.
    fn allow(&self);
    /// Inhibits pulses.
    fn inhibit(&self);
    /// Reads a word.
    fn load(&self, word: Word) -> u32;
    /// Writes a word. [`Word::Pause`]: only the fast path, and [`Permission`] when a pause does not end.
    fn store(&self, word: Word, value: u32);
}

/// The servo's side.
#[derive(Clone, Copy, Debug, Default)]
pub struct Permission {
    /// The pause that the tick before has seen, and in how many ticks in a row.
    pause: u32,
    ticks: u32,
}

/// Ticks after which a pause has not ended in its time: [`LONGEST`], and a tick at either end.
pub const PATIENCE: u32 = LONGEST / GapBlock::CYCLES + 2;

impl Permission {
    /// Nothing is permitted.
    pub const fn new() -> Permission {
        Permission { pause: 0, ticks: 0 }
    }

    /// Permits pulses: the line is on unless a pause holds it back. [`decided`] must follow. A pause that has not ended in its time ends
    /// here.
    #[inline(always)]
    pub fn permit(&mut self, line: &impl Line) {
        line.store(Word::Permitted, 1);
        let pause = line.load(Word::Pause);
        if pause & 1 == 1 {
            self.waits(line, pause);
        } else {
            line.allow();
        }
        if line.load(Word::Pause) != pause {
            // It has begun, or ended, in between.
            follow(line);
        }
    }

    /// Forbids pulses.
    #[inline(always)]
    pub fn forbid(&mut self, line: &impl Line) {
        line.store(Word::Permitted, 0);
        line.inhibit();
    }

    #[cold]
    fn waits(&mut self, line: &impl Line, pause: u32) {
        self.ticks = if pause == self.pause { self.ticks + 1 } else { 0 };
        self.pause = pause;
        if self.ticks >= PATIENCE {
            line.store(Word::Pause, pause.wrapping_add(1));
        }
    }
}

/// Lets the line be as the pause says, over what was written before it began or ended. Twice at the most: then it stays off until the next
/// tick.
#[cold]
fn follow(line: &impl Line) {
    for _ in 0..2 {
        let pause = line.load(Word::Pause);
        if pause & 1 == 1 {
            line.inhibit();
        } else {
            line.allow();
        }
        if line.load(Word::Pause) == pause {
            return;
        }
    }
    line.inhibit();
}

/// The servo has written its outputs, decided by inputs that were read when this had been forced. Whoever ends a pause from now on trusts the
/// decision as long as nothing more is forced.
#[inline(always)]
pub fn decided(line: &impl Line, [bridge, pulses]: [u32; 2]) {
    line.store(Word::Bridge, bridge);
    line.store(Word::Pulses, pulses);
}

/// Begins a pause and inhibits pulses. True where a pause was under way, which this one replaces. Only for the fast path.
#[inline(always)]
pub fn hold(line: &impl Line) -> bool {
    line.inhibit();
    let pause = line.load(Word::Pause);
    line.store(Word::Pause, pause.wrapping_add(1) | 1);
    pause & 1 == 1
}

/// Pauses that have begun so far, modulo 2^31.
pub fn begun(line: &impl Line) -> u32 {
    let pause = line.load(Word::Pause);
    pause / 2 + (pause & 1)
}

/// The pause is over. Only for the fast path.
#[inline(always)]
pub fn release(line: &impl Line) {
    let pause = line.load(Word::Pause);
    line.store(Word::Pause, pause.wrapping_add(pause & 1));
    let decided = [line.load(Word::Bridge), line.load(Word::Pulses)];
    if line.load(Word::Permitted) == 1 && line.forced() == decided {
        line.allow();
        if line.forced() != decided {
            // Reflex or stop came in between.
            line.inhibit();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::EDGE_MODULUS;
    use crate::reflex::EDGE_COUNT;
    use std::cell::{Cell, RefCell};

    /// Codes of 20, 34 and 70 V at 0.1 V above code 410; charging takes 1 us.
    const LEVELS: Config =
        Config { hold: [100, 200, 300, 400], levels: [610, 750, 1110], reversed: false, blanking: 168, asked: false };

    /// A pulse as the wires show it, when the time is read.
    #[derive(Clone, Copy, Debug)]
    struct Shown {
        killed: bool,
        open: bool,
        high: bool,
        /// When the newest edge of the high comparator since the pulse before came, cycles ago.
        fell: Option<u32>,
        opened: u32,
        /// Code of the conversion before the newest.
        code: u16,
    }

    const BURNED: Shown = Shown { killed: false, open: false, high: false, fell: None, opened: 8000, code: 810 };
    /// The stamps wrap in the pulse.
    const NOW: u32 = 700;

    fn ago(cycles: u32) -> u32 {
        (NOW + EDGE_MODULUS - cycles) % EDGE_MODULUS
    }

    impl Look for Shown {
        fn newest(&self) -> u32 {
            7
        }
        fn code_before(&self, place: u32) -> u16 {
            assert_eq!(place, 7);
            self.code
        }
        fn gate_and_high(&self) -> [bool; 2] {
            [self.open, self.high]
        }
        fn shorts(&self) -> u32 {
            self.killed.into()
        }
        fn highs(&self) -> u32 {
            2 * u32::from(self.fell.is_some())
        }
        fn high_at(&self, highs: u32) -> u32 {
            assert_eq!(highs, 2);
            ago(self.fell.unwrap())
        }
        fn gates(&self) -> u32 {
            2
        }
        fn opened(&self, gates: u32) -> u32 {
            assert_eq!(gates, 2);
            ago(self.opened)
        }
        fn seen(&self) -> Seen {
            Seen::default()
        }
        fn now(&self) -> u32 {
            NOW
        }
    }

    fn class(shown: Shown) -> Option<Class> {
        let pauses = Pauses::new();
        pauses.set(&LEVELS);
        let class = Watch::new().end(&pauses, &shown);
        // Swapped leads change nothing.
        pauses.set(&Config { levels: LEVELS.levels.map(|code| 4095 - code), reversed: true, ..LEVELS });
        let swapped = Shown { code: 4095 - shown.code, ..shown };
        assert_eq!(Watch::new().end(&pauses, &swapped), class, "{shown:?}");
        class
    }

    #[test]
    fn the_least_pause_is_that_of_every_class_whose_own_is_shorter_and_goes_again() {
        let pauses = Pauses::new();
        pauses.set(&LEVELS);
        pauses.set_least(250);
        assert_eq!(pauses.holds(), [250, 250, 300, 400]);
        pauses.set(&Config { hold: [0, 0, 0, 500], ..LEVELS });
        assert_eq!(pauses.holds(), [250, 250, 250, 500]);
        pauses.set_least(u32::MAX);
        assert_eq!(pauses.holds(), [LONGEST; 4]);
        pauses.set_least(0);
        assert_eq!(pauses.holds(), [0, 0, 0, 500]);
        assert!(Config { asked: true, ..Config::NONE }.pauses());
    }

    #[test]
    fn a_pulse_is_told_by_comparator_conversion_and_reflex() {
        use Class::{Arc, Open, Short, Spark};
        let code = |code| Shown { code, ..BURNED };
        let enough = AGE + LATE + 168;
        for (shown, expected) in [
            // Burned from the beginning: the voltage tells.
            (code(810), Spark),
            (code(750), Spark),
            (code(749), Arc),
            (code(610), Arc),
            (code(609), Short),
            (code(410), Short),
            // No comparator, and not ignited.
            (code(1109), Spark),
            (code(1110), Open),
            // The reflex knows better, whatever is seen.
            (Shown { killed: true, high: true, ..code(1410) }, Short),
            // High to the end, or fallen with the gate, before or after it.
            (Shown { high: true, fell: Some(7000), ..code(410) }, Open),
            (Shown { fell: Some(0), ..code(1410) }, Open),
            (Shown { fell: Some(LATE + TOGETHER - 1), ..code(410) }, Open),
            // High in every pulse, without an edge: a comparator that is stuck, or a gap that has kept its voltage.
            (Shown { high: true, ..code(680) }, Arc),
            (Shown { high: true, ..code(410) }, Short),
            (Shown { high: true, ..code(1410) }, Open),
            (Shown { high: true, opened: enough - 1, ..code(410) }, Open),
            // Ignited after a delay.
            (Shown { fell: Some(LATE + TOGETHER), ..code(1410) }, Spark),
            (Shown { fell: Some(8000), ..code(410) }, Spark),
            // An edge before the gate opened is one of the pulse before.
            (Shown { fell: Some(8001), ..code(410) }, Short),
            // Long enough to be converted, or not.
            (Shown { opened: enough, ..code(680) }, Arc),
            (Shown { opened: enough - 1, ..code(680) }, Spark),
        ] {
            assert_eq!(class(shown), Some(expected), "{shown:?}");
        }
        assert_eq!(class(Shown { open: true, ..BURNED }), None);
        // A pulse of 100 kHz and 80 % is long enough.
        assert!(enough <= 168 * 8);
    }

    /// Gate and high comparator as timer, DMA and gap task have them; times are cycles without end.
    #[derive(Default)]
    struct Wires {
        gate: Vec<u64>,
        high: Vec<u64>,
        now: u64,
        /// Edges that are in blocks, what the newest block has of them, and what a block ago.
        taken: [usize; 2],
        seen: [Seen; 2],
        blocks: u64,
    }

    impl Wires {
        /// Goes on to a time, block by block. The gap task runs so many cycles after each.
        fn until(&mut self, now: u64, late: u64) {
            while (self.blocks + 1) * u64::from(GapBlock::CYCLES) + late <= now {
                let began = self.blocks * u64::from(GapBlock::CYCLES);
                self.blocks += 1;
                let mut block = GapBlock::EMPTY;
                for ((edges, taken), all) in [&mut block.gate_edges, &mut block.high_edges]
                    .into_iter()
                    .zip(&mut self.taken)
                    .zip([&self.gate, &self.high])
                {
                    let new = all[*taken..].iter().take_while(|at| **at <= began + u64::from(GapBlock::CYCLES));
                    new.for_each(|at| {
                        assert!(edges.push((at - began) as u16));
                        *taken += 1;
                    });
                }
                let [newest, before] = &mut self.seen;
                *before = *newest;
                *newest = newest.block(self.taken.map(|taken| taken as u32 % EDGE_COUNT), &block);
            }
            self.now = now;
        }

        fn stamp(at: u64) -> u32 {
            (at % u64::from(EDGE_MODULUS)) as u32
        }
    }

    impl Look for Wires {
        fn newest(&self) -> u32 {
            0
        }
        /// An arc's.
        fn code_before(&self, _: u32) -> u16 {
            680
        }
        fn gate_and_high(&self) -> [bool; 2] {
            [self.gate.len() % 2 == 1, self.high.len() % 2 == 1]
        }
        fn shorts(&self) -> u32 {
            0
        }
        fn highs(&self) -> u32 {
            self.high.len() as u32 % EDGE_COUNT
        }
        fn high_at(&self, highs: u32) -> u32 {
            assert_eq!(highs, self.highs());
            Wires::stamp(*self.high.last().unwrap())
        }
        fn gates(&self) -> u32 {
            self.gate.len() as u32 % EDGE_COUNT
        }
        fn opened(&self, gates: u32) -> u32 {
            assert_eq!(gates, self.gates());
            Wires::stamp(self.gate[self.gate.len() - 2])
        }
        fn seen(&self) -> Seen {
            self.seen[1]
        }
        fn now(&self) -> u32 {
            Wires::stamp(self.now)
        }
    }

    #[test]
    fn a_pulse_of_any_length_is_told_by_its_edges_also_where_their_stamps_have_wrapped() {
        // Xorshift64 (Marsaglia 2003).
        let mut state = 1u64;
        let mut random = move |from: u64, to: u64| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            from + state % (to - from)
        };
        let pauses = Pauses::new();
        pauses.set(&LEVELS);
        let (mut wires, mut watch) = (Wires::default(), Watch::new());
        let (mut at, mut wrong) = (100_000, Vec::new());
        for n in 0..200_000 {
            // 10 us to 2 ms, burning from the beginning, after a delay, or not at all.
            let on = 1680 * 200f64.powf(random(0, 1000) as f64 / 1000.0) as u64;
            let kind = [Class::Arc, Class::Spark, Class::Open][random(0, 3) as usize];
            wires.until(at, random(0, 6000));
            wires.gate.push(at);
            let closes = at + on;
            if kind != Class::Arc {
                wires.high.push(at + 168);
                // What ignites with the end of the gate is taken for open.
                let ignites = random(at + 300, closes - 200);
                wires.high.push(if kind == Class::Spark { ignites } else { closes - 20 });
            }
            wires.until(closes, random(0, 6000));
            wires.gate.push(closes);
            // The gap of an open pulse keeps its voltage for a while, or falls with the gate.
            let keeps = kind == Class::Open && random(0, 2) == 1;
            if keeps {
                let _ = wires.high.pop();
            }
            wires.until(closes + random(40, LATE.into()), 0);
            let found = watch.end(&pauses, &wires);
            if found != Some(kind) {
                wrong.push((n, kind, found, on));
            }
            let off = random(400, 30_000);
            if keeps {
                wires.high.push(closes + random(150, 390));
            }
            at = closes + off;
        }
        assert!(wrong.is_empty(), "{} of 200000: {:?}", wrong.len(), &wrong[..wrong.len().min(9)]);
    }

    #[test]
    fn edges_and_shorts_are_those_since_the_pulse_before() {
        let pauses = Pauses::new();
        pauses.set(&LEVELS);
        let mut watch = Watch::new();
        let mut class = |shown| watch.end(&pauses, &shown);
        let killed = Shown { killed: true, fell: Some(4000), code: 680, ..BURNED };
        assert_eq!(class(killed), Some(Class::Short));
        // The counts have not gone on: nothing of it belongs to the next pulse, nor to one whose gate was open again.
        assert_eq!(class(killed), Some(Class::Arc));
        assert_eq!(class(Shown { open: true, fell: None, ..killed }), None);
        assert_eq!(class(Shown { fell: None, ..killed }), Some(Class::Arc));
        assert_eq!(class(killed), Some(Class::Spark));
    }

    #[test]
    fn a_hold_is_bounded_and_changes_alone() {
        let pauses = Pauses::new();
        assert_eq!(pauses.reload(Class::Arc), 0);
        assert!(!Config::NONE.pauses() && LEVELS.pauses());
        pauses.set(&Config { hold: [0, 1, u32::MAX, 2000], ..LEVELS });
        let reloads = [Class::Open, Class::Spark, Class::Arc, Class::Short].map(|class| pauses.reload(class));
        // 84 MHz by two; 200 cycles go by beside the count.
        assert_eq!(reloads, [0, 1, (LONGEST - 200) / 4 + 1, 451]);
    }

    /// What may happen to the line while a task of lower priority is at work.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Event {
        Hold,
        Release,
        /// The reflex ends a pulse.
        Kill,
        /// A contact stops the head.
        Stop,
    }

    impl Event {
        const ALL: [Event; 4] = [Event::Hold, Event::Release, Event::Kill, Event::Stop];

        fn priority(self) -> u8 {
            match self {
                Event::Hold | Event::Release => 1,
                Event::Kill | Event::Stop => 2,
            }
        }
    }

    /// The line, with a script of events at numbered accesses.
    struct Scripted {
        script: Vec<(u32, Event)>,
        access: Cell<u32>,
        priority: Cell<u8>,
        done: RefCell<Vec<Event>>,
        on: Cell<bool>,
        forced: Cell<[u32; 2]>,
        words: [Cell<u32>; 4],
        /// Held, and not released.
        paused: Cell<bool>,
        /// Times that it was switched on.
        allowed: Cell<u32>,
    }

    impl Scripted {
        fn new(script: Vec<(u32, Event)>) -> Scripted {
            Scripted {
                script,
                access: Cell::new(0),
                priority: Cell::new(0),
                done: RefCell::default(),
                on: Cell::new(false),
                forced: Cell::new([0; 2]),
                words: Default::default(),
                paused: Cell::new(false),
                allowed: Cell::new(0),
            }
        }

        fn word(&self, word: Word) -> u32 {
            self.words[word as usize].get()
        }

        /// Before each access.
        fn point(&self) {
            let access = self.access.replace(self.access.get() + 1);
            for (at, event) in &self.script {
                if *at == access && event.priority() > self.priority.get() {
                    self.happen(*event);
                }
            }
        }

        fn happen(&self, event: Event) {
            let priority = self.priority.replace(event.priority());
            self.done.borrow_mut().push(event);
            let [bridge, pulses] = self.forced.get();
            match event {
                Event::Hold => {
                    self.paused.set(true);
                    let _ = hold(self);
                }
                Event::Release => {
                    self.paused.set(false);
                    let trusted = self.forced.get() == [Word::Bridge, Word::Pulses].map(|word| self.word(word));
                    let permitted = self.word(Word::Permitted) == 1;
                    let allowed = self.allowed.get();
                    release(self);
                    // Not for a moment against what was there before, and at its end against nothing that came in between.
                    let tried = self.allowed.get() != allowed;
                    assert!(!tried || trusted && permitted, "{:?}", self.script);
                    assert!(!self.on.get() || !tried || self.forced.get() == [bridge, pulses], "{:?}", self.script);
                }
                Event::Kill => {
                    self.on.set(false);
                    self.forced.set([bridge, pulses + 1]);
                }
                Event::Stop => {
                    self.on.set(false);
                    self.forced.set([bridge + 2, pulses]);
                }
            }
            self.priority.set(priority);
        }

        /// A tick of the servo, as the runtime and `lines::settle` have it. What was forced when it began.
        fn tick(&self, permission: &mut Permission, permits: bool) -> [u32; 2] {
            let seen = self.forced();
            if permits {
                permission.permit(self);
            } else {
                permission.forbid(self);
            }
            decided(self, seen);
            if self.forced() != seen {
                self.inhibit();
            }
            seen
        }
    }

    impl Line for Scripted {
        fn forced(&self) -> [u32; 2] {
            self.point();
            self.forced.get()
        }
        fn allow(&self) {
            self.point();
            self.on.set(true);
            self.allowed.set(self.allowed.get() + 1);
        }
        fn inhibit(&self) {
            self.point();
            self.on.set(false);
        }
        fn load(&self, word: Word) -> u32 {
            self.point();
            self.words[word as usize].get()
        }
        fn store(&self, word: Word, value: u32) {
            self.point();
            self.words[word as usize].set(value);
        }
    }

    /// Accesses of three ticks that nothing interrupts, and room for what interrupts them.
    const ACCESSES: u32 = 36;

    /// Three ticks of the servo under a script: permitted, as `second` has it, permitted. After each the line must be as the rules say.
    fn run(script: &[(u32, Event)], second: bool) {
        let line = Scripted::new(script.to_vec());
        let mut permission = Permission::new();
        for permits in [true, second, true] {
            let seen = line.tick(&mut permission, permits);
            let forced = line.forced.get() != seen;
            let what = || format!("{script:?}, {second}: {:?}", line.done.borrow());
            if line.on.get() {
                assert!(!forced, "on against reflex or stop: {}", what());
                assert!(permits, "on against the servo: {}", what());
                assert!(!line.paused.get(), "on in a pause: {}", what());
            }
        }
        // Not held for nothing either: at the latest a tick later.
        line.access.set(u32::MAX / 2);
        let before = line.on.get();
        let seen = line.tick(&mut permission, true);
        assert_eq!(line.on.get(), !line.paused.get(), "{script:?}, {second}, {before}, {seen:?}");
        // What comes between two ticks: a pause ends into a permission, or into none.
        line.happen(Event::Kill);
        line.happen(Event::Hold);
        line.happen(Event::Release);
        assert!(!line.on.get(), "a pause has switched on what the reflex had switched off");
        line.tick(&mut permission, true);
        line.happen(Event::Hold);
        assert!(!line.on.get());
        line.happen(Event::Release);
        assert!(line.on.get(), "the end of a pause lets pulses go on");
    }

    #[test]
    fn no_pause_switches_on_what_anything_else_holds_whatever_interrupts_what() {
        for second in [true, false] {
            for a in 0..ACCESSES {
                for first in Event::ALL {
                    run(&[(a, first)], second);
                    for b in a..ACCESSES {
                        for then in Event::ALL {
                            run(&[(a, first), (b, then)], second);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn three_events_in_a_tick_switch_nothing_on_either() {
        for a in 0..ACCESSES / 3 {
            for b in a..ACCESSES / 2 {
                for c in b..ACCESSES / 2 {
                    for script in 0..64 {
                        let event = |n: usize| Event::ALL[script >> (2 * n) & 3];
                        run(&[(a, event(0)), (b, event(1)), (c, event(2))], true);
                    }
                }
            }
        }
    }

    #[test]
    fn pauses_are_counted_also_where_one_takes_the_place_of_another() {
        let line = Scripted::new(Vec::new());
        let mut permission = Permission::new();
        for (event, count) in [
            (Event::Hold, 1),
            (Event::Release, 1),
            (Event::Hold, 2),
            (Event::Hold, 3),
            (Event::Release, 3),
            (Event::Release, 3),
        ] {
            line.tick(&mut permission, true);
            line.happen(event);
            assert_eq!(begun(&line), count, "{event:?}");
        }
        line.words[Word::Pause as usize].set(u32::MAX - 1);
        line.happen(Event::Hold);
        assert_eq!((begun(&line), line.on.get()), (1 << 31, false));
        line.happen(Event::Release);
        assert_eq!(begun(&line), 0);
    }

    #[test]
    fn a_pause_whose_timer_has_stopped_ends_with_a_servo_tick() {
        let line = Scripted::new(Vec::new());
        let mut permission = Permission::new();
        line.tick(&mut permission, true);
        line.happen(Event::Hold);
        let ticks = (0..1000).take_while(|_| {
            line.tick(&mut permission, true);
            !line.on.get()
        });
        assert_eq!(ticks.count() as u32, PATIENCE);
        // A stop in a pause that does not end: off for as long as the servo has it so.
        line.happen(Event::Hold);
        (0..2 * PATIENCE).for_each(|_| {
            line.tick(&mut permission, false);
            assert!(!line.on.get());
        });
    }
}

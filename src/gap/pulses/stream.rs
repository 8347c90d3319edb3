//! Cuts blocks into pulses, says of each what it was, and counts.
//!
//! A pulse is an open gate: from a rise to the next fall of the gate line, however many blocks that takes, and every one is
//! counted. The comparator for 70 % of the open-circuit voltage shows when the gap was charged and when it ignited:
//!
//! - charged, and high to the end: *open*;
//! - charged, then low: ignited at that moment. The conversions after it classify what burns ([`Evidence`]);
//! - never charged: it burned, or was short, from the beginning.
//!
//! A comparator that has not shown [`UNSHOWN`] pulses whose conversions are as high as the open circuit is not believed: then the
//! conversions alone tell when a pulse ignited, and all that needs the moment (waiting and charging times) stands still.
//!
//! Waiting time begins where the gap is charged: charging time is no ignition delay.

use super::class::{CLASSES, Class};
use super::looks::{Fit, Looks, Seen};
use super::samples::{Boundaries, Evidence};
use edm_hal_shim::gap::{BLOCK, Edges, GapBlock};

/// High pulses without an edge of the high comparator after which it is not believed. As `PulseWatch` counts.
pub const UNSHOWN: u32 = 1000;
/// Cycles between an edge and the middle of the nearest conversion that does not sample it: half an aperture, and doubt.
const CLEAR: i32 = GapBlock::APERTURE as i32 / 2 + 24;
/// Cycles of a block.
const END: i32 = GapBlock::CYCLES as i32;

/// A pulse that is over. Times are core cycles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Pulse {
    /// What it was.
    pub class: Class,
    /// From the opening of the gate to 70 % of the open-circuit voltage; `None`: it never had that.
    pub charged: Option<u32>,
    /// From there to the ignition, or to the end of a pulse that did not ignite.
    pub waited: u32,
    /// It was seen to ignite.
    pub ignited: bool,
    /// It did not ignite, or waited longer than an arc does; or nothing shows whether it did.
    pub waits: bool,
    /// It burned or was short from the beginning, and nothing shows which.
    pub unclear: bool,
}

/// All pulses since the start. Every number wraps: of two readings the difference counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counts {
    /// Pulses of each class, in the order of [`Class`].
    pub classes: [u32; CLASSES],
    /// Pulses that were charged to 70 %, and the sum of their charging times, core cycles.
    pub charged: u32,
    /// See `charged`.
    pub charging: u32,
    /// Of those: the sum of their waiting times, core cycles, and how many have ignited.
    pub waited: u32,
    /// See `waited`.
    pub ignited: u32,
    /// Pulses that did not ignite, or waited longer than an arc does; or of which nothing shows whether they did.
    pub waits: u32,
    /// Pulses that burned or were short from the beginning, and nothing shows which: \[G\] takes these for shorts.
    pub unclear: u32,
}

impl Counts {
    /// What has come since an earlier reading.
    #[inline]
    pub fn since(&self, earlier: &Counts) -> Counts {
        Counts {
            classes: core::array::from_fn(|class| self.numbered(class).wrapping_sub(earlier.numbered(class))),
            charged: self.charged.wrapping_sub(earlier.charged),
            charging: self.charging.wrapping_sub(earlier.charging),
            waited: self.waited.wrapping_sub(earlier.waited),
            ignited: self.ignited.wrapping_sub(earlier.ignited),
            waits: self.waits.wrapping_sub(earlier.waits),
            unclear: self.unclear.wrapping_sub(earlier.unclear),
        }
    }

    /// A copy, word by word: as a whole it is copied by a function of the library, which takes four times as long.
    #[inline(always)]
    pub fn copied(&self) -> Counts {
        let [a, b, c, d, e, f] = self.classes;
        let Counts { charged, charging, waited, ignited, waits, unclear, .. } = *self;
        Counts { classes: [a, b, c, d, e, f], charged, charging, waited, ignited, waits, unclear }
    }

    /// Pulses of a class.
    #[inline]
    pub fn class(&self, class: Class) -> u32 {
        self.numbered(class as usize)
    }

    /// Shorts, and pulses that conduct from the beginning and are too brief to tell: \[G\] takes these for shorts.
    pub fn shorted(&self) -> u32 {
        self.class(Class::Short).wrapping_add(self.unclear)
    }

    /// Discharges that are no arcs, brief ones with an ignition delay among them.
    pub fn discharged(&self) -> u32 {
        let all = self.class(Class::Spark).wrapping_add(self.class(Class::Uncertain));
        all.wrapping_sub(self.unclear)
    }

    fn numbered(&self, class: usize) -> u32 {
        self.classes.get(class).copied().unwrap_or(0)
    }

    /// All pulses.
    pub fn total(&self) -> u32 {
        self.classes.iter().fold(0, |sum, count| sum.wrapping_add(*count))
    }

    #[inline(always)]
    fn add(&mut self, pulse: &Pulse) {
        if let Some(count) = self.classes.get_mut(pulse.class as usize) {
            *count = count.wrapping_add(1);
        }
        self.waits = self.waits.wrapping_add(pulse.waits.into());
        self.unclear = self.unclear.wrapping_add(pulse.unclear.into());
        if let Some(charging) = pulse.charged {
            self.charged = self.charged.wrapping_add(1);
            self.charging = self.charging.wrapping_add(charging);
            self.waited = self.waited.wrapping_add(pulse.waited);
            self.ignited = self.ignited.wrapping_add(pulse.ignited.into());
        }
    }
}

/// The edges of a line that are still to come in a block.
struct Coming<'a>(&'a [u16]);

impl<'a> Coming<'a> {
    #[inline(always)]
    fn of(edges: &'a Edges) -> Self {
        Coming(edges.times())
    }

    /// The next edge before `to`.
    #[inline(always)]
    fn before(&mut self, to: i32) -> Option<i32> {
        let (next, rest) = self.0.split_first()?;
        let at = i32::from(*next);
        (at < to).then(|| {
            self.0 = rest;
            at
        })
    }
}

/// What is known of the pulse whose gate is open. Times are core cycles since the present block began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Now {
    opened: i32,
    charged: Option<i32>,
    ignited: Option<i32>,
    /// From when on conversions count, and until when.
    from: i32,
    to: i32,
    evidence: Evidence,
}

impl Now {
    /// A block later. What does not happen stays as far away.
    #[inline(always)]
    fn shift(&mut self) {
        self.opened = self.opened.saturating_sub(END);
        self.from = self.from.saturating_sub(END);
        self.to = if self.to == i32::MAX { i32::MAX } else { self.to.saturating_sub(END) };
        self.charged = self.charged.map(|at| at.saturating_sub(END));
        self.ignited = self.ignited.map(|at| at.saturating_sub(END));
    }

    /// The gated conversions of a block that count and whose middle lies before a moment.
    #[inline(always)]
    fn codes<'a>(&self, block: &'a GapBlock, to: i32) -> &'a [u16] {
        codes(block, self.from, to.min(self.to))
    }
}

/// The gated conversions of a block whose middle lies between two moments, but for what lies between them.
#[inline(always)]
fn codes(block: &GapBlock, from: i32, to: i32) -> &[u16] {
    let left = block.gate & u32::MAX.wrapping_shl(before(from)) & !u32::MAX.wrapping_shl(before(to));
    if left == 0 {
        return &[];
    }
    let (begin, end) = (left.trailing_zeros(), u32::BITS - left.leading_zeros());
    block.codes.get(begin as usize..end as usize).unwrap_or(&[])
}

/// Pulses out of blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PulseStream {
    boundaries: Boundaries,
    counts: Counts,
    now: Now,
    open: bool,
    high: bool,
    /// High pulses since the newest edge of the high comparator.
    unshown: u32,
    looks: Looks,
    #[cfg(test)]
    stepwise: bool,
}

impl PulseStream {
    /// Nothing seen yet.
    pub fn new(boundaries: Boundaries) -> PulseStream {
        let (counts, now) = (Counts::default(), Now::default());
        PulseStream {
            boundaries,
            counts,
            now,
            open: false,
            high: false,
            unshown: UNSHOWN,
            looks: Looks::NEW,
            #[cfg(test)]
            stepwise: false,
        }
    }

    /// Goes on with other boundaries from the next pulse on; the counts go on too.
    pub fn retune(&mut self, boundaries: Boundaries) {
        self.looks.retune();
        self.boundaries = boundaries;
        self.now.evidence = Evidence::default();
    }

    /// Looks closely at the next pulse that ends, whether the levels fit it.
    #[inline(always)]
    pub fn look(&mut self) {
        self.looks.look();
    }

    /// Shows what each pulse that ends burned at, or shows it no longer: [`PulseStream::take`].
    pub fn collect(&mut self, collects: bool) {
        self.looks.collect(collects);
    }

    /// What burns cannot be told from the open circuit.
    #[inline(always)]
    pub fn is_unclear(&self) -> bool {
        self.looks.are_unclear()
    }

    /// Levels are learned anew.
    #[cold]
    pub fn forget(&mut self) {
        self.looks.retune();
        self.boundaries.learn(None, false);
    }

    /// Something is there to take.
    #[inline(always)]
    pub fn has_news(&self) -> bool {
        self.looks.news()
    }

    /// Whether the levels fit, and of the pulses that ended since, the newest that showed something.
    pub fn take(&mut self) -> (Fit, Option<Seen>) {
        self.looks.take()
    }

    /// Whether the levels fit, share of arcs among pulses that did not wait and its standard error, percent (255: not known): a byte each.
    pub fn levels(&self) -> u32 {
        self.looks.word()
    }

    /// All pulses so far.
    #[inline(always)]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// A block is missing: what its pulses were is not known, and the one that is open is uncertain.
    #[cold]
    pub fn lost(&mut self) {
        self.now = Now::default();
    }

    /// Takes a block; gives each pulse whose gate it shows to have closed to `done`.
    #[inline]
    pub fn block(&mut self, block: &GapBlock, mut done: impl FnMut(&Pulse)) {
        let mut highs = Coming::of(&block.high_edges);
        self.high = block.was_high;
        if self.open != block.gate_was_open {
            self.missed(block.gate_was_open);
        }
        let mut gates = block.gate_edges.times().iter();
        loop {
            let edge = gates.next();
            // What came with the end of the block, or after its last conversion, is in no other block.
            let to = edge.map_or(i32::MAX, |at| i32::from(*at));
            if self.open {
                self.until(block, to, &mut highs);
            } else {
                self.rest(to, &mut highs);
            }
            if edge.is_none() {
                break;
            }
            if self.open {
                let pulse = self.close(to);
                if self.looks.are_due(pulse.class, self.boundaries.overlap()) {
                    let Now { evidence, from, to: end, .. } = self.now;
                    self.look_at(block, from, to.min(end), &evidence, &pulse);
                }
                self.counts.add(&pulse);
                done(&pulse);
            } else {
                if let Some(falls) = gates.as_slice().first()
                    && let Some(pulse) = self.whole(block, to, i32::from(*falls), &mut highs)
                {
                    gates.next();
                    self.counts.add(&pulse);
                    done(&pulse);
                    continue;
                }
                self.begin(to);
            }
            self.open = !self.open;
        }
        if self.open {
            self.now.shift();
        }
    }

    /// A pulse that a block has from its beginning to its end, in one go: what it was, as [`PulseStream::begin`] and what follows find it
    /// step by step. `None` where that is needed: the comparator is not believed, or was high before, or has more edges than a charge
    /// and an ignition.
    #[inline(always)]
    fn whole(&mut self, block: &GapBlock, opened: i32, closed: i32, highs: &mut Coming<'_>) -> Option<Pulse> {
        if self.high || self.unshown >= UNSHOWN || self.stepwise() {
            return None;
        }
        let before = |at: Option<&u16>| at.map(|at| i32::from(*at)).filter(|at| *at < closed);
        let charged = before(highs.0.first());
        let ignited = charged.and_then(|_| before(highs.0.get(1)));
        let blanked = opened.wrapping_add_unsigned(self.boundaries.blanking());
        let mut evidence = Evidence::default();
        let (from, pulse) = match (charged, ignited) {
            (Some(charged), None) => {
                highs.0 = highs.0.get(1..)?;
                (self.high, self.unshown) = (true, 0);
                let waited = closed.wrapping_sub(charged);
                (blanked, ended(opened, charged, waited, false, true, Class::Open))
            }
            (Some(charged), Some(ignited)) => {
                if before(highs.0.get(2)).is_some() {
                    return None;
                }
                highs.0 = highs.0.get(2..)?;
                self.unshown = 0;
                let from = ignited.wrapping_add(CLEAR);
                let waited = ignited.wrapping_sub(charged);
                let waits = self.waits(waited);
                let class = burned(self.burning(block, from, closed, &mut evidence, waits));
                (from, ended(opened, charged, waited, true, waits, class))
            }
            (None, _) => {
                let class = self.burning(block, blanked, closed, &mut evidence, false);
                let waits = evidence.is_high();
                self.unshown = self.unshown.saturating_add(waits.into());
                let unclear = self.unclear(class, &evidence);
                (blanked, Pulse { class, charged: None, waited: 0, ignited: false, waits, unclear })
            }
        };
        if self.looks.are_due(pulse.class, self.boundaries.overlap()) {
            self.look_at(block, from, closed, &evidence, &pulse);
        }
        Some(pulse)
    }

    /// What burned between two moments of a block.
    #[inline(always)]
    fn burning(&self, block: &GapBlock, from: i32, to: i32, evidence: &mut Evidence, waited: bool) -> Class {
        evidence.ignite();
        let codes = codes(block, from, to);
        if !codes.is_empty() {
            evidence.samples(&self.boundaries, codes);
        }
        evidence.class(&self.boundaries, waited)
    }

    /// Whether nothing shows of a pulse that was not charged whether it burned or was short.
    #[inline(always)]
    fn unclear(&self, class: Class, evidence: &Evidence) -> bool {
        class == Class::Uncertain && !evidence.burns(&self.boundaries)
    }

    /// Whether a pulse waits longer than an arc does.
    #[inline(always)]
    fn waits(&self, waited: i32) -> bool {
        waited.max(0).unsigned_abs() > self.boundaries.arc_delay()
    }

    /// Tests compare what is found in one go with what is found step by step.
    #[inline(always)]
    fn stepwise(&self) -> bool {
        #[cfg(test)]
        return self.stepwise;
        #[cfg(not(test))]
        false
    }

    /// Edges of the gate were missed: begins anew.
    #[cold]
    fn missed(&mut self, open: bool) {
        self.open = open;
        self.now = Now::default();
    }

    /// The gate is closed until `to`.
    #[inline(always)]
    fn rest(&mut self, to: i32, highs: &mut Coming<'_>) {
        while highs.before(to).is_some() {
            self.high = !self.high;
            self.unshown = 0;
        }
    }

    #[inline(always)]
    fn begin(&mut self, at: i32) {
        let mut evidence = Evidence::default();
        let shown = self.unshown < UNSHOWN;
        let charged = (shown && self.high).then_some(at);
        if shown && charged.is_none() {
            // Until it is charged: one that never is has burned from the beginning.
            evidence.ignite();
        }
        let from = at.wrapping_add_unsigned(self.boundaries.blanking());
        self.now = Now { opened: at, charged, ignited: None, from, to: i32::MAX, evidence };
    }

    /// The gate stays open until `to`.
    #[inline(always)]
    fn until(&mut self, block: &GapBlock, to: i32, highs: &mut Coming<'_>) {
        while let Some(at) = highs.before(to) {
            self.unshown = 0;
            self.high = !self.high;
            let now = &mut self.now;
            if !self.high {
                if now.ignited.is_none() {
                    // What was converted before belongs to the wait.
                    now.ignited = Some(at);
                    now.evidence.ignite();
                    now.from = at.wrapping_add(CLEAR);
                }
            } else if now.ignited.is_some() {
                // It has gone out, and is charged again.
                now.to = now.to.min(at.wrapping_sub(CLEAR));
            } else {
                now.charged = Some(at);
                now.evidence = Evidence::default();
            }
        }
        // Of a wait that the comparator sees nothing has to be converted.
        if self.now.charged.is_none() || self.now.ignited.is_some() {
            self.samples(block, to);
        }
    }

    /// The gated conversions that count and whose middle lies before a moment.
    #[inline(always)]
    fn samples(&mut self, block: &GapBlock, to: i32) {
        let codes = self.now.codes(block, to);
        if !codes.is_empty() {
            self.now.evidence.samples(&self.boundaries, codes);
        }
    }

    /// Looks closely at a pulse that has closed: its evidence, and the conversions that it is of.
    #[cold]
    #[inline(never)]
    fn look_at(&mut self, block: &GapBlock, from: i32, to: i32, evidence: &Evidence, pulse: &Pulse) {
        let waited = pulse.waits && pulse.ignited;
        self.looks.at(&mut self.boundaries, evidence, codes(block, from, to), pulse.class, waited);
    }

    /// The gate closes.
    #[inline(always)]
    fn close(&mut self, at: i32) -> Pulse {
        let Now { opened, charged, ignited, evidence, .. } = self.now;
        let Some(charged) = charged else {
            let (class, high) = (evidence.class(&self.boundaries, false), evidence.is_high());
            let waits = high || class == Class::Open || self.unshown >= UNSHOWN;
            self.unshown = self.unshown.saturating_add(high.into());
            let unclear = self.unclear(class, &evidence);
            return Pulse { class, charged: None, waited: 0, ignited: false, waits, unclear };
        };
        let waited = ignited.unwrap_or(at).wrapping_sub(charged);
        let waits = ignited.is_none() || self.waits(waited);
        let class = match ignited {
            None => Class::Open,
            Some(_) => burned(evidence.class(&self.boundaries, waits)),
        };
        ended(opened, charged, waited, ignited.is_some(), waits, class)
    }
}

/// What a pulse was that has ignited after it was charged, by what burned: it was no short. Its discharge is over, or what burned cannot be
/// told.
#[inline(always)]
fn burned(class: Class) -> Class {
    match class {
        Class::Spark | Class::Arc => class,
        _ => Class::Uncertain,
    }
}

/// A pulse that was charged, and has closed.
#[inline(always)]
fn ended(opened: i32, charged: i32, waited: i32, ignited: bool, waits: bool, class: Class) -> Pulse {
    let positive = |cycles: i32| cycles.max(0).unsigned_abs();
    Pulse {
        class,
        charged: Some(positive(charged.wrapping_sub(opened))),
        waited: positive(waited),
        ignited,
        waits,
        unclear: false,
    }
}

/// How many conversions of a block have their middle before a moment.
#[inline(always)]
fn before(at: i32) -> u32 {
    /// Middle of the first.
    const MIDDLE: i32 = (GapBlock::SPACING - GapBlock::APERTURE / 2) as i32;
    let since = at.saturating_sub(MIDDLE).max(0).unsigned_abs();
    since.div_ceil(GapBlock::SPACING).min(BLOCK as u32)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::super::samples::Config;
    use super::*;
    use crate::units::{Seconds, Volts};
    use proptest::prelude::*;
    use std::vec::Vec;

    #[test]
    fn an_edge_of_the_comparator_with_the_end_of_a_block_is_not_lost() {
        let block = |high: &[u16], gate: &[u16], open, was_high| {
            let mut block = GapBlock { codes: [810; BLOCK], gate: GapBlock::ALL, ..GapBlock::EMPTY };
            high.iter().for_each(|at| assert!(block.high_edges.push(*at)));
            gate.iter().for_each(|at| assert!(block.gate_edges.push(*at)));
            (block.gate_was_open, block.was_high) = (open, was_high);
            block
        };
        // The end is 8400; a recording has edges until the first conversion of the next block.
        for at in [8399, 8400, 8401, 8675] {
            let mut pulses = PulseStream::new(Config::default().build().unwrap());
            let mut found = Vec::new();
            let blocks = [
                // It shows the comparator, and the next pulse opens.
                block(&[1100, 2000], &[1000, 2000, 4000], false, false),
                // It is charged, and ignites with the end.
                block(&[100, at], &[], true, false),
                block(&[], &[7000], true, false),
                // It opens, and is charged with the end.
                block(&[at], &[8000], false, false),
                block(&[3000], &[7000], true, true),
            ];
            blocks.iter().for_each(|block| pulses.block(block, |pulse| found.push((pulse.class, pulse.ignited))));
            assert_eq!(found[1..], [(Class::Spark, true); 2], "{at}");
        }
    }

    /// What one pulse is made of, core cycles.
    #[derive(Clone, Copy, Debug)]
    struct Made {
        off: u32,
        /// From the gate to 70 %; `None`: it burns from the beginning.
        charges: Option<u32>,
        waits: u32,
        /// Volts after ignition; `None`: it stays open.
        burns: Option<i32>,
        /// From the ignition to the end of the gate.
        lasts: u32,
    }

    impl Made {
        fn on(&self) -> u32 {
            self.charges.unwrap_or(0) + if self.charges.is_some() { self.waits } else { 0 } + self.lasts
        }
    }

    /// Blocks of pulses on end, and of 100 us without one, with comparators or without.
    fn blocks(pulses: &[Made], comparators: bool) -> Vec<GapBlock> {
        blocks_of(100, pulses, comparators)
    }

    /// The same of a generator with this open-circuit voltage.
    fn blocks_of(open: i32, pulses: &[Made], comparators: bool) -> Vec<GapBlock> {
        let (mut gate, mut high, mut steps) = (Vec::new(), Vec::new(), Vec::new());
        let mut at = 0u32;
        steps.push((0, 0));
        for pulse in pulses {
            at += pulse.off;
            gate.push(at);
            let closes = at + pulse.on();
            match pulse.charges {
                Some(charges) => {
                    steps.push((at, open));
                    high.push(at + charges);
                    let ignites = at + charges + pulse.waits;
                    if let Some(volts) = pulse.burns {
                        steps.push((ignites, volts));
                        high.push(ignites);
                    } else {
                        // It falls with the gate.
                        high.push(closes + 20);
                    }
                }
                None => steps.push((at, pulse.burns.unwrap_or(0))),
            }
            at = closes;
            gate.push(at);
            steps.push((at, 0));
        }
        let level = |edges: &[u32], at: u32| edges.partition_point(|edge| *edge < at) % 2 == 1;
        let within = |edges: &[u32], from: u32, to: u32| {
            edges.partition_point(|at| *at < from)..edges.partition_point(|at| *at < to)
        };
        let block = |n: u32| {
            let (begin, end) = (n * 8400, (n + 1) * 8400);
            let volts = |at: u32| steps[..steps.partition_point(|step| step.0 <= at)].last().map_or(0, |step| step.1);
            let mut block =
                GapBlock { gate_was_open: level(&gate, begin), was_high: level(&high, begin), ..GapBlock::EMPTY };
            for i in 0..BLOCK as u32 {
                let (from, to) = (begin + 336 * i + 216 - 24, begin + 336 * (i + 1) + 24);
                block.codes[i as usize] = (410 + 10 * volts(to - 24)) as u16;
                let steady = within(&gate, from + 1, to).is_empty();
                block.gate |= u32::from(steady && level(&gate, to)) << i;
            }
            let inside = |edges: &[u32], into: &mut Edges| {
                edges[within(edges, begin, end)].iter().for_each(|at| assert!(into.push((at - begin) as u16)));
            };
            inside(&gate, &mut block.gate_edges);
            if comparators {
                inside(&high, &mut block.high_edges);
            } else {
                block.was_high = false;
            }
            block
        };
        (0..at / 8400 + 3).map(block).collect()
    }

    fn run(pulses: &[Made], comparators: bool) -> (Vec<Pulse>, Counts) {
        // Here an arc is what burns like one, whatever its delay.
        let config = Config { noise: Volts(1.0), arc_delay: Seconds(1.0), ..Config::default() };
        let mut stream = PulseStream::new(config.build().unwrap());
        // The comparator is believed from its first edge on.
        stream.unshown = 0;
        let mut done = Vec::new();
        blocks(pulses, comparators).iter().for_each(|block| stream.block(block, |pulse| done.push(*pulse)));
        (done, *stream.counts())
    }

    /// 400 open pulses of a generator, then sparks, arcs, open ones and shorts, one in a block at the most.
    fn mixed([open, spark, arc]: [i32; 3], comparators: bool, pulses: u32) -> Vec<GapBlock> {
        let of = |n: u32| match n % 10 {
            _ if n < 400 => Made { off: 1300, burns: None, ..SPARK },
            0 => Made { off: 1300, burns: None, ..SPARK },
            1 => Made { off: 1300, charges: None, burns: Some(1), lasts: 7200, ..SPARK },
            2 | 3 => Made { off: 1300, waits: 0, burns: Some(arc), lasts: 7000, ..SPARK },
            _ => Made { off: 1300, burns: Some(spark), waits: 3000 + 97 * (n % 31), ..SPARK },
        };
        blocks_of(open, &(0..pulses).map(of).collect::<Vec<_>>(), comparators)
    }

    /// What comes of them with a look each millisecond: whether the levels fit, and the counts when that was known.
    fn looked_at(config: &Config, blocks: &[GapBlock]) -> (PulseStream, Vec<(Fit, Counts)>) {
        let mut stream = PulseStream::new(config.build().unwrap());
        let mut taken = Vec::new();
        for (n, block) in blocks.iter().enumerate() {
            if n % 20 == 0 {
                stream.look();
            }
            stream.block(block, |_| {});
            if stream.has_news() {
                let (fit, seen) = stream.take();
                assert_eq!(seen, None);
                taken.push((fit, *stream.counts()));
            }
        }
        (stream, taken)
    }

    /// Generators that the levels do not fit: open circuit, spark, arc.
    const WEAK: [i32; 3] = [80, 25, 18];
    const WEAKER: [i32; 3] = [65, 22, 15];

    #[test]
    fn sparks_and_arcs_of_any_generator_are_learned_and_told() {
        for (generator, fit) in [
            ([100, 40, 28], Fit::Fits),
            ([110, 41, 29], Fit::Fits),
            (WEAK, Fit::DoesNotFit),
            (WEAKER, Fit::DoesNotFit),
            ([100, 25, 18], Fit::DoesNotFit),
            ([100, 18, 12], Fit::DoesNotFit),
            ([100, 45, 42], Fit::Fits),
            ([80, 32, 22], Fit::Divider),
            ([80, 40, 28], Fit::Supply),
        ] {
            let config = Config { noise: Volts(1.0), ..Config::default() };
            let (mut stream, taken) = looked_at(&config, &mixed(generator, true, 8000));
            assert_eq!(taken.last().map(|taken| taken.0), Some(fit), "{generator:?}: {taken:?}");
            let before = *stream.counts();
            mixed(generator, true, 4000).iter().for_each(|block| stream.block(block, |_| {}));
            let since = stream.counts().since(&before);
            let all = [Class::Open, Class::Short, Class::Arc, Class::Spark].map(|class| since.class(class));
            assert_eq!((all, since.class(Class::Uncertain)), ([760, 360, 720, 2160], 0), "{generator:?}");
            assert_eq!(since.waits, 760 + 2160);
        }
    }

    #[test]
    fn without_a_comparator_sparks_and_arcs_are_not_told_where_the_open_circuit_is_another_one() {
        for generator in [WEAK, WEAKER] {
            let config = Config { noise: Volts(1.0), ..Config::default() };
            let (stream, taken) = looked_at(&config, &mixed(generator, false, 4000));
            let [(Fit::DoesNotFit, before)] = taken[..] else { panic!("{generator:?}: {taken:?}") };
            // 16 ms, after those in which the comparator has to show itself.
            assert!(before.total() < 1400, "{generator:?}: {before:?}");
            let since = stream.counts().since(&before);
            assert_eq!([Class::Spark, Class::Arc].map(|class| since.class(class)), [0; 2], "{since:?}");
        }
    }

    #[test]
    fn pulses_in_step_with_looks_are_learned_at_each_phase() {
        // 32 us on, 8 us off: 25 of them are a millisecond, so each look meets a pulse that ends at the same place of a block.
        let open = Made { off: 1344, charges: Some(200), waits: 0, burns: None, lasts: 5176 };
        for phase in (0..6720).step_by(210) {
            let pulses: Vec<Made> =
                (0..2500).map(|n| if n == 0 { Made { off: 1344 + phase, ..open } } else { open }).collect();
            let (stream, taken) = looked_at(&Config::default(), &blocks(&pulses, true));
            assert_eq!(taken.last().map(|taken| taken.0), Some(Fit::Fits), "{phase}: {:?}", stream.looks);
        }
    }

    #[test]
    fn discharges_that_a_comparator_shows_say_nothing_of_the_open_circuit() {
        // One pulse that stays open, and a fifth of a second of arcs behind it.
        let arc = Made { off: 1300, charges: None, burns: Some(28), ..SPARK };
        let open = Made { off: 1300, burns: None, ..SPARK };
        let pulses: Vec<Made> = (0..4000).map(|n| if n < 30 { open } else { arc }).collect();
        let (stream, taken) = looked_at(&Config { noise: Volts(1.0), ..Config::default() }, &blocks(&pulses, true));
        assert!(taken.iter().all(|(fit, _)| matches!(fit, Fit::Unknown | Fit::Fits)), "{taken:?}");
        assert_eq!(stream.counts().class(Class::Arc), 4000 - 30);
    }

    #[test]
    fn arcs_that_burn_like_sparks_are_uncertain_and_what_waits_is_a_spark() {
        let chance = |n: u32| (n.wrapping_mul(2_654_435_761) >> 20) as i32 % 9 - 4;
        let of = |n: u32| match n % 4 {
            0 => Made { off: 1300, burns: None, ..SPARK },
            1 => Made { off: 1300, waits: 0, burns: Some(36 + chance(n)), ..SPARK },
            _ => Made { off: 1300, burns: Some(40 + chance(n)), ..SPARK },
        };
        let blocks = blocks(&(0..8000).map(of).collect::<Vec<_>>(), true);
        let config = Config { noise: Volts(1.0), ..Config::default() };
        let (mut stream, _) = looked_at(&config, &blocks);
        let before = *stream.counts();
        blocks.iter().for_each(|block| stream.block(block, |_| {}));
        let since = stream.counts().since(&before);
        let all = [Class::Open, Class::Arc, Class::Uncertain, Class::Spark].map(|class| since.class(class));
        assert_eq!(all, [2000, 0, 2000, 4000]);
    }

    #[test]
    fn a_generator_changed_while_it_sparks_is_learned_and_again_when_it_is_back() {
        let good = mixed([100, 40, 28], true, 1000);
        let other = mixed(WEAK, true, 60_000);
        let blocks: Vec<GapBlock> =
            good.iter().chain(&other[500..]).chain(good.iter().cycle().take(60_000)).copied().collect();
        let config = Config { noise: Volts(1.0), ..Config::default() };
        let (_, taken) = looked_at(&config, &blocks);
        let fits: Vec<Fit> = taken.iter().map(|(fit, _)| *fit).collect();
        assert!(fits.starts_with(&[Fit::Fits]) && fits.contains(&Fit::DoesNotFit), "{fits:?}");
        assert_eq!(fits.last(), Some(&Fit::Fits), "{fits:?}");
    }

    #[test]
    fn other_levels_are_looked_at_anew_and_collecting_goes_on() {
        let config = Config { noise: Volts(1.0), ..Config::default() };
        let blocks = mixed(WEAK, true, 1000);
        let (mut stream, _) = looked_at(&config, &blocks);
        stream.collect(true);
        let taught =
            Config { open: Volts(80.0), spark: Volts(25.0), arc_below: Volts(21.5), short_below: Volts(9.0), ..config };
        stream.retune(taught.build().unwrap());
        assert_eq!(stream.take(), (Fit::Unknown, None));
        let (mut opens, mut burned) = (0, Vec::new());
        for (n, block) in blocks.iter().enumerate() {
            if n % 20 == 0 {
                stream.look();
            }
            stream.block(block, |_| {});
            match stream.take().1 {
                Some(Seen::Open(code)) => {
                    assert_eq!(code, 800);
                    opens += 1;
                }
                Some(Seen::Burned(code, step)) => {
                    assert!(step.is_none_or(|step| step == 0));
                    burned.push(code);
                }
                None => {}
            }
        }
        assert_eq!(stream.take().0, Fit::Fits);
        let of = |code| burned.iter().filter(|burned| **burned == code).count();
        assert_eq!((of(250), of(180), of(10), burned.len()), (360, 120, 60, 540));
        // One that closes before the second conversion of its block has one at hand that may have been made while it closed, or none.
        assert!((415..=460).contains(&opens), "{opens} of 460");
        stream.collect(false);
        blocks.iter().for_each(|block| stream.block(block, |_| {}));
        assert_eq!(stream.take(), (Fit::Fits, None));
    }

    const SPARK: Made = Made { off: 1000, charges: Some(200), waits: 3000, burns: Some(40), lasts: 4000 };

    #[test]
    fn a_pulse_is_told_by_its_ignition_and_by_what_burns_after_it() {
        for (made, class) in [
            (SPARK, Class::Spark),
            (Made { burns: Some(28), ..SPARK }, Class::Arc),
            (Made { burns: None, ..SPARK }, Class::Open),
            (Made { charges: None, burns: Some(28), ..SPARK }, Class::Arc),
            (Made { charges: None, burns: Some(40), ..SPARK }, Class::Spark),
            (Made { charges: None, burns: Some(2), ..SPARK }, Class::Short),
            // Ignited too late to be told, or over before anything is converted.
            (Made { lasts: 400, ..SPARK }, Class::Uncertain),
            // It had been charged: what is low after it is no short.
            (Made { burns: Some(2), ..SPARK }, Class::Uncertain),
            // As long as a millisecond.
            (Made { waits: 100_000, lasts: 60_000, ..SPARK }, Class::Spark),
            (Made { burns: None, waits: 160_000, ..SPARK }, Class::Open),
        ] {
            for off in [600, 1000, 5000, 8399] {
                let (pulses, counts) = run(&[Made { off, ..made }; 7], true);
                let waited = if made.burns.is_some() { made.waits } else { made.waits + made.lasts };
                let expected = Pulse {
                    class,
                    charged: made.charges,
                    waited: if made.charges.is_some() { waited } else { 0 },
                    ignited: made.charges.is_some() && made.burns.is_some(),
                    waits: made.burns.is_none(),
                    unclear: made.charges.is_none() && class == Class::Uncertain,
                };
                assert_eq!(pulses, [expected; 7], "{made:?}, {off} off");
                assert_eq!((counts.total(), counts.classes[class as usize]), (7, 7));
                assert_eq!(counts.waited, 7 * expected.waited);
            }
        }
    }

    /// Pulses, what was seen of each, and counts.
    type Told = (Vec<Pulse>, Vec<(Fit, Option<Seen>)>, Counts);

    /// The same blocks, step by step and in one go.
    fn both(blocks: &[GapBlock], config: Config) -> [Told; 2] {
        [false, true].map(|stepwise| {
            let mut stream = PulseStream::new(config.build().unwrap());
            (stream.unshown, stream.stepwise) = (0, stepwise);
            let (mut done, mut seen) = (Vec::new(), Vec::new());
            for (n, block) in blocks.iter().enumerate() {
                // With looks, without, and with a teach-in.
                stream.collect(n % 5 == 4);
                if n % 3 != 0 {
                    stream.look();
                }
                stream.block(block, |pulse| done.push(*pulse));
                seen.push(stream.take());
            }
            (done, seen, *stream.counts())
        })
    }

    #[test]
    fn a_comparator_that_shows_nothing_is_not_believed_after_a_thousand_pulses() {
        for (made, class) in [(SPARK, Class::Spark), (Made { burns: None, ..SPARK }, Class::Open)] {
            // Before, nothing is said of a pulse that is high and not shown to be.
            let (pulses, counts) = run(&[Made { waits: 12_000, ..made }; 1200], false);
            assert_eq!(pulses.len(), 1200);
            assert!(pulses[..900].iter().all(|pulse| pulse.class == Class::Uncertain), "{:?}", pulses[0]);
            assert!(pulses[1010..].iter().all(|pulse| pulse.class == class), "{:?}", pulses[1010]);
            assert_eq!((counts.charged, counts.waited), (0, 0));
        }
    }

    #[test]
    fn at_100_khz_every_pulse_is_counted_and_arcs_are_told() {
        // 5 us on, 5 us off: not a whole number of conversions, or all pulses would see the same phase of them.
        let arc = Made { off: 853, charges: None, waits: 0, burns: Some(28), lasts: 840 };
        let (pulses, counts) = run(&[arc; 10_000], true);
        assert_eq!((pulses.len(), counts.total()), (10_000, 10_000));
        let arcs = counts.classes[Class::Arc as usize];
        assert!(arcs > 5000 && arcs + counts.classes[Class::Uncertain as usize] == 10_000, "{arcs}");
        let open = Made { charges: Some(90), waits: 0, burns: None, lasts: 750, ..arc };
        assert_eq!(run(&[open; 1000], true).1.classes[Class::Open as usize], 1000);
    }

    #[test]
    fn a_lost_block_leaves_an_uncertain_pulse_and_no_wrong_one() {
        let blocks = blocks(&[Made { waits: 30_000, ..SPARK }; 3], true);
        let mut stream = PulseStream::new(Config::default().build().unwrap());
        stream.unshown = 0;
        for (n, block) in blocks.iter().enumerate() {
            if n == 2 {
                stream.lost();
            } else {
                stream.block(block, |_| {});
            }
        }
        let counts = stream.counts();
        let [spark, uncertain] = [Class::Spark, Class::Uncertain].map(|class| counts.classes[class as usize]);
        assert!(spark >= 2 && spark + uncertain == counts.total(), "{counts:?}");
    }

    proptest! {
        #[test]
        fn every_pulse_is_counted_once_however_it_falls_on_blocks(
            made in prop::collection::vec((400u32..9000, prop::option::of(60u32..400), 0u32..20_000, 0usize..4, 1500u32..9000), 1..60)
        ) {
            let burns = [None, Some(40), Some(28), Some(2)];
            let made: Vec<Made> = made
                .into_iter()
                .map(|(off, charges, waits, burn, lasts)| Made { off, charges, waits, burns: burns[burn], lasts })
                // What never charges burns.
                .map(|made| if made.charges.is_none() { Made { burns: made.burns.or(Some(2)), ..made } } else { made })
                .collect();
            let (pulses, counts) = run(&made, true);
            prop_assert_eq!(pulses.len(), made.len());
            prop_assert_eq!(counts.total() as usize, made.len());
            for (pulse, made) in pulses.iter().zip(&made) {
                prop_assert_eq!(pulse.charged, made.charges);
                prop_assert_eq!(pulse.ignited, made.charges.is_some() && made.burns.is_some());
                let class = match (made.charges, made.burns) {
                    (Some(_), None) => Class::Open,
                    (Some(_), Some(2)) => Class::Uncertain,
                    (_, Some(40)) => Class::Spark,
                    (_, Some(28)) => Class::Arc,
                    _ => Class::Short,
                };
                prop_assert_eq!(pulse.class, class, "{:?}", made);
            }
        }

        #[test]
        fn a_pulse_within_a_block_is_the_same_in_one_go_and_step_by_step(
            blocks in prop::collection::vec(
                (any::<[u16; BLOCK]>(), any::<u32>(), prop::collection::vec(0u16..8400, 0..12),
                 prop::collection::vec(0u16..8700, 0..16), any::<bool>()),
                1..60
            ),
            scale in 0u16..3
        ) {
            let (mut open, mut made) = (false, Vec::new());
            for (codes, gate, mut gates, mut highs, was_high) in blocks {
                gates.sort_unstable();
                highs.sort_unstable();
                // Codes of all kinds, and such as pulses have.
                let codes = codes.map(|code| if scale == 0 { code } else { 400 + code % (400 * scale) });
                let mut block = GapBlock { codes, gate, gate_was_open: open, was_high, ..GapBlock::EMPTY };
                gates.iter().for_each(|at| { block.gate_edges.push(*at); });
                highs.iter().for_each(|at| { block.high_edges.push(*at); });
                open ^= gates.len() % 2 == 1;
                made.push(block);
            }
            let [one, other] = both(&made, Config::default());
            prop_assert_eq!(one, other);
        }

        #[test]
        fn no_block_makes_it_fail(
            blocks: Vec<([u16; BLOCK], u32, Vec<u16>, Vec<u16>, bool, bool)>, reversed: bool
        ) {
            let mut stream = PulseStream::new(Config { reversed, ..Config::default() }.build().unwrap());
            for (codes, gate, gates, highs, gate_was_open, was_high) in blocks {
                let mut block = GapBlock { codes, gate, gate_was_open, was_high, ..GapBlock::EMPTY };
                gates.iter().for_each(|at| { block.gate_edges.push(*at); });
                highs.iter().for_each(|at| { block.high_edges.push(*at); });
                stream.block(&block, |pulse| assert!(pulse.class != Class::NoPulse));
            }
        }
    }
}

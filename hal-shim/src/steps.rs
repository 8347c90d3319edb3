//! Step and direction: pulses of a host that a timer counts, and what they amount to.
//!
//! No encoder mode counts them: there a pulse of TI1 counts once up and once down, because the direction is that of the edge and of the
//! other level (RM0090 18.3.12, table of counting direction versus encoder signals). Instead the timer counts *both* edges of the step
//! line in external clock mode 1 (18.3.3; SMS = 111) from the edge detector TI1F_ED (TS = 100): two *half steps* a pulse, odd while the
//! line is high. Every edge of the direction line captures that count (18.3.5, both edges), and DMA moves it into a ring. So a count
//! and a direction that belong to each other come from hardware, no pulse interrupts, and a change of direction within a pulse shows: its
//! stamp has the other parity.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Stamps that the ring keeps: changes of direction between two readings, but two.
pub const STAMPS: usize = 64;
const LAP: u32 = STAMPS as u32;
/// Readings in which the level of the direction line may be another than that of the newest stamp: an edge is on its way.
const ON_THE_WAY: u8 = 4;

/// Ring of stamps. Where the counter stands at each edge of the direction line, half steps.
pub type Ring = [AtomicU32; STAMPS];

/// Which edge is a step, and which level goes where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Polarity {
    /// A step begins where the pin rises. The isolated input of the wiring page inverts: it falls where a current begins.
    pub rises: bool,
    /// A high pin is the direction toward the work. On that input a current is a low pin.
    pub reversed: bool,
}

/// What the hardware shows at a moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counted {
    /// Stamps written so far, modulo [`STAMPS`]. Looked at after the rest.
    pub stamps: u32,
    /// Half steps, wrapping; odd while the step line is high.
    pub half: u32,
    /// Level of the direction line.
    pub high: bool,
}

/// What a reading has found beside steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Changes of direction within a step.
    pub within: u32,
    /// Direction changed faster than the ring is read: steps were counted, but perhaps the wrong way.
    pub lost: bool,
}

/// Pulses of a host.
pub trait StepInput {
    /// Hands each run of steps in one direction since the last reading to `run`, oldest first, positive toward the work. Often enough
    /// that direction changes fewer than 62 times and the count by less than 2^31 half steps in between.
    ///
    /// A run may take back a step of the one before, where a change of direction was on its way into the ring, a tenth of a
    /// microsecond: sums are exact.
    fn read(&mut self, polarity: Polarity, run: impl FnMut(i32)) -> Found;
}

/// How far the pulses have been taken.
#[derive(Clone, Copy, Debug)]
pub struct Account {
    taken: u32,
    last: u32,
    high: bool,
    /// Readings that have found another level.
    off: u8,
}

impl Account {
    /// None so far.
    pub fn new(now: Counted, ring: &Ring) -> Account {
        let account = Account { taken: now.stamps, last: now.half, high: now.high, off: 0 };
        account.mark(ring);
        account
    }

    /// What has come since the last reading.
    #[inline]
    pub fn read(&mut self, now: Counted, ring: &Ring, polarity: Polarity, mut run: impl FnMut(i32)) -> Found {
        let mut found = Found::default();
        // Mostly no host sends steps.
        if self.off == 0 && (now.stamps % LAP, now.half, now.high) == (self.taken, self.last, self.high) {
            return found;
        }
        let new = now.stamps.wrapping_sub(self.taken) % LAP;
        if new >= LAP - 1 || !self.is_marked(ring) {
            found.lost = true;
            (self.taken, self.high, self.off) = (now.stamps % LAP, now.high, 0);
        }
        while self.taken != now.stamps % LAP {
            let at = slot(ring, self.taken).map_or(self.last, |stamp| stamp.load(Relaxed));
            if now.half.wrapping_sub(at).cast_signed() < 0 {
                break;
            }
            run(self.go_to(at, polarity));
            found.within += u32::from((at & 1 == 1) == polarity.rises);
            self.high = !self.high;
            self.taken = (self.taken + 1) % LAP;
        }
        run(self.go_to(now.half, polarity));
        self.off = if now.high == self.high { 0 } else { self.off.saturating_add(1) };
        if self.off > ON_THE_WAY {
            found.lost = true;
            (self.high, self.off) = (now.high, 0);
        }
        self.mark(ring);
        found
    }

    /// Steps from the last count to this one, in the present direction.
    fn go_to(&mut self, half: u32, polarity: Polarity) -> i32 {
        // A step counts where it begins.
        let begun = |half: u32| half.wrapping_add(polarity.rises.into()) & !1;
        let steps = begun(half).wrapping_sub(begun(self.last)).cast_signed() >> 1;
        self.last = half;
        if self.high == polarity.reversed { steps } else { steps.wrapping_neg() }
    }

    /// What no stamp can be: the last one written before a lap of the ring is over tells whether one was.
    fn impossible(&self) -> u32 {
        self.last ^ 1 << 31
    }

    fn mark(&self, ring: &Ring) {
        if let Some(before) = slot(ring, self.taken.wrapping_sub(1)) {
            before.store(self.impossible(), Relaxed);
        }
    }

    fn is_marked(&self, ring: &Ring) -> bool {
        slot(ring, self.taken.wrapping_sub(1)).is_some_and(|before| before.load(Relaxed) == self.impossible())
    }
}

fn slot(ring: &Ring, number: u32) -> Option<&AtomicU32> {
    ring.get((number % LAP) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Timer and ring, edge by edge.
    struct Lines {
        counted: Counted,
        ring: Ring,
        account: Account,
        sum: i32,
        within: u32,
        lost: u32,
    }

    impl Lines {
        /// Both lines without current.
        fn idle() -> Lines {
            let counted = Counted { stamps: 0, half: 1, high: true };
            let ring = [const { AtomicU32::new(0) }; STAMPS];
            let account = Account::new(counted, &ring);
            Lines { counted, ring, account, sum: 0, within: 0, lost: 0 }
        }
        fn half(&mut self) {
            self.counted.half = self.counted.half.wrapping_add(1);
        }
        fn steps(&mut self, steps: u32) {
            (0..2 * steps).for_each(|_| self.half());
        }
        fn turn(&mut self) {
            self.ring[self.counted.stamps as usize].store(self.counted.half, Relaxed);
            self.counted.stamps = (self.counted.stamps + 1) % LAP;
            self.counted.high ^= true;
        }
        fn read(&mut self, now: Counted) -> Vec<i32> {
            let mut runs = Vec::new();
            let found = self.account.read(now, &self.ring, Polarity::default(), |run| runs.push(run));
            self.sum += runs.iter().sum::<i32>();
            self.within += found.within;
            self.lost += u32::from(found.lost);
            runs
        }
        fn look(&mut self) -> Vec<i32> {
            self.read(self.counted)
        }
    }

    #[test]
    fn runs_are_those_between_changes_of_direction() {
        let mut lines = Lines::idle();
        lines.steps(3);
        lines.turn();
        lines.steps(5);
        lines.turn();
        lines.turn();
        lines.steps(2);
        // No current is away from the work; two changes at rest are none.
        assert_eq!(lines.look(), [-3, 5, 0, 2]);
        assert_eq!(lines.look(), []);
        assert_eq!((lines.sum, lines.within, lines.lost), (4, 0, 0));
    }

    #[test]
    fn a_step_counts_where_it_begins_and_a_change_within_it_is_seen() {
        let mut lines = Lines::idle();
        lines.half();
        assert_eq!(lines.look(), [-1]);
        lines.turn();
        lines.half();
        assert_eq!(lines.look(), [0, 0]);
        assert_eq!((lines.sum, lines.within), (-1, 1));
        lines.half();
        assert_eq!(lines.look(), [1]);
    }

    #[test]
    fn the_other_edge_and_the_other_level() {
        let ring = [const { AtomicU32::new(0) }; STAMPS];
        let polarity = Polarity { rises: true, reversed: true };
        let mut account = Account::new(Counted { stamps: 0, half: 0, high: true }, &ring);
        let mut sum = 0;
        let mut now = Counted { stamps: 0, half: 1, high: true };
        assert_eq!(account.read(now, &ring, polarity, |run| sum += run), Found::default());
        assert_eq!(sum, 1);
        ring[0].store(1, Relaxed);
        now = Counted { stamps: 1, half: 6, high: false };
        assert_eq!(account.read(now, &ring, polarity, |run| sum += run), Found { within: 1, lost: false });
        assert_eq!(sum, 1 - 2);
    }

    #[test]
    fn sums_are_exact_whenever_stamps_arrive_and_across_every_wrap() {
        let mut lines = Lines::idle();
        let half = (u32::MAX - 100) | 1;
        lines.counted.half = half;
        lines.account = Account::new(lines.counted, &lines.ring);
        let (mut random, mut truth) = (1u32, 0);
        for _ in 0..100_000 {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let steps = random >> 16 & 7;
            let before = lines.counted;
            truth += if lines.counted.high { -(steps as i32) } else { steps as i32 };
            lines.steps(steps);
            if random >> 24 & 3 == 0 {
                lines.turn();
                truth += if lines.counted.high { -1 } else { 1 };
                lines.steps(1);
            }
            match random >> 28 {
                // Stamps and level are looked at before the count, or the level after it.
                0..4 => drop(lines.read(Counted { half: lines.counted.half, ..before })),
                4..8 => drop(lines.read(Counted { stamps: before.stamps, ..lines.counted })),
                8..12 => drop(lines.look()),
                _ => {}
            }
        }
        for _ in 0..2 {
            lines.look();
        }
        assert_eq!((lines.sum, lines.within, lines.lost), (truth, 0, 0));
    }

    #[test]
    fn a_ring_that_was_overrun_is_said_and_the_steps_after_it_count_right() {
        for turns in [LAP - 1, LAP, LAP + 1, 2 * LAP, 5 * LAP + 3] {
            let mut lines = Lines::idle();
            lines.steps(1);
            lines.look();
            for _ in 0..turns {
                lines.steps(1);
                lines.turn();
            }
            lines.look();
            assert_eq!(lines.lost, 1, "{turns}");
            let sum = lines.sum;
            lines.steps(4);
            lines.look();
            let expected = if lines.counted.high { -4 } else { 4 };
            assert_eq!((lines.sum - sum, lines.lost), (expected, 1), "{turns}");
        }
        let mut lines = Lines::idle();
        for _ in 0..LAP - 2 {
            lines.steps(1);
            lines.turn();
        }
        lines.look();
        assert_eq!((lines.sum, lines.lost), (0, 0));
    }

    #[test]
    fn a_direction_without_an_edge_is_lost_after_a_while() {
        let mut lines = Lines::idle();
        lines.counted.high = false;
        for _ in 0..ON_THE_WAY {
            lines.look();
        }
        assert_eq!(lines.lost, 0);
        lines.look();
        lines.steps(1);
        assert_eq!((lines.look(), lines.lost), (vec![1], 1));
    }
}

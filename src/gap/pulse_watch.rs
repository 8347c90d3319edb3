//! Whether the reflex sees the pulses, and whether they keep to their permission.
//!
//! The reflex hears of a pulse by a branch of the gate line of its own, and judges it by a converter of its own. Where
//! either is dead, nothing looks different until a short lasts. So what parts of the hardware count is compared once a
//! millisecond: edges of the gate, conversions that those pulses have started, and shorts that the reflex has found against
//! those that the fixed-rate voltage shows. (The fixed-rate converter sees a short only where the reflex does not end its
//! pulses first, or where they are long.) And what is converted must not stand still: a signal always has noise.
//!
//! The comparators of the gap voltage judge nothing. Pulses of which one shows no edge are counted, for the host.

use edm_hal_shim::reflex::{EDGE_COUNT, PulseCounts};

/// What is known of the pulses beside their counts.
#[derive(Clone, Copy, Debug)]
pub struct PulseSeen {
    /// Pulses are permitted.
    pub permitted: bool,
    /// It matters that there are none otherwise: the head is enabled.
    pub watched: bool,
    /// The fixed-rate voltage has shown nothing but short since the last look.
    pub short: bool,
}

/// What the counts say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PulseFault {
    /// There are pulses that nobody permitted.
    Unpermitted,
    /// The reflex does not see pulses, or shorts.
    Unseen,
}

/// What the counts have come to.
#[derive(Clone, Copy, Debug, Default)]
pub struct PulseWatch {
    last: PulseCounts,
    /// Pulses that were not converted, less those that were.
    unconverted: u32,
    /// Pulses in shorts of which the reflex found none.
    unfound: u32,
    /// There was an edge of the gate since the look before.
    gate_seen: bool,
    /// Looks in a row that have found pulses without permission.
    unpermitted: u32,
    /// Looks in a row at new pulses in which gap current, gap voltage have had the same code.
    same: [u32; 2],
    /// Pulses in a row of which the high, the low comparator has shown no edge, and how many thousand of them there were.
    unshown: [u32; 2],
    unseen: [u32; 2],
}

impl PulseWatch {
    /// Pulses without an answer that are enough: 16 ms at 1 kHz, a look at 16 kHz and more.
    const PULSES: u32 = 16;
    /// Looks at pulses without permission that are enough: the pulse that was on goes on to its end.
    const LOOKS: u32 = 3;
    /// Looks with the same code that are enough. A converter whose noise is a quarter of a code, which is less than the data
    /// sheet of any has, gives the same code twice with 91 %, and so often never.
    const SAME: u32 = 400;
    /// Pulses without an edge of a comparator that are enough.
    const UNSHOWN: u32 = 1000;

    /// Whether there was an edge of the gate between the last two looks.
    pub fn gate_seen(&self) -> bool {
        self.gate_seen
    }

    /// Pulses that the high comparator has not shown, and the low one, thousands, wrapping.
    pub fn unseen(&self) -> [u32; 2] {
        self.unseen
    }

    /// Compares the counts with those of a millisecond ago.
    pub fn look(&mut self, counts: PulseCounts, seen: PulseSeen) -> Option<PulseFault> {
        let since = |now: u8, then: u8| u32::from(now.wrapping_sub(then));
        let edges = since(counts.edges, self.last.edges);
        let conversions = since(counts.conversions, self.last.conversions);
        let shorts = since(counts.shorts, self.last.shorts);
        let last = core::mem::replace(&mut self.last, counts);
        self.gate_seen = edges > 0;
        let pulses = edges / 2;

        for (same, (now, then)) in self.same.iter_mut().zip(counts.newest.iter().zip(&last.newest)) {
            *same = match (now == then && seen.permitted, conversions > 0) {
                (true, true) => same.saturating_add(1),
                (true, false) => *same,
                (false, _) => 0,
            };
        }
        let compared = counts.comparators.iter().zip(&last.comparators);
        for ((unshown, unseen), (now, then)) in self.unshown.iter_mut().zip(&mut self.unseen).zip(compared) {
            *unshown = if now == then && seen.permitted { unshown.saturating_add(pulses) } else { 0 };
            if *unshown > Self::UNSHOWN {
                (*unshown, *unseen) = (0, unseen.wrapping_add(1));
            }
        }

        // Half of them are enough: a blanking may be longer than the period of quick pulses. What comes without permission is
        // no concern of the reflex.
        let more = self.unconverted.saturating_add(pulses).saturating_sub(2 * conversions);
        self.unconverted = if seen.permitted { more } else { 0 };
        self.unfound = match (shorts, seen.short && seen.permitted) {
            (0, true) => self.unfound.saturating_add(pulses),
            (0, false) => self.unfound,
            _ => 0,
        };
        let stray = seen.watched && !seen.permitted && pulses > 0;
        self.unpermitted = if stray { self.unpermitted.saturating_add(1) } else { 0 };

        let stands = self.same.iter().any(|looks| *looks > Self::SAME);
        let unseen = self.unconverted > Self::PULSES || self.unfound > Self::PULSES || stands;
        if self.unpermitted > Self::LOOKS {
            Some(PulseFault::Unpermitted)
        } else if unseen && seen.permitted {
            (self.unconverted, self.unfound, self.same) = (0, 0, [0; 2]);
            Some(PulseFault::Unseen)
        } else {
            None
        }
    }
}

// A look finds more pulses than are enough before the counts wrap.
const _: () = assert!(EDGE_COUNT == 256 && PulseWatch::PULSES < EDGE_COUNT / 4);

#[cfg(test)]
mod tests {
    use super::*;

    const WORK: PulseSeen = PulseSeen { permitted: true, watched: true, short: false };
    const SHORT: PulseSeen = PulseSeen { short: true, ..WORK };

    /// Looks until a fault, with so many edges, conversions and shorts in each; gives the looks that it took, of 1000.
    fn looks(watch: &mut PulseWatch, each: [f32; 3], seen: PulseSeen) -> Option<(u32, PulseFault)> {
        let from = watch.last;
        (1..=1000).find_map(|n| {
            let of = |per: f32, from: u8| from.wrapping_add((per * n as f32) as u32 as u8);
            let [edges, conversions, shorts] = each;
            let counts = PulseCounts {
                edges: of(edges, from.edges),
                conversions: of(conversions, from.conversions),
                shorts: of(shorts, from.shorts),
                comparators: [of(edges, from.edges); 2],
                newest: [n as u16; 2],
            };
            watch.look(counts, seen).map(|fault| (n, fault))
        })
    }

    #[test]
    fn pulses_that_are_converted_are_none_to_worry_about_at_any_rate() {
        for khz in [0.3, 1.0, 4.9, 16.0, 33.3, 100.0, 105.0] {
            for share in [0.5, 1.0] {
                let mut watch = PulseWatch::default();
                assert_eq!(looks(&mut watch, [2.0 * khz, share * khz, 0.0], WORK), None, "{khz} kHz, {share}");
            }
        }
    }

    #[test]
    fn a_converter_that_no_pulse_starts_is_found_after_some_pulses() {
        for (khz, most) in [(1.0, 17), (5.0, 4), (20.0, 1), (100.0, 1)] {
            let mut watch = PulseWatch::default();
            let found = looks(&mut watch, [2.0 * khz, 0.0, 0.0], WORK);
            assert_eq!(found, Some((most, PulseFault::Unseen)), "{khz} kHz");
        }
        // A branch that has a loose contact.
        let mut watch = PulseWatch::default();
        assert!(looks(&mut watch, [10.0, 2.0, 0.0], WORK).is_some());
    }

    #[test]
    fn shorts_that_the_reflex_does_not_find_are_found() {
        let mut watch = PulseWatch::default();
        assert_eq!(looks(&mut watch, [10.0, 5.0, 1.0], SHORT), None);
        assert_eq!(looks(&mut watch, [10.0, 5.0, 0.0], SHORT), Some((4, PulseFault::Unseen)));
        // Few shorts, each with a retreat that clears it: they add up, until the reflex finds one.
        let mut watch = PulseWatch::default();
        let mut edges = 0u8;
        let mut look = |watch: &mut PulseWatch, seen, shorts| {
            edges = edges.wrapping_add(10);
            let newest = [edges.into(); 2];
            watch.look(PulseCounts { edges, conversions: edges / 2, shorts, newest, ..PulseCounts::default() }, seen)
        };
        for _ in 0..3 {
            assert_eq!(look(&mut watch, SHORT, 0), None);
            assert_eq!((0..50).find_map(|_| look(&mut watch, WORK, 0)), None);
        }
        let mut other = watch;
        assert_eq!(look(&mut watch, SHORT, 0), Some(PulseFault::Unseen));
        assert_eq!(look(&mut other, WORK, 1), None);
        assert_eq!(look(&mut other, SHORT, 1), None);
    }

    /// Looks, five pulses in each; gives the look that found a fault, of 10 000, and what the comparators had not shown then.
    fn pulses(newest: impl Fn(u16) -> [u16; 2], comparators: [u8; 2], seen: PulseSeen) -> (Option<u16>, [u32; 2]) {
        let mut watch = PulseWatch::default();
        let found = (1..=10_000).find(|n| {
            let so_many = |each: u8| (*n as u8).wrapping_mul(each);
            let counts = PulseCounts {
                edges: so_many(10),
                conversions: so_many(5),
                shorts: 0,
                comparators: comparators.map(so_many),
                newest: newest(*n),
            };
            watch.look(counts, seen).is_some()
        });
        (found, watch.unseen())
    }

    #[test]
    fn a_line_of_the_converter_that_always_gives_the_same_is_found() {
        let off = PulseSeen { permitted: false, watched: false, ..WORK };
        for stuck in [1, 1234, 4095] {
            for (newest, by) in [([true, false], 402), ([false, true], 402)] {
                let codes = |n: u16| newest.map(|stands| if stands { stuck } else { 2000 + n % 3 });
                assert_eq!(pulses(codes, [10, 5], WORK).0, Some(by), "{newest:?} {stuck}");
                assert_eq!(pulses(codes, [10, 5], off).0, None);
            }
        }
        // Now and then another one.
        assert_eq!(pulses(|n| [2048 + n / 400; 2], [10, 5], WORK).0, None);
    }

    #[test]
    fn a_comparator_that_shows_no_pulse_is_counted_but_no_fault() {
        let codes = |n: u16| [n; 2];
        assert_eq!(pulses(codes, [10, 5], WORK), (None, [0, 0]));
        assert_eq!(pulses(codes, [0, 5], WORK), (None, [49, 0]));
        assert_eq!(pulses(codes, [10, 0], WORK), (None, [0, 49]));
        assert_eq!(pulses(codes, [0, 0], PulseSeen { permitted: false, watched: false, ..WORK }), (None, [0, 0]));
    }

    #[test]
    fn what_was_not_converted_without_permission_is_no_reason_later() {
        let mut watch = PulseWatch::default();
        let off = PulseSeen { permitted: false, watched: false, ..WORK };
        assert_eq!(looks(&mut watch, [10.0, 0.0, 0.0], off), None);
        assert_eq!(looks(&mut watch, [10.0, 5.0, 0.0], WORK), None);
    }

    #[test]
    fn pulses_that_nobody_permitted_are_found_but_not_the_last_one_that_was() {
        let mut watch = PulseWatch::default();
        let off = PulseSeen { permitted: false, ..WORK };
        assert_eq!(looks(&mut watch, [10.0, 5.0, 0.0], off), Some((4, PulseFault::Unpermitted)));
        let mut watch = PulseWatch::default();
        assert_eq!(looks(&mut watch, [1.0, 0.5, 0.0], off), None);
        let disabled = PulseSeen { watched: false, ..off };
        assert_eq!(looks(&mut watch, [200.0, 100.0, 0.0], disabled), None);
    }
}

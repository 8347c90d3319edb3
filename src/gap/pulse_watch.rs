//! Whether the reflex sees the pulses, and whether they keep to their permission.
//!
//! The reflex hears of a pulse by a branch of the gate line of its own, and judges it by a converter of its own. Where
//! either is dead, nothing looks different until a short lasts. So what parts of the hardware count is compared once a
//! millisecond: edges of the gate, conversions that those pulses have started, and shorts that the reflex has found against
//! those that the gap voltage shows. And what is converted must not stand still: a signal always has noise.
//!
//! The reflex wants a current, and not every generator gives one: a capacitor that is drained before the reflex looks has none, in a
//! short as in a spark. So what it sees of pulses that burn is learned: a generator *gives* a current once more looks at such pulses have found
//! one, by [`PulseWatch::GIVES`]. Of one that does not, a short without a current is none for the reflex, and its retreat is
//! that of the gap voltage. With other settings it is another generator, perhaps.
//!
//! Pulses of which a comparator of the gap voltage shows no edge are counted, for the host.

use edm_hal_shim::reflex::{EDGE_COUNT, PulseCounts};

/// Thresholds by which the reflex judges a pulse, converter codes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sight {
    /// Gap current that counts as flowing, and more.
    pub current: u16,
    /// Lowest and highest gap voltage of a pulse that is no short.
    pub voltage: [u16; 2],
    /// Lowest and highest gap voltage of a pulse that has not ignited.
    pub open: [u16; 2],
}

impl Sight {
    fn is_within(code: u16, [lowest, highest]: [u16; 2]) -> bool {
        lowest <= code && code <= highest
    }
}

/// What is known of the pulses beside their counts.
#[derive(Clone, Copy, Debug)]
pub struct PulseSeen {
    /// Pulses are permitted.
    pub permitted: bool,
    /// It matters that there are none otherwise: the head is enabled.
    pub watched: bool,
    /// The gap voltage has shown nothing but short since the last look.
    pub short: bool,
    /// Pulses that the gap voltage has had, wrapping.
    pub pulses: u32,
    /// Thresholds of the reflex.
    pub sight: Sight,
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
    /// Pulses that the gap voltage had.
    known: u32,
    /// Pulses that were not converted, less those that were.
    unconverted: u32,
    /// Pulses in shorts of which the reflex found none.
    unfound: u32,
    /// Looks at pulses that burned with a current, less those without one, and what that was learned by.
    flows: i32,
    gives: bool,
    sight: Sight,
    /// The look before saw a short, and the reflex a voltage.
    apart: bool,
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
    /// Looks at pulses that burn by which more had a current than had none: with an arc in ten pulses of a sinker a tenth of a second.
    const GIVES: i32 = 8;
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
        let known = seen.pulses.wrapping_sub(core::mem::replace(&mut self.known, seen.pulses));
        // A gate that rings has edges beyond count, and no pulses.
        let pulses = (edges / 2).min(known.saturating_add(1));

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
        self.learn(&counts, &seen, conversions > 0 && seen.permitted);
        let short = seen.short && seen.permitted;
        let [current, voltage] = counts.newest;
        let low = !Sight::is_within(voltage, seen.sight.voltage);
        self.unfound = match shorts {
            0 if !short => self.unfound,
            // One that is over: the newest pulse may have come after it.
            0 if !low && !self.apart => self.unfound,
            // It sees the short, and that no current flows.
            0 if low && current < seen.sight.current && !self.gives => 0,
            0 => self.unfound.saturating_add(pulses),
            _ => 0,
        };
        self.apart = short && !low;
        let without_permission = seen.watched && !seen.permitted && edges > 1;
        self.unpermitted = if without_permission { self.unpermitted.saturating_add(1) } else { 0 };

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

    /// Learns of the newest pulse, if there is one, whether this generator gives a current.
    fn learn(&mut self, counts: &PulseCounts, seen: &PulseSeen, new: bool) {
        if self.sight != seen.sight {
            // Another generator, perhaps.
            (self.sight, self.flows, self.gives) = (seen.sight, 0, false);
        }
        let [current, voltage] = counts.newest;
        if new && !Sight::is_within(voltage, self.sight.open) {
            let more = self.flows.saturating_add(if current >= self.sight.current { 1 } else { -1 });
            self.flows = more.clamp(-Self::GIVES, Self::GIVES);
            self.gives |= self.flows >= Self::GIVES;
        }
    }
}

// A look finds more pulses than are enough before the counts wrap.
const _: () = assert!(EDGE_COUNT == 256 && PulseWatch::PULSES < EDGE_COUNT / 4);

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 A; 20 V and 70 V of 0.1 V a code.
    const SIGHT: Sight = Sight { current: 2110, voltage: [610, 4095], open: [1110, 4095] };
    const WORK: PulseSeen = PulseSeen { permitted: true, watched: true, short: false, pulses: 0, sight: SIGHT };
    const SHORT: PulseSeen = PulseSeen { short: true, ..WORK };

    /// Looks until a fault, with so many edges, conversions and shorts in each; gives the looks that it took, of 1000.
    fn looks(watch: &mut PulseWatch, each: [f32; 3], seen: PulseSeen) -> Option<(u32, PulseFault)> {
        let (from, known) = (watch.last, watch.known);
        (1..=1000).find_map(|n| {
            let of = |per: f32, from: u8| from.wrapping_add((per * n as f32) as u32 as u8);
            let [edges, conversions, shorts] = each;
            let counts = PulseCounts {
                edges: of(edges, from.edges),
                conversions: of(conversions, from.conversions),
                shorts: of(shorts, from.shorts),
                comparators: [of(edges, from.edges); 2],
                newest: [3000 + n as u16 % 7, if seen.short { 420 + n as u16 % 5 } else { n as u16 }],
            };
            let pulses = known + (0.5 * edges * n as f32) as u32;
            watch.look(counts, PulseSeen { pulses, ..seen }).map(|fault| (n, fault))
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
    fn a_gate_that_rings_makes_no_pulses_that_could_be_missed() {
        let at = |n: u32, edges, conversions| PulseCounts {
            edges: (n * edges) as u8,
            conversions: (n * conversions) as u8,
            newest: [3000 + n as u16 % 7; 2],
            ..PulseCounts::default()
        };
        for (edges, conversions) in [(2000, 299), (2000, 1), (299, 3), (257, 1)] {
            let mut watch = PulseWatch::default();
            let found = (1..=20).find(|n| watch.look(at(*n, edges, conversions), WORK).is_some());
            assert_eq!(found, None, "{edges} edges");
            // A dead converter is found after it.
            let found = (21..=40).find(|n| watch.look(at(*n, 10, 0), PulseSeen { pulses: 5 * n, ..WORK }).is_some());
            assert!(found.is_some_and(|n| n <= 25), "{found:?}");
        }
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
            let newest = [3000 + u16::from(edges), 420 + u16::from(edges / 10 % 8)];
            let seen = PulseSeen { pulses: watch.known + 5, ..seen };
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

    /// So many looks at five pulses each that burn or are short at these codes, with a little noise; the fault and its look.
    fn burning(
        watch: &mut PulseWatch,
        looks: u16,
        [current, voltage]: [u16; 2],
        shorts: u8,
        seen: PulseSeen,
    ) -> Option<u16> {
        let from = watch.last;
        (1..=looks).find(|n| {
            let add = |to: u8, each: u8| to.wrapping_add(each.wrapping_mul(*n as u8));
            let counts = PulseCounts {
                edges: add(from.edges, 10),
                conversions: add(from.conversions, 5),
                shorts: add(from.shorts, shorts),
                comparators: [add(from.edges, 10); 2],
                newest: [current + n % 3, voltage + n % 3],
            };
            let seen = PulseSeen { pulses: watch.known + 5, ..seen };
            watch.look(counts, seen) == Some(PulseFault::Unseen)
        })
    }

    /// Codes of 6 A and of none, of 40, 28 and 1 V.
    const FLOWS: u16 = 2420;
    const NONE: u16 = 2046;
    const SPARK: u16 = 810;
    const ARC: u16 = 690;
    const TOUCH: u16 = 420;

    #[test]
    fn a_drained_capacitor_gives_the_reflex_nothing_and_that_is_no_fault() {
        let mut watch = PulseWatch::default();
        assert_eq!(burning(&mut watch, 1000, [NONE, TOUCH], 0, SHORT), None, "at once");
        assert_eq!(burning(&mut watch, 1000, [NONE, SPARK], 0, WORK), None);
        assert_eq!(burning(&mut watch, 1000, [NONE, TOUCH], 0, SHORT), None);
        // It sees the voltage of a short as one that is none: its own sense of the voltage is wrong.
        assert_eq!(burning(&mut watch, 10, [NONE, SPARK], 0, SHORT), Some(5));
    }

    #[test]
    fn a_generator_that_gives_a_current_and_none_in_a_short_has_lost_its_sensor() {
        for burns in [ARC, SPARK, TOUCH] {
            let mut watch = PulseWatch::default();
            assert_eq!(burning(&mut watch, 100, [FLOWS, burns], 1, WORK), None);
            assert_eq!(burning(&mut watch, 1000, [NONE, burns], 0, WORK), None, "what burns may be small");
            // With other settings it is another generator, perhaps.
            let other = PulseSeen { sight: Sight { current: 2300, ..SIGHT }, ..SHORT };
            assert_eq!(burning(&mut { watch }, 100, [NONE, TOUCH], 0, other), None);
            assert_eq!(burning(&mut watch, 100, [NONE, TOUCH], 0, SHORT), Some(4));
        }
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
            watch.look(counts, PulseSeen { pulses: watch.known + 5, ..seen }).is_some()
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

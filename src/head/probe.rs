//! Touch probes: where the axis is in the servo tick in which something happens.
//!
//! A *source* is something that begins and ends: each is an *edge*. The position of an index mark is that of the decoder, which
//! has timed it; that of anything else is the one of the tick that sees it. What the tick sees of a contact or a discharge is the
//! block of conversions before it, 50 us long, so that a position is late by the travel of 100 us at the most, half a count at
//! 5 mm/s. Nothing that happens here moves the head.

use crate::encoder::Mark;
use crate::units::{TICKS_PER_MS, Volts};

/// Probes.
pub const PROBES: usize = 2;

/// What a probe waits for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Source {
    /// Nothing: it is off.
    #[default]
    Off = 0,
    /// Contact of electrode and work, by the sense supply: with pulses off.
    Contact = 1,
    /// An index mark: one that is crossed toward the work begins where it lies, one that is crossed away from it ends there.
    Index = 2,
    /// A discharge: the mean of a block lies below the share of the open circuit by which the work is found.
    Discharge = 3,
}

impl Source {
    /// The source of a number.
    pub fn from_number(number: u8) -> Option<Source> {
        [Source::Off, Source::Contact, Source::Index, Source::Discharge].get(usize::from(number)).copied()
    }
}

/// What a probe is to do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Probe {
    /// What it waits for.
    pub source: Source,
    /// Each edge is kept instead of the one before; otherwise the first.
    pub every: bool,
    /// Edges that are kept: where the source begins, where it ends.
    pub edges: [bool; 2],
    /// Counts how often it was armed, wrapping: another number forgets what it has kept.
    pub armed: u8,
}

/// An edge that was kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Edge {
    /// Position, counts, of the coordinates of now.
    pub position: i64,
    /// Servo tick, wrapping.
    pub tick: u32,
    /// Edges since the probe was armed, wrapping; 0 where none was kept since: position and tick are older then.
    pub count: u16,
}

/// What a probe has kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Latched {
    /// As it was armed.
    pub probe: Probe,
    /// Where the source has begun, and ended.
    pub edges: [Edge; 2],
}

/// What the servo task has to know in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Wanted {
    /// Some probe is on.
    pub on: bool,
    /// What each is to do.
    pub probes: [Probe; PROBES],
    /// Mean of a block below which it has a discharge; 0 where the open circuit is not known.
    pub discharge: Volts,
}

impl Wanted {
    /// All probes are off.
    pub const OFF: Wanted = Wanted {
        on: false,
        probes: [Probe { source: Source::Off, every: false, edges: [false; 2], armed: 0 }; PROBES],
        discharge: Volts(0.0),
    };
}

/// What a tick sees of the sources.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ProbeInputs {
    /// Newest index mark.
    pub mark: Mark,
    /// Mean of the newest block, if it is valid.
    pub block: Option<Volts>,
}

/// Where and when.
#[derive(Clone, Copy, Debug)]
pub(super) struct Here {
    pub tick: u32,
    pub position: i64,
    /// Position of the newest mark.
    pub marked: i64,
    /// Pulses are allowed.
    pub pulses: bool,
    /// Electrode and work touch, as the sense shows it.
    pub touches: bool,
}

/// The probes.
#[derive(Debug, Default)]
pub(super) struct Probes {
    latched: [Latched; PROBES],
    /// Level, or crossings, at the tick before; none where the probe was armed since.
    before: [Option<u32>; PROBES],
    pulses: bool,
    /// Ticks since pulses were switched, or any probe was on.
    steady: u32,
}

impl Probes {
    /// What they have kept.
    pub fn latched(&self) -> &[Latched; PROBES] {
        &self.latched
    }

    /// The axis is given other coordinates: `by` is added to all of them.
    pub fn shift(&mut self, by: i64) {
        for edge in self.latched.iter_mut().flat_map(|latched| &mut latched.edges) {
            edge.position = edge.position.saturating_add(by);
        }
    }

    /// Takes up what is wanted from now on.
    pub fn want(&mut self, wanted: &Wanted) {
        for ((latched, before), probe) in self.latched.iter_mut().zip(&mut self.before).zip(&wanted.probes) {
            if latched.probe != *probe {
                latched.probe = *probe;
                for edge in &mut latched.edges {
                    edge.count = 0;
                }
                *before = None;
            }
        }
        if !wanted.on {
            self.steady = 0;
        }
    }

    /// One tick.
    pub fn tick(&mut self, wanted: &Wanted, sight: &ProbeInputs, here: &Here) {
        self.steady = if self.pulses == here.pulses { self.steady.saturating_add(1) } else { 0 };
        self.pulses = here.pulses;
        // Filters and supplies have settled: between pulses there is no voltage either.
        let steady = self.steady >= TICKS_PER_MS;
        let discharges = sight.block.is_some_and(|block| block.0 < wanted.discharge.0);
        for (latched, before) in self.latched.iter_mut().zip(&mut self.before) {
            let (level, position) = match latched.probe.source {
                Source::Off => continue,
                Source::Index => (sight.mark.crossings, here.marked),
                Source::Contact if steady && !here.pulses => (here.touches.into(), here.position),
                Source::Discharge if steady && here.pulses => (discharges.into(), here.position),
                // Not known.
                Source::Contact => {
                    *before = None;
                    continue;
                }
                Source::Discharge => {
                    *before = Some(0);
                    continue;
                }
            };
            let Some(before) = before.replace(level).filter(|before| *before != level) else { continue };
            let begins = match latched.probe.source {
                Source::Index => sight.mark.toward_work,
                _ => level > before,
            };
            let Probe { edges: [first, second], every, .. } = latched.probe;
            let [begun, ended] = &mut latched.edges;
            let (kept, edge) = if begins { (first, begun) } else { (second, ended) };
            if kept && (every || edge.count == 0) {
                *edge = Edge { position, tick: here.tick, count: edge.count.wrapping_add(1) };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: Probe = Probe { source: Source::Contact, every: false, edges: [true; 2], armed: 1 };

    struct Bench {
        probes: Probes,
        wanted: Wanted,
        tick: u32,
    }

    impl Bench {
        fn of(probe: Probe) -> Bench {
            let mut bench = Bench { probes: Probes::default(), wanted: Wanted::OFF, tick: 0 };
            bench.arm(probe);
            bench
        }

        fn arm(&mut self, probe: Probe) {
            self.wanted = Wanted { on: true, probes: [probe, Probe::default()], discharge: Volts(85.0) };
            self.probes.want(&self.wanted);
        }

        fn tick(&mut self, touches: bool, pulses: bool, volts: f32, mark: Mark) {
            self.tick += 1;
            let position = i64::from(self.tick) * 10;
            let here = Here { tick: self.tick, position, marked: mark.count.into(), pulses, touches };
            self.probes.tick(&self.wanted, &ProbeInputs { mark, block: Some(Volts(volts)) }, &here);
        }

        fn touch(&mut self, ticks: u32, touches: bool) {
            (0..ticks).for_each(|_| self.tick(touches, false, 9.0, Mark::default()));
        }

        /// Tick and count of each edge.
        fn edges(&self) -> [(u32, u16); 2] {
            let [latched, off] = self.probes.latched();
            assert_eq!(off.edges, [Edge::default(); 2]);
            latched.edges.map(|edge| {
                assert_eq!(edge.position, i64::from(edge.tick) * 10);
                (edge.tick, edge.count)
            })
        }
    }

    #[test]
    fn the_first_of_each_edge_is_kept_or_the_newest() {
        for (every, edges) in [(false, [(101, 1), (111, 1)]), (true, [(121, 2), (131, 2)])] {
            let mut bench = Bench::of(Probe { every, ..BOTH });
            bench.touch(100, false);
            for _ in 0..2 {
                bench.touch(10, true);
                bench.touch(10, false);
            }
            assert_eq!(bench.edges(), edges);
            // What was kept is there until the next one, and counted no more.
            bench.arm(Probe { every, armed: 2, ..BOTH });
            bench.touch(5, false);
            assert_eq!(bench.edges(), edges.map(|(tick, _)| (tick, 0)));
            bench.touch(5, true);
            assert_eq!(bench.edges()[0], (146, 1));
        }
    }

    #[test]
    fn an_edge_that_nobody_asked_for_is_not_kept() {
        let mut bench = Bench::of(Probe { edges: [false, true], ..BOTH });
        bench.touch(100, false);
        bench.touch(10, true);
        assert_eq!(bench.edges(), [(0, 0); 2]);
        bench.touch(10, false);
        assert_eq!(bench.edges(), [(0, 0), (111, 1)]);
    }

    #[test]
    fn what_was_so_before_is_no_edge() {
        let mut bench = Bench::of(BOTH);
        bench.touch(100, true);
        assert_eq!(bench.edges(), [(0, 0); 2]);
        bench.arm(Probe { armed: 2, ..BOTH });
        bench.touch(1, true);
        bench.touch(1, false);
        assert_eq!(bench.edges(), [(0, 0), (102, 1)]);
    }

    #[test]
    fn between_pulses_nothing_touches_and_without_them_nothing_discharges() {
        let mut bench = Bench::of(Probe { every: true, ..BOTH });
        bench.touch(100, false);
        // Without a voltage it looks like a contact, until a millisecond after the last pulse.
        for n in 0..200 {
            bench.tick(n % 3 == 0, true, 0.0, Mark::default());
        }
        bench.touch(15, true);
        bench.touch(50, false);
        assert_eq!(bench.edges(), [(0, 0); 2]);
        bench.touch(1, true);
        assert_eq!(bench.edges()[0], (366, 1));

        let mut bench = Bench::of(Probe { source: Source::Discharge, ..BOTH });
        bench.touch(100, false);
        for _ in 0..100 {
            bench.tick(false, true, 86.0, Mark::default());
        }
        assert_eq!(bench.edges(), [(0, 0); 2]);
        bench.tick(false, true, 84.0, Mark::default());
        bench.tick(false, true, 86.0, Mark::default());
        assert_eq!(bench.edges(), [(201, 1), (202, 1)]);
    }

    #[test]
    fn a_mark_begins_downward_and_ends_upward_where_it_lies() {
        let mut bench = Bench::of(Probe { source: Source::Index, ..BOTH });
        let mark = |crossings, toward_work| Mark { count: 7, toward_work, crossings };
        for mark in [mark(3, true), mark(3, true), mark(4, false), mark(5, true)] {
            bench.tick(false, false, 9.0, mark);
        }
        let [latched, _] = bench.probes.latched();
        assert_eq!(latched.edges.map(|edge| (edge.tick, edge.count, edge.position)), [(4, 1, 7), (3, 1, 7)]);
        bench.probes.shift(-10);
        assert_eq!(bench.probes.latched()[0].edges.map(|edge| edge.position), [-3, -3]);
    }

    #[test]
    fn sources_have_their_numbers() {
        let found = (0..=u8::MAX).filter_map(Source::from_number).map(|source| source as u8).collect::<Vec<_>>();
        assert_eq!(found, [0, 1, 2, 3]);
    }
}

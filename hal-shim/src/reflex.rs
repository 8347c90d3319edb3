//! The reflex: what to do about one short pulse, before any filter has seen it.
//!
//! A pulse is short when, after the blanking, its voltage is below the threshold while current flows and the gate is still
//! open. Every short pulse is killed. A *run* of consecutive short pulses, or shorts that have lasted too long, starts the
//! retreat (architecture page, "Short path"). A pulse that was not short ends the run; the count of gate edges shows it, so
//! that good pulses cost nothing.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Edges counted before the count wraps; a run broken by exactly this many good edges in a row would go unnoticed, so it is
/// also broken by time.
pub const EDGE_COUNT: u32 = 256;

/// What a person set, in the units of the reflex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Consecutive short pulses that start the retreat, at least 1.
    pub run: u32,
    /// Clock ticks of uninterrupted shorts that start the retreat.
    pub ticks: u32,
    /// Code of the gap current from which it counts as flowing.
    pub current: u16,
    /// Lowest and highest code of the gap voltage with which a pulse is no short.
    pub voltage: (u16, u16),
    /// Time constant with which the gap voltage rises in a pulse, ns.
    pub tau_ns: u32,
    /// A positive duty moves away from the work: so does the retreat of the reflex.
    pub motor_reversed: bool,
}

/// What the reflex judges by. Written by a slower task, read by the reflex.
pub struct Limits {
    /// Consecutive short pulses that start the retreat.
    run: AtomicU32,
    /// Clock ticks of uninterrupted shorts that start the retreat.
    ticks: AtomicU32,
    /// Code of the gap current from which it counts as flowing.
    current: AtomicU32,
    /// Gap open and position known: the retreat may be forced.
    armed: AtomicU32,
}

impl Limits {
    /// Nothing is a short until [`Limits::set`], and nothing is forced until [`Limits::arm`].
    pub const fn new() -> Self {
        Limits {
            run: AtomicU32::new(u32::MAX),
            ticks: AtomicU32::new(u32::MAX),
            current: AtomicU32::new(u32::MAX),
            armed: AtomicU32::new(0),
        }
    }

    /// New values; from now on short pulses are killed.
    pub fn set(&self, config: &Config) {
        self.run.store(config.run, Relaxed);
        self.ticks.store(config.ticks, Relaxed);
        self.current.store(u32::from(config.current), Relaxed);
    }

    /// Whether a retreat may be forced: only while the head erodes.
    pub fn arm(&self, armed: bool) {
        self.armed.store(u32::from(armed), Relaxed);
    }
}

impl Default for Limits {
    fn default() -> Self {
        Limits::new()
    }
}

/// What to do about a pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Not a short: the gate has closed, or no current flows.
    Pass,
    /// A short: end this pulse.
    Kill,
    /// A short, and the run is long enough: end it and retreat.
    Retreat,
}

/// The run of short pulses so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct Run {
    /// Consecutive short pulses, 0 without a run.
    length: u32,
    began: u32,
    last: u32,
    edges: u32,
}

impl Run {
    /// A run that has not begun.
    pub const fn new() -> Self {
        Run { length: 0, began: 0, last: 0, edges: 0 }
    }

    /// Judges a pulse whose voltage was low after the blanking.
    ///
    /// `gate_open` now, `current` of this pulse as a code, `edges` of the gate counted so far modulo [`EDGE_COUNT`], `now`
    /// in clock ticks, wrapping.
    pub fn low(&mut self, limits: &Limits, gate_open: bool, current: u16, edges: u32, now: u32) -> Verdict {
        if !gate_open || u32::from(current) < limits.current.load(Relaxed) {
            return Verdict::Pass;
        }
        // The next pulse is two edges on; the same pulse converted again would be none.
        let next = edges.wrapping_sub(self.edges) % EDGE_COUNT <= 2;
        let most = limits.ticks.load(Relaxed);
        if self.length == 0 || !next || now.wrapping_sub(self.last) > most {
            self.length = 0;
            self.began = now;
        }
        self.length = self.length.saturating_add(1);
        self.last = now;
        self.edges = edges;
        let long = self.length >= limits.run.load(Relaxed) || now.wrapping_sub(self.began) >= most;
        if !long || limits.armed.load(Relaxed) == 0 {
            return Verdict::Kill;
        }
        // The retreat is under way: the next one needs a run of its own.
        self.length = 0;
        Verdict::Retreat
    }
}

/// What the pulses have done so far, by parts of the hardware that know nothing of each other. Each count wraps at
/// [`EDGE_COUNT`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PulseCounts {
    /// Edges of the gate, two to a pulse.
    pub edges: u8,
    /// Pulses that the reflex's converter has converted.
    pub conversions: u8,
    /// Pulses that the reflex has found short.
    pub shorts: u8,
    /// Edges of the high comparator, and of the low one.
    pub comparators: [u8; 2],
    /// Gap current and gap voltage of the newest pulse, converter codes.
    pub newest: [u16; 2],
}

/// The lines that reflex and stop force at any moment, seen from the servo task.
pub trait ForcedLines {
    /// What was forced up to a moment.
    type Mark: Copy;
    /// What was forced up to now.
    fn forced(&self) -> Self::Mark;
    /// Whether the bridge was forced between two marks.
    fn bridge_forced(&self, earlier: Self::Mark, later: Self::Mark) -> bool;
    /// Repeats what was forced since `seen`, after outputs decided before it may have been written.
    fn settle(&mut self, seen: Self::Mark);
    /// Pulses off and bridge off, now.
    fn stop(&mut self);
    /// Retreats that the reflex has begun so far, wrapping.
    fn retreats(&self) -> u32;
    /// What the pulses have done so far.
    fn pulses(&self) -> PulseCounts;
}

/// Where the reflex gets what is not in [`Limits`].
pub trait Thresholds {
    /// Why values were refused.
    type Error;
    /// Blanking, voltage thresholds, and which way away from the work is.
    ///
    /// # Errors
    /// Refused, nothing has changed.
    fn set(&mut self, config: &Config) -> Result<(), Self::Error>;
    /// Has the end of each pulse looked at while there is any pause; without one it costs nothing.
    fn watch_ends(&mut self, pauses: &crate::pause::Config);
    /// Pauses that have begun so far, modulo 2^31.
    fn pauses_begun(&self) -> u32;
    /// Blocks of 50 us so far in which the gate closed so often that it rings, wrapping: the ends of its pulses were not all looked at.
    fn gate_rung(&self) -> u32;
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u32 = 168_000;
    /// 100 us: pulses at 10 kHz.
    const PULSE: u32 = 16_800;

    const CONFIG: Config =
        Config { run: 5, ticks: MS, current: 100, voltage: (0, 4095), tau_ns: 0, motor_reversed: false };

    fn limits() -> Limits {
        let limits = Limits::new();
        limits.set(&CONFIG);
        limits.arm(true);
        limits
    }

    /// Feeds pulses, `true` for a short one, and gives the verdicts of the short ones.
    fn feed(limits: &Limits, pulse: u32, pulses: &[bool]) -> Vec<Verdict> {
        let mut run = Run::new();
        let pulses = pulses.iter().zip(0u32..).filter(|(short, _)| **short);
        pulses.map(|(_, i)| run.low(limits, true, 100, (2 * i + 7) % EDGE_COUNT, i.wrapping_mul(pulse))).collect()
    }

    #[test]
    fn the_fifth_short_pulse_in_a_row_starts_the_retreat() {
        use Verdict::{Kill, Retreat};
        assert_eq!(feed(&limits(), PULSE, &[true; 5]), [Kill, Kill, Kill, Kill, Retreat]);
        // And the next retreat takes five more.
        assert_eq!(feed(&limits(), PULSE, &[true; 10])[5..], [Kill, Kill, Kill, Kill, Retreat]);
    }

    #[test]
    fn one_good_pulse_ends_the_run() {
        let pulses = [true, true, true, true, false, true, true, true, true];
        assert!(feed(&limits(), PULSE, &pulses).iter().all(|v| *v == Verdict::Kill));
    }

    #[test]
    fn a_millisecond_of_shorts_is_enough_however_few() {
        use Verdict::{Kill, Retreat};
        assert_eq!(feed(&limits(), MS, &[true; 2]), [Kill, Retreat]);
        assert_eq!(feed(&limits(), MS / 2 - 1, &[true; 4]), [Kill, Kill, Kill, Retreat]);
        assert_eq!(feed(&limits(), MS / 2, &[true; 3]), [Kill, Kill, Retreat]);
    }

    #[test]
    fn shorts_further_apart_than_the_time_limit_are_no_run() {
        assert_eq!(feed(&limits(), MS + 1, &[true; 20]), [Verdict::Kill; 20]);
    }

    #[test]
    fn good_pulses_that_wrap_the_edge_count_end_the_run_by_time() {
        let mut pulses = vec![false; 5 * 128];
        pulses.iter_mut().step_by(128).for_each(|p| *p = true);
        // 100 kHz: 128 pulses are 1.28 ms.
        assert_eq!(feed(&limits(), 1680, &pulses), [Verdict::Kill; 5]);
    }

    #[test]
    fn a_closed_gate_or_no_current_is_not_a_short() {
        let (limits, mut run) = (limits(), Run::new());
        assert_eq!(run.low(&limits, false, 4095, 0, 0), Verdict::Pass);
        assert_eq!(run.low(&limits, true, 99, 0, 0), Verdict::Pass);
        assert_eq!(run.low(&limits, true, 100, 0, 0), Verdict::Kill);
    }

    #[test]
    fn unarmed_it_kills_but_never_forces_and_forgets_nothing() {
        let limits = limits();
        limits.arm(false);
        assert_eq!(feed(&limits, PULSE, &[true; 20]), [Verdict::Kill; 20]);
        limits.set(&Config { run: 1, ..CONFIG });
        limits.arm(true);
        assert_eq!(feed(&limits, PULSE, &[true; 2]), [Verdict::Retreat; 2]);
    }

    #[test]
    fn nothing_is_a_short_before_the_limits_are_set() {
        let limits = Limits::new();
        limits.arm(true);
        let mut run = Run::new();
        assert_eq!(run.low(&limits, true, 4095, 0, 0), Verdict::Pass);
        limits.set(&CONFIG);
        assert_eq!(run.low(&limits, true, 4095, 0, 0), Verdict::Kill);
    }

    #[test]
    fn clock_and_edge_count_wrap_inside_a_run() {
        let (limits, mut run) = (limits(), Run::new());
        let verdicts: Vec<_> = (0..5u32)
            .map(|i| run.low(&limits, true, 100, (252 + 2 * i) % 256, (u32::MAX - 20_000).wrapping_add(i * PULSE)))
            .collect();
        assert_eq!(verdicts[4], Verdict::Retreat);
    }
}

//! Generator, gap and material: what each pulse becomes.
//!
//! A pulse begins with the generator's gate. If electrode and work touch, or a bridge of debris joins them, it is *short*.
//! Otherwise it *arcs* at once with a chance that grows with debris, or waits an *ignition delay*, exponential with a mean
//! that grows with the gap; ignited within the on-time it is a *spark*, else it stays *open*. Burning removes material.
//!
//! The median delay follows the curve of a public wire-EDM model, 0.48 g^2 - 3.69 g + 14.05 us (g in um; held constant below
//! 3.84 um, where the curve turns), scaled for a sinker.

use super::Parameters;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Exp1};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::LN_2;

/// Pulses by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pulses {
    /// Never ignited.
    pub open: u64,
    /// Ignited after a delay.
    pub spark: u64,
    /// Ignited at once at the spot of the last discharge.
    pub arc: u64,
    /// Electrode and work touched, or debris bridged the gap.
    pub short: u64,
}

/// A stretch of constant gap condition, in us since the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// When it began.
    pub from: f64,
    /// When it ends, as far as is known.
    pub to: f64,
    /// Voltage it tends to, V.
    pub volts: f64,
    /// Voltage when it began, V.
    pub initial: f64,
    /// Gate on.
    pub gate: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Gate off until the end of the stretch.
    Off,
    /// Gate on, not ignited; ignites at the end of the stretch or stays open until then.
    Waiting { ignites: bool, end: f64 },
    /// Burning until the end of the stretch.
    Burning { arc: bool },
    /// Short until the end of the stretch.
    Shorted,
}

#[derive(Clone, Copy, Debug)]
struct Bridge {
    until: f64,
    breaks_at_um: f64,
}

/// State of generator, gap and material.
#[derive(Clone, Debug)]
pub struct Spark {
    phase: Phase,
    stretch: Stretch,
    bridge: Option<Bridge>,
    /// Concentration of debris; 1 at the default working point.
    debris: f64,
    /// Depth removed, um.
    pub removed_um: f64,
    /// Length the electrode lost, um.
    pub wear_um: f64,
    /// Classes so far.
    pub pulses: Pulses,
    last_gap_um: f64,
    shorts_in_a_row: u32,
    /// A short from outside.
    pub forced_short: bool,
    /// The generator makes no pulses although it may.
    pub dead: bool,
    frozen: bool,
    constants: Constants,
    ignition: Xoshiro256PlusPlus,
    arcs: Xoshiro256PlusPlus,
    bridges: Xoshiro256PlusPlus,
}

#[derive(Clone, Debug)]
struct Constants {
    open: f64,
    burn: f64,
    on: f64,
    off: f64,
    suspend_after: u32,
    suspend: f64,
    scale: f64,
    reach: f64,
    debris_gap: f64,
    removal: f64,
    wear: f64,
    arc_removal: f64,
    arc_burn: f64,
    arc_chance: f64,
    bridge_chance: f64,
    bridge_us: f64,
    bridge_um: f64,
    flush_us: f64,
    flush_depth_um: f64,
    sign: f64,
}

/// Voltage of a short, V: cable and contact (assumed).
const SHORT_V: f64 = 1.0;
/// Burn time a second at the default working point: two thirds of 160 us, 5000 times.
const DEBRIS_PER_BURN: f64 = 1.0 / (2.0 / 3.0 * 160.0 * 5000.0);

/// Mean ignition delay, us, at an effective gap in um.
pub fn mean_delay_us(scale: f64, gap_um: f64) -> f64 {
    let g = gap_um.max(3.69 / (2.0 * 0.48));
    scale * (0.48 * g * g - 3.69 * g + 14.05) / LN_2
}

impl Spark {
    /// Gate off, clean gap.
    pub fn new(p: &Parameters, seed: u64) -> Spark {
        let stream = |n| Xoshiro256PlusPlus::seed_from_u64(seed.wrapping_mul(16).wrapping_add(n));
        Spark {
            phase: Phase::Off,
            stretch: Stretch { from: 0.0, to: 0.0, volts: 0.0, initial: 0.0, gate: false },
            bridge: None,
            debris: 0.0,
            removed_um: 0.0,
            wear_um: 0.0,
            pulses: Pulses::default(),
            last_gap_um: f64::INFINITY,
            shorts_in_a_row: 0,
            forced_short: false,
            dead: false,
            frozen: false,
            constants: Constants {
                open: p.open.into(),
                burn: p.burn.into(),
                on: p.on.into(),
                off: p.off.into(),
                suspend_after: p.suspend_after,
                suspend: f64::from(p.suspend_ms) * 1e3,
                scale: p.ignition_scale.into(),
                reach: p.ignition_reach.into(),
                debris_gap: p.ignition_debris.into(),
                removal: f64::from(p.removal) * 1e-6,
                wear: f64::from(p.wear) * 0.01,
                arc_removal: p.arc_removal.into(),
                arc_burn: p.arc_burn.into(),
                arc_chance: p.arc_chance.into(),
                bridge_chance: p.bridge_chance.into(),
                bridge_us: f64::from(p.bridge_ms) * 1e3,
                bridge_um: p.bridge_um.into(),
                flush_us: f64::from(p.flush) * 1e6,
                flush_depth_um: f64::from(p.flush_depth) * 1e3,
                sign: if p.gap_reversed { -1.0 } else { 1.0 },
            },
            ignition: stream(1),
            arcs: stream(2),
            bridges: stream(3),
        }
    }

    /// Advances from `from` to `to` (us), with the gap at either end in um, and gives every stretch that touches the
    /// interval. `enabled` is the head's permission to pulse.
    pub fn advance(&mut self, from: f64, to: f64, gap: (f64, f64), enabled: bool, stretches: &mut Vec<Stretch>) {
        self.flush(to - from, gap.1);
        stretches.push(self.stretch);
        let slope = (gap.1 - gap.0) / (to - from);
        while self.stretch.to < to {
            let now = self.stretch.to.max(from);
            self.next(now, gap.0 + slope * (now - from), enabled);
            stretches.push(self.stretch);
        }
    }

    /// Debris settles out, and is thinned by the dielectric that an opening gap draws in.
    fn flush(&mut self, us: f64, gap_um: f64) {
        if self.frozen {
            return;
        }
        let c = &self.constants;
        let time = c.flush_us * (1.0 + self.removed_um / c.flush_depth_um);
        self.debris -= self.debris * us / time;
        let (before, after) = (self.last_gap_um.max(1.0), gap_um.max(1.0));
        if after > before {
            self.debris *= before / after;
        }
        self.last_gap_um = gap_um;
    }

    fn next(&mut self, now: f64, gap_um: f64, enabled: bool) {
        let c = &self.constants;
        match self.phase {
            Phase::Off if !enabled || self.dead => self.enter(Phase::Off, now, now + 50.0, 0.0, false),
            Phase::Off => self.ignite(now, gap_um),
            Phase::Waiting { ignites: true, end } => {
                self.pulses.spark += 1;
                let volts = c.burn;
                self.enter(Phase::Burning { arc: false }, now, end, volts, true);
            }
            Phase::Waiting { ignites: false, .. } => {
                self.pulses.open += 1;
                self.end_pulse(now);
            }
            Phase::Burning { arc } => {
                self.remove(now - self.stretch.from, arc, gap_um, now);
                self.end_pulse(now);
            }
            Phase::Shorted => {
                self.pulses.short += 1;
                self.end_pulse(now);
            }
        }
    }

    fn ignite(&mut self, now: f64, gap_um: f64) {
        self.bridge = self.bridge.filter(|bridge| now < bridge.until && gap_um < bridge.breaks_at_um);
        let end = now + self.constants.on;
        if gap_um <= 0.0 || self.bridge.is_some() || self.forced_short {
            self.shorts_in_a_row += 1;
            self.enter(Phase::Shorted, now, end, SHORT_V, true);
            return;
        }
        self.shorts_in_a_row = 0;
        let c = &self.constants;
        if self.arcs.random::<f64>() < c.arc_chance * self.debris && gap_um < 100.0 {
            self.pulses.arc += 1;
            let volts = c.arc_burn;
            self.enter(Phase::Burning { arc: true }, now, end, volts, true);
            return;
        }
        let seen = gap_um / (1.0 + c.debris_gap * self.debris);
        let exponential: f64 = Exp1.sample(&mut self.ignition);
        let at = now + exponential * mean_delay_us(c.scale, seen);
        let ignites = at < end && seen < c.reach;
        let volts = c.open;
        self.enter(Phase::Waiting { ignites, end }, now, if ignites { at } else { end }, volts, true);
    }

    fn end_pulse(&mut self, now: f64) {
        let c = &self.constants;
        let suspended = c.suspend_after > 0 && self.shorts_in_a_row >= c.suspend_after;
        let off = if suspended { c.suspend } else { c.off };
        if suspended {
            self.shorts_in_a_row = 0;
        }
        self.enter(Phase::Off, now, now + off, 0.0, false);
    }

    fn remove(&mut self, us: f64, arc: bool, gap_um: f64, now: f64) {
        if self.frozen {
            return;
        }
        let c = &self.constants;
        let depth = us * c.removal * if arc { c.arc_removal } else { 1.0 };
        self.removed_um += depth;
        self.wear_um += depth * c.wear;
        self.debris += us * DEBRIS_PER_BURN * 1e6 / c.flush_us;
        if self.bridges.random::<f64>() < c.bridge_chance * self.debris {
            let lasts: f64 = Exp1.sample(&mut self.bridges);
            let breaks: f64 = Exp1.sample(&mut self.bridges);
            self.bridge =
                Some(Bridge { until: now + lasts * c.bridge_us, breaks_at_um: gap_um + breaks * c.bridge_um });
        }
    }

    fn enter(&mut self, phase: Phase, from: f64, to: f64, volts: f64, gate: bool) {
        self.phase = phase;
        let initial = self.stretch.volts;
        self.stretch = Stretch { from, to, volts: volts * self.constants.sign, initial, gate };
    }

    /// Material and debris stay as they are from now on.
    pub fn freeze(&mut self, debris: f64) {
        self.debris = debris;
        self.frozen = true;
    }

    /// Concentration of debris; 1 at the default working point.
    pub fn debris(&self) -> f64 {
        self.debris
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean gated voltage and burn share over `seconds` at a fixed gap.
    fn at(p: &Parameters, gap: f64, seconds: f64) -> (f64, Spark) {
        let mut spark = Spark::new(p, 1);
        let (mut area, mut time) = (0.0, 0.0);
        let mut stretches = Vec::new();
        for tick in 0..(seconds * 20_000.0) as u64 {
            let from = tick as f64 * 50.0;
            stretches.clear();
            spark.advance(from, from + 50.0, (gap, gap), true, &mut stretches);
            for s in stretches.iter().filter(|s| s.gate) {
                let (a, b) = (s.from.max(from), s.to.min(from + 50.0));
                area += s.volts * (b - a).max(0.0);
                time += (b - a).max(0.0);
            }
        }
        (area / time, spark)
    }

    #[test]
    fn the_mean_ignition_delay_follows_its_formula() {
        let p = Parameters { arc_chance: 0.0, bridge_chance: 0.0, ignition_debris: 0.0, ..Parameters::default() };
        // Sparks within the on-time: 1 - exp(-160 / mean).
        let (_, spark) = at(&p, 40.0, 4.0);
        let total = (spark.pulses.spark + spark.pulses.open) as f64;
        let expected = 1.0 - (-160.0 / mean_delay_us(0.1, 40.0)).exp();
        assert!((spark.pulses.spark as f64 / total - expected).abs() < 0.01);
        assert_eq!((spark.pulses.arc, spark.pulses.short), (0, 0));
    }

    #[test]
    fn the_gated_voltage_falls_as_the_gap_closes_between_burn_and_open() {
        let p = Parameters::default();
        let volts: Vec<f64> = [5.0, 15.0, 25.0, 35.0, 50.0, 90.0].iter().map(|&gap| at(&p, gap, 1.0).0).collect();
        assert!(volts.is_sorted(), "{volts:?}");
        assert!(volts[0] > 39.0 && volts[5] < 100.0 && volts[5] > 85.0, "{volts:?}");
    }

    #[test]
    fn at_60_v_the_work_recedes_by_about_0_2_mm_a_minute() {
        let p = Parameters::default();
        let (volts, spark) = at(&p, 34.0, 10.0);
        assert!((volts - 60.0).abs() < 4.0, "{volts}");
        let mm_per_minute = spark.removed_um * 6.0 * 1e-3;
        assert!((0.15..0.25).contains(&mm_per_minute), "{mm_per_minute}");
        assert!((0.5..1.5).contains(&spark.debris()), "{}", spark.debris());
    }

    #[test]
    fn a_closed_gap_shorts_every_pulse_and_removes_nothing() {
        let (volts, spark) = at(&Parameters::default(), 0.0, 0.1);
        assert!(volts < 2.0);
        assert_eq!((spark.pulses.spark, spark.pulses.open, spark.removed_um), (0, 0, 0.0));
    }

    #[test]
    fn beyond_its_reach_no_pulse_ignites_however_long() {
        let p = Parameters { on: 5000.0, ..Parameters::default() };
        assert!(at(&p, 149.0, 1.0).1.pulses.spark > 0);
        assert_eq!(at(&p, 151.0, 1.0).1.pulses.spark, 0);
    }

    #[test]
    fn a_generator_that_suspends_itself_pulses_less_after_shorts() {
        let p = Parameters { suspend_after: 5, ..Parameters::default() };
        let (_, spark) = at(&p, 0.0, 1.0);
        // Five pulses of 200 us and 5 ms of rest, less the last off-time.
        assert!((800..860).contains(&spark.pulses.short), "{}", spark.pulses.short);
    }

    #[test]
    fn an_opening_gap_thins_the_debris_and_a_closing_one_does_not_thicken_it() {
        let (_, mut spark) = at(&Parameters::default(), 30.0, 3.0);
        let before = spark.debris();
        spark.flush(1.0, 60.0);
        assert!((spark.debris() / before - 0.5).abs() < 0.01);
        let thin = spark.debris();
        spark.flush(1.0, 30.0);
        assert!((spark.debris() / thin - 1.0).abs() < 0.01);
    }
}

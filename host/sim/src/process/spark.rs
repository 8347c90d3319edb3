//! Generator, gap and material: what each pulse becomes.
//!
//! A pulse begins with the generator's gate. If electrode and work touch, or a *bridge* joins them, it is *short*: no
//! voltage, no removal. It *arcs* when the channel of the last discharge has not recovered: no delay, lower voltage, little
//! removal. Otherwise it waits an *ignition delay*; ignited within the on-time it is a *spark*, else it stays *open*.
//!
//! - Ignition is a hazard that runs while the pulse waits, so a gap that moves meanwhile counts as it moves. Its median
//!   delay follows the curve of a public wire-EDM model, 0.48 g^2 - 3.69 g + 14.05 us (g in um; held constant below
//!   3.84 um, where the curve turns), scaled for a sinker (assumed). Debris raises the hazard; beyond a reach there is none:
//!   [R] section 6.5.1 saw pulses stay open beyond a certain range.
//! - Bridges of debris grow with the square of its concentration; peaks of the two surfaces touch with the chance of
//!   heights that are normally distributed. A bridge ends with time, or when the gap has opened far enough (all assumed).
//! - Arcs follow a discharge, the more the dirtier the gap and the shorter the off-time, and repeat while it stays dirty
//!   (all assumed).
//!
//! The head's permission and the touch of the electrode act at the beginning of a servo tick, all else in continuous time.

use super::Parameters;
use super::debris::Debris;
use super::random::{Cause, Random};
use edm_process::Pulses;
use rand::RngExt;
use rand_distr::{Distribution, Exp1, StandardNormal};
use std::f64::consts::LN_2;

/// Voltage of a short, V: cable and contact (assumed).
const SHORT_V: f64 = 1.0;
/// Time constants of the edge after which a stretch counts as settled: 3e-4 of the step.
const SETTLED: f64 = 8.0;
/// Gaps of so many heights are never bridged by peaks: a chance of 1e-7.
const PEAKS: f64 = 4.0;

/// e^-x for 0 to [`SETTLED`], to 1e-9: six squarings of a polynomial. It is wanted at every event, and `exp` is for all
/// numbers.
fn fade(x: f64) -> f64 {
    let y = x * (-1.0 / 64.0);
    let root = 1.0 + y * (1.0 + y * (1.0 / 2.0 + y * (1.0 / 6.0 + y * (1.0 / 24.0 + y * (1.0 / 120.0)))));
    (0..6).fold(root, |power, _| power * power)
}

/// A stretch of constant gap condition; times in us since the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// When it began.
    pub from: f64,
    /// Voltage it tends to, V.
    pub volts: f64,
    /// Voltage when it began, V.
    pub initial: f64,
    /// Time constant of the way from one to the other.
    pub rise: f64,
    /// When the generator's gate opened and will close, the same time twice while it is off.
    pub gate: (f64, f64),
}

impl Stretch {
    /// Whether the edge is over at a time inside the stretch.
    pub fn settled(&self, time: f64) -> bool {
        time - self.from > SETTLED * self.rise
    }

    /// Gap voltage at a time inside the stretch, V.
    pub fn at(&self, time: f64) -> f64 {
        if self.settled(time) {
            self.volts
        } else {
            self.volts + (self.initial - self.volts) * fade((time - self.from) / self.rise)
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Gate off; the next pulse is due at a time.
    Off { due: f64 },
    /// Gate on, not ignited; `delay` of hazard is left at time `since`.
    Waiting { delay: f64, since: f64 },
    /// Burning since a time.
    Burning { since: f64, removal: f64 },
    /// Shorted.
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
    c: Constants,
    phase: Phase,
    /// When the gate opened and will close; the same time twice while it is off.
    gate: (f64, f64),
    /// Stretches that touch the last interval, in order; the last one continues.
    pub stretches: Vec<Stretch>,
    bridge: Option<Bridge>,
    /// What floats in the gap.
    pub debris: Debris,
    /// Depth removed, um.
    pub removed_um: f64,
    /// Length the electrode lost, um.
    pub wear_um: f64,
    /// Classes so far.
    pub pulses: Pulses,
    /// The pulse before this one burned, and it was an arc.
    last: (bool, bool),
    shorts_in_a_row: u32,
    /// A short from outside.
    pub forced_short: bool,
    /// The generator makes no pulses although it may.
    pub dead: bool,
    /// The contact sense supply gives nothing.
    pub senseless: bool,
    /// Share of the pulses that arc whatever the gap is like.
    pub forced_arcs: f64,
    /// Chance ignition only: no removal, no bridges, no arcs.
    held: bool,
    ignition: Random,
    arcs: Random,
    bridges: Random,
    burns: Random,
}

/// Parameters in um, us and V.
#[derive(Clone, Debug)]
struct Constants {
    open: f64,
    burn: f64,
    scatter: f64,
    on: f64,
    off: f64,
    rise: f64,
    sense: f64,
    suspend_after: u32,
    suspend: f64,
    ignition_scale: f64,
    ignition_debris: f64,
    reach: f64,
    removal: f64,
    wear: f64,
    arc_removal: f64,
    arc_burn: f64,
    arc_chance: f64,
    arc_repeats: f64,
    bridge_chance: f64,
    bridge_us: f64,
    bridge_um: f64,
    peaks: f64,
    sign: f64,
}

/// Mean ignition delay in a clean gap, us; the gap in um.
pub fn mean_delay_us(scale: f64, gap_um: f64) -> f64 {
    let g = gap_um.max(3.69 / (2.0 * 0.48));
    scale * (0.48 * g * g - 3.69 * g + 14.05) * (1.0 / LN_2)
}

impl Spark {
    /// Gate off, clean gap.
    pub fn new(p: &Parameters, seed: u64) -> Spark {
        let off = f64::from(p.off);
        // The channel recovers during the off-time.
        let recovery = (-off / f64::from(p.arc_recovery)).exp();
        let c = Constants {
            open: p.open.into(),
            burn: p.burn.into(),
            scatter: p.burn_scatter.into(),
            on: p.on.into(),
            off,
            rise: p.rise.into(),
            sense: p.sense.into(),
            suspend_after: p.suspend_after,
            suspend: f64::from(p.suspend_ms) * 1e3,
            ignition_scale: p.ignition_scale.into(),
            ignition_debris: p.ignition_debris.into(),
            reach: p.ignition_reach.into(),
            removal: f64::from(p.removal) * 1e-6,
            wear: f64::from(p.wear) * 0.01,
            arc_removal: p.arc_removal.into(),
            arc_burn: p.arc_burn.into(),
            arc_chance: f64::from(p.arc_chance) * recovery,
            arc_repeats: p.arc_repeats.into(),
            bridge_chance: p.bridge_chance.into(),
            bridge_us: f64::from(p.bridge_ms) * 1e3,
            bridge_um: p.bridge_um.into(),
            peaks: p.peaks.into(),
            sign: if p.gap_reversed { -1.0 } else { 1.0 },
        };
        Spark {
            phase: Phase::Off { due: 0.0 },
            gate: (0.0, 0.0),
            stretches: vec![Stretch { from: 0.0, volts: 0.0, initial: 0.0, rise: c.rise, gate: (0.0, 0.0) }],
            bridge: None,
            debris: Debris::new(p),
            removed_um: 0.0,
            wear_um: 0.0,
            pulses: Pulses::default(),
            last: (false, false),
            shorts_in_a_row: 0,
            forced_short: false,
            dead: false,
            senseless: false,
            forced_arcs: 0.0,
            held: false,
            ignition: Cause::Ignition.stream(seed),
            arcs: Cause::Arc.stream(seed),
            bridges: Cause::Bridge.stream(seed),
            burns: Cause::Burn.stream(seed),
            c,
        }
    }

    /// From now on nothing but chance ignition at this concentration of debris: no removal, no bridges, no arcs.
    pub fn hold(&mut self, debris: f64) {
        self.debris.hold(debris);
        self.held = true;
    }

    /// Advances from `from` to `to` (us), with the gap at either end in um. `enabled` is the head's permission to pulse.
    pub fn advance(&mut self, from: f64, to: f64, gap: (f64, f64), enabled: bool) {
        self.stretches.drain(..self.stretches.len() - 1);
        self.debris.flush(to - from, self.removed_um, gap.1);
        let gap_um = 0.5 * (gap.0 + gap.1);
        let touching = self.forced_short || gap_um <= 0.0;
        let on = !matches!(self.phase, Phase::Off { .. });
        if !enabled || self.dead {
            if on {
                self.end_pulse(from);
            }
            self.last = (false, false);
            let senses = !enabled && !touching && !self.senseless;
            self.rest(from, if senses { self.c.sense } else { 0.0 });
            return;
        }
        if on && touching {
            self.touch(from);
        }
        let mut now = from;
        while let Some(at) = self.next(now, to, gap_um) {
            now = at;
            self.happen(at, gap_um, touching);
        }
    }

    /// No pulses: the gap shows what the sense supply gives.
    fn rest(&mut self, now: f64, volts: f64) {
        let volts = volts * self.c.sign;
        if let Some(last) = self.stretches.last().filter(|last| last.volts != volts) {
            let initial = last.at(now);
            self.stretches.push(Stretch { from: now, volts, initial, rise: self.c.rise, gate: self.gate });
        }
    }

    /// Ignitions per us of waiting.
    fn hazard(&self, gap_um: f64) -> f64 {
        if gap_um > self.c.reach {
            return 0.0;
        }
        (1.0 + self.c.ignition_debris * self.debris.concentration()) / mean_delay_us(self.c.ignition_scale, gap_um)
    }

    /// Time of the next event before `to`; waiting continues otherwise.
    fn next(&mut self, now: f64, to: f64, gap_um: f64) -> Option<f64> {
        let closes = self.gate.1;
        let at = match self.phase {
            Phase::Off { due } => due.max(now),
            Phase::Burning { .. } | Phase::Shorted => closes,
            Phase::Waiting { delay, since } => {
                let hazard = self.hazard(gap_um);
                let left = delay - (to - since) * hazard;
                if left > 0.0 && to <= closes {
                    self.phase = Phase::Waiting { delay: left, since: to };
                    return None;
                }
                (since + delay / hazard).min(closes)
            }
        };
        (at < to).then_some(at)
    }

    fn happen(&mut self, now: f64, gap_um: f64, touching: bool) {
        match self.phase {
            Phase::Off { .. } => self.begin_pulse(now, gap_um, touching),
            Phase::Waiting { .. } if now < self.gate.1 => {
                self.pulses.spark += 1;
                self.burn(now, false);
            }
            Phase::Waiting { .. } => {
                self.pulses.open += 1;
                self.end_pulse(now);
            }
            Phase::Burning { .. } | Phase::Shorted => self.end_pulse(now),
        }
    }

    fn begin_pulse(&mut self, now: f64, gap_um: f64, touching: bool) {
        self.gate = (now, now + self.c.on);
        // Every pulse draws the same numbers, so that its fate does not shift the fate of later ones.
        let delay: f64 = Exp1.sample(&mut self.ignition);
        let (arc, bridge): (f64, f64) = (self.arcs.random(), self.bridges.random());
        let (burned, arced) = std::mem::take(&mut self.last);

        self.bridge = self.bridge.filter(|bridge| now < bridge.until && gap_um < bridge.breaks_at_um);
        if !self.held && self.bridge.is_none() {
            let heights = gap_um / self.c.peaks;
            let touch = if heights < PEAKS { (-heights * heights).exp() } else { 0.0 };
            if bridge < self.c.bridge_chance * self.debris.concentration().powi(2) + touch {
                self.bridge = Some(self.new_bridge(now, gap_um));
            }
        }
        if touching || self.bridge.is_some() {
            return self.touch(now);
        }
        self.shorts_in_a_row = 0;
        let dirt = self.debris.concentration();
        let chance = if arced { self.c.arc_repeats * dirt.min(1.0) } else { self.c.arc_chance * dirt };
        if arc < self.forced_arcs || burned && !self.held && arc < chance {
            self.pulses.arc += 1;
            return self.burn(now, true);
        }
        self.enter(Phase::Waiting { delay, since: now }, now, self.c.open);
    }

    fn new_bridge(&mut self, now: f64, gap_um: f64) -> Bridge {
        let mut draw = || -> f64 { Exp1.sample(&mut self.bridges) };
        Bridge { until: now + draw() * self.c.bridge_us, breaks_at_um: gap_um.max(0.0) + draw() * self.c.bridge_um }
    }

    /// The rest of this pulse is short.
    fn touch(&mut self, now: f64) {
        if let Phase::Burning { since, removal } = self.phase {
            self.remove((now - since) * removal);
        } else if self.phase != Phase::Shorted {
            self.pulses.short += 1;
            self.shorts_in_a_row += 1;
        }
        if self.phase != Phase::Shorted {
            self.enter(Phase::Shorted, now, SHORT_V);
        }
    }

    fn burn(&mut self, now: f64, arc: bool) {
        let scatter: f64 = StandardNormal.sample(&mut self.burns);
        let (volts, share) = if arc { (self.c.arc_burn, self.c.arc_removal) } else { (self.c.burn, 1.0) };
        self.last = (true, arc);
        let removal = self.c.removal * share;
        self.enter(Phase::Burning { since: now, removal }, now, volts + self.c.scatter * scatter);
    }

    fn end_pulse(&mut self, now: f64) {
        if let Phase::Burning { since, removal } = self.phase {
            self.remove((now - since) * removal);
        }
        let suspended = self.c.suspend_after > 0 && self.shorts_in_a_row >= self.c.suspend_after;
        let off = if suspended { self.c.suspend } else { self.c.off };
        if suspended {
            self.shorts_in_a_row = 0;
        }
        let volts = if self.phase == Phase::Shorted || self.senseless { 0.0 } else { self.c.sense };
        self.gate = (now, now);
        self.enter(Phase::Off { due: now + off }, now, volts);
    }

    fn remove(&mut self, depth_um: f64) {
        if self.held {
            return;
        }
        self.removed_um += depth_um;
        self.wear_um += depth_um * self.c.wear;
        self.debris.add(depth_um);
    }

    fn enter(&mut self, phase: Phase, now: f64, volts: f64) {
        self.phase = phase;
        let initial = self.stretches.last().map_or(0.0, |last| last.at(now));
        let (volts, rise) = (volts * self.c.sign, self.c.rise);
        self.stretches.push(Stretch { from: now, volts, initial, rise, gate: self.gate });
    }
}

#[cfg(test)]
mod tests;

//! The generator, and what each pulse becomes.
//!
//! A pulse begins with the generator's gate. If electrode and work touch, or a bridge joins them, it is *short*. It is an
//! *arc* when the channel of the last discharge has not recovered: lower voltage, little removal, and mostly no delay; one after
//! another is a *stable* arc. Otherwise it waits; ignited in time it is a *spark*, else it stays *open*. Some sparks do not wait,
//! and some arcs do, so that a delay alone does not tell one from the other. A pulse that the head cuts off before it ignites is
//! none of these.
//!
//! Ignition is a hazard that runs while the pulse waits, so a gap that moves meanwhile counts as it moves. It goes with the
//! cube of the field, so while the voltage rises, time counts for less: the integral of (1 - e^-t)^3. It counts from
//! the burn voltage on: below that no channel could burn.

use crate::gap::{Discharge, Gap};
use crate::math::{exponents, gone};
use crate::parameters::{Kind, Parameters};
use crate::random::{Cause, Stream};

/// Time constants of the edge after which a stretch counts as settled: 3e-4 of the step.
const SETTLED: f64 = 8.0;
/// Time constants by which a rising voltage delays ignition.
const RISE_DELAYS: f64 = 11.0 / 6.0;
/// Longest pause between two pulses that the head may make, us: if it inhibits the generator longer, or within a pulse, the next pulse
/// finds no channel (assumed).
const PAUSE_US: f64 = 1200.0;
/// Shortest delay of an arc that has one, us.
const LATE_US: f64 = 0.2;
/// Time constants after which a channel has recovered, or a capacitor is charged.
const OVER: f64 = 40.0;

/// What became of a pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// Never ignited.
    Open,
    /// Ignited where the field was high, mostly after a delay.
    Spark,
    /// Ignited at the spot of the last spark, mostly at once.
    Arc,
    /// Ignited at the spot of the last arc, mostly at once.
    StableArc,
    /// Electrode and work touched, or a bridge joined them.
    Short,
}

/// Pulses by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pulses {
    /// [`Class::Open`].
    pub open: u64,
    /// [`Class::Spark`].
    pub spark: u64,
    /// [`Class::Arc`] and [`Class::StableArc`].
    pub arc: u64,
    /// [`Class::StableArc`].
    pub stable_arc: u64,
    /// [`Class::Short`].
    pub short: u64,
}

impl Pulses {
    /// All of them.
    pub fn total(&self) -> u64 {
        self.open + self.spark + self.arc + self.short
    }

    /// Sparks and arcs.
    pub fn discharges(&self) -> u64 {
        self.spark + self.arc
    }

    /// Pulses of each class that have come since an earlier look. 0 of a class of which the earlier look had one more: where the permission changes,
    /// the pulse under way is made again, and may become another one.
    pub fn since(&self, earlier: &Pulses) -> Pulses {
        Pulses {
            open: self.open.saturating_sub(earlier.open),
            spark: self.spark.saturating_sub(earlier.spark),
            arc: self.arc.saturating_sub(earlier.arc),
            stable_arc: self.stable_arc.saturating_sub(earlier.stable_arc),
            short: self.short.saturating_sub(earlier.short),
        }
    }

    /// The sum of two.
    pub fn plus(&self, other: &Pulses) -> Pulses {
        Pulses {
            open: self.open + other.open,
            spark: self.spark + other.spark,
            arc: self.arc + other.arc,
            stable_arc: self.stable_arc + other.stable_arc,
            short: self.short + other.short,
        }
    }

    fn count(&mut self, class: Class) {
        match class {
            Class::Open => self.open += 1,
            Class::Spark => self.spark += 1,
            Class::Arc => self.arc += 1,
            Class::StableArc => {
                self.arc += 1;
                self.stable_arc += 1;
            }
            Class::Short => self.short += 1,
        }
    }
}

/// Voltage or current that nears an end.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Edge {
    /// Where it began.
    pub from: f64,
    /// What it tends to.
    pub to: f64,
    /// Time constant of that, us.
    pub us: f64,
}

impl Edge {
    /// Value so many microseconds after it began.
    #[inline]
    pub fn at(&self, us: f64) -> f64 {
        if us > SETTLED * self.us { self.to } else { self.to + (self.from - self.to) * libm::exp(-us / self.us) }
    }
}

/// A stretch of constant gap condition; times in us since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stretch {
    /// When it began.
    pub from: f64,
    /// Gap voltage, V.
    pub volts: Edge,
    /// Gap current, A.
    pub amps: Edge,
    /// When the generator's gate opened and will close, the same time twice while it is off.
    pub gate: (f64, f64),
}

impl Stretch {
    /// Gap voltage and current at a time inside the stretch: mostly both are settled.
    #[inline]
    fn at(&self, us: f64) -> (f64, f64) {
        let age = us - self.from;
        let longer = if self.volts.us > self.amps.us { self.volts.us } else { self.amps.us };
        if age > SETTLED * longer { (self.volts.to, self.amps.to) } else { (self.volts.at(age), self.amps.at(age)) }
    }

    /// Gap voltage at a time inside the stretch, V.
    pub fn volts_at(&self, us: f64) -> f64 {
        self.volts.at(us - self.from)
    }

    /// Gap current at a time inside the stretch, A.
    pub fn amps_at(&self, us: f64) -> f64 {
        self.amps.at(us - self.from)
    }
}

/// Observer of the gap. All times in us since the start, in order.
pub trait Wires {
    /// From now on the gap shows this.
    fn stretch(&mut self, stretch: &Stretch);
    /// A pulse has become something.
    fn pulse(&mut self, _class: Class, _us: f64) {}
}

/// No observer.
impl Wires for () {
    fn stretch(&mut self, _stretch: &Stretch) {}
}

/// What the head and the wires ask of the generator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orders {
    /// Pulses may be made.
    pub pulses: bool,
    /// Off-time instead of the set one, us.
    pub off_us: Option<f64>,
    /// Least off-time after a pulse that stayed open, a spark, an arc, a short, us: the generator is inhibited until then.
    pub pauses_us: [f64; 4],
    /// Something lies across the gap.
    pub shorted: bool,
    /// The generator makes no pulses, even if allowed.
    pub dead: bool,
    /// The contact sense supply gives nothing.
    pub senseless: bool,
    /// Share of the pulses that arc whatever the gap is like.
    pub arcs: f64,
}

impl Default for Orders {
    fn default() -> Orders {
        Orders {
            pulses: true,
            off_us: None,
            pauses_us: [0.0; 4],
            shorted: false,
            dead: false,
            senseless: false,
            arcs: 0.0,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Gate off; the next pulse is due.
    Off { due: f64 },
    /// Gate on, not ignited. It ignites when the hazard reaches -ln(1 - draw); `spent` of it has run when `counted` of the
    /// time had counted.
    Waiting { draw: f64, spent: f64, counted: f64 },
    /// Gate on; it ignites at a time, at a place.
    Fated { at: f64, facet: usize, class: Class },
    /// Burning since a time, until a time unless cut off; `watts` of power, or `energy` at once.
    Burning { since: f64, ends: f64, facet: usize, watts: f64, energy: f64, arc: bool },
    /// The capacitor has nothing left for the rest of the gate.
    Drained,
    /// Shorted.
    Shorted,
}

/// Voltage that rises from `origin` with a time constant: 1 - e^-x of the end. Time under it counts with the cube of that.
#[derive(Clone, Copy, Debug)]
struct Rise {
    origin: f64,
    us: f64,
    per_us: f64,
    /// What would have counted until a channel can burn, us: it does not count.
    idle: f64,
}

impl Rise {
    /// From an origin with a time constant, of which the first `idle` do not count.
    fn new(origin: f64, us: f64, idle: f64) -> Rise {
        Rise { origin, us, per_us: 1.0 / us, idle: us * idle }
    }

    /// Time constants that do not count where nothing counts below this share of the end, from 0 to below 1.
    fn idle(burns: f64) -> f64 {
        if burns > 0.0 { Rise::integral(exponents(burns)).0 } else { 0.0 }
    }

    /// Time that has counted so many time constants after the origin, in time constants, and the cube of the voltage: the
    /// integral of (1 - e^-x)^3.
    fn integral(x: f64) -> (f64, f64) {
        let g = gone(x);
        let e = 1.0 - g;
        (x - g * (3.0 - 1.5 * (1.0 + e) + (1.0 + e + e * e) * (1.0 / 3.0)), g * g * g)
    }

    /// Time that has counted at a time, us.
    #[inline]
    fn counted(&self, now: f64) -> f64 {
        let waited = now - self.origin;
        let x = waited * self.per_us;
        let all = if x > OVER { waited - RISE_DELAYS * self.us } else { self.us * Rise::integral(x.max(0.0)).0 };
        if all > self.idle { all - self.idle } else { 0.0 }
    }

    /// When so much will have counted.
    fn when(&self, counted: f64) -> f64 {
        let wanted = (counted + self.idle) * self.per_us;
        let mut x = wanted + RISE_DELAYS;
        if x < OVER {
            // Newton on a convex function; for small x the integral is a quarter of the fourth power.
            if wanted < 1.0 {
                x = (4.0 * wanted).sqrt().sqrt();
            }
            for _ in 0..8 {
                let (at, slope) = Rise::integral(x);
                let by = (at - wanted) / slope.max(1e-30);
                x -= by;
                if by.abs() < 1e-9 {
                    break;
                }
            }
        }
        self.origin + x * self.us
    }
}

/// The last discharge.
#[derive(Clone, Copy, Debug)]
struct Last {
    facet: usize,
    ended: f64,
    arc: bool,
    burned: f64,
}

/// Constants of an RC generator; without a capacitor they are unused.
#[derive(Clone, Copy, Debug)]
struct Capacitor {
    /// One over the time constant of its charging, 1/us.
    per_us: f64,
    /// Time in which a discharge is over, us: half a period of its circuit.
    discharge_us: f64,
    /// Peak current over the voltage that falls, A/V.
    amps_per_volt: f64,
    /// Its voltage at a time.
    stored: (f64, f64),
    /// How many time constants it was charged last, and the share of the voltage that came of it.
    charging: (f64, f64),
}

impl Capacitor {
    fn new(p: &Parameters) -> Capacitor {
        let (farad, henry) = (p.capacitor_pf * 1e-12, p.loop_nh * 1e-9);
        Capacitor {
            per_us: 1e-6 / (p.capacitor_ohm * farad),
            discharge_us: p.discharge_us(),
            amps_per_volt: (farad / henry).sqrt(),
            stored: (0.0, -1e12),
            charging: (0.0, 0.0),
        }
    }

    /// Its voltage while it is charged.
    #[inline]
    fn charged(&mut self, now: f64, open_v: f64) -> f64 {
        let (volts, at) = self.stored;
        if volts == open_v {
            return volts;
        }
        let x = (now - at) * self.per_us;
        if x > OVER {
            return open_v;
        }
        // Off-times repeat.
        if x != self.charging.0 {
            self.charging = (x, gone(x));
        }
        volts + (open_v - volts) * self.charging.1
    }
}

/// State of the generator.
#[derive(Clone, Debug)]
pub struct Generator {
    p: Parameters,
    capacitor: Capacitor,
    phase: Phase,
    gate: (f64, f64),
    rise: Rise,
    /// See [`Rise::idle`]: of the share of the open-circuit voltage below which nothing ignites.
    idle: f64,
    /// Time constants in which a voltage rises to that.
    burns_from: f64,
    now: Stretch,
    last: Option<Last>,
    /// When the last discharge ended.
    ended: f64,
    shorts_in_a_row: u32,
    /// Classes so far.
    pub pulses: Pulses,
    /// Energy of all discharges, uJ.
    pub energy: f64,
    held: bool,
    ignition: Stream,
    place: Stream,
    arcs: Stream,
    burns: Stream,
    prompt: Stream,
}

impl Generator {
    /// Gate off.
    pub fn new(p: &Parameters, seed: u64) -> Generator {
        let burns = p.ignites_above * p.burn_v / p.open_v;
        let idle = Rise::idle(burns);
        Generator {
            p: *p,
            capacitor: Capacitor::new(p),
            phase: Phase::Off { due: 0.0 },
            gate: (0.0, 0.0),
            rise: Rise::new(0.0, p.cable_us, idle),
            idle,
            burns_from: exponents(burns),
            now: Stretch {
                volts: Edge { us: p.cable_us, ..Edge::default() },
                amps: Edge { us: p.cable_us, ..Edge::default() },
                ..Stretch::default()
            },
            last: None,
            ended: -1e12,
            shorts_in_a_row: 0,
            pulses: Pulses::default(),
            energy: 0.0,
            held: false,
            ignition: Stream::new(Cause::Ignition, seed),
            place: Stream::new(Cause::Place, seed),
            arcs: Stream::new(Cause::Arc, seed),
            burns: Stream::new(Cause::Burn, seed),
            prompt: Stream::new(Cause::Prompt, seed),
        }
    }

    /// What it is set to.
    pub(crate) fn parameters(&self) -> &Parameters {
        &self.p
    }

    /// It is set anew, from the next pulse on.
    pub(crate) fn set(&mut self, p: &Parameters) {
        self.p = *p;
    }

    /// Chance ignition only.
    pub fn hold(&mut self) {
        self.held = true;
    }

    /// What the gap shows now.
    pub fn stretch(&self) -> &Stretch {
        &self.now
    }

    /// Advances from `from` to `to`.
    #[inline]
    pub fn advance(&mut self, from: f64, to: f64, gap: &mut Gap, orders: &Orders, wires: &mut impl Wires) {
        let touching = orders.shorted || gap.touches();
        let on = !matches!(self.phase, Phase::Off { .. });
        if !orders.pulses || orders.dead {
            if on {
                self.end_pulse(from, gap, orders, wires);
            }
            // In a pause between two pulses a channel recovers in its own time.
            self.last = self.last.filter(|last| !on && from - last.ended < PAUSE_US);
            let senses = !orders.pulses && !touching && !orders.senseless;
            let volts = if senses { self.p.sense_v } else { 0.0 };
            if self.now.volts.to != volts {
                self.show(from, volts, self.p.cable_us, 0.0, wires);
            }
            return;
        }
        if on && touching && self.phase != Phase::Shorted {
            self.short(from, gap, wires);
        }
        let mut now = from;
        loop {
            let closes = self.gate.1;
            let at = match self.phase {
                Phase::Off { due } => due.max(now),
                Phase::Burning { ends, .. } => ends,
                Phase::Drained | Phase::Shorted => closes,
                Phase::Fated { at, .. } => at.min(closes),
                Phase::Waiting { draw, spent, counted } => {
                    let rate = gap.rate(now - self.ended);
                    let will_have = self.rise.counted(closes.min(to));
                    let all = spent + rate * (will_have - counted);
                    // -ln(1 - x) is more than x: most pulses that stay open need no logarithm.
                    let target = if draw < all { -libm::log(1.0 - draw) } else { f64::INFINITY };
                    if target < all {
                        self.rise.when(counted + (target - spent) / rate).clamp(now, closes.min(to))
                    } else if to <= closes {
                        self.phase = Phase::Waiting { draw, spent: all, counted: will_have };
                        return;
                    } else {
                        closes
                    }
                }
            };
            if at >= to {
                return;
            }
            now = at;
            match self.phase {
                Phase::Off { .. } => self.begin_pulse(now, gap, touching, orders.arcs, wires),
                Phase::Waiting { .. } if now < closes => {
                    let facet = gap.surface.pick(self.place.unit());
                    self.ignite(now, facet, Class::Spark, wires);
                }
                Phase::Fated { facet, class, .. } if now < closes => self.ignite(now, facet, class, wires),
                Phase::Waiting { .. } | Phase::Fated { .. } => {
                    self.count(Class::Open, now, wires);
                    self.end_pulse(now, gap, orders, wires);
                }
                Phase::Burning { .. } if now < closes => self.drained(now, gap, touching, orders.arcs, wires),
                Phase::Burning { .. } | Phase::Drained | Phase::Shorted => self.end_pulse(now, gap, orders, wires),
            }
        }
    }

    #[inline]
    fn count(&mut self, class: Class, now: f64, wires: &mut impl Wires) {
        self.pulses.count(class);
        wires.pulse(class, now);
    }

    /// The gap shows another voltage, and a current that changes as fast.
    #[inline]
    fn show(&mut self, now: f64, volts: f64, us: f64, amps: f64, wires: &mut impl Wires) {
        let (from, flowing) = self.now.at(now);
        let amps = Edge { from: flowing, to: amps, us: self.p.cable_us };
        self.now = Stretch { from: now, volts: Edge { from, to: volts, us }, amps, gate: self.gate };
        wires.stretch(&self.now);
    }

    /// The same while the capacitor discharges: a current that begins at its peak and dies.
    fn show_discharge(&mut self, now: f64, volts: f64, peak: f64, us: f64, wires: &mut impl Wires) {
        let from = self.now.volts_at(now);
        let volts = Edge { from, to: volts, us: self.p.cable_us };
        self.now = Stretch { from: now, volts, amps: Edge { from: peak, to: 0.0, us }, gate: self.gate };
        wires.stretch(&self.now);
    }

    #[inline]
    fn begin_pulse(&mut self, now: f64, gap: &mut Gap, touching: bool, arcs: f64, wires: &mut impl Wires) {
        let p = &self.p;
        let fixed = matches!(p.kind, Kind::IsoFrequency | Kind::ControlledRc);
        self.gate = (now, now + if fixed { p.on_us } else { p.wait_us });
        let rise = gap.charging_us();
        let (mut open, mut origin) = (p.open_v, now);
        if p.kind == Kind::ControlledRc {
            open = self.capacitor.charged(now, p.open_v);
            self.capacitor.stored = (open, now);
        } else if p.kind == Kind::Rc {
            // The gap shows the capacitor, which has been charged since it was empty.
            origin = self.capacitor.stored.1;
        }
        if touching || gap.bridged() {
            return self.short(now, gap, wires);
        }
        self.shorts_in_a_row = 0;
        let last = self.last.take();
        // Without the order nothing is drawn for it: the run of a seed stays what it was.
        if arcs > 0.0 && self.arcs.unit() < arcs {
            let facet = last.map_or_else(|| gap.surface.pick(self.place.unit()), |last| last.facet);
            return self.begin_arc(now, facet, last.is_some_and(|last| last.arc), (open, rise), wires);
        }
        if let Some(last) = last {
            // A capacitor that is charged over the gap has no off-time: the voltage comes back by itself.
            let recovered = now - last.ended + if p.kind == Kind::Rc { RISE_DELAYS * rise } else { 0.0 };
            let over = recovered / gap.recovery_us(last.facet, last.burned, now);
            if !self.held && over < OVER && self.arcs.unit() < libm::exp(-over) {
                return self.begin_arc(now, last.facet, last.arc, (open, rise), wires);
            }
        }
        self.rise =
            if rise == self.rise.us { Rise { origin, ..self.rise } } else { Rise::new(origin, rise, self.idle) };
        let counted = if origin < now { self.rise.counted(now) } else { 0.0 };
        let draw = self.ignition.unit();
        // One that would ignite in the gap of now does so at once. A capacitor that is charged over the gap has no beginning.
        if p.kind != Kind::Rc && self.prompt.unit() < p.prompt_sparks {
            let waits = self.rise.counted(self.gate.1);
            if draw < gone(gap.rate(now - self.ended) * waits) {
                let (at, facet) = (now + rise * self.burns_from, gap.surface.pick(self.place.unit()));
                self.phase = Phase::Fated { at, facet, class: Class::Spark };
                return self.show(now, open, rise, 0.0, wires);
            }
        }
        self.phase = Phase::Waiting { draw, spent: 0.0, counted };
        self.show(now, open, rise, 0.0, wires);
    }

    fn ignite(&mut self, now: f64, facet: usize, class: Class, wires: &mut impl Wires) {
        self.count(class, now, wires);
        self.burn(now, facet, class != Class::Spark, wires);
    }

    /// A pulse becomes an arc, at once or after a delay in which it has a voltage that rises so.
    fn begin_arc(&mut self, now: f64, facet: usize, stays: bool, (open, us): (f64, f64), wires: &mut impl Wires) {
        let class = if stays { Class::StableArc } else { Class::Arc };
        if self.p.kind == Kind::Rc || self.prompt.unit() >= self.p.late_arcs {
            return self.ignite(now, facet, class, wires);
        }
        let at = now + LATE_US + (self.p.late_arc_us - LATE_US) * self.prompt.unit();
        self.phase = Phase::Fated { at, facet, class };
        self.show(now, open, us, 0.0, wires);
    }

    /// The rest of this pulse is short.
    #[inline(never)]
    fn short(&mut self, now: f64, gap: &mut Gap, wires: &mut impl Wires) {
        if !self.strike(now, gap) && !matches!(self.phase, Phase::Drained) {
            self.count(Class::Short, now, wires);
            self.shorts_in_a_row += 1;
        }
        self.phase = Phase::Shorted;
        let p = &self.p;
        let (short, cable, ohm) = (p.short_v, p.cable_us, p.burn_ohm);
        match p.kind {
            Kind::ControlledRc => {
                let volts = self.capacitor.stored.0;
                self.capacitor.stored = (0.0, now);
                let us = ohm * p.capacitor_pf * 1e-6;
                self.show_discharge(now, 0.0, volts / ohm, us, wires);
            }
            Kind::Rc => {
                let amps = p.open_v / p.capacitor_ohm;
                self.capacitor.stored = (0.0, now);
                self.show(now, short, cable, amps, wires);
            }
            _ => {
                let amps = (p.open_v - short) / ohm;
                self.show(now, short, cable, amps, wires);
            }
        }
    }

    fn burn(&mut self, now: f64, facet: usize, arc: bool, wires: &mut impl Wires) {
        let p = &self.p;
        let scatter = if p.burn_scatter_v > 0.0 { p.burn_scatter_v * self.burns.step() } else { 0.0 };
        let volts = (if arc { p.arc_v } else { p.burn_v }) + scatter;
        let (mut watts, mut energy, mut ends) = (0.0, 0.0, self.gate.1);
        if matches!(p.kind, Kind::ControlledRc | Kind::Rc) {
            let stored =
                if p.kind == Kind::Rc { self.capacitor.charged(now, p.open_v) } else { self.capacitor.stored.0 };
            let volts = volts.min(stored);
            energy = p.capacitor_uj(stored, volts);
            let peak = (stored - volts) * self.capacitor.amps_per_volt;
            ends = ends.min(now + self.capacitor.discharge_us);
            self.capacitor.stored = (0.0, now);
            self.show_discharge(now, volts, peak, self.capacitor.discharge_us, wires);
        } else {
            let amps = (p.open_v - volts) / p.burn_ohm;
            watts = volts * amps;
            if p.kind == Kind::IsoEnergy {
                self.gate.1 = now + p.on_us;
                ends = self.gate.1;
            }
            let cable = p.cable_us;
            self.show(now, volts, cable, amps, wires);
        }
        self.phase = Phase::Burning { since: now, ends, facet, watts, energy, arc };
    }

    /// What burns has ended now. Whether anything burned.
    #[inline]
    fn strike(&mut self, now: f64, gap: &mut Gap) -> bool {
        let Phase::Burning { since, facet, watts, energy, arc, .. } = self.phase else { return false };
        let energy = energy + watts * (now - since);
        self.energy += energy;
        let burned = now - since;
        gap.strike(Discharge { facet, energy, arc, burned_us: burned, at_us: now });
        self.last = Some(Last { facet, ended: now, arc, burned });
        self.ended = now;
        true
    }

    /// A capacitor's discharge is over before its gate is.
    fn drained(&mut self, now: f64, gap: &mut Gap, touching: bool, arcs: f64, wires: &mut impl Wires) {
        self.strike(now, gap);
        if self.p.kind == Kind::Rc {
            self.capacitor.stored = (0.0, now);
            self.begin_pulse(now, gap, touching, arcs, wires);
        } else {
            self.phase = Phase::Drained;
            self.show(now, 0.0, self.p.cable_us, 0.0, wires);
        }
    }

    /// Least off-time after the pulse that ends, us.
    fn pause(&self, orders: &Orders) -> f64 {
        let [open, spark, arc, short] = orders.pauses_us;
        match self.phase {
            Phase::Off { .. } => 0.0,
            Phase::Waiting { .. } | Phase::Fated { .. } => open,
            Phase::Burning { arc: true, .. } => arc,
            Phase::Burning { .. } => spark,
            Phase::Drained if self.last.is_some_and(|last| last.arc) => arc,
            Phase::Drained => spark,
            Phase::Shorted => short,
        }
    }

    #[inline]
    fn end_pulse(&mut self, now: f64, gap: &mut Gap, orders: &Orders, wires: &mut impl Wires) {
        let pause = self.pause(orders);
        self.strike(now, gap);
        let p = &self.p;
        let suspended = p.suspend_after > 0.0 && f64::from(self.shorts_in_a_row) >= p.suspend_after;
        let off = match p.kind {
            _ if suspended => p.suspend_ms * 1e3,
            // It has none; a pulse that stays open just goes on, and one that is short is looked at again.
            Kind::Rc => 0.0,
            _ => orders.off_us.unwrap_or(p.off_us).max(pause),
        };
        if suspended {
            self.shorts_in_a_row = 0;
        }
        self.gate = (now, now);
        let volts = if self.phase == Phase::Shorted || orders.senseless { 0.0 } else { p.sense_v };
        if p.kind == Kind::ControlledRc || self.phase == Phase::Shorted {
            self.capacitor.stored.1 = now;
        }
        self.phase = Phase::Off { due: now + off };
        if p.kind != Kind::Rc || suspended {
            let cable = p.cable_us;
            self.show(now, volts, cable, 0.0, wires);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_counts_with_the_cube_of_a_rising_voltage() {
        // From the beginning, and from 40 % of the end on.
        for burns in [0.0, 0.4] {
            let rise = Rise::new(100.0, 3.0, Rise::idle(burns));
            let (mut sum, mut last) = (0.0, 0.0);
            const STEP_US: f64 = 0.001;
            for k in 0..150_000 {
                let g = gone((f64::from(k) + 0.5) * STEP_US / 3.0);
                sum += if g < burns { 0.0 } else { g * g * g * STEP_US };
                if k % 997 == 0 {
                    let now = 100.0 + f64::from(k + 1) * STEP_US;
                    let counted = rise.counted(now);
                    // A step in which it begins to count may be off by itself.
                    let off = 1e-6 + burns * burns * burns * STEP_US;
                    assert!((counted - sum).abs() < off && counted >= last, "{now}: {counted} {sum}");
                    // Back again, but where next to nothing has counted.
                    assert!(counted < 1e-6 || (rise.when(counted) - now).abs() < 1e-5, "{now} {}", rise.when(counted));
                    last = counted;
                }
            }
        }
    }
}

//! What is between electrode and work: surfaces, fluid, bridges, the slow disturbance.
//!
//! Gap, debris and rates are updated every `step_us`, and steady in between.

mod fluid;
mod surface;

pub use fluid::{Film, REFERENCE};

use crate::math::gone;
use crate::parameters::{Kind, Parameters};
use crate::random::{Cause, Stream};
use fluid::Fluid;
use std::f64::consts::TAU;
use surface::Surface;

/// Facets of the face.
pub const FACETS: usize = 16;

/// Debris that joins electrode and work.
#[derive(Clone, Copy, Debug)]
struct Bridge {
    until_us: f64,
    tears_at_um: f64,
}

/// Time in which the power density that a face bears is averaged, us (assumed).
const BEARS_US: f64 = 50e3;

/// Heat of an arc's place at which a run of arcs is over, in clean gap's recovery times (assumed).
const COLD: f64 = 0.1;

/// Place of the last arc.
#[derive(Clone, Copy, Debug, Default)]
struct Hot {
    facet: usize,
    /// Heat at a time, in clean gap's recovery times.
    heat: f64,
    at_us: f64,
    /// Gap in which the first of a run struck, um.
    gap_um: f64,
    /// Volume that the run has taken, um^3.
    taken: f64,
}

/// State of the gap.
#[derive(Clone, Debug)]
pub struct Gap {
    p: Parameters,
    pub(crate) surface: Surface,
    pub(crate) fluid: Fluid,
    bridge: Option<Bridge>,
    /// The slow disturbance, of mean 0 and deviation 1; what a step leaves of it.
    slow: f64,
    slow_keeps: (f64, f64),
    /// Electrode carrier, um, at the last look and now.
    looked_at: f64,
    carrier: f64,
    gap_um: f64,
    /// The gap as bridges and arcs feel it.
    slow_gap_um: f64,
    slow_gap_keeps: f64,
    hot: Hot,
    /// Deepest pit of a run of arcs, um; area of a place, um^2.
    pit_um: f64,
    spot_um2: f64,
    /// Energy of a step, uJ; mean power density, W/mm^2, and what a step leaves of it; share of removal that it allows.
    power: (f64, f64, f64, f64),
    /// Burning time whose recovery time is that of the parameters, us: the on-time or, of a capacitor, its discharge.
    full_on_us: f64,
    /// Rate at which bridges form, over `bridge_hz`.
    forms: f64,
    /// Debris of the front in 5 %, and mean damage, at the last look.
    pub(crate) seen: (f64, f64),
    /// Gap in which a discharge's own debris is as much as 5 %, um.
    own_dirt_um: f64,
    /// One over the time for which a bubble veils the face, 1/us.
    per_veil: f64,
    held: bool,
    slow_random: Stream,
    bridges: Stream,
}

/// A discharge that has ended.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Discharge {
    pub facet: usize,
    /// uJ.
    pub energy: f64,
    pub arc: bool,
    /// How long it burned and when it ended, us.
    pub burned_us: f64,
    pub at_us: f64,
}

impl Gap {
    /// A clean gap with the electrode `gap_um` above the work; the surface begins at 0.
    pub fn new(p: &Parameters, gap_um: f64, seed: u64) -> Gap {
        let keeps = 1.0 - gone(p.step_us * 1e-6 * TAU * p.slow_hz);
        let mut gap = Gap {
            p: *p,
            surface: Surface::new(p, seed),
            fluid: Fluid::new(p, gap_um),
            bridge: None,
            slow: 0.0,
            slow_keeps: (keeps, (1.0 - keeps * keeps).sqrt()),
            looked_at: -gap_um,
            carrier: -gap_um,
            gap_um,
            slow_gap_um: gap_um,
            slow_gap_keeps: if p.tear_ms > 0.0 { libm::exp(-p.step_us / (p.tear_ms * 1e3)) } else { 0.0 },
            hot: Hot::default(),
            pit_um: 0.0,
            spot_um2: p.spot * libm::cbrt(p.crater_um3()) * libm::cbrt(p.crater_um3()),
            power: (0.0, 0.0, libm::exp(-p.step_us / BEARS_US), 1.0),
            full_on_us: match p.kind {
                Kind::ControlledRc => p.discharge_us(),
                // It has no on-time.
                Kind::Rc if p.recovery_rc > 0.0 => p.recovery_us / p.recovery_rc,
                _ => p.on_us,
            },
            forms: 0.0,
            seen: (0.0, 0.0),
            own_dirt_um: libm::cbrt(p.crater_um3()) / (p.spot * REFERENCE),
            per_veil: 1.0 / p.veil_us,
            held: false,
            slow_random: Stream::new(Cause::Slow, seed),
            bridges: Stream::new(Cause::Bridge, seed),
        };
        gap.look(0.0);
        gap
    }

    /// The generator is set anew: craters become larger or smaller. How long a channel recovers still goes with how long it burns, over
    /// the on-time of the machine.
    pub(crate) fn set(&mut self, p: &Parameters) {
        let across = libm::cbrt(p.crater_um3());
        self.p = *p;
        self.spot_um2 = p.spot * across * across;
        self.own_dirt_um = across / (p.spot * REFERENCE);
    }

    /// From now on nothing but chance ignition at this concentration of debris, in 5 %.
    pub fn hold(&mut self, dirt: f64) {
        (self.held, self.slow, self.bridge) = (true, 0.0, None);
        self.fluid.hold(dirt);
        self.look(0.0);
    }

    /// Mean gap with the carrier where it is, um.
    pub fn mean_um(&self) -> f64 {
        self.surface.depth_um() + self.surface.worn_um() - self.carrier
    }

    /// Depth of the hole, um.
    pub fn hole_um(&self) -> f64 {
        self.p.depth_um + self.surface.depth_um()
    }

    /// The carrier is here now, um below the first surface.
    pub fn place(&mut self, carrier_um: f64) {
        self.carrier = carrier_um;
    }

    /// Gap over the highest peak, um, with the carrier where it is: below zero electrode and work touch.
    pub fn least_um(&self) -> f64 {
        self.surface.least_um() - (self.carrier - self.looked_at)
    }

    /// Electrode and work touch.
    pub fn touches(&self) -> bool {
        self.least_um() <= 0.0
    }

    /// Distance of the solid surfaces with the carrier there, um: below zero they push. Peaks only touch.
    #[inline]
    pub fn solid_um(&self, carrier_um: f64) -> f64 {
        self.surface.solid_um() - (carrier_um - self.looked_at)
    }

    /// Electrode and work are joined by debris.
    #[inline]
    pub fn bridged(&self) -> bool {
        self.bridge.is_some()
    }

    /// Ignitions in a microsecond of waiting, so long after the last discharge.
    #[inline]
    pub fn rate(&self, since_us: f64) -> f64 {
        let rate = self.surface.rate();
        if since_us < self.p.veil_us { rate * (since_us * self.per_veil) } else { rate }
    }

    /// Time constant with which the voltage rises over the gap, us.
    pub fn charging_us(&self) -> f64 {
        self.p.charging_us(self.gap_um)
    }

    /// Time constant with which the last channel on a facet, which burned so long, recovers at a time, us.
    pub fn recovery_us(&self, facet: usize, burned_us: f64, now_us: f64) -> f64 {
        let debris = self.fluid.front().get(facet).copied().unwrap_or(0.0);
        let dirt = debris * self.fluid.dirt_per_debris() + self.own_dirt_um / self.gap_um.max(1.0);
        let clean = self.p.recovery_us * (1.0 + libm::pow(dirt, self.p.recovery_power) + self.surface.damage_at(facet));
        if self.p.recovery_heats == 0.0 && self.p.arc_heat == 0.0 {
            return clean;
        }
        let heat = if self.hot.facet == facet { self.heat(now_us) } else { 0.0 };
        if heat > self.p.arc_stays {
            return f64::INFINITY;
        }
        let hot = self.p.recovery_us * heat;
        let burned = burned_us / self.full_on_us;
        let power = self.p.recovery_heats;
        (clean + hot) * if power == 1.0 { burned } else { libm::pow(burned, power) }
    }

    /// Heat that the place of the last arc still has, in clean gap's recovery times.
    fn heat(&self, now_us: f64) -> f64 {
        let Hot { heat, at_us, gap_um, .. } = self.hot;
        if heat == 0.0 {
            return 0.0;
        }
        let opened = (self.slow_gap_um - gap_um).max(0.0) / self.p.arc_tear_um;
        heat * libm::exp(-(now_us - at_us) / (self.p.arc_cool_ms * 1e3) - opened)
    }

    /// An arc heats its place, which gives how many times it hurts it.
    fn scorch(&mut self, discharge: &Discharge, work: f64) -> f64 {
        if self.p.arc_heat == 0.0 {
            return 1.0;
        }
        let left = if self.hot.facet == discharge.facet { self.heat(discharge.at_us) } else { 0.0 };
        if left < COLD {
            self.hot = Hot { facet: discharge.facet, gap_um: self.slow_gap_um, ..Hot::default() };
        } else if self.slow_gap_um < self.hot.gap_um {
            self.hot.gap_um = self.slow_gap_um;
        }
        self.hot.heat = left + self.p.arc_heat * 1e-3 * discharge.burned_us;
        self.hot.at_us = discharge.at_us;
        self.hot.taken += work;
        self.pit_um = self.pit_um.max(self.hot.taken / self.spot_um2);
        1.0 + left
    }

    /// Depth of the deepest pit that arcs in one place have left, um.
    pub fn pit_um(&self) -> f64 {
        self.pit_um
    }

    /// A discharge has ended.
    pub(crate) fn strike(&mut self, discharge: Discharge) {
        if self.held {
            return;
        }
        let Discharge { facet, energy, arc, .. } = discharge;
        let p = &self.p;
        let undisturbed = energy * p.removal_um3_uj;
        let mut work = undisturbed * if arc { p.arc_share } else { 1.0 } * self.power.3;
        if p.hurt_half > 0.0 {
            // On carbon a spark takes that.
            work *= p.hurt_half / (p.hurt_half + self.surface.damage_at(facet));
        }
        let electrode = work * if p.negative > 0.0 { p.wear_negative } else { p.wear_positive };
        self.power.0 += energy;
        let hurts = arc.then(|| self.scorch(&discharge, work));
        self.surface.strike(facet, work, electrode, hurts);
        // Gas goes with the energy, not with the metal.
        self.fluid.enter(facet, work + electrode, undisturbed);
    }

    /// Advances by `us` to the time `now_us` and updates everything. `forming` says whether bridges can form: there is voltage.
    pub fn step(&mut self, us: f64, now_us: f64, forming: bool) {
        let p = &self.p;
        let mut gap = self.mean_um();
        if p.runout_um > 0.0 {
            gap -= p.runout_um * libm::sin(now_us * (TAU * 1e-3) / p.turn_ms);
        }
        self.gap_um = gap;
        self.slow_gap_um =
            if self.slow_gap_keeps > 0.0 { gap + (self.slow_gap_um - gap) * self.slow_gap_keeps } else { gap };
        if p.saturate_w_mm2 > 0.0 {
            // uJ/us are W.
            let density = std::mem::take(&mut self.power.0) / us / (p.area_um2() * 1e-6);
            self.power.1 = density + (self.power.1 - density) * self.power.2;
            let relative = self.power.1 / (p.saturate_w_mm2 * (1.0 + p.saturate_edge_um / p.radius_um));
            self.power.3 = 1.0 / (1.0 + relative);
            if p.gas_level_um_s > 0.0 {
                self.fluid.rises(self.power.1 * p.area_um2() * 1e-6 * p.removal_um3_uj);
            }
        }
        self.fluid.step(us, gap, self.hole_um(), self.surface.through());
        if !self.held {
            self.slow = self.slow * self.slow_keeps.0 + self.slow_keeps.1 * self.slow_random.step();
        }
        self.look(now_us);
        if self.held {
            return;
        }
        match self.bridge {
            Some(bridge) if self.slow_gap_um > bridge.tears_at_um || now_us > bridge.until_us => self.bridge = None,
            None if forming && self.bridges.unit() < self.forms * self.p.bridge_hz * us * 1e-6 => {
                self.bridge = Some(Bridge {
                    tears_at_um: self.slow_gap_um + self.p.tear_um * self.bridges.exponential(),
                    until_us: now_us + self.p.bridge_ms * 1e3 * self.bridges.exponential(),
                });
            }
            _ => {}
        }
    }

    fn look(&mut self, now_us: f64) {
        let s = if self.held { 0.0 } else { self.p.slow_log };
        // Of mean 1.
        let factor = libm::exp(s * self.slow - 0.5 * s * s);
        let dirt = self.fluid.dirt_per_debris();
        let heat = self.heat(now_us);
        if heat < COLD {
            self.hot.heat = 0.0;
        }
        let hot = (heat >= COLD).then_some((self.hot.facet, heat));
        self.forms = self.surface.look(self.gap_um, factor, self.fluid.front(), dirt, hot);
        self.looked_at = self.carrier;
        self.seen = (self.fluid.dirt(), self.surface.damage());
    }
}

//! Process model: simulated electrical discharge machining, pulse by pulse. It serves the simulator and the
//! modelled chip, which need a machine at the other end of the head's wires, and people who check it against publications.
//!
//! [`Process`] is the gap with its generator, [`axis::Axis`] what moves the electrode. The caller advances
//! both in its own steps: the axis under the drive's voltage and the film's force, then the process with the carrier
//! where the axis has taken it. What the gap shows reaches [`Wires`] as stretches of voltage and current, from which
//! converter, gate and comparator are simulated elsewhere.
//!
//! Terms: gap = surface - electrode face, x positive toward the work, 0 at the first surface; the *front* is the gap under
//! the electrode, the *side* that around it. *Dirt* is the debris of the front in units of 5 % by volume. Units: um, us, V,
//! A, uJ, um^3, where nothing else is said. Equations and numbers are in docs/process-model.md.
//!
//! The same parameters, seed and steps give the same bits on every machine: logarithms and exponentials come from a pinned
//! library, random numbers from another. Everything here is simulated.

#![forbid(unsafe_code)]

pub mod axis;
pub mod gap;
pub mod generator;
pub mod harness;
pub mod math;
pub mod parameters;
pub mod random;

pub use gap::Film;
pub use generator::{Class, Edge, Orders, Pulses, Stretch, Wires};
pub use parameters::{Kind, Parameters, Refused};

use gap::Gap;
use generator::Generator;

/// Generator, gap, fluid and material.
#[derive(Clone, Debug)]
pub struct Process {
    generator: Generator,
    gap: Gap,
    now_us: f64,
    /// Time of the next update of gap and fluid.
    look_us: f64,
    step_us: f64,
}

/// What of a generator is set anew.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setting {
    /// On-time, us.
    pub on_us: Option<f64>,
    /// Off-time, us.
    pub off_us: Option<f64>,
    /// Current of a spark, A.
    pub amps: Option<f64>,
    /// Voltage that a spark burns at, V.
    pub burn_v: Option<f64>,
    /// The electrode is negative.
    pub negative: Option<bool>,
}

/// What really is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Truth {
    /// Time since the start, s.
    pub t_s: f64,
    /// Mean gap, um; negative in contact.
    pub gap_um: f64,
    /// Smallest gap between peaks, um.
    pub least_um: f64,
    /// Depth removed from the work, um.
    pub depth_um: f64,
    /// Length the electrode has lost, um.
    pub worn_um: f64,
    /// Share of the face before which nothing is left.
    pub through: f64,
    /// Debris of the front, in 5 % by volume.
    pub dirt: f64,
    /// Mean damage by arcs; 1 doubles a clean channel's recovery time.
    pub damage: f64,
    /// Deepest pit that arcs in one place have left, um.
    pub pit_um: f64,
    /// Mean size of craters, um. Roughness goes with it; its size is not claimed.
    pub crater_um: f64,
    /// Energy of all discharges, J.
    pub energy_j: f64,
    /// Pulses so far.
    pub pulses: Pulses,
    /// Share of the debris made that no cell has.
    pub imbalance: f64,
}

impl Process {
    /// Generator off, clean fluid, electrode `gap_um` above the work. The same seed gives the same run.
    ///
    /// # Errors
    /// When a parameter does not fit.
    pub fn new(p: &Parameters, gap_um: f64, seed: u64) -> Result<Process, Refused> {
        p.check()?;
        Ok(Process {
            generator: Generator::new(p, seed),
            gap: Gap::new(p, gap_um, seed),
            now_us: 0.0,
            look_us: p.step_us,
            step_us: p.step_us,
        })
    }

    /// Sets a transistor generator anew while the process runs: what is given of on-time and off-time, us, current of a spark, A, and
    /// whether the electrode is negative. Best between pulses: one under way ends by its old times at the old power.
    ///
    /// # Errors
    /// What does not fit, and the generator stays as it is; one with a capacitor has other settings.
    pub fn set_generator(&mut self, set: &Setting) -> Result<(), Refused> {
        let mut p = *self.generator.parameters();
        if !matches!(p.kind, Kind::IsoFrequency | Kind::IsoEnergy) {
            return Err(Refused::Conflict("only a transistor generator can be set while the process runs"));
        }
        p.on_us = set.on_us.unwrap_or(p.on_us);
        p.off_us = set.off_us.unwrap_or(p.off_us);
        p.burn_v = set.burn_v.unwrap_or(p.burn_v);
        p.burn_ohm = set.amps.map_or(p.burn_ohm, |amps| (p.open_v - p.burn_v) / amps);
        p.negative = set.negative.map_or(p.negative, |negative| if negative { 1.0 } else { 0.0 });
        p.check()?;
        self.generator.set(&p);
        self.gap.set(&p);
        Ok(())
    }

    /// Holds the debris at `dirt`, without erosion, arcs, bridges and slow disturbance: chance ignition alone.
    pub fn hold(&mut self, dirt: f64) {
        self.gap.hold(dirt);
        self.generator.hold();
    }

    /// Advances by `us`, with the carrier of the electrode now `carrier_um` below the first surface.
    #[inline]
    pub fn advance(&mut self, us: f64, carrier_um: f64, orders: &Orders, wires: &mut impl Wires) {
        self.gap.place(carrier_um);
        let end = self.now_us + us;
        while self.look_us <= end {
            self.generator.advance(self.now_us, self.look_us, &mut self.gap, orders, wires);
            self.now_us = self.look_us;
            self.look_us += self.step_us;
            self.gap.step(self.step_us, self.now_us, orders.pulses && !orders.dead);
        }
        if self.now_us < end {
            self.generator.advance(self.now_us, end, &mut self.gap, orders, wires);
            self.now_us = end;
        }
    }

    /// Time since the start, us.
    pub fn now_us(&self) -> f64 {
        self.now_us
    }

    /// What the gap shows now.
    pub fn stretch(&self) -> &Stretch {
        self.generator.stretch()
    }

    /// Mean gap with the carrier where it is, um.
    pub fn gap_um(&self) -> f64 {
        self.gap.mean_um()
    }

    /// Pulses so far.
    pub fn pulses(&self) -> Pulses {
        self.generator.pulses
    }

    /// Depth removed from the work, um.
    pub fn depth_um(&self) -> f64 {
        self.gap.surface.depth_um()
    }

    /// Length the electrode has lost, um.
    pub fn worn_um(&self) -> f64 {
        self.gap.surface.worn_um()
    }

    /// Debris of the front, in 5 % by volume, at the last look.
    pub fn dirt(&self) -> f64 {
        self.gap.seen.0
    }

    /// Mean damage by arcs, at the last look.
    pub fn damage(&self) -> f64 {
        self.gap.seen.1
    }

    /// Share of the face before which nothing is left.
    pub fn through(&self) -> f64 {
        self.gap.surface.through()
    }

    /// What an electrode meets whose carrier is there, um below the first surface.
    #[inline]
    pub fn load(&self, carrier_um: f64) -> axis::Load {
        let gap_um = self.gap.solid_um(carrier_um);
        let film = self.gap.fluid.film(gap_um, self.gap.hole_um());
        axis::Load { force_n: 0.0, gap_um, film }
    }

    /// What really is.
    pub fn truth(&self) -> Truth {
        let surface = &self.gap.surface;
        Truth {
            t_s: self.now_us * 1e-6,
            gap_um: self.gap.mean_um(),
            least_um: self.gap.least_um(),
            depth_um: surface.depth_um(),
            worn_um: surface.worn_um(),
            through: surface.through(),
            dirt: self.gap.fluid.dirt(),
            damage: surface.damage(),
            pit_um: self.gap.pit_um(),
            crater_um: surface.crater_um(),
            energy_j: self.generator.energy * 1e-6,
            pulses: self.generator.pulses,
            imbalance: self.gap.fluid.imbalance(),
        }
    }
}

#[cfg(test)]
mod tests;

//! The model's version, and a fingerprint by which a changed model is noticed.
//!
//! The fingerprint is a hash over all numbers, over runs of the process with its axis in which every mechanism acts
//! (`RUNS`), and over runs under the servo of the gates. Its tests change every number, order and load by itself, and
//! want the fingerprint to change.
//!
//! A change of any parameter or equation is a new version, with its own fit and gates: run `fit`, then `model-report`, and
//! add its fingerprint here. A version that is there keeps its own, bit for bit.

use crate::axis::{Axis, Load, Winding};
use crate::harness::{Law, Motion, Rig, Voltage};
use crate::parameters::{DECLARED, GAO, GAO_CLEAR, MACHINES, OF_VERSION_1, SINKER, XIN};
use crate::{Class, Kind, Orders, Parameters, Process, Refused, Stretch, Wires};

/// Version of the model that a scenario has unless it names another; 0 is the one in host/sim.
pub const VERSION: u32 = 2;
/// Versions of the model and their [`fingerprint`].
pub const FINGERPRINTS: [(u32, u64); 2] = [(1, 0xfe0d_b586_ca68_88b9), (2, 0x0dca_08ea_a2a9_c02a)];

/// FNV-1a over what it is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Hash(u64);

impl Hash {
    const NEW: Hash = Hash(0xcbf2_9ce4_8422_2325);

    fn word(&mut self, word: u64) {
        for byte in word.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    fn reals(&mut self, reals: &[f64]) {
        reals.iter().for_each(|real| self.word(real.to_bits()));
    }

    /// State of a process, bit by bit.
    fn process(&mut self, process: &Process) {
        let t = process.truth();
        let n = t.pulses;
        self.reals(&[
            t.gap_um,
            t.least_um,
            t.depth_um,
            t.worn_um,
            t.through,
            t.dirt,
            t.damage,
            t.crater_um,
            t.energy_j,
        ]);
        self.reals(&[process.dirt(), process.damage()]);
        if t.pit_um > 0.0 {
            self.reals(&[t.pit_um]);
        }
        [n.open, n.spark, n.arc, n.stable_arc, n.short].into_iter().for_each(|n| self.word(n));
    }
}

impl Wires for Hash {
    fn stretch(&mut self, stretch: &Stretch) {
        let Stretch { from, volts, amps, gate } = *stretch;
        self.reals(&[from, volts.from, volts.to, volts.us, amps.from, amps.to, amps.us, gate.0, gate.1]);
    }

    fn pulse(&mut self, class: Class, us: f64) {
        self.word(class as u64);
        self.reals(&[us]);
    }
}

/// Result of a run under the gates' servo, bit by bit.
pub fn outcome(rig: &Rig) -> u64 {
    let mut hash = Hash::NEW;
    hash.process(&rig.process);
    hash.reals(&[rig.x, rig.volts]);
    hash.0
}

/// A machine in a situation: what [`Course`] drives.
#[derive(Clone, Copy, Debug)]
struct Run {
    machine: fn(u32) -> Parameters,
    /// Gap, electrode and work, that the axis keeps while it erodes, um; `None` without work, the axis alone.
    gap_um: Option<f64>,
    /// Debris of a gap that is held, in 5 %.
    held: Option<f64>,
}

/// Every mechanism acts in one of these. The first four are blind holes of one kind of generator each, in which acts what all of
/// them have in common; then a sheet that is bored through, the false model, a held gap, and the axis alone.
const RUNS: [Run; 8] = [
    Run { machine: iso_frequency, gap_um: Some(25.0), held: None },
    Run { machine: iso_energy, gap_um: Some(25.0), held: None },
    Run { machine: controlled_rc, gap_um: Some(6.0), held: None },
    Run { machine: rc, gap_um: Some(12.0), held: None },
    Run { machine: sheet, gap_um: Some(6.0), held: None },
    Run { machine: nothing_comes_back, gap_um: Some(25.0), held: None },
    Run { machine: iso_frequency, gap_um: Some(25.0), held: Some(1.0) },
    Run { machine: iso_frequency, gap_um: None, held: None },
];

/// The sinker with what a machine can have and its own has not; short of stroke, with many bridges, and with damage that
/// soon is the most; with channels that recover slowly.
fn iso_frequency(version: u32) -> Parameters {
    Parameters {
        suspend_after: 5.0,
        suspend_ms: 2.0,
        most_hurt: 0.3,
        bridge_hz: 100.0,
        bridge_um: 40.0,
        bridge_ms: 3.0,
        tear_um: 1.0,
        recovery_us: 20.0,
        spot: 10.0,
        counterbalance_n_mm: 0.1,
        viscous_n_s_m: 0.5,
        play_um: 2.0,
        stroke_mm: 0.6,
        ..SINKER.of(version)
    }
}

fn iso_energy(version: u32) -> Parameters {
    Parameters { kind: Kind::IsoEnergy, on_us: 60.0, flush_kpa: 0.5, depth_um: 3000.0, ..iso_frequency(version) }
}

/// It turns, veils and wears.
fn controlled_rc(version: u32) -> Parameters {
    Parameters {
        suspend_after: 5.0,
        suspend_ms: 2.0,
        most_hurt: 0.3,
        bridge_hz: 100.0,
        bridge_um: 10.0,
        bridge_ms: 8.0,
        tear_um: 0.3,
        spot: 5.0,
        ..GAO.of(version)
    }
}

fn sheet(version: u32) -> Parameters {
    Parameters { removal_um3_uj: 100.0, thickness_um: 3.0, ..controlled_rc(version) }
}

/// Its capacitor is charged about as soon as a channel recovers.
fn rc(version: u32) -> Parameters {
    let recovery_rc = if version == 1 { 0.0 } else { 40.0 };
    Parameters {
        kind: Kind::Rc,
        capacitor_pf: 10_000.0,
        recovery_us: 5.5,
        recovery_rc,
        spot: 2.0,
        ..iso_frequency(version)
    }
}

fn nothing_comes_back(version: u32) -> Parameters {
    Parameters { comes_back: 0.0, ..iso_frequency(version) }
}

/// What acts on a course in one of its steps.
#[derive(Clone, Copy, Debug)]
struct Acts {
    winding: Winding,
    load: Load,
    orders: Orders,
}

/// A process with its axis, step by step: it erodes under every order, is pressed onto the work, torn off it against the
/// film up to the upper stop, left alone, braked, and comes down again.
struct Course {
    run: Run,
    axis: Axis,
    process: Process,
    steps: u32,
    hash: Hash,
}

impl Course {
    const STEP_US: f64 = 12.5;
    /// Steps in a millisecond, and milliseconds of a course.
    const MS: u32 = 80;
    const LASTS_MS: u32 = 700;
    /// The work is there, um below the upper stop.
    const WORK_UM: f64 = 300.0;

    fn new(run: Run, p: &Parameters) -> Result<Course, Refused> {
        let mut process = Process::new(p, Course::WORK_UM, 1)?;
        if let Some(dirt) = run.held {
            process.hold(dirt);
        }
        Ok(Course { run, axis: Axis::new(p, Course::STEP_US), process, steps: 0, hash: Hash::NEW })
    }

    fn carrier_um(&self) -> f64 {
        self.axis.electrode() * 1e6 - Course::WORK_UM
    }

    /// A spring and a damper of the winding's that keep a gap: about 200 Hz of 0.2 kg.
    fn keeps(&self, gap_um: f64) -> Winding {
        const V_PER_UM: f64 = 0.5;
        const V_PER_M_S: f64 = 800.0;
        let volts = V_PER_UM * (self.process.gap_um() - gap_um) - V_PER_M_S * self.axis.v;
        Winding::Volts(volts.clamp(-43.0, 43.0))
    }

    fn acts(&self) -> Acts {
        let mut orders = Orders::default();
        let ms = self.steps / Course::MS;
        let Some(gap_um) = self.run.gap_um else {
            let winding = match ms % 200 {
                0..60 => Winding::Volts(12.0),
                60..70 => Winding::Open,
                70..130 => Winding::Volts(-12.0),
                130..140 => Winding::Volts(0.0),
                // To and fro within the friction's bristles.
                _ => Winding::Volts(if ms % 20 < 10 { 0.3 } else { -0.3 }),
            };
            return Acts { winding, load: Load::NONE, orders };
        };
        let mut load = self.process.load(self.carrier_um());
        let mut winding = self.keeps(gap_um);
        match ms % 350 {
            60..80 => orders.off_us = Some(77.0),
            90..95 => orders.shorted = true,
            100..105 => orders.dead = true,
            110..140 => orders.arcs = 0.5,
            150..155 => orders.pulses = false,
            155..160 => (orders.pulses, orders.senseless) = (false, true),
            160..165 => orders.senseless = true,
            // A slow wave: what is squeezed out comes back.
            170..250 => winding = self.keeps(gap_um * if ms % 20 < 10 { 0.7 } else { 1.6 }),
            250..275 => {
                (winding, load.force_n) = (Winding::Volts(3.0), 1.0);
                orders.pulses = ms % 350 < 265;
            }
            // Far from the work an arc finds the capacitor charged.
            275..290 => (winding, orders.arcs) = (Winding::Volts(-43.0), 0.3),
            290..295 => winding = Winding::Open,
            295..300 => winding = Winding::Volts(0.0),
            _ => {}
        }
        Acts { winding, load, orders }
    }

    /// A millisecond, with what acts in it changed; the hash of all until then.
    fn millisecond(&mut self, change: impl Fn(&mut Acts)) -> Hash {
        for _ in 0..Course::MS {
            let mut acts = self.acts();
            let Load { force_n, gap_um, film } = acts.load;
            self.hash.reals(&[force_n, gap_um, film.damping, film.suction]);
            change(&mut acts);
            self.axis.step(acts.winding, &acts.load);
            let Axis { x, v, i, .. } = self.axis;
            self.hash.reals(&[x, v, i, self.axis.electrode(), self.axis.contact_n(gap_um)]);
            if self.run.gap_um.is_some() {
                self.process.advance(Course::STEP_US, self.carrier_um(), &acts.orders, &mut self.hash);
            }
            self.steps += 1;
        }
        self.hash.process(&self.process);
        self.hash
    }
}

/// Of a version: of all numbers of all machines, of `RUNS`, and of five runs under the gates' servo.
///
/// # Errors
/// When a machine's numbers do not fit.
pub fn fingerprint(version: u32) -> Result<u64, Refused> {
    let mut hash = Hash::NEW;
    // Of version 1 what it has, so that what others have does not change it.
    let numbers = if version == 1 { OF_VERSION_1 } else { DECLARED.len() };
    let values = MACHINES.iter().flat_map(|machine| machine.of(version).values().take(numbers));
    values.for_each(|value| hash.reals(&[value]));
    for run in RUNS {
        let mut course = Course::new(run, &(run.machine)(version))?;
        (0..Course::LASTS_MS).for_each(|_| {
            course.millisecond(|_| {});
        });
        hash.word(course.hash.0);
    }
    let jumps = Motion { buzz: (5.0, 200.0), jump: (3000.0, 0.5, 100.0) };
    let deep = Parameters { depth_um: 3000.0, flush_kpa: 2.0, ..SINKER.of(version) };
    let runs = [
        (SINKER.of(version), Law::Voltage(Voltage::thesis_of(version, 45.0)), Motion::default()),
        (deep, Law::Voltage(Voltage::calm(55.0)), jumps),
        (XIN.of(version), Law::Gap(45.0), Motion::default()),
        (GAO.of(version), Law::Fc(200, true), Motion::default()),
        (GAO_CLEAR.of(version), Law::Tav(20.0, 20.0), Motion::default()),
    ];
    for (p, law, motion) in runs {
        let mut rig = Rig::new(&p, law, motion, 1)?;
        rig.run(5.0);
        hash.word(outcome(&rig));
    }
    Ok(hash.0)
}

#[cfg(test)]
mod tests;

//! Five machines that the settings do not know, for tests of the measurements that a head makes of itself, and the loop that it should
//! find. Simulated: the process model, with its noise of converters and its LuGre friction.

use crate::bore::Setup;
use crate::machine::Machine;
use crate::process::Plant;
use edm_servo_head::head::{Command, MotionLimits, State};
use edm_servo_head::settings::{Declared, Settings, Value};
use edm_servo_head::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres, TICK_HZ};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus as Random;

/// A machine: motor, mass, friction, what it hangs from.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// Name in reports.
    pub name: &'static str,
    /// Resistance of the winding, ohm.
    pub ohm: f64,
    /// Its inductance, mH.
    pub mh: f64,
    /// Force constant, N/A.
    pub n_a: f64,
    /// Moving mass, kg.
    pub kg: f64,
    /// Counterbalance, N.
    pub counterbalance_n: f64,
    /// Friction while it slides, N.
    pub friction_n: f64,
    /// Friction at rest, N.
    pub stiction_n: f64,
    /// Stiffness of its cables, N/mm.
    pub spring_n_mm: f64,
    /// Viscous friction, N s/m.
    pub viscous_n_s_m: f64,
    /// Length of a count, um.
    pub count_um: f64,
}

/// The machines.
pub const KINDS: [Kind; 5] = [
    // The actuator of [R], as the settings begin.
    Kind {
        name: "thesis",
        ohm: 12.4,
        mh: 3.0,
        n_a: 7.5,
        kg: 0.2,
        counterbalance_n: 2.2,
        friction_n: 0.3,
        stiction_n: 0.36,
        spring_n_mm: 0.01,
        viscous_n_s_m: 0.0,
        count_um: 1.0,
    },
    // A heavier electrode on a stronger motor, balls in the guide.
    Kind {
        name: "heavy",
        ohm: 4.5,
        mh: 2.4,
        n_a: 14.0,
        kg: 1.1,
        counterbalance_n: 12.0,
        friction_n: 1.2,
        stiction_n: 1.5,
        spring_n_mm: 0.05,
        viscous_n_s_m: 5.0,
        count_um: 1.0,
    },
    // A light one, hardly any friction.
    Kind {
        name: "light",
        ohm: 22.0,
        mh: 6.0,
        n_a: 6.0,
        kg: 0.09,
        counterbalance_n: 1.1,
        friction_n: 0.08,
        stiction_n: 0.09,
        spring_n_mm: 0.002,
        viscous_n_s_m: 0.5,
        count_um: 0.5,
    },
    // Sticky: half as much again to begin with.
    Kind {
        name: "sticky",
        ohm: 9.0,
        mh: 1.6,
        n_a: 9.5,
        kg: 0.35,
        counterbalance_n: 3.6,
        friction_n: 0.8,
        stiction_n: 1.2,
        spring_n_mm: 0.02,
        viscous_n_s_m: 2.0,
        count_um: 1.0,
    },
    // On a spring, with a coarse encoder.
    Kind {
        name: "spring",
        ohm: 15.0,
        mh: 5.0,
        n_a: 11.0,
        kg: 0.5,
        counterbalance_n: 6.5,
        friction_n: 0.5,
        stiction_n: 0.6,
        spring_n_mm: 0.15,
        viscous_n_s_m: 0.0,
        count_um: 2.0,
    },
];

/// A head at rest 6 mm below its home and 3 mm above the work, whose settings are off by up to a quarter.
///
/// # Panics
/// When the head does not come to rest there.
pub fn ready(kind: &Kind, seed: u64) -> (Machine, Settings) {
    above(kind, seed, 3.0)
}

/// A head at rest 6 mm below its home and so many mm above the work, whose settings are off by up to a quarter.
///
/// # Panics
/// When the head does not come to rest there.
pub fn above(kind: &Kind, seed: u64, mm: f64) -> (Machine, Settings) {
    with(kind, seed, mm, |_| {})
}

/// A head at rest 6 mm below its home and so many mm above the work, with settings that were changed after they were drawn.
///
/// # Panics
/// When the head does not come to rest there.
pub fn with(kind: &Kind, seed: u64, mm: f64, change: impl FnOnce(&mut Settings)) -> (Machine, Settings) {
    try_with(kind, seed, mm, |settings, _| change(settings))
        .unwrap_or_else(|| panic!("{} {seed} is not at rest there", kind.name))
}

/// A head at rest 6 mm below its home and so many mm above the work, with settings and a plant that were changed after they were drawn; `None` where
/// the settings do not fit together, or the loop cannot take the head there.
///
/// # Panics
/// When the head refuses to be enabled.
pub fn try_with(
    kind: &Kind,
    seed: u64,
    mm: f64,
    change: impl FnOnce(&mut Settings, &mut Plant),
) -> Option<(Machine, Settings)> {
    let setup = Setup::load("default").unwrap();
    let mut random = Random::seed_from_u64(seed);
    let mut process = setup.process;
    for (key, value) in [
        ("model.coil_ohm", kind.ohm),
        ("model.coil_mh", kind.mh),
        ("model.force_n_a", kind.n_a),
        ("model.mass_kg", kind.kg),
        ("model.counterbalance_n", kind.counterbalance_n),
        ("model.friction_n", kind.friction_n),
        ("model.stiction_n", kind.stiction_n),
        ("model.cable_n_mm", kind.spring_n_mm),
        ("model.viscous_n_s_m", kind.viscous_n_s_m),
        ("scale.count_um", kind.count_um),
        ("workpiece.surface_mm", 6.0 + mm),
    ] {
        process.set(key, Value::Number(value)).unwrap_or_else(|error| panic!("{key}: {error}"));
    }
    let mut off = |value: f64, share: f64| (value * random.random_range(1.0 - share..1.0 + share)) as f32;
    let mut settings = Settings {
        commissioned: true,
        axis_resistance: off(kind.ohm, 0.15),
        axis_inductance: off(kind.mh, 0.25),
        axis_force_constant: off(kind.n_a, 0.15),
        axis_mass: off(kind.kg, 0.25),
        axis_counterbalance: kind.counterbalance_n as f32,
        axis_breakaway: off(kind.stiction_n, 0.2),
        encoder_count: kind.count_um as f32,
        ..setup.head
    };
    change(&mut settings, &mut process);
    let mut machine = Machine::new(process, &settings, seed).ok()?;
    run(&mut machine, 0.01, |_| false);
    for command in [Command::SetHome(Nanometres(0)), Command::Enable] {
        machine.command(command).unwrap_or_else(|refused| panic!("{}: {command:?}: {refused}", kind.name));
    }
    let limits = MotionLimits {
        velocity: MicrometresPerSecond(20e3),
        acceleration: MicrometresPerSecond2(1e6),
        deceleration: MicrometresPerSecond2(1e6),
    };
    machine.command(Command::Position(Nanometres(6_000_000), limits)).ok()?;
    run(&mut machine, 5.0, |machine| machine.status().state == State::Ready).then_some((machine, settings))
}

/// Whether it came to this within so many seconds.
pub fn run(machine: &mut Machine, seconds: f64, mut until: impl FnMut(&mut Machine) -> bool) -> bool {
    (0..(seconds * f64::from(TICK_HZ)) as u32).any(|_| {
        machine.tick();
        until(machine)
    })
}

/// A complex number.
pub type Complex = (f64, f64);

/// Product.
pub fn times(a: Complex, b: Complex) -> Complex {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

/// Sum.
pub fn plus(a: Complex, b: Complex) -> Complex {
    (a.0 + b.0, a.1 + b.1)
}

/// Quotient.
pub fn over(a: Complex, b: Complex) -> Complex {
    let by = b.0 * b.0 + b.1 * b.1;
    times(a, (b.0 / by, -b.1 / by))
}

/// Product with a real number.
pub fn scaled(a: Complex, by: f64) -> Complex {
    (a.0 * by, a.1 * by)
}

/// exp(j angle).
pub fn turned(angle: f64) -> Complex {
    (angle.cos(), angle.sin())
}

/// Absolute value.
pub fn size(a: Complex) -> f64 {
    a.0.hypot(a.1)
}

/// Motor and mass as they are: position, m, to a duty of 1 that is held for a tick. The process model takes two steps a tick:
/// winding exactly, then velocity, then position, each from the one before. That is 25 us earlier than in nature, and here as well.
pub fn position(kind: &Kind, hz: f64) -> Complex {
    let w = std::f64::consts::TAU * hz;
    let step = 0.5 / f64::from(TICK_HZ);
    let z = turned(w * step);
    let differs = plus(z, (-1.0, 0.0));
    let left = (-kind.ohm * step / (kind.mh * 1e-3)).exp();
    // Current to a voltage; velocity to a current, and the voltage that it generates; position.
    let current = over(((1.0 - left) / kind.ohm, 0.0), plus(z, (-left, 0.0)));
    let moves = scaled(over(scaled(z, step), differs), kind.spring_n_mm * 1e3);
    let resists = plus(scaled(z, kind.viscous_n_s_m), moves);
    let mass = plus(scaled(differs, kind.kg / step), resists);
    let force = scaled(times(z, current), kind.n_a);
    let velocity = over(scaled(force, 48.0), plus(mass, scaled(force, kind.n_a)));
    let held = scaled(plus((1.0, 0.0), turned(-w * step)), 0.5);
    times(over(scaled(times(velocity, z), step), differs), held)
}

/// The loop opened at the duty, as its settings make it of that machine, and of the encoder at a velocity, counts/s. The velocity is a
/// difference of positions: over four ticks, from their newest edges, where each brings one; over four edges from 10 000 counts/s on;
/// over one below. The newest edge is half of a spacing old, on average.
pub fn open_loop(kind: &Kind, settings: &Settings, hz: f64, counts_s: f64) -> Complex {
    let w = std::f64::consts::TAU * hz;
    let tick = 1.0 / f64::from(TICK_HZ);
    let x = position(kind, hz);
    let spacing = 1.0 / counts_s;
    let span = match counts_s {
        20_000.0.. => 4.0 * tick,
        10_000.0.. => 4.0 * spacing,
        _ => spacing,
    };
    let difference = scaled(plus((1.0, 0.0), scaled(turned(-w * span), -1.0)), 1.0 / span);
    let age = 0.5 * w * spacing;
    let velocity = times(x, times(difference, scaled(turned(-age), age.sin() / age)));
    let set = |value: f32| f64::from(value);
    let acceleration =
        set(settings.axis_force_constant) * 48.0 / (set(settings.axis_resistance) * set(settings.axis_mass));
    let p = std::f64::consts::TAU * set(settings.servo_velocity_hz) / acceleration;
    let i = p * tick / (set(settings.servo_integral_ms) * 1e-3);
    let pi = plus((p, 0.0), over((i, 0.0), plus((1.0, 0.0), scaled(turned(-w * tick), -1.0))));
    let to_velocity = std::f64::consts::TAU * set(settings.servo_position_hz);
    let back_emf = set(settings.axis_force_constant) / 48.0;
    plus(times(pi, plus(velocity, scaled(x, to_velocity))), scaled(x, back_emf * to_velocity))
}

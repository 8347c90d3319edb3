//! Jumps as fast as the actuator makes them: an encoder that is sound is never taken for a lost one, and one that is cut in the middle
//! is named at once and presses nothing.
//!
//! Simulated: light and heavy electrodes, under settings that know of them and settings that do not; both pitches of encoder. The short
//! form bores ten holes and cuts an encoder at every second millisecond of three jumps. `EDM_BORES=200` bores 200, and cuts at every
//! tenth of a millisecond.

use edm_servo_head::head::{Command, Fault, Reason, State};
use edm_servo_head::settings::{Declared, Settings, Value};
use edm_servo_head::units::{Nanometres, TICK_HZ, TICK_S};
use edm_sim::bore::Setup;
use edm_sim::machine::Machine;

const SCENARIOS: [&str; 2] = ["sinker-deep", "default"];
/// Moving mass, kg, and what the settings say of it.
const MASSES: [[f64; 2]; 5] = [[0.1, 0.1], [0.2, 0.2], [0.4, 0.4], [0.1, 0.2], [0.4, 0.2]];
const HEIGHTS_UM: [f32; 3] = [300.0, 1000.0, 1700.0];
const COUNTS_UM: [f32; 2] = [0.5, 1.0];
/// Velocity, mm/s, acceleration, m/s^2, and jerk, m/s^3: up to what a head of 0.2 kg can just follow, and beyond what one of 0.4 kg can.
const LIMITS: [[f32; 3]; 3] = [[200.0, 75.0, 15e3], [200.0, 50.0, 30e3], [100.0, 75.0, 15e3]];

/// Prime to the number of all combinations, 180: neighbours have little in common.
const STRIDE: usize = 37;

fn bores() -> Option<usize> {
    std::env::var("EDM_BORES").ok().and_then(|bores| bores.parse().ok())
}

#[derive(Clone, Copy, Debug)]
struct Case {
    scenario: &'static str,
    masses: [f64; 2],
    height_um: f32,
    count_um: f32,
    limits: [f32; 3],
}

/// One of all combinations.
fn case(n: usize) -> Case {
    let mut rest = n * STRIDE;
    let mut one_of = |many: usize| {
        let one = rest % many;
        rest /= many;
        one
    };
    Case {
        scenario: SCENARIOS[one_of(SCENARIOS.len())],
        masses: MASSES[one_of(MASSES.len())],
        height_um: HEIGHTS_UM[one_of(HEIGHTS_UM.len())],
        count_um: COUNTS_UM[one_of(COUNTS_UM.len())],
        limits: LIMITS[one_of(LIMITS.len())],
    }
}

/// A head that erodes, with a jump after so many milliseconds of it.
fn eroding(case: &Case, every_ms: f32, seed: u64) -> Machine {
    let setup = Setup::load(case.scenario).unwrap();
    let mut process = setup.process;
    // A counterbalance that lifts an eighth more than the mass weighs.
    let [force, believed] = case.masses.map(|mass| 1.125 * 9.80665 * mass);
    for (key, value) in
        [("model.mass_kg", case.masses[0]), ("model.counterbalance_n", force), ("scale.count_um", case.count_um.into())]
    {
        process.set(key, Value::Number(value)).unwrap();
    }
    let [jump_velocity, jump_acceleration, jump_jerk] = case.limits;
    let settings = Settings {
        commissioned: true,
        seek_velocity: 5000.0,
        axis_mass: case.masses[1] as f32,
        axis_counterbalance: believed as f32,
        encoder_count: case.count_um,
        jump_every_ms: every_ms,
        jump_height: case.height_um,
        jump_velocity,
        jump_acceleration,
        jump_jerk,
        ..setup.head
    };
    let mut machine = Machine::new(process, &settings, seed).unwrap();
    run(&mut machine, 0.01, |_| false);
    for command in
        [Command::SetHome(Nanometres(0)), Command::Enable, Command::MoveTo(Nanometres(4_000_000)), Command::Start]
    {
        machine.command(command).unwrap();
    }
    assert!(run(&mut machine, 5.0, |machine| machine.status().state == State::Eroding), "{case:?}");
    machine
}

/// Whether it came to this within so many seconds.
fn run(machine: &mut Machine, seconds: f64, mut until: impl FnMut(&mut Machine) -> bool) -> bool {
    (0..(seconds * f64::from(TICK_HZ)) as u32).any(|_| {
        machine.tick();
        until(machine)
    })
}

#[test]
fn fast_jumps_end_in_no_fault_whatever_the_electrode_weighs() {
    let bores = bores().unwrap_or(10);
    let (mut false_faults, mut all) = (Vec::new(), 0);
    for n in 0..bores {
        let case = case(n);
        let mut machine = eroding(&case, 250.0, n as u64);
        let mut jumps = 0;
        run(&mut machine, 8.0, |machine| {
            while let Some(change) = machine.next_change() {
                jumps += u32::from(change.reason == Reason::Jumped);
            }
            machine.status().fault.is_some()
        });
        all += jumps;
        match machine.status().fault {
            Some(fault) => false_faults.push((case, fault)),
            None => assert!(jumps > 10, "{case:?}: {jumps} jumps"),
        }
    }
    println!("{} of {bores} bores with {all} jumps end in a false fault", false_faults.len());
    assert!(false_faults.is_empty(), "{false_faults:#?}");
}

/// What came of a cut.
struct Cut {
    /// Velocity then, mm/s.
    velocity: f64,
    /// Time until it was named.
    named_ms: f64,
    /// Largest force on the work.
    force_n: f64,
}

/// Cuts the encoder so long after a jump was commanded; `None` where that is over by then.
fn cut(case: &Case, after_s: f64) -> Option<Cut> {
    let mut machine = eroding(case, 0.0, 1);
    run(&mut machine, 0.3, |_| false);
    machine.command(Command::Jump).unwrap();
    assert!(run(&mut machine, 0.01, |machine| machine.status().state == State::Jumping), "{case:?}");
    run(&mut machine, after_s, |_| false);
    if machine.status().state != State::Jumping {
        return None;
    }
    let velocity = machine.process.truth().velocity_um_s * 1e-3;
    machine.process.happen("encoder.cut", Value::Flag(true)).unwrap();
    let (mut ticks, mut named, mut force_n) = (0, None, 0.0f64);
    run(&mut machine, 0.5, |machine| {
        ticks += 1;
        force_n = force_n.max(machine.process.truth().contact_n);
        if machine.status().fault.is_some() {
            named.get_or_insert(ticks);
        }
        false
    });
    assert_eq!(machine.status().fault, Some(Fault::EncoderLost), "{case:?}");
    Some(Cut { velocity, named_ms: f64::from(named?) * f64::from(TICK_S) * 1e3, force_n })
}

#[test]
fn an_encoder_cut_in_a_fast_jump_is_named_at_once_and_presses_nothing() {
    let step_s = if bores().is_some() { 1e-4 } else { 2e-3 };
    // Slower ones, and such as begin or come to rest, go no further meanwhile than a sound encoder may be silent: the supervision's.
    for (limits, height_um, fast) in
        [([50.0, 10.0, 2e3], 1000.0, 21.0), ([200.0, 75.0, 15e3], 1000.0, 30.0), ([200.0, 75.0, 15e3], 1700.0, 30.0)]
    {
        let case = Case { scenario: "sinker-deep", masses: MASSES[1], height_um, count_um: 1.0, limits };
        // Heads that were cut at these three times leapt off their stop while the current of the winding still changed direction.
        let leaps = [9.1e-3, 9.7e-3, 11.4e-3].into_iter().filter_map(|after_s| cut(&case, after_s));
        let cuts = (1..).map_while(|step| cut(&case, step_s * f64::from(step))).chain(leaps);
        let mut soon = 0;
        for Cut { velocity, named_ms, force_n } in cuts {
            let most = if velocity.abs() > fast { 0.75 } else { 7.0 };
            soon += u32::from(velocity.abs() > fast);
            assert!(named_ms <= most, "{limits:?}: cut at {velocity:.1} mm/s, named after {named_ms:.2} ms");
            assert!(force_n <= 0.0, "{limits:?}: cut at {velocity:.1} mm/s, {force_n:.1} N");
        }
        assert!(soon >= 6, "{limits:?}: {soon} at speed");
    }
}

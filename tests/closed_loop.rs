//! The whole core against the process model: holes, fault_inputs, and commissioning on a machine with friction, noise and
//! stops.

use edm_servo_head::head::{Command, Fault, Finding, MotionLimits, Reason, Report, State};
use edm_servo_head::settings::{Declared as _, Settings, Value};
use edm_servo_head::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres, TICK_HZ};
use edm_sim::bore::{self, Setup};
use edm_sim::machine::Machine;
use edm_sim::process::{Cable, FaultInputs, Plant};
use edm_sim::run::{Job, Observer, Outcome, Sample};

struct Nobody;

impl Observer for Nobody {
    fn sample(&mut self, _: &Sample) {}
}

fn bored(scenario: &str, seed: u64, surrogate: bool) -> Outcome {
    let job = Job {
        setup: Setup::load(scenario).unwrap(),
        depth_mm: 0.03,
        seed,
        surrogate,
        path: None,
        table: None,
        coarse_error_um: 0.0,
    };
    bore::bore(&job, &mut Nobody, &mut |_| {}).unwrap()
}

#[test]
fn the_same_seed_bores_the_same_hole_and_another_seed_another() {
    assert_eq!(bored("default", 5, false), bored("default", 5, false));
    assert_ne!(bored("default", 5, false), bored("default", 6, false));
}

#[test]
fn the_dry_loop_goes_to_its_depth_without_a_spark() {
    let outcome = bored("default", 1, true);
    assert!(outcome.completed);
    assert_eq!(outcome.pulses.spark + outcome.pulses.short, 0);
}

fn plant(values: &[(&str, f64)]) -> Plant {
    Plant::with(values).unwrap()
}

/// A machine whose friction breaks away at so many newtons, and slides at five sixths of that.
fn rubbing(breakaway: f32) -> Plant {
    plant(&[("model.stiction_n", f64::from(breakaway)), ("model.friction_n", f64::from(breakaway) / 1.2)])
}

fn of_radius(mm: f32) -> Plant {
    plant(&[("model.radius_um", 1e3 * f64::from(mm))])
}

/// A machine that has been eroding for a second.
fn eroding(seed: u64) -> Machine {
    eroding_with(&Settings { commissioned: true, ..Settings::default() }, Plant::default(), seed)
}

fn eroding_with(settings: &Settings, plant: Plant, seed: u64) -> Machine {
    let mut machine = Machine::new(plant, settings, seed).unwrap();
    run(&mut machine, 0.01);
    for command in
        [Command::SetHome(Nanometres(0)), Command::Enable, Command::MoveTo(Nanometres(3_000_000)), Command::Start]
    {
        machine.command(command).unwrap();
    }
    run(&mut machine, 3.5);
    assert_eq!(machine.status().state, State::Eroding);
    machine
}

fn run(machine: &mut Machine, seconds: f64) {
    for _ in 0..(seconds * f64::from(TICK_HZ)) as u64 {
        machine.tick();
    }
}

#[test]
fn a_fault_of_the_machine_is_noticed_in_time_and_moves_the_head_away_from_the_work() {
    let stuck = FaultInputs { stuck_code: Some(4095), ..FaultInputs::default() };
    let cases = [
        (FaultInputs { generator_dead: true, ..FaultInputs::default() }, Fault::GateMissing, 0.05),
        (stuck, Fault::GapSignalInvalid, 0.03),
        (FaultInputs { short: true, ..FaultInputs::default() }, Fault::PersistentShort, 1.1),
        (FaultInputs { bus_v: Some(30.0), ..FaultInputs::default() }, Fault::BusSag, 0.002),
    ];
    for (fault_inputs, fault, within) in cases {
        let mut machine = eroding(1);
        let before = machine.process.truth();
        machine.process.fault_inputs = fault_inputs;
        run(&mut machine, within);
        assert_eq!(machine.status().fault, Some(fault));
        run(&mut machine, 1.0);
        let after = machine.process.truth();
        assert!(after.position_um < before.position_um + 1.0, "{}", fault.name());
        let pulses = after.pulses;
        run(&mut machine, 0.1);
        assert_eq!(machine.process.truth().pulses, pulses, "{}: pulses stay off", fault.name());
    }
}

/// Heads that erode with so much dry friction, which commissioning has found.
fn eroding_against(friction: f32) -> impl Iterator<Item = (u64, Machine)> {
    (1..=50).map(move |seed| {
        let settings = Settings { commissioned: true, axis_breakaway: friction, ..Settings::default() };
        (seed, eroding_with(&settings, rubbing(friction), seed))
    })
}

#[test]
fn an_encoder_that_dies_while_eroding_is_named_before_the_electrode_presses_into_the_work() {
    // Hardly any, that of the model, and what a stiff guide has. The contact gives way by half a micrometre a newton.
    for friction in [0.05, 0.3, 1.0] {
        let mut deepest = (0.0, 0);
        for (seed, mut machine) in eroding_against(friction) {
            machine.process.fault_inputs.encoder = Cable::CUT;
            for _ in 0..2 * TICK_HZ {
                machine.tick();
                let deep = -machine.process.truth().gap_um;
                deepest = if deep > deepest.0 { (deep, seed) } else { deepest };
            }
            assert_eq!(machine.status().first, Some(Fault::EncoderLost), "{friction} N, seed {seed}");
        }
        println!("{friction} N: {:.1} um, seed {}", deepest.0, deepest.1);
        assert!(deepest.0 <= 3.0, "{friction} N: {:.1} um into the work, seed {}", deepest.0, deepest.1);
    }
}

/// A head that erodes with an electrode of so many mm radius, whose face it has been told.
fn eroding_with_face(radius: f32, seed: u64) -> Machine {
    eroding_with(&with_face(radius), of_radius(radius), seed)
}

fn with_face(radius_mm: f32) -> Settings {
    Settings { commissioned: true, face: radius_mm * 1e3, ..Settings::default() }
}

#[test]
fn the_path_waits_for_a_head_that_the_film_under_a_large_face_holds_and_no_encoder_is_lost() {
    for (radius, seed) in [(10.0, 1), (10.0, 2), (15.0, 3), (25.0, 4), (25.0, 5)] {
        let mut machine = eroding_with_face(radius, seed);
        let from = machine.process.truth().surface_um;
        let mut furthest = 0.0f32;
        for _ in 0..20 * TICK_HZ {
            machine.tick();
            furthest = furthest.max(machine.status().following.abs());
        }
        assert_eq!(machine.status().first, None, "{radius} mm, seed {seed}");
        let area_mm2 = std::f64::consts::PI * f64::from(radius * radius);
        let removed_mm3 = 1e-3 * (machine.process.truth().surface_um - from) * area_mm2;
        assert!(removed_mm3 > 1.0, "{radius} mm, seed {seed}: {removed_mm3} mm3");
        assert!(furthest < 150.0, "{radius} mm, seed {seed}: the set point ran {furthest} um ahead");
    }
}

/// Has the machine go on for as long as it is in this state, which may neither fault nor touch; heights of its lowest and its
/// highest place above the first one, and the largest following error, um.
fn moved(machine: &mut Machine, command: Command, state: State, what: &str) -> [f32; 3] {
    let from = machine.status().position;
    machine.command(command).unwrap();
    while machine.status().state != state {
        machine.tick();
    }
    let mut seen = [0.0f32; 3];
    for tick in 0.. {
        machine.tick();
        let status = machine.status();
        assert_eq!(status.fault, None, "{what}: after {tick} ticks");
        assert!(machine.process.truth().gap_um > 0.0, "{what}: it touches");
        assert!(tick < 10 * TICK_HZ, "{what}: it does not come back");
        let up = (from - status.position) as f32;
        seen = [seen[0].min(up), seen[1].max(up), seen[2].max(status.following.abs())];
        if status.state != state {
            break;
        }
    }
    println!("{what}: {seen:?} um");
    seen
}

/// Faces, mm, and a seed each.
const FACES: [(f32, u64); 5] = [(5.0, 1), (10.0, 2), (15.0, 3), (20.0, 4), (25.0, 5)];

#[test]
fn a_jump_waits_for_a_head_that_the_film_under_a_large_face_holds() {
    for (radius, seed) in FACES {
        for (velocity, acceleration, jerk) in [(50.0, 10.0, 2000.0), (200.0, 40.0, 8000.0)] {
            let settings = Settings {
                jump_velocity: velocity,
                jump_acceleration: acceleration,
                jump_jerk: jerk,
                ..with_face(radius)
            };
            let mut machine = eroding_with(&settings, of_radius(radius), seed);
            for _ in 0..3 {
                let what = format!("{radius} mm, {velocity} mm/s, seed {seed}");
                let [_, up, following] = moved(&mut machine, Command::Jump, State::Jumping, &what);
                assert!((950.0..1100.0).contains(&up) && following < 150.0, "{what}: {up} um up");
                run(&mut machine, 1.0);
                assert_eq!(machine.status().state, State::Eroding, "{what}");
            }
        }
    }
}

#[test]
fn a_face_that_no_force_of_the_head_lifts_is_a_following_error_in_time() {
    let stuck = plant(&[("model.radius_um", 50e3), ("model.viscosity_mpas", 20.0)]);
    // Larger than the settings may say, in a thick dielectric.
    let settings = Settings { contact_press: 20.0, ..with_face(30.0) };
    let mut machine = eroding_with(&settings, stuck, 1);
    machine.command(Command::Jump).unwrap();
    run(&mut machine, 0.9);
    assert_eq!((machine.status().state, machine.status().fault), (State::Jumping, None));
    run(&mut machine, 0.5);
    assert_eq!(machine.status().fault, Some(Fault::FollowingError));
}

#[test]
fn a_position_is_reached_by_a_head_that_the_film_under_a_large_face_holds() {
    for (radius, seed) in FACES {
        for velocity in [5e3, 20e3, 100e3] {
            let mut machine = eroding_with_face(radius, seed);
            machine.command(Command::Hold).unwrap();
            run(&mut machine, 0.05);
            let above = machine.status().position;
            let limits = MotionLimits { velocity: MicrometresPerSecond(velocity), ..LIFT };
            for to in [500, above - 50] {
                let what = format!("{radius} mm, {velocity} um/s, seed {seed}");
                let go = Command::Position(Nanometres(to * 1000), limits);
                let [.., following] = moved(&mut machine, go, State::Positioning, &what);
                // Where a film lets go no more than 2 mm/s, and less.
                run(&mut machine, 2.0);
                assert_eq!(machine.status().position, to, "{what}");
                assert!(following < 150.0, "{what}: the set point ran {following} um ahead");
            }
        }
    }
}

#[test]
fn an_encoder_that_dies_under_a_large_face_is_named_before_the_electrode_reaches_the_work() {
    for (radius, seed) in [(5.0, 1), (10.0, 2), (15.0, 3), (25.0, 4)] {
        let mut machine = eroding_with_face(radius, seed);
        machine.process.fault_inputs.encoder = Cable::CUT;
        for _ in 0..4 * TICK_HZ {
            machine.tick();
            let gap = machine.process.truth().gap_um;
            assert!(gap > -1.0, "{radius} mm, seed {seed}: {gap} um");
        }
        assert_eq!(machine.status().first, Some(Fault::EncoderLost), "{radius} mm, seed {seed}");
    }
}

#[test]
fn friction_alone_is_never_taken_for_a_dead_encoder() {
    for friction in [0.05, 0.3, 1.0] {
        for (seed, mut machine) in eroding_against(friction).take(5) {
            run(&mut machine, 12.0);
            assert_eq!(machine.status().first, None, "{friction} N, seed {seed}");
        }
    }
}

fn check(mut plant: Plant) -> Result<Report, Finding> {
    // No workpiece: it lies at the very end of the stroke.
    plant.installation.surface = plant.stroke_mm() as f32 - 0.01;
    let mut machine = Machine::new(plant, &Settings::default(), 1).unwrap();
    run(&mut machine, 0.01);
    machine.command(Command::Commission).unwrap();
    for _ in 0..30 * TICK_HZ {
        machine.tick();
        if let Some(result) = machine.next_check() {
            return result;
        }
    }
    panic!("the check does not end: {:?}", machine.status());
}

#[test]
fn the_commissioning_passes_a_right_machine_and_names_each_wrong_wire() {
    assert_eq!(check(Plant::default()).err(), None);
    let wrong = |key, value| check(plant(&[(key, value)])).err();
    assert_eq!(wrong("wiring.motor_reversed", 1.0), Some(Finding::MotorReversed));
    assert_eq!(wrong("wiring.encoder_reversed", 1.0), Some(Finding::EncoderReversed));
    assert_eq!(wrong("wiring.gap_reversed", 1.0), Some(Finding::GapReversed));
    assert!(matches!(wrong("model.stroke_mm", 25.0), Some(Finding::Stroke(_))));
}

#[test]
fn commissioning_finds_the_friction_that_the_supervision_judges_by() {
    for friction in [0.05, 0.3, 1.0] {
        let report = check(rubbing(friction)).unwrap();
        let found = report.friction.value;
        // In front of it the bristles creep, and the push goes on growing until a motion shows.
        assert!((0.98 * friction..friction + 0.05).contains(&found), "{found} N instead of {friction}");
    }
}

/// Heads that hold their place above the work, pulses off, as they came out of the erosion.
fn holding(friction: f32, other: &[(&str, f64)]) -> impl Iterator<Item = (u64, Machine)> {
    let mut plant = rubbing(friction);
    for (key, value) in other {
        plant.set(key, Value::Number(*value)).unwrap();
    }
    let face = plant.model().radius_um as f32;
    let settings = Settings { commissioned: true, axis_breakaway: friction, face, ..Settings::default() };
    (1..=10).map(move |seed| {
        let mut machine = eroding_with(&settings, plant, seed);
        machine.command(Command::Hold).unwrap();
        run(&mut machine, 0.5);
        (seed, machine)
    })
}

#[test]
fn an_encoder_that_dies_while_the_head_holds_its_place_does_not_let_it_press_into_the_work() {
    let mut unnamed = Vec::new();
    for friction in [0.05, 0.3, 1.0] {
        for (seed, mut machine) in holding(friction, &[]) {
            let from = machine.process.truth().position_um;
            machine.process.fault_inputs.encoder = Cable::CUT;
            for _ in 0..20 * TICK_HZ {
                machine.tick();
                let truth = machine.process.truth();
                assert!(truth.contact_n <= 2.5, "{friction} N, seed {seed}: {} N", truth.contact_n);
            }
            // One that nothing pushes stands as well as before, and one that rises is told of at the stop, perhaps later.
            let gone = machine.process.truth().position_um - from;
            match machine.status().first {
                None if gone < 1.0 => {}
                None => unnamed.push((friction, seed, gone)),
                told => assert_eq!(told, Some(Fault::EncoderLost), "{friction} N, seed {seed}"),
            }
        }
    }
    // A known gap: a set point less than a count away moves a stiff head for seconds, as slowly as its integrator grows; one or two of
    // these thirty.
    assert!(unnamed.len() <= 3, "{unnamed:?}");
}

#[test]
fn a_head_that_holds_its_place_is_never_taken_for_one_whose_encoder_is_dead() {
    let changes: [&[(&str, f64)]; 4] =
        [&[], &[("model.radius_um", 12e3)], &[("model.radius_um", 25e3)], &[("model.counterbalance_n", 2.4)]];
    for (change, friction) in changes.iter().flat_map(|change| [0.05, 0.3, 1.0].map(|friction| (change, friction))) {
        for (seed, mut machine) in holding(friction, change).take(4) {
            run(&mut machine, 10.0);
            let status = machine.status();
            assert_eq!((status.state, status.first), (State::HoldingPosition, None), "{friction} N, seed {seed}");
        }
    }
}

/// What an emergency stop finds 20 ms after this: named in the end, and how far the head has risen, um.
fn stopped(friction: f32, seed: u64, before: FaultInputs) -> (Vec<Fault>, f64) {
    let settings = Settings { commissioned: true, axis_breakaway: friction, ..Settings::default() };
    let mut machine = eroding_with(&settings, rubbing(friction), seed);
    let from = machine.process.truth().position_um;
    machine.process.fault_inputs = before;
    run(&mut machine, 0.02);
    machine.process.happen("stop.open", Value::Flag(true)).unwrap();
    run(&mut machine, 1.0);
    let mut named = Vec::new();
    while let Some(change) = machine.next_change() {
        named.extend(match change.reason {
            Reason::Fault(fault) => Some(fault),
            _ => None,
        });
    }
    (named, from - machine.process.truth().position_um)
}

#[test]
fn an_emergency_stop_lifts_a_stiff_head_and_names_an_encoder_that_has_not_seen_it() {
    for friction in [0.05, 0.3, 1.0] {
        for seed in 1..=5 {
            let (named, risen) = stopped(friction, seed, FaultInputs::default());
            assert_eq!(named, [Fault::EmergencyStop], "{friction} N, seed {seed}");
            assert!(risen > 500.0, "{friction} N, seed {seed}: {risen} um");
            let dead = FaultInputs { encoder: Cable::CUT, ..FaultInputs::default() };
            let (named, _) = stopped(friction, seed, dead);
            assert!(named.contains(&Fault::EncoderLost), "{friction} N, seed {seed}: {named:?}");
        }
    }
}

const LIFT: MotionLimits = MotionLimits {
    velocity: MicrometresPerSecond(20e3),
    acceleration: MicrometresPerSecond2(10e6),
    deceleration: MicrometresPerSecond2(10e6),
};

/// A head that is in a jump, or else under way toward the work, for so many ms; its velocity, mm/s.
fn under_way(settings: &Settings, command: Command, state: State, ms: u32) -> Option<(Machine, f64)> {
    let mut machine = eroding_with(settings, Plant::default(), 1);
    if state == State::Positioning {
        machine.command(Command::Hold).unwrap();
        run(&mut machine, 0.05);
        machine.command(Command::Position(Nanometres(500_000), LIFT)).unwrap();
        run(&mut machine, 0.5);
    }
    machine.command(command).unwrap();
    while machine.status().state != state {
        run(&mut machine, 0.001);
    }
    run(&mut machine, 0.001 * f64::from(ms));
    let velocity = machine.process.truth().velocity_um_s * 1e-3;
    (machine.status().state == state).then_some((machine, velocity))
}

#[test]
fn an_encoder_that_dies_in_a_fast_motion_does_not_let_the_head_run_into_the_work() {
    let jumps = |velocity, acceleration, jerk| Settings {
        commissioned: true,
        jump_height: 1800.0,
        jump_velocity: velocity,
        jump_acceleration: acceleration,
        jump_jerk: jerk,
        ..Settings::default()
    };
    let down = |um_s| {
        let limits = MotionLimits { velocity: MicrometresPerSecond(um_s), ..LIFT };
        (
            Settings { commissioned: true, ..Settings::default() },
            Command::Position(Nanometres(1_960_000), limits),
            State::Positioning,
        )
    };
    let jump = |settings| (settings, Command::Jump, State::Jumping);
    let mut seen = 0;
    for (settings, command, state) in
        [jump(jumps(50.0, 10.0, 2000.0)), jump(jumps(200.0, 40.0, 8000.0)), down(5e3), down(20e3), down(100e3)]
    {
        let mut worst = (0.0, 0, 0.0);
        for ms in (0..300).step_by(3) {
            let Some((mut machine, velocity)) = under_way(&settings, command, state, ms) else { break };
            machine.process.fault_inputs.encoder = Cable::CUT;
            for _ in 0..TICK_HZ {
                machine.tick();
                let newtons = machine.process.truth().contact_n;
                worst = if newtons > worst.0 { (newtons, ms, velocity) } else { worst };
            }
            seen += 1;
        }
        let (newtons, ms, velocity) = worst;
        assert!(newtons <= 5.0, "{newtons} N, dead after {ms} ms at {velocity} mm/s");
    }
    assert!(seen > 150, "{seen}");
}

#[test]
fn a_head_that_starts_once_more_seeks_until_it_is_at_the_work() {
    let mut machine = eroding(1);
    let first = machine.status().found;
    for to in [500_000, 1_500_000] {
        machine.command(Command::Hold).unwrap();
        run(&mut machine, 0.05);
        machine.command(Command::Position(Nanometres(to), LIFT)).unwrap();
        run(&mut machine, 0.5);
        machine.command(Command::MoveTo(Nanometres(3_000_000))).unwrap();
        machine.command(Command::Start).unwrap();
        while machine.status().state != State::Eroding {
            assert!(machine.status().tick < 20 * TICK_HZ, "{:?}", machine.status().state);
            machine.tick();
        }
        let gap = machine.process.truth().gap_um;
        assert!(gap < 100.0, "work found {gap:.0} um above it");
        assert!((machine.status().found - first).abs() < 100, "{} and {first}", machine.status().found);
        run(&mut machine, 0.5);
    }
}

//! The surface of the work is found by touching it, on the process model: 0.2 kg, 2 N/um, friction, a sense supply of 11 V with
//! the noise of its converter.

use edm_servo_head::head::{Command, Fault, MotionLimits, Reason, Refused, Search, State};
use edm_servo_head::settings::{Settings, Value};
use edm_servo_head::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres, TICK_HZ};
use edm_sim::machine::Machine;
use edm_sim::process::Plant;

/// What a contact may press, N.
const PRESSES: f64 = 5.0;
/// How far past the surface the first touch may lead, counts of 1 um.
const OVERSHOOT: u32 = 8;
const SEEDS: u64 = 20;

fn um(um: i64) -> Nanometres {
    Nanometres(um * 1000)
}

/// Enabled, homed at the upper stop; the work is 2 mm below.
fn ready(settings: &Settings, plant: Plant, seed: u64) -> Machine {
    let settings = Settings { commissioned: true, ..*settings };
    let mut machine = Machine::new(plant, &settings, seed).unwrap();
    run(&mut machine, 0.01);
    for command in [Command::SetHome(Nanometres(0)), Command::Enable] {
        machine.command(command).unwrap();
    }
    run(&mut machine, 0.01);
    while machine.next_change().is_some() {}
    machine
}

/// The largest contact force meanwhile, N.
fn run(machine: &mut Machine, seconds: f64) -> f64 {
    let mut most = 0.0f64;
    for _ in 0..(seconds * f64::from(TICK_HZ)) as u64 {
        machine.tick();
        most = most.max(machine.process.truth().contact_n);
    }
    most
}

/// Until the search has come to its end; the largest contact force meanwhile, N.
fn search(machine: &mut Machine, reach: Nanometres) -> f64 {
    machine.command(Command::FindSurface(reach)).unwrap();
    let mut most = 0.0f64;
    for _ in 0..60 * TICK_HZ {
        machine.tick();
        most = most.max(machine.process.truth().contact_n);
        if machine.status().search != Search::Runs {
            return most;
        }
    }
    panic!("never ends: {:?}", machine.status());
}

/// The count at which the face of the electrode meets the highest peak of the work, by the truth.
fn surface(machine: &Machine) -> f64 {
    let truth = machine.process.truth();
    let offset = machine.status().position - truth.count;
    truth.position_um + truth.least_um + offset as f64
}

fn move_to(machine: &mut Machine, to: Nanometres) {
    let ramp = MicrometresPerSecond2(2e6);
    let limits = MotionLimits { velocity: MicrometresPerSecond(5e3), acceleration: ramp, deceleration: ramp };
    machine.command(Command::Position(to, limits)).unwrap();
    run(machine, 1.0);
    assert_eq!(machine.status().state, State::Ready);
    reasons(machine);
}

fn reasons(machine: &mut Machine) -> Vec<Reason> {
    std::iter::from_fn(|| machine.next_change()).map(|change| change.reason).collect()
}

#[test]
fn the_surface_is_found_to_a_count_however_fast_the_first_touch_is() {
    let mut farthest = 0;
    for seed in 1..=SEEDS {
        for (first, friction) in [(0.5, 0.1), (2.0, 0.3), (5.0, 0.1), (5.0, 0.3)] {
            let surface_mm = 1.5 + 0.0377 * seed as f64;
            let plant = Plant::with(&[
                ("model.friction_n", friction / 1.2),
                ("model.stiction_n", friction),
                ("workpiece.surface_mm", surface_mm),
            ])
            .unwrap();
            let settings = Settings { touch_first: first, ..Settings::default() };
            let mut machine = ready(&settings, plant, seed);
            let force = search(&mut machine, Nanometres(0));
            assert_eq!(reasons(&mut machine), [Reason::Positioned, Reason::Touched]);
            let status = *machine.status();
            assert_eq!((status.state, status.search, status.fault), (State::Ready, Search::Found, None));
            let off = status.touched as f64 - surface(&machine);
            assert!((-1.0..=1.0).contains(&off), "{first} mm/s, {friction} N, seed {seed}: off by {off} counts");
            assert!(force <= PRESSES, "{first} mm/s, {friction} N, seed {seed}: {force} N");
            assert!(status.overshoot <= OVERSHOOT, "{first} mm/s, {friction} N, seed {seed}: {}", status.overshoot);
            let back = machine.process.truth().least_um;
            assert!((95.0..105.0).contains(&back), "{first} mm/s, {friction} N, seed {seed}: {back} um above it");
            farthest = farthest.max(status.overshoot);
        }
    }
    assert!(farthest >= 2, "what the test is about: {farthest} counts");
}

#[test]
fn the_overshoot_told_is_how_far_the_electrode_was_past_the_surface() {
    let mut told = 0;
    for seed in 1..=SEEDS {
        let plant = Plant::with(&[("workpiece.surface_mm", 1.5 + 0.0377 * seed as f64)]).unwrap();
        let mut machine = ready(&Settings::default(), plant, seed);
        machine.command(Command::FindSurface(Nanometres(0))).unwrap();
        let mut deepest = f64::MIN;
        while machine.status().search == Search::Runs {
            machine.tick();
            deepest = deepest.max(-machine.process.truth().least_um);
        }
        let overshoot = machine.status().overshoot;
        assert!((f64::from(overshoot) - deepest).abs() <= 1.5, "seed {seed}: {overshoot} for {deepest} um");
        told += u64::from(overshoot > 0);
    }
    assert!(told > SEEDS / 2, "what the test is about");
}

#[test]
fn nothing_within_reach_is_an_answer_and_no_fault() {
    for (reach, ends) in [(um(500), 500), (um(1000), 1000), (um(0), 11_000)] {
        let settings = Settings { axis_stroke: 11_000.0, ..Settings::default() };
        let mut machine = ready(&settings, Plant::default(), 1);
        machine.process.happen("workpiece.raised_mm", Value::Number(-100.0)).unwrap();
        let force = search(&mut machine, reach);
        let status = machine.status();
        assert_eq!((status.state, status.search, status.fault), (State::Ready, Search::Missed, None));
        assert_eq!((status.touched, status.overshoot, force), (0, 0, 0.0));
        assert!((machine.process.truth().position_um - f64::from(ends)).abs() < 5.0, "{:?}", machine.process.truth());
        assert_eq!(reasons(&mut machine), [Reason::Positioned, Reason::NotTouched]);
    }
}

#[test]
fn a_lower_limit_switch_on_the_way_is_the_end_of_it_and_no_fault() {
    let plant = Plant::with(&[("limit.lower_mm", 4.0)]).unwrap();
    let mut machine = ready(&Settings::default(), plant, 1);
    machine.process.happen("workpiece.raised_mm", Value::Number(-100.0)).unwrap();
    machine.command(Command::FindSurface(um(0))).unwrap();
    let mut deepest = 0.0f64;
    while machine.status().search == Search::Runs {
        machine.tick();
        deepest = deepest.max(machine.process.truth().position_um);
    }
    run(&mut machine, 0.1);
    let status = machine.status();
    assert_eq!((status.state, status.search, status.fault), (State::Ready, Search::Missed, None));
    assert!((4000.0..4010.0).contains(&deepest), "{deepest} um");
    assert!((machine.process.truth().position_um - 3500.0).abs() < 15.0, "off the switch again");
    assert_eq!(reasons(&mut machine), [Reason::Positioned, Reason::NotTouched]);
    // One that stays open is a fault afterwards.
    machine.process.fault_inputs.safety.lower_limit = true;
    run(&mut machine, 0.01);
    assert_eq!(machine.status().fault, Some(Fault::LowerLimit));
}

#[test]
fn work_right_below_the_upper_limit_switch_is_found_without_a_fault() {
    let plant = Plant::with(&[("limit.upper_mm", 1.95)]).unwrap();
    let mut machine = ready(&Settings::default(), plant, 1);
    search(&mut machine, um(0));
    let highest = machine.process.truth().position_um;
    run(&mut machine, 0.1);
    let status = machine.status();
    assert_eq!((status.state, status.search, status.fault), (State::Ready, Search::Found, None));
    assert!((status.touched as f64 - surface(&machine)).abs() <= 1.0);
    assert!((1930.0..1955.0).contains(&highest), "{highest} um: it goes back as far as the switch");
}

#[test]
fn a_head_that_touches_already_goes_back_first_and_finds_the_same_surface() {
    for seed in 1..=SEEDS {
        let mut machine = ready(&Settings::default(), Plant::default(), seed);
        move_to(&mut machine, um(1500));
        // The work is put against the electrode, hardly so: one that presses on it looks like an encoder that has died.
        for tenths in 0.. {
            machine.process.happen("workpiece.raised_mm", Value::Number(0.498 + f64::from(tenths) * 1e-4)).unwrap();
            run(&mut machine, 0.01);
            if machine.status().gap.touches {
                break;
            }
        }
        search(&mut machine, um(500));
        let (status, off) = (*machine.status(), machine.status().touched as f64 - surface(&machine));
        assert_eq!((status.search, status.fault), (Search::Found, None), "seed {seed}");
        assert!((-1.0..=1.0).contains(&off), "seed {seed}: off by {off} counts");
    }
}

#[test]
fn a_gap_that_never_reads_open_is_told_and_nothing_goes_toward_the_work() {
    for signal in ["sense.off", "gap.saturated", "gap.short"] {
        let mut machine = ready(&Settings::default(), Plant::default(), 1);
        move_to(&mut machine, um(1000));
        machine.process.happen(signal, Value::Flag(true)).unwrap();
        run(&mut machine, 0.05);
        let before = machine.process.truth().position_um;
        machine.command(Command::FindSurface(um(0))).unwrap();
        while machine.status().search == Search::Runs {
            machine.tick();
            assert!(machine.process.truth().position_um < before + 2.0, "{signal}");
        }
        let status = machine.status();
        assert_eq!((status.search, status.fault, status.state), (Search::NotOpen, None, State::Ready), "{signal}");
        assert!((machine.process.truth().position_um - before + 100.0).abs() < 5.0, "{signal}: it has tried higher up");
    }
}

#[test]
fn work_that_is_taken_away_between_the_touches_is_not_found() {
    let mut machine = ready(&Settings::default(), Plant::default(), 1);
    machine.command(Command::FindSurface(um(0))).unwrap();
    while machine.process.truth().least_um > 0.0 {
        machine.tick();
    }
    run(&mut machine, 0.01);
    machine.process.happen("workpiece.raised_mm", Value::Number(-3.0)).unwrap();
    run(&mut machine, 2.0);
    let status = machine.status();
    assert_eq!((status.search, status.fault, status.touched), (Search::Missed, None, 0));
    let farthest = machine.process.truth().position_um;
    assert!((2050.0..2105.0).contains(&farthest), "{farthest} um: touch.back_um past the first touch at the most");
}

/// At moments all through a search, `then` is done.
fn interrupted(then: impl Fn(&mut Machine, u64)) {
    for moment in 0..60 {
        let mut machine = ready(&Settings::default(), Plant::default(), moment);
        move_to(&mut machine, um(1800));
        machine.command(Command::FindSurface(um(0))).unwrap();
        let force = run(&mut machine, moment as f64 * 7e-3);
        assert!(force <= PRESSES);
        then(&mut machine, moment);
    }
}

#[test]
fn disabling_holding_braking_and_stopping_break_a_search_off_wherever_it_is() {
    interrupted(|machine, moment| {
        let runs = machine.status().search == Search::Runs;
        let (search, touched) =
            if runs { (Search::BrokenOff, 0) } else { (machine.status().search, machine.status().touched) };
        let rest = match moment % 5 {
            0 => {
                machine.command(Command::Disable).unwrap();
                (State::Disabled, None)
            }
            1 => {
                machine.command(Command::Hold).unwrap();
                (if runs { State::Ready } else { State::HoldingPosition }, None)
            }
            2 => {
                machine.command(Command::Brake(MicrometresPerSecond2(1e6))).unwrap();
                (State::Ready, None)
            }
            3 => {
                machine.process.fault_inputs.safety.emergency_stop = true;
                (State::Fault, Some(Fault::EmergencyStop))
            }
            _ => {
                machine.raise(Fault::HostSilent);
                (State::Fault, Some(Fault::HostSilent))
            }
        };
        run(machine, 0.4);
        let status = machine.status();
        assert_eq!((status.search, status.touched), (search, touched), "{moment}");
        let contact = (State::Fault, Some(Fault::Contact));
        // Broken off in the contact itself, it is a contact.
        let pressed = runs && matches!(moment % 5, 1 | 2) && (status.state, status.fault) == contact;
        assert!(pressed || (status.state, status.fault) == rest, "{moment}: {:?} {:?}", status.state, status.fault);
    });
}

#[test]
fn what_is_asked_for_where_it_cannot_be_is_refused_and_nothing_moves() {
    let mut machine = ready(&Settings::default(), Plant::default(), 1);
    let before = machine.process.truth().count;
    let beyond = |target: i64| Refused::OutOfTravel { target: um(target), min: um(0), max: um(12_000) };
    assert_eq!(machine.command(Command::FindSurface(um(12_001))), Err(beyond(12_001)));
    assert_eq!(machine.command(Command::FindSurface(um(-1))), Err(beyond(-1)));
    machine.command(Command::MoveTo(um(2500))).unwrap();
    assert_eq!(machine.command(Command::FindSurface(um(0))), Err(Refused::PathActive));
    machine.command(Command::Start).unwrap();
    run(&mut machine, 0.01);
    assert_eq!(machine.command(Command::FindSurface(um(0))), Err(Refused::State(State::Seeking)));
    while machine.status().state != State::Eroding {
        machine.tick();
    }
    assert_eq!(machine.command(Command::FindSurface(um(0))), Err(Refused::State(State::Eroding)));
    machine.command(Command::Disable).unwrap();
    run(&mut machine, 0.01);
    assert_eq!(machine.command(Command::FindSurface(um(0))), Err(Refused::State(State::Disabled)));

    let slow = Settings { contact_approach: 1.0, ..Settings::default() };
    let too_fast = Refused::TooFast { velocity: MicrometresPerSecond(5000.0), most: MicrometresPerSecond(1000.0) };
    let mut machine = ready(&slow, Plant::default(), 1);
    assert_eq!(machine.command(Command::FindSurface(um(0))), Err(too_fast));
    let blind = Settings { contact_below: 0.0, ..Settings::default() };
    let mut blind = ready(&blind, Plant::default(), 1);
    assert_eq!(blind.command(Command::FindSurface(um(0))), Err(Refused::NoSense));
    for machine in [machine, blind] {
        assert_eq!((machine.process.truth().count, machine.status().search), (before, Search::Never));
    }
    let settings = Settings { touch_second: 3.0, touch_first: 2.0, ..Settings::default() };
    assert!(settings.build().unwrap_err().to_string().contains("touch.first_mm_s"));
}

#[test]
fn a_search_right_after_pulses_waits_for_the_sense_supply() {
    for seed in 1..=SEEDS {
        let mut machine = ready(&Settings::default(), Plant::default(), seed);
        machine.command(Command::MoveTo(um(2100))).unwrap();
        machine.command(Command::Start).unwrap();
        while machine.status().state != State::Eroding {
            machine.tick();
        }
        run(&mut machine, 1.0);
        machine.command(Command::Hold).unwrap();
        run(&mut machine, 0.0005);
        machine.command(Command::ClearPath).unwrap();
        search(&mut machine, um(500));
        let off = machine.status().touched as f64 - surface(&machine);
        assert_eq!((machine.status().search, machine.status().fault), (Search::Found, None), "seed {seed}");
        assert!((-1.5..=1.0).contains(&off), "seed {seed}: off by {off} counts");
    }
}

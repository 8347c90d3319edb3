//! Electrode and work in motions with pulses off, on the process model: 0.2 kg, 2 N/um, a sense supply of 11 V.

use edm_servo_head::head::{Command, Fault, Home, HomingState, MotionLimits, Probe, Reason, Refused, Source, State};
use edm_servo_head::motion::{Method, Missed};
use edm_servo_head::settings::{Settings, Value};
use edm_servo_head::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres, TICK_HZ};
use edm_sim::machine::Machine;
use edm_sim::process::Plant;

/// What a contact may press, N: at the approach of 5 mm/s, and at 20 mm/s through space that has been cleared.
const APPROACHING: f64 = 5.0;
const CLEARED: f64 = 15.0;
const SEEDS: u64 = 20;

fn mm(mm: f64) -> Nanometres {
    Nanometres((mm * 1e6) as i64)
}

fn at(mm_s: f32) -> MotionLimits {
    let ramp = MicrometresPerSecond2(2e6);
    MotionLimits { velocity: MicrometresPerSecond(mm_s * 1e3), acceleration: ramp, deceleration: ramp }
}

/// Enabled, homed at the upper stop; the work is 2 mm below.
fn ready(settings: &Settings, seed: u64) -> Machine {
    let settings = Settings { commissioned: true, ..*settings };
    let mut machine = Machine::new(Plant::default(), &settings, seed).unwrap();
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

fn reasons(machine: &mut Machine) -> Vec<Reason> {
    std::iter::from_fn(|| machine.next_change()).map(|change| change.reason).collect()
}

#[test]
fn a_move_into_the_work_ends_in_a_contact_that_is_told_and_left_however_fast_it_was_asked_to_be() {
    for seed in 1..=SEEDS {
        for velocity in [1.0, 5.0, 20.0, 100.0] {
            let mut machine = ready(&Settings::default(), seed);
            machine.command(Command::Position(mm(2.18), at(velocity))).unwrap();
            let force = run(&mut machine, 2.0 / f64::from(velocity.min(5.0)) + 1.0);
            assert!(force <= APPROACHING, "{velocity} mm/s, seed {seed}: {force} N");
            assert_eq!(reasons(&mut machine), [Reason::Positioned, Reason::Fault(Fault::Contact)]);
            assert!(
                machine.process.truth().gap_um > 400.0,
                "{velocity} mm/s, seed {seed}: {:?}",
                machine.process.truth()
            );
        }
    }
}

#[test]
fn space_that_was_cleared_is_gone_through_fast_and_what_has_been_put_there_since_is_felt() {
    for seed in 1..=SEEDS {
        let mut machine = ready(&Settings::default(), seed);
        machine.command(Command::Position(mm(1.9), at(20.0))).unwrap();
        run(&mut machine, 0.7);
        assert_eq!(machine.status().state, State::Ready, "5 mm/s take 0.38 s");
        machine.command(Command::Position(mm(0.0), at(20.0))).unwrap();
        run(&mut machine, 0.2);
        machine.command(Command::Position(mm(1.9), at(20.0))).unwrap();
        run(&mut machine, 0.15);
        assert_eq!(machine.status().state, State::Ready, "20 mm/s take 0.1 s");
        machine.command(Command::Position(mm(0.0), at(20.0))).unwrap();
        run(&mut machine, 0.2);
        machine.process.happen("workpiece.raised_mm", Value::Number(1.0)).unwrap();
        machine.command(Command::Position(mm(1.9), at(20.0))).unwrap();
        let force = run(&mut machine, 0.5);
        assert!(force > 0.0 && force <= CLEARED, "seed {seed}: {force} N");
        assert_eq!(machine.status().fault, Some(Fault::Contact));
    }
}

#[test]
fn a_head_that_was_disabled_has_cleared_nothing() {
    let mut machine = ready(&Settings::default(), 1);
    let down = |machine: &mut Machine| {
        machine.command(Command::Position(mm(1.5), at(20.0))).unwrap();
        run(machine, 0.2);
        machine.status().state
    };
    assert_eq!(down(&mut machine), State::Positioning);
    run(&mut machine, 0.2);
    machine.command(Command::Position(mm(0.0), at(20.0))).unwrap();
    run(&mut machine, 0.2);
    assert_eq!(down(&mut machine), State::Ready);
    machine.command(Command::Position(mm(0.0), at(20.0))).unwrap();
    run(&mut machine, 0.2);
    machine.command(Command::Disable).unwrap();
    run(&mut machine, 0.01);
    machine.command(Command::Enable).unwrap();
    run(&mut machine, 0.01);
    assert_eq!(down(&mut machine), State::Positioning);
    assert!(machine.status().approaching);
}

#[test]
fn whoever_asks_to_touch_finds_the_work_to_a_few_counts_and_does_not_press() {
    for seed in 1..=SEEDS {
        let mut machine = ready(&Settings::default(), seed);
        machine.command(Command::Touch(mm(3.0), at(5.0))).unwrap();
        let force = run(&mut machine, 1.0);
        assert!(force <= APPROACHING, "seed {seed}: {force} N");
        assert_eq!(reasons(&mut machine), [Reason::Positioned, Reason::Touched]);
        let (status, truth) = (machine.status(), machine.process.truth());
        assert_eq!((status.state, status.fault), (State::Ready, None));
        // The peaks are met first.
        let highest = truth.position_um + truth.least_um;
        assert!((status.touched as f64 - highest).abs() <= 3.0, "seed {seed}: {} for {highest}", status.touched);
        assert!(truth.contact_n <= APPROACHING, "seed {seed}: {truth:?}");
        // Away from the work nothing is in the way.
        machine.command(Command::Position(mm(1.0), at(20.0))).unwrap();
        run(&mut machine, 0.5);
        assert_eq!((machine.status().state, machine.status().fault), (State::Ready, None));
    }
}

#[test]
fn homing_into_the_work_is_a_homing_error_and_leaves_it() {
    let mut machine = ready(&Settings::default(), 1);
    let home = Home {
        method: Method::MarkBelow,
        fast: MicrometresPerSecond(1e5),
        slow: MicrometresPerSecond(1e4),
        acceleration: MicrometresPerSecond2(2e6),
        at: Nanometres(0),
    };
    machine.command(Command::Home(home)).unwrap();
    let force = run(&mut machine, 2.0);
    assert!(force <= APPROACHING, "{force} N");
    let status = *machine.status();
    assert_eq!((status.fault, status.homing), (None, HomingState::Failed(Missed::Touched)));
    assert!(!status.homed || status.position < 1600, "{status:?}");
    assert!(machine.process.truth().gap_um > 400.0, "{:?}", machine.process.truth());
}

/// The count at which electrode and work have first touched, as the model knows it.
fn first_touch(machine: &mut Machine, seconds: f64) -> Option<i64> {
    let mut count = None;
    for _ in 0..(seconds * f64::from(TICK_HZ)) as u64 {
        machine.tick();
        if count.is_none() && machine.process.truth().least_um <= 0.0 {
            count = Some(machine.process.truth().count);
        }
    }
    count
}

#[test]
fn homing_finds_the_work_to_a_count_and_without_pulses_at_any_velocity_up_to_5_mm_s() {
    for seed in 1..=SEEDS {
        for slow in [100.0, 1000.0, 5000.0, 20_000.0] {
            let mut machine = ready(&Settings::default(), seed);
            machine.command(Command::Position(mm(1.5), at(20.0))).unwrap();
            run(&mut machine, 0.5);
            let home = Home {
                method: Method::Contact,
                fast: MicrometresPerSecond(1e5),
                slow: MicrometresPerSecond(slow),
                acceleration: MicrometresPerSecond2(2e6),
                at: mm(4.0),
            };
            machine.command(Command::Home(home)).unwrap();
            let truth = first_touch(&mut machine, 600.0 / f64::from(slow) + 0.3).unwrap();
            let status = *machine.status();
            assert_eq!((status.fault, status.homing), (None, HomingState::Done), "{slow} um/s, seed {seed}");
            // What was the true count is 4 mm now; the axis stands 10 um above.
            let off = status.touched - truth;
            assert!(off.abs() <= 1, "{slow} um/s, seed {seed}: {off} counts off");
            assert_eq!(machine.process.truth().count - status.position, status.touched - 4000);
            assert!((status.position - 3990).abs() <= 1, "{status:?}");
        }
    }
}

/// The touch probe against what the model knows: counts and ticks by which it is off at the most.
#[test]
fn a_probe_keeps_the_count_and_the_tick_of_a_contact() {
    for seed in 1..=SEEDS {
        for velocity in [0.5, 2.0, 5.0] {
            let mut machine = ready(&Settings::default(), seed);
            machine.command(Command::Position(mm(1.8), at(20.0))).unwrap();
            run(&mut machine, 0.5);
            let probe = Probe { source: Source::Contact, every: false, edges: [true; 2], armed: 1 };
            machine.command(Command::Probe([probe, Probe::default()])).unwrap();
            machine.command(Command::Touch(mm(3.0), at(velocity))).unwrap();
            let (mut touched, mut left) = (None, None);
            for _ in 0..(0.4 / f64::from(velocity) * f64::from(TICK_HZ)) as u64 + 4000 {
                machine.tick();
                let (truth, tick) = (machine.process.truth(), machine.status().tick);
                let touches = truth.least_um <= 0.0;
                if touches {
                    touched = touched.or(Some((truth.count, tick)));
                    left = None;
                } else if touched.is_some() {
                    left = left.or(Some((truth.count, tick)));
                }
            }
            let [kept, off] = machine.status().probes;
            assert_eq!((kept.probe, off.probe), (probe, Probe::default()));
            // The counts of a head that was homed at the upper stop are the true ones.
            let [(count, tick), end] = [touched, left].map(Option::unwrap);
            let [begun, ended] = kept.edges;
            let late = begun.tick.wrapping_sub(tick).cast_signed();
            assert!(
                (begun.position - count).abs() <= 1 && (0..=2).contains(&late),
                "{velocity} mm/s, seed {seed}: {kept:?}"
            );
            assert_eq!(begun.count, 1, "the first is kept");
            // It may come off and touch again: the first end is no later than the last.
            assert!(ended.count == 1 && ended.tick.wrapping_sub(end.1).cast_signed() <= 2, "{kept:?}, {end:?}");
        }
    }
}

#[test]
fn there_is_no_homing_on_contact_without_a_sense_supply() {
    let mut machine = ready(&Settings { contact_below: 0.0, ..Settings::default() }, 1);
    let slow = MicrometresPerSecond(1e3);
    let acceleration = MicrometresPerSecond2(2e6);
    let home = Home { method: Method::Contact, fast: slow, slow, acceleration, at: Nanometres(0) };
    assert_eq!(machine.command(Command::Home(home)), Err(Refused::NoSense));
}

#[test]
fn a_motion_broken_off_just_above_the_work_does_not_come_to_rest_in_it() {
    let mut felt = 0;
    for tenths in (10..=80).step_by(5) {
        let mut machine = ready(&Settings::default(), tenths);
        machine.command(Command::Position(mm(2.5), at(5.0))).unwrap();
        let gap = tenths as f64 * 0.1;
        while machine.process.truth().least_um > gap {
            machine.tick();
        }
        // The set point stands at once, ahead of the head.
        machine.command(Command::Brake(MicrometresPerSecond2(1e8))).unwrap();
        let force = run(&mut machine, 2.0);
        assert!(force <= APPROACHING, "{gap} um above the work: {force} N");
        let status = machine.status();
        felt += u32::from(status.fault == Some(Fault::Contact));
        assert!(matches!(status.fault, None | Some(Fault::Contact)), "{gap} um above the work: {:?}", status.fault);
    }
    assert!(felt > 0, "what the test is about");
}

/// A head that has moved and come to rest, before anything breaks that would feel a contact.
fn without_sense(signal: &str) {
    let mut machine = ready(&Settings::default(), 1);
    machine.command(Command::Position(mm(0.5), at(5.0))).unwrap();
    run(&mut machine, 0.3);
    machine.process.happen(signal, Value::Flag(true)).unwrap();
    let before = machine.process.truth().position_um;
    machine.command(Command::Position(mm(0.2), at(5.0))).unwrap();
    run(&mut machine, 0.3);
    assert_eq!((machine.status().state, machine.status().fault), (State::Ready, None), "upward it may");
    machine.command(Command::Position(mm(1.0), at(5.0))).unwrap();
    run(&mut machine, 0.3);
    assert_eq!(machine.status().fault, Some(Fault::Contact));
    assert!(machine.process.truth().position_um < before);
}

#[test]
fn without_the_sense_supply_nothing_moves_toward_the_work() {
    without_sense("sense.off");
}

#[test]
fn with_a_converter_at_the_end_of_its_range_nothing_moves_toward_the_work() {
    without_sense("gap.saturated");
}

#[test]
fn a_head_without_a_sense_supply_cannot_be_asked_to_touch_and_approaches_slowly_all_the_same() {
    let mut machine = ready(&Settings { contact_below: 0.0, ..Settings::default() }, 1);
    assert_eq!(machine.command(Command::Touch(mm(3.0), at(5.0))), Err(Refused::NoSense));
    machine.command(Command::Position(mm(1.9), at(100.0))).unwrap();
    run(&mut machine, 0.2);
    assert!((4000.0..6000.0).contains(&machine.process.truth().velocity_um_s), "{:?}", machine.process.truth());
}

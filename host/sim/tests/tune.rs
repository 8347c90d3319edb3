//! Tuning: the response that a head measures is that of its loop, whatever comes between ends it safely, and it stays where it may.
//!
//! Simulated: five machines on the process model, whose settings are off by up to a quarter. `EDM_TUNE=8` takes eight seeds each.

use edm_servo_head::head::{Command, Evidence, Fault, Point, Reason, State, TuneStep};
use edm_servo_head::settings::{Settings, Value};
use edm_sim::kinds::{Complex, KINDS, Kind, above, open_loop, over, position, ready, run, size, times, with};
use edm_sim::machine::Machine;

/// What a tuning has found, and on the way: points, largest current, highest and lowest place against that where it began, um.
struct Found {
    points: Vec<Point>,
    amps: f64,
    reach_um: (f64, f64),
    seconds: f64,
}

fn tuned(machine: &mut Machine, kind: &Kind) -> Found {
    let begun = machine.process.truth();
    while machine.next_change().is_some() {}
    machine.command(Command::Tune).unwrap();
    let mut found = Found { points: Vec::new(), amps: 0.0, reach_um: (0.0, 0.0), seconds: 0.0 };
    let mut reason = None;
    let ended = run(machine, 200.0, |machine| {
        let truth = machine.process.truth();
        found.amps = found.amps.max(f64::from(machine.status().current.0.abs()));
        let um = truth.position_um - begun.position_um;
        found.reach_um = (found.reach_um.0.min(um), found.reach_um.1.max(um));
        found.seconds = truth.t_s - begun.t_s;
        if let Some(Evidence::Point(point)) = machine.next_evidence() {
            found.points.push(point);
        }
        while let Some(change) = machine.next_change() {
            reason = Some(change.reason);
        }
        reason == Some(Reason::Tuned) || machine.status().fault.is_some()
    });
    let status = machine.status();
    assert!(ended && status.fault.is_none(), "{}: {:?} {:?}", kind.name, status.state, status.fault);
    assert_eq!((status.state, status.tunes), (State::Ready, TuneStep::None));
    found
}

/// Share of the truth by which a measured value is wrong, and may be by what is stated: three of its deviations.
fn wrong(value: [f32; 3], truth: Complex) -> (f64, f64) {
    let ratio = over((f64::from(value[0]), f64::from(value[1])), truth);
    (size((ratio.0 - 1.0, ratio.1)), 3.0 * f64::from(value[2]) / size(truth))
}

/// Share that no deviation states: of the loop, what the held sine brings back; of the motion, also edges between whole counts. Where an
/// edge does not come in every tick, what the velocity does to fast changes is no linear thing, and the truth here is an approximation.
const LOOP: f64 = 0.03;
const COARSE: f64 = 0.1;
const MOTION: f64 = 0.05;

#[test]
fn the_measured_response_is_that_of_the_loop() {
    let seeds = std::env::var("EDM_TUNE").ok().and_then(|seeds| seeds.parse().ok()).unwrap_or(1u64);
    let mut bad = Vec::new();
    println!("| machine | L within, 20 to 500 Hz | to 1000 Hz | motion within | seconds | A |");
    for kind in &KINDS {
        let (mut near, mut far, mut motion, mut seconds, mut amps) = (0.0f64, 0.0f64, 0.0f64, 0.0f64, 0.0f64);
        for seed in 0..seeds {
            let (mut machine, settings) = ready(kind, seed);
            let found = tuned(&mut machine, kind);
            assert_eq!(found.points.len(), settings.tune_points as usize, "{} {seed}", kind.name);
            (seconds, amps) = (seconds.max(found.seconds), amps.max(found.amps));
            // Nothing toward the work but what a loop swings about its place; no more than its length.
            let (up, down) = found.reach_um;
            assert!(down < 20.0 && up > -3000.0, "{} {seed}: {up} to {down} um", kind.name);
            assert!(found.amps < 1.5, "{} {seed}: {} A", kind.name, found.amps);
            for point in &found.points {
                let hz = f64::from(point.hz);
                let counts_s = f64::from(settings.tune_velocity) * 1e3 / kind.count_um;
                let (l, stated) = wrong(point.open, open_loop(kind, &settings, hz, counts_s));
                let velocity = times(position(kind, hz), (0.0, std::f64::consts::TAU * hz * 1e3));
                let (g, g_stated) = wrong(point.plant, velocity);
                let coarse = counts_s < 20_000.0 && hz > 500.0;
                if l > if coarse { COARSE } else { LOOP } + stated || g > MOTION + g_stated {
                    bad.push(format!(
                        "{} {seed}: {hz:.0} Hz: L {l:.3} off (3 s: {stated:.3}), G {g:.3} ({g_stated:.3})",
                        kind.name
                    ));
                }
                match hz {
                    ..20.0 => {}
                    ..500.0 => near = near.max(l),
                    _ => far = far.max(l),
                }
                motion = motion.max(if hz > 20.0 { g } else { 0.0 });
            }
        }
        println!(
            "| {} | {:.1} % | {:.1} % | {:.1} % | {seconds:.0} | {amps:.2} |",
            kind.name,
            near * 100.0,
            far * 100.0,
            motion * 100.0
        );
    }
    assert!(bad.is_empty(), "{bad:#?}");
}

/// Gains that are set while it measures: each point is of one loop.
#[test]
fn a_gain_that_changes_begins_its_frequency_anew() {
    let kind = &KINDS[0];
    let (mut machine, settings) = ready(kind, 3);
    let other = Settings { servo_velocity_hz: 120.0, servo_position_hz: 30.0, ..settings };
    machine.command(Command::Tune).unwrap();
    let (mut points, mut changed) = (Vec::new(), false);
    run(&mut machine, 60.0, |machine| {
        if let Some(Evidence::Point(point)) = machine.next_evidence() {
            points.push(point);
        }
        // In the middle of a frequency about the cross-over.
        if points.len() == 12 && !changed {
            run(machine, 0.6, |_| false);
            machine.configure(&other.build().unwrap()).unwrap();
            changed = true;
        }
        points.len() > 12
    });
    let hz = f64::from(points[12].hz);
    let (new, old) = (open_loop(kind, &other, hz, 25e3), open_loop(kind, &settings, hz, 25e3));
    assert!(wrong(points[12].open, new).0 < LOOP && wrong(points[12].open, old).0 > 0.2, "{:?}", points[12]);
}

/// Whatever comes between, at any step, ends it where it ends any positioning.
#[test]
fn whatever_comes_between_ends_in_hold_or_in_the_reaction_of_the_fault() {
    type Act = fn(&mut Machine);
    let what: [(&str, Act, State, Option<Fault>); 5] = [
        ("hold", |machine| machine.command(Command::Hold).unwrap(), State::Ready, None),
        ("disable", |machine| machine.command(Command::Disable).unwrap(), State::Disabled, None),
        ("silence", |machine| machine.raise(Fault::HostSilent), State::Fault, Some(Fault::HostSilent)),
        (
            "upper limit",
            |machine| machine.process.fault_inputs.safety.upper_limit = true,
            State::Fault,
            Some(Fault::UpperLimit),
        ),
        (
            "stop",
            |machine| machine.process.fault_inputs.safety.emergency_stop = true,
            State::Fault,
            Some(Fault::EmergencyStop),
        ),
    ];
    for (number, (name, disturb, state, fault)) in what.into_iter().enumerate() {
        for step in [TuneStep::Rise, TuneStep::Measure, TuneStep::Return] {
            let settings = |settings: &mut Settings| settings.tune_points = 3;
            let (mut machine, _) = with(&KINDS[0], number as u64, 3.0, settings);
            machine.command(Command::Tune).unwrap();
            assert!(run(&mut machine, 60.0, |machine| machine.status().tunes == step), "{step:?} never comes");
            run(&mut machine, if step == TuneStep::Measure { 1.3 } else { 0.01 }, |_| false);
            let before = machine.process.truth().count;
            disturb(&mut machine);
            run(&mut machine, 1.0, |_| false);
            let status = machine.status();
            assert_eq!(
                (status.state, status.fault, status.tunes),
                (state, fault, TuneStep::None),
                "{name} in {step:?}"
            );
            assert!(!machine.pulses());
            // Not toward the work, but for what a hold takes to brake.
            let down = machine.process.truth().count - before;
            assert!(down < 150, "{name} in {step:?}: {down} um down");
        }
    }
}

/// As in `dead_encoder.rs`.
const CONTACT_N: f64 = 5.0;

#[test]
fn an_encoder_that_is_cut_is_named_and_presses_nothing_into_the_work() {
    let mut bad = Vec::new();
    for (number, kind) in KINDS.iter().enumerate() {
        for seconds in [0.05, 0.4, 0.75, 2.3, 6.1] {
            // Just above the work.
            let (mut machine, _) = above(kind, number as u64, 0.2);
            machine.command(Command::Tune).unwrap();
            run(&mut machine, seconds, |_| false);
            machine.process.happen("encoder.cut", Value::Flag(true)).unwrap();
            let mut contact = 0.0f64;
            run(&mut machine, 4.0, |machine| {
                contact = contact.max(machine.process.truth().contact_n);
                false
            });
            let status = machine.status();
            println!("{:7} {seconds} s: {contact:.2} N, {:?} {:?}", kind.name, status.state, status.fault);
            let named = matches!(status.fault, Some(Fault::EncoderLost | Fault::FollowingError | Fault::PolarityWrong));
            if contact > CONTACT_N || !named || status.state != State::Fault || machine.pulses() {
                bad.push(format!("{} {seconds} s: {contact:.2} N, {:?}", kind.name, status.fault));
            }
        }
    }
    assert!(bad.is_empty(), "{bad:#?}");
}

#[test]
fn what_cannot_be_is_refused_before_anything_moves() {
    let (mut machine, settings) = ready(&KINDS[0], 0);
    let refuses = |machine: &mut Machine, what: &str| {
        let refused = machine.command(Command::Tune).unwrap_err().to_string();
        assert!(refused.contains(what), "{refused}");
        assert_ne!(machine.status().state, State::Identifying);
    };
    // 6 mm are free above.
    let long = Settings { tune_travel: 7000.0, ..settings };
    machine.configure(&long.build().unwrap()).unwrap();
    refuses(&mut machine, "7000 um upward is longer than the 6000 um");
    machine.configure(&settings.build().unwrap()).unwrap();
    machine.command(Command::Disable).unwrap();
    refuses(&mut machine, "disabled");
    for (wrong, key) in [
        (Settings { tune_current: 3.1, ..settings }, "tune.current_a"),
        (Settings { tune_lowest: 200.0, tune_highest: 300.0, ..settings }, "tune.lowest_hz"),
    ] {
        let why = wrong.build().unwrap_err().to_string();
        assert!(why.contains(key), "{why}");
    }
}

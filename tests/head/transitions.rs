//! The changes of state that a head makes are those of the table, and it makes all of them.

use crate::bench::Bench;
use edm_servo_head::head::{Carry, Command, Fault, Home, MotionLimits, Reason, SeenBy, State, TRANSITIONS};
use edm_servo_head::motion::Method;
use edm_servo_head::path::{Piece, Shape};
use edm_servo_head::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus as Random;

/// Ticks that a head is left alone between two interventions at the most; one time in ten longer.
const PAUSE: u32 = 1000;
const LONG_PAUSE: u32 = 20_000;

fn um(um: i64) -> Nanometres {
    Nanometres(um * 1000)
}

fn command(random: &mut Random) -> Command {
    let acceleration = MicrometresPerSecond2(1e7);
    match random.random_range(0..24) {
        0..4 => Command::Enable,
        4 => Command::Disable,
        5 | 22 => Command::Hold,
        6 => Command::Commission,
        7 => Command::ClearPath,
        8 => Command::Brake(acceleration),
        9..12 => Command::Start,
        12..14 => Command::Guide,
        14..17 => Command::MoveBy(um(random.random_range(1..300))),
        17..19 => Command::ResetFault,
        19 | 23 => {
            let to = um(random.random_range(100..9000));
            let velocity = MicrometresPerSecond(2e4);
            let limits = MotionLimits { velocity, acceleration, deceleration: acceleration };
            if random.random() { Command::Position(to, limits) } else { Command::Touch(to, limits) }
        }
        _ => Command::Home(Home {
            method: if random.random() { Method::UpperLimit } else { Method::MarkBelow },
            fast: MicrometresPerSecond(1e5),
            slow: MicrometresPerSecond(1e4),
            acceleration,
            at: um(0),
        }),
    }
}

/// Moves the work or pulls at a wire, and puts it back later.
fn disturb(bench: &mut Bench, random: &mut Random) {
    match random.random_range(0..40) {
        0..8 => (bench.surface_um, bench.follows) = (bench.um() - 1.0, None),
        // It erodes: the work gives way.
        8..18 => bench.follows = Some(35.0),
        18..30 => (bench.surface_um, bench.follows) = (bench.um() + 5000.0, None),
        30 => bench.head.raise(Fault::EncoderLost),
        31 => bench.head.raise(Fault::FollowingError),
        32 => bench.safety.emergency_stop = true,
        _ => bench.safety.emergency_stop = false,
    }
}

type Seen = Vec<(State, State, Reason)>;

fn note(bench: &mut Bench, seen: &mut Seen) {
    for change in bench.changes() {
        let change = (change.from, change.to, change.reason);
        if !seen.contains(&change) {
            seen.push(change);
        }
    }
}

#[test]
fn the_table_of_transitions_is_what_heads_do() {
    let mut seen = Seen::new();
    for seed in 0..160 {
        let mut random = Random::seed_from_u64(seed);
        let mut bench = Bench::with(|settings| {
            settings.seek_settle_ms = 10.0;
            settings.seek_velocity = 5000.0;
        });
        // An axis longer than its settings say, where homing ends in vain.
        let long = seed % 4 == 0;
        if long {
            bench.stroke_m = 0.03;
        }
        bench.make_ready();
        for _ in 0..300 {
            for _ in 0..random.random_range(0..4) {
                let _ = bench.head.command(command(&mut random));
            }
            if bench.state() == State::Done && random.random() {
                // Rarely in this order by chance.
                let _ = bench.head.command(Command::MoveBy(Nanometres(100_000)));
                let _ = bench.head.command(if random.random() { Command::Start } else { Command::Hold });
            }
            disturb(&mut bench, &mut random);
            let most =
                if bench.state() == State::Homing || random.random_range(0..10) == 0 { LONG_PAUSE } else { PAUSE };
            for _ in 0..random.random_range(1..most) {
                bench.safety.upper_limit = bench.um() < 1.0;
                bench.safety.lower_limit = !long && bench.um() > 11_000.0;
                bench.tick();
                note(&mut bench, &mut seen);
            }
        }
    }
    // It takes a home and some way into the work, which chance seldom brings about.
    let brake = Command::Brake(MicrometresPerSecond2(1e7));
    for then in [None, Some(Command::Hold), Some(brake), Some(Command::Disable)] {
        for fault in [false, true] {
            let mut bench = Bench::eroding();
            bench.command(Command::Jump);
            bench.run(0.01);
            if let Some(then) = then {
                bench.command(then);
            } else if fault {
                bench.head.raise(Fault::HostSilent);
            }
            bench.run(0.3);
            note(&mut bench, &mut seen);
        }
    }
    // Ends that take a path followed to its last count, with and without a lift.
    for (lift, spark_out, through) in [(0.0, 0.0, 0.0), (0.0, 500.0, 0.0), (0.0, 5000.0, 0.0), (0.0, 0.0, 10.0)] {
        for lift in [lift, 300.0] {
            for disable in [false, true] {
                let mut bench = Bench::with(|settings| {
                    (settings.end_lift, settings.end_spark_out_ms) = (lift, spark_out);
                    (settings.end_through, settings.end_window_ms) = (through, 100.0);
                });
                bench.make_ready();
                bench.command(Command::MoveTo(um(if through > 0.0 { 3000 } else { 2050 })));
                bench.command(Command::Start);
                bench.run_until(10.0, |bench| bench.state() == State::Eroding);
                (bench.follows, bench.surface_um) = (None, if through > 0.0 { 2100.0 } else { 2095.0 });
                bench.run(if spark_out > 0.0 { 0.3 } else { 0.0 });
                if spark_out != 500.0 {
                    bench.surface_um = 1e6;
                }
                bench.run_until(3.0, |bench| matches!(bench.state(), State::Lifting | State::Done));
                if bench.state() == State::Lifting {
                    match (disable, spark_out > 0.0, through > 0.0) {
                        (true, _, true) => bench.command(Command::Disable),
                        (true, ..) if spark_out > 1000.0 => bench.command(Command::Hold),
                        (true, true, _) => bench.head.raise(Fault::HostSilent),
                        _ => {}
                    }
                }
                bench.run(0.5);
                note(&mut bench, &mut seen);
            }
        }
    }
    for lift in [0.0, 300.0] {
        let mut bench = Bench::with(|settings| settings.end_lift = lift);
        bench.make_ready();
        bench.surface_um = 1e6;
        let stop = Piece { shape: Shape::Line, to: [500_000, 0, 0], centre: [0; 2], mark: false, stop: true };
        bench.command(Command::AppendTo(stop));
        bench.command(Command::AppendBy(Piece { to: [250_000, 0, 0], ..stop }));
        bench.command(Command::MoveTo(um(1000)));
        for surface in [1e6, 700.0, 1e6] {
            bench.surface_um = surface;
            bench.command(Command::Start);
            bench.run(0.01);
            bench.run_until(3.0, |bench| matches!(bench.state(), State::Eroding | State::Done));
            (bench.follows, bench.surface_um) = (None, 1e6);
            bench.run_until(3.0, |bench| bench.state() == State::Done);
            note(&mut bench, &mut seen);
        }
    }
    // A jump for which there is not all the room that it is set to take.
    let mut bench = Bench::with(|settings| (settings.jump_every_ms, settings.jump_height) = (200.0, 3000.0));
    bench.make_ready();
    bench.erode();
    bench.run(0.5);
    note(&mut bench, &mut seen);
    // Searches for a surface, out of every rest, that end in each way.
    for (surface, then) in [
        (2100.0, None),
        (1e6, None),
        (1e6, Some(Command::Hold)),
        (1e6, Some(Command::Disable)),
        (1e6, Some(Command::ResetFault)),
    ] {
        for rest in [State::Ready, State::HoldingPosition, State::Done] {
            let mut bench = Bench::with(|_| ());
            bench.make_ready();
            bench.surface_um = 1e6;
            if rest == State::Done {
                bench.command(Command::MoveTo(um(500)));
                bench.command(Command::Start);
                bench.run_until(3.0, |bench| bench.state() == State::Done);
            } else if rest == State::HoldingPosition {
                bench.command(Command::Hold);
            }
            bench.surface_um = surface;
            bench.command(Command::FindSurface(um(3000)));
            bench.run(0.1);
            match then {
                Some(Command::ResetFault) => bench.head.raise(Fault::HostSilent),
                Some(then) => bench.command(then),
                None => bench.run_until(3.0, |bench| bench.state() == State::Ready),
            }
            bench.run(0.1);
            note(&mut bench, &mut seen);
        }
    }
    // Identifications and tunings, out of every rest, that end in each way.
    for measures in [Command::Identify, Command::Tune] {
        for then in [None, Some(Command::Hold), Some(Command::Disable), Some(Command::ResetFault)] {
            for rest in [State::Ready, State::HoldingPosition, State::Done] {
                let mut bench = Bench::with(|settings| {
                    (settings.identify_travel, settings.tune_travel) = (500.0, 500.0);
                    (settings.tune_points, settings.tune_lowest) = (3, 50.0);
                });
                bench.make_ready();
                bench.surface_um = 1e6;
                bench.command(Command::MoveTo(um(1000)));
                bench.command(Command::Start);
                bench.run_until(3.0, |bench| bench.state() == State::Done);
                match rest {
                    State::Ready => {
                        let (velocity, acceleration) = (MicrometresPerSecond(2e4), MicrometresPerSecond2(1e7));
                        let limits = MotionLimits { velocity, acceleration, deceleration: acceleration };
                        bench.command(Command::Position(um(1100), limits));
                        bench.run_until(3.0, |bench| bench.state() == State::Ready);
                    }
                    State::HoldingPosition => bench.command(Command::Hold),
                    _ => {}
                }
                bench.command(measures);
                bench.run(0.1);
                match then {
                    Some(Command::ResetFault) => bench.head.raise(Fault::HostSilent),
                    Some(then) => bench.command(then),
                    None => bench.run_until(30.0, |bench| bench.state() == State::Ready),
                }
                bench.run(0.1);
                note(&mut bench, &mut seen);
            }
        }
    }
    // Moves of a coarse axis, and all that comes between.
    let carries = |answer: Option<Carry>, then: Option<Command>, touch: bool, seeks: bool, seen: &mut Seen| {
        let mut bench = Bench::with(|settings| {
            (settings.inch_step, settings.feed_max) = (1000.0, 2000.0);
            (settings.axis_stroke, settings.seek_velocity) = (3000.0, 5000.0);
            settings.inch_seen = if touch { SeenBy::Touch } else { SeenBy::Word };
        });
        bench.make_ready();
        bench.command(Command::MoveTo(um(4000)));
        bench.command(Command::Start);
        bench.surface_um = if seeks { 1e6 } else { 2000.0 };
        for _ in 0..200_000 {
            bench.tick();
            if bench.output.pulses && !seeks {
                bench.surface_um = bench.surface_um.max(bench.um() + 40.0);
            }
            if bench.state() == State::Inching {
                break;
            }
        }
        if touch {
            bench.surface_um = 1e6;
        }
        bench.run(1.0);
        if let Some(answer) = answer {
            bench.surface_um -= if answer == Carry::Refused { 0.0 } else { 1000.0 };
            bench.command(Command::Carry(answer));
        }
        match then {
            Some(Command::ResetFault) => bench.head.raise(Fault::HostSilent),
            Some(then) => bench.command(then),
            None => {}
        }
        bench.run(1.0);
        note(&mut bench, seen);
    };
    for seeks in [false, true] {
        carries(Some(Carry::AsAsked), None, false, seeks, &mut seen);
    }
    carries(Some(Carry::Refused), None, false, false, &mut seen);
    carries(Some(Carry::AsAsked), Some(Command::Hold), false, false, &mut seen);
    carries(None, None, true, false, &mut seen);
    for then in [brake, Command::Disable, Command::ResetFault] {
        carries(None, Some(then), false, false, &mut seen);
    }
    let rules = |&(from, to, reason): &(State, State, Reason)| match reason {
        Reason::Fault(_) => to == State::Fault,
        Reason::Disabled => to == State::Disabled && from != State::Fault,
        _ => from == to,
    };
    let unknown: Vec<_> = seen.iter().filter(|change| !rules(change) && !TRANSITIONS.contains(change)).collect();
    assert!(unknown.is_empty(), "not in the table: {unknown:?}");
    let never: Vec<_> = TRANSITIONS.iter().filter(|change| !seen.contains(change)).collect();
    assert!(never.is_empty(), "no head made {never:?}");
    for state in State::ALL {
        let left = |to| seen.iter().any(|change| change.0 == state && change.1 == to);
        assert!(left(State::Fault) && (left(State::Disabled)), "{state:?}");
    }
}

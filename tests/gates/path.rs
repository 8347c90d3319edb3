//! Accuracy of the path in both directions: measured on the path register of the head, against the same curves in f64.

use super::gate::{Gate, Kind, Wanted};
use super::mixed::{Exact, GRID, arc, empty, go, mixed};
use edm_servo_head::head::{Command, Refused, State};
use edm_servo_head::path::{AXES, Piece, Plane, Point};
use edm_servo_head::settings::{Declared, SettingError, Settings, Value};
use edm_servo_head::units::{FRACTION_BITS, Fixed, Nanometres, PLAN_TICKS, TICK_HZ};
use edm_sim::machine::Machine;
use edm_sim::process::Plant;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::collections::VecDeque;

/// Radii whose arcs are measured, mm.
const RADII_MM: [f64; 10] = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0];
const ONE: f64 = (1u64 << FRACTION_BITS) as f64;
/// Heights, mm, and peak velocities that they have to reach, m/s.
const JUMPS: [(f64, f64); 3] = [(3.0, 0.30), (5.0, 0.45), (8.0, 0.60)];

/// A jump and its return.
#[derive(Default)]
struct Jump {
    /// Height, mm.
    height_mm: f64,
    /// Largest velocity of the set point, m/s.
    peak_m_s: f64,
    /// Largest acceleration of the set point over its limit, plan to plan.
    acceleration_ratio: f64,
    /// Largest jerk of the set point over its limit.
    jerk_ratio: f64,
    /// Travel of the electrode past the float point before the gap leads, over the float distance.
    overshoot_ratio: f64,
    /// Electrode and work have touched, or something was taken for it.
    touched: bool,
    /// Time away, ms.
    away_ms: f64,
    /// Largest force of the film, N.
    film_n: f64,
    /// Largest following error, um.
    following_um: f64,
}

fn um(point: Point) -> [f64; AXES] {
    std::array::from_fn(|axis| point[axis].0 as f64 / ONE * GRID[axis] as f64 / 1000.0)
}

/// Largest distance of an axis from its exact place, counts, and of an arc from its circle, um, at `points` of each piece.
fn accuracy(pieces: &[(Piece, Exact)], points: u32) -> (f64, f64) {
    let mut path = empty();
    let (mut ratio, mut circle) = (0.0f64, 0.0f64);
    let mut start = path.s();
    for (piece, exact) in pieces {
        path.append(piece).expect("a piece that is in order");
        let length = path.ahead_of(start);
        for point in 0..=points {
            let along = Fixed((i128::from(length.0) * i128::from(point) / i128::from(points)) as i64);
            go(&mut path, start.plus(along));
            let at = um(path.setpoint());
            let expected = exact.at(along.0 as f64 / length.0 as f64);
            for axis in 0..AXES {
                ratio = ratio.max((at[axis] - expected[axis]).abs() * 1000.0 / GRID[axis] as f64);
            }
            circle = circle.max(exact.off_circle(at));
        }
        start = start.plus(length);
    }
    (ratio, circle)
}

/// Largest distance of the set point from the circle, um: turns and parts of turns of every radius, in every plane.
fn arc_error(points: u32) -> f64 {
    let mut worst = 0.0f64;
    for plane in [Plane::Xy, Plane::Zx, Plane::Yz] {
        for radius_mm in RADII_MM {
            for (begin, swept) in [(0.0, 1.0), (0.13, -1.0), (0.4, 0.37), (0.9, -0.71)] {
                let piece = arc([0; AXES], plane, radius_mm * 1e6, begin, swept, 0);
                let exact = Exact::new([0; AXES], &piece);
                worst = worst.max(accuracy(&[(piece, exact)], points).1);
            }
        }
    }
    worst
}

/// Servo ticks from the tick that answers a short to a set point that goes back: the most of a minute of erosion.
fn reversal_ticks() -> Result<(u32, u32), String> {
    let settings = Settings { commissioned: true, seek_velocity: 5000.0, ..Settings::default() };
    // Thirty times the bridges of the default scenario: a minute of that has two shorts.
    // Without a reach: with it so large a face leads sooner, and the law feeds a part of the float distance while it is watched.
    let mut plant = Plant::default();
    plant.set("model.bridge_hz", Value::Number(10.0)).map_err(|error| error.to_string())?;
    let mut machine = Machine::new(plant, &settings, 1).map_err(|error| error.to_string())?;
    let reported = |refused: Refused| refused.to_string();
    (0..TICK_HZ / 100).for_each(|_| machine.tick());
    machine.command(Command::Enable).map_err(reported)?;
    machine.command(Command::SetHome(Nanometres(0))).map_err(reported)?;
    machine.command(Command::MoveBy(Nanometres(8_000_000))).map_err(reported)?;
    machine.command(Command::Start).map_err(reported)?;
    let (mut shorts, mut worst) = (0, 0);
    // What was followed in the newest ticks: the planner tells of a change a few ticks later.
    let mut newest: VecDeque<(u32, Fixed)> = VecDeque::new();
    let mut pending = None;
    for _ in 0..60 * TICK_HZ {
        machine.tick();
        let status = machine.status();
        newest.push_back((status.tick, status.setpoint));
        if newest.len() > 40 {
            newest.pop_front();
        }
        while let Some(change) = machine.next_change() {
            if change.to == State::Retreating {
                pending = Some(change.tick);
            }
        }
        let Some(short) = pending else { continue };
        let back = newest.iter().zip(newest.iter().skip(1)).find(|(before, now)| now.0 >= short && now.1 < before.1);
        if let Some((_, (tick, _))) = back {
            (shorts, worst, pending) = (shorts + 1, worst.max(tick - short), None);
        }
    }
    if shorts == 0 { Err("not one short in a minute of erosion".into()) } else { Ok((shorts, worst)) }
}

/// What a jump is measured with: the axis of the default scenario, 0.2 kg, and an encoder of 5 um, whose edges the decoder
/// can follow at 0.6 m/s; an electrode of 10 mm.
fn jumping(height_mm: f64) -> (Plant, Settings) {
    // Without a reach: with it so large a face leads sooner, and the law feeds a part of the float distance while it is watched.
    let mut plant = Plant::default();
    for (key, value) in
        [("scale.count_um", 5.0), ("model.radius_um", 5000.0), ("model.reach_um_v", 0.0), ("workpiece.surface_mm", 9.0)]
    {
        // All of them are in their ranges.
        let _: Result<(), SettingError> = plant.set(key, Value::Number(value));
    }
    let settings = Settings {
        commissioned: true,
        seek_velocity: 5000.0,
        encoder_count: 5.0,
        jump_height: (height_mm * 1000.0) as f32,
        jump_velocity: 650.0,
        jump_acceleration: 75.0,
        jump_jerk: 15_000.0,
        ..Settings::default()
    };
    (plant, settings)
}

/// Ticks for which the electrode is watched after a jump: 20 ms, in which the loop settles.
const SETTLE: u32 = TICK_HZ / 50;

/// A jump out of an erosion 9 mm down.
fn jump(height_mm: f64) -> Result<Jump, String> {
    let (plant, settings) = jumping(height_mm);
    let count_um = f64::from(settings.encoder_count);
    let mut machine = Machine::new(plant, &settings, 1).map_err(|error| error.to_string())?;
    let reported = |refused: Refused| refused.to_string();
    (0..TICK_HZ / 100).for_each(|_| machine.tick());
    machine.command(Command::SetHome(Nanometres(0))).map_err(reported)?;
    machine.command(Command::Enable).map_err(reported)?;
    machine.command(Command::MoveBy(Nanometres(11_000_000))).map_err(reported)?;
    machine.command(Command::Start).map_err(reported)?;
    let mut eroding = 0;
    while eroding < TICK_HZ {
        machine.tick();
        eroding += u32::from(machine.status().state == State::Eroding);
        if machine.status().state == State::Fault || machine.status().tick > 60 * TICK_HZ {
            return Err(format!("no jump of {height_mm} mm: the head is {:?}", machine.status().fault));
        }
    }
    let before = machine.status().setpoint;
    machine.command(Command::Jump).map_err(reported)?;
    let mut report = Jump::default();
    // Set points of the newest ticks, m.
    let metres = |counts: Fixed| counts.0 as f64 / ONE * count_um * 1e-6;
    let mut places = vec![metres(before)];
    let float = metres(before) * 1e6 - f64::from(settings.jump_float);
    let mut deepest = f64::NEG_INFINITY;
    let home_um = machine.process.truth().position_um - machine.status().position as f64 * count_um;
    let (mut away, mut settles) = (false, SETTLE);
    while settles > 0 {
        machine.tick();
        let (truth, status) = (machine.process.truth(), machine.status());
        let position_um = truth.position_um - home_um;
        away |= position_um < float - f64::from(settings.jump_float);
        if away {
            deepest = deepest.max(position_um);
        }
        if status.state == State::Jumping {
            places.push(metres(status.setpoint));
        } else {
            settles -= 1;
        }
        report.touched |= truth.contact_n > 0.0;
        report.film_n = report.film_n.max(truth.film_n.abs());
        report.following_um = report.following_um.max(f64::from(status.following).abs() * count_um);
    }
    report.touched |= machine.status().fault.is_some();
    report.away_ms = places.len() as f64 * 1000.0 / f64::from(TICK_HZ);
    let top = places.iter().copied().fold(f64::INFINITY, f64::min);
    report.height_mm = (metres(before) - top) * 1e3;
    report.overshoot_ratio = ((deepest - float) / f64::from(settings.jump_float)).max(0.0);
    // Plan to plan: the set point goes on in a straight line in between.
    let plan_s = f64::from(PLAN_TICKS) / f64::from(TICK_HZ);
    let mut values: Vec<f64> = places.into_iter().step_by(PLAN_TICKS as usize).collect();
    let limits = [1.0, f64::from(settings.jump_acceleration), f64::from(settings.jump_jerk)];
    let ratios = limits.map(|limit| {
        values = values.windows(2).map(|pair| (pair[1] - pair[0]) / plan_s).collect();
        values.iter().fold(0.0f64, |most, x| most.max(x.abs())) / limit
    });
    [report.peak_m_s, report.acceleration_ratio, report.jerk_ratio] = ratios;
    Ok(report)
}

/// Runs with so many reversals on the mixed path: a million of them take a second or two.
///
/// # Panics
/// When the head does not begin to erode.
pub fn gates(reversals: u64) -> Vec<Gate> {
    let pieces = mixed(1);
    let mut path = empty();
    let mut starts = vec![];
    for (piece, _) in &pieces {
        starts.push(path.ahead_of(Fixed(0)));
        path.append(piece).expect("a piece that is in order");
    }
    let length = path.ahead_of(Fixed(0));
    // Coordinates that are come past again and again: parts of the path, and every joint is between two.
    let places = 20_011i64;
    let place = |number: i64| Fixed((i128::from(length.0) * i128::from(number) / i128::from(places)) as i64);
    let mut first: Vec<Option<Point>> = vec![None; places as usize + 1];
    let mut random = Xoshiro256PlusPlus::seed_from_u64(2);
    let (mut at, mut away, mut revisits, mut differing, mut joints) = (0i64, true, 0, 0, 0);
    for number in 0..reversals {
        // On the whole it goes to one end, then to the other.
        if at == 0 || at == places {
            away = at == 0;
        }
        let step = if number % 2 == 0 { random.random_range(1..=400) } else { -random.random_range(1..=360i64) };
        at = (at + if away { step } else { -step }).clamp(0, places);
        let segment = |s: Fixed| starts.partition_point(|start| *start < s);
        let before = segment(path.s());
        go(&mut path, place(at));
        joints += segment(path.s()).abs_diff(before) as u64;
        let point = path.setpoint();
        match &mut first[at as usize] {
            Some(first) => {
                revisits += 1;
                differing += u64::from(*first != point);
            }
            unseen => *unseen = Some(point),
        }
    }
    go(&mut path, Fixed(0));
    let retrace_error_counts = path.setpoint().iter().map(|axis| (axis.0 as f64 / ONE).abs()).fold(0.0, f64::max);
    let (shorts, reversal_ticks) = reversal_ticks().expect("an erosion");
    let exact_mm: f64 = pieces.iter().map(|(_, exact)| exact.length() * 1e-3).sum();
    let length_mm = length.0 as f64 / ONE / 1000.0;
    let travelled = format!("{reversals} reversals, {joints} joints, {revisits} coordinates passed again");
    let gate = |name: &str, value: f64, most: f64, note: &str| {
        Gate::new(Kind::Physics, name, value, Wanted::AtMost(most), note)
    };
    let said = format!("the most of {shorts} shorts");
    let mut gates = vec![
        gate("coordinates passed again with another set point", differing as f64, 0.0, &travelled),
        gate("error after the full retrace, counts", retrace_error_counts, 0.0, ""),
        gate("largest error of the ratio of axes, counts of 1 um", accuracy(&pieces, 500).0, 0.5, ""),
        gate("largest deviation of arcs of 0.1 to 100 mm, um", arc_error(1000), 0.1, ""),
        gate("servo ticks from a short to the retreat", reversal_ticks.into(), 0.0, &said),
        Gate::figure("length of the mixed path, mm", length_mm, format!("exact {exact_mm:.3} mm")),
    ];
    for (height_mm, least_m_s) in JUMPS {
        let jump = jump(height_mm).expect("an erosion");
        let name = |what: &str| format!("jump of {height_mm} mm: {what}");
        let (away, film, following) = (jump.away_ms, jump.film_n, jump.following_um);
        let note = format!("away for {away:.1} ms, film {film:.1} N, following error {following:.0} um");
        gates.push(gate(&name("off its height, mm"), (jump.height_mm - height_mm).abs(), 0.001, &note));
        gates.push(Gate::new(Kind::Physics, name("peak, m/s"), jump.peak_m_s, Wanted::AtLeast(least_m_s), ""));
        // Near its limits, or it would not be one.
        for (what, ratio) in [("acceleration", jump.acceleration_ratio), ("jerk", jump.jerk_ratio)] {
            let name = name(&format!("{what} over its limit"));
            gates.push(Gate::new(Kind::Physics, name, ratio, Wanted::Between(0.85, 1.0), ""));
        }
        gates.push(gate(&name("past the float point, of the float distance"), jump.overshoot_ratio, 0.1, ""));
        gates.push(gate(&name("contact"), f64::from(u8::from(jump.touched)), 0.0, ""));
    }
    gates
}

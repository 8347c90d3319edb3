//! Accuracy of the path in both directions: measured on the path register of the head, against the same curves in f64.
//!
//! *Mixed path*: 200 lines, arcs, whole turns and helices in all planes, with radii from 0.1 to 100 mm, from a seed. *Exact*:
//! what its pieces are in real numbers, from the ends and centres in nm that a host gives.

use crate::machine::Machine;
use crate::process::Plant;
use edm_servo_head::head::{Command, Refused, State};
use edm_servo_head::path::{AXES, Bound, Path, Piece, Plane, Point, Shape, Turn};
use edm_servo_head::settings::{Declared, SettingError, Settings, Value};
use edm_servo_head::units::{FRACTION_BITS, Fixed, Nanometres, PLAN_TICKS, TICK_HZ};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::fmt::Write;

/// nm per count of the axes that it is measured with: an encoder of 1 um, and set points in um.
pub const GRID: [i64; AXES] = [1000, 1000, 1000];
/// Segments of the mixed path.
pub const SEGMENTS: usize = 200;
/// Radii whose arcs are measured, mm.
pub const RADII_MM: [f64; 10] = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0];

const ONE: f64 = (1u64 << FRACTION_BITS) as f64;
const ORIGIN: Point = [Fixed(0); AXES];

/// What was measured; all of it simulated.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Segments of the mixed path.
    pub segments: usize,
    /// Its length, mm.
    pub length_mm: f64,
    /// Times that it was reversed on.
    pub reversals: u64,
    /// Joints crossed on the way.
    pub joints: u64,
    /// Coordinates come past again.
    pub revisits: u64,
    /// Of these, how many had another set point than at first.
    pub differing: u64,
    /// Largest distance from the start, of all axes, after going back all the way, counts.
    pub retrace_error_counts: f64,
    /// Largest distance of any axis from its exact place at the same coordinate, counts.
    pub ratio_error_counts_max: f64,
    /// Largest distance of the set point from the circle, radii 0.1 to 100 mm, all planes, um.
    pub arc_error_um_max: f64,
    /// Shorts in a minute of erosion.
    pub shorts: u32,
    /// Servo ticks from one that sets off a retreat to a set point that goes back, at the most: 0 is the same tick.
    pub reversal_ticks: u32,
    /// Jumps out of an erosion, one of each height.
    pub jump: Vec<JumpReport>,
}

/// A jump and its return.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JumpReport {
    /// Height, mm.
    pub height_mm: f64,
    /// Largest velocity of the set point, m/s.
    pub peak_m_s: f64,
    /// Largest acceleration of the set point over its limit, plan to plan.
    pub acceleration_ratio: f64,
    /// Largest jerk of the set point over its limit.
    pub jerk_ratio: f64,
    /// Travel of the electrode past the float point before the gap leads, over the float distance.
    pub overshoot_ratio: f64,
    /// Electrode and work have touched, or something was taken for it.
    pub touched: bool,
    /// Time away, ms.
    pub away_ms: f64,
    /// Largest force of the film, N.
    pub film_n: f64,
    /// Largest following error, um.
    pub following_um: f64,
}

/// Heights, mm, and peak velocities that they have to reach, m/s.
pub const JUMPS: [(f64, f64); 3] = [(3.0, 0.30), (5.0, 0.45), (8.0, 0.60)];

/// A register on an empty path that begins at the origin.
pub fn empty() -> Box<Path> {
    let mut path = Box::new(Path::EMPTY);
    path.scale(GRID);
    path.restart(ORIGIN, ORIGIN);
    path.set_retreat(Fixed::whole(10_000_000));
    path
}

/// A piece in real numbers.
#[derive(Clone, Copy, Debug)]
pub struct Exact {
    from: [f64; AXES],
    to: [f64; AXES],
    arc: Option<Circle>,
}

#[derive(Clone, Copy, Debug)]
struct Circle {
    /// First and second axis of its plane.
    axes: [usize; 2],
    centre: [f64; 2],
    radius: f64,
    /// Where it begins and how far it goes, rad.
    begin: f64,
    swept: f64,
}

impl Exact {
    /// From where a piece begins, nm.
    pub fn new(from: [i64; AXES], piece: &Piece) -> Exact {
        let (from, to) = (from.map(|nm| nm as f64 / 1000.0), piece.to.map(|nm| nm as f64 / 1000.0));
        let Some((plane, turn)) = piece.shape.arc() else { return Exact { from, to, arc: None } };
        let [u, v] = axes(plane);
        let [cu, cv] = piece.centre.map(|nm| f64::from(nm) / 1000.0);
        let centre = [from[u] + cu, from[v] + cv];
        let begin = (-cv).atan2(-cu);
        let swept = ((to[v] - centre[1]).atan2(to[u] - centre[0]) - begin).rem_euclid(TAU);
        let swept = if turn == Turn::Forward { swept } else { TAU - swept };
        let whole = from[u] == to[u] && from[v] == to[v];
        let swept = if whole || swept == 0.0 { TAU } else { swept };
        let swept = if turn == Turn::Forward { swept } else { -swept };
        Exact { from, to, arc: Some(Circle { axes: [u, v], centre, radius: cu.hypot(cv), begin, swept }) }
    }

    /// Where it is at a part of its length, um.
    pub fn at(&self, part: f64) -> [f64; AXES] {
        let mut point: [f64; AXES] =
            std::array::from_fn(|axis| self.from[axis] + (self.to[axis] - self.from[axis]) * part);
        if let Some(Circle { axes: [u, v], centre, radius, begin, swept }) = self.arc {
            point[u] = centre[0] + radius * (begin + swept * part).cos();
            point[v] = centre[1] + radius * (begin + swept * part).sin();
        }
        point
    }

    /// Length, um.
    pub fn length(&self) -> f64 {
        let square = |axis: usize| (self.to[axis] - self.from[axis]).powi(2);
        match self.arc {
            None => (0..AXES).map(square).sum::<f64>().sqrt(),
            Some(Circle { axes: [u, v], radius, swept, .. }) => (radius * swept).hypot(square(AXES - u - v).sqrt()),
        }
    }

    /// Distance of a point from the circle, um.
    pub fn off_circle(&self, point: [f64; AXES]) -> f64 {
        let Some(Circle { axes: [u, v], centre, radius, .. }) = self.arc else { return 0.0 };
        ((point[u] - centre[0]).hypot(point[v] - centre[1]) - radius).abs()
    }
}

fn axes(plane: Plane) -> [usize; 2] {
    match plane {
        Plane::Xy => [1, 2],
        Plane::Zx => [0, 1],
        Plane::Yz => [2, 0],
    }
}

/// An arc of a radius, from a point, all in nm, angles in turns; its end as near to the circle as whole nm are.
pub fn arc(from: [i64; AXES], plane: Plane, radius_nm: f64, begin: f64, swept: f64, along: i64) -> Piece {
    let [u, v] = axes(plane);
    let centre = [-radius_nm * (begin * TAU).cos(), -radius_nm * (begin * TAU).sin()].map(|nm| nm.round() as i32);
    let [cu, cv] = centre.map(f64::from);
    let (radius, begin) = (cu.hypot(cv), (-cv).atan2(-cu));
    let end = begin + swept * TAU;
    let mut to = from;
    if swept.abs() < 1.0 {
        to[u] += (cu + radius * end.cos()).round() as i64;
        to[v] += (cv + radius * end.sin()).round() as i64;
    }
    to[AXES - u - v] += along;
    let turn = if swept > 0.0 { Turn::Forward } else { Turn::Backward };
    Piece { shape: Shape::of(plane, turn), to, centre, mark: false, stop: false }
}

/// The mixed path of a seed, with what it is in real numbers.
pub fn mixed(seed: u64) -> Vec<(Piece, Exact)> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut from = [0; AXES];
    (0..SEGMENTS)
        .map(|number| {
            let size = 1000.0 * 3000f64.powf(random.random());
            let piece = if number % 2 == 0 {
                // It stays in the neighbourhood, or the last ones would be out of reach.
                let to = std::array::from_fn(|axis| from[axis] / 2 + (size * random.random_range(-1.0..1.0)) as i64);
                Piece { shape: Shape::Line, to, centre: [0; 2], mark: false, stop: false }
            } else {
                let plane = [Plane::Xy, Plane::Zx, Plane::Yz][random.random_range(0..3)];
                let radius = 1e5 * 1000f64.powf(random.random());
                let sign = if random.random() { 1.0 } else { -1.0 };
                let swept = match random.random_range(0..8) {
                    0 => 1.0,
                    _ => f64::min(random.random_range(0.02..0.98), 2e7 / radius),
                };
                let along = if random.random() { 0 } else { random.random_range(-500_000..500_000) };
                arc(from, plane, radius, random.random(), sign * swept, along)
            };
            let exact = Exact::new(from, &piece);
            from = piece.to;
            (piece, exact)
        })
        .collect()
}

fn um(point: Point) -> [f64; AXES] {
    std::array::from_fn(|axis| point[axis].0 as f64 / ONE * GRID[axis] as f64 / 1000.0)
}

/// Goes to a coordinate, however many joints are in between, which are counted.
pub fn go(path: &mut Path, to: Fixed) -> u64 {
    let mut stops = 0;
    loop {
        match path.step(Fixed(to.0 - path.s().0)) {
            Some(Bound::Joints) => stops += 1,
            _ => return stops,
        }
    }
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
pub fn arc_error(points: u32) -> f64 {
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

/// Measures. `reversals` is what takes the time: a million of them a second or two.
///
/// # Errors
/// When the head does not begin to erode.
pub fn measure(reversals: u64) -> Result<Report, String> {
    let pieces = mixed(1);
    let mut path = empty();
    let mut starts = vec![];
    for (piece, _) in &pieces {
        starts.push(path.ahead_of(Fixed(0)));
        path.append(piece).map_err(|refused| refused.to_string())?;
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
    let (shorts, reversal_ticks) = reversal_ticks()?;
    Ok(Report {
        segments: pieces.len(),
        length_mm: length.0 as f64 / ONE / 1000.0,
        reversals,
        joints,
        revisits,
        differing,
        retrace_error_counts,
        ratio_error_counts_max: accuracy(&pieces, 500).0,
        arc_error_um_max: arc_error(1000),
        shorts,
        reversal_ticks,
        jump: JUMPS.iter().map(|(height_mm, _)| jump(*height_mm)).collect::<Result<_, _>>()?,
    })
}

/// Servo ticks from the tick that answers a short to a set point that goes back: the most of a minute of erosion.
fn reversal_ticks() -> Result<(u32, u32), String> {
    let settings = Settings { commissioned: true, seek_velocity: 5000.0, ..Settings::default() };
    // Thirty times the bridges of the default scenario: a minute of that has two shorts.
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
    // On version 2 the law leads sooner on so large a face: it feeds 8 um in the time for which the electrode is watched.
    let mut plant = Plant::default().turned_to(1);
    for (key, value) in [("scale.count_um", 5.0), ("model.radius_um", 5000.0), ("workpiece.surface_mm", 9.0)] {
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
fn jump(height_mm: f64) -> Result<JumpReport, String> {
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
    let mut report = JumpReport {
        height_mm: 0.0,
        peak_m_s: 0.0,
        acceleration_ratio: 0.0,
        jerk_ratio: 0.0,
        overshoot_ratio: 0.0,
        touched: false,
        away_ms: 0.0,
        film_n: 0.0,
        following_um: 0.0,
    };
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

impl Report {
    /// Whether everything is within its bound.
    pub fn holds(&self) -> bool {
        self.differing == 0
            && self.retrace_error_counts == 0.0
            && self.ratio_error_counts_max <= 0.5
            && self.arc_error_um_max <= 0.1
            && self.reversal_ticks == 0
            && self.jump.iter().zip(JUMPS).all(|(jump, (_, peak_m_s))| jump.holds(peak_m_s))
    }

    /// The table of docs/path.md.
    pub fn table(&self) -> String {
        let mut table = String::from("| figure | bound | measured |\n| --- | --- | --- |\n");
        let rows = [
            (
                "reversals on a mixed path",
                "10^6".into(),
                format!("{}, over {} segments", self.reversals, self.segments),
            ),
            ("length of that path", "none".into(), format!("{:.0} mm", self.length_mm)),
            ("joints crossed", "none".into(), self.joints.to_string()),
            ("coordinates passed again", "none".into(), self.revisits.to_string()),
            ("of these with another set point", "0".into(), self.differing.to_string()),
            ("error after the full retrace", "0 counts".into(), format!("{} counts", self.retrace_error_counts)),
            (
                "largest error of the ratio of axes",
                "0.5 counts".into(),
                format!("{:.4} counts of 1 um", self.ratio_error_counts_max),
            ),
            (
                "largest deviation of arcs, 0.1 to 100 mm",
                "0.1 um".to_string(),
                format!("{:.4} um", self.arc_error_um_max),
            ),
            (
                "servo ticks from a short to the retreat, largest",
                "0".into(),
                format!("{}, of {} shorts", self.reversal_ticks, self.shorts),
            ),
        ];
        for (figure, bound, measured) in rows {
            let _ = writeln!(table, "| {figure} | {bound} | {measured} |");
        }
        let _ = writeln!(
            table,
            "\n| jump | peak, at least | acceleration, jerk of their limits, at most 1 | past the float point, at most 0.1 | contact \
             | away | film | following error |\n| --- | --- | --- | --- | --- | --- | --- | --- |"
        );
        for (jump, (_, least)) in self.jump.iter().zip(JUMPS) {
            let _ = writeln!(
                table,
                "| {:.0} mm | {:.3} m/s, {least:.2} | {:.3}, {:.3} | {:.3} | {} | {:.1} ms | {:.1} N | {:.0} um |",
                jump.height_mm,
                jump.peak_m_s,
                jump.acceleration_ratio,
                jump.jerk_ratio,
                jump.overshoot_ratio,
                if jump.touched { "yes" } else { "no" },
                jump.away_ms,
                jump.film_n,
                jump.following_um,
            );
        }
        table
    }
}

impl JumpReport {
    fn holds(&self, peak_m_s: f64) -> bool {
        let within = self.acceleration_ratio <= 1.0 && self.jerk_ratio <= 1.0 && self.overshoot_ratio <= 0.1;
        self.peak_m_s >= peak_m_s && within && !self.touched
    }
}

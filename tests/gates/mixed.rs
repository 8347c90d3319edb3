//! *Mixed path*: 200 lines, arcs, whole turns and helices in all planes, with radii from 0.1 to 100 mm, from a seed. *Exact*:
//! what its pieces are in real numbers, from the ends and centres in nm that a host gives.

use edm_servo_head::path::{AXES, Bound, Path, Piece, Plane, Point, Shape, Turn};
use edm_servo_head::units::Fixed;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::TAU;

/// nm per count of the axes that it is measured with: an encoder of 1 um, and set points in um.
pub const GRID: [i64; AXES] = [1000, 1000, 1000];
/// Segments of the mixed path.
const SEGMENTS: usize = 200;
const ORIGIN: Point = [Fixed(0); AXES];

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

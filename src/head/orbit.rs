//! An orbit: a path that a head makes of a depth, so that the cavity is wider than its electrode all around.
//!
//! The electrode sinks while it goes around, in circles or along squares whose radius is the undersize; or it goes over half a sphere
//! from its equator to its pole, so that the cavity is as much wider at its bottom as at its sides. The pieces are those of a path like any
//! other, and are made one by one as the head comes to them: place and way back follow from the path coordinate alone.

use crate::path::{AXES, Piece, Plane, RADII, Shape, Turn};

/// What the head goes around in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OrbitShape {
    /// Straight down.
    None,
    /// Circles.
    Circle,
    /// Squares.
    Square,
    /// Circles over half a sphere.
    Sphere,
}

/// An orbit of a depth that is not known yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Its shape.
    pub shape: OrbitShape,
    /// Radius: the undersize, nm, one of an arc.
    pub radius: i64,
    /// How far it sinks in a turn; on a sphere from ring to ring, along its surface, nm, above 0.
    pub pitch: i64,
}

/// An orbit under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Orbit {
    config: Config,
    from: [i64; AXES],
    /// Depth, nm.
    to: i64,
    /// Turns, but for the one that stays at the depth.
    count: i64,
    /// The next piece: of this turn, that side.
    turn: i64,
    side: u8,
    /// Deepest of the turn before, nm.
    top: i64,
}

/// Quarter of a circle's circumference over its radius, in thousandths.
const QUARTER: i64 = 1571;
/// Sides of a square, from the middle of the right one: its ends, as shares of the radius, and the eighths of the turn there.
const SIDES: [([i64; 2], i64); 5] = [([1, 1], 1), ([-1, 1], 3), ([-1, -1], 5), ([1, -1], 7), ([1, 0], 8)];

impl Orbit {
    /// From a place, nm, around it down to a depth. `None` where the equator of a sphere would lie above it.
    pub fn new(config: Config, from: [i64; AXES], to: i64) -> Option<Orbit> {
        let [top, ..] = from;
        let depth = to.saturating_sub(top);
        let sphere = config.shape == OrbitShape::Sphere;
        let length = if sphere { config.radius.saturating_mul(QUARTER).wrapping_div(1000) } else { depth };
        let pitch = config.pitch.max(1);
        let count = length.saturating_add(pitch.saturating_sub(1)).checked_div(pitch).unwrap_or(1).max(1);
        let fits = depth > 0 && (!sphere || depth >= config.radius);
        fits.then_some(Orbit { config, from, to, count, turn: 0, side: 0, top })
    }

    /// The next piece; none at the end.
    pub fn next(&mut self) -> Option<Piece> {
        match self.config.shape {
            OrbitShape::Sphere => self.over_a_sphere(),
            _ => self.down(),
        }
    }

    fn down(&mut self) -> Option<Piece> {
        let Orbit { config: Config { shape, radius, .. }, from: [begin, ..], to, count, turn, side, top } = *self;
        if turn == 0 {
            self.turn = 1;
            return Some(self.line(begin, [radius, 0]));
        }
        if turn > count.saturating_add(1) {
            self.turn = i64::MAX;
            return (turn < i64::MAX).then(|| self.line(to, [0; 2]));
        }
        // The last turn stays at the depth: the one before it was deep only at its end.
        let depth = to.saturating_sub(begin).saturating_mul(turn.min(count)).checked_div(count).unwrap_or(0);
        let down = begin.saturating_add(depth);
        if shape == OrbitShape::Circle {
            (self.turn, self.top) = (turn.saturating_add(1), down);
            return Some(self.around(down, radius));
        }
        let &([x, y], eighths) = SIDES.get(usize::from(side))?;
        let part = top.saturating_add(down.saturating_sub(top).saturating_mul(eighths).wrapping_div(8));
        self.side = side.wrapping_add(1);
        if usize::from(self.side) == SIDES.len() {
            (self.turn, self.side, self.top) = (turn.saturating_add(1), 0, down);
        }
        Some(self.line(part, [x.saturating_mul(radius), y.saturating_mul(radius)]))
    }

    fn over_a_sphere(&mut self) -> Option<Piece> {
        let Orbit { config: Config { radius, .. }, to, count, turn, side, .. } = *self;
        let equator = to.saturating_sub(radius);
        if turn == 0 {
            self.turn = 1;
            return Some(self.line(equator, [0; 2]));
        }
        let angle = turn.saturating_sub(1) as f32 / count as f32 * core::f32::consts::FRAC_PI_2;
        let deep = ((radius as f32 * sine(angle)) as i64).max(0).min(radius);
        // On the sphere, whatever the sine is: it only spaces the rings.
        let square = radius.saturating_add(deep).saturating_mul(radius.saturating_sub(deep));
        let (ring, down) = (libm::sqrtf(square as f32) as i64, equator.saturating_add(deep));
        let (least, _) = RADII;
        if turn > count || ring < least {
            self.turn = i64::MAX;
            return (turn < i64::MAX).then(|| self.line(to, [0; 2]));
        }
        self.side = side ^ 1;
        if side == 0 {
            return Some(self.line(down, [ring, 0]));
        }
        self.turn = turn.saturating_add(1);
        Some(self.around(down, ring))
    }

    fn line(&self, down: i64, [x, y]: [i64; 2]) -> Piece {
        let [_, x0, y0] = self.from;
        let to = [down, x0.saturating_add(x), y0.saturating_add(y)];
        Piece { shape: Shape::Line, to, centre: [0; 2], mark: false, stop: false }
    }

    /// Once around, from the right of the middle.
    fn around(&self, down: i64, radius: i64) -> Piece {
        let centre = [(radius as i32).wrapping_neg(), 0];
        Piece { shape: Shape::of(Plane::Xy, Turn::Forward), centre, ..self.line(down, [radius, 0]) }
    }
}

/// Sine of up to a quarter of a turn, to 1e-6: the series as far as x^11.
fn sine(x: f32) -> f32 {
    let square = x * x;
    let mut sum = 1.0;
    for factor in [1.0 / 110.0, 1.0 / 72.0, 1.0 / 42.0, 1.0 / 20.0, 1.0 / 6.0] {
        sum = 1.0 - square * factor * sum;
    }
    x * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pieces(shape: OrbitShape, radius: i64, pitch: i64, depth: i64) -> Vec<Piece> {
        let mut orbit = Orbit::new(Config { shape, radius, pitch }, [500, 70, -30], 500 + depth).unwrap();
        let pieces: Vec<Piece> = std::iter::from_fn(|| orbit.next()).collect();
        assert_eq!((orbit.next(), orbit.next()), (None, None));
        pieces
    }

    #[test]
    fn circles_sink_by_equal_steps_of_a_pitch_at_most_and_the_last_stays_at_the_depth() {
        let all = pieces(OrbitShape::Circle, 20_000, 10_000, 25_000);
        let downs: Vec<i64> = all.iter().map(|piece| piece.to[0] - 500).collect();
        assert_eq!(downs, [0, 8333, 16_666, 25_000, 25_000, 25_000]);
        for piece in &all[1..5] {
            assert_eq!((piece.shape, piece.centre), (Shape::Xy, [-20_000, 0]));
            assert_eq!(piece.to[1..], [20_070, -30]);
        }
        assert_eq!((all[0].shape, all[5].shape, all[5].to), (Shape::Line, Shape::Line, [25_500, 70, -30]));
    }

    #[test]
    fn squares_end_each_turn_in_the_middle_of_a_side() {
        let all = pieces(OrbitShape::Square, 1000, 800, 800);
        let places: Vec<[i64; 3]> =
            all.iter().map(|piece| [piece.to[0] - 500, piece.to[1] - 70, piece.to[2] + 30]).collect();
        assert_eq!(
            places[..6],
            [
                [0, 1000, 0],
                [100, 1000, 1000],
                [300, -1000, 1000],
                [500, -1000, -1000],
                [700, 1000, -1000],
                [800, 1000, 0]
            ]
        );
        assert_eq!((places.len(), places[6], places[11]), (12, [800, 1000, 1000], [800, 0, 0]));
    }

    #[test]
    fn rings_of_a_sphere_lie_on_it_from_its_equator_to_its_pole() {
        let (radius, depth) = (1_000_000, 1_500_000);
        let all = pieces(OrbitShape::Sphere, radius, 50_000, depth);
        assert_eq!(all[0].to, [500 + depth - radius, 70, -30]);
        let rings: Vec<&Piece> = all.iter().filter(|piece| piece.shape == Shape::Xy).collect();
        assert_eq!(rings.len(), 32, "1571 um, by 50 at most; the pole is none");
        for ring in rings {
            let [down, x, _] = ring.to;
            let [deep, wide] = [down - 500 - (depth - radius), x - 70].map(|nm| nm as f64);
            assert!((deep.hypot(wide) - radius as f64).abs() < 2.0, "{deep} {wide}");
            assert_eq!(i64::from(ring.centre[0]), -(x - 70));
        }
        assert_eq!(all.last().unwrap().to, [500 + depth, 70, -30]);
        assert_eq!(Orbit::new(Config { shape: OrbitShape::Sphere, radius, pitch: 1 }, [0; 3], radius - 1), None);
    }

    #[test]
    fn no_numbers_fail() {
        for shape in [OrbitShape::Circle, OrbitShape::Square, OrbitShape::Sphere] {
            for nm in [i64::MIN, -1, 0, 1, 10_000, i64::MAX] {
                let orbit = Orbit::new(Config { shape, radius: nm, pitch: nm }, [nm, nm, nm], i64::MAX);
                orbit.into_iter().for_each(|mut orbit| assert!((0..1000).filter_map(|_| orbit.next()).count() > 0));
            }
        }
    }
}

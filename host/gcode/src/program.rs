//! A whole program as a path: how long it is, where it leads and what it allows.

use crate::{Move, read};
use edm_servo_head::path::{AXES, BESIDE_NM, Path, Point, Shape};
use edm_servo_head::units::{FRACTION_BITS, Fixed};

/// Points of an arc that are drawn.
const ARC_POINTS: i64 = 64;

/// A path that was checked, from X0 Y0 in the surface of the work.
#[derive(Clone, Debug, PartialEq)]
pub struct Program {
    /// Name of its file.
    pub name: String,
    /// Its pieces.
    pub moves: Vec<Move>,
    /// Path coordinates of their ends, from X0 Y0 Z0.
    pub ends: Vec<Fixed>,
    /// Length, mm.
    pub length_mm: f64,
    /// Points of it in their order: down, X, Y, mm.
    pub outline: Vec<[f64; 3]>,
    /// How far up and down each piece leads, mm below the surface.
    reach: Vec<[f64; 2]>,
}

impl Program {
    /// Reads a program.
    ///
    /// # Errors
    /// What cannot be carried out, with line and word.
    pub fn parse(name: &str, text: &str) -> Result<Program, String> {
        Program::new(name, read(text)?)
    }

    /// Works out where moves lead.
    ///
    /// # Errors
    /// What cannot be a path, with line and word.
    pub fn new(name: &str, moves: Vec<Move>) -> Result<Program, String> {
        // A register of its own goes along it once.
        let mut path = Box::new(Path::EMPTY);
        path.scale([BESIDE_NM; AXES]);
        path.restart([Fixed(0); AXES], [Fixed(0); AXES]);
        let mm = |point: Point| point.map(|um| um.0 as f64 / (1u64 << FRACTION_BITS) as f64 / 1e3);
        let mut outline = vec![mm(path.setpoint())];
        let (mut ends, mut reach) = (Vec::new(), Vec::new());
        for Move { line, word, piece, .. } in &moves {
            let refused = |what: String| format!("line {line}: {word}: {what}");
            let (up, down) = path.extent(piece).map_err(|wrong| refused(wrong.to_string()))?;
            reach.push([up as f64 * 1e-6, down as f64 * 1e-6]);
            let begin = path.s();
            path.append(piece).map_err(|wrong| refused(wrong.to_string()))?;
            let length = path.ahead_of(begin);
            let points = if piece.shape == Shape::Line { 1 } else { ARC_POINTS };
            for point in 1..=points {
                let to = begin.plus(Fixed((i128::from(length.0) * i128::from(point) / i128::from(points)) as i64));
                path.step(to.minus(path.s()));
                outline.push(mm(path.setpoint()));
            }
            ends.push(path.s());
        }
        let length_mm = f64::from(path.s().to_f32()) * 1e-3;
        Ok(Program { name: name.into(), moves, ends, length_mm, outline, reach })
    }

    /// Checks that it stays within a stroke: mm above and below the surface.
    ///
    /// # Errors
    /// Where it leads outside, with line and word.
    pub fn within(&self, above_mm: f64, below_mm: f64) -> Result<(), String> {
        for (Move { line, word, .. }, [up, down]) in self.moves.iter().zip(&self.reach) {
            let (reach, limit) = match () {
                () if *down > below_mm => (-down, -below_mm),
                () if -up > above_mm => (-up, above_mm),
                () => continue,
            };
            return Err(format!("line {line}: {word}: leads to Z{reach:.3}; the stroke ends at Z{limit:.3}"));
        }
        Ok(())
    }

    /// Largest feed that the program allows at the present path coordinate, um/s.
    pub fn feed(&self, at: Fixed) -> Option<f64> {
        let under_way = self.ends.partition_point(|end| *end < at);
        self.moves.get(under_way).or(self.moves.last())?.feed
    }

    /// Depth of its end, mm.
    pub fn depth_mm(&self) -> f64 {
        self.outline.last().map_or(0.0, |[down, ..]| *down)
    }

    /// Its greatest depth, mm.
    pub fn deepest_mm(&self) -> f64 {
        self.reach.iter().fold(0.0, |deepest, [_, down]| down.max(deepest))
    }

    /// Whether it leads X or Y anywhere.
    pub fn leads_beside(&self) -> bool {
        self.outline.iter().any(|[_, x, y]| (*x, *y) != (0.0, 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_knows_its_depth_its_length_and_what_it_allows_where() {
        let program = Program::parse("cup", "G1 Z-1 F6\nG18 G2 X2 I1 K0\nG1 Z-0.5").unwrap();
        assert_eq!((program.depth_mm(), program.leads_beside()), (0.5, true));
        // Seen from the end of Y, X to the right, Z points down: the clockwise half circle leads down by its radius, from Z-1.
        assert!((program.deepest_mm() - 2.0).abs() < 1e-6, "{}", program.deepest_mm());
        let length = 1.0 + core::f64::consts::PI + 0.5;
        assert!((program.length_mm - length).abs() < 1e-3, "{}", program.length_mm);
        assert_eq!((program.ends.len(), program.outline.len()), (3, 1 + 1 + 64 + 1));
        assert_eq!(program.feed(Fixed::whole(500)), Some(100.0));
    }

    #[test]
    fn what_leaves_the_stroke_is_named_with_line_and_word_both_ways() {
        let program = Program::parse("deep", "G1 Z-1\nG1 X1 Z-3\nG0 Z2").unwrap();
        assert_eq!(program.within(2.0, 3.0), Ok(()));
        assert_eq!(program.within(2.0, 2.9).unwrap_err(), "line 2: Z-3: leads to Z-3.000; the stroke ends at Z-2.900");
        assert_eq!(program.within(1.5, 3.0).unwrap_err(), "line 3: Z2: leads to Z2.000; the stroke ends at Z1.500");
    }
}

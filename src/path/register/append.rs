//! What is appended: pieces of a host become segments behind the last one.

use super::{AHEAD, Register};
use crate::path::grid::{Place, REACH};
use crate::path::piece::{Packed, Piece, Refused, Segment};
use crate::path::shape::Shape;
use crate::path::{AXES, Point};
use crate::units::{FRACTION_BITS, Fixed};

impl<const N: usize> Register<N> {
    /// Appends a straight line to a point in counts.
    pub fn push_line(&mut self, to: Point) -> Result<(), Refused> {
        let mut nm = [0; AXES];
        for (nm, (to, nm_per_count)) in nm.iter_mut().zip(to.iter().zip(&self.nm_per_count)) {
            let whole = (to.0 >> FRACTION_BITS).saturating_mul(*nm_per_count);
            let part = (to.0 & ((1 << FRACTION_BITS) - 1)).saturating_mul(*nm_per_count);
            *nm = whole.saturating_add(part.saturating_add(1 << (FRACTION_BITS - 1)) >> FRACTION_BITS);
        }
        self.append(&Piece { shape: Shape::Line, to: nm, centre: [0; 2], mark: false, stop: false })
    }

    /// Appends a piece.
    ///
    /// # Errors
    /// See [`Refused`].
    pub fn append(&mut self, piece: &Piece) -> Result<(), Refused> {
        if self.waiting() >= AHEAD {
            return Err(Refused::QueueFull);
        }
        let mut packed = self.packed(piece)?;
        let grid = self.grid();
        let (place, end) = self.last();
        let ([_, x, y], [_, to_x, to_y]) = (place, packed.to);
        let next = packed.unpack(place, end, &self.datum, &grid);
        let before = match self.segments.len() {
            0 => Segment::Line(self.lead),
            slots => self.unpacked(slots).unwrap_or(Segment::Line(self.lead)),
        };
        if before.length().0 > 0 {
            let (end, begin) = (before.here(before.length()), next.here(Fixed(0)));
            packed.join(self.unit(end.direction()), self.unit(begin.direction()));
        }
        self.segments.push_back(packed).map_err(|_| Refused::QueueFull)?;
        self.beside |= (x, y) != (to_x, to_y) || piece.shape != Shape::Line;
        if self.current == 0 && self.lead.length().0 == 0 && self.segments.len() == 1 {
            // Only what the register holds can be gone back along.
            self.current = 1;
            self.enter(next, self.start);
            self.come_past(&packed);
        }
        self.newest = self.newest.plus(packed.length());
        Ok(())
    }

    /// How far up and down a piece leads the first axis, nm.
    ///
    /// # Errors
    /// As if it were appended.
    pub fn extent(&self, piece: &Piece) -> Result<(i64, i64), Refused> {
        let packed = self.packed(piece)?;
        let (place, _) = self.last();
        let (least, most) = packed.extent(place);
        let [datum, ..] = self.datum_nm();
        Ok((datum.saturating_add(least.into()), datum.saturating_add(most.into())))
    }

    fn packed(&self, piece: &Piece) -> Result<Packed, Refused> {
        let mut to: Place = [0; AXES];
        for (axis, (place, (nm, datum))) in to.iter_mut().zip(piece.to.iter().zip(self.datum_nm())).enumerate() {
            let from_datum = nm.saturating_sub(datum);
            if from_datum.saturating_abs() > REACH {
                return Err(Refused::TooFar { axis: axis as u8 });
            }
            *place = from_datum as i32;
        }
        let (from, _) = self.last();
        Packed::new(from, to, piece)
    }

    /// Direction in um per um.
    pub(super) fn unit(&self, direction: [f32; AXES]) -> [f32; AXES] {
        let mut unit = direction;
        for (unit, nm_per_count) in unit.iter_mut().zip(&self.nm_per_count) {
            *unit *= *nm_per_count as f32 * 1e-3;
        }
        unit
    }
}

//! A straight segment.

use super::piece::Here;
use super::{AXES, Point};
use crate::units::Fixed;

/// Binary places of a slope.
pub(super) const SLOPE_BITS: u32 = 26;

/// A straight line, ready to be followed.
///
/// Set points are calculated from the nearer end, so both ends are met exactly and the 2^-27 rounding of the slope amounts to
/// less than 0.0001 count per 10 mm.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Line {
    from: Point,
    to: Point,
    length: Fixed,
    /// Counts per um of path, [`SLOPE_BITS`] binary places.
    slope: [i32; AXES],
}

impl Line {
    /// A point: a line of no length.
    pub const fn point(at: Point) -> Line {
        Line { from: at, to: at, length: Fixed(0), slope: [0; AXES] }
    }

    /// Line between two points in counts, of a length in um along the path. A point when it has none.
    ///
    /// An axis moves by less than 32 counts per um.
    #[inline(never)]
    pub(super) fn new(from: Point, to: Point, length: Fixed) -> Line {
        if length.0 <= 0 {
            return Line::point(to);
        }
        // 32 binary digits of the length are as many as the slope has.
        let drop = 32u32.saturating_sub(length.0.leading_zeros());
        let mut slope = [0; AXES];
        for (slope, (from, to)) in slope.iter_mut().zip(from.iter().zip(&to)) {
            let travel = to.minus(*from).0 >> drop;
            let (length, half) = (length.0 >> drop, length.0 >> drop >> 1);
            if travel != 0 {
                let scaled = travel.unsigned_abs().saturating_mul(1 << SLOPE_BITS).saturating_add(half as u64);
                let size = scaled.checked_div(length as u64).unwrap_or(0).min(i32::MAX as u64) as i32;
                *slope = if travel < 0 { size.wrapping_neg() } else { size };
            }
        }
        Line { from, to, length, slope }
    }

    /// Length, um.
    pub fn length(&self) -> Fixed {
        self.length
    }

    /// Start, counts.
    pub fn start(&self) -> Point {
        self.from
    }

    /// End point, counts.
    pub fn end(&self) -> Point {
        self.to
    }

    /// See [`Segment::here`](super::Segment::here).
    #[inline]
    pub(super) fn here(&self, distance: Fixed) -> Here {
        let left = Fixed(self.length.0.wrapping_sub(distance.0));
        let from_start = distance <= left;
        let (anchor, along) = if from_start {
            (&self.from, Fixed(distance.0.max(0)))
        } else {
            (&self.to, Fixed(left.0.max(0).wrapping_neg()))
        };
        let mut here = Here { at: *anchor, slope: self.slope };
        for (at, slope) in here.at.iter_mut().zip(&self.slope) {
            *at = at.near(product::<SLOPE_BITS>(along, *slope));
        }
        here
    }
}

/// `x * factor * 2^-PLACES` without a 128-bit product: the high word's part is whole, so only the low word's is rounded down.
#[inline(always)]
pub(super) fn product<const PLACES: u32>(x: Fixed, factor: i32) -> Fixed {
    const { assert!(PLACES <= 32) };
    let factor = i64::from(factor);
    let high = (x.0 >> 32).wrapping_mul(factor) << (32 - PLACES);
    let low = (i64::from(x.0 as u32).wrapping_mul(factor)) >> PLACES;
    Fixed(high.wrapping_add(low))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::FRACTION_BITS;
    use proptest::prelude::*;

    fn line(to: [i64; 3], length: i64) -> Line {
        Line::new([Fixed(0); AXES], to.map(Fixed::whole), Fixed::whole(length))
    }

    #[test]
    fn both_ends_are_met_exactly() {
        let line = line([3, -4, 0], 5);
        assert_eq!(line.here(Fixed(0)).at, [Fixed(0); AXES]);
        assert_eq!(line.here(line.length()).at, [3, -4, 0].map(Fixed::whole));
        assert_eq!(line.here(Fixed::whole(-1)).at, [Fixed(0); AXES]);
        assert_eq!(line.here(Fixed::whole(6)).at, line.end());
    }

    #[test]
    fn a_line_of_no_length_is_its_point() {
        let point = line([3, -4, 9], 0);
        let Here { at, slope } = point.here(Fixed::whole(1));
        assert_eq!((at, slope), ([3, -4, 9].map(Fixed::whole), [0; AXES]));
    }

    proptest! {
        /// The ratio between axes holds at every point to a ten-thousandth of a count per 10 mm.
        #[test]
        fn the_ratio_between_axes_is_exact(x in -12_000i64..12_000, y in -12_000i64..12_000, part in 0.0f64..=1.0) {
            prop_assume!(x != 0 || y != 0);
            let length = Fixed((((x * x + y * y) as f64).sqrt() * (1u32 << FRACTION_BITS) as f64) as i64);
            let line = Line::new([Fixed(0); AXES], [x, y, 0].map(Fixed::whole), length);
            let [a, b, _] = line.here(Fixed((line.length().0 as f64 * part) as i64)).at;
            let one = (1u64 << FRACTION_BITS) as f64;
            let cross = (a.0 as f64 * y as f64 - b.0 as f64 * x as f64) / one / line.length().to_f32() as f64;
            prop_assert!(cross.abs() < 2e-4, "{cross}");
        }

        #[test]
        fn the_product_agrees_with_128_bits(x in -(1i64 << 50)..1i64 << 50, factor in any::<i32>()) {
            let exact = |places: u32| ((x as i128 * factor as i128) >> places) as i64;
            prop_assert_eq!(product::<26>(Fixed(x), factor).0, exact(26));
            prop_assert_eq!(product::<30>(Fixed(x), factor).0, exact(30));
        }
    }
}

//! A straight segment.

use crate::units::{FRACTION_BITS, Fixed};

/// Binary places of a slope.
const SLOPE_BITS: u32 = 26;

/// A straight line in `A` axes.
///
/// Setpoints are reckoned from the nearer end, so both ends are met exactly and the 2^-27 rounding of the slope amounts to
/// less than 0.0001 count per 10 mm.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Line<const A: usize> {
    from: [Fixed; A],
    to: [Fixed; A],
    length: Fixed,
    /// Counts per um of path, [`SLOPE_BITS`] binary places.
    slope: [i32; A],
}

impl<const A: usize> Line<A> {
    /// Line between two points in counts, with the counts per um of each axis. `None` when it is shorter than the
    /// coordinate resolves, longer than [`Fixed::MAX_WHOLE`] um, or an axis has more than 31 counts to a um, or one that
    /// moves alone fewer than 2^-16.
    pub fn new(from: [Fixed; A], to: [Fixed; A], counts_per_um: [f32; A]) -> Option<Line<A>> {
        let (length, slope) = match (&from[..], &to[..], &counts_per_um[..]) {
            // An axis alone needs no root, and f64 is soft on the chip.
            ([from], [to], [scale]) => {
                let (length, slope) = alone(to.minus(*from), *scale)?;
                (length, [slope; A])
            }
            _ => several(&from, &to, &counts_per_um)?,
        };
        Some(Line { from, to, length, slope })
    }

    /// Length, um.
    pub fn length(&self) -> Fixed {
        self.length
    }

    /// End point, counts.
    pub fn end(&self) -> [Fixed; A] {
        self.to
    }

    /// Axis setpoints at a distance from the start, counts. Outside 0..=length the nearer end is given.
    pub fn at(&self, distance: Fixed) -> [Fixed; A] {
        let left = self.length.minus(distance);
        let from_start = distance <= left;
        let (anchor, along) = if from_start {
            (&self.from, Fixed(distance.0.max(0)))
        } else {
            (&self.to, Fixed(left.0.max(0).saturating_neg()))
        };
        let mut setpoint = *anchor;
        for (setpoint, slope) in setpoint.iter_mut().zip(&self.slope) {
            *setpoint = setpoint.plus(times_slope(along, *slope));
        }
        setpoint
    }

    /// Axis travel for a travel along the path, counts.
    pub fn travel(&self, _distance: Fixed, by: Fixed) -> [Fixed; A] {
        self.slope.map(|slope| times_slope(by, slope))
    }

    /// Axis travel per path travel, counts per um.
    pub fn direction(&self, _distance: Fixed) -> [f32; A] {
        self.slope.map(|slope| slope as f32 * (1.0 / (1u32 << SLOPE_BITS) as f32))
    }
}

/// Length and slope of a travel of one axis: the counts over the scale, rounded down, and the scale with its sign.
fn alone(travel: Fixed, counts_per_um: f32) -> Option<(Fixed, i32)> {
    // The scale is a whole number of 24 bits over a power of two. Other exponents make slopes that do not fit.
    let bits = counts_per_um.to_bits();
    let whole = u64::from(bits & 0x7F_FFFF | 0x80_0000);
    let places = 150u32.checked_sub(bits >> 23 & 0xFF).filter(|places| matches!(places, 19..=39))?;
    let travelled = travel.0.unsigned_abs();
    let (high, rest) = (travelled.checked_div(whole)?, travelled.checked_rem(whole)?);
    // `rest` has 24 bits.
    let low = (rest << places).checked_div(whole)?;
    let length = i64::try_from(high.checked_mul(1 << places)?.checked_add(low)?).ok()?;
    if !(1..=Fixed::MAX_WHOLE << FRACTION_BITS).contains(&length) {
        return None;
    }
    let slope = ((whole << SLOPE_BITS).wrapping_add(1 << (places - 1)) >> places) as i32;
    Some((Fixed(length), if travel.0 < 0 { slope.saturating_neg() } else { slope }))
}

/// Length and slopes of a travel of several axes.
fn several<const A: usize>(from: &[Fixed; A], to: &[Fixed; A], counts_per_um: &[f32; A]) -> Option<(Fixed, [i32; A])> {
    const ONE: f64 = (1u64 << FRACTION_BITS) as f64;
    let mut square = 0.0;
    for ((from, to), scale) in from.iter().zip(to).zip(counts_per_um) {
        let um = to.minus(*from).0 as f64 / ONE / f64::from(*scale);
        square += um * um;
    }
    let length = libm::sqrt(square);
    if !(length * ONE >= 1.0 && length <= Fixed::MAX_WHOLE as f64) {
        return None;
    }
    let mut slope = [0; A];
    for (slope, (from, to)) in slope.iter_mut().zip(from.iter().zip(to)) {
        let counts = to.minus(*from).0 as f64 / ONE;
        let ratio = libm::round(counts / length * (1u64 << SLOPE_BITS) as f64);
        if libm::fabs(ratio) >= f64::from(i32::MAX) {
            return None;
        }
        *slope = ratio as i32;
    }
    Some((Fixed((length * ONE) as i64), slope))
}

/// `x * slope` without a 128-bit product: the high word's part is whole, so only the low word's is rounded down.
fn times_slope(x: Fixed, slope: i32) -> Fixed {
    let slope = i64::from(slope);
    let high = (x.0 >> 32).wrapping_mul(slope) << (32 - SLOPE_BITS);
    let low = (i64::from(x.0 as u32).wrapping_mul(slope)) >> SLOPE_BITS;
    Fixed(high.wrapping_add(low))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn line2(to: [i64; 2]) -> Line<2> {
        Line::new([Fixed(0); 2], to.map(Fixed::whole), [1.0, 1.0]).unwrap()
    }

    #[test]
    fn both_ends_are_met_exactly() {
        let line = line2([3, -4]);
        assert_eq!(line.length(), Fixed::whole(5));
        assert_eq!(line.at(Fixed(0)), [Fixed(0); 2]);
        assert_eq!(line.at(line.length()), [Fixed::whole(3), Fixed::whole(-4)]);
        assert_eq!(line.at(Fixed::whole(-1)), [Fixed(0); 2]);
        assert_eq!(line.at(Fixed::whole(6)), line.end());
    }

    #[test]
    fn a_line_of_no_length_or_out_of_scale_is_not_made() {
        let p = [Fixed::whole(7)];
        assert!(Line::new(p, p, [1.0]).is_none());
        assert!(Line::new(p, [Fixed::whole(8)], [32.0]).is_none());
        assert!(Line::new(p, [Fixed::whole(8)], [31.0]).is_some());
        assert!(Line::new(p, [Fixed::whole(8)], [f32::NAN]).is_none());
        assert!(Line::new(p, [Fixed::whole(8)], [0.0]).is_none());
    }

    #[test]
    fn the_size_of_a_segment_keeps_the_history_in_core_coupled_memory() {
        assert!(core::mem::size_of::<super::super::Segment<{ super::super::AXES }>>() <= 48);
    }

    proptest! {
        /// An axis alone takes the way of several, to the last place of each.
        #[test]
        fn one_axis_agrees_with_several(counts in -(1i64 << 44)..(1i64 << 44), nm_per_count in 50u32..=100_000) {
            let (to, scale) = (Fixed(counts), 1000.0 / nm_per_count as f32);
            let one = alone(to, scale);
            let several = several(&[Fixed(0)], &[to], &[scale]);
            if let (Some((a, slope)), Some((b, [expected]))) = (one, several) {
                prop_assert!((a.0 - b.0).abs() <= 1 && (slope - expected).abs() <= 1, "{a:?} {slope}, {b:?} {expected}");
            } else {
                prop_assert!(one.is_none() && several.is_none());
            }
        }

        /// The ratio between axes holds at every point to a ten-thousandth of a count per 10 mm.
        #[test]
        fn the_ratio_between_axes_is_exact(x in -12_000i64..12_000, y in -12_000i64..12_000, part in 0.0f64..=1.0) {
            prop_assume!(x != 0 || y != 0);
            let line = line2([x, y]);
            let [a, b] = line.at(Fixed((line.length().0 as f64 * part) as i64));
            let one = (1u64 << FRACTION_BITS) as f64;
            let cross = (a.0 as f64 * y as f64 - b.0 as f64 * x as f64) / one / line.length().to_f32() as f64;
            prop_assert!(cross.abs() < 2e-4, "{cross}");
        }

        #[test]
        fn the_product_agrees_with_128_bits(x in -(1i64 << 50)..1i64 << 50, slope in any::<i32>()) {
            let exact = ((x as i128 * slope as i128) >> SLOPE_BITS) as i64;
            prop_assert_eq!(times_slope(Fixed(x), slope).0, exact);
        }
    }
}

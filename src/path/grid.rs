//! Lengths and places in whole numbers: nm from where the path begins, and counts of each axis.

use super::{AXES, Point};
use crate::units::{FRACTION_BITS, Fixed};

/// How far from where the path begins it may lead along any axis, nm: 1.07 m.
pub const REACH: i64 = 1 << 30;

/// Binary places of a length that is kept, um.
const LENGTH_BITS: u32 = 10;

/// nm per count of each axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid(pub [i64; AXES]);

impl Grid {
    /// A length in counts: the nearest.
    pub fn counts(nm: i64, nm_per_count: i64) -> Fixed {
        let half = nm_per_count >> 1;
        let half = if nm < 0 { half.wrapping_neg() } else { half };
        let scaled = (nm << FRACTION_BITS).wrapping_add(half);
        Fixed(scaled.checked_div(nm_per_count).unwrap_or(0))
    }

    /// A length in nm, the nearest; at [`REACH`] where it is longer.
    pub fn nm(counts: Fixed, nm_per_count: i64) -> i64 {
        let scaled = counts.0.saturating_mul(nm_per_count);
        (scaled.saturating_add(1 << (FRACTION_BITS - 1)) >> FRACTION_BITS).clamp(REACH.wrapping_neg(), REACH)
    }
}

/// A point as the register keeps it: nm from where the path begins.
pub(super) type Place = [i32; AXES];

/// A place in counts.
#[inline(never)]
pub(super) fn counts(place: Place, datum: &Point, grid: &Grid) -> Point {
    let mut point = *datum;
    for (point, (nm, nm_per_count)) in point.iter_mut().zip(place.iter().zip(&grid.0)) {
        *point = point.plus(Grid::counts((*nm).into(), *nm_per_count));
    }
    point
}

/// Length of a way in nm, as it is kept: um with [`LENGTH_BITS`] places; 0 only for none.
pub(super) fn length(travel: [u64; AXES]) -> u32 {
    let mut sum = 0u64;
    for travel in travel {
        sum = sum.saturating_add(travel.saturating_mul(travel));
    }
    // As many more places of the root as there is room for.
    let places = (sum.leading_zeros() >> 1).min(31);
    let root = (sum << (places << 1)).isqrt();
    let scaled = (root << LENGTH_BITS).checked_div(1000u64 << places).unwrap_or(0);
    let least = u64::from(sum > 0);
    scaled.max(least).min(u32::MAX.into()) as u32
}

/// A length as it is kept, in um.
pub(super) fn length_um(kept: u32) -> Fixed {
    Fixed(i64::from(kept) << (FRACTION_BITS - LENGTH_BITS))
}

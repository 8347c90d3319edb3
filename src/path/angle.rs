//! Angles of arcs, in whole numbers: the same bits on every machine.

/// An angle, 2^-32 turn, from the first axis of a plane toward the second; wraps at a turn.
pub(super) type Angle = u32;

/// Binary places of a sine.
pub(super) const SINE_BITS: u32 = 30;

/// sin(pi/4 t) / t over t^2, t from -1 to 1: interpolated at the zeros of a Chebyshev polynomial, 31 places.
const SINE: [i32; 4] = [1_686_629_708, -173_399_501, 5_347_249, -77_211];
/// (cos(pi/4 t) - 1) / t^2 over t^2, 32 places.
const COSINE: [i32; 4] = [-1_324_675_878, 68_093_864, -1_399_993, 15_213];

/// atan(2^-i), 2^-40 turn.
const ATAN: [i64; 32] = [
    137_438_953_472,
    81_134_951_838,
    42_869_480_287,
    21_761_217_566,
    10_922_836_750,
    5_466_743_129,
    2_734_038_620,
    1_367_102_738,
    683_561_799,
    341_782_203,
    170_891_265,
    85_445_653,
    42_722_829,
    21_361_415,
    10_680_707,
    5_340_354,
    2_670_177,
    1_335_088,
    667_544,
    333_772,
    166_886,
    83_443,
    41_722,
    20_861,
    10_430,
    5_215,
    2_608,
    1_304,
    652,
    326,
    163,
    81,
];

/// Cosine and sine, [`SINE_BITS`] places, to 10^-8: 1 nm at a radius of 100 mm.
#[inline]
pub(super) fn cos_sin(angle: Angle) -> [i32; 2] {
    // Within an eighth of a turn of one of the four axes.
    let quarter = angle.wrapping_add(1 << 29) >> 30;
    let t = (angle.wrapping_sub(quarter << 30) << 2).cast_signed();
    let square = high(t, t);
    let series = |[a, b, c, d]: [i32; 4]| {
        let next = |sum: i32, constant: i32| constant.wrapping_add(high(square, sum) << 2);
        next(next(next(d, c), b), a)
    };
    let sine = high(t, series(SINE));
    let cosine = (1i32 << SINE_BITS).wrapping_add(high(square, series(COSINE)));
    match quarter & 3 {
        0 => [cosine, sine],
        1 => [sine.wrapping_neg(), cosine],
        2 => [cosine.wrapping_neg(), sine.wrapping_neg()],
        _ => [sine, cosine.wrapping_neg()],
    }
}

/// Angle of a vector, by turning it onto the first axis (Volder's CORDIC); 0 for none.
#[inline(never)]
pub(super) fn of([x, y]: [i32; 2]) -> Angle {
    // Room for the gain of 1.65, and places below the last.
    let (mut x, mut y) = (i64::from(x) << 28, i64::from(y) << 28);
    let mut angle = 0i64;
    if x < 0 {
        (x, y, angle) = (x.wrapping_neg(), y.wrapping_neg(), 1 << 39);
    }
    for (i, step) in ATAN.iter().enumerate() {
        let (dx, dy) = (y >> i, x >> i);
        if y >= 0 {
            (x, y, angle) = (x.wrapping_add(dx), y.wrapping_sub(dy), angle.wrapping_add(*step));
        } else {
            (x, y, angle) = (x.wrapping_sub(dx), y.wrapping_add(dy), angle.wrapping_sub(*step));
        }
    }
    if x == 0 && y == 0 { 0 } else { (angle.wrapping_add(1 << 7) >> 8) as u32 }
}

/// The high word of a product: one instruction.
#[inline(always)]
fn high(a: i32, b: i32) -> i32 {
    (i64::from(a).wrapping_mul(i64::from(b)) >> 32) as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;
    use proptest::prelude::*;

    const TURN: f64 = (1u64 << 32) as f64;

    proptest! {
        #[test]
        fn sine_and_cosine_are_right_to_a_nanometre_at_100_mm(angle in any::<u32>()) {
            let exact = f64::from(angle) / TURN * TAU;
            let [cosine, sine] = cos_sin(angle).map(|x| f64::from(x) / f64::from(1 << SINE_BITS));
            prop_assert!((cosine - exact.cos()).abs() < 1e-8 && (sine - exact.sin()).abs() < 1e-8);
        }

        #[test]
        fn the_angle_of_a_vector_is_right_to_a_nanometre_at_100_mm(x in -(1i32 << 30)..1 << 30, y in -(1i32 << 30)..1 << 30) {
            prop_assume!(x.abs().max(y.abs()) > 1000);
            let exact = f64::from(y).atan2(f64::from(x)) / TAU * TURN;
            let off = of([x, y]).wrapping_sub(exact.round() as i64 as u32).cast_signed();
            prop_assert!(off.abs() <= 6, "{off}");
        }
    }

    #[test]
    fn the_ends_of_every_quarter_are_met() {
        for (quarter, vector) in [[1, 0], [0, 1], [-1, 0], [0, -1]].iter().enumerate() {
            let off = of(vector.map(|x| x * 1_000_000)).wrapping_sub((quarter as u32) << 30).cast_signed();
            assert!(off.abs() <= 2, "{quarter}: {off}");
            assert_eq!(cos_sin((quarter as u32) << 30), vector.map(|x| x << SINE_BITS));
        }
    }
}

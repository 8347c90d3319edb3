//! Functions of the pinned library, and two series for the small arguments that nearly all of the calls have.

/// Below this, six terms of the series are right to 2e-14.
const SMALL: f64 = 0.02;
/// Below this, the series of a 32nd and five doublings are quicker than the library.
const DOUBLED: f64 = 32.0 * SMALL;

/// Share that has gone after `x` time constants: 1 - e^-x, for x from 0 on.
#[inline]
pub fn gone(x: f64) -> f64 {
    if x < SMALL {
        little_gone(x)
    } else if x < DOUBLED {
        // 1 - (1 - g)^2.
        (0..5).fold(little_gone(x * (1.0 / 32.0)), |g, _| g * (2.0 - g))
    } else {
        -libm::expm1(-x)
    }
}

#[inline]
fn little_gone(x: f64) -> f64 {
    const C: [f64; 5] = [1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0];
    x * (1.0 - x * (C[0] - x * (C[1] - x * (C[2] - x * (C[3] - x * C[4])))))
}

/// Sum of sixteen, in an order of its own that can be done four at a time.
#[inline]
pub fn sum(of: &[f64; 16]) -> f64 {
    let mut four = [0.0; 4];
    for group in of.chunks_exact(4) {
        for (sum, x) in four.iter_mut().zip(group) {
            *sum += x;
        }
    }
    (four[0] + four[1]) + (four[2] + four[3])
}

/// -ln(1 - x), for x from 0 to below 1.
#[inline]
pub fn exponents(x: f64) -> f64 {
    if x < SMALL {
        x * (1.0 + x * (1.0 / 2.0 + x * (1.0 / 3.0 + x * (1.0 / 4.0 + x * (1.0 / 5.0 + x * (1.0 / 6.0))))))
    } else {
        -libm::log1p(-x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_series_meet_the_library_where_they_end() {
        for k in 1..1000 {
            let x = 2.0 * DOUBLED * f64::from(k) / 1000.0;
            assert!((gone(x) / -libm::expm1(-x) - 1.0).abs() < 1e-13, "{x}");
            let x = SMALL * f64::from(k) / 1000.0;
            assert!((gone(x) / -libm::expm1(-x) - 1.0).abs() < 1e-13, "{x}");
            assert!((exponents(x) / -libm::log1p(-x) - 1.0).abs() < 1e-11, "{x}");
        }
    }
}

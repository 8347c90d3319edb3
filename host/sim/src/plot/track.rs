//! Where the head went, in memory of a fixed size.

use crate::millisecond::{Millisecond, Phase};

/// Points kept at the most; then those that are close together are left out.
const POINTS: usize = 4000;
/// The smallest distance that is then left between them, um.
const FINEST_UM: f64 = 0.1;

/// Points that the head came past: down, X, Y, um.
#[derive(Debug, Default)]
pub(super) struct Track {
    points: Vec<[f64; 3]>,
    /// Distance from the newest point at which the next is kept, um.
    apart_um: f64,
}

impl Track {
    /// Takes the newest millisecond, if the head was at work in it.
    pub fn add(&mut self, ms: &Millisecond) {
        if !matches!(ms.phase, Phase::Eroding | Phase::Retreating) {
            return;
        }
        let [x, y] = ms.beside_um;
        self.keep([ms.position_um.mean, x, y]);
        if self.points.len() >= POINTS {
            self.apart_um = (2.0 * self.apart_um).max(FINEST_UM);
            for point in std::mem::take(&mut self.points) {
                self.keep(point);
            }
        }
    }

    /// Keeps a point that is far enough from the newest.
    fn keep(&mut self, point: [f64; 3]) {
        let square = |newest: &[f64; 3]| newest.iter().zip(point).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        if self.points.last().is_none_or(|newest| square(newest) > self.apart_um * self.apart_um) {
            self.points.push(point);
        }
    }

    /// All, oldest first.
    pub fn all(&self) -> &[[f64; 3]] {
        &self.points
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::millisecond::Span;

    #[test]
    fn a_long_track_keeps_its_ends_and_a_bounded_number_of_points() {
        let mut track = Track::default();
        for i in 0..100_000 {
            let mean = f64::from(i) * 0.5;
            let position_um = Span { mean, min: mean, max: mean };
            let ms = super::super::tests::ms(i, Phase::Eroding);
            track.add(&Millisecond { position_um, beside_um: [mean, 0.0], ..ms });
        }
        assert!((POINTS / 4..POINTS).contains(&track.all().len()), "{}", track.all().len());
        assert_eq!(track.all().first(), Some(&[0.0, 0.0, 0.0]));
        assert!(track.all().last().unwrap()[0] > 49_900.0);
        assert!(track.all().windows(2).all(|pair| pair[1][0] - pair[0][0] < 100.0));
    }
}

//! The encoder on its scale: edges of A, B and index with their times.

use super::Parameters;
use edm_hal_shim::encoder::Levels;
use rand::RngExt;
use rand_xoshiro::Xoshiro256PlusPlus;

/// An edge as the decoder gets it: clock time and levels after it.
pub type Edge = (u32, Levels);

/// Scale and reading head.
#[derive(Clone, Debug)]
pub struct Scale {
    per_metre: f64,
    marks: i64,
    phase_error: f64,
    loss: f64,
    reversed: bool,
    /// The lines stand still whatever moves.
    pub dead: bool,
    /// Line A changes at odd half-periods, B a quarter later; together they count this.
    half_a: i64,
    half_b: i64,
}

impl Scale {
    /// Scale whose count 0 is centred on the upper stop.
    pub fn new(p: &Parameters) -> Scale {
        let per_metre = 1e6 / f64::from(p.count);
        let mut scale = Scale {
            per_metre,
            marks: (f64::from(p.marks) * 1e-3 * per_metre).round() as i64,
            phase_error: p.phase_error.into(),
            loss: p.edge_loss.into(),
            reversed: p.encoder_reversed,
            dead: false,
            half_a: 0,
            half_b: 0,
        };
        (scale.half_a, scale.half_b) = scale.halves(0.0);
        scale
    }

    /// Half-periods of A and B passed at a position: A changes before odd counts, B before even ones.
    fn halves(&self, x: f64) -> (i64, i64) {
        let counts = x * self.per_metre + 0.5;
        (((counts + 1.0) * 0.5).floor() as i64, ((counts - self.phase_error) * 0.5).floor() as i64)
    }

    /// The true count at a position.
    pub fn count(&self, x: f64) -> i64 {
        (x * self.per_metre + 0.5).floor() as i64
    }

    /// Levels of the lines now.
    pub fn levels(&self) -> Levels {
        let (a, b) = (self.half_a & 1 == 1, self.half_b & 1 == 1);
        let count = self.half_a + self.half_b;
        let index = count.rem_euclid(self.marks) == 0;
        if self.reversed { Levels { a: b, b: a, index } } else { Levels { a, b, index } }
    }

    /// Edges of a straight piece of motion that begins at clock time `start` and takes `ticks`.
    pub fn travel(
        &mut self,
        from: f64,
        to: f64,
        start: u32,
        ticks: f64,
        random: &mut Xoshiro256PlusPlus,
        edges: &mut Vec<Edge>,
    ) {
        if self.dead {
            return;
        }
        let (a, b) = self.halves(to);
        let forward = to > from;
        while (self.half_a, self.half_b) != (a, b) {
            // Where each line changes next, in counts.
            let ahead = i64::from(forward);
            let next_a = 2.0 * (self.half_a + ahead) as f64 - 1.5;
            let next_b = 2.0 * (self.half_b + ahead) as f64 - 0.5 + self.phase_error;
            let first_a = match (self.half_a != a, self.half_b != b) {
                (true, true) => (next_a < next_b) == forward,
                (changes_a, _) => changes_a,
            };
            let place = if first_a { next_a } else { next_b };
            let by = if forward { 1 } else { -1 };
            if first_a {
                self.half_a += by;
            } else {
                self.half_b += by;
            }
            let share = ((place / self.per_metre - from) / (to - from)).clamp(0.0, 1.0);
            if self.loss == 0.0 || random.random::<f64>() >= self.loss {
                edges.push((start.wrapping_add((share * ticks) as u32), self.levels()));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_servo_head::encoder::Quadrature;
    use rand::SeedableRng;

    fn walk(p: &Parameters, turns: &[f64]) -> (i64, i64, u32) {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
        let mut scale = Scale::new(p);
        let mut decoder = Quadrature::new(scale.levels(), 0);
        let (mut x, mut now) = (0.0, 0u32);
        for &turn in turns {
            let mut edges = Vec::new();
            scale.travel(x, turn, now, 8400.0, &mut random, &mut edges);
            assert!(edges.is_sorted_by_key(|edge| edge.0));
            for (time, levels) in edges {
                decoder.edge(levels, time);
            }
            x = turn;
            now += 8400;
        }
        let seen = decoder.snapshot(now);
        (seen.raw.count as i32 as i64, scale.count(x), seen.illegal)
    }

    #[test]
    fn the_decoder_counts_what_the_scale_moves_also_with_a_phase_error() {
        let turns = [30e-6, 28.3e-6, 55.9e-6, -40.2e-6, -40.7e-6, -40.2e-6, 3.49e-6, 3.51e-6];
        for phase_error in [0.0, 0.4, -0.7] {
            let p = Parameters { phase_error, ..Parameters::default() };
            for n in 1..=turns.len() {
                let (seen, truth, illegal) = walk(&p, &turns[..n]);
                assert!((seen - truth).abs() <= i64::from(phase_error != 0.0), "{seen} {truth}");
                assert_eq!(illegal, 0);
            }
        }
    }

    #[test]
    fn lost_edges_are_illegal_transitions() {
        let p = Parameters { edge_loss: 0.1, ..Parameters::default() };
        let turns: Vec<f64> = (1..100).map(|k| f64::from(k) * 20e-6).collect();
        let (_, _, illegal) = walk(&p, &turns);
        assert!(illegal > 50, "{illegal}");
    }

    #[test]
    fn a_scale_wired_the_wrong_way_counts_down() {
        let p = Parameters { encoder_reversed: true, ..Parameters::default() };
        let (seen, truth, illegal) = walk(&p, &[25.2e-6]);
        assert_eq!((seen, truth, illegal), (-25, 25, 0));
    }
}

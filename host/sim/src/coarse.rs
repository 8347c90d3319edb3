//! A coarse axis of the machine, which carries the head, and the host that moves it when the head asks.
//!
//! The axis moves at a constant velocity and stops with an error that is the same on the whole way of a move, up to a set
//! size either way. A host with a scale on the axis says where that stands; one without says that it has moved as asked.

use edm_servo_head::head::{Carry, Inch, Status};
use edm_servo_head::units::{Nanometres, TICK_HZ};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Velocity of the axis, um/s; assumed.
const VELOCITY: f64 = 10_000.0;
/// Ticks from the end of a move to the answer: the axis has come to rest, and the host has looked. Assumed, 0.1 s.
const SETTLES: u32 = TICK_HZ / 10;
/// Resolution of the host's scale, nm; assumed.
const SCALE_NM: f64 = 1000.0;

/// The axis and its host.
#[derive(Clone, Debug)]
pub struct Coarse {
    /// Where the axis is and is to go, um toward the work.
    place_um: f64,
    goal_um: f64,
    /// Largest error of a move, um.
    error_um: f64,
    /// The host has a scale.
    scale: bool,
    /// Ticks at rest since a move; none where nothing was asked.
    rests: Option<u32>,
    random: Xoshiro256PlusPlus,
    moves: u64,
}

impl Coarse {
    /// At rest, with errors of moves of at most `error_um`.
    pub fn new(error_um: f64, scale: bool, seed: u64) -> Coarse {
        // Not the stream of the process.
        let random = Xoshiro256PlusPlus::seed_from_u64(seed ^ 0xC0A5_E000_0000_0000);
        Coarse { place_um: 0.0, goal_um: 0.0, error_um, scale, rests: None, random, moves: 0 }
    }

    /// Where it is, um toward the work.
    pub fn place_um(&self) -> f64 {
        self.place_um
    }

    /// Moves so far.
    pub fn moves(&self) -> u64 {
        self.moves
    }

    /// One servo tick: looks at a head whose count is so many nm, and gives the answer of the host when there is one.
    pub fn tick(&mut self, status: &Status, nm_per_count: f64) -> Option<Carry> {
        if status.inch != Inch::Asks {
            self.rests = None;
        } else if self.rests.is_none() {
            // By its own scale, or by its steps.
            let error = self.random.random_range(-1.0..=1.0) * self.error_um;
            let by = (status.carry_to - status.coarse) as f64 * nm_per_count * 1e-3;
            self.goal_um = self.place_um + by + error;
            (self.rests, self.moves) = (Some(0), self.moves + 1);
        }
        let step = VELOCITY / f64::from(TICK_HZ);
        let left = self.goal_um - self.place_um;
        self.place_um = if left.abs() <= step { self.goal_um } else { self.place_um + step.copysign(left) };
        let rests = self.rests.as_mut().filter(|_| left == 0.0)?;
        *rests += 1;
        (*rests == SETTLES).then(|| match self.scale {
            true => Carry::To(Nanometres(((self.place_um * 1e3 / SCALE_NM).round() * SCALE_NM) as i64)),
            false => Carry::AsAsked,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(coarse: &mut Coarse, status: &Status) -> Carry {
        (0..100_000).find_map(|_| coarse.tick(status, 1000.0)).expect("an answer")
    }

    #[test]
    fn an_axis_goes_where_it_is_asked_to_but_for_its_error() {
        let asks = Status { inch: Inch::Asks, carry_to: 8000, ..Status::default() };
        let mut exact = Coarse::new(0.0, true, 1);
        assert_eq!(answer(&mut exact, &asks), Carry::To(Nanometres(8_000_000)));
        assert_eq!((exact.place_um(), exact.moves()), (8000.0, 1));
        // Nothing more until it is asked again.
        assert!((0..10_000).all(|_| exact.tick(&asks, 1000.0).is_none()));
        exact.tick(&Status::default(), 1000.0);
        let again = Status { carry_to: 16_000, coarse: 8000, ..asks };
        assert_eq!(answer(&mut exact, &again), Carry::To(Nanometres(16_000_000)));
        let mut errors = Vec::new();
        for seed in 0..50 {
            let mut coarse = Coarse::new(5.0, false, seed);
            assert_eq!(answer(&mut coarse, &asks), Carry::AsAsked);
            errors.push(coarse.place_um() - 8000.0);
        }
        assert!(errors.iter().all(|error| error.abs() <= 5.0));
        assert!(errors.iter().any(|error| *error > 3.0) && errors.iter().any(|error| *error < -3.0), "{errors:?}");
    }
}

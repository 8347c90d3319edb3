//! Steps of a host as places of the axis: an electronic gear that loses nothing.
//!
//! Each step moves the place by a ratio of whole numbers; what is no whole count is kept as a remainder. So after any number of steps
//! either way the place is the one that the sum of all steps amounts to. The set point follows it with a time constant: a count a plan would
//! otherwise be a step of the velocity.

use crate::units::{FRACTION_BITS, Fixed, TICKS_PER_MS};
use edm_hal_shim::steps::Polarity;

/// Counts beyond which a place is not followed, whatever the host sends.
const FARTHEST: i64 = 1 << 34;

/// How steps move the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Which edge is a step, and which level goes where.
    pub polarity: Polarity,
    /// So many counts, 1 or more ...
    pub counts: u32,
    /// ... for so many steps, 1 or more.
    pub steps: u32,
    /// Time constant with which the set point follows, servo ticks, a plan or more.
    pub smooth: u32,
}

/// Why steps are not followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Unfollowed {
    /// They are, or nobody has asked for it.
    #[default]
    No,
    /// They came faster than the axis may go.
    TooFast,
    /// Their direction changed faster than it is counted.
    Lost,
    /// They turned while the queue of the path was full.
    Overrun,
    /// The path that they record leads out of the travel.
    Beyond,
}

/// Counts that steps amount to.
#[derive(Clone, Copy, Debug, Default)]
struct Gear {
    counts: i64,
    /// Of a count, in the steps of the ratio.
    rest: u32,
}

impl Gear {
    /// Takes steps, positive toward the work.
    fn take(&mut self, steps: i32, config: &Config) {
        let ratio = i64::from(config.steps.max(1));
        let all = i64::from(steps).wrapping_mul(config.counts.into()).wrapping_add(self.rest.into());
        self.counts = self.counts.saturating_add(all.checked_div_euclid(ratio).unwrap_or(0));
        self.rest = all.checked_rem_euclid(ratio).unwrap_or(0) as u32;
    }

    /// Where the steps have led, less where they began.
    fn place(&self, config: &Config) -> i64 {
        let part = (u64::from(self.rest) << FRACTION_BITS).checked_div(config.steps.into()).unwrap_or(0);
        let whole = self.counts.clamp(-FARTHEST, FARTHEST) << FRACTION_BITS;
        whole.wrapping_add(part.cast_signed())
    }
}

/// Follows steps from a place on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stepper {
    from: Fixed,
    gear: Gear,
    /// Between these the set point stays.
    pub bounds: (Fixed, Fixed),
}

impl Stepper {
    /// No step yet.
    pub fn new(from: Fixed, bounds: (Fixed, Fixed)) -> Stepper {
        Stepper { from, gear: Gear::default(), bounds }
    }

    /// Takes steps, positive toward the work.
    pub fn take(&mut self, steps: i32, config: &Config) {
        self.gear.take(steps, config);
    }

    /// Where the steps have led, and whether a bound keeps the axis from there.
    pub fn place(&self, config: &Config) -> (Fixed, bool) {
        let to = self.from.plus(Fixed(self.gear.place(config)));
        let (least, most) = self.bounds;
        let inside = to.max(least).min(most);
        (inside, inside != to)
    }
}

/// Makes a path of steps: it has an end where they turn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recorder {
    from: Fixed,
    gear: Gear,
    /// Which way the newest went, 0 for neither yet.
    toward: i32,
    /// Ticks since the path has had an end.
    age: u32,
    /// End of the path so far, counts.
    queued: Fixed,
}

/// Counts, and ticks, after which what is recorded becomes path though it goes on: 50 and 50 ms.
const SPAN: Fixed = Fixed(50 << FRACTION_BITS);
const AGE: u32 = 50 * TICKS_PER_MS;

impl Recorder {
    /// A path goes on from here.
    pub fn new(from: Fixed) -> Recorder {
        Recorder { from, gear: Gear::default(), toward: 0, age: 0, queued: from }
    }

    /// Takes steps. Where they turn, gives the place that the path has to reach before.
    pub fn take(&mut self, steps: i32, config: &Config) -> Option<Fixed> {
        if steps == 0 {
            return None;
        }
        let turns = self.toward != 0 && self.toward != steps.signum();
        let corner = self.end(config);
        self.toward = steps.signum();
        self.gear.take(steps, config);
        (turns && corner != self.queued).then_some(corner)
    }

    /// Where the steps have led.
    pub fn end(&self, config: &Config) -> Fixed {
        self.from.plus(Fixed(self.gear.place(config)))
    }

    /// The path ends there now.
    pub fn queue(&mut self, end: Fixed) {
        (self.queued, self.age) = (end, 0);
    }

    /// What of it is to become path now, `ticks` after the last call.
    pub fn due(&mut self, config: &Config, ticks: u32) -> Option<Fixed> {
        let end = self.end(config);
        if end == self.queued {
            self.age = 0;
            return None;
        }
        self.age = self.age.saturating_add(ticks);
        let long = end.minus(self.queued).0.unsigned_abs() >= SPAN.0.unsigned_abs();
        (long || self.age >= AGE).then_some(end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(counts: u32, steps: u32) -> Config {
        Config { polarity: Polarity::default(), counts, steps, smooth: 40 }
    }

    const WIDE: (Fixed, Fixed) = (Fixed(i64::MIN), Fixed(i64::MAX));

    #[test]
    fn a_ratio_loses_nothing_however_the_steps_come() {
        for (counts, steps) in [(1, 1), (7, 13), (1, 3), (1_000_000, 999_999), (1, 1_000_000), (25, 16)] {
            let config = config(counts, steps);
            let mut stepper = Stepper::new(Fixed::whole(-5), WIDE);
            let (mut sum, mut random) = (0i64, 7u32);
            for _ in 0..200_000 {
                random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let run = (random >> 20) as i32 - 2048;
                sum += i64::from(run);
                stepper.take(run, &config);
            }
            let exact = i128::from(sum) * i128::from(counts) * (1 << FRACTION_BITS);
            let exact = exact.div_euclid(i128::from(steps)) - 5 * (1 << FRACTION_BITS);
            assert_eq!(i128::from(stepper.place(&config).0.0), exact, "{counts}/{steps}");
            stepper.take(-(sum as i32), &config);
            assert_eq!(stepper.place(&config).0, Fixed::whole(-5), "and back");
        }
    }

    #[test]
    fn beyond_a_bound_the_set_point_stays_and_comes_back_where_the_steps_do() {
        let config = config(1, 1);
        let mut stepper = Stepper::new(Fixed(0), (Fixed::whole(-10), Fixed::whole(10)));
        stepper.take(15, &config);
        assert_eq!(stepper.place(&config), (Fixed::whole(10), true));
        stepper.take(-6, &config);
        assert_eq!(stepper.place(&config), (Fixed::whole(9), false));
        stepper.take(i32::MIN, &config);
        (0..10_000).for_each(|_| stepper.take(i32::MIN, &config));
        assert_eq!(stepper.place(&config), (Fixed::whole(-10), true));
    }

    #[test]
    fn a_recorded_path_ends_where_steps_turn_and_now_and_then_between() {
        let config = config(1, 2);
        let mut recorder = Recorder::new(Fixed::whole(10));
        assert_eq!((recorder.take(0, &config), recorder.due(&config, AGE)), (None, None));
        assert_eq!((recorder.take(7, &config), recorder.take(4, &config)), (None, None));
        assert_eq!(recorder.due(&config, AGE - 1), None);
        // Ten and eleven halves.
        let corner = Fixed::whole(10).plus(Fixed(11 << (FRACTION_BITS - 1)));
        assert_eq!(recorder.take(-1, &config), Some(corner));
        recorder.queue(corner);
        assert_eq!(recorder.take(-8, &config), None);
        assert_eq!(recorder.due(&config, AGE), Some(Fixed::whole(11)));
        recorder.queue(Fixed::whole(11));
        // It has that end already.
        assert_eq!(recorder.take(1, &config), None);
        assert_eq!(recorder.take(150, &config), None);
        assert!(recorder.due(&config, 1).is_some());
    }
}

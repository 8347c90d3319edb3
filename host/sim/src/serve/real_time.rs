//! Simulated time at so many times the speed of real time.

use edm_servo_head::units::TICK_HZ;
use std::time::{Duration, Instant};

/// Real time between two looks at the clock when nothing else happens.
const BEAT: Duration = Duration::from_millis(1);
/// Real time by which the simulation may lag before it gives up catching up.
const PATIENCE: Duration = Duration::from_millis(200);

/// Which servo tick is due.
#[derive(Clone, Copy, Debug)]
pub struct RealTime {
    start: Instant,
    speed: f64,
    done: u64,
}

/// Ticks that are due.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Due {
    /// How many.
    pub ticks: u64,
    /// Simulated time lost because the computer is too slow, s.
    pub lost_s: f64,
}

impl RealTime {
    /// Starts now. `speed`: simulated seconds a second.
    pub fn new(start: Instant, speed: f64) -> RealTime {
        RealTime { start, speed, done: 0 }
    }

    /// The ticks since the last call. A lag beyond 0.2 s of real time is dropped: simulated time stops for that long.
    pub fn due(&mut self, now: Instant) -> Due {
        let rate = self.speed * f64::from(TICK_HZ);
        let reached = (now.saturating_duration_since(self.start).as_secs_f64() * rate) as u64;
        let ticks = reached.saturating_sub(self.done);
        let most = (PATIENCE.as_secs_f64() * rate) as u64;
        if ticks <= most {
            self.done += ticks;
            return Due { ticks, lost_s: 0.0 };
        }
        self.start = now;
        self.done = 0;
        Due { ticks: most, lost_s: (ticks - most) as f64 / f64::from(TICK_HZ) }
    }

    /// When to look again if nothing else happens.
    pub fn next(&self, now: Instant) -> Instant {
        let tick = Duration::from_secs_f64(1.0 / (self.speed * f64::from(TICK_HZ)));
        now + BEAT.max(tick)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_has_its_ticks_however_often_one_looks() {
        for (speed, ticks) in [(1.0, 20_000), (0.1, 2000), (10.0, 200_000)] {
            let start = Instant::now();
            let mut real_time = RealTime::new(start, speed);
            let mut sum = 0;
            for us in (0..=1_000_000).step_by(777).chain([1_000_000]) {
                let due = real_time.due(start + Duration::from_micros(us));
                assert_eq!(due.lost_s, 0.0);
                sum += due.ticks;
            }
            assert_eq!(sum, ticks, "{speed}");
        }
    }

    #[test]
    fn a_lag_is_caught_up_to_a_fifth_of_a_second_and_then_given_up() {
        let start = Instant::now();
        let mut real_time = RealTime::new(start, 2.0);
        assert_eq!(real_time.due(start + Duration::from_millis(200)), Due { ticks: 8000, lost_s: 0.0 });
        let late = start + Duration::from_millis(700);
        assert_eq!(real_time.due(late), Due { ticks: 8000, lost_s: 0.6 });
        assert_eq!(real_time.due(late + Duration::from_millis(1)), Due { ticks: 40, lost_s: 0.0 });
    }
}

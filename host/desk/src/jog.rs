//! Moving a head by hand: enabled and holding, pulses off, in steps that a session requests.
//!
//! Positions are kept as in a hole: a head without a home takes where it rests for it. The head limits the velocity toward the work
//! and goes back from a contact by itself. It is disabled at the end.

use crate::Failure;
use crate::bus::lock;
use crate::head::{Head, at};
use crate::live::{Live, Sample};
use serde::Serialize;
use std::collections::VecDeque;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Velocity of a step, where the head allows it, mm/s.
const VELOCITY_MM_S: f64 = 2.0;
/// The longest step, mm.
const LONGEST_MM: f64 = 10.0;
/// Time between two samples.
const PERIOD: Duration = Duration::from_millis(50);
/// Why a wait ended when nothing went wrong.
const ENDED: &str = "ended on request";

/// What a session requests.
#[derive(Debug, Default)]
pub struct Requests {
    steps: Mutex<VecDeque<i64>>,
    /// Once it is known.
    room: Mutex<Option<Room>>,
    end: AtomicBool,
}

/// Where steps may lead, counts.
#[derive(Clone, Copy, Debug)]
struct Room {
    /// Where the head is to be when all steps are done.
    target: i64,
    /// The ends of the travel.
    low: i64,
    high: i64,
    /// Counts a millimetre.
    per_mm: f64,
}

impl Requests {
    /// One step more, positive toward the work.
    ///
    /// # Errors
    /// What is allowed.
    pub fn step(&self, by_mm: f64) -> Result<(), Failure> {
        let refused = |why: String| Err(Failure::BadInput(why));
        if !(-LONGEST_MM..=LONGEST_MM).contains(&by_mm) {
            return refused(format!("step {by_mm} mm: must be a number from -{LONGEST_MM} to {LONGEST_MM} mm"));
        }
        let mut room = lock(&self.room);
        let Some(Room { target, low, high, per_mm }) = *room else {
            return refused("the head is not enabled yet: wait a moment".into());
        };
        let step = (by_mm * per_mm).round() as i64;
        let (to, mm) = (target + step, |counts: i64| counts as f64 / per_mm);
        if !(low..=high).contains(&to) {
            let (to, low, high) = (mm(to), mm(low), mm(high));
            return refused(format!("to {to:.3} mm: must be from {low:.3} to {high:.3} mm, the travel"));
        }
        *room = Some(Room { target: to, low, high, per_mm });
        lock(&self.steps).push_back(step);
        Ok(())
    }

    /// Ends it: hold, disable.
    pub fn end(&self) {
        self.end.store(true, Ordering::Release);
    }

    fn ended(&self) -> bool {
        self.end.load(Ordering::Acquire)
    }
}

/// How it stands.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Progress {
    /// Present activity.
    pub doing: &'static str,
    /// Where the head is to be, mm below home.
    pub target_mm: Option<f64>,
    /// What the head does.
    pub sample: Sample,
}

/// Inputs of a run.
pub struct Jog<'a> {
    /// The head.
    pub head: &'a Head,
    /// What it does.
    pub live: &'a mut Live,
    /// Requests of the session.
    pub requests: &'a Requests,
    /// Called in every wait. An error ends the run.
    pub alive: &'a dyn Fn() -> Result<(), Failure>,
    /// Called with the progress.
    pub on_progress: &'a mut dyn FnMut(&Progress),
}

impl Jog<'_> {
    /// Moves until it is to end; says what the head is then.
    ///
    /// # Errors
    /// What went wrong; the head is disabled or in a fault then, or the error says that it may not be.
    pub fn execute(mut self) -> Result<String, Failure> {
        self.head.free()?;
        let velocity = self.head.whole(at::PROFILE_VELOCITY)?;
        let armed = self.head.arm()?;
        self.live.expect_heartbeat();
        let moved = self.moves();
        *lock(&self.requests.room) = None;
        let now = self.head.stop();
        let _ = self.head.set(at::PROFILE_VELOCITY, velocity);
        armed.disarm();
        match (moved, now) {
            (Ok(()), now) => now,
            (Err(Failure::Failed(why)), now) if why == ENDED => now,
            (Err(why), Ok(now)) => Err(Failure::Failed(format!("{why}; {now}"))),
            (Err(why), Err(now)) => Err(Failure::Failed(format!("{why}; {now}; the head retreats by itself"))),
        }
    }

    fn moves(&mut self) -> Result<(), Failure> {
        let (head, requests) = (self.head, self.requests);
        let per_mm = self.live.counts_per_mm();
        let alive = self.alive;
        let mut tick = || {
            alive()?;
            if requests.ended() { Err(Failure::Failed(ENDED.into())) } else { Ok(()) }
        };
        head.enable(&mut tick)?;
        if head.whole(at::HOMED)? == 0 {
            head.home_here(&mut tick)?;
        }
        head.set(at::PROFILE_VELOCITY, (VELOCITY_MM_S * per_mm).round() as i64)?;
        let (here, end) = head.room()?;
        *lock(&requests.room) = Some(Room { target: here, low: here.min(0), high: end, per_mm });
        let mut target = here;
        loop {
            let sample = self.live.sample()?;
            let moving = !lock(&requests.steps).is_empty();
            let doing = if moving { "moving, pulses off" } else { "holding, pulses off" };
            if sample.fault_number != 0 {
                return Err(Failure::Failed(sample.fault));
            }
            head.enabled()?;
            (self.on_progress)(&Progress { doing, target_mm: Some(target as f64 / per_mm), sample });
            tick()?;
            // All that were requested meanwhile are one move.
            let step: i64 = lock(&requests.steps).drain(..).sum();
            if step == 0 {
                std::thread::sleep(PERIOD);
                continue;
            }
            target += step;
            let (live, on_progress) = (&mut *self.live, &mut *self.on_progress);
            head.move_to(target, &mut || {
                tick()?;
                let sample = live.sample()?;
                on_progress(&Progress { doing: "moving, pulses off", target_mm: Some(target as f64 / per_mm), sample });
                Ok(())
            })?;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_end_within_the_travel_and_none_is_taken_before_it_is_known() {
        let requests = Requests::default();
        let why = |by| requests.step(by).unwrap_err().to_string();
        assert!(why(0.1).contains("not enabled yet"));
        *lock(&requests.room) = Some(Room { target: 500, low: 0, high: 2000, per_mm: 1000.0 });
        assert!(why(f64::NAN).contains("from -10 to 10 mm") && why(11.0).contains("step 11 mm"));
        assert_eq!(why(-0.501), "to -0.001 mm: must be from 0.000 to 2.000 mm, the travel");
        requests.step(1.0).unwrap();
        // From where the step before it ends.
        assert_eq!(why(0.501), "to 2.001 mm: must be from 0.000 to 2.000 mm, the travel");
        requests.step(0.5).unwrap();
        assert_eq!(lock(&requests.steps).iter().sum::<i64>(), 1500);
    }
}

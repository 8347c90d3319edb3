//! The last bore of a head, kept for pages: one that is opened or loaded later shows the same as one that was there.
//!
//! A record begins when the head is enabled and replaces the one before when pulses are on: a move or a guided check does not take
//! the last bore away.

use crate::gap::Gap;
use crate::head::state;
use crate::live::Sample;
use serde::Serialize;
use serde_json::Value;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Points kept; then every second one is dropped, and from then on taken half as often.
const POINTS: usize = 8192;
/// How long a record continues after the head was disabled or in a fault: a retrace ends in that time.
const AFTER: Duration = Duration::from_secs(3);

/// Time since the record began, s; number of the state; position, mm; gap voltage, its set point, V; feed, um/s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point(f64, u8, f64, Option<f64>, f64, Option<f64>);

/// What a head did in a bore.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Record {
    /// Node-ID.
    pub node: u8,
    /// Number of the record since the program started.
    pub run: u64,
    /// When it began, ms since 1970.
    pub unix_ms: u64,
    /// Surface of the work below home, mm, once it is known.
    pub surface_mm: Option<f64>,
    /// Deepest position of the electrode, mm.
    pub deepest_mm: Option<f64>,
    /// Depth requested of this program, mm.
    pub target_mm: Option<f64>,
    /// How it ended, as the page shows it; null before, and of a bore of another program.
    pub ended: Value,
    /// What it did.
    pub points: Vec<Point>,
    /// The last look at the gap that saw pulses, and when that was, ms since 1970.
    pub gap: Option<(u64, Gap)>,
}

/// Makes the record of a head.
#[derive(Default)]
pub struct Recorder {
    /// The last bore.
    pub last: Record,
    /// What happens since the head was enabled, until there are pulses.
    begun: Option<(Instant, Record)>,
    /// Since when the record is that of a bore in progress.
    on: Option<Instant>,
    /// When the head was neither disabled nor in a fault last.
    enabled: Option<Instant>,
    /// Depth that this program has requested of the hole in progress, mm.
    pub target_mm: Option<f64>,
    /// One of so many samples becomes a point.
    every: usize,
    passed: usize,
}

/// What a sample has done to the record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Taken {
    /// Nothing.
    Nothing,
    /// One more point.
    Point(Point),
    /// A new record.
    New,
}

impl Recorder {
    /// Takes a sample at this time.
    pub fn take(&mut self, sample: &Sample, now: Instant) -> Taken {
        let enabled = !matches!(sample.state_number, state::DISABLED | state::FAULT);
        if enabled {
            self.enabled = Some(now);
            if self.on.is_none() && self.begun.is_none() {
                let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
                let record = Record { node: sample.node, unix_ms: since.as_millis() as u64, ..Record::default() };
                self.begun = Some((now, record));
                (self.every, self.passed) = (1, 0);
            }
        } else if self.enabled.is_none_or(|last| now.duration_since(last) > AFTER) {
            (self.on, self.begun) = (None, None);
            return Taken::Nothing;
        }
        let pulses = state::LED.contains(&sample.state_number);
        let mut new = false;
        if pulses && let Some((began, record)) = self.begun.take() {
            let run = self.last.run + 1;
            self.last = Record { run, target_mm: self.target_mm, ..record };
            self.on = Some(began);
            new = true;
        }
        let (began, record) = match (&mut self.begun, self.on) {
            (Some((began, record)), _) => (*began, record),
            (None, Some(began)) => (began, &mut self.last),
            (None, None) => return Taken::Nothing,
        };
        if pulses {
            record.surface_mm = sample.surface_mm;
            record.deepest_mm = Some(record.deepest_mm.unwrap_or(f64::MIN).max(sample.deepest()));
        }
        self.passed += 1;
        if self.passed < self.every {
            return if new { Taken::New } else { Taken::Nothing };
        }
        self.passed = 0;
        let seconds = (now.duration_since(began).as_secs_f64() * 100.0).round() / 100.0;
        let Sample { state_number, position_mm, gap_v, setpoint_v, feed_um_s, .. } = *sample;
        let point = Point(seconds, state_number, position_mm, gap_v, setpoint_v, feed_um_s);
        if record.points.len() == POINTS {
            let mut odd = false;
            record.points.retain(|_| {
                odd = !odd;
                odd
            });
            self.every *= 2;
        }
        record.points.push(point);
        match (new, self.begun.is_some()) {
            (true, _) => Taken::New,
            (false, true) => Taken::Nothing,
            (false, false) => Taken::Point(point),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(state_number: u8, position_mm: f64) -> Sample {
        Sample {
            at_ms: 0,
            node: 1,
            state: String::new(),
            state_number,
            reason: "",
            fault: String::new(),
            fault_number: 0,
            homed: true,
            position_mm,
            deepest_mm: position_mm,
            surface_mm: Some(2.0),
            gap_v: None,
            setpoint_v: 65.0,
            open_v: 0.0,
            feed_um_s: None,
            shorts: 0,
        }
    }

    /// Ready, touching, seeking, eroding, lifting, in that order; one a second from `at` on.
    fn bore(recorder: &mut Recorder, at: Instant) -> Vec<Taken> {
        let states = [(2, 0.0), (15, 1.9), (3, 1.95), (4, 2.5), (14, 0.0), (0, 0.0)];
        let take = |(second, (number, mm)): (u64, (u8, f64))| {
            recorder.take(&sample(number, mm), at + Duration::from_secs(second))
        };
        (0..).zip(states).map(take).collect()
    }

    #[test]
    fn a_bore_is_recorded_from_the_enabling_on_and_kept_until_the_next_one_has_pulses() {
        let (mut recorder, at) = (Recorder { target_mm: Some(0.5), ..Recorder::default() }, Instant::now());
        let taken = bore(&mut recorder, at);
        assert_eq!(taken[..3], [Taken::Nothing, Taken::Nothing, Taken::New]);
        assert!(taken[3..].iter().all(|taken| matches!(taken, Taken::Point(_))), "{taken:?}");
        let kept = recorder.last.clone();
        assert_eq!((kept.run, kept.points.len(), kept.points[0].1), (1, 6, 2), "from the enabling on: {kept:?}");
        // The lift is not of the hole.
        assert_eq!((kept.surface_mm, kept.deepest_mm, kept.target_mm), (Some(2.0), Some(2.5), Some(0.5)));
        let later = at + Duration::from_secs(60);
        for (second, number) in [(0, 0), (1, 9), (2, 9), (3, 0), (30, 0)] {
            assert_eq!(recorder.take(&sample(number, 1.0), later + Duration::from_secs(second)), Taken::Nothing);
        }
        assert_eq!(recorder.last, kept, "a move takes nothing away");
        bore(&mut recorder, later + Duration::from_secs(60));
        assert_eq!((recorder.last.run, recorder.last.points.len()), (2, 6));
    }

    #[test]
    fn a_bore_of_a_day_has_as_many_points_as_fit_from_its_first_to_its_last() {
        let (mut recorder, at) = (Recorder::default(), Instant::now());
        let day = 5 * 86_400;
        for fifth in 0..day {
            recorder.take(&sample(4, 2.0), at + Duration::from_millis(200 * fifth));
        }
        let points = &recorder.last.points;
        assert!((POINTS / 2..=POINTS).contains(&points.len()), "{}", points.len());
        let (first, last) = (points.first().unwrap().0, points.last().unwrap().0);
        assert!(first < 60.0 && last > 86_300.0, "{first} to {last} s");
        assert!(points.is_sorted_by(|a, b| a.0 < b.0));
    }
}

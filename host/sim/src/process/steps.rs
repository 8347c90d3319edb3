//! Step and direction outputs of a host: pulses with their times, and what a timer counts of them.

use edm_hal_shim::steps::{Counted, STAMPS};
use std::collections::VecDeque;

/// Length of a servo tick, us.
const TICK_US: f64 = 50.0;
/// From a change of the direction to the next step, us (assumed: what drives ask for).
const SETUP_US: f64 = 5.0;

/// An output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// Steps.
    Step,
    /// Their direction.
    Direction,
}

/// An edge at the head's pin, behind an input that inverts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepEdge {
    /// From the beginning of the tick, us.
    pub us: f64,
    /// Which line.
    pub line: Line,
    /// Level of the pin after it.
    pub high: bool,
}

/// What a host sends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Move {
    /// So many steps, positive toward the work, so many a second.
    Steps(i64, f64),
    /// Nothing for so many us.
    Pause(f64),
}

/// A host with step and direction outputs.
#[derive(Clone, Debug)]
pub struct Steps {
    moves: VecDeque<Move>,
    /// The direction changes while a step is active, at half of its time: a wiring or a program that does so.
    pub turns_within: bool,
    /// The head takes steps, which a host that waits looks at before each.
    pub ready: bool,
    /// See `ready`.
    pub waits: bool,
    active: bool,
    toward: bool,
    /// Until the next edge, and from the end of the step under way to the next.
    wait_us: f64,
    rest_us: f64,
    edges: Vec<StepEdge>,
    half: u32,
    stamps: u32,
    ring: [u32; STAMPS],
    sent: i64,
}

impl Default for Steps {
    /// At rest: no current in either input.
    fn default() -> Steps {
        Steps {
            moves: VecDeque::new(),
            turns_within: false,
            ready: false,
            waits: false,
            active: false,
            toward: false,
            wait_us: 0.0,
            rest_us: 0.0,
            edges: Vec::new(),
            half: 1,
            stamps: 0,
            ring: [0; STAMPS],
            sent: 0,
        }
    }
}

impl Steps {
    /// Sends this after all that is still to be sent.
    pub fn send(&mut self, next: Move) {
        self.moves.push_back(next);
    }

    /// Steps sent so far, those toward the work less the others.
    pub fn sent(&self) -> i64 {
        self.sent
    }

    /// Whether all is sent.
    pub fn is_done(&self) -> bool {
        self.moves.is_empty() && !self.active
    }

    /// Edges of the last tick, in order of time.
    pub fn edges(&self) -> &[StepEdge] {
        &self.edges
    }

    /// What a timer has counted, and its newest stamps by number.
    pub fn counted(&self) -> (Counted, &[u32; STAMPS]) {
        let stamps = self.stamps % STAMPS as u32;
        (Counted { stamps, half: self.half, high: !self.toward }, &self.ring)
    }

    /// A servo tick, in which steps come at `hz` where nothing else is sent.
    #[inline]
    pub fn advance(&mut self, hz: f64) {
        self.edges.clear();
        if hz != 0.0 || self.wait_us != 0.0 || !self.is_done() {
            self.send_for_a_tick(hz);
        }
    }

    fn send_for_a_tick(&mut self, hz: f64) {
        let mut now = 0.0;
        while self.wait_us <= TICK_US - now {
            now += std::mem::take(&mut self.wait_us);
            if self.active {
                self.active = false;
                self.edge(now, Line::Step, true);
                self.wait_us = self.rest_us;
                continue;
            }
            if self.waits && !self.ready {
                return;
            }
            let (toward, period_us) = match self.moves.front_mut() {
                Some(Move::Steps(0, _)) => {
                    self.moves.pop_front();
                    continue;
                }
                Some(Move::Steps(steps, hz)) => (*steps > 0, 1e6 / hz.abs()),
                Some(Move::Pause(us)) => {
                    self.wait_us = *us;
                    self.moves.pop_front();
                    continue;
                }
                None if hz != 0.0 => (hz > 0.0, 1e6 / hz.abs()),
                None => return,
            };
            if toward != self.toward && !self.turns_within {
                self.turn(now, toward);
                self.wait_us = SETUP_US;
                continue;
            }
            if let Some(Move::Steps(steps, _)) = self.moves.front_mut() {
                *steps -= steps.signum();
            }
            // One that begins as the line says counts so, wherever it was to go.
            self.sent += if self.toward { 1 } else { -1 };
            self.active = true;
            self.edge(now, Line::Step, false);
            if toward != self.toward {
                self.turn(now + period_us / 4.0, toward);
            }
            (self.wait_us, self.rest_us) = (period_us / 2.0, period_us / 2.0);
        }
        self.wait_us -= TICK_US - now;
    }

    fn turn(&mut self, us: f64, toward: bool) {
        self.toward = toward;
        if let Some(stamp) = self.ring.get_mut(self.stamps as usize % STAMPS) {
            *stamp = self.half;
        }
        self.stamps = self.stamps.wrapping_add(1);
        self.edges.push(StepEdge { us, line: Line::Direction, high: !toward });
    }

    fn edge(&mut self, us: f64, line: Line, high: bool) {
        self.half = self.half.wrapping_add(1);
        self.edges.push(StepEdge { us, line, high });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_come_at_their_rate_in_whole_pulses_and_end_with_their_number() {
        let mut steps = Steps::default();
        steps.send(Move::Steps(1000, 100_000.0));
        steps.send(Move::Steps(-300, 500_000.0));
        let mut ticks = 0;
        while !steps.is_done() {
            steps.advance(0.0);
            assert!(steps.edges().is_sorted_by_key(|edge| edge.us) && steps.edges().iter().all(|edge| edge.us <= 50.0));
            ticks += 1;
        }
        // 10 ms and 0.6 ms, and two changes of direction.
        assert_eq!((steps.sent(), ticks), (700, 213));
        let (counted, ring) = steps.counted();
        assert_eq!((counted, ring[0], ring[1]), (Counted { stamps: 2, half: 2601, high: true }, 1, 2001));
    }

    #[test]
    fn a_direction_that_changes_within_a_step_belongs_to_the_next() {
        let mut steps = Steps { turns_within: true, ..Steps::default() };
        steps.send(Move::Steps(2, 1000.0));
        (0..100).for_each(|_| steps.advance(0.0));
        assert_eq!((steps.sent(), steps.counted().1[0]), (0, 2));
    }

    #[test]
    fn a_rate_without_a_number_goes_on() {
        let mut steps = Steps::default();
        (0..20_000).for_each(|_| steps.advance(-1234.5));
        assert!((steps.sent() + 1234).abs() <= 1, "{}", steps.sent());
    }
}

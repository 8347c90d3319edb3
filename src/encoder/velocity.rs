//! Velocity from counts and time stamps together, every tick.
//!
//! Terms: a *line* is the place on the scale between two counts; an edge is the crossing of a line. The velocity is the
//! distance between the lines of two edges by the time between them, so it needs no edge in every tick and no filter. Both
//! edges are real ones; a tick border, which means nothing to the axis, is in neither.
//!
//! - *Which two edges.* Of each tick that brings edges the newest is kept. The velocity is taken from the newest of all to
//!   the one kept four such ticks before, unless that lies more than [`WINDOW_TICKS`] back; then to the one just before.
//!   From 20 kcount/s this averages over four ticks (100 us of delay), from 10 to 20 kcount/s over four edges: one line of
//!   the encoder, whose unequal spacing cancels. Slower, it is the newest spacing, with no delay but that of the edge
//!   itself. A counter that times by the tick may be off by one count of those that four ticks bring.
//! - *No new edge*: the next line has not been reached, so |v| is less than one count by the time since the newest edge.
//!   The value is held down to that, and is exactly 0 after [`STANDSTILL`]. The newest edge is then given that age, and again
//!   every 8 ms, so the clock may wrap as often as it likes. \[R\] section 6.6.2: a period measurement waits for the next edge
//!   and stays high when the axis has stopped.
//! - *A reversal* crosses the same line twice: distance 0, velocity 0. An axis that trembles over one line has none,
//!   however short the time between the edges.
//!
//! Largest error at constant velocity, once two edges are there. `e` is how far an edge may be from its place on the scale,
//! in counts: 0.11 for channels 20 degrees out of quadrature, where spacings are 0.78 and 1.22 counts.
//!
//! | velocity | edges timed | edges timed, `e` = 0.11 | timed by the tick |
//! | --- | --- | --- | --- |
//! | standstill | 1 count by the time since the newest edge, 0 after 2 s | the same | the same |
//! | 1 count/s | 0.0001 % | +28 %, -18 %: 1 / (1 - 2e), 1 / (1 + 2e) | 0.005 % |
//! | 1 Mcount/s | 0.01 % | 0.12 %: 2e in 200 counts, and the clock | 0.63 %: 1 + 2e in 200 counts |
//!
//! An interrupt that is served late by varying times adds that variation by 200 us at speed: 0.5 % for 1 us. Slower than one
//! count in two seconds reads as up to 0.5 count/s after each edge, never as more.

use crate::units::{CountsPerSecond, Seconds, TICK_HZ};
use edm_hal_shim::encoder::RawCount;

/// Longest time without an edge that is not yet a standstill: 1 count/s is still a velocity.
pub const STANDSTILL: Seconds = Seconds(2.0);

/// Oldest edge that a velocity still counts from when there is a newer one, ticks. Twice the four ticks of delay at speed, so
/// that from 10 kcount/s on a whole line of the encoder is averaged.
pub const WINDOW_TICKS: u32 = 8;

/// See [`Velocity::holds`]: nothing is that young.
const UNKNOWN: u32 = 0;

/// An edge: which line was crossed, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Edge {
    line: u32,
    time: u32,
}

impl Edge {
    /// The newest edge of a reading. A line carries the number of the count on its far side, seen from above.
    fn newest(reading: RawCount) -> Self {
        Edge { line: reading.count.wrapping_add(u32::from(!reading.toward_work)), time: reading.last_edge }
    }

    /// Time since an edge before, clock ticks.
    fn since(self, earlier: Edge) -> u32 {
        self.time.wrapping_sub(earlier.time)
    }
}

/// Velocity of one axis.
#[derive(Clone, Debug)]
pub struct Velocity {
    hz: f32,
    window: u32,
    standstill: u32,
    last_edge: u32,
    /// Time of the newest edge kept, and the age up to which the value needs no look: up to it |v| is less than one count by the
    /// time since the edge. A division, which a tick that brings the next edge spares: [`UNKNOWN`] until a tick has none.
    time: u32,
    holds: u32,
    /// The edges kept, a ring.
    edges: [Edge; 4],
    newest: usize,
    value: f32,
}

impl Velocity {
    /// Starts at standstill. `clock_hz` is the rate of the clock that times edges and readings, [`TICK_HZ`] to 500 MHz.
    pub fn new(first: RawCount, clock_hz: u32) -> Self {
        let mut velocity = Velocity {
            hz: clock_hz as f32,
            window: clock_hz / TICK_HZ * WINDOW_TICKS,
            standstill: (clock_hz as f32 * STANDSTILL.0) as u32,
            last_edge: first.last_edge,
            time: 0,
            holds: 0,
            edges: [Edge::newest(first); 4],
            newest: 0,
            value: 0.0,
        };
        velocity.stand(first.now);
        velocity
    }

    /// Whether a reading brings nothing new: no edge, and none is missing yet. [`Velocity::tick`] may then be left out.
    #[inline]
    pub fn holds(&self, reading: &RawCount) -> bool {
        // Counted edges have different times.
        self.is_newest(reading.last_edge) && reading.now.wrapping_sub(self.time) < self.holds
    }

    /// Takes this tick's reading and returns the velocity. Ticks may be late or left out; less than 2^31 clock ticks and
    /// counts must lie between two of them.
    #[inline]
    pub fn tick(&mut self, reading: RawCount) -> CountsPerSecond {
        if !self.is_newest(reading.last_edge) {
            self.last_edge = reading.last_edge;
            self.edge(Edge::newest(reading));
            return CountsPerSecond(self.value);
        }
        self.wait(reading.now)
    }

    /// Whether the newest edge of a reading is the one seen last.
    #[inline]
    pub fn is_newest(&self, last_edge: u32) -> bool {
        last_edge == self.last_edge
    }

    /// As [`Velocity::tick`], for a reading at clock time `now` that brings no edge.
    #[inline]
    pub fn wait(&mut self, now: u32) -> CountsPerSecond {
        let age = now.wrapping_sub(self.time);
        if age >= self.holds {
            if self.holds == UNKNOWN {
                self.holds = ((self.hz / self.value.abs()) as u32).max(1).min(self.standstill);
                if age < self.holds {
                    return CountsPerSecond(self.value);
                }
            }
            if age >= self.standstill {
                self.stand(now);
            } else {
                self.value = (self.hz / age as f32).copysign(self.value);
            }
        }
        CountsPerSecond(self.value)
    }

    #[inline]
    fn edge(&mut self, edge: Edge) {
        self.value = self.measure(edge);
        self.holds = UNKNOWN;
    }

    /// Velocity at a new edge, counts/s.
    #[inline]
    fn measure(&mut self, edge: Edge) -> f32 {
        let before = self.edges[self.newest % 4];
        self.newest = (self.newest + 1) % 4;
        let oldest = core::mem::replace(&mut self.edges[self.newest], edge);
        self.time = edge.time;
        let reference = if edge.since(oldest) <= self.window { oldest } else { before };
        let lines = edge.line.wrapping_sub(reference.line) as i32;
        lines as f32 * self.hz / edge.since(reference).max(1) as f32
    }

    /// At standstill the newest edge is as old as that takes, and the only one. A little later it is made so again.
    #[cold]
    fn stand(&mut self, now: u32) {
        let line = self.edges[self.newest % 4].line;
        self.time = now.wrapping_sub(self.standstill);
        self.edges = [Edge { line, time: self.time }; 4];
        self.holds = self.standstill + self.standstill / 256;
        self.value = 0.0;
    }
}

#[cfg(test)]
mod tests;

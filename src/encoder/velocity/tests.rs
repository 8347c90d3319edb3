//! Velocity of axes that are known: both sides of every bound in the module's table.

use super::*;

const HZ: u32 = 168_000_000;
const TICK: u64 = (HZ / TICK_HZ) as u64;
const TRUE_SPACING: [f64; 4] = [0.0; 4];
/// B late by 20 degrees of 360, that is by 0.22 of a count.
const B_LATE: [f64; 4] = [-0.11, 0.11, -0.11, 0.11];

#[derive(Clone, Copy)]
enum Stamps {
    Edge,
    Tick,
}

/// An axis at constant velocity, read every tick by a counter.
struct Axis {
    spacing: f64,
    places: [f64; 4],
    stamps: Stamps,
    forward: bool,
    edges: u64,
    seen: u64,
    last_edge: u64,
}

impl Axis {
    fn new(counts_per_second: f64, places: [f64; 4], stamps: Stamps) -> Self {
        let spacing = f64::from(HZ) / counts_per_second.abs();
        Axis { spacing, places, stamps, forward: counts_per_second > 0.0, edges: 0, seen: 0, last_edge: 0 }
    }

    /// Clock time of edge number `edge`, from 1.
    fn time(&self, edge: u64) -> u64 {
        ((edge as f64 + self.places[(edge % 4) as usize]) * self.spacing) as u64
    }

    fn read(&mut self, now: u64) -> RawCount {
        while self.time(self.edges + 1) <= now {
            self.edges += 1;
        }
        if self.edges != self.seen {
            self.seen = self.edges;
            self.last_edge = match self.stamps {
                Stamps::Edge => self.time(self.edges),
                Stamps::Tick => now,
            };
        }
        let edges = self.edges as u32;
        RawCount {
            count: if self.forward { edges } else { edges.wrapping_neg() },
            last_edge: self.last_edge as u32,
            toward_work: self.forward,
            now: now as u32,
        }
    }
}

/// Smallest and largest relative error from the sixth edge on.
fn error(counts_per_second: f64, places: [f64; 4], stamps: Stamps, seconds: f64) -> (f64, f64) {
    let mut axis = Axis::new(counts_per_second, places, stamps);
    let mut velocity = Velocity::new(axis.read(0), HZ);
    let (mut low, mut high) = (0.0f64, 0.0f64);
    for tick in 1..(seconds * f64::from(TICK_HZ)) as u64 {
        // An odd offset: ticks and edges do not fall together.
        let CountsPerSecond(value) = velocity.tick(axis.read(tick * TICK + 1234));
        if axis.edges >= 6 && tick > 10 {
            let error = f64::from(value) / counts_per_second - 1.0;
            (low, high) = (low.min(error), high.max(error));
        }
    }
    (low, high)
}

fn largest((low, high): (f64, f64)) -> f64 {
    high.max(-low)
}

#[test]
fn at_1_count_per_s_it_is_right_over_several_wraps_of_the_clock() {
    for v in [1.0, -1.0] {
        assert!(largest(error(v, TRUE_SPACING, Stamps::Edge, 60.0)) <= 1e-6);
        let by_tick = largest(error(v * 1.000_013, TRUE_SPACING, Stamps::Tick, 60.0));
        assert!((0.3 * 5e-5..=5e-5).contains(&by_tick), "{by_tick}");
    }
}

#[test]
fn at_1_count_per_s_a_phase_error_shows_as_the_spacing_of_the_newest_two_edges() {
    for v in [1.0, -1.0] {
        let (low, high) = error(v, B_LATE, Stamps::Edge, 20.0);
        assert!((0.275..=0.283).contains(&high), "{high}");
        assert!((-0.181..=-0.178).contains(&low), "{low}");
    }
}

#[test]
fn at_1_mcount_per_s_it_is_right_with_timed_edges_with_phase_error_and_with_a_timer() {
    for v in [1e6, -1e6, 0.997e6, -1.0037e6] {
        assert!(largest(error(v, TRUE_SPACING, Stamps::Edge, 1.0)) <= 1e-4);
        assert!(largest(error(v, B_LATE, Stamps::Edge, 1.0)) <= 0.0012);
        assert!(largest(error(v, B_LATE, Stamps::Tick, 1.0)) <= 0.0063);
    }
    // The bounds are not idle: an odd number of edges in the window, and a count that falls on a tick border.
    assert!(largest(error(0.997e6, B_LATE, Stamps::Edge, 1.0)) >= 0.0008);
    assert!(largest(error(0.997e6, TRUE_SPACING, Stamps::Tick, 1.0)) >= 0.002);
}

#[test]
fn between_the_rates_the_error_is_what_two_edges_allow() {
    let mut v = 2.0;
    while v < 5e6 {
        // Four ticks or four edges, or one edge.
        let spacings = if v < 10_000.0 { 1.0 } else { (v * 4.0 / f64::from(TICK_HZ)).floor().max(4.0) };
        let seconds = (20.0 / v).max(0.05);
        let exact = largest(error(v, TRUE_SPACING, Stamps::Edge, seconds));
        assert!(exact <= 2e-4, "{v}: {exact}");
        let (low, high) = error(v, B_LATE, Stamps::Edge, seconds);
        let early = 0.22 / spacings;
        // A tick without an edge holds the value down to the spacing in progress.
        let late = if v < 1.22 * f64::from(TICK_HZ) { 0.22 } else { early };
        assert!(high <= early / (1.0 - early) + 2e-4 && low >= -late / (1.0 + late) - 2e-4, "{v}: {low} {high}");
        v *= 1.37;
    }
}

#[test]
fn from_10_kcount_per_s_on_the_unequal_spacing_of_an_encoder_line_cancels() {
    let (_, high) = error(9_900.0, B_LATE, Stamps::Edge, 1.0);
    assert!(high > 0.2, "{high}");
    let (_, high) = error(10_100.0, B_LATE, Stamps::Edge, 1.0);
    assert!(high < 1e-4, "{high}");
}

#[test]
fn after_a_sudden_stop_it_is_at_most_one_count_by_the_time_since_and_exactly_zero_after_two_seconds() {
    for v in [1e6, -1e6] {
        let mut axis = Axis::new(v, TRUE_SPACING, Stamps::Edge);
        let mut velocity = Velocity::new(axis.read(0), HZ);
        for tick in 1..100 {
            velocity.tick(axis.read(tick * TICK));
        }
        let stopped = axis.read(99 * TICK);
        for tick in 100.. {
            let now = (tick * TICK) as u32;
            let age = now.wrapping_sub(stopped.last_edge);
            let value = velocity.tick(RawCount { now, ..stopped }).0 * v.signum() as f32;
            if age >= 2 * HZ {
                assert_eq!(value, 0.0);
                break;
            }
            let limit = HZ as f32 / age as f32;
            assert!(value > 0.99 * limit && value <= limit, "{value} after {age} clock ticks");
        }
    }
}

#[test]
fn hours_of_standstill_never_look_like_motion_and_neither_does_the_edge_that_ends_them() {
    // Every millisecond for three hours: the clock wraps 422 times.
    let rest = RawCount { count: 77, toward_work: true, ..RawCount::default() };
    let mut velocity = Velocity::new(rest, HZ);
    let mut now = 0u32;
    for ms in 0..3 * 3_600_000u32 {
        now = ms.wrapping_mul(HZ / 1000);
        assert_eq!(velocity.tick(RawCount { now, ..rest }).0, 0.0);
    }
    let edge = RawCount { count: 78, last_edge: now.wrapping_add(100), toward_work: true, now: now.wrapping_add(8400) };
    let value = velocity.tick(edge).0;
    assert!(value > 0.49 && value <= 0.5, "{value}");
}

#[test]
fn an_edge_that_ends_a_standstill_of_any_length_is_slow() {
    // Around one and two wraps of the clock, where the plain difference of times is near zero.
    for wraps in [0, 1u64 << 32, 2 << 32] {
        for around in (0..4000).map(|step| step * 21_000) {
            let ends = wraps + u64::from(2 * HZ) + around;
            let rest = RawCount { toward_work: true, ..RawCount::default() };
            let mut velocity = Velocity::new(rest, HZ);
            let mut now = 0;
            while now + u64::from(HZ) < ends {
                now += u64::from(HZ);
                velocity.tick(RawCount { now: now as u32, ..rest });
            }
            let edge = RawCount { count: 1, last_edge: ends as u32, toward_work: true, now: (ends + 5) as u32 };
            let value = velocity.tick(edge).0;
            assert!(value > 0.0 && value <= 0.5, "{value} after {ends}");
        }
    }
}

#[test]
fn trembling_over_one_line_is_no_velocity() {
    // From 1 to 7 edges a tick, as close as 1 us, in every position relative to the tick border.
    let mut reading = RawCount { count: 1000, last_edge: 0, toward_work: true, now: 0 };
    let mut velocity = Velocity::new(reading, HZ);
    let mut state = 0x1234_5678_u32;
    for _ in 0..1_000_000 {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let edges = (state >> 16) % 8;
        for _ in 0..edges {
            reading.toward_work = !reading.toward_work;
            reading.count = if reading.toward_work { 1000 } else { 999 };
        }
        reading.now = reading.now.wrapping_add(TICK as u32);
        if edges > 0 {
            reading.last_edge = reading.now.wrapping_sub((state >> 8) % 2 * (TICK as u32 - 168));
        }
        assert_eq!(velocity.tick(reading).0, 0.0);
    }
}

#[test]
fn an_axis_that_comes_to_rest_trembling_has_no_velocity_four_ticks_later() {
    let mut axis = Axis::new(100_000.0, TRUE_SPACING, Stamps::Edge);
    let mut velocity = Velocity::new(axis.read(0), HZ);
    for tick in 1..100 {
        velocity.tick(axis.read(tick * TICK));
    }
    // Back over the newest line and forth again in each tick: the count is always the same.
    let mut reading = axis.read(99 * TICK);
    let mut value = 0.0;
    for _ in 0..5 {
        reading.now = reading.now.wrapping_add(TICK as u32);
        reading.last_edge = reading.now.wrapping_sub(10);
        value = velocity.tick(reading).0;
    }
    assert_eq!(value, 0.0);
}

#[test]
fn a_stroke_there_and_back_has_no_velocity_beyond_its_own() {
    // 20 kcount/s, 50 counts there and 50 back: the line at the turn is crossed twice.
    let spacing = u64::from(HZ) / 20_000;
    let mut velocity = Velocity::new(RawCount { toward_work: true, ..RawCount::default() }, HZ);
    let mut largest = 0.0f32;
    for tick in 1..10_000u64 {
        let edge = (tick * TICK + 4000) / spacing;
        let (turn, along) = (edge / 50, (edge % 50) as u32);
        let toward_work = turn % 2 == 0;
        let count = if toward_work { along + 1 } else { 49 - along };
        let now = (tick * TICK + 4000) as u32;
        let value = velocity.tick(RawCount { count, last_edge: (edge * spacing) as u32, toward_work, now }).0;
        assert!(value.abs() <= 20_000.1, "{value}");
        largest = largest.max(value.abs());
    }
    assert!(largest > 19_999.0);
}

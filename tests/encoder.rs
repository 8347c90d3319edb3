//! The encoder as a machine uses it: scale, lines, both counters, marks, and what happens when edges are lost.
//!
//! The number of random transitions is ten million here; the full proof of a thousand million is
//! `EDM_ENCODER_TRANSITIONS=1000000000 cargo test --test encoder random_transitions`.

use core::cell::Cell;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::{EdgeCounter, EncoderTimer, Levels, RawCount};
use edm_servo_head::encoder::{
    DecoderCount, EncoderFault, MarkCheck, MarkSpacing, Plausibility, PlausibilityLimits, Position, Quadrature, Shared,
    Snapshot, TimerCount, Velocity, WrongDistance,
};
use proptest::prelude::*;

/// Seeded xorshift: small, fast, and good enough to pick transitions.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32
    }
}

/// Levels of A and B at a whole count: B is a square wave of four counts, A the same wave one count ahead.
fn lines(position: i64) -> Levels {
    Levels { a: (position + 1) & 2 != 0, b: position & 2 != 0, index: false }
}

/// Runs random transitions through a decoder and checks it against the true position: legal ones must all be counted,
/// illegal ones must all be reported and must not move the count.
fn random_transitions(transitions: u64, seed: u64) {
    let mut random = Random(seed);
    let mut decoder = Quadrature::new(lines(0), 0);
    let mut position = Position::new(decoder.snapshot(0).raw);
    let (mut place, mut counted, mut illegal) = (0i64, 0i64, 0u64);
    for transition in 0..transitions {
        let bits = random.next();
        let step = if bits & 1 == 0 { 1 } else { -1 };
        if bits & 0b1110 == 0 {
            place += 2 * step;
            illegal += 1;
        } else {
            place += step;
            counted += step;
        }
        decoder.edge(lines(place), || transition as u32);
        let snapshot = decoder.snapshot(transition as u32);
        assert_eq!(snapshot.raw.count, counted as u32, "count after transition {transition}, seed {seed}");
        assert_eq!(snapshot.illegal, illegal as u32, "illegal ones after transition {transition}, seed {seed}");
        position.update(snapshot.raw);
    }
    assert_eq!(position.counts(), counted);
    assert!(illegal > transitions / 9 && illegal < transitions / 7, "one in eight was meant to be illegal");
}

#[test]
fn random_transitions_end_on_the_exact_count_with_every_illegal_one_counted() {
    let transitions = match std::env::var("EDM_ENCODER_TRANSITIONS") {
        Ok(number) => number.parse().expect("EDM_ENCODER_TRANSITIONS is a whole number"),
        Err(_) => 10_000_000,
    };
    let started = std::time::Instant::now();
    random_transitions(transitions, 0x0EDC_0DE5);
    println!("{transitions} transitions in {:.1} s", started.elapsed().as_secs_f64());
}

/// A glass scale with index marks. Places are in eighths of a count, so that a mark can begin anywhere within a count.
#[derive(Clone, Copy)]
struct Scale {
    mark_begins: i64,
    mark_width: i64,
    mark_spacing: i64,
}

const EIGHTHS: i64 = 8;

impl Scale {
    /// A mark every 10 000 counts \[L\], a count wide as a gated index output gives it; one of them at 40.
    const PLAIN: Scale = Scale { mark_begins: 40 * EIGHTHS, mark_width: EIGHTHS, mark_spacing: 10_000 * EIGHTHS };

    fn levels(self, place: i64) -> Levels {
        let index = (place - self.mark_begins).rem_euclid(self.mark_spacing) < self.mark_width;
        Levels { index, ..lines(place.div_euclid(EIGHTHS)) }
    }
}

/// An axis with both counters on its lines and a clock.
struct Machine<'a> {
    scale: Scale,
    place: i64,
    clock: Cell<u32>,
    register: Cell<u32>,
    decoder: Quadrature<&'a Shared>,
    shared: &'a Shared,
}

#[derive(Clone, Copy)]
struct Time<'a>(&'a Cell<u32>);

impl Clock for Time<'_> {
    const HZ: u32 = 168_000_000;
    fn now(&self) -> u32 {
        self.0.get()
    }
}

struct Timer16<'a>(&'a Cell<u32>);

impl EncoderTimer for Timer16<'_> {
    const BITS: u32 = 16;
    fn counter(&self) -> u32 {
        self.0.get() & 0xFFFF
    }
}

impl<'a> Machine<'a> {
    fn new(shared: &'a Shared, scale: Scale) -> Self {
        let decoder = Quadrature::on(shared, scale.levels(0), 0);
        Machine { scale, place: 0, clock: Cell::new(0), register: Cell::new(0), decoder, shared }
    }

    fn counts(&self) -> i64 {
        self.place.div_euclid(EIGHTHS)
    }

    /// Moves by eighths of a count, each in `ticks` clock ticks. `served` says of each edge whether the edge interrupt gets
    /// to see it; a timer in encoder mode sees them all.
    fn travel(&mut self, eighths: i64, ticks: u32, mut served: impl FnMut() -> bool) {
        for _ in 0..eighths.abs() {
            let before = self.scale.levels(self.place);
            self.place += eighths.signum();
            self.clock.set(self.clock.get().wrapping_add(ticks));
            self.register.set(self.counts() as u32);
            let levels = self.scale.levels(self.place);
            if levels != before && served() {
                self.decoder.edge(levels, || self.clock.get());
            }
        }
    }

    /// Moves to the middle of a count.
    fn travel_to(&mut self, count: i64) {
        self.travel(count * EIGHTHS + EIGHTHS / 2 - self.place, 10, || true);
    }

    fn snapshot(&self) -> Snapshot {
        DecoderCount::new(self.shared, Time(&self.clock)).snapshot()
    }

    fn raw(&self) -> RawCount {
        self.snapshot().raw
    }
}

#[test]
fn no_count_is_lost_on_reversal() {
    // [R]: four counts a trip. A thousand trips over random parts of the stroke, turning anywhere within a count.
    let shared = Shared::new();
    let mut machine = Machine::new(&shared, Scale::PLAIN);
    let mut position = Position::new(machine.raw());
    let mut random = Random(7);
    for _ in 0..1000 {
        let target = (random.next() % 16_000) as i64 - 8000;
        machine.travel(target - machine.place, 50, || true);
        assert_eq!(position.update(machine.raw()), machine.counts());
        for _ in 0..100 {
            let tremble = (random.next() % 64) as i64 - 32;
            machine.travel(tremble, 50, || true);
            machine.travel(-tremble, 50, || true);
        }
        assert_eq!(position.update(machine.raw()), machine.counts());
    }
    machine.travel_to(0);
    assert_eq!((position.update(machine.raw()), machine.snapshot().illegal), (0, 0));
}

#[test]
fn a_step_back_from_zero_is_a_step_back_for_both_counters() {
    // [R]: below zero the count became a huge positive one, and the loop drove the actuator to its stop.
    let shared = Shared::new();
    let mut machine = Machine::new(&shared, Scale::PLAIN);
    let (register, clock) = (Cell::new(0), Cell::new(0));
    let mut timer = TimerCount::new(Timer16(&register), Time(&clock));
    let mut by_edges = Position::new(machine.raw());
    let mut by_timer = Position::new(timer.read());
    for target in [-1, 0, -1, -2, 3, -70_000, -35_000, 70_000, 0] {
        // The 16-bit timer is read at least every half turn.
        while machine.counts() != target {
            let step = (target - machine.counts()).clamp(-30_000, 30_000);
            machine.travel_to(machine.counts() + step);
            register.set(machine.register.get());
            by_timer.update(timer.read());
        }
        assert_eq!((by_edges.update(machine.raw()), by_timer.counts()), (target, target));
    }
}

#[test]
fn velocity_is_not_stuck_at_standstill_and_homing_does_not_kick_it() {
    // [R]: the frequency measured last stayed when the axis had stopped.
    let shared = Shared::new();
    let mut machine = Machine::new(&shared, Scale::PLAIN);
    let mut velocity = Velocity::new(machine.raw(), Time::HZ);
    let mut position = Position::new(machine.raw());
    // 100 kcount/s: 210 clock ticks an eighth, 5 counts a servo tick.
    for tick in 0..2000 {
        machine.travel(5 * EIGHTHS, 210, || true);
        position.update(machine.raw());
        let value = velocity.tick(machine.raw()).0;
        assert!(tick < 5 || (99_999.0..100_001.0).contains(&value), "{value}");
        if tick == 1000 {
            position.set_position(0);
        }
    }
    assert_eq!(position.counts(), 999 * 5);
    for tick in 1..=40_000u16 {
        machine.clock.set(machine.clock.get().wrapping_add(8400));
        let value = velocity.tick(machine.raw()).0;
        let limit = 20_000.0 / f32::from(tick);
        assert!(value <= 1.000_001 * limit && (value > 0.0) == (tick < 40_000), "{value} after {tick} ticks");
    }
}

/// What supervision says 2 ms after `travel`, and the illegal transitions.
fn supervised(travel: impl FnOnce(&mut Machine)) -> (Result<(), EncoderFault>, u32) {
    let shared = Shared::new();
    let mut machine = Machine::new(&shared, Scale { mark_width: 0, ..Scale::PLAIN });
    let (register, clock) = (Cell::new(0), Cell::new(0));
    let mut timer = TimerCount::new(Timer16(&register), Time(&clock));
    let mut watch = Plausibility::new(PlausibilityLimits::default(), 0);
    assert_eq!(watch.look(machine.raw(), Some(timer.read()), 0), Ok(()));
    travel(&mut machine);
    register.set(machine.register.get());
    let mut result = Ok(());
    for _ in 0..40 {
        result = watch.look(machine.raw(), Some(timer.read()), machine.snapshot().illegal);
    }
    (result, machine.snapshot().illegal)
}

/// The interrupt misses `edges` in a row and serves all others.
fn losing(edges: u32) -> impl FnMut() -> bool {
    let mut number = 0;
    move || {
        number += 1;
        number > edges
    }
}

#[test]
fn lost_edges_are_noticed_whatever_their_number() {
    assert_eq!(supervised(|machine| machine.travel(990 * EIGHTHS, 100, losing(0))), (Ok(()), 0));
    // One lost edge makes a double transition, two make a step back, three leave the levels unchanged: the decoder itself
    // notices the first alone, the comparison with the timer all of them.
    for (lost, difference, illegal) in [(1, -2, 1), (2, -4, 0), (3, -4, 0), (4, -4, 0), (5, -6, 1)] {
        let result = supervised(|machine| machine.travel(990 * EIGHTHS, 100, losing(lost)));
        assert_eq!(result, (Err(EncoderFault::Disagreement { difference }), illegal), "{lost} lost");
    }
}

#[test]
fn noise_on_both_lines_is_reported_by_its_rate_and_does_not_move_the_count() {
    for (bursts, expected) in [(5, Ok(())), (6, Err(EncoderFault::IllegalTransitions { seen: 12 }))] {
        let result = supervised(|machine| {
            machine.travel_to(300);
            for _ in 0..bursts {
                // Both lines flip and come back: two illegal transitions.
                let levels = machine.scale.levels(machine.place);
                machine.decoder.edge(Levels { a: !levels.a, b: !levels.b, ..levels }, || machine.clock.get());
                machine.decoder.edge(levels, || machine.clock.get());
            }
            assert_eq!(machine.raw().count, 300);
        });
        assert_eq!(result, (expected, 2 * bursts));
    }
}

#[test]
fn marks_watch_the_count_over_a_long_scale_and_show_what_was_lost_between_them() {
    let shared = Shared::new();
    let mut machine = Machine::new(&shared, Scale::PLAIN);
    let mut check = MarkCheck::new(MarkSpacing::default(), 0);
    let mut position = Position::new(machine.raw());
    for target in [45_000, -25_000, 30_000, 15_000] {
        while machine.counts() != target {
            let step = (target - machine.counts()).clamp(-500, 500);
            machine.travel_to(machine.counts() + step);
            position.update(machine.raw());
            let mark = machine.snapshot().mark;
            assert_eq!(check.update(mark), Ok(()));
            assert!(mark.crossings == 0 || (position.at(mark.count) - 40) % 10_000 == 0);
        }
    }
    // Between the marks at 20 040 and 10 040 the interrupt loses four edges: no illegal transition, no trace in the count.
    machine.travel(-4 * EIGHTHS, 10, || false);
    machine.travel_to(10_000);
    assert_eq!(check.update(machine.snapshot().mark), Err(WrongDistance { expected: -10_000, measured: -9_996 }));
    assert_eq!((machine.snapshot().illegal, check.wrong()), (0, 1));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    /// Whatever the mark's width, wherever it begins within a count, and however the axis wanders and turns over it: it is
    /// always latched at the same count, and what was latched says between which marks the axis is.
    #[test]
    fn a_mark_has_one_position_however_it_is_crossed(
        begins in 0..EIGHTHS,
        width in 1..=5 * EIGHTHS,
        start in -20 * EIGHTHS..20 * EIGHTHS,
        walk in prop::collection::vec(-40i64..=40, 1..200),
    ) {
        const SPACING: i64 = 16;
        let scale = Scale { mark_begins: begins, mark_width: width, mark_spacing: SPACING * EIGHTHS };
        let count = |place: i64| place.div_euclid(EIGHTHS);
        let marks_below = |place: i64| (place - begins).div_euclid(SPACING * EIGHTHS);
        let mut decoder = Quadrature::new(scale.levels(start), 0);
        let mut check = MarkCheck::new(MarkSpacing { counts: SPACING as u32, tolerance: 0 }, 0);
        let mut place = start;
        let mut between = marks_below(start);
        let mut counted = false;
        for step in walk {
            for _ in 0..step.abs() {
                // What happens before the first count is not seen.
                if !counted {
                    between = marks_below(place);
                }
                counted |= count(place) != count(place + step.signum());
                place += step.signum();
                decoder.edge(scale.levels(place), || 0);
                let mark = decoder.snapshot(0).mark;
                prop_assert_eq!(check.update(mark), Ok(()));
                if mark.crossings > 0 {
                    let position = i64::from(mark.count as i32) + count(start);
                    prop_assert_eq!(position.rem_euclid(SPACING), 0, "not where a mark begins");
                    between = position.div_euclid(SPACING) - i64::from(!mark.toward_work);
                }
                // At the two counts that meet where a mark is crossed, the crossing may still be pending.
                if (1..SPACING - 1).contains(&count(place).rem_euclid(SPACING)) && counted {
                    prop_assert_eq!(between, marks_below(place));
                }
            }
        }
    }

    /// A gated index output switches with A or B. Whichever of the two edges the interrupt sees first, the mark is found
    /// within one count.
    #[test]
    fn an_index_edge_that_races_an_edge_of_a_or_b_is_within_one_count(
        start in -30i64..-5,
        walk in prop::collection::vec((-25i64..=25, any::<u32>()), 1..60),
    ) {
        let scale = Scale { mark_begins: 0, mark_width: EIGHTHS, mark_spacing: 16 * EIGHTHS };
        let mut place = start;
        let mut seen = scale.levels(place * EIGHTHS);
        let mut decoder = Quadrature::new(seen, 0);
        let mut check = MarkCheck::new(MarkSpacing { counts: 16, tolerance: 1 }, 0);
        for (step, races) in walk {
            for number in 0..step.abs() {
                place += step.signum();
                let levels = scale.levels(place * EIGHTHS);
                let index_first = races >> number & 1 == 1;
                let (a, b, index) = if index_first { (seen.a, seen.b, levels.index) } else { (levels.a, levels.b, seen.index) };
                decoder.edge(Levels { a, b, index }, || 0);
                decoder.edge(levels, || 0);
                seen = levels;
                let mark = decoder.snapshot(0).mark;
                let above = (i64::from(mark.count as i32) + start).rem_euclid(16);
                prop_assert_eq!(check.update(mark), Ok(()));
                prop_assert!(mark.crossings == 0 || above == 0 || above == 15, "latched {} counts above the mark", above);
            }
        }
    }

    /// However far the raw count jumps between readings, short of half its range, the position is the plain sum.
    #[test]
    fn position_is_the_sum_of_all_moves(
        start: u32,
        moves in prop::collection::vec(-0x7FFF_FFFFi32..=0x7FFF_FFFF, 0..200),
    ) {
        let mut reading = RawCount { count: start, ..RawCount::default() };
        let mut position = Position::new(reading);
        let mut expected = i64::from(start as i32);
        for step in moves {
            reading.count = reading.count.wrapping_add_signed(step);
            expected += i64::from(step);
            prop_assert_eq!(position.update(reading), expected);
        }
    }

    /// No sequence of readings, however absurd, gives a velocity that is not a finite number.
    #[test]
    fn velocity_is_always_a_finite_number(readings in prop::collection::vec(any::<(u32, u32, bool, u32)>(), 1..200)) {
        let mut velocity = Velocity::new(RawCount::default(), Time::HZ);
        for (count, last_edge, toward_work, now) in readings {
            let value = velocity.tick(RawCount { count, last_edge, toward_work, now }).0;
            prop_assert!(value.is_finite());
        }
    }
}

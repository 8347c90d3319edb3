//! The encoder on its scale: edges of A, B and index with their times.
//!
//! Line A changes before every odd count, B before every even one, a quarter period behind A when moving toward the work
//! [L]; a phase error shifts B. The index line is high for the one count in which a mark lies.

use super::random::{Cause, Random};
use super::{Cable, Installation};
use edm_hal_shim::encoder::Levels;
use edm_servo_head::units::TICK_S;
use rand::RngExt;

/// An edge as the decoder gets it: clock time and levels after it.
pub type Edge = (u32, Levels);

/// Changes of a line that trembles, 1/s (assumed).
const TREMBLES: f64 = 1000.0;
/// Mean time for which a loose contact is open, and for which it is closed, s (assumed).
const LOOSE: f64 = 0.01;

/// Scale and reading head.
#[derive(Clone, Debug)]
pub struct Scale {
    per_metre: f64,
    marks: i64,
    phase_error: f64,
    loss: f64,
    reversed: bool,
    cable: Cable,
    /// The loose contact is open; A has trembled an odd number of times.
    opened: bool,
    trembled: bool,
    /// Half-periods of A and of B passed; together they are the count of the scale.
    halves: (i64, i64),
    /// Positions of the next edge on either side, m.
    edges: (f64, f64),
    /// Levels of the lines between them, and of the receivers, which differ in `changed` alone.
    lines: Levels,
    levels: Levels,
    changed: bool,
    /// Count of a timer in encoder mode on the receivers; it started at their zero.
    timer: i64,
    random: Random,
}

impl Scale {
    /// Scale whose count 0 is centred on the upper stop.
    pub fn new(p: &Installation, seed: u64) -> Scale {
        let per_metre = 1e6 / f64::from(p.count);
        let mut scale = Scale {
            per_metre,
            marks: (f64::from(p.marks) * 1e-3 * per_metre).round() as i64,
            phase_error: p.phase_error.into(),
            loss: p.edge_loss.into(),
            reversed: p.encoder_reversed,
            cable: Cable::default(),
            opened: false,
            trembled: false,
            halves: (0, 0),
            edges: (0.0, 0.0),
            lines: Levels::default(),
            levels: Levels::default(),
            changed: false,
            timer: 0,
            random: Cause::Encoder.stream(seed),
        };
        scale.find(0.0);
        scale.levels = scale.lines;
        scale
    }

    /// Begins a tick with this cable, whose random contacts have until then done what they do.
    pub fn begin(&mut self, cable: Cable) {
        let was = (self.cable, self.opened, self.trembled);
        self.cable = cable;
        if !cable.is_sound() {
            let [opens, trembles]: [f64; 2] = self.random.random();
            let step = f64::from(TICK_S);
            self.opened = cable.loose && self.opened ^ (opens < step / LOOSE);
            self.trembled ^= cable.trembles && trembles < step * TREMBLES;
        } else {
            self.opened = false;
        }
        self.changed |= was != (self.cable, self.opened, self.trembled);
    }

    /// Takes the lines to a position without an edge.
    fn find(&mut self, x: f64) {
        let counts = x * self.per_metre + 0.5;
        self.halves = (((counts + 1.0) * 0.5).floor() as i64, ((counts - self.phase_error) * 0.5).floor() as i64);
        self.look_around();
    }

    /// Position of the edge of A that begins half-period `half`, in counts; of B likewise.
    fn edge_a(half: i64) -> f64 {
        2.0 * half as f64 - 1.5
    }

    fn edge_b(&self, half: i64) -> f64 {
        2.0 * half as f64 - 0.5 + self.phase_error
    }

    fn look_around(&mut self) {
        let (a, b) = self.halves;
        let below = Scale::edge_a(a).max(self.edge_b(b));
        let above = Scale::edge_a(a + 1).min(self.edge_b(b + 1));
        self.edges = (below / self.per_metre, above / self.per_metre);
        let (a, b) = (a & 1 == 1, b & 1 == 1);
        let index = (self.halves.0 + self.halves.1).rem_euclid(self.marks) == 0;
        self.lines = if self.reversed { Levels { a: b, b: a, index } } else { Levels { a, b, index } };
    }

    /// Shows the receivers what the lines are now, at that clock time.
    fn show(&mut self, time: u32, edges: &mut Vec<Edge>) {
        let Cable { a_cut, b_cut, trembles, .. } = self.cable;
        let (was, lines) = (self.levels, self.lines);
        let or = |cut: bool, held: bool, line: bool| if cut || self.opened { held } else { line };
        let a = if trembles { self.trembled } else { or(a_cut, was.a, lines.a) };
        self.levels = Levels { a, b: or(b_cut, was.b, lines.b), index: or(a_cut && b_cut, was.index, lines.index) };
        self.timer += step(was, self.levels);
        if self.levels != was && (self.loss == 0.0 || self.random.random::<f64>() >= self.loss) {
            edges.push((time, self.levels));
        }
    }

    /// The count at a position, without the mistakes of the lines.
    pub fn true_count(&self, x: f64) -> i64 {
        let counts = x * self.per_metre + 0.5;
        // Cheaper than `floor`, which is a call on processors without an instruction for it.
        let whole = counts as i64;
        whole - i64::from(counts < whole as f64)
    }

    /// Count of a timer in encoder mode on these lines; it started at their zero.
    pub fn timer(&self) -> u32 {
        self.timer as u32
    }

    /// Levels of the receivers now.
    pub fn levels(&self) -> Levels {
        self.levels
    }

    /// Edges of a straight piece of motion that begins at clock time `start` and takes `ticks`.
    #[inline(always)]
    pub fn travel(&mut self, from: f64, to: f64, start: u32, ticks: f64, edges: &mut Vec<Edge>) {
        // Most pieces are shorter than a count.
        if to < self.edges.0 || self.edges.1 <= to || self.changed {
            self.pass(from, to, start, ticks, edges);
        }
    }

    #[inline(never)]
    fn pass(&mut self, from: f64, to: f64, start: u32, ticks: f64, edges: &mut Vec<Edge>) {
        if std::mem::take(&mut self.changed) {
            self.show(start, edges);
        }
        while to < self.edges.0 || self.edges.1 <= to {
            let (a, b) = self.halves;
            let place = if to >= self.edges.1 {
                let a_first = Scale::edge_a(a + 1) < self.edge_b(b + 1);
                self.halves = if a_first { (a + 1, b) } else { (a, b + 1) };
                self.edges.1
            } else {
                let a_first = Scale::edge_a(a) > self.edge_b(b);
                self.halves = if a_first { (a - 1, b) } else { (a, b - 1) };
                self.edges.0
            };
            self.look_around();
            let share = ((place - from) / (to - from)).clamp(0.0, 1.0);
            self.show(start.wrapping_add((share * ticks) as u32), edges);
        }
    }
}

/// Counts by which a change of levels takes a timer on: one, where one line alone has changed.
fn step(from: Levels, to: Levels) -> i64 {
    let phase = |levels: Levels| i64::from(levels.b) << 1 | i64::from(levels.a ^ levels.b);
    [0, 1, 0, -1][(phase(to) - phase(from)).rem_euclid(4) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_servo_head::encoder::Quadrature;

    const TICK: u32 = 8400;

    struct Walk {
        seen: i64,
        illegal: u32,
        scale: Scale,
        x: f64,
    }

    impl Walk {
        fn lag(&self) -> i64 {
            self.scale.true_count(self.x) - self.seen
        }
    }

    /// Straight pieces of one tick each, as a decoder sees them.
    fn walk(p: &Installation, turns: &[f64]) -> Walk {
        let mut scale = Scale::new(p, 1);
        let mut decoder = Quadrature::new(scale.levels(), 0);
        let (mut x, mut now) = (0.0, 0u32);
        for &turn in turns {
            let mut edges = Vec::new();
            scale.travel(x, turn, now, f64::from(TICK), &mut edges);
            assert!(edges.is_sorted_by_key(|edge| edge.0));
            assert!(edges.iter().all(|edge| (now..=now + TICK).contains(&edge.0)));
            for (time, levels) in edges {
                decoder.edge(levels, || time);
            }
            x = turn;
            now += TICK;
        }
        let state = decoder.snapshot(now);
        Walk { seen: (state.raw.count as i32).into(), illegal: state.illegal, scale, x }
    }

    const TURNS: [f64; 8] = [30e-6, 28.3e-6, 55.9e-6, -40.2e-6, -40.7e-6, -40.2e-6, 3.49e-6, 3.51e-6];

    #[test]
    fn the_decoder_counts_what_the_scale_moves_and_so_does_the_timer() {
        for n in 1..=TURNS.len() {
            let walk = walk(&Installation::default(), &TURNS[..n]);
            assert_eq!((walk.lag(), walk.illegal), (0, 0));
            assert_eq!(i64::from(walk.scale.timer() as i32), walk.seen);
        }
    }

    #[test]
    fn a_phase_error_shifts_every_other_edge_and_loses_none() {
        for phase_error in [-0.9, -0.4, 0.4, 0.9] {
            let p = Installation { phase_error, ..Installation::default() };
            for n in 1..=TURNS.len() {
                let walk = walk(&p, &TURNS[..n]);
                assert!(walk.lag().abs() <= 1);
                assert_eq!(walk.illegal, 0);
            }
        }
        let times = |phase_error| {
            let mut edges = Vec::new();
            let mut scale = Scale::new(&Installation { phase_error, ..Installation::default() }, 1);
            scale.travel(0.0, 4e-6, 0, 400.0, &mut edges);
            edges.iter().map(|edge| edge.0).collect::<Vec<_>>()
        };
        // Counts begin half a micrometre before their whole number.
        for (time, expected) in times(0.0).into_iter().chain(times(0.5)).zip([50, 150, 250, 350, 50, 200, 250, 400]) {
            assert!(time.abs_diff(expected) <= 1, "{time} {expected}");
        }
    }

    #[test]
    fn a_leads_b_toward_the_work_and_the_mark_is_one_count_wide() {
        let mut edges = Vec::new();
        let mut scale = Scale::new(&Installation { marks: 0.1, ..Installation::default() }, 1);
        assert_eq!(scale.levels(), Levels { a: false, b: false, index: true });
        scale.travel(0.0, 101e-6, 0, 1e6, &mut edges);
        assert_eq!((edges[0].1.a, edges[0].1.b), (true, false));
        let marks: Vec<_> = edges.iter().enumerate().filter(|(_, edge)| edge.1.index).map(|(k, _)| k + 1).collect();
        assert_eq!(marks, [100]);
    }

    #[test]
    fn lost_edges_are_illegal_transitions_and_lose_counts() {
        let p = Installation { edge_loss: 0.1, ..Installation::default() };
        let turns: Vec<f64> = (1..100).map(|k| f64::from(k) * 20e-6).collect();
        let walk = walk(&p, &turns);
        // 1980 edges, a tenth lost; two in a row look like none.
        assert!((120..240).contains(&walk.illegal), "{}", walk.illegal);
        assert_ne!(walk.lag(), 0);
    }

    #[test]
    fn a_scale_wired_the_wrong_way_counts_down() {
        let walk = walk(&Installation { encoder_reversed: true, ..Installation::default() }, &[25.2e-6]);
        assert_eq!((walk.seen, walk.scale.timer() as i32, walk.illegal), (-25, -25, 0));
    }

    #[test]
    fn a_dead_encoder_stands_still_and_both_counters_go_on_from_there() {
        for (missed, jumped) in [(48, 0), (49, 1), (50, 0), (51, -1)] {
            let mut scale = Scale::new(&Installation::default(), 1);
            let decoder = &mut Quadrature::new(scale.levels(), 0);
            let mut edges = Vec::new();
            let resumed = f64::from(missed) * 1e-6;
            scale.begin(Cable::CUT);
            scale.travel(0.0, resumed, 0, 100.0, &mut edges);
            assert_eq!((edges.len(), scale.timer()), (0, 0));
            scale.begin(Cable::default());
            scale.travel(resumed, resumed + 3e-6, 0, 100.0, &mut edges);
            for (time, levels) in edges {
                decoder.edge(levels, || time);
            }
            assert_eq!(scale.timer().cast_signed(), 3 + jumped);
            assert_eq!(decoder.snapshot(0).raw.count, scale.timer());
        }
    }

    /// Counts of both counters after 100 ms at 1 mm/s with such a cable, each tick; illegal transitions.
    fn counts(cable: Cable) -> (Vec<i32>, u32) {
        let mut scale = Scale::new(&Installation::default(), 1);
        let decoder = &mut Quadrature::new(scale.levels(), 0);
        let counts = (0..2000u32).map(|tick| {
            let mut edges = Vec::new();
            scale.begin(cable);
            let at = |tick: u32| f64::from(tick) * 50e-9;
            scale.travel(at(tick), at(tick + 1), tick * TICK, f64::from(TICK), &mut edges);
            for (time, levels) in edges {
                decoder.edge(levels, || time);
            }
            assert_eq!(decoder.snapshot(0).raw.count, scale.timer());
            scale.timer().cast_signed()
        });
        let counts = counts.collect();
        (counts, decoder.snapshot(0).illegal)
    }

    #[test]
    fn one_line_alone_trembles_by_a_count() {
        for cable in [Cable { a_cut: true, ..Cable::default() }, Cable { b_cut: true, ..Cable::default() }] {
            let (counts, illegal) = counts(cable);
            assert!(counts.iter().all(|count| (-1..=1).contains(count)) && illegal == 0);
            assert!(counts.windows(2).filter(|pair| pair[0] != pair[1]).count() >= 49);
        }
    }

    #[test]
    fn a_line_that_trembles_counts_up_and_down_and_a_loose_contact_loses_what_passes_while_it_is_open() {
        let (noisy, _) = counts(Cable { trembles: true, ..Cable::default() });
        assert!(noisy.windows(2).filter(|pair| pair[0] != pair[1]).count() > 90);
        assert!(noisy.iter().all(|count| count.abs() < 40), "{noisy:?}");
        let (loose, _) = counts(Cable { loose: true, ..Cable::default() });
        let longest = loose.chunk_by(|a, b| a == b).map(<[i32]>::len).max().unwrap();
        assert!(longest > 100 && (20..80).contains(loose.last().unwrap()), "{longest} ticks, {loose:?}");
    }
}

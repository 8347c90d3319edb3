//! What the encoder's interrupts cost, edge by edge: estimated cycles on the modelled chip with warm flash, entry and return
//! included. (`cargo fil cycles` adds what the flash accelerator and the buses wait for.)

use super::common;
use edm_fil::cycles::names;
use edm_fil::image::Image;
use edm_fil::latency::RATED_SCENE;
use edm_fil::machine::Machine;
use edm_fil::synthetic::{Rig, TICK};
use edm_fil::wires::ENCODER;
use edm_hal_shim::board::F405;
use edm_soc::TICK_HZ;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

const A: usize = 0;
const B: usize = 1;
const INDEX: usize = 2;
/// Exceptions of A, B and index.
const VECTORS: [u8; 3] = [16 + 6, 16 + 7, 16 + 8];
/// Counter of TIM1, which begins a tick at 0.
const TIM1_CNT: u32 = 0x4001_0024;
const US: u64 = TICK_HZ / 1_000_000;
const MS: u64 = TICK_HZ / 1000;

/// From one edge to the next at the rated 300 kcount/s.
const RATED_SPACING: u64 = TICK_HZ / 300_000;

/// Bounds, estimated cycles; RTIC has 16 of them, for a BASEPRI that is saved, and restored behind a barrier.
const LEGAL: u64 = 80;
const NEAR_A_MARK: u64 = 160;
const OVERLOAD: u64 = 125;

/// A disabled head, whose axis rests; the encoder's lines are moved by hand.
struct Lines {
    machine: Machine<Rig>,
    levels: [bool; 3],
    now: u64,
    /// Where the decoder has its count, and what it has counted as illegal.
    counters: [u32; 2],
}

impl Lines {
    fn new() -> Lines {
        let image = Image::parse(common::firmware().to_vec()).unwrap();
        let mut machine = Machine::new(&image, Rig::new(RATED_SCENE), F405::TABLE.crystal_hz.into()).unwrap();
        let now = 60 * MS;
        machine.run_until(now).unwrap();
        machine.start_meter(Box::new(|_| 0)).unwrap();
        let shared = image.find("chip", "ENCODER").unwrap();
        let counters = ["count", "illegal"].map(|name| shared + names::offset(&image, "Shared", name).unwrap());
        let mut lines = Lines { machine, levels: [false; 3], now, counters };
        // The first edge leaves a place of which it is not known what the index line was before.
        lines.runs(&[A, A]);
        lines
    }

    /// Changes a line at `at`, ticks from now.
    fn change(&mut self, at: u64, line: usize) {
        self.levels[line] = !self.levels[line];
        let soc = self.machine.soc();
        soc.world.level(self.now + at, ENCODER[line], self.levels[line]);
        soc.world_changed();
    }

    /// A millisecond passes: the runs of each vector meanwhile.
    fn pass(&mut self) -> [Vec<u64>; 3] {
        self.machine.meter().unwrap().clear();
        self.now += MS;
        self.machine.run_until(self.now).unwrap();
        let tasks = self.machine.meter().unwrap().tasks().unwrap();
        VECTORS.map(|vector| {
            let runs = tasks.get(&vector).map_or(&[][..], |task| &task.runs);
            runs.iter().map(|run| run.cost.warm).collect()
        })
    }

    /// What the decoder has counted, and what of it as illegal.
    fn counted(&mut self) -> [u32; 2] {
        let sram = &self.machine.soc().memory.sram;
        self.counters.map(|at| sram.load(at, 4).unwrap())
    }

    /// Changes lines one after the other, 5 us apart: all runs.
    fn runs(&mut self, lines: &[usize]) -> Vec<u64> {
        for (n, &line) in (1..).zip(lines) {
            self.change(n * 5 * US, line);
        }
        self.pass().concat()
    }
}

#[test]
fn a_legal_edge_takes_80_cycles() {
    let mut lines = Lines::new();
    let runs = lines.runs(&[A, B, A, B, B, A, B, A]);
    println!("{runs:?}");
    assert!(runs.len() == 8 && runs.iter().all(|run| *run <= LEGAL), "{runs:?}");
}

#[test]
fn an_edge_near_an_index_mark_takes_160_cycles() {
    let mut lines = Lines::new();
    // Onto marks, over them, and back.
    let runs = lines.runs(&[A, INDEX, B, A, INDEX, B, B, INDEX, A, B, INDEX, A, B, B]);
    println!("{runs:?}");
    assert!(runs.len() == 14 && runs.iter().all(|run| *run <= NEAR_A_MARK), "{runs:?}");
    assert!(runs.iter().filter(|run| **run > LEGAL).count() >= 8, "no mark was met: {runs:?}");
}

#[test]
fn an_illegal_transition_takes_no_longer_than_a_mark() {
    let mut lines = Lines::new();
    for line in [A, B] {
        lines.change(10 * US, line);
    }
    // The vector of A sees both, that of B nothing new.
    let [a, b, _] = lines.pass();
    println!("{a:?} {b:?}");
    assert!(a.len() == 1 && b.len() == 1 && a[0].max(b[0]) <= NEAR_A_MARK && a[0].min(b[0]) > LEGAL, "{a:?} {b:?}");
}

#[test]
fn the_edge_that_masks_the_lines_and_the_one_that_opens_them_take_125_cycles() {
    let mut lines = Lines::new();
    // All of them between two ticks, which is what is counted.
    let count = lines.machine.soc().read(TIM1_CNT, 4).unwrap();
    let tick = TICK - u64::from(count) % TICK;
    for n in 0..60 {
        lines.change(tick + 10 * US + n * TICK / 80, A);
    }
    lines.change(tick + 4 * TICK, A);
    lines.change(tick + 5 * TICK, A);
    let [runs, ..] = lines.pass();
    println!("{runs:?}");
    let masked = runs.iter().position(|run| *run > LEGAL).expect("the storm was not met");
    assert!(runs[masked] <= OVERLOAD && runs[masked + 1] <= OVERLOAD, "{runs:?}");
    // It was not known where the axis stood while nobody looked.
    assert!(runs[masked + 2] <= NEAR_A_MARK && runs[masked + 3] <= LEGAL, "{runs:?}");
}

#[test]
fn no_edge_is_lost_at_the_rated_rate_however_the_axis_turns_and_whenever_a_mark_changes() {
    let mut lines = Lines::new();
    let [began, illegal] = lines.counted();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let mut place: i32 = 0;
    for ms in 0..20 {
        let mut at = 5 * US;
        while at < MS - 20 * US {
            let forth = random.random_bool(0.5);
            // A leads: from each even place the next edge toward the work is one of A.
            let from = if forth { place } else { place - 1 };
            place += if forth { 1 } else { -1 };
            lines.change(at, if from.rem_euclid(2) == 0 { A } else { B });
            // Marks six counts wide, and their edges before, at and behind those of A and B.
            if lines.levels[INDEX] != (place.rem_euclid(12) < 6) {
                lines
                    .change(at + random.random_range(0..RATED_SPACING / 2) * u64::from(random.random_bool(0.7)), INDEX);
            }
            at += random.random_range(RATED_SPACING..2 * RATED_SPACING);
        }
        lines.pass();
        assert_eq!(lines.counted(), [began.wrapping_add_signed(place), illegal], "after {ms} ms");
    }
}

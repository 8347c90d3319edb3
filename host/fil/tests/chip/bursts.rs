//! Random bursts of writes to the release image on the modelled chip: what the dictionary reads afterwards is what its tasks
//! run. What they run is read from their memory (`edm_fil::seen`), the rest by the bus.

use crate::common;
use edm_fil::bench::WINDOW;
use edm_fil::host::{self, Bus as _};
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_servo_head::canopen::objects::{setting_address_at, setting_kind};
use edm_servo_head::settings::{Declared, Kind, Settings};
use edm_sim::machine::Rig as _;
use edm_sim::process::Plant;
use edm_soc::{Frame, TICK_HZ};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::collections::BTreeSet;

const BURSTS: u32 = 1000;
/// Windows of a millisecond.
const MS: u64 = TICK_HZ / 1000 / WINDOW;
/// Time that a frame of eight bytes takes.
const FRAME: u64 = 130 * (TICK_HZ / 1_000_000);

/// Runs of a burst.
#[derive(Debug, Default)]
struct Seen {
    accepted: u32,
    refused: u32,
    longest: u64,
}

struct Master {
    random: Xoshiro256PlusPlus,
    rig: Emulated,
    known: Settings,
    /// Requests that were not answered.
    asked: u32,
    seen: Seen,
}

impl Master {
    fn new(seed: u64) -> Master {
        let image = Image::parse(common::firmware().to_vec()).unwrap();
        let known = Settings { commissioned: true, ..Settings::default() };
        let mut rig = Emulated::start(&image, Plant::default(), &known, seed, Witness::None).unwrap();
        host::begin(&mut rig).unwrap();
        Master { random: Xoshiro256PlusPlus::seed_from_u64(seed), rig, known, asked: 0, seen: Seen::default() }
    }

    fn below(&mut self, bound: u32) -> u32 {
        self.random.random_range(0..bound)
    }

    /// A value near the one that is, at a bound, or beyond it.
    fn value(&mut self, at: usize) -> u32 {
        let way = self.below(12);
        let share: f32 = self.random.random();
        let now = self.known.word(at).unwrap();
        match Settings::FIELDS[at].kind {
            Kind::Number { min, max } => match way {
                0..9 => (f32::from_bits(now) * (0.8 + 0.4 * share)).clamp(min, max),
                9 => min,
                10 => max,
                _ => max * 2.0 + 1.0,
            }
            .to_bits(),
            Kind::Integer { min, max } => match way {
                0..9 => (now.saturating_sub(2) + self.below(5)).clamp(min, max),
                9 => min,
                10 => max,
                _ => max.wrapping_add(1),
            },
            Kind::Flag => self.below(2),
            Kind::Choice(names) => self.below(names.len() as u32 + 1),
        }
    }

    /// Windows pass until everything is answered, at most 50 ms.
    fn hear(&mut self) {
        for window in 0..50 * MS {
            while let Some(frame) = self.rig.take() {
                if frame.id == 0x581 {
                    self.asked -= 1;
                    *if frame.data[0] == 0x80 { &mut self.seen.refused } else { &mut self.seen.accepted } += 1;
                }
            }
            if self.asked == 0 {
                self.seen.longest = self.seen.longest.max(window);
                return;
            }
            self.rig.tick().unwrap();
        }
        panic!("{} requests were not answered", self.asked);
    }

    /// A frame that is no request.
    fn also(&mut self, after: u64, id: u16, data: &[u8]) {
        self.rig.send_at(after, Frame::new(id, data));
    }

    fn burst(&mut self) -> BTreeSet<usize> {
        let mut touched = BTreeSet::new();
        let waits = self.below(2) == 0;
        // The server keeps eight requests beside the one under way.
        for n in 0..1 + self.below(9) {
            let at = self.below(Settings::COUNT as u32) as usize;
            let (index, sub) = setting_address_at(at).unwrap();
            let size = setting_kind(at as u16).unwrap().0.size().unwrap() as u8;
            let [low, high] = index.to_le_bytes();
            let [a, b, c, d] = self.value(at).to_le_bytes();
            touched.insert(at);
            self.asked += 1;
            let after = if waits { WINDOW / 2 } else { FRAME * u64::from(n) };
            self.rig.send_at(after, Frame::new(0x601, &[0x23 | (4 - size) << 2, low, high, sub, a, b, c, d]));
            match self.below(8) {
                0 => self.also(after, 0x201, &[[6, 7, 15, 0][n as usize % 4], 0]),
                1 => self.also(after, 0x80, &[]),
                2 => self.also(after, 0, &[1, 1]),
                _ => {}
            }
            if waits {
                self.hear();
            }
        }
        self.hear();
        touched
    }

    /// Everything agrees.
    fn settle(&mut self, touched: BTreeSet<usize>) {
        for at in touched {
            let (index, sub) = setting_address_at(at).unwrap();
            let size = setting_kind(at as u16).unwrap().0.size().unwrap();
            let word = host::read(&mut self.rig, index, sub).unwrap();
            self.known.put_word(at, word & (u64::MAX >> (64 - 8 * size)) as u32).unwrap();
        }
        let generations = [1, 2, 3, 4].map(|sub| host::read(&mut self.rig, 0x200C, sub).unwrap());
        assert_eq!(generations, [generations[0]; 4]);
        let runs = self.rig.runs().unwrap();
        let limits = self.known.build().unwrap().head.supervise;
        assert_eq!(runs.head, limits, "planner");
        assert_eq!(runs.supervision, limits, "supervision");
        let short = self.known.gap_short / self.known.gap_volts_per_code;
        assert_eq!(runs.short, short, "gap task");
    }
}

#[test]
fn after_random_bursts_of_writes_the_dictionary_reads_what_the_tasks_of_the_chip_run() {
    let started = std::time::Instant::now();
    let mut seen = Vec::new();
    for head in 0..10 {
        let mut master = Master::new(head);
        for _ in 0..BURSTS / 10 {
            let touched = master.burst();
            master.settle(touched);
        }
        let lost = [1, 2].map(|sub| host::read(&mut master.rig, 0x200D, sub).unwrap());
        assert_eq!(lost, [0, 0]);
        seen.push(master.seen);
    }
    let sum = |of: fn(&Seen) -> u32| seen.iter().map(of).sum::<u32>();
    let longest = seen.iter().map(|seen| seen.longest).max().unwrap_or(0);
    println!("{BURSTS} bursts in {:.1} s", started.elapsed().as_secs_f64());
    println!("{} accepted, {} refused, {longest} windows at most", sum(|s| s.accepted), sum(|s| s.refused));
    assert!(sum(|s| s.accepted) > BURSTS && sum(|s| s.refused) > BURSTS / 10);
}

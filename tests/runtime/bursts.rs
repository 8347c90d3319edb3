//! Random bursts: what the dictionary reads afterwards is what every task runs.
//!
//! A hundred thousand of them, a minute of one core; `EDM_BURSTS=1000000 cargo test --test runtime bursts` runs more.

use crate::rig::{Host, ID, MS, download, place, setting};
use edm_servo_head::head::State;
use edm_servo_head::settings::{Declared, Kind, Settings};
use edm_sim::schedule::Habits;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::collections::BTreeSet;

/// Bursts that a head lives for: random settings do not keep it fit for work.
const LIFE: u32 = 100;
/// Keys of what is wired, which opens commissioning again.
const WIRED: [&str; 3] = ["gap.", "motor.", "encoder."];

/// What has happened in all the bursts.
#[derive(Debug, Default)]
struct Seen {
    /// Requests.
    accepted: u64,
    refused: u64,
    /// Settings of a reset that had to wait.
    stale: u64,
    /// Frames, events.
    lost: [u64; 2],
    /// Bursts that ended with the loop closed, in a fault, in commissioning.
    closed: u32,
    faults: u32,
    checks: u32,
    boots: u32,
    /// Longest time from a request to the end of its answer, periods.
    longest: u64,
    periods: u64,
}

impl Seen {
    fn and(self, other: Seen) -> Seen {
        Seen {
            accepted: self.accepted + other.accepted,
            refused: self.refused + other.refused,
            stale: self.stale + other.stale,
            lost: [self.lost[0] + other.lost[0], self.lost[1] + other.lost[1]],
            closed: self.closed + other.closed,
            faults: self.faults + other.faults,
            checks: self.checks + other.checks,
            boots: self.boots + other.boots,
            longest: self.longest.max(other.longest),
            periods: self.periods + other.periods,
        }
    }
}

struct Master {
    random: Xoshiro256PlusPlus,
    host: Host,
    /// What the dictionary has read.
    known: Settings,
    /// May have changed since.
    touched: BTreeSet<usize>,
    stopped: bool,
}

impl Master {
    fn new(seed: u64) -> Master {
        let mut host = Host::new(|_| {}, seed);
        let mut known = Settings::default();
        host.head.set_habits(Habits::PROMPT);
        host.learn(&mut known, 0..Settings::COUNT);
        Master {
            random: Xoshiro256PlusPlus::seed_from_u64(!seed),
            host,
            known,
            touched: BTreeSet::new(),
            stopped: false,
        }
    }

    fn below(&mut self, bound: u32) -> u32 {
        self.random.random_range(0..bound)
    }

    /// A value of a setting: near what it is, anywhere in its range, at its bounds, beyond them, or nonsense.
    fn value(&mut self, at: usize) -> u32 {
        let kind = Settings::FIELDS[at].kind;
        let now = self.known.word(at).unwrap();
        let way = self.below(16);
        let share: f32 = self.random.random();
        match kind {
            Kind::Number { min, max } => match way {
                0..10 => (f32::from_bits(now) * (0.8 + 0.4 * share)).clamp(min, max),
                10 | 11 => min + (max - min) * share,
                12 => min,
                13 => max,
                14 => max * 2.0 + 1.0,
                _ => f32::NAN,
            }
            .to_bits(),
            Kind::Integer { min, max } => match way {
                0..10 => (now.saturating_sub(2) + self.below(5)).clamp(min, max),
                10 | 11 => min + ((max - min) as f32 * share) as u32,
                12 => min,
                13 => max,
                14 => max.wrapping_add(1),
                _ => u32::MAX,
            },
            Kind::Flag => self.below(3).min(1),
            Kind::Choice(names) => self.below(names.len() as u32 + 1),
        }
    }

    fn write(&mut self) {
        let at = loop {
            let at = self.below(Settings::COUNT as u32) as usize;
            // Rarely what would open commissioning again.
            let key = Settings::FIELDS[at].key;
            if !WIRED.iter().any(|prefix| key.starts_with(prefix)) || self.below(16) == 0 {
                break at;
            }
        };
        let word = self.value(at);
        self.touched.insert(at);
        self.host.ask(setting(at, word));
    }

    fn other(&mut self) {
        let id = u16::from(ID);
        match self.below(24) {
            0..4 => {
                for word in [0x06u16, 0x07, 0x0F] {
                    self.host.send(0x200 + id, &word.to_le_bytes());
                }
            }
            4..8 => {
                let words = [0x06u16, 0x07, 0x0F, 0x0F, 0x1F, 0x0B, 0x80, 0x00];
                let word = words[self.below(8) as usize];
                self.host.send(0x200 + id, &word.to_le_bytes());
            }
            8..11 => {
                let target = self.below(2000) as i32 - 1000;
                self.host.send(0x300 + id, &target.to_le_bytes());
            }
            11 => {
                let velocity = self.below(2000) as i32 - 1000;
                self.host.send(0x400 + id, &velocity.to_le_bytes());
            }
            12..18 => self.host.send(0x80, &[]),
            18 => {
                let mode = [1, 3, 6, 8][self.below(4) as usize];
                self.host.ask(download(0x6060, 0, 1, mode));
            }
            19 if self.below(8) == 0 => self.host.ask(download(0x2001, 3, 1, 1)),
            20 if self.below(4) == 0 => {
                self.stopped = true;
                self.host.send(0, &[2, 0]);
                // What was asked before is not answered any more, once all of it is off the bus.
                while self.host.head.coming() > 0 {
                    self.host.run(1);
                }
                self.host.run(3 * MS);
                self.host.asked = self.host.answered;
            }
            20 => self.host.send(0, &[128, ID]),
            21 if self.below(8) == 0 => {
                let command = 129 + self.below(2) as u8;
                self.reset(command);
            }
            _ => self.host.send(0, &[1, 0]),
        }
    }

    /// Reset of node or communication, in the middle of whatever goes on.
    fn reset(&mut self, command: u8) {
        self.host.reset(command);
        if command == 129 {
            self.touched.extend(0..Settings::COUNT);
        }
    }

    /// One burst.
    fn burst(&mut self) {
        self.host.head.set_habits(Habits::BUSY);
        let waits = self.below(3);
        for _ in 0..1 + self.below(12) {
            if self.stopped {
                self.host.send(0, &[1, 0]);
                self.stopped = false;
            }
            self.write();
            if waits == 0 || waits == 1 && self.below(2) == 0 {
                self.host.hear();
            }
            if self.below(3) == 0 {
                self.other();
            }
            if self.below(8) == 0 {
                let pause = self.below(30);
                self.host.run(pause.into());
            }
        }
    }

    /// After a few quiet milliseconds everything agrees.
    fn settle(&mut self, all: bool, seen: &mut Seen) {
        self.host.send(0, &[1, 0]);
        self.stopped = false;
        self.host.hear();
        for answer in self.host.answers() {
            *if answer.is_ok() { &mut seen.accepted } else { &mut seen.refused } += 1;
        }
        self.host.run(2 * MS);
        self.host.head.set_habits(Habits::PROMPT);
        self.host.run(MS);

        self.touched.extend([place("commission.passed"), place("axis.breakaway_n")]);
        if all {
            self.touched.extend(0..Settings::COUNT);
        }
        let touched = std::mem::take(&mut self.touched);
        let [newest, servo, gap, supervision] = loop {
            let state = self.host.head.status().state;
            self.host.learn(&mut self.known, touched.clone());
            let generations = self.host.generations();
            if self.host.head.status().state == state {
                break generations;
            }
            // A check has ended while the host read: the drive is told within a millisecond.
            self.host.run(2 * MS);
        };
        assert_eq!([gap, supervision], [servo; 2], "generations that the tasks run");
        if newest == servo {
            self.host.expect_runs(&self.known);
        } else {
            // The settings of a reset, which wait until the head is disabled; until then none is written.
            assert_eq!(newest, servo + 1);
            assert_eq!(self.host.head.status().state, State::Fault);
            seen.stale += 1;
            self.touched.extend(0..Settings::COUNT);
        }
    }
}

/// Says which head it was when a test fails.
struct Named(u32);

impl Drop for Named {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("head {}", self.0);
        }
    }
}

/// The bursts of these heads.
fn bursts(heads: impl Iterator<Item = u32>) -> Seen {
    let mut seen = Seen::default();
    for head in heads {
        let named = Named(head);
        let mut master = Master::new(head.into());
        let mut lost = [0; 2];
        for n in 0..LIFE {
            let boots = master.host.boots;
            master.burst();
            master.settle(n == LIFE - 1, &mut seen);
            match master.host.head.status().state {
                State::Disabled => {}
                State::Fault => seen.faults += 1,
                State::Commissioning => seen.checks += 1,
                _ => seen.closed += 1,
            }
            // A reset of communication forgets what was to be told.
            let told = std::mem::take(&mut master.host.emergencies);
            let now = master.host.expect_counted();
            for ((now, before), code) in now.iter().zip(&mut lost).zip([0x8110, 0x6100]) {
                assert!(now == before || told.contains(&code) || boots != master.host.boots, "{code:x}: {told:x?}");
                *before = *now;
            }
        }
        seen.lost = [seen.lost[0] + u64::from(lost[0]), seen.lost[1] + u64::from(lost[1])];
        seen.boots += master.host.boots;
        seen.periods += master.host.head.periods();
        seen.longest = seen.longest.max(master.host.longest);
        drop(named);
    }
    seen
}

#[test]
fn after_random_bursts_of_writes_the_dictionary_reads_what_every_task_runs() {
    let count = match std::env::var("EDM_BURSTS") {
        Ok(number) => number.parse().expect("EDM_BURSTS is a whole number"),
        Err(_) => 100_000,
    };
    let started = std::time::Instant::now();
    let threads = std::thread::available_parallelism().map_or(1, |cores| cores.get() as u32);
    let seen = std::thread::scope(|scope| {
        let part = |first| scope.spawn(move || bursts((first..count / LIFE).step_by(threads as usize)));
        let parts: Vec<_> = (0..threads).map(part).collect();
        parts.into_iter().map(|part| part.join().unwrap()).fold(Seen::default(), Seen::and)
    });
    println!("{count} bursts in {:.1} s: {seen:?}", started.elapsed().as_secs_f64());
    let share = count / 100;
    assert!(seen.closed > share && seen.faults > 0 && seen.checks > 0 && seen.boots > 0, "{seen:?}");
    assert!(seen.accepted > u64::from(count) && seen.refused > u64::from(share), "{seen:?}");
}

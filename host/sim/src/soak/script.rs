//! Random lives: what a host may do with a head, in any order, and what may happen to its wires meanwhile.
//!
//! Excluded: commissioning, which needs an axis without a workpiece; velocities beyond 20 mm/s, and seeking beyond 5 mm/s, for
//! which no force is guaranteed; settings of a disabled head, which may describe any machine. Loop gains are
//! changed by a fifth at the most: with others the loop is no loop.

use super::case::{Action, Case, Step};
use crate::faults::wires::{WIRES, Wire};
use edm_servo_head::canopen::objects::{setting_address_at, setting_kind};
use edm_servo_head::settings::{Declared, Kind, Settings, Value};
use edm_servo_head::units::{TICK_HZ, TICKS_PER_MS};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::ops::Range;

/// Node-ID of the head.
pub const ID: u8 = 5;
/// Length of a life, s.
pub const LIFE_S: u64 = 60;
/// Fastest that a host moves, counts/s: 20 mm/s.
const FASTEST: u32 = 20_000;
/// Lowest target, counts: a millimetre into the work.
const LOWEST: u32 = 3000;
/// Keys of settings that are only changed a little, and the share.
const TOUCHY: &[&str] = &["servo.", "single.", "feed.", "gap.", "axis.", "generator."];
/// Settings that are not changed.
const LEFT: &[&str] = &["feed.structure"];

/// A life in the making.
struct Script {
    random: Xoshiro256PlusPlus,
    steps: Vec<Step>,
    /// Ticks until the next step.
    wait: u64,
    /// Ticks so far.
    now: u64,
    /// Wires that will be repaired: when, and which.
    broken: Vec<(u64, &'static Wire)>,
}

/// The life of a seed.
pub fn life(seed: u64) -> Case {
    let random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut script = Script { random, steps: Vec::new(), wait: 0, now: 0, broken: Vec::new() };
    script.pause(10..11);
    script.frame(0, &[1, ID]);
    script.enable();
    script.home(35);
    while script.now < LIFE_S * u64::from(TICK_HZ) {
        script.something();
        script.repair(false);
    }
    script.repair(true);
    script.pause(500..501);
    script.frame(0x080, &[]);
    Case { seed, steps: script.steps }
}

impl Script {
    fn below(&mut self, bound: u32) -> u32 {
        self.random.random_range(0..bound)
    }

    fn push(&mut self, action: Action) {
        self.steps.push(Step { after: std::mem::take(&mut self.wait), action });
    }

    fn frame(&mut self, id: u16, data: &[u8]) {
        self.push(Action::Frame(id, data.to_vec()));
    }

    /// Lets some milliseconds pass.
    fn pause(&mut self, ms: Range<u32>) {
        let ticks = self.random.random_range(u64::from(ms.start)..u64::from(ms.end)) * u64::from(TICKS_PER_MS)
            + u64::from(self.below(TICKS_PER_MS));
        self.wait += ticks;
        self.now += ticks;
    }

    /// An expedited write, and time for it.
    fn write(&mut self, index: u16, sub: u8, size: u8, value: u32) {
        self.frame(0x600 + u16::from(ID), &download(index, sub, size, value));
        self.pause(1..3);
    }

    fn control(&mut self, word: u16) {
        self.frame(0x200 + u16::from(ID), &word.to_le_bytes());
        self.pause(2..6);
    }

    fn enable(&mut self) {
        for word in [0x80, 0x06, 0x07, 0x0F] {
            self.control(word);
        }
        // An encoder proves itself in a tenth of a second.
        self.pause(10..300);
    }

    /// Enabled, and homed where it is: what a lost encoder and a reset take away.
    fn ready(&mut self) {
        if self.below(2) == 0 {
            self.enable();
            self.home(35);
        }
    }

    fn mode(&mut self, mode: u32) {
        self.write(0x6060, 0, 1, mode);
    }

    fn home(&mut self, method: u32) {
        self.mode(6);
        self.write(0x6098, 0, 1, method);
        self.control(0x0F);
        self.control(0x1F);
        self.pause(5..500);
        self.control(0x0F);
    }

    fn target(&mut self, target: u32) {
        self.write(0x607A, 0, 4, target);
        self.control(0x2F);
        self.control(0x3F);
    }

    fn position(&mut self) {
        self.ready();
        self.mode(1);
        let (velocity, target) = (1 + self.below(FASTEST), self.below(LOWEST));
        self.write(0x6081, 0, 4, velocity);
        self.target(target);
    }

    fn jog(&mut self) {
        self.mode(3);
        let velocity = self.below(2 * FASTEST + 1).cast_signed() - FASTEST.cast_signed();
        self.frame(0x400 + u16::from(ID), &velocity.to_le_bytes());
        self.pause(5..500);
        if self.below(4) > 0 {
            self.frame(0x400 + u16::from(ID), &[0; 4]);
        }
    }

    /// Set points with every SYNC, a slope that ends anywhere.
    fn follow(&mut self) {
        self.mode(8);
        let (mut target, slope) = (self.below(LOWEST).cast_signed(), self.below(41).cast_signed() - 20);
        for _ in 0..self.below(60) {
            self.frame(0x300 + u16::from(ID), &target.to_le_bytes());
            self.frame(0x080, &[]);
            self.wait += u64::from(TICKS_PER_MS);
            self.now += u64::from(TICKS_PER_MS);
            target += slope;
        }
    }

    /// A setting, to any value for those that are guarded: an enabled head knows which it takes.
    fn setting(&mut self) {
        let place = self.below(Settings::COUNT as u32) as usize;
        let Some(field) = Settings::FIELDS.get(place) else { return };
        let Some(default) = Settings::default().word(place) else { return };
        if LEFT.contains(&field.key) {
            return;
        }
        let share: f32 = self.random.random();
        let near = TOUCHY.iter().any(|prefix| field.key.starts_with(prefix));
        let word = match field.kind {
            Kind::Number { min, max } => {
                let value =
                    if near { f32::from_bits(default) * (0.8 + 0.4 * share) } else { min + (max - min) * share };
                value.clamp(min, max).to_bits()
            }
            Kind::Integer { min, max } => min + ((max - min) as f32 * share) as u32,
            Kind::Flag => self.below(2),
            Kind::Choice(names) => self.below(names.len() as u32),
        };
        let size = u16::try_from(place).ok().and_then(setting_kind).and_then(|(kind, _)| kind.size());
        if let (Some((index, sub)), Some(size)) = (setting_address_at(place), size) {
            self.push(Action::Enabled(0x600 + u16::from(ID), download(index, sub, size as u8, word).to_vec()));
            self.pause(1..3);
        }
    }

    /// A wire breaks; it will be repaired.
    fn wire(&mut self) {
        let at = self.below(WIRES.len() as u32) as usize;
        let Some(wire) = WIRES.get(at) else { return };
        if self.broken.iter().any(|(_, other)| other.signal == wire.signal) {
            return;
        }
        self.push(Action::Wire(wire.signal, value(wire, true)));
        let ms = if self.below(4) == 0 { self.below(20) } else { 20 + self.below(1000) };
        self.broken.push((self.now + u64::from(ms * TICKS_PER_MS), wire));
    }

    /// Repairs what is due, or everything.
    fn repair(&mut self, all: bool) {
        while let Some(at) = self.broken.iter().position(|(due, _)| all || *due <= self.now) {
            let (_, wire) = self.broken.swap_remove(at);
            self.push(Action::Wire(wire.signal, value(wire, false)));
        }
    }

    fn something(&mut self) {
        match self.below(100) {
            0..16 => self.enable(),
            16..26 => {
                let methods = [35, 35, 35, 17, 18, 33, 34, 37];
                let method = methods[self.below(8) as usize];
                self.home(method);
            }
            26..38 => self.position(),
            38..54 => {
                // Erode: set points become path.
                self.ready();
                self.mode(1);
                self.write(0x2001, 1, 1, 1);
                let target = 1900 + self.below(600);
                self.target(target);
                self.pause(100..5000);
            }
            54..58 => self.write(0x2001, 1, 1, 0),
            58..60 => self.write(0x2001, 2, 1, 1),
            60..66 => self.jog(),
            66..70 => self.follow(),
            70..73 => {
                // Quick stop, disable voltage, shutdown, halt.
                let word = [0x02, 0x0B, 0x00, 0x06, 0x07, 0x10F][self.below(6) as usize];
                self.control(word);
            }
            73..78 => {
                self.write(0x2001, 5, 1, 1);
                self.position();
                self.pause(50..800);
                self.write(0x2001, 5, 1, 0);
            }
            78..80 => {
                let command = [2, 128, 1, 1][self.below(4) as usize];
                self.frame(0, &[command, ID]);
                self.pause(1..100);
                self.frame(0, &[1, ID]);
            }
            80 => {
                if self.below(4) == 0 {
                    let command = 129 + self.below(2) as u8;
                    self.frame(0, &[command, ID]);
                    self.pause(100..200);
                    self.frame(0, &[1, ID]);
                }
            }
            81 => {
                self.write(0x2001, 1, 1, 2);
                self.pause(10..500);
            }
            82..86 => self.setting(),
            86..90 => self.wire(),
            _ => self.pause(1..1000),
        }
        self.pause(0..50);
    }
}

/// The values of the campaign of pairs; a work that is put there, or taken away, by up to a millimetre.
fn value(wire: &Wire, broken: bool) -> Value<'static> {
    match (wire.signal, broken) {
        ("workpiece.raised_mm", true) => Value::Number(0.5),
        (_, true) => wire.broken,
        (_, false) => wire.sound(),
    }
}

fn download(index: u16, sub: u8, size: u8, value: u32) -> [u8; 8] {
    let [low, high] = index.to_le_bytes();
    let [a, b, c, d] = value.to_le_bytes();
    [0x23 | (4 - size) << 2, low, high, sub, a, b, c, d]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_is_a_life_of_its_length_and_another_seed_another() {
        let case = life(1);
        let ticks: u64 = case.steps.iter().map(|step| step.after).sum();
        assert!((LIFE_S..LIFE_S + 10).contains(&(ticks / u64::from(TICK_HZ))), "{ticks}");
        assert_eq!(case, life(1));
        assert_ne!(case.steps, life(2).steps);
    }

    #[test]
    fn every_wire_breaks_and_is_mended_in_some_life() {
        let cases: Vec<Case> = (1..=30).map(life).collect();
        for wire in WIRES {
            for broken in [true, false] {
                let action = Action::Wire(wire.signal, value(wire, broken));
                assert!(cases.iter().any(|case| case.steps.iter().any(|step| step.action == action)), "{action:?}");
            }
        }
    }
}

//! Ten million frames, most of them nearly right: nothing panics, and nothing changes without an accepted write.

use crate::machine::*;
use crate::watched::{ID, Watched};
use edm_servo_head::canopen::Abort;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Objects worth addressing.
const INDICES: [u16; 28] = [
    RANGED, READ_ONLY, WRITE_ONLY, NAME, SCOPE, LONG, FLAG, BYTES, ARRAY, GUARDED, CONTROL, STATUS, TARGET, 0x1000,
    0x1003, 0x1005, 0x1006, 0x1008, 0x1010, 0x1014, 0x1016, 0x1017, 0x1019, 0x1029, 0x1400, 0x1600, 0x1801, 0x1A01,
];

struct Host {
    random: Xoshiro256PlusPlus,
    watched: Watched,
    /// Number of the next segment of a block.
    sequence: u8,
}

impl Host {
    fn new(seed: u64) -> Self {
        Self { random: Xoshiro256PlusPlus::seed_from_u64(seed), watched: Watched::new(), sequence: 1 }
    }

    fn below(&mut self, bound: u32) -> u32 {
        self.random.random_range(0..bound)
    }

    fn one_in(&mut self, bound: u32) -> bool {
        self.below(bound) == 0
    }

    /// A value of any size, often a small one.
    fn word(&mut self) -> u32 {
        match self.below(4) {
            0 => self.random.random(),
            1 => self.below(1200),
            2 => self.below(12),
            _ => [0x6576_6173, 0x6461_6F6C, 0x6040_0010, 0x607A_0020, 0x8000_0220, 0x220, 0x4000_01A0, 0x2000_0020]
                [self.below(8) as usize],
        }
    }

    /// A beginning that can end well.
    fn good_initiate(&mut self) -> [u8; 8] {
        self.sequence = 1;
        let value = self.below(1100).to_le_bytes();
        let (command, index, sub) = match self.below(6) {
            0 => (0x23, RANGED, 0),
            1 => (0x2B, CONTROL, 0),
            2 => (0x2B, ARRAY, 1 + self.below(8) as u8),
            3 => (0x20, BYTES, 0),
            4 => (0xC0, BYTES, 0),
            _ => (0xC0, NAME, 0),
        };
        let [low, high] = u16::to_le_bytes(index);
        [command, low, high, sub, value[0], value[1], value[2], value[3]]
    }

    fn initiate(&mut self) -> [u8; 8] {
        const COMMANDS: [u8; 14] = [0x40, 0x40, 0x23, 0x27, 0x2B, 0x2F, 0x22, 0x21, 0x21, 0x20, 0xA4, 0xC6, 0xC2, 0xC0];
        let command = COMMANDS[self.below(14) as usize];
        let index = INDICES[self.below(INDICES.len() as u32) as usize];
        let sub = if self.one_in(2) { 0 } else { self.below(10) as u8 };
        let rest = match command {
            0xA4 => [self.below(130) as u8, self.below(3) as u8 * 10, 0, 0],
            _ => self.word().to_le_bytes(),
        };
        self.sequence = 1;
        let [low, high] = index.to_le_bytes();
        [command, low, high, sub, rest[0], rest[1], rest[2], rest[3]]
    }

    /// What a client would say next.
    fn go_on(&mut self) -> [u8; 8] {
        let answer = self.watched.answer;
        if matches!(answer[0], 0x42..0x60 | 0x80) {
            return if self.one_in(2) { self.good_initiate() } else { self.initiate() };
        }
        let last = u8::from(self.one_in(4));
        let unused = if last == 1 { self.below(8) as u8 } else { 0 };
        let mut request: [u8; 8] = self.random.random();
        request[0] = match answer[0] {
            0x60 => unused << 1 | last,
            0x20 | 0x30 => (answer[0] ^ 0x10) & 0x10 | unused << 1 | last,
            0x41 => 0x60,
            0x00..0x20 => 0x60 | (answer[0] ^ 0x10) & 0x10,
            0xA4 | 0xA2 if answer[0] == 0xA2 && self.one_in(2) => 0xC1 | (self.below(8) as u8) << 2,
            0xA4 | 0xA2 => {
                self.sequence = if self.sequence > 31 { 1 } else { self.sequence + 1 };
                (self.sequence - 1).max(1) | last << 7
            }
            0xC6 => 0xA3,
            0xC1.. => 0xA1,
            command => {
                (request[1], request[2]) = (command & 0x7F, 1 + self.below(127) as u8);
                0xA2
            }
        };
        if self.one_in(50) {
            request[0] ^= 1 << self.below(8);
        }
        request
    }

    fn step(&mut self) {
        self.watched.now += u64::from(self.below(300));
        let kind = self.below(100);
        let (id, data): (u16, [u8; 8]) = match kind {
            0..25 => (0x600 + ID, self.initiate()),
            25..70 => (0x600 + ID, self.go_on()),
            70..75 => (0x600 + ID, self.random.random()),
            75..78 => (0, [[1, 1, 1, 128, 2, 129, 130, 3][self.below(8) as usize], ID as u8, 0, 0, 0, 0, 0, 0]),
            78..82 => (0x80, self.random.random()),
            82..90 => (0x200 + 0x100 * self.below(4) as u16 + ID, self.random.random()),
            90..93 => (0x700 + self.below(128) as u16, self.random.random()),
            93..95 => (self.below(0x800) as u16, self.random.random()),
            95..98 => return self.watched.pass(u64::from(self.random.random_range(0..2_000u32))),
            98 => {
                self.watched.machine.enabled = self.one_in(4);
                self.watched.machine.scope_broken_from = if self.one_in(4) { 1000 } else { u32::MAX };
                let (silence, result) = (self.one_in(100), if self.one_in(2) { Ok(()) } else { Err(Abort::Hardware) });
                self.watched.pass(if silence { 2_000_000 } else { 0 });
                return self.watched.answer(result);
            }
            _ => return self.watched.tick(),
        };
        let length = match kind {
            75..78 if !self.one_in(20) => 2,
            78..82 => self.below(3) as usize,
            90..93 => 1,
            _ if self.one_in(20) || kind >= 82 => self.below(9) as usize,
            _ => 8,
        };
        self.watched.send(id, &data[..length]);
    }
}

fn flood(seed: u64) {
    let mut host = Host::new(seed);
    // Four tests make ten million.
    for _ in 0..2_500_000 {
        host.step();
    }
    // Neither a wall nor an open door.
    let Watched { expedited, segmented, block, refused, .. } = host.watched;
    let fewest = expedited.min(segmented).min(block).min(refused);
    assert!(fewest > 5_000, "{expedited} {segmented} {block} {refused}");
}

#[test]
fn a_quarter_of_ten_million_frames_1() {
    flood(1);
}

#[test]
fn a_quarter_of_ten_million_frames_2() {
    flood(2);
}

#[test]
fn a_quarter_of_ten_million_frames_3() {
    flood(3);
}

#[test]
fn a_quarter_of_ten_million_frames_4() {
    flood(4);
}

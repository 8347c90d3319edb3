//! Memory of the scope: rings of samples, each with a header.

use super::{RECORD, SIGNALS, SNAPSHOT};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Words of a header.
pub const HEADER: usize = 12;
/// Words that a host reads before the samples.
pub const STREAM_HEADER: usize = 8;
/// Marks a complete record of this layout: `SC`, version 1.
const MAGIC: u32 = 0x4353_0001;

/// Words of a header. The first eight are those that a host reads.
#[derive(Clone, Copy)]
enum Word {
    Magic,
    /// Signals, what has begun it, fault: a byte each.
    What,
    /// Numbers of signals 1 to 4, 5 to 8.
    Low,
    High,
    /// Servo ticks from one sample to the next.
    Every,
    Samples,
    /// Sample of the trigger, from the oldest on; that number of samples: none.
    Trigger,
    /// Servo tick of the trigger.
    Tick,
    /// Place of the oldest sample in the ring.
    First,
    /// Number of the record, which rises.
    Serial,
    Check,
}

const _: () = assert!(Word::Check as usize <= HEADER && Word::First as usize == STREAM_HEADER);

/// What a bank holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Contents {
    /// Numbers of its signals; 0 behind the last.
    pub signals: [u8; SIGNALS],
    /// How many there are.
    pub width: u32,
    /// What has begun it: the number of its trigger and 1; 0 it was stopped before.
    pub cause: u8,
    /// Fault of then; 0 none.
    pub fault: u8,
    /// Servo ticks from one sample to the next.
    pub every: u32,
    /// Samples.
    pub samples: u32,
    /// Sample of the trigger.
    pub trigger: u32,
    /// Servo tick of the trigger.
    pub tick: u32,
    /// Place of the oldest sample in the ring.
    pub first: u32,
    /// Number of the record.
    pub serial: u32,
}

/// A ring of samples and its header. Whatever its bits, a reader stays inside.
#[derive(Clone, Copy, Debug)]
pub struct Bank {
    header: &'static [AtomicU32],
    words: &'static [AtomicU32],
}

impl Bank {
    fn get(&self, word: Word) -> u32 {
        self.header.get(word as usize).map_or(0, |word| word.load(Relaxed))
    }

    fn set(&self, word: Word, value: u32) {
        if let Some(word) = self.header.get(word as usize) {
            word.store(value, Relaxed);
        }
    }

    fn check(&self) -> u32 {
        let words = self.header.iter().take(Word::Check as usize);
        words.fold(!0, |sum, word| sum.rotate_left(5) ^ word.load(Relaxed))
    }

    /// Words in its ring.
    pub fn room(&self) -> u32 {
        self.words.len() as u32
    }

    /// Writes a word of a sample.
    #[inline(always)]
    pub fn store(&self, at: u32, value: i32) {
        if let Some(word) = self.words.get(at as usize) {
            word.store(value.cast_unsigned(), Relaxed);
        }
    }

    /// There is nothing in it from here on.
    pub fn clear(&self) {
        self.set(Word::Magic, 0);
    }

    /// Its record is complete.
    pub fn seal(&self, contents: &Contents) {
        let Contents { signals, width, cause, fault, every, samples, trigger, tick, first, serial } = *contents;
        let [a, b, c, d, e, f, g, h] = signals;
        self.set(Word::What, width | u32::from(cause) << 8 | u32::from(fault) << 16);
        self.set(Word::Low, u32::from_le_bytes([a, b, c, d]));
        self.set(Word::High, u32::from_le_bytes([e, f, g, h]));
        self.set(Word::Every, every);
        self.set(Word::Samples, samples);
        self.set(Word::Trigger, trigger);
        self.set(Word::Tick, tick);
        self.set(Word::First, first);
        self.set(Word::Serial, serial);
        self.set(Word::Magic, MAGIC);
        self.set(Word::Check, self.check());
    }

    /// Number of its record, if there is one.
    pub fn serial(&self) -> Option<u32> {
        let (width, samples) = (self.get(Word::What) & 0xFF, self.get(Word::Samples));
        let fits = (1..=SIGNALS as u32).contains(&width)
            && samples <= self.ring(width)
            && self.get(Word::First) < self.ring(width);
        let whole = self.get(Word::Magic) == MAGIC && self.get(Word::Check) == self.check();
        (fits && whole).then(|| self.get(Word::Serial))
    }

    /// Samples of so many signals that fit.
    pub fn ring(&self, width: u32) -> u32 {
        self.room().checked_div(width).unwrap_or(0)
    }

    /// Turns a bit of a header over.
    #[cfg(test)]
    pub fn flip(&self, word: usize, bit: u32) {
        self.header[word].fetch_xor(1 << bit, Relaxed);
    }

    /// Length of what a host reads of its record, bytes.
    pub fn length(&self) -> u32 {
        match self.serial() {
            Some(_) => {
                let words = self.get(Word::Samples).wrapping_mul(self.get(Word::What) & 0xFF);
                words.wrapping_add(STREAM_HEADER as u32).wrapping_mul(4)
            }
            None => 0,
        }
    }

    /// A word of what a host reads.
    #[inline(never)]
    fn word(&self, at: u32) -> u32 {
        let Some(place) = at.checked_sub(STREAM_HEADER as u32) else {
            return self.header.get(at as usize).map_or(0, |word| word.load(Relaxed));
        };
        let width = self.get(Word::What) & 0xFF;
        let end = self.ring(width).wrapping_mul(width);
        let place = self.get(Word::First).wrapping_mul(width).wrapping_add(place);
        let place = if place >= end { place.wrapping_sub(end) } else { place };
        self.words.get(place as usize).map_or(0, |word| word.load(Relaxed))
    }

    /// Bytes of what a host reads from `offset` on: eight words, then the samples, the oldest first, little-endian.
    pub fn copy(&self, offset: u32, out: &mut [u8]) {
        for (byte, place) in out.iter_mut().zip(offset..) {
            *byte = (self.word(place / 4) >> (place % 4 * 8)) as u8;
        }
    }
}

/// All banks.
#[derive(Clone, Copy, Debug)]
pub struct Memory {
    /// Of the host's record.
    pub record: Bank,
    /// Of the snapshots.
    pub snapshots: [Bank; 2],
}

impl Memory {
    /// Words that it takes.
    pub const WORDS: usize = HEADER + RECORD + 2 * (HEADER + SNAPSHOT);

    /// Over words that no start-up code touches; `None` where there are fewer than [`WORDS`](Memory::WORDS).
    pub fn over(words: &'static [AtomicU32]) -> Option<Memory> {
        let bank = |words: &'static [AtomicU32], room| {
            let (header, rest) = words.split_at_checked(HEADER)?;
            let (words, rest) = rest.split_at_checked(room)?;
            Some((Bank { header, words }, rest))
        };
        let (record, rest) = bank(words, RECORD)?;
        let (first, rest) = bank(rest, SNAPSHOT)?;
        let (second, _) = bank(rest, SNAPSHOT)?;
        Some(Memory { record, snapshots: [first, second] })
    }

    /// Of a PC, for the rest of the program.
    #[cfg(not(target_os = "none"))]
    #[allow(clippy::missing_panics_doc, reason = "there are as many words as it takes")]
    pub fn leak() -> Memory {
        extern crate std;
        let words: std::vec::Vec<AtomicU32> = (0..Memory::WORDS).map(|_| AtomicU32::new(0)).collect();
        Memory::over(std::vec::Vec::leak(words)).expect("it has its words")
    }

    /// Forgets what is in it: after power-up, noise.
    pub fn clear(&self) {
        let Memory { record, snapshots: [first, second] } = self;
        [record, first, second].iter().for_each(|bank| bank.clear());
    }
}

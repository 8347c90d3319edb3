//! What survives a reset and a power cut in the memory with a cell: the hole under the electrode, and the work of the head.
//!
//! | word | content |
//! | --- | --- |
//! | 0 | a mark while the copy may be read, else anything |
//! | 1 | number of the copy: the newest one counts |
//! | 2.. | [`Backup`], a word or two each, in the order of its fields |
//! | last | CRC-32 (that of Ethernet) over all between the first word and this |
//!
//! There are two copies, and the older one is written: first word 0 is taken away, then come the others, at last word 0. So a
//! cut between any two words leaves the older copy or the newer one. Noise, as after a time without the cell, has neither.

use crc::{CRC_32_ISO_HDLC, Crc};
use edm_hal_shim::backup::BackupMemory;

/// Marks a copy that was written to its end; the version of the layout is in it.
const WHOLE: u32 = 0x4B_45_50_01;
/// Words before the content, and of it.
const HEAD: usize = 2;
const CONTENT: usize = 30;
/// Words of a copy. The two are one after the other at the beginning of the memory.
pub const COPY: usize = HEAD + CONTENT + 1;
const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// What is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Backup {
    /// The hole under the electrode, if one was begun.
    pub hole: Option<Hole>,
    /// What the head has done.
    pub work: Work,
}

/// A hole that was begun. Positions are counts from the home.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Hole {
    /// Surface of the work.
    pub surface: i64,
    /// Farthest place of the electrode in the work; the surface before it was there.
    pub deepest: i64,
    /// Place that it was to go to.
    pub target: i64,
    /// Newest path coordinate, um.
    pub path: i64,
    /// The reference, as touched with a new electrode, and how much deeper it was touched last.
    pub reference: Option<i64>,
    /// See [`reference`](Hole::reference).
    pub wear: i64,
    /// Distance by which a coarse axis has carried the head.
    pub carried: i64,
    /// How the home was found that the counts are from.
    pub home: HomeFound,
    /// Checksum of the settings that say what a count is.
    pub scale: u32,
    /// Row of a table of technology, as a host has numbered it.
    pub row: u16,
    /// State of the head, by its number.
    pub state: u8,
    /// The encoder was lost in the hole.
    pub encoder_lost: bool,
}

/// How a home was found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HomeFound {
    /// Homing method, 6098h.
    pub method: i8,
    /// Home offset, 607Ch.
    pub offset: i32,
}

/// What the head has done since the memory was first supplied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Time under power, ms.
    pub on_ms: u64,
    /// Time in erosions, ms.
    pub eroding_ms: u64,
    /// Pulses, whatever became of them.
    pub pulses: u64,
    /// Arcs among them.
    pub arcs: u64,
    /// Shorts among them.
    pub shorts: u64,
    /// Erosions that came to their end.
    pub holes: u32,
}

/// What was found in the memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Found {
    /// Nothing: never written, or without its cell for a time.
    #[default]
    Nothing,
    /// What was kept last.
    Kept(Backup),
    /// Copies that were written, and none of them is what it was.
    Damaged,
}

/// Why a copy cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Unread {
    /// It was not written to its end.
    Nothing,
    /// It was, and is not what it was.
    Damaged,
}

/// Takes words off the front, or puts them at the end.
struct Words<'a>(&'a mut [u32; CONTENT], usize);

impl Words<'_> {
    fn put(&mut self, word: u32) {
        if let Some(slot) = self.0.get_mut(self.1) {
            *slot = word;
        }
        self.1 = self.1.saturating_add(1);
    }

    fn put64(&mut self, number: u64) {
        self.put(number as u32);
        self.put((number >> 32) as u32);
    }

    fn take(&mut self) -> u32 {
        let word = self.0.get(self.1).copied().unwrap_or(0);
        self.1 = self.1.saturating_add(1);
        word
    }

    fn take64(&mut self) -> u64 {
        u64::from(self.take()) | u64::from(self.take()) << 32
    }
}

/// Bits of the word of flags.
const HOLE: u32 = 1 << 24;
const REFERENCE: u32 = 1 << 25;
const LOST: u32 = 1 << 26;

impl Backup {
    fn words(&self) -> [u32; CONTENT] {
        let mut words = [0; CONTENT];
        let mut put = Words(&mut words, 0);
        let hole = self.hole.unwrap_or_default();
        let flags = if self.hole.is_some() { HOLE } else { 0 }
            | if hole.reference.is_some() { REFERENCE } else { 0 }
            | if hole.encoder_lost { LOST } else { 0 };
        put.put(flags | u32::from(hole.state) << 16 | u32::from(hole.row));
        let Hole { surface, deepest, target, path, reference, wear, carried, .. } = hole;
        [surface, deepest, target, path, reference.unwrap_or(0), wear, carried]
            .into_iter()
            .for_each(|place| put.put64(place.cast_unsigned()));
        put.put(i32::from(hole.home.method).cast_unsigned());
        put.put(hole.home.offset.cast_unsigned());
        put.put(hole.scale);
        let Work { on_ms, eroding_ms, pulses, arcs, shorts, holes } = self.work;
        [on_ms, eroding_ms, pulses, arcs, shorts].into_iter().for_each(|number| put.put64(number));
        put.put(holes);
        words
    }

    fn of(mut words: [u32; CONTENT]) -> Backup {
        let mut take = Words(&mut words, 0);
        let flags = take.take();
        let mut place = || take.take64().cast_signed();
        let (surface, deepest, target, path) = (place(), place(), place(), place());
        let (reference, wear, carried) = (place(), place(), place());
        let home = HomeFound { method: take.take() as i8, offset: take.take().cast_signed() };
        let hole = Hole {
            surface,
            deepest,
            target,
            path,
            reference: (flags & REFERENCE != 0).then_some(reference),
            wear,
            carried,
            home,
            scale: take.take(),
            row: flags as u16,
            state: (flags >> 16) as u8,
            encoder_lost: flags & LOST != 0,
        };
        let work = Work {
            on_ms: take.take64(),
            eroding_ms: take.take64(),
            pulses: take.take64(),
            arcs: take.take64(),
            shorts: take.take64(),
            holes: take.take(),
        };
        Backup { hole: (flags & HOLE != 0).then_some(hole), work }
    }
}

/// Checksum of a copy.
fn check(number: u32, content: &[u32; CONTENT]) -> u32 {
    let mut digest = CRC.digest();
    digest.update(&number.to_le_bytes());
    content.iter().for_each(|word| digest.update(&word.to_le_bytes()));
    digest.finalize()
}

/// Keeps a [`Backup`] in a memory.
#[derive(Debug)]
pub struct Keeper<M> {
    memory: M,
    /// Which of the two copies is the newest, and its number.
    newest: (usize, u32),
    /// What it says.
    kept: Option<Backup>,
}

impl<M: BackupMemory> Keeper<M> {
    /// Keeps in this memory, of which nothing is known yet.
    pub const fn new(memory: M) -> Keeper<M> {
        Keeper { memory, newest: (0, 0), kept: None }
    }

    /// What was kept last. Once, at the start.
    // In a frame of its own, that is off the stack again before anything else runs.
    #[inline(never)]
    pub fn load(&mut self) -> Found {
        let copies = [self.copy(0), self.copy(1)];
        let newest = match copies {
            [Ok((first, _)), Ok((second, _))] => usize::from((second.wrapping_sub(first) as i32) > 0),
            [_, Ok(_)] => 1,
            _ => 0,
        };
        match copies.get(newest) {
            Some(Ok((number, backup))) => {
                (self.newest, self.kept) = ((newest, *number), Some(*backup));
                Found::Kept(*backup)
            }
            _ if copies.contains(&Err(Unread::Damaged)) => Found::Damaged,
            _ => Found::Nothing,
        }
    }

    /// Reads a copy: its number and what it says.
    fn copy(&self, copy: usize) -> Result<(u32, Backup), Unread> {
        let word = |place: usize| self.memory.read(copy.wrapping_mul(COPY).wrapping_add(place));
        if word(0) != WHOLE {
            return Err(Unread::Nothing);
        }
        let mut content = [0; CONTENT];
        content.iter_mut().zip(HEAD..).for_each(|(slot, place)| *slot = word(place));
        let number = word(1);
        if word(HEAD + CONTENT) != check(number, &content) {
            return Err(Unread::Damaged);
        }
        Ok((number, Backup::of(content)))
    }

    /// Keeps this from now on, if it is something else than before.
    pub fn keep(&mut self, backup: &Backup) {
        if self.kept.as_ref() == Some(backup) {
            return;
        }
        let (copy, number) = (1usize.saturating_sub(self.newest.0), self.newest.1.wrapping_add(1));
        let content = backup.words();
        let base = copy.wrapping_mul(COPY);
        let mut write = |place: usize, word| self.memory.write(base.wrapping_add(place), word);
        write(0, 0);
        write(1, number);
        content.iter().zip(HEAD..).for_each(|(word, place)| write(place, *word));
        write(HEAD + CONTENT, check(number, &content));
        write(0, WHOLE);
        (self.newest, self.kept) = ((copy, number), Some(*backup));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_hal_shim::backup::WORDS;
    use std::cell::{Cell, RefCell};
    use std::rc::Rc;
    use std::vec::Vec;

    /// A memory that loses its power after so many writes.
    #[derive(Clone)]
    struct Memory(Rc<RefCell<Vec<u32>>>, Rc<Cell<usize>>);

    impl Memory {
        fn new(fill: impl FnMut() -> u32) -> Memory {
            let words = std::iter::repeat_with(fill).take(WORDS).collect();
            Memory(Rc::new(RefCell::new(words)), Rc::new(Cell::new(usize::MAX)))
        }
    }

    impl BackupMemory for Memory {
        fn read(&self, place: usize) -> u32 {
            self.0.borrow()[place]
        }
        fn write(&mut self, place: usize, word: u32) {
            if self.1.get() > 0 {
                self.1.set(self.1.get() - 1);
                self.0.borrow_mut()[place] = word;
            }
        }
    }

    fn backup(n: i64) -> Backup {
        let hole = Hole {
            surface: -n,
            deepest: n << 33,
            target: n + 1,
            path: -(n << 20),
            reference: (n % 2 == 0).then_some(n - 7),
            wear: 3 * n,
            carried: n << 31,
            home: HomeFound { method: -(n as i8 % 100), offset: -5 },
            scale: 0xDEAD_BEEF,
            row: 0xFFFF,
            state: n as u8,
            encoder_lost: n % 3 == 0,
        };
        let [on_ms, eroding_ms, pulses, arcs, shorts] = [1, 2, 3, 4, 5].map(|k| (n as u64) << 31 | k);
        let work = Work { on_ms, eroding_ms, pulses, arcs, shorts, holes: u32::MAX };
        Backup { hole: (n % 5 != 0).then_some(hole), work }
    }

    #[test]
    fn what_is_kept_is_read_back_and_the_newest_counts() {
        let memory = Memory::new(|| 0);
        let mut keeper = Keeper::new(memory.clone());
        assert_eq!(keeper.load(), Found::Nothing);
        for n in 1..12 {
            keeper.keep(&backup(n));
            assert_eq!(Keeper::new(memory.clone()).load(), Found::Kept(backup(n)));
        }
        // What goes on with it goes on with its numbers.
        let mut keeper = Keeper::new(memory.clone());
        keeper.load();
        keeper.keep(&backup(13));
        assert_eq!(Keeper::new(memory).load(), Found::Kept(backup(13)));
    }

    #[test]
    fn a_cut_between_any_two_words_leaves_the_older_or_the_newer() {
        for written in 0..=COPY + 1 {
            let memory = Memory::new(|| 0xA5A5_A5A5);
            let mut keeper = Keeper::new(memory.clone());
            keeper.load();
            keeper.keep(&backup(1));
            keeper.keep(&backup(2));
            memory.1.set(written);
            keeper.keep(&backup(3));
            let expected = if written > COPY { 3 } else { 2 };
            assert_eq!(Keeper::new(memory.clone()).load(), Found::Kept(backup(expected)), "{written} words");
            // And from there on.
            memory.1.set(usize::MAX);
            let mut keeper = Keeper::new(memory.clone());
            keeper.load();
            keeper.keep(&backup(4));
            assert_eq!(Keeper::new(memory).load(), Found::Kept(backup(4)));
        }
    }

    #[test]
    fn what_is_the_same_is_not_written_again() {
        let memory = Memory::new(|| 0);
        let mut keeper = Keeper::new(memory.clone());
        keeper.keep(&backup(1));
        memory.1.set(100);
        keeper.keep(&backup(1));
        assert_eq!(memory.1.get(), 100);
    }

    #[test]
    fn noise_is_nothing_and_a_bit_that_flips_is_damage_unless_the_other_copy_is_whole() {
        let mut state = 1u32;
        let noise = move || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            state
        };
        assert_eq!(Keeper::new(Memory::new(noise)).load(), Found::Nothing);
        for bit in 0..32 * COPY {
            let memory = Memory::new(|| 0);
            let mut keeper = Keeper::new(memory.clone());
            keeper.keep(&backup(1));
            let first = keeper.newest.0;
            memory.0.borrow_mut()[first * COPY + bit / 32] ^= 1 << (bit % 32);
            let found = Keeper::new(memory.clone()).load();
            assert_eq!(found, if bit < 32 { Found::Nothing } else { Found::Damaged }, "bit {bit}");
            keeper.keep(&backup(2));
            assert_eq!(Keeper::new(memory).load(), Found::Kept(backup(2)), "bit {bit}");
        }
    }
}

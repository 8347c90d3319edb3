//! An update with the power cut at every erase and every word: what starts afterwards is the old program or the new one.

use edm_boot::{
    DONE, FLASH_END, Flash, HEADER, Header, IS_READY, LONGEST, PREFIX, PROGRAM, READY, STAGE, STAGE_SECTOR_LENGTH,
    STAGE_SECTORS, Wrong, clear, file, mark, prepare, staged,
};

/// First address of what is modelled: the program and the stage.
const FIRST: u32 = PROGRAM;

/// The flash, with the power cut inside an operation.
#[derive(Clone)]
struct Cells {
    words: Vec<u32>,
    operations: u32,
    cut: Option<(u32, u64)>,
    off: bool,
}

fn sum(words: &[u32]) -> u32 {
    file::sum(words.iter().copied())
}

impl Cells {
    fn new() -> Cells {
        Cells { words: vec![u32::MAX; (FLASH_END - FIRST) as usize / 4], operations: 0, cut: None, off: false }
    }

    fn range(from: u32, to: u32) -> std::ops::Range<usize> {
        (from - FIRST) as usize / 4..(to - FIRST) as usize / 4
    }

    /// Counts an operation; random bits when the power fails in it.
    fn begin(&mut self) -> Option<u64> {
        let torn = self.cut.filter(|(at, _)| *at == self.operations).map(|(_, seed)| seed);
        self.operations += 1;
        self.off |= torn.is_some();
        torn
    }
}

fn next(seed: &mut u64) -> u32 {
    *seed ^= *seed >> 12;
    *seed ^= *seed << 25;
    *seed ^= *seed >> 27;
    (seed.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32) as u32
}

impl Flash for Cells {
    fn word(&self, address: u32) -> u32 {
        self.words[Self::range(address, address + 4)][0]
    }

    fn sum(&mut self, from: u32, to: u32) -> u32 {
        sum(&self.words[Self::range(from, to)])
    }

    fn erase(&mut self, sector: u32) -> bool {
        if self.off {
            return false;
        }
        let (from, to) = match sector {
            3 => (PROGRAM, 0x0801_0000),
            4 => (0x0801_0000, 0x0802_0000),
            5..=11 => (0x0802_0000 + (sector - 5) * 0x2_0000, 0x0802_0000 + (sector - 4) * 0x2_0000),
            _ => panic!("sector {sector} is not to be erased"),
        };
        let torn = self.begin();
        let cells = &mut self.words[Self::range(from, to)];
        let half = cells.len() / 2;
        match torn {
            None => cells.fill(u32::MAX),
            // Not begun, just finished, programmed to zero beforehand, one end first, or each bit for itself.
            Some(mut seed) => match next(&mut seed) % 7 {
                0 => {}
                1 => cells.fill(u32::MAX),
                2 => cells.fill(0),
                3 => cells[..half].fill(u32::MAX),
                4 => cells[half..].fill(u32::MAX),
                5 => cells.iter_mut().for_each(|cell| *cell |= next(&mut seed)),
                _ => cells.iter_mut().for_each(|cell| *cell |= next(&mut seed) | next(&mut seed) | next(&mut seed)),
            },
        }
        !self.off
    }

    fn write(&mut self, address: u32, words: &[u32]) -> bool {
        for (address, word) in (address..).step_by(4).zip(words).filter(|(_, word)| **word != u32::MAX) {
            if self.off {
                return false;
            }
            let torn = self.begin();
            let cell = &mut self.words[Self::range(address, address + 4)][0];
            assert_eq!(*cell & word, *word, "{address:#010x} was not erased");
            let keep =
                torn.map_or(0, |mut seed| [!0, 0, next(&mut seed), next(&mut seed)][next(&mut seed) as usize % 4]);
            *cell &= word | keep;
        }
        !self.off
    }
}

/// A program of so many words.
fn program(words: u32, seed: u32) -> Vec<u32> {
    let code = (2..words).map(|n| n.wrapping_mul(0x9E37_79B9) ^ seed);
    [0x2002_0000, PROGRAM + 0x201].into_iter().chain(code).collect()
}

fn header(program: &[u32]) -> Header {
    Header { product: 1, board: 405, length: 4 * program.len() as u32, sum: sum(program), id: 7, version: 0, build: 0 }
}

fn update(program: &[u32], header: Header) -> Vec<u32> {
    let mut words = header.words().to_vec();
    words.push(sum(&words));
    assert_eq!(words.len(), HEADER);
    words.resize(PREFIX as usize / 4, u32::MAX);
    words.extend(program);
    words
}

/// What the program does with an update. False: the power is off, or something is wrong.
fn stage(flash: &mut Cells, update: &[u32]) -> bool {
    (0..STAGE_SECTORS).all(|sector| clear(flash, sector))
        && update.chunks(16).zip((STAGE..).step_by(64)).all(|(words, address)| flash.write(address, words))
        && staged(flash).is_ok()
        && mark(flash)
}

fn holds(flash: &Cells, program: &[u32]) -> bool {
    flash.words[Cells::range(PROGRAM, PROGRAM + 4 * program.len() as u32)] == *program
}

/// A head with a program, and an old update in its stage if so wanted.
fn head(old: &[u32], earlier: Option<&[u32]>) -> Cells {
    let mut flash = Cells::new();
    flash.write(PROGRAM, old);
    if let Some(earlier) = earlier {
        assert!(stage(&mut flash, &update(earlier, header(earlier))) && prepare(&mut flash));
        assert_eq!((flash.word(READY), flash.word(DONE)), (IS_READY, 0));
    }
    flash.operations = 0;
    flash
}

#[test]
fn a_cut_at_any_erase_or_word_leaves_a_program_that_starts() {
    // Across a border of sectors: the program's are 16 and 64 KiB.
    let [old, new] = [program(4100, 1), program(4200, 2)];
    let image = update(&new, header(&new));
    for earlier in [None, Some(&old[..])] {
        let fresh = head(&old, earlier);
        let mut whole = fresh.clone();
        assert!(stage(&mut whole, &image));
        let staging = whole.operations;
        assert!(prepare(&mut whole) && holds(&whole, &new));
        let all = whole.operations;
        assert!(all > staging + 4200);
        // Each of the first and last of every part, and some between; every one in the campaign.
        let step = if std::env::var_os("EDM_EVERY_CUT").is_some() { 1 } else { 397 };
        let near = |at: u32| [0, staging, all].iter().any(|border| at.abs_diff(*border) < 12);
        let mut outcomes = [0; 2];
        for at in (0..all).filter(|at| at % step == 0 || near(*at)) {
            for seed in 1..3 {
                let mut flash = fresh.clone();
                flash.cut = Some((at, u64::from(at) << 8 | seed));
                let marked = stage(&mut flash, &image);
                let first = !flash.off && prepare(&mut flash);
                assert!(flash.off || (marked && first), "cut {at}");
                // Power is back; and goes once more, in the copy.
                (flash.cut, flash.off) = (Some((flash.operations + 40, seed)), false);
                prepare(&mut flash);
                (flash.cut, flash.off) = (None, false);
                assert!(prepare(&mut flash), "cut {at}, seed {seed}: nothing starts");
                let programs = [holds(&flash, &old), holds(&flash, &new)];
                assert!(programs[0] != programs[1], "cut {at}, seed {seed}: {programs:?}");
                // What was marked is not forgotten, and what was not is not taken.
                assert!(!marked || programs[1], "cut {at}, seed {seed}: the update was lost");
                outcomes[usize::from(programs[1])] += 1;
                // Another attempt works.
                assert!(stage(&mut flash, &image) && prepare(&mut flash) && holds(&flash, &new));
            }
        }
        assert!(outcomes.iter().all(|count| *count > 30), "{outcomes:?}");
        let cuts: u32 = outcomes.iter().sum();
        println!("cuts: {cuts}, of which {} leave the new program", outcomes[1]);
    }
}

#[test]
fn what_is_not_right_is_not_copied() {
    let [old, new] = [program(600, 1), program(500, 2)];
    let right = header(&new);
    let wrong = [
        (Header { product: 2, ..right }, Wrong::Product),
        (Header { sum: right.sum ^ 1, ..right }, Wrong::Sum),
        (Header { length: right.length - 4, ..right }, Wrong::Sum),
        (Header { length: LONGEST + 4, ..right }, Wrong::Length),
        (Header { length: 2, ..right }, Wrong::Length),
    ];
    for (header, expected) in wrong {
        let mut flash = head(&old, None);
        let image = update(&new, header);
        assert!(flash.write(STAGE, &image));
        assert_eq!(staged(&mut flash), Err(expected));
        // Whoever marks it all the same.
        assert!(mark(&mut flash) && prepare(&mut flash) && holds(&flash, &old));
    }
    for word in [0, 1, 8, HEADER - 1] {
        let mut flash = head(&old, None);
        let mut image = update(&new, right);
        image[word] ^= 1 << 9;
        assert!(flash.write(STAGE, &image));
        assert_eq!(staged(&mut flash), Err(Wrong::Format));
        assert!(mark(&mut flash) && prepare(&mut flash) && holds(&flash, &old));
    }
}

#[test]
fn nothing_is_started_that_is_no_program() {
    assert!(!prepare(&mut Cells::new()));
    for start in
        [[0x2002_0000, u32::MAX], [0, PROGRAM + 0x201], [0x2002_0000, PROGRAM + 0x200], [0x2002_0000, STAGE + 1]]
    {
        let mut flash = Cells::new();
        flash.write(PROGRAM, &start);
        assert!(!prepare(&mut flash), "{start:x?}");
    }
    let mut flash = Cells::new();
    flash.write(PROGRAM, &program(8, 0));
    assert!(prepare(&mut flash));
}

#[test]
fn a_stage_that_is_erased_is_not_erased_again() {
    let mut flash = head(&program(8, 0), None);
    assert!((0..STAGE_SECTORS).all(|sector| clear(&mut flash, sector)));
    assert_eq!(flash.operations, 0);
    flash.write(STAGE + 3 * STAGE_SECTOR_LENGTH, &[1]);
    assert!((0..STAGE_SECTORS).all(|sector| clear(&mut flash, sector)));
    assert_eq!(flash.operations, 2);
}

//! The backup SRAM, 4 KiB (RM0090 §5.1.2): what it holds, and noise where nothing has supplied it.

/// Words.
const WORDS: usize = 1024;

/// The memory. Its clock gate and its write protection are those of RCC and PWR.
#[derive(Clone)]
pub struct Backup {
    pub words: Vec<u32>,
    /// Writes until the power is cut.
    left: Option<u32>,
}

impl Backup {
    pub fn new() -> Self {
        let mut backup = Self { words: vec![0; WORDS], left: None };
        backup.scramble(1);
        backup
    }

    /// Nothing has supplied it for a while.
    fn scramble(&mut self, seed: u64) {
        noise(seed).zip(&mut self.words).for_each(|(noise, word)| *word = noise);
    }

    /// The power is back after a cut, in which the words were `kept` or not.
    pub fn power_is_back(&mut self, kept: bool, seed: u64) {
        self.left = None;
        if !kept {
            self.scramble(seed);
        }
    }

    pub fn cut_after(&mut self, writes: u32) {
        self.left = Some(writes);
    }

    /// A write, and whether the power is cut before it: then it is none.
    pub fn write(&mut self, place: usize, word: u32) -> bool {
        match &mut self.left {
            Some(0) => return true,
            Some(left) => *left -= 1,
            None => (),
        }
        self.words[place] = word;
        false
    }
}

/// Words without any order (xorshift).
pub fn noise(seed: u64) -> impl Iterator<Item = u32> {
    let mut state = seed | 1 << 40;
    std::iter::repeat_with(move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 16) as u32
    })
}

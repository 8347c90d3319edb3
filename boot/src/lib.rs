//! What stands where in the flash, and what the boot loader does: it starts the program, or first copies an update.
//!
//! An update is *staged*: the program that runs writes a new one, with its [`Header`], into the upper half of the flash, checks
//! it, and marks it as ready. At the next start the boot loader copies it over the program and clears the mark. Until the mark is
//! cleared it copies again at each start; the vector table, without which nothing is started, is written last. So a cut of the
//! power leaves the old program, or a copy that begins again. Marks are words that are programmed from all ones, never erased.
//!
//! | sectors | what |
//! | --- | --- |
//! | 0 | boot loader, with its checksum; an update never touches it |
//! | 1, 2 | settings |
//! | 3 to 7 | program: vector table, seal, code |
//! | 8 to 11 | stage: header and marks, then a program |
#![cfg_attr(not(test), no_std)]
#![deny(unsafe_code)]

#[cfg(target_arch = "arm")]
#[allow(unsafe_code, reason = "the registers of flash and CRC unit, and the flash itself")]
pub mod chip;
#[cfg(not(target_arch = "arm"))]
pub mod file;

/// First address of the flash: the boot loader.
pub const BOOT: u32 = 0x0800_0000;
/// Bytes of the boot loader; the last word is the sum of the others.
pub const BOOT_LENGTH: u32 = 4096;
/// First address of the program: its vector table. memory.x says the same.
pub const PROGRAM: u32 = 0x0800_C000;
/// End of the program, and first address of the stage.
pub const STAGE: u32 = 0x0808_0000;
/// End of the flash.
pub const FLASH_END: u32 = 0x0810_0000;
/// RAM that a stack may lie in.
const RAM: core::ops::RangeInclusive<u32> = 0x2000_0008..=0x2002_0000;

/// Sectors of the program, each with its first address (RM0090 3.3).
const SECTORS: [(u32, u32); 5] = [(3, PROGRAM), (4, 0x0801_0000), (5, 0x0802_0000), (6, 0x0804_0000), (7, 0x0806_0000)];
/// First sector of the stage.
pub const STAGE_SECTOR: u32 = 8;
/// Sectors of the stage.
pub const STAGE_SECTORS: u32 = 4;
/// Bytes of each.
pub const STAGE_SECTOR_LENGTH: u32 = 128 * 1024;

/// Longest program, bytes.
pub const LONGEST: u32 = STAGE - PROGRAM;
/// Words of a header, its own sum among them.
pub const HEADER: usize = 16;
/// Bytes from the begin of an update to the program in it: the header, the marks, and room.
pub const PREFIX: u32 = 128;
/// Where the mark stands that an update is ready to be copied.
pub const READY: u32 = STAGE + 4 * HEADER as u32;
/// Where the mark stands that it was copied.
pub const DONE: u32 = READY + 4;
/// Value of [`READY`].
pub const IS_READY: u32 = 0x4544_4D52;
/// First word of an update: "EDMU".
pub const MAGIC: u32 = u32::from_le_bytes(*b"EDMU");
/// Second word: how the others are to be read.
pub const FORMAT: u32 = 1;
/// What the updates are for: an EDM servo head, as 1018h:2 has it.
pub const PRODUCT: u32 = 1;
/// Bytes of the vector table that are written last: stack pointer and reset vector.
const LAST: u32 = 8;

/// What an update begins with, as words with the least significant byte first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// [`PRODUCT`].
    pub product: u32,
    /// Which board the program is for: the number of its chip, such as 405.
    pub board: u32,
    /// Bytes of the program, whole words.
    pub length: u32,
    /// Sum of the program.
    pub sum: u32,
    /// By which a program knows itself: the sum in its seal, object 1F56h:1.
    pub id: u32,
    /// Version: major in the high half, minor in the low half, as 1018h:3 has it.
    pub version: u32,
    /// Commit that it was built from; 0: unknown.
    pub build: u32,
}

impl Header {
    /// The words before the header's own sum.
    pub fn words(&self) -> [u32; HEADER - 1] {
        let mut words = [u32::MAX; HEADER - 1];
        let known = [MAGIC, FORMAT, self.product, self.board, self.length, self.sum, self.id, self.version, self.build];
        for (word, value) in words.iter_mut().zip(known) {
            *word = value;
        }
        words
    }

    /// The header of an update; `sum` is the sum of all words but the last.
    ///
    /// # Errors
    /// [`Wrong::Format`]: it is none that is known here. [`Wrong::Length`]: no program has this length.
    pub fn read(words: &[u32; HEADER], sum: u32) -> Result<Header, Wrong> {
        let [MAGIC, FORMAT, product, board, length, program, id, version, build, .., own] = *words else {
            return Err(Wrong::Format);
        };
        if own != sum {
            return Err(Wrong::Format);
        }
        if !length.is_multiple_of(4) || length <= LAST || length > LONGEST {
            return Err(Wrong::Length);
        }
        Ok(Header { product, board, length, sum: program, id, version, build })
    }
}

/// Why an update is not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrong {
    /// It begins with no header that is known here.
    Format,
    /// Its length is not that of a program, or not what its header says.
    Length,
    /// It is for another product or board.
    Product,
    /// Its checksum is wrong.
    Sum,
}

/// The flash as boot loader and program see it. An address is a whole word's.
pub trait Flash {
    /// The word at an address.
    fn word(&self, address: u32) -> u32;
    /// Sum over the words from one address up to another: that of the chip's CRC unit (RM0090 section 4: polynomial
    /// 04C11DB7h from FFFFFFFFh, words most significant bit first).
    fn sum(&mut self, from: u32, to: u32) -> u32;
    /// Erases a sector. The processor stands still meanwhile, 0.25 to 2 s. False: it was not done.
    fn erase(&mut self, sector: u32) -> bool;
    /// Programs words, 16 us each; one of all ones is left out. False: it was not done.
    fn write(&mut self, address: u32, words: &[u32]) -> bool;
}

/// The update that is staged, whole and right; marked or not.
///
/// # Errors
/// What is wrong with it. The board is for the caller to look at: a boot loader is the same on each.
pub fn staged(flash: &mut impl Flash) -> Result<Header, Wrong> {
    let own = flash.sum(STAGE, READY - 4);
    let mut words = [0; HEADER];
    for (word, address) in words.iter_mut().zip((STAGE..).step_by(4)) {
        *word = flash.word(address);
    }
    let header = Header::read(&words, own)?;
    if header.product != PRODUCT {
        return Err(Wrong::Product);
    }
    let program = STAGE + PREFIX;
    if flash.sum(program, program + header.length) == header.sum { Ok(header) } else { Err(Wrong::Sum) }
}

/// Marks what is staged as ready to be copied.
pub fn mark(flash: &mut impl Flash) -> bool {
    flash.write(READY, &[IS_READY]) && flash.word(READY) == IS_READY
}

/// Whether an update is marked and has not been copied.
pub fn is_marked(flash: &impl Flash) -> bool {
    // A mark of which a cut of the power has left some bits is copied again, and cleared.
    flash.word(READY) == IS_READY && flash.word(DONE) != 0
}

/// Takes back the mark of an update, and erases one sector of the stage: number 0 to 3. A sector that is erased is left alone.
pub fn clear(flash: &mut impl Flash, number: u32) -> bool {
    // While it is being erased nothing may look like an update that waits.
    if number == 0 && !matches!(flash.word(READY), 0 | u32::MAX) && !flash.write(READY, &[0]) {
        return false;
    }
    let begin = STAGE + number * STAGE_SECTOR_LENGTH;
    let blank = |flash: &_| is_blank(flash, begin, begin + STAGE_SECTOR_LENGTH);
    blank(&*flash) || (flash.erase(STAGE_SECTOR + number) && blank(&*flash))
}

/// Whether the flash is erased from one address up to another.
pub fn is_blank(flash: &impl Flash, from: u32, to: u32) -> bool {
    (from..to).step_by(4).all(|address| flash.word(address) == u32::MAX)
}

/// What comes before the start of the program: copies an update that waits. Whether there is a program to be started.
pub fn prepare(flash: &mut impl Flash) -> bool {
    if is_marked(flash)
        && let Ok(header) = staged(flash)
    {
        let end = PROGRAM + header.length;
        // It may be there: a cut of the power came before its mark was cleared.
        if flash.sum(PROGRAM, end) != header.sum && !(copy(flash, end) && flash.sum(PROGRAM, end) == header.sum) {
            return false;
        }
        // When it cannot be cleared the next start looks again; the program is right.
        flash.write(DONE, &[0]);
    }
    let (stack, reset) = (flash.word(PROGRAM), flash.word(PROGRAM + 4));
    RAM.contains(&stack) && reset & 1 == 1 && (PROGRAM + LAST..STAGE).contains(&reset)
}

/// Copies from the stage to the program, up to an address. What the program is started by comes last.
fn copy(flash: &mut impl Flash, end: u32) -> bool {
    let erased = SECTORS.iter().filter(|(_, begin)| *begin < end).all(|(sector, _)| flash.erase(*sector));
    erased
        && (PROGRAM + LAST..end).step_by(4).all(|address| move_word(flash, address))
        && (PROGRAM..PROGRAM + LAST).step_by(4).rev().all(|address| move_word(flash, address))
}

fn move_word(flash: &mut impl Flash, address: u32) -> bool {
    let word = flash.word(address - PROGRAM + STAGE + PREFIX);
    flash.write(address, &[word])
}

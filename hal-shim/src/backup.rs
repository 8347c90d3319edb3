//! Memory with a supply of its own: it keeps its words over a reset, and while the power is off.

/// Words of the memory.
pub const WORDS: usize = 1024;

/// Such a memory. It has no checksum, and a word is written whole or not at all.
pub trait BackupMemory {
    /// The word at a place below [`WORDS`]: what was written last, or noise where the memory was without any supply.
    fn read(&self, place: usize) -> u32;
    /// Writes a word, before anything that is written afterwards. No effect from [`WORDS`] on.
    fn write(&mut self, place: usize, word: u32);
}

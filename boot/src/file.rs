//! An update as a file, on a PC.

use crate::{FORMAT, HEADER, Header, MAGIC, PREFIX, PRODUCT, Wrong};

/// What the chip's CRC unit makes of words ([`Flash::sum`](crate::Flash::sum)).
pub fn sum(words: impl IntoIterator<Item = u32>) -> u32 {
    words.into_iter().fold(u32::MAX, |sum, word| {
        (0..32).fold(sum ^ word, |sum, _| sum << 1 ^ if sum >> 31 == 1 { 0x04C1_1DB7 } else { 0 })
    })
}

/// The words that bytes are, least significant byte first; what is no whole word is left out.
pub fn words(bytes: &[u8]) -> impl Iterator<Item = u32> + '_ {
    let (words, _) = bytes.as_chunks::<4>();
    words.iter().map(|word| u32::from_le_bytes(*word))
}

/// The header of an update, once the file is whole and its sums are right.
///
/// # Errors
/// Why no head takes it.
pub fn read(file: &[u8]) -> Result<Header, Wrong> {
    let (head, program) = file.split_at_checked(PREFIX as usize).ok_or(Wrong::Format)?;
    let mut known = [0; HEADER];
    for (to, word) in known.iter_mut().zip(words(head)) {
        *to = word;
    }
    if known[..2] != [MAGIC, FORMAT] {
        return Err(Wrong::Format);
    }
    let header = Header::read(&known, sum(known[..HEADER - 1].iter().copied()))?;
    match header {
        Header { product, .. } if product != PRODUCT => Err(Wrong::Product),
        Header { length, .. } if length as usize != program.len() => Err(Wrong::Length),
        Header { sum: right, .. } if right != sum(words(program)) => Err(Wrong::Sum),
        _ => Ok(header),
    }
}

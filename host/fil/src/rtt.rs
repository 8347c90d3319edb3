//! Log messages: the first up channel of Segger RTT in the chip's RAM, decoded by defmt.
//!
//! Reading happens from outside, as a debug probe does it, and costs the chip no time.

use crate::image::Image;
use anyhow::Result;
use defmt_decoder::{DecodeError, Table};
use edm_soc::{Memory, Region};

/// Places in the control block: 16 bytes of id, two counts, then the descriptor of up channel 0.
const BUFFER: u32 = 24 + 4;
const SIZE: u32 = 24 + 8;
const WRITE: u32 = 24 + 12;
const READ: u32 = 24 + 16;

/// Reader of the log channel.
pub struct Rtt {
    block: Option<u32>,
    table: Option<Table>,
    raw: Vec<u8>,
}

impl Rtt {
    /// Reader for the firmware in `image`; it stays silent when the image has no RTT block or no defmt table.
    ///
    /// # Errors
    /// When the image's defmt table is damaged or of another version.
    pub fn new(image: &Image) -> Result<Self> {
        Ok(Self { block: image.symbol("_SEGGER_RTT"), table: Table::parse(image.file())?, raw: Vec::new() })
    }

    /// Takes what the firmware has written and returns the messages that are complete.
    pub fn poll(&mut self, memory: &Memory) -> Vec<String> {
        self.drain(memory);
        let Some(table) = &self.table else { return Vec::new() };
        if !self.raw.contains(&0) {
            return Vec::new();
        }
        let mut decoder = table.new_stream_decoder();
        // Frames end with a zero byte; what follows the last one waits for its end.
        let end = self.raw.iter().rposition(|b| *b == 0).map_or(0, |i| i + 1);
        decoder.received(&self.raw[..end]);
        let mut lines = Vec::new();
        loop {
            match decoder.decode() {
                Ok(frame) => {
                    let level = frame.level().map_or("print", |l| l.as_str());
                    lines.push(format!("{level} {}", frame.display_message()));
                }
                Err(DecodeError::UnexpectedEof) => break,
                Err(DecodeError::Malformed) => lines.push("(a damaged log frame)".into()),
            }
        }
        self.raw.drain(..end);
        lines
    }

    /// Forgets what has begun and not ended: the chip has gone back in time.
    pub fn forget(&mut self) {
        self.raw.clear();
    }

    fn drain(&mut self, memory: &Memory) {
        let Some(block) = self.block else { return };
        let region = memory.ram(block);
        let word = |offset| region.load(block + offset, 4);
        let (Some(buffer), Some(size), Some(write), Some(mut read)) =
            (word(BUFFER), word(SIZE), word(WRITE), word(READ))
        else {
            return;
        };
        // Before the firmware has set the block up it holds whatever RAM held.
        if word(0) != Some(u32::from_le_bytes(*b"SEGG")) || size == 0 || write >= size || read >= size {
            return;
        }
        while read != write {
            let Some(byte) = Region::load(region, buffer + read, 1) else { return };
            self.raw.push(byte as u8);
            read = (read + 1) % size;
        }
        region.store(block + READ, 4, read);
    }
}

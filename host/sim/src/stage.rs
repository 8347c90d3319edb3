//! The stage of a virtual head: memory, with the rules of a flash and none of its time. What is started "runs" in so far as the
//! head says that it does.

use edm_boot::{DONE, file, is_marked};
use edm_hal_shim::board::F405;
use edm_hal_shim::stage::{FLASH_END, Flash, STAGE, Stage, staged};

/// Words of the stage, from its begin on; nothing as long as nobody has written.
#[derive(Debug, Default)]
pub struct Memory {
    words: Vec<u32>,
    id: u32,
}

fn place(address: u32) -> Option<usize> {
    (STAGE..FLASH_END).contains(&address).then(|| (address - STAGE) as usize / 4)
}

impl Flash for Memory {
    fn word(&self, address: u32) -> u32 {
        place(address).and_then(|place| self.words.get(place)).copied().unwrap_or(u32::MAX)
    }

    fn sum(&mut self, from: u32, to: u32) -> u32 {
        file::sum((from..to).step_by(4).map(|address| self.word(address)))
    }

    fn erase(&mut self, sector: u32) -> bool {
        let begin = ((sector - edm_boot::STAGE_SECTOR) * edm_boot::STAGE_SECTOR_LENGTH) as usize / 4;
        let end = (begin + edm_boot::STAGE_SECTOR_LENGTH as usize / 4).min(self.words.len());
        self.words.get_mut(begin..end).into_iter().flatten().for_each(|word| *word = u32::MAX);
        true
    }

    fn write(&mut self, address: u32, words: &[u32]) -> bool {
        let Some(begin) = place(address).filter(|begin| begin + words.len() <= (FLASH_END - STAGE) as usize / 4) else {
            return false;
        };
        if self.words.len() < begin + words.len() {
            self.words.resize(begin + words.len(), u32::MAX);
        }
        self.words[begin..].iter_mut().zip(words).for_each(|(cell, word)| *cell &= word);
        true
    }
}

impl Stage for Memory {
    fn board(&self) -> u32 {
        F405::TABLE.chip()
    }

    fn id(&self) -> u32 {
        self.id
    }

    fn restart(&mut self) {
        if is_marked(self)
            && let Ok(header) = staged(self)
        {
            self.id = header.id;
            self.write(DONE, &[0]);
        }
    }
}

//! Memory with a cell of a virtual head: what it keeps when its power is cut, in a file if the head has one.

use edm_hal_shim::backup::{BackupMemory, WORDS};
use std::cell::{RefCell, RefMut};
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::rc::Rc;

/// The memory; a clone is the same one. It begins without anything in it.
#[derive(Clone, Debug)]
pub struct Battery {
    words: Rc<RefCell<Vec<u32>>>,
    file: Option<Rc<RefCell<File>>>,
}

impl Battery {
    /// What is kept in this file, if there is one: its words, little-endian. One that cannot be had is none.
    pub fn new(path: Option<&Path>) -> Battery {
        let (mut words, mut bytes) = (vec![0; WORDS], Vec::new());
        let open = |path| OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path);
        let mut file = path.and_then(|path| open(path).inspect_err(|error| complain(path, error)).ok());
        if let (Some(file), Some(path)) = (&mut file, path)
            && let Err(error) = file.read_to_end(&mut bytes)
        {
            complain(path, &error);
        }
        bytes.as_chunks::<4>().0.iter().zip(&mut words).for_each(|(bytes, word)| *word = u32::from_le_bytes(*bytes));
        Battery { words: Rc::new(RefCell::new(words)), file: file.map(|file| Rc::new(RefCell::new(file))) }
    }

    /// The words, for a test to damage them.
    pub fn words(&self) -> RefMut<'_, Vec<u32>> {
        self.words.borrow_mut()
    }
}

fn complain(path: &Path, error: &std::io::Error) {
    eprintln!("{}: {error}", path.display());
}

impl BackupMemory for Battery {
    fn read(&self, place: usize) -> u32 {
        self.words.borrow().get(place).copied().unwrap_or(0)
    }

    fn write(&mut self, place: usize, word: u32) {
        let mut words = self.words.borrow_mut();
        if let Some(slot) = words.get_mut(place) {
            *slot = word;
        }
        // The word that ends a copy is not 0, and the first one.
        if let (Some(file), true) = (&self.file, word != 0 && place.is_multiple_of(edm_servo_head::backup::COPY)) {
            let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
            // In its place: a program that ends meanwhile leaves one of the copies.
            let mut file = file.borrow_mut();
            if let Err(error) = file.seek(SeekFrom::Start(0)).and_then(|_| file.write_all(&bytes)) {
                eprintln!("what is kept over a power cut: {error}");
            }
        }
    }
}

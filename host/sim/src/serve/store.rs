//! What a virtual head keeps when its power is cut: a file that is replaced whole or not at all.
//!
//! The file holds two images, each behind its length (32 bits, little-endian): application, communication. An image of no
//! length is none. What an image means, and whether it is fit to run, is the affair of drive and node.

use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// What is stored.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stored {
    /// Settings and profile of the drive.
    pub application: Option<Vec<u8>>,
    /// Communication parameters of the node.
    pub communication: Option<Vec<u8>>,
}

/// The store of one head; without a folder it forgets with the program.
#[derive(Debug)]
pub enum Store {
    /// Kept as long as the program runs.
    Memory(Stored),
    /// Kept in this file.
    File(PathBuf),
}

impl Store {
    /// The store of node `id` in a folder, if there is one.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn new(folder: Option<&Path>, id: u8) -> Result<Store, String> {
        let Some(folder) = folder else { return Ok(Store::Memory(Stored::default())) };
        fs::create_dir_all(folder).map_err(|error| format!("--store {}: cannot be made: {error}", folder.display()))?;
        Ok(Store::File(folder.join(format!("node-{id}.stored"))))
    }

    /// What was stored last; nothing where nothing ever was.
    ///
    /// # Errors
    /// When the file cannot be read or is damaged.
    pub fn load(&self) -> io::Result<Stored> {
        match self {
            Store::Memory(stored) => Ok(stored.clone()),
            Store::File(path) => match fs::read(path) {
                Ok(bytes) => Stored::from_bytes(&bytes)
                    .ok_or_else(|| io::Error::other(format!("{}: damaged, and not used", path.display()))),
                Err(error) if error.kind() == ErrorKind::NotFound => Ok(Stored::default()),
                Err(error) => Err(error),
            },
        }
    }

    /// Stores this instead of what was stored last.
    ///
    /// # Errors
    /// When the file cannot be written; the last one is still there.
    pub fn save(&mut self, stored: &Stored) -> io::Result<()> {
        match self {
            Store::Memory(kept) => kept.clone_from(stored),
            Store::File(path) => {
                let folder = path.parent().unwrap_or(Path::new("."));
                let mut file = tempfile::NamedTempFile::new_in(folder)?;
                file.write_all(&stored.bytes())?;
                file.as_file().sync_all()?;
                file.persist(path)?;
            }
        }
        Ok(())
    }
}

impl Stored {
    fn bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        for image in [&self.application, &self.communication] {
            let image = image.as_deref().unwrap_or_default();
            bytes.extend((image.len() as u32).to_le_bytes());
            bytes.extend(image);
        }
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Option<Stored> {
        let image = |bytes: &[u8]| {
            let (length, rest) = bytes.split_first_chunk()?;
            let (image, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
            Some(((!image.is_empty()).then(|| image.to_vec()), rest.to_vec()))
        };
        let (application, rest) = image(bytes)?;
        let (communication, rest) = image(&rest)?;
        rest.is_empty().then_some(Stored { application, communication })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stored(application: &[u8], communication: Option<&[u8]>) -> Stored {
        Stored { application: Some(application.to_vec()), communication: communication.map(<[u8]>::to_vec) }
    }

    #[test]
    fn what_was_stored_last_is_there_also_for_the_next_program() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("new");
        for (mut store, again) in [
            (Store::new(None, 7).unwrap(), None),
            (Store::new(Some(&inside), 7).unwrap(), Some(Store::new(Some(&inside), 7).unwrap())),
        ] {
            assert_eq!(store.load().unwrap(), Stored::default());
            for newest in [stored(b"one", None), stored(b"two", Some(b"three")), Stored::default()] {
                store.save(&newest).unwrap();
                for store in again.iter().chain([&store]) {
                    assert_eq!(store.load().unwrap(), newest);
                }
            }
        }
        assert_eq!(fs::read_dir(&inside).unwrap().count(), 1, "nothing else is left");
    }

    #[test]
    fn nodes_have_stores_of_their_own_and_a_save_that_fails_loses_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut seven = Store::new(Some(folder.path()), 7).unwrap();
        seven.save(&stored(b"seven", None)).unwrap();
        assert_eq!(Store::new(Some(folder.path()), 8).unwrap().load().unwrap(), Stored::default());
        let mut gone = Store::File(folder.path().join("missing").join("node-7.stored"));
        assert!(gone.save(&stored(b"eight", None)).is_err());
        assert_eq!(seven.load().unwrap(), stored(b"seven", None));
    }

    #[test]
    fn a_damaged_file_is_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::new(Some(folder.path()), 7).unwrap();
        store.save(&stored(b"seven", Some(b"eight"))).unwrap();
        let path = folder.path().join("node-7.stored");
        let whole = fs::read(&path).unwrap();
        for length in 0..whole.len() {
            fs::write(&path, &whole[..length]).unwrap();
            assert!(store.load().is_err(), "{length}");
        }
        fs::write(&path, [&whole[..], b"x"].concat()).unwrap();
        assert!(store.load().is_err());
    }
}

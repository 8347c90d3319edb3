//! What a virtual head keeps when its power is cut: a file that is replaced whole or not at all.

use edm_servo_head::canopen::drive::Kept;
use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// The store of one head; without a folder it forgets with the program.
#[derive(Debug)]
pub enum Store {
    /// Kept as long as the program runs.
    Memory(Box<Kept>),
    /// Kept in this file.
    File(PathBuf),
}

impl Store {
    /// The store of node `id` in a folder, if there is one.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn new(folder: Option<&Path>, id: u8) -> Result<Store, String> {
        let Some(folder) = folder else { return Ok(Store::Memory(Box::new(Kept::NOTHING))) };
        fs::create_dir_all(folder).map_err(|error| format!("--store {}: cannot be made: {error}", folder.display()))?;
        Ok(Store::File(folder.join(format!("node-{id}.stored"))))
    }

    /// What was stored last; nothing where nothing ever was.
    ///
    /// # Errors
    /// When the file cannot be read or is damaged.
    pub fn load(&self) -> io::Result<Kept> {
        match self {
            Store::Memory(stored) => Ok((**stored).clone()),
            Store::File(path) => match fs::read(path) {
                Ok(bytes) => Kept::from_bytes(&bytes)
                    .ok_or_else(|| io::Error::other(format!("{}: damaged, and not used", path.display()))),
                Err(error) if error.kind() == ErrorKind::NotFound => Ok(Kept::NOTHING),
                Err(error) => Err(error),
            },
        }
    }

    /// Stores this instead of what was stored last.
    ///
    /// # Errors
    /// When the file cannot be written; the last one is still there.
    pub fn save(&mut self, stored: &Kept) -> io::Result<()> {
        match self {
            Store::Memory(kept) => kept.as_mut().clone_from(stored),
            Store::File(path) => {
                let folder = path.parent().unwrap_or(Path::new("."));
                let mut file = tempfile::NamedTempFile::new_in(folder)?;
                file.write_all(stored.bytes())?;
                file.as_file().sync_all()?;
                file.persist(path)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Something that was stored.
    fn stored(first: u8) -> Kept {
        let mut bytes = *Kept::NOTHING.bytes();
        bytes[0] = 1;
        bytes[1] = first;
        Kept::from_bytes(&bytes).unwrap()
    }

    #[test]
    fn what_was_stored_last_is_there_also_for_the_next_program() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("new");
        for (mut store, again) in [
            (Store::new(None, 7).unwrap(), None),
            (Store::new(Some(&inside), 7).unwrap(), Some(Store::new(Some(&inside), 7).unwrap())),
        ] {
            assert_eq!(store.load().unwrap(), Kept::NOTHING);
            for newest in [stored(1), stored(2), Kept::NOTHING] {
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
        seven.save(&stored(7)).unwrap();
        assert_eq!(Store::new(Some(folder.path()), 8).unwrap().load().unwrap(), Kept::NOTHING);
        let mut gone = Store::File(folder.path().join("missing").join("node-7.stored"));
        assert!(gone.save(&stored(8)).is_err());
        assert_eq!(seven.load().unwrap(), stored(7));
    }

    #[test]
    fn a_damaged_file_is_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::new(Some(folder.path()), 7).unwrap();
        store.save(&stored(7)).unwrap();
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

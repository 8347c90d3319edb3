//! What a virtual head keeps when its power is cut: a file that is replaced whole or not at all.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// The store of one head; without a folder it forgets with its power.
#[derive(Debug)]
pub enum Store {
    /// Kept as long as the program runs.
    Memory(Option<Vec<u8>>),
    /// Kept in this file.
    File(PathBuf),
}

impl Store {
    /// The store of node `id` in a folder, if there is one.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn new(folder: Option<&Path>, id: u8) -> Result<Store, String> {
        let Some(folder) = folder else { return Ok(Store::Memory(None)) };
        fs::create_dir_all(folder).map_err(|error| format!("--store {}: cannot be made: {error}", folder.display()))?;
        Ok(Store::File(folder.join(format!("node-{id}.stored"))))
    }

    /// What was stored last.
    pub fn load(&self) -> Option<Vec<u8>> {
        match self {
            Store::Memory(image) => image.clone(),
            Store::File(path) => fs::read(path).ok(),
        }
    }

    /// Stores an image instead of the last one.
    ///
    /// # Errors
    /// When the file cannot be written; the last one is still there.
    pub fn save(&mut self, image: &[u8]) -> io::Result<()> {
        match self {
            Store::Memory(kept) => *kept = Some(image.to_vec()),
            Store::File(path) => {
                let folder = path.parent().unwrap_or(Path::new("."));
                let mut file = tempfile::NamedTempFile::new_in(folder)?;
                file.write_all(image)?;
                file.as_file().sync_all()?;
                file.persist(path)?;
            }
        }
        Ok(())
    }

    /// Forgets.
    ///
    /// # Errors
    /// When the file cannot be removed.
    pub fn clear(&mut self) -> io::Result<()> {
        match self {
            Store::Memory(image) => *image = None,
            Store::File(path) if path.exists() => fs::remove_file(path)?,
            Store::File(_) => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_stored_last_is_there_and_then_forgotten() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("new");
        for (mut store, again) in [
            (Store::new(None, 7).unwrap(), None),
            (Store::new(Some(&inside), 7).unwrap(), Some(Store::new(Some(&inside), 7).unwrap())),
        ] {
            assert_eq!(store.load(), None);
            store.save(b"one").unwrap();
            store.save(b"two").unwrap();
            for store in again.iter().chain([&store]) {
                assert_eq!(store.load().as_deref(), Some(&b"two"[..]));
            }
            store.clear().unwrap();
            store.clear().unwrap();
            assert_eq!(store.load(), None);
        }
        assert_eq!(fs::read_dir(&inside).unwrap().count(), 0, "nothing else is left");
    }

    #[test]
    fn nodes_have_stores_of_their_own_and_a_save_that_fails_loses_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut seven = Store::new(Some(folder.path()), 7).unwrap();
        seven.save(b"seven").unwrap();
        assert_eq!(Store::new(Some(folder.path()), 8).unwrap().load(), None);
        let missing = folder.path().join("missing");
        let mut gone = Store::File(missing.join("node-7.stored"));
        assert!(gone.save(b"eight").is_err());
        assert_eq!(seven.load().as_deref(), Some(&b"seven"[..]));
    }
}

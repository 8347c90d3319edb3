//! What a virtual head keeps when its power is cut: a file that is replaced whole or not at all. Its bytes are those that a
//! chip has in its flash ([`edm_servo_head::stored`]), checksum included.

use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// The store of one head; without a folder it forgets with the program.
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

    /// The image that was stored last; `None` where none ever was.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn load(&self) -> io::Result<Option<Vec<u8>>> {
        match self {
            Store::Memory(image) => Ok(image.clone()),
            Store::File(path) => match fs::read(path) {
                Ok(image) => Ok(Some(image)),
                Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
                Err(error) => Err(io::Error::new(error.kind(), format!("{}: {error}", path.display()))),
            },
        }
    }

    /// Stores this image instead of the last one.
    ///
    /// # Errors
    /// When the file cannot be written; the last image is still there.
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_stored_last_is_there_also_for_the_next_program() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("new");
        for (mut store, again) in [
            (Store::new(None, 7).unwrap(), None),
            (Store::new(Some(&inside), 7).unwrap(), Some(Store::new(Some(&inside), 7).unwrap())),
        ] {
            assert_eq!(store.load().unwrap(), None);
            for newest in [&b"one"[..], b"another", b""] {
                store.save(newest).unwrap();
                for store in again.iter().chain([&store]) {
                    assert_eq!(store.load().unwrap().unwrap(), newest);
                }
            }
        }
        assert_eq!(fs::read_dir(&inside).unwrap().count(), 1, "nothing else is left");
    }

    #[test]
    fn nodes_have_stores_of_their_own_and_a_save_that_fails_loses_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut seven = Store::new(Some(folder.path()), 7).unwrap();
        seven.save(b"seven").unwrap();
        assert_eq!(Store::new(Some(folder.path()), 8).unwrap().load().unwrap(), None);
        let mut gone = Store::File(folder.path().join("missing").join("node-7.stored"));
        assert!(gone.save(b"eight").is_err());
        assert_eq!(seven.load().unwrap().unwrap(), b"seven");
    }

    #[test]
    fn a_file_that_cannot_be_read_is_no_empty_store() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("node-7.stored")).unwrap();
        assert!(Store::new(Some(folder.path()), 7).unwrap().load().is_err());
    }
}

//! Stored settings of a virtual head: a file that is replaced whole or not at all. Its bytes are those that a
//! chip has in its flash ([`edm_servo_head::stored`]), checksum included.

use crate::battery::Battery;
use edm_hal_shim::store::{BUFFER, Loaded, Storage};
use edm_servo_head::head::WritePermit;
use std::cell::RefCell;
use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// The store of one head; without a folder it forgets with the program.
#[derive(Clone, Debug)]
pub enum Store {
    /// Kept as long as the program runs; a clone is the same one.
    Memory(Rc<RefCell<Option<Vec<u8>>>>),
    /// Kept in this file.
    File(PathBuf),
}

impl Store {
    /// The store of this name in a folder, if there is one.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn new(folder: Option<&Path>, name: &str) -> Result<Store, String> {
        let Some(folder) = folder else { return Ok(Store::memory(None)) };
        fs::create_dir_all(folder).map_err(|error| format!("--store {}: cannot be made: {error}", folder.display()))?;
        Ok(Store::File(folder.join(format!("{name}.stored"))))
    }

    /// A store that forgets with the program, with an image in it or none.
    pub fn memory(image: Option<Vec<u8>>) -> Store {
        Store::Memory(Rc::new(RefCell::new(image)))
    }

    /// The memory with a cell of the same head.
    pub fn battery(&self) -> Battery {
        match self {
            Store::Memory(_) => Battery::new(None),
            Store::File(path) => Battery::new(Some(&path.with_extension("kept"))),
        }
    }

    fn read(&self) -> Result<Option<Vec<u8>>, String> {
        match self {
            Store::Memory(image) => Ok(image.borrow().clone()),
            Store::File(path) => match fs::read(path) {
                Ok(image) => Ok(Some(image)),
                Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
                Err(error) => Err(format!("{}: {error}", path.display())),
            },
        }
    }
}

impl Storage<WritePermit> for Store {
    type Error = String;

    fn load<'b>(&mut self, buffer: &'b mut [u8; BUFFER]) -> Result<Loaded<'b>, String> {
        let Some(image) = self.read()? else { return Ok(Loaded::Nothing) };
        let place = buffer.get_mut(..image.len()).ok_or("longer than an image can be")?;
        place.copy_from_slice(&image);
        Ok(Loaded::Newest(place))
    }

    fn save(&mut self, image: &[u8], _: &mut [u8; BUFFER], _: &WritePermit) -> Result<(), String> {
        let path = match self {
            Store::Memory(kept) => {
                *kept.borrow_mut() = Some(image.to_vec());
                return Ok(());
            }
            Store::File(path) => path,
        };
        let failed = |error: std::io::Error| format!("{}: {error}", path.display());
        let mut file = tempfile::NamedTempFile::new_in(path.parent().unwrap_or(Path::new("."))).map_err(failed)?;
        file.write_all(image).and_then(|()| file.as_file().sync_all()).map_err(failed)?;
        file.persist(&path).map_err(|error| failed(error.error))?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_servo_head::head::Head;
    use edm_servo_head::path::Path as Register;
    use edm_servo_head::settings::Settings;

    fn save(store: &mut Store, image: &[u8]) -> Result<(), String> {
        let active = Settings::default().build().unwrap();
        let permit = Head::new(active.head, Box::new(Register::EMPTY)).permit_write().unwrap();
        store.save(image, &mut [0; BUFFER], &permit)
    }

    fn load(store: &mut Store) -> Result<Option<Vec<u8>>, String> {
        store.load(&mut [0; BUFFER]).map(|loaded| loaded.image().map(<[u8]>::to_vec))
    }

    #[test]
    fn what_was_stored_last_is_there_also_for_the_next_program() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("new");
        for (mut store, again) in [
            (Store::new(None, "node-7").unwrap(), None),
            (Store::new(Some(&inside), "node-7").unwrap(), Some(Store::new(Some(&inside), "node-7").unwrap())),
        ] {
            assert_eq!(load(&mut store).unwrap(), None);
            let mut again = again;
            for newest in [&b"first"[..], b"second", b""] {
                save(&mut store, newest).unwrap();
                for store in again.iter_mut().chain([&mut store]) {
                    assert_eq!(load(store).unwrap().unwrap(), newest);
                }
            }
        }
        assert_eq!(fs::read_dir(&inside).unwrap().count(), 1, "nothing else is left");
    }

    #[test]
    fn nodes_have_stores_of_their_own_and_a_save_that_fails_loses_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut seven = Store::new(Some(folder.path()), "node-7").unwrap();
        save(&mut seven, b"seven").unwrap();
        assert_eq!(load(&mut Store::new(Some(folder.path()), "node-8").unwrap()).unwrap(), None);
        let mut gone = Store::File(folder.path().join("missing").join("node-7.stored"));
        assert!(save(&mut gone, b"eight").is_err());
        assert_eq!(load(&mut seven).unwrap().unwrap(), b"seven");
    }

    #[test]
    fn a_file_longer_than_an_image_can_be_is_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::new(Some(folder.path()), "node-7").unwrap();
        fs::write(folder.path().join("node-7.stored"), [0; BUFFER]).unwrap();
        assert!(load(&mut store).is_ok());
        fs::write(folder.path().join("node-7.stored"), [0; BUFFER + 1]).unwrap();
        assert!(load(&mut store).is_err());
    }
}

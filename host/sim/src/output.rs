//! Files that appear complete or not at all.
//!
//! An output is claimed before the run: the claim shows that the file can be written and leaves nothing behind. It is
//! written next to its place under a temporary name and renamed at the end, so that an interrupted run leaves no half file
//! and an older file lives until its successor is whole.

use serde::Serialize;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A file that was claimed and not yet written.
#[derive(Debug)]
pub struct Output {
    label: String,
    target: PathBuf,
    folder: PathBuf,
    /// A pipe or a device: written to directly, never replaced.
    special: bool,
}

impl Output {
    /// Claims `path` for the option that names it; the error is one line that names both.
    pub fn claim(option: &str, path: &Path) -> Result<Output, String> {
        let label = format!("{option} {}", path.display());
        let refused = |reason: &dyn std::fmt::Display| format!("{label}: must be a file that can be written: {reason}");
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let folder = fs::canonicalize(folder).map_err(|error| refused(&format!("{}: {error}", folder.display())))?;
        let name = path.file_name().ok_or_else(|| refused(&"it has no name"))?;
        let target = fs::canonicalize(path).unwrap_or_else(|_| folder.join(name));
        let special = match fs::metadata(&target) {
            Ok(found) if found.is_dir() => return Err(refused(&"it is a folder")),
            Ok(found) if found.is_file() => {
                OpenOptions::new().append(true).open(&target).map_err(|error| refused(&error))?;
                false
            }
            Ok(_) => true,
            Err(_) => {
                File::create_new(&target).and_then(|_| fs::remove_file(&target)).map_err(|error| refused(&error))?;
                false
            }
        };
        let folder = target.parent().map_or(folder, Path::to_path_buf);
        if !special {
            tempfile::tempfile_in(&folder).map_err(|error| refused(&error))?;
        }
        Ok(Output { label, target, folder, special })
    }

    /// Claims the file of an option, where one is given.
    pub fn claim_any(option: &str, path: Option<&Path>) -> Result<Option<Output>, String> {
        path.map(|path| Output::claim(option, path)).transpose()
    }

    /// Whether this output would replace that file.
    pub fn replaces(&self, path: &Path) -> bool {
        fs::canonicalize(path).is_ok_and(|path| path == self.target)
    }

    /// Whether both outputs are the same file.
    pub fn collides(&self, other: &Output) -> bool {
        self.target == other.target
    }

    /// The file itself.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Option and path, as given.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// A file without a name on the same disk, gone when it is closed, whatever happens.
    pub fn scratch(&self) -> Result<File, String> {
        let folder = if self.special { std::env::temp_dir() } else { self.folder.clone() };
        tempfile::tempfile_in(folder).map_err(|error| self.failed(&error))
    }

    /// Writes the file and puts it in its place.
    pub fn write(self, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), String> {
        self.try_write(fill).map_err(|error| self.failed(&error))
    }

    /// Writes a value as JSON.
    pub fn write_json(self, value: &impl Serialize) -> Result<(), String> {
        self.write(|file| {
            serde_json::to_writer_pretty(&mut *file, value)?;
            file.write_all(b"\n")
        })
    }

    fn try_write(&self, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
        if self.special {
            let mut file = BufWriter::new(OpenOptions::new().write(true).open(&self.target)?);
            fill(&mut file)?;
            return file.flush();
        }
        let temporary = self.temporary()?;
        let mut file = BufWriter::new(temporary);
        fill(&mut file)?;
        let temporary = file.into_inner()?;
        temporary.persist(&self.target)?;
        Ok(())
    }

    /// With the rights a plain new file gets, not the private ones of a temporary file.
    fn temporary(&self) -> io::Result<NamedTempFile> {
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        builder.tempfile_in(&self.folder)
    }

    fn failed(&self, error: &io::Error) -> String {
        format!("{}: could not be written: {error}", self.label)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::ffi::OsString;

    fn listing(folder: &Path) -> BTreeSet<OsString> {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect()
    }

    #[test]
    fn a_claim_leaves_nothing_and_a_written_file_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let output = Output::claim("--json", &path).unwrap();
        assert_eq!(listing(folder.path()).len(), 0);
        output.write(|file| file.write_all(b"whole")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        assert_eq!(listing(folder.path()).len(), 1);
    }

    #[test]
    fn a_failed_write_leaves_the_older_file_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        fs::write(&path, "old").unwrap();
        let output = Output::claim("--json", &path).unwrap();
        let error = output
            .write(|file| {
                file.write_all(b"half")?;
                Err(io::Error::other("disk full"))
            })
            .unwrap_err();
        assert!(error.contains("a.json: could not be written: disk full"), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(listing(folder.path()).len(), 1);
    }

    #[test]
    fn a_place_that_cannot_be_written_is_refused_with_its_option_and_path() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("file"), "").unwrap();
        let before = listing(folder.path());
        for path in [folder.path().join("nowhere/a.json"), folder.path().join("file/a.json"), folder.path().into()] {
            let error = Output::claim("--json", &path).unwrap_err();
            let label = format!("--json {}: must be a file that can be written: ", path.display());
            assert!(error.starts_with(&label), "{error}");
        }
        assert_eq!(listing(folder.path()), before);
    }

    #[test]
    fn one_file_by_two_names_is_one_file() {
        let folder = tempfile::tempdir().unwrap();
        let plain = Output::claim("--json", &folder.path().join("a")).unwrap();
        let detour = Output::claim("--plot", &folder.path().join("./a")).unwrap();
        let other = Output::claim("--plot", &folder.path().join("b")).unwrap();
        assert!(plain.collides(&detour));
        assert!(!plain.collides(&other));
        fs::write(folder.path().join("a"), "").unwrap();
        assert!(plain.replaces(&folder.path().join("a")));
        assert!(!other.replaces(&folder.path().join("a")));
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_written_to_and_not_replaced() {
        let output = Output::claim("--json", Path::new("/dev/null")).unwrap();
        output.write(|file| file.write_all(b"gone")).unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
    }

    #[cfg(unix)]
    #[test]
    fn a_written_file_has_the_rights_of_any_other_new_file() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        fs::write(folder.path().join("plain"), "").unwrap();
        Output::claim("--json", &path).unwrap().write(|_| Ok(())).unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&path), mode(&folder.path().join("plain")));
    }
}

//! A page of the project with a section that a command writes, between two marks that name the command.

use crate::output::Output;
use std::path::{Path, PathBuf};

/// A page, taken apart at the marks.
#[derive(Debug)]
pub struct Page {
    path: PathBuf,
    /// With the mark that begins the section.
    before: String,
    section: String,
    /// With the mark that ends it.
    after: String,
}

/// A file of the project that the current directory is in.
///
/// # Errors
/// When neither that nor a directory above it has the file.
pub fn in_project(file: &Path) -> Result<PathBuf, String> {
    let here = std::env::current_dir().map_err(|error| error.to_string())?;
    let found = here.ancestors().map(|folder| folder.join(file)).find(|path| path.exists());
    found.ok_or_else(|| {
        format!("no {} in {} or above it: run the command inside the project", file.display(), here.display())
    })
}

impl Page {
    /// Reads a page that has a section of this command.
    ///
    /// # Errors
    /// When it cannot be read, or has no such section.
    pub fn read(path: &Path, command: &str) -> Result<Page, String> {
        let text = std::fs::read_to_string(path)
            .map_err(|error| format!("--page: cannot read {}: {error}", path.display()))?;
        let begin = format!("<!-- {command} writes this section -->\n");
        let end = format!("<!-- end of what {command} writes -->\n");
        let parts = text.split_once(&begin).and_then(|(before, rest)| Some((before, rest.split_once(&end)?)));
        let Some((before, (section, after))) = parts else {
            return Err(format!("--page: {} has no section of `{command}`", path.display()));
        };
        Ok(Page {
            path: path.to_owned(),
            before: format!("{before}{begin}"),
            section: section.to_owned(),
            after: format!("{end}{after}"),
        })
    }

    /// Reads and claims a page of the project that the current directory is in.
    ///
    /// # Errors
    /// When it is not there, has no such section, or cannot be written.
    pub fn of_project(file: &str, command: &str) -> Result<(Page, Output), String> {
        Page::claimed(&in_project(Path::new(file))?, command)
    }

    /// Reads and claims a page.
    ///
    /// # Errors
    /// When it has no such section, or cannot be written.
    pub fn claimed(path: &Path, command: &str) -> Result<(Page, Output), String> {
        let page = Page::read(path, command)?;
        let output = page.claim()?;
        Ok((page, output))
    }

    /// What the section says.
    pub fn section(&self) -> &str {
        &self.section
    }

    /// Claims the page for writing.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn claim(&self) -> Result<Output, String> {
        Output::claim("--page", &self.path)
    }

    /// Replaces the section.
    ///
    /// # Errors
    /// When the page cannot be written.
    pub fn write(&self, output: Output, section: &str) -> Result<(), String> {
        output
            .write(|to| [&self.before, section, &self.after].iter().try_for_each(|part| to.write_all(part.as_bytes())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str = "a\n<!-- cargo x writes this section -->\nold\n<!-- end of what cargo x writes -->\nb\n";

    #[test]
    fn a_section_is_replaced_and_the_rest_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("page.md");
        std::fs::write(&path, PAGE).unwrap();
        let page = Page::read(&path, "cargo x").unwrap();
        assert_eq!(page.section(), "old\n");
        page.write(page.claim().unwrap(), "new\n").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), PAGE.replace("old", "new"));
    }

    #[test]
    fn a_page_without_a_section_of_the_command_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("page.md");
        assert!(Page::read(&path, "cargo x").unwrap_err().contains("cannot read"));
        std::fs::write(&path, PAGE).unwrap();
        assert!(Page::read(&path, "cargo y").unwrap_err().contains("has no section of `cargo y`"));
    }
}

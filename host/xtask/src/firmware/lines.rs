//! What the debug information says: which source an instruction comes from.

use addr2line::gimli::{self, EndianSlice, LittleEndian};
use addr2line::{Context, LookupResult};
use object::{Object, ObjectSection};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The debug information of an image.
fn dwarf<'d>(file: &object::File<'d>) -> Result<gimli::Dwarf<EndianSlice<'d, LittleEndian>>, gimli::Error> {
    gimli::Dwarf::load(|id| {
        let data = file.section_by_name(id.name()).and_then(|section| section.data().ok());
        Ok(EndianSlice::new(data.unwrap_or(&[]), LittleEndian))
    })
}

/// Where in the source an instruction is: the line, and those of the calls that were put in line around it.
pub fn place(root: &Path, file: &object::File, address: u32) -> String {
    let lines = || -> Result<Vec<String>, gimli::Error> {
        let context = Context::from_dwarf(dwarf(file)?)?;
        let mut found = context.find_frames(address.into());
        let mut frames = loop {
            match found {
                LookupResult::Output(frames) => break frames?,
                // Split debug information is not used.
                LookupResult::Load { continuation, .. } => {
                    found = addr2line::LookupContinuation::resume(continuation, None);
                }
            }
        };
        let mut lines = Vec::new();
        while let Some(frame) = frames.next()? {
            let location = frame.location.and_then(|at| Some((at.file?, at.line?)));
            lines.extend(location.map(|(file, line)| format!("{}:{line}", relative(root, file))));
        }
        Ok(lines)
    };
    format!("at {address:#010x}: {}", lines().unwrap_or_default().join(" in "))
}

/// A source file relative to the workspace, to the libraries or to the compiler.
fn relative<'p>(root: &Path, path: &'p str) -> &'p str {
    let libraries = ["/registry/src/", "/rustc/"].iter().find_map(|mark| path.split_once(mark)?.1.split_once('/'));
    let here = Path::new(path).strip_prefix(root).ok().and_then(Path::to_str);
    libraries.map(|(_, path)| path).or(here).unwrap_or(path)
}

/// Bytes of code by room, from the line table.
pub fn rooms(file: &object::File) -> Result<BTreeMap<String, u64>, gimli::Error> {
    let dwarf = dwarf(file)?;
    let mut sizes = BTreeMap::new();
    let mut units = dwarf.units();
    while let Some(header) = units.next()? {
        let unit = dwarf.unit(header)?;
        let Some(program) = unit.line_program.clone() else { continue };
        let mut rows = program.rows();
        let mut before: Option<(u64, String)> = None;
        while let Some((header, row)) = rows.next_row()? {
            if let Some((address, room)) = before.take()
                && (super::PROGRAM..super::FLASH.end).contains(&address)
            {
                *sizes.entry(room).or_insert(0) += row.address().saturating_sub(address);
            }
            if row.end_sequence() {
                continue;
            }
            // Each part is relative to the one before, unless it is absolute.
            let mut path =
                PathBuf::from(unit.comp_dir.map_or_else(String::new, |dir| dir.to_string_lossy().into_owned()));
            if let Some(file) = row.file(header) {
                if let Some(folder) = file.directory(header) {
                    path.push(&*dwarf.attr_string(&unit, folder)?.to_string_lossy());
                }
                path.push(&*dwarf.attr_string(&unit, file.path_name())?.to_string_lossy());
            }
            before = Some((row.address(), room(&path.to_string_lossy())));
        }
    }
    Ok(sizes)
}

/// The room, or the library, that a source file belongs to.
fn room(path: &str) -> String {
    if let Some((_, library)) = path.split_once("/registry/src/") {
        let name = library.split('/').nth(1).unwrap_or("?");
        // Without the version.
        return name.rsplit_once('-').map_or(name, |(name, _)| name).to_owned();
    }
    if path.contains("/rustc/") || path.contains("/library/") {
        return "core".to_owned();
    }
    if let Some((_, shim)) = path.split_once("hal-shim/src/") {
        return format!("hal-shim/{}", shim.split('/').next().unwrap_or_default().trim_end_matches(".rs"));
    }
    if path.contains("hal-shim/store/src/") {
        return "hal-shim/store".to_owned();
    }
    for package in ["canopen", "crossing", "firmware", "runtime"] {
        if path.contains(&format!("{package}/src/")) {
            return package.to_owned();
        }
    }
    match path.rsplit_once("src/") {
        Some((_, file)) => format!("src/{}", file.split('/').next().unwrap_or_default().trim_end_matches(".rs")),
        None => "?".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_named_without_the_folders_of_the_machine() {
        let named = |path| relative(Path::new("/home/me/head"), path);
        assert_eq!(named("/home/me/head/src/path/register.rs"), "src/path/register.rs");
        assert_eq!(
            named("/home/me/.cargo/registry/src/a-registry-1949/rtic-2.4.0/src/lib.rs"),
            "rtic-2.4.0/src/lib.rs"
        );
        assert_eq!(named("/rustc/0123/library/core/src/fmt/mod.rs"), "library/core/src/fmt/mod.rs");
        assert_eq!(named("/elsewhere/a.rs"), "/elsewhere/a.rs");
    }

    #[test]
    fn a_source_file_belongs_to_its_room_or_library() {
        assert_eq!(room("/home/me/head/src/path/register.rs"), "src/path");
        assert_eq!(room("src/main.rs"), "src/main");
        assert_eq!(room("/home/me/head/hal-shim/src/stm32f4/pwm.rs"), "hal-shim/stm32f4");
        assert_eq!(room("/home/me/head/hal-shim/store/src/sector.rs"), "hal-shim/store");
        assert_eq!(room("/home/me/head/canopen/src/sdo/crc.rs"), "canopen");
        assert_eq!(room("/home/me/head/src/canopen/eds.rs"), "src/canopen");
        assert_eq!(room("/home/me/.cargo/registry/src/a-registry-1949/defmt-rtt-1.3.1/src/lib.rs"), "defmt-rtt");
        assert_eq!(room("/rustc/0123/library/core/src/fmt/mod.rs"), "core");
    }
}

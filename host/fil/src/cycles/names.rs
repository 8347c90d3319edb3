//! Names for numbers: tasks from the vector table and the firmware's task table, functions and fields from DWARF.

use crate::image::Image;
use addr2line::{Context, LookupResult, demangle_auto};
use anyhow::{Context as _, Result, anyhow};
use edm_hal_shim::board::TASKS;
use edm_hal_shim::seal::PROGRAM;
use edm_soc::Exception;
use gimli::{EndianArcSlice, LittleEndian, Reader as _};
use object::{Object, ObjectSection};
use std::collections::BTreeMap;
use std::sync::Arc;

type Reader = EndianArcSlice<LittleEndian>;

/// The debug information of an image.
pub struct Debug {
    context: Context<Reader>,
    /// Symbols by address: assembly has no debug information.
    symbols: BTreeMap<u32, String>,
}

fn sections(file: &[u8]) -> Result<gimli::Dwarf<Reader>> {
    let object = object::File::parse(file)?;
    let load = |id: gimli::SectionId| -> Result<Reader> {
        let data = object.section_by_name(id.name()).and_then(|s| s.data().ok()).unwrap_or(&[]);
        Ok(EndianArcSlice::new(Arc::from(data), LittleEndian))
    };
    gimli::Dwarf::load(load)
}

impl Debug {
    /// Reads the debug information.
    ///
    /// # Errors
    /// When it is damaged.
    pub fn new(image: &Image) -> Result<Self> {
        let context = Context::from_dwarf(sections(image.file())?).context("debug information")?;
        let symbols = image.symbols().filter(|(name, _)| !name.starts_with('$'));
        let symbols = symbols.map(|(name, at)| (at & !1, plain(&demangle_auto(name.into(), None)))).collect();
        Ok(Self { context, symbols })
    }

    /// Functions that the instruction at `address` belongs to, the innermost first: it is inlined into those that follow.
    /// One that the debug information does not know belongs to the symbol before it.
    pub fn functions(&self, address: u32) -> Vec<String> {
        let mut names = Vec::new();
        let mut found = self.context.find_frames(address.into());
        let frames = loop {
            match found {
                LookupResult::Output(frames) => break frames,
                // Split debug information is not used.
                LookupResult::Load { continuation, .. } => {
                    found = addr2line::LookupContinuation::resume(continuation, None);
                }
            }
        };
        let Ok(mut frames) = frames else { return names };
        while let Ok(Some(frame)) = frames.next() {
            if let Some(function) = frame.function
                && let Ok(name) = function.demangle()
            {
                names.push(plain(&name));
            }
        }
        if names.is_empty() {
            names.extend(self.symbols.range(..=address).next_back().map(|(_, name)| name.clone()));
        }
        names
    }
}

/// A demangled name without its hash.
fn plain(name: &str) -> String {
    match name.rfind("::h") {
        Some(at) if name.len() == at + 19 => name[..at].to_owned(),
        _ => name.to_owned(),
    }
}

/// Offset of a field in the structure `name` (last part of its path).
///
/// # Errors
/// When there is no such structure or field.
pub fn offset(image: &Image, name: &str, field: &str) -> Result<u32> {
    let dwarf = sections(image.file())?;
    let mut units = dwarf.units();
    while let Some(header) = units.next()? {
        let unit = dwarf.unit(header)?;
        let mut entries = unit.entries();
        while let Some(entry) = entries.next_dfs()? {
            if entry.tag() != gimli::DW_TAG_structure_type || text(&dwarf, &unit, entry)?.as_deref() != Some(name) {
                continue;
            }
            if let Some(offset) = member(&dwarf, &unit, entry.offset(), field)? {
                return Ok(offset);
            }
        }
    }
    Err(anyhow!("the debug information has no {name}.{field}"))
}

type Unit = gimli::Unit<Reader>;
type Entry = gimli::DebuggingInformationEntry<Reader>;

fn text(dwarf: &gimli::Dwarf<Reader>, unit: &Unit, entry: &Entry) -> Result<Option<String>> {
    let Some(value) = entry.attr_value(gimli::DW_AT_name) else { return Ok(None) };
    Ok(Some(dwarf.attr_string(unit, value)?.to_string_lossy()?.into_owned()))
}

fn member(dwarf: &gimli::Dwarf<Reader>, unit: &Unit, structure: gimli::UnitOffset, field: &str) -> Result<Option<u32>> {
    let mut tree = unit.entries_tree(Some(structure))?;
    let mut children = tree.root()?.children();
    while let Some(child) = children.next()? {
        let entry = child.entry();
        if entry.tag() == gimli::DW_TAG_member && text(dwarf, unit, entry)?.as_deref() == Some(field) {
            let at = entry.attr_value(gimli::DW_AT_data_member_location).and_then(|v| v.udata_value());
            return Ok(Some(at.unwrap_or(0) as u32));
        }
    }
    Ok(None)
}

/// Name of the task that exception `e` runs: by its vector's symbol, which the task table knows. A vector that the table does
/// not know is the dispatcher of the software task.
pub fn task(image: &Image, e: Exception) -> String {
    let vector = image.word(PROGRAM + 4 * u32::from(e)).unwrap_or(0);
    let names: Vec<_> = image.symbols().filter(|s| s.1 == vector).map(|s| s.0).collect();
    TASKS
        .iter()
        .find(|t| names.contains(&t.source))
        .or_else(|| TASKS.iter().find(|t| t.source == "software"))
        .map_or_else(|| format!("exception {e}"), |t| t.name.to_owned())
}

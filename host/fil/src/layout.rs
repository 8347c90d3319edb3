//! Where the firmware's compiler has put the fields of a type, from the debug information of the ELF.
//!
//! The harness reads the head's status from the chip's RAM as a debugger would. Host and firmware are built from the same
//! sources by the same compiler, but nothing promises that a Rust type is laid out alike on both: [`Layout::same`] compares
//! every field before a byte is read.

use anyhow::{Context, Result, bail};
use gimli::{AttributeValue, DebuggingInformationEntry, EndianSlice, LittleEndian, Unit};
use object::{Object, ObjectSection};
use std::collections::BTreeMap;

type Slice<'a> = EndianSlice<'a, LittleEndian>;

/// Size and fields of the requested types, and the numbers of the variants among them.
pub struct Layout {
    types: BTreeMap<String, Type>,
    variants: BTreeMap<String, u64>,
}

/// A structure.
struct Type {
    size: u64,
    fields: BTreeMap<String, u64>,
    /// Where its numbers of four bytes are, those of the structures in it as well: never padding.
    words: Vec<u32>,
}

impl Layout {
    /// Finds the structures `wanted` (paths such as `edm_servo_head::head::Status`) in an ELF file.
    ///
    /// # Errors
    /// When the debug information is damaged or lacks one of them.
    pub fn read(file: &[u8], wanted: &[&str]) -> Result<Self> {
        let object = object::File::parse(file)?;
        let section = |id: gimli::SectionId| -> Result<Slice<'_>, gimli::Error> {
            let data = object.section_by_name(id.name()).and_then(|s| s.data().ok());
            Ok(EndianSlice::new(data.unwrap_or(&[]), LittleEndian))
        };
        let dwarf = gimli::Dwarf::load(section)?;
        let mut types = BTreeMap::new();
        let mut variants = BTreeMap::new();
        let mut units = dwarf.units();
        while let Some(header) = units.next()? {
            let unit = dwarf.unit(header)?;
            let mut entries = unit.entries();
            // Names of the entries that enclose the present one.
            let mut path: Vec<String> = Vec::new();
            let mut inside: Option<(String, usize)> = None;
            let mut number = None;
            while let Some(entry) = entries.next_dfs()? {
                let depth = entry.depth().max(0) as usize;
                path.truncate(depth);
                path.resize(depth, String::new());
                let name = name(&dwarf, &unit, entry)?;
                path.push(name.clone());
                if inside.as_ref().is_some_and(|(_, d)| depth <= *d) {
                    inside = None;
                }
                let full = || path.iter().filter(|p| !p.is_empty()).skip(1).cloned().collect::<Vec<_>>().join("::");
                match (entry.tag(), &inside) {
                    (gimli::DW_TAG_variant, _) => {
                        number = entry.attr_value(gimli::DW_AT_discr_value).and_then(|v| v.udata_value());
                    }
                    (gimli::DW_TAG_member, None) if number.is_some() => {
                        variants.extend(number.take().map(|number| (full(), number)));
                    }
                    (gimli::DW_TAG_structure_type, None) => {
                        let full = full();
                        // A generic type is in the image once: what it is generic over does not matter.
                        let bare = full.split('<').next().unwrap_or_default().to_owned();
                        let full = if wanted.contains(&bare.as_str()) { bare } else { full };
                        if wanted.contains(&full.as_str()) {
                            let size = entry.attr_value(gimli::DW_AT_byte_size).and_then(|v| v.udata_value());
                            if !types.contains_key(&full) {
                                let mut words = Vec::new();
                                numbers(&unit, entry.offset(), 0, &mut words)?;
                                let (size, fields) = (size.unwrap_or(0), BTreeMap::new());
                                types.insert(full.clone(), Type { size, fields, words });
                            }
                            inside = Some((full, depth));
                        }
                    }
                    (gimli::DW_TAG_member, Some((full, d))) if depth == d + 1 => {
                        let at = entry.attr_value(gimli::DW_AT_data_member_location).and_then(|v| v.udata_value());
                        if let (Some(at), Some(found)) = (at, types.get_mut(full)) {
                            found.fields.insert(name, at);
                        }
                    }
                    _ => (),
                }
            }
        }
        for wanted in wanted {
            types.get(*wanted).with_context(|| format!("the ELF has no debug information of {wanted}"))?;
        }
        Ok(Self { types, variants })
    }

    /// Place of a field.
    ///
    /// # Errors
    /// When there is no such field.
    pub fn offset(&self, of: &str, field: &str) -> Result<u32> {
        let at = self.types.get(of).and_then(|found| found.fields.get(field));
        Ok(*at.with_context(|| format!("{of} has no field {field}"))? as u32)
    }

    /// Places of the numbers of four bytes in a type, in bytes from its first, ascending; none of an unknown type.
    pub fn words(&self, of: &str) -> &[u32] {
        self.types.get(of).map_or(&[], |found| &found.words)
    }

    /// Number of a variant, by the path of its own type: the first word of a value of the enumeration.
    ///
    /// # Errors
    /// When there is no such variant.
    pub fn variant(&self, path: &str) -> Result<u32> {
        Ok(*self.variants.get(path).with_context(|| format!("the ELF has no variant {path}"))? as u32)
    }

    /// Checks that a type has the size and the fields that it has here.
    ///
    /// # Errors
    /// The first difference.
    pub fn same(&self, of: &str, size: usize, fields: &[(&str, usize)]) -> Result<()> {
        let there = self.types.get(of).map(|found| found.size);
        if there != Some(size as u64) {
            bail!("{of} has {size} bytes here and {there:?} in the firmware");
        }
        for (field, here) in fields {
            let there = self.offset(of, field)?;
            if there as usize != *here {
                bail!("{of}.{field} is at {here} here and at {there} in the firmware");
            }
        }
        Ok(())
    }
}

/// Adds the places of the numbers of four bytes in the structure at `offset`, which lies `base` bytes behind the first.
fn numbers(unit: &Unit<Slice<'_>>, offset: gimli::UnitOffset, base: u64, words: &mut Vec<u32>) -> Result<()> {
    let mut tree = unit.entries_tree(Some(offset))?;
    let mut children = tree.root()?.children();
    while let Some(child) = children.next()? {
        let member = child.entry();
        let at = member.attr_value(gimli::DW_AT_data_member_location).and_then(|value| value.udata_value());
        let (Some(at), Some(AttributeValue::UnitRef(of))) = (at, member.attr_value(gimli::DW_AT_type)) else {
            continue;
        };
        let of = unit.entry(of)?;
        match of.tag() {
            gimli::DW_TAG_structure_type => numbers(unit, of.offset(), base + at, words)?,
            gimli::DW_TAG_base_type
                if of.attr_value(gimli::DW_AT_byte_size).and_then(|size| size.udata_value()) == Some(4) =>
            {
                words.push((base + at) as u32);
            }
            _ => (),
        }
    }
    if base == 0 {
        words.sort_unstable();
    }
    Ok(())
}

fn name<'a>(
    dwarf: &gimli::Dwarf<Slice<'a>>,
    unit: &Unit<Slice<'a>>,
    entry: &DebuggingInformationEntry<Slice<'a>>,
) -> Result<String> {
    let Some(value) = entry.attr_value(gimli::DW_AT_name) else { return Ok(String::new()) };
    if matches!(value, AttributeValue::Udata(_)) {
        return Ok(String::new());
    }
    Ok(dwarf.attr_string(unit, value)?.to_string_lossy().into_owned())
}

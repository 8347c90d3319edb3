//! The ELF file: what is loaded where, and where its symbols are.

use anyhow::{Context, Result, bail};
use edm_soc::Memory;
use object::read::elf::{FileHeader, ProgramHeader};
use object::{Endianness, Object, ObjectSymbol, elf};
use std::collections::BTreeMap;

/// A firmware image.
pub struct Image {
    segments: Vec<(u32, Vec<u8>)>,
    symbols: BTreeMap<String, u32>,
    file: Vec<u8>,
}

impl Image {
    /// Parses an ELF file of a 32-bit little-endian ARM.
    ///
    /// # Errors
    /// When the file is no such ELF, or its vector table is not at the start of flash.
    pub fn parse(file: Vec<u8>) -> Result<Self> {
        let header = elf::FileHeader32::<Endianness>::parse(&*file).context("not a 32-bit ELF file")?;
        let endian = header.endian()?;
        let mut segments = Vec::new();
        for segment in header.program_headers(endian, &*file)? {
            let data = segment.data(endian, &*file).ok().context("a segment lies outside of the file")?;
            if segment.p_type(endian) == elf::PT_LOAD && !data.is_empty() {
                segments.push((segment.p_paddr(endian), data.to_vec()));
            }
        }
        if !segments.iter().any(|s| s.0 == 0x0800_0000) {
            bail!("no segment at 0x0800_0000: the linker script was not applied, the chip would not start");
        }
        let symbols = object::File::parse(&*file)?
            .symbols()
            .filter_map(|s| Some((s.name().ok()?.to_owned(), s.address() as u32)))
            .collect();
        Ok(Self { segments, symbols, file })
    }

    /// Programs the image into flash.
    ///
    /// # Errors
    /// When a segment does not fit.
    pub fn load(&self, memory: &Memory) -> Result<()> {
        for (address, data) in &self.segments {
            memory.flash.fill(*address, data).with_context(|| format!("segment at {address:#010x} is not in flash"))?;
        }
        Ok(())
    }

    /// Address of a symbol.
    pub fn symbol(&self, name: &str) -> Option<u32> {
        self.symbols.get(name).copied()
    }

    /// Address of the symbol of `module` and `name` among the mangled names of Rust.
    pub fn find(&self, module: &str, name: &str) -> Option<u32> {
        let part = |name: &str| format!("{}{name}", name.len());
        let wanted = part(module) + &part(name);
        self.symbols.iter().find(|(symbol, _)| symbol.contains(&wanted)).map(|(_, address)| *address)
    }

    /// Every symbol with its address.
    pub fn symbols(&self) -> impl Iterator<Item = (&str, u32)> {
        self.symbols.iter().map(|(name, address)| (name.as_str(), *address))
    }

    /// The word at `address`, as it is loaded.
    pub fn word(&self, address: u32) -> Option<u32> {
        self.segments.iter().find_map(|(start, data)| {
            let offset = address.checked_sub(*start)? as usize;
            Some(u32::from_le_bytes(data.get(offset..offset + 4)?.try_into().ok()?))
        })
    }

    /// The file as read.
    pub fn file(&self) -> &[u8] {
        &self.file
    }
}

//! `cargo firmware`: builds the image for each board, checks that a chip would start it, and says where the bytes go.
//!
//! Bytes of a *room* come from the line table of the debug information, which knows the source file of every instruction
//! even after everything has been inlined into the tasks. The largest *frame* is the most that one function takes of the
//! stack at once, from the instructions that move the stack pointer.

use edm_hal_shim::board::{BOARDS, Table};
use gimli::{EndianSlice, RunTimeEndian};
use object::{Object, ObjectSection, ObjectSymbol, SectionKind};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Where the chip looks for its vector table.
const VECTORS: u64 = 0x0800_0000;
/// Where the program may begin: the sectors in between hold the settings.
const PROGRAM: u64 = 0x0800_C000;
const FLASH_LIMIT: u64 = 384 * 1024;
const RAM_LIMIT: u64 = 64 * 1024;
/// A value that belongs into a static, not on the stack, shows as a larger frame.
const FRAME_LIMIT: u32 = 4 * 1024;
const FLASH: std::ops::Range<u64> = VECTORS..VECTORS + 1024 * 1024;
const RAM: std::ops::Range<u64> = 0x2000_0000..0x2002_0000;
const TARGET: &str = "thumbv7em-none-eabihf";

/// Builds, checks and reports every board. The images are left in `firmware/` of the target directory, a name each.
pub fn run(root: &Path) -> Result<(), String> {
    for (feature, Table { name, .. }) in BOARDS {
        let elf = build(root, feature)?;
        let data = std::fs::read(&elf).map_err(|e| format!("{}: {e}", elf.display()))?;
        let image = Image::read(&data)?;
        println!("{name}: {}", shown(&elf).display());
        image.check()?;
        image.print();
        println!();
    }
    Ok(())
}

/// Links one board's image, not optimised, in an environment that sets flags of its own, and checks that a chip would start it.
/// An environment variable RUSTFLAGS replaces every flag of `.cargo/config.toml`; linker arguments may not be among them.
pub fn link(root: &Path) -> Result<(), String> {
    let status = cargo()
        .current_dir(root)
        .args(["build", "-p", "edm-firmware", "--bin", "edm-servo-head", "--target", TARGET])
        .env("RUSTFLAGS", "-C force-frame-pointers=no")
        .env("CARGO_PROFILE_DEV_OPT_LEVEL", "0")
        .status()
        .map_err(|e| format!("cargo: {e}"))?;
    if !status.success() {
        return Err("the firmware does not build under RUSTFLAGS".into());
    }
    let elf = target(root).join(TARGET).join("debug/edm-servo-head");
    let data = std::fs::read(&elf).map_err(|e| format!("{}: {e}", elf.display()))?;
    Image::read(&data)?.starts()?;
    println!("{}: vector table in place", shown(&elf).display());
    Ok(())
}

fn target(root: &Path) -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from)
}

/// The cargo that runs this program.
pub fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// Builds the firmware for a board and says where it is.
pub fn build(root: &Path, feature: &str) -> Result<PathBuf, String> {
    let status = cargo()
        .current_dir(root)
        .args(["build", "--profile", "firmware", "-p", "edm-firmware", "--bin", "edm-servo-head", "--target", TARGET])
        .args(["--no-default-features", "--features", feature])
        .status()
        .map_err(|e| format!("cargo: {e}"))?;
    if !status.success() {
        return Err(format!("the firmware does not build with {feature}"));
    }
    let target = target(root);
    let folder = target.join("firmware");
    let elf = folder.join(format!("edm-servo-head-{feature}.elf"));
    std::fs::create_dir_all(&folder)
        .and_then(|()| std::fs::copy(target.join(TARGET).join("firmware/edm-servo-head"), &elf))
        .map_err(|e| format!("{}: {e}", elf.display()))?;
    Ok(elf)
}

/// What is known of an image.
struct Image {
    /// Name, address and size of the sections that the chip sees.
    sections: Vec<(String, u64, u64)>,
    /// Initial stack pointer and reset vector.
    vectors: Option<(u32, u32)>,
    entry: u64,
    rooms: BTreeMap<String, u64>,
    flash: u64,
    ram: u64,
    /// Largest frame, bytes.
    frame: u32,
    /// Instructions that set PRIMASK.
    masks: usize,
}

/// The path as someone in the current directory would type it.
fn shown(path: &Path) -> PathBuf {
    let absolute = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let here = std::env::current_dir().and_then(|here| here.canonicalize()).unwrap_or_default();
    absolute.strip_prefix(&here).map(Path::to_owned).unwrap_or(absolute)
}

impl Image {
    fn read(data: &[u8]) -> Result<Image, String> {
        let file = object::File::parse(data).map_err(|e| e.to_string())?;
        let code = code(&file);
        let mut image = Image {
            sections: Vec::new(),
            vectors: None,
            entry: file.entry(),
            rooms: rooms(&file).map_err(|e| format!("debug information: {e}"))?,
            flash: 0,
            ram: 0,
            frame: code.iter().map(|code| frame(code)).max().unwrap_or(0),
            masks: code.iter().map(|code| masks(code)).sum(),
        };
        for section in file.sections() {
            let (address, size) = (section.address(), section.size());
            if size == 0 || !allocated(&section) {
                continue;
            }
            let name = section.name().unwrap_or("?").to_owned();
            if name == ".vector_table" && address == VECTORS {
                let bytes = section.data().map_err(|e| e.to_string())?;
                image.vectors = bytes.first_chunk::<8>().map(|b| {
                    let [a, b, c, d, e, f, g, h] = *b;
                    (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h]))
                });
            }
            // Initial values of variables are in flash as well.
            if FLASH.contains(&address) || name == ".data" {
                image.flash += size;
            }
            if RAM.contains(&address) {
                image.ram += size;
            }
            image.sections.push((name, address, size));
        }
        Ok(image)
    }

    fn print(&self) {
        for (name, address, size) in &self.sections {
            println!("  {name:<14} {address:#010x} {size:>7}");
        }
        println!(
            "  flash {:.1} of {} KiB, RAM {:.1} of {} KiB, largest frame {} of {} bytes, vector table in place",
            kib(self.flash),
            FLASH_LIMIT / 1024,
            kib(self.ram),
            RAM_LIMIT / 1024,
            self.frame,
            FRAME_LIMIT
        );
        println!("  code by room:");
        let mut rooms: Vec<_> = self.rooms.iter().collect();
        rooms.sort_by_key(|(_, size)| std::cmp::Reverse(**size));
        for (room, size) in rooms {
            println!("    {room:<28} {size:>6}");
        }
    }

    /// What keeps a chip from starting this image.
    fn starts(&self) -> Result<(), String> {
        let (stack, reset) =
            self.vectors.ok_or("no vector table at 0x08000000: were the linker arguments replaced?")?;
        let in_program = |address: u64| address >= PROGRAM && FLASH.contains(&address);
        if !(RAM.contains(&u64::from(stack)) || u64::from(stack) == RAM.end) || stack % 8 != 0 {
            return Err(format!("the initial stack pointer {stack:#010x} is not in RAM"));
        }
        if reset & 1 == 0 || !in_program(u64::from(reset & !1)) {
            return Err(format!("the reset vector {reset:#010x} is no address of the program"));
        }
        if self.entry & !1 != u64::from(reset & !1) {
            return Err(format!("entry {:#010x} and reset vector {reset:#010x} differ", self.entry));
        }
        Ok(())
    }

    /// What keeps a chip from starting this image, or us from shipping it.
    fn check(&self) -> Result<(), String> {
        self.starts()?;
        for (name, address, _) in &self.sections {
            if FLASH.contains(address) && name != ".vector_table" && *address < PROGRAM {
                return Err(format!("section {name} lies in the sectors of the settings"));
            }
        }
        if self.flash > FLASH_LIMIT || self.ram > RAM_LIMIT {
            return Err(format!("flash {} or RAM {} bytes are over their limits", self.flash, self.ram));
        }
        if self.frame > FRAME_LIMIT {
            return Err(format!("a function takes {} bytes of stack", self.frame));
        }
        // RTIC masks while it starts, and a panic for good. Another one is a critical section that would delay the
        // reflex.
        if self.masks > 2 {
            return Err(format!("PRIMASK is set in {} places, 2 allowed: whose critical section is it?", self.masks));
        }
        Ok(())
    }
}

fn kib(bytes: u64) -> f64 {
    bytes as f64 / 1024.0
}

fn allocated<'d>(section: &impl ObjectSection<'d>) -> bool {
    let debug = matches!(section.kind(), SectionKind::Debug | SectionKind::DebugString | SectionKind::Metadata);
    !debug
        && (FLASH.contains(&section.address()) || RAM.contains(&section.address()) || section.name() == Ok(".ccmram"))
}

/// The stretches of code. Mapping symbols tell code (`$t`) from data (`$d`).
fn code<'d>(file: &object::File<'d>) -> Vec<&'d [u8]> {
    let Some(text) = file.section_by_name(".text") else { return Vec::new() };
    let (start, bytes) = (text.address(), text.data().unwrap_or_default());
    let mut marks: Vec<(u64, bool)> = file
        .symbols()
        .filter_map(|symbol| {
            let name = symbol.name().ok()?;
            let kind = name.split('.').next()?;
            matches!(kind, "$t" | "$d").then_some((symbol.address(), kind == "$t"))
        })
        .collect();
    marks.sort_unstable();
    let ends = marks.iter().skip(1).map(|mark| mark.0).chain([start + bytes.len() as u64]);
    let stretches = marks.iter().zip(ends).filter(|((_, code), _)| *code);
    stretches
        .filter_map(|((from, _), to)| bytes.get(from.checked_sub(start)? as usize..to.checked_sub(start)? as usize))
        .collect()
}

/// The instructions of a stretch of Thumb code, each of one or two half-words (ARMv7-M manual, A5.1).
fn instructions(code: &[u8]) -> impl Iterator<Item = (u32, Option<u32>)> {
    let mut halves = code.as_chunks::<2>().0.iter().map(|half| u32::from(u16::from_le_bytes(*half)));
    std::iter::from_fn(move || {
        let first = halves.next()?;
        Some((first, (first >> 11 >= 0b11101).then(|| halves.next().unwrap_or(0))))
    })
}

/// How often a stretch of code sets PRIMASK: `cpsid i` or `msr primask` (ARMv7-M manual, B5.2.1 and B5.2.3).
fn masks(code: &[u8]) -> usize {
    let sets = |&(first, second): &(u32, Option<u32>)| match second {
        None => first == 0xB672,
        Some(second) => first & 0xFFF0 == 0xF380 && second == 0x8810,
    };
    instructions(code).filter(sets).count()
}

/// The largest immediate that is subtracted from the stack pointer in a stretch of Thumb code (ARMv7-M manual, A7.7.176).
fn frame(code: &[u8]) -> u32 {
    let taken = |(first, second): (u32, Option<u32>)| {
        let Some(second) = second else {
            return (first & 0xFF80 == 0xB080).then_some((first & 0x7F) * 4);
        };
        let twelve = (first >> 10 & 1) << 11 | (second >> 12 & 0b111) << 8 | second & 0xFF;
        match (first & 0xFBFF, second & 0x8F00) {
            // sub.w, with a rotated byte; frames are never made of the repeated patterns.
            (0xF1AD, 0x0D00) if twelve >> 10 != 0 => Some((0x80 | twelve & 0x7F).rotate_right(twelve >> 7)),
            (0xF1AD | 0xF2AD, 0x0D00) => Some(twelve),
            _ => None,
        }
    };
    instructions(code).filter_map(taken).max().unwrap_or(0)
}

/// Bytes of code by room, from the line table.
fn rooms(file: &object::File) -> Result<BTreeMap<String, u64>, gimli::Error> {
    let endian = RunTimeEndian::Little;
    let load = |id: gimli::SectionId| -> Result<EndianSlice<'_, RunTimeEndian>, gimli::Error> {
        let data = file.section_by_name(id.name()).and_then(|section| section.data().ok());
        Ok(EndianSlice::new(data.unwrap_or(&[]), endian))
    };
    let dwarf = gimli::Dwarf::load(load)?;
    let mut sizes = BTreeMap::new();
    let mut units = dwarf.units();
    while let Some(header) = units.next()? {
        let unit = dwarf.unit(header)?;
        let Some(program) = unit.line_program.clone() else { continue };
        let mut rows = program.rows();
        let mut before: Option<(u64, String)> = None;
        while let Some((header, row)) = rows.next_row()? {
            if let Some((address, room)) = before.take()
                && (PROGRAM..FLASH.end).contains(&address)
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

    fn good() -> Image {
        Image {
            sections: vec![(".vector_table".to_owned(), VECTORS, 392), (".text".to_owned(), PROGRAM, 60_000)],
            vectors: Some((0x2002_0000, 0x0800_C001)),
            entry: 0x0800_C001,
            rooms: BTreeMap::new(),
            flash: FLASH_LIMIT,
            ram: RAM_LIMIT,
            frame: FRAME_LIMIT,
            masks: 2,
        }
    }

    #[test]
    fn an_image_at_its_limits_passes() {
        assert_eq!(good().check(), Ok(()));
    }

    #[test]
    fn whatever_a_chip_would_not_start_is_refused() {
        let refused = |image: Image, word: &str| {
            let error = image.check().expect_err(word);
            assert!(error.contains(word), "{error}");
        };
        refused(Image { vectors: None, ..good() }, "vector table");
        refused(Image { vectors: Some((0, 0x0800_C001)), ..good() }, "stack pointer");
        refused(Image { vectors: Some((0x2002_0004, 0x0800_C001)), ..good() }, "stack pointer");
        refused(Image { vectors: Some((0x2002_0000, 0)), ..good() }, "reset vector");
        refused(Image { vectors: Some((0x2002_0000, 0x0800_C000)), ..good() }, "reset vector");
        refused(Image { entry: 0, ..good() }, "differ");
        refused(Image { frame: FRAME_LIMIT + 1, ..good() }, "stack");
        refused(Image { masks: 3, ..good() }, "PRIMASK");
        refused(Image { flash: FLASH_LIMIT + 1, ..good() }, "limits");
        refused(Image { ram: RAM_LIMIT + 1, ..good() }, "limits");
        let mut image = good();
        image.sections.push((".text".to_owned(), PROGRAM - 4, 8));
        refused(image, "settings");
    }

    fn bytes(halves: &[u16]) -> Vec<u8> {
        halves.iter().flat_map(|half| half.to_le_bytes()).collect()
    }

    #[test]
    fn masks_by_hand() {
        // cpsid i; cpsie i; msr primask, r3; msr basepri, r3
        assert_eq!(masks(&bytes(&[0xB672, 0xB662, 0xF383, 0x8810, 0xF383, 0x8811])), 2);
        // The second half of another instruction masks nothing.
        assert_eq!(masks(&bytes(&[0xF04F, 0xB672])), 0);
    }

    #[test]
    fn frames_by_hand() {
        let halves = |halves: &[u16]| frame(&bytes(halves));
        // push {r4, lr}; sub sp, #16
        assert_eq!(halves(&[0xB510, 0xB084]), 16);
        // sub.w sp, sp, #44032, then subw sp, sp, #3184, then the first alone; add sp, #508 is none.
        assert_eq!(halves(&[0xF5AD, 0x4D2C]), 44_032);
        assert_eq!(halves(&[0xF6AD, 0x4D70]), 0xC70);
        assert_eq!(halves(&[0xB07F]), 0);
        // The second half of another instruction is no subtraction.
        assert_eq!(halves(&[0xF04F, 0xB084]), 0);
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

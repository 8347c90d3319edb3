//! `cargo firmware`: builds the image for each board, checks that a chip would start it, and reports its size by room.
//!
//! Bytes of a *room* come from the line table of the debug information, which knows the source file of every instruction
//! even after everything has been inlined into the tasks. The largest *frame* is the most that one function takes of the
//! stack. What tasks can reach, and how deep the stack gets, is read in the machine code: [`graph`] and [`tasks`].

use edm_hal_shim::board::{self, BOARDS, RAM_END, STACK, STACK_GUARD, Table};
use edm_hal_shim::seal;
use edm_seal::image::{TARGET, build, cargo, libraries, target};
use object::{Object, ObjectSection, SectionKind};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

mod graph;
mod lines;
mod tasks;
mod thumb;

use graph::Graph;
use tasks::{EXCEPTION, Report};

/// Where the program begins, with its vector table.
const PROGRAM: u64 = seal::PROGRAM as u64;
/// The sector of the boot loader, which is linked by itself; the two behind it hold the settings.
const LOADER: std::ops::Range<u64> = seal::BOOT as u64..seal::BOOT as u64 + 0x4000;
const SETTINGS: std::ops::Range<u64> = LOADER.end..PROGRAM;
const FLASH_LIMIT: u64 = 384 * 1024;
const RAM_LIMIT: u64 = 56 * 1024;
/// A value that belongs into a static, not on the stack, shows as a larger frame; and a larger one could step over the guard, or
/// leave too little of it to the handler of the fault.
const FRAME_LIMIT: u32 = 16 * 1024;
const _: () = assert!(2 * FRAME_LIMIT <= STACK_GUARD);
/// Largest stack of all tasks together; RAM leaves more than twice as much.
const STACK_LIMIT: u32 = STACK;
/// Least RAM for the stack and its guard.
const RESERVE: u32 = STACK + STACK_GUARD;
const _: () = assert!(RAM.end - RAM.start - RAM_LIMIT >= 2 * STACK_LIMIT as u64);
const FLASH: std::ops::Range<u64> = seal::BOOT as u64..seal::STAGE as u64;
const RAM: std::ops::Range<u64> = 0x2000_0000..RAM_END as u64;
const SHARED: std::ops::Range<u64> = RAM_END as u64..(RAM_END + board::SHARED) as u64;
/// Code that runs from RAM; its bytes are in flash as well.
const FAST: std::ops::Range<u64> = board::FAST as u64..board::FAST as u64 + STACK_GUARD as u64;

/// Builds, checks and reports every board, or the one that has the feature `only`. The images are left in `firmware/` of the
/// target directory, a name each.
///
/// # Errors
/// An image that does not build or that a check refuses; a feature that no board has.
pub fn run(root: &Path, only: Option<&str>) -> Result<(), String> {
    let root = root.canonicalize().map_err(|e| e.to_string())?;
    if let Some(only) = only.filter(|only| BOARDS.iter().all(|(feature, _)| feature != only)) {
        let features: Vec<_> = BOARDS.iter().map(|(feature, _)| *feature).collect();
        return Err(format!("no board has the feature {only}; boards: {}", features.join(", ")));
    }
    for (feature, Table { name, .. }) in BOARDS {
        if only.is_some_and(|only| only != *feature) {
            continue;
        }
        let elf = build(&root, feature)?;
        let data = std::fs::read(&elf).map_err(|e| format!("{}: {e}", elf.display()))?;
        let file = object::File::parse(&*data).map_err(|e| e.to_string())?;
        let graph = Graph::read(&file)?;
        let tasks = tasks::check(&graph, &tasks::HEAD, &|address| lines::place(&root, &file, address));
        let tasks = tasks.map_err(|errors| errors.join("\n"))?;
        let image = Image::read(&file, &graph)?;
        println!("{name}: {}", shown(&elf).display());
        image.print(&tasks);
        image.check(&tasks)?;
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
    let file = object::File::parse(&*data).map_err(|e| e.to_string())?;
    Image::read(&file, &Graph::read(&file)?)?.starts()?;
    println!("{}: vector table in place", shown(&elf).display());
    Ok(())
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
    /// Largest frame, bytes, and whose it is.
    frame: u32,
    largest: String,
    /// Instructions that set PRIMASK.
    masks: usize,
    /// A section that names the folder of the libraries.
    placed: Option<String>,
}

/// The path as someone in the current directory would type it.
fn shown(path: &Path) -> PathBuf {
    let absolute = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let here = std::env::current_dir().and_then(|here| here.canonicalize()).unwrap_or_default();
    absolute.strip_prefix(&here).map(Path::to_owned).unwrap_or(absolute)
}

impl Image {
    fn read(file: &object::File, graph: &Graph) -> Result<Image, String> {
        let largest = graph.functions.iter().max_by_key(|function| function.frame);
        let mut image = Image {
            sections: Vec::new(),
            vectors: None,
            entry: file.entry(),
            rooms: lines::rooms(file).map_err(|e| format!("debug information: {e}"))?,
            flash: 0,
            ram: 0,
            frame: largest.map_or(0, |function| function.frame),
            largest: largest.map_or_else(String::new, |function| function.name.clone()),
            masks: graph.masks,
            placed: None,
        };
        let libraries = libraries()?.into_os_string().into_encoded_bytes();
        for section in file.sections() {
            let (address, size) = (section.address(), section.size());
            if size == 0 || !allocated(&section) {
                continue;
            }
            let name = section.name().unwrap_or("?").to_owned();
            let data = section.data().map_err(|e| e.to_string())?;
            if data.windows(libraries.len().max(1)).any(|bytes| bytes == libraries) {
                image.placed = Some(name.clone());
            }
            if name == ".vector_table" && address == PROGRAM {
                image.vectors = data.first_chunk::<8>().map(|b| {
                    let [a, b, c, d, e, f, g, h] = *b;
                    (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h]))
                });
            }
            let shared = SHARED.contains(&address);
            // Initial values of variables are in flash as well.
            let copied = name == ".data" || FAST.contains(&address) || shared && !data.is_empty();
            if (FLASH.contains(&address) && !LOADER.contains(&address)) || copied {
                image.flash += size;
            }
            if RAM.contains(&address) || shared {
                image.ram += size;
            }
            image.sections.push((name, address, size));
        }
        Ok(image)
    }

    /// What the variables leave of the RAM: the stack grows down to them.
    fn left(&self) -> u64 {
        let variables = self.sections.iter().filter(|(_, address, _)| RAM.contains(address));
        let end = variables.map(|(_, address, size)| address + size).max().unwrap_or(RAM.start);
        self.vectors.map_or(0, |(stack, _)| u64::from(stack).saturating_sub(end))
    }

    fn print(&self, tasks: &Report) {
        for (name, address, size) in &self.sections {
            println!("  {name:<14} {address:#010x} {size:>7}");
        }
        println!(
            "  flash {:.1} of {} KiB, RAM {:.1} of {} KiB, largest frame {} of {} bytes ({}), vector table in place",
            kib(self.flash),
            FLASH_LIMIT / 1024,
            kib(self.ram),
            RAM_LIMIT / 1024,
            self.frame,
            FRAME_LIMIT,
            self.largest
        );
        println!(
            "  stack at most {:.1} of {} KiB: each line at its deepest on top of the next, with {EXCEPTION} bytes for an \
             exception; RAM leaves {:.1}",
            kib(tasks.stack.into()),
            STACK_LIMIT / 1024,
            kib(self.left())
        );
        print!("{tasks}");
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
            self.vectors.ok_or("no vector table at 0x0800C000: were the linker arguments replaced?")?;
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
    fn check(&self, tasks: &Report) -> Result<(), String> {
        self.starts()?;
        for (name, address, size) in &self.sections {
            if *address < SETTINGS.end && address + size > SETTINGS.start && FLASH.contains(address) {
                return Err(format!("section {name} lies in the sectors of the settings"));
            }
        }
        if let Some((name, ..)) =
            self.sections.iter().find(|(_, address, size)| address + size > FLASH.end && FLASH.contains(address))
        {
            return Err(format!("section {name} reaches into the sectors of the next program"));
        }
        if self.flash > FLASH_LIMIT || self.ram > RAM_LIMIT {
            return Err(format!("flash {} or RAM {} bytes are over their limits", self.flash, self.ram));
        }
        if self.frame > FRAME_LIMIT {
            return Err(format!(
                "{} uses {} bytes of stack, more than the allowed {FRAME_LIMIT}",
                self.largest, self.frame
            ));
        }
        if tasks.stack > STACK_LIMIT || self.left() < RESERVE.into() {
            let (stack, left) = (tasks.stack, self.left());
            return Err(format!(
                "the stack is {stack} bytes deep; {STACK_LIMIT} are allowed, {left} are free with the guard of {STACK_GUARD}"
            ));
        }
        // RTIC masks while it starts, and a panic for good. Another one is a critical section that would delay the
        // reflex.
        if self.masks > 2 {
            return Err(format!("PRIMASK is set in {} places, 2 are allowed: find the critical section", self.masks));
        }
        if let Some(name) = &self.placed {
            return Err(format!(
                "section {name} has a path of this computer's libraries: another computer would build another image"
            ));
        }
        Ok(())
    }
}

fn kib(bytes: u64) -> f64 {
    bytes as f64 / 1024.0
}

fn allocated<'d>(section: &impl ObjectSection<'d>) -> bool {
    let debug = matches!(section.kind(), SectionKind::Debug | SectionKind::DebugString | SectionKind::Metadata);
    let address = section.address();
    let placed = [FLASH, RAM, SHARED, FAST].iter().any(|range| range.contains(&address));
    !debug && (placed || section.name() == Ok(".ccmram"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> Image {
        Image {
            sections: vec![(".vector_table".to_owned(), PROGRAM, 392), (".text".to_owned(), PROGRAM + 0x200, 60_000)],
            vectors: Some((RAM_END, 0x0800_C001)),
            entry: 0x0800_C001,
            rooms: BTreeMap::new(),
            flash: FLASH_LIMIT,
            ram: RAM_LIMIT,
            frame: FRAME_LIMIT,
            largest: String::new(),
            masks: 2,
            placed: None,
        }
    }

    #[test]
    fn an_image_at_its_limits_passes() {
        assert_eq!(good().check(&Report { stack: STACK_LIMIT, ..Report::default() }), Ok(()));
    }

    #[test]
    fn whatever_a_chip_would_not_start_is_refused() {
        let refused = |image: Image, word: &str| {
            let error = image.check(&Report::default()).expect_err(word);
            assert!(error.contains(word), "{error}");
        };
        refused(Image { vectors: None, ..good() }, "vector table");
        refused(Image { vectors: Some((0, 0x0800_C001)), ..good() }, "stack pointer");
        refused(Image { vectors: Some((RAM_END + 4, 0x0800_C001)), ..good() }, "stack pointer");
        refused(Image { vectors: Some((RAM_END, 0)), ..good() }, "reset vector");
        refused(Image { vectors: Some((RAM_END, 0x0800_C000)), ..good() }, "reset vector");
        refused(Image { entry: 0, ..good() }, "differ");
        refused(Image { frame: FRAME_LIMIT + 1, ..good() }, "stack");
        refused(Image { masks: 3, ..good() }, "PRIMASK");
        refused(Image { placed: Some(".rodata".to_owned()), ..good() }, "libraries");
        let deep = good().check(&Report { stack: STACK_LIMIT + 1, ..Report::default() });
        assert!(deep.is_err_and(|error| error.contains("deep")));
        let mut image = good();
        image.sections.push((".bss".to_owned(), RAM.start, RAM.end - RAM.start - u64::from(RESERVE)));
        assert_eq!(image.check(&Report::default()), Ok(()));
        image.sections.push((".uninit".to_owned(), RAM.end - u64::from(RESERVE), 1));
        refused(image, "with the guard");
        refused(Image { flash: FLASH_LIMIT + 1, ..good() }, "limits");
        refused(Image { ram: RAM_LIMIT + 1, ..good() }, "limits");
        let mut image = good();
        image.sections.push((".text".to_owned(), PROGRAM - 4, 8));
        refused(image, "settings");
    }
}

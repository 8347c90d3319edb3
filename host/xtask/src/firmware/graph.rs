//! Who calls whom, from the machine code of an image.
//!
//! A function is what a symbol says is one. Each branch that leaves it is a call: `bl`, a jump at its end, a conditional one,
//! and falling out of its end. Arms of a jump table lie within their function and are read with it. A *taken* function is one
//! whose address is anywhere but in the vector table: in data, in a literal pool, or in the two halves of `movw` and `movt`. The linker's
//! relocations say where an address is: a number, as of an object, may look like one.
//! Only such a function can be called by an address that a register holds. A *thunk* is a jump of the linker's between flash and RAM:
//! it loads the address of the one function that it calls.

use super::thumb::{Branch, Effect, effects};
use object::elf::{R_ARM_ABS32, R_ARM_THM_MOVT_ABS};
use object::{Object, ObjectSection, ObjectSymbol, RelocationFlags, SymbolKind};
use std::collections::{BTreeMap, BTreeSet};

/// A function of the image.
#[derive(Debug, Default)]
pub struct Function {
    /// Its first name as in the source, without hash.
    pub name: String,
    /// Its symbols.
    pub symbols: BTreeSet<String>,
    /// Bytes of the stack that it takes in all: what it pushes and what it subtracts, wherever it does.
    pub frame: u32,
    /// Calls: where, and the number of whom.
    pub calls: Vec<(u32, usize)>,
    /// Calls of what a register or memory holds.
    pub indirect: Vec<u32>,
    /// Where the stack pointer is set to what cannot be known.
    pub dynamic: Vec<u32>,
    /// Runs from RAM.
    pub fast: bool,
    /// Is a jump of the linker's.
    pub thunk: bool,
}

/// All functions of an image.
#[derive(Debug, Default)]
pub struct Graph {
    /// The functions, by address.
    pub functions: Vec<Function>,
    /// Numbers of the functions that the vector table names, without the reset; each once.
    pub vectors: BTreeSet<usize>,
    /// Number of the function that the chip starts.
    pub reset: usize,
    /// Numbers of the taken functions.
    pub taken: BTreeSet<usize>,
    /// Instructions that set PRIMASK.
    pub masks: usize,
}

/// Begins the names of the linker's thunks.
const THUNK: &str = "__Thumb";
/// The vector table's section.
const VECTOR_TABLE: &str = ".vector_table";

impl Graph {
    /// Reads an image.
    ///
    /// # Errors
    /// When a branch or a vector leads to what is no function.
    pub fn read(file: &object::File) -> Result<Self, String> {
        let (extents, functions) = functions(file);
        let mut graph = Self { functions, ..Self::default() };
        // The linker adds none for its own thunks.
        let placed: BTreeSet<u32> = file
            .sections()
            .filter(super::allocated)
            .flat_map(|section| section.relocations())
            .filter(|(_, relocation)| {
                matches!(relocation.flags(), RelocationFlags::Elf { r_type: R_ARM_ABS32 | R_ARM_THM_MOVT_ABS })
            })
            .map(|(at, _)| at as u32)
            .collect();
        if placed.is_empty() {
            return Err(
                "the image has no relocations, which say where addresses are: link it with --emit-relocs".into()
            );
        }
        for section in file.sections().filter(super::allocated) {
            let bytes = section.data().map_err(|e| e.to_string())?;
            // The boot loader is another program, and calls nothing of this one.
            if section.name() == Ok(".boot") {
                continue;
            }
            if section.name() == Ok(VECTOR_TABLE) {
                // The first is the stack pointer.
                let mut vectors = words(bytes)
                    .skip(1)
                    .filter(|word| *word != 0)
                    .map(|word| extents.named(word).ok_or_else(|| format!("the vector {word:#010x} is no function")));
                graph.reset = vectors.next().ok_or("the vector table is empty")??;
                graph.vectors = vectors.collect::<Result<_, _>>()?;
                continue;
            }
            for (address, bytes, code) in stretches(file, section.address() as u32, bytes) {
                if code {
                    graph.code(address, bytes, &extents, &placed)?;
                } else {
                    let skip = (address.next_multiple_of(4) - address) as usize;
                    let words = (address + skip as u32..).step_by(4).zip(words(bytes.get(skip..).unwrap_or_default()));
                    let addresses = words.filter(|(at, _)| placed.contains(at));
                    graph.taken.extend(addresses.filter_map(|(_, word)| extents.named(word)));
                }
            }
        }
        Ok(graph)
    }

    /// Reads a stretch of code.
    fn code(&mut self, address: u32, bytes: &[u8], extents: &Extents, placed: &BTreeSet<u32>) -> Result<(), String> {
        let mut low = BTreeMap::new();
        // The function that goes on behind the instruction before.
        let mut open: Option<usize> = None;
        let mut thunk = None;
        for (at, effect) in effects(address, bytes) {
            // Padding between functions belongs to none.
            let Some(number) = extents.owner(at) else { continue };
            if let Some(before) = open.filter(|before| *before != number) {
                self.functions[before].calls.push((at, number));
            }
            open = Some(number);
            let function = &mut self.functions[number];
            match effect {
                Effect::Branch { to, kind } => {
                    let callee = extents.owner(to).ok_or_else(|| {
                        format!("{} goes to {to:#010x}, which is in no function, at {at:#010x}", function.name)
                    })?;
                    if callee != number || kind == Branch::Call {
                        function.calls.push((at, callee));
                    }
                    // A call at the very end is one that never comes back.
                    open = open.filter(|_| kind == Branch::Maybe);
                }
                Effect::Indirect => {
                    match thunk.take().filter(|_| function.thunk) {
                        Some(callee) => function.calls.push((at, callee)),
                        None => function.indirect.push(at),
                    }
                    open = None;
                }
                Effect::End => open = None,
                Effect::Takes(bytes) => function.frame += bytes,
                Effect::StackPointer => function.dynamic.push(at),
                Effect::Low { register, half } => {
                    low.insert(register, half);
                }
                Effect::High { register, half } => {
                    let named = low.get(&register).and_then(|low| extents.named(half << 16 | low));
                    if function.thunk {
                        thunk = named;
                    } else if placed.contains(&at) {
                        self.taken.extend(named);
                    }
                }
                Effect::Masks => self.masks += 1,
                Effect::None => {}
            }
        }
        Ok(())
    }

    /// Name of a function.
    pub fn name(&self, number: usize) -> &str {
        &self.functions[number].name
    }

    /// Whether a symbol, or the last part of its name, is that of a function.
    pub fn is(&self, number: usize, symbol: &str) -> bool {
        let Function { name, symbols, .. } = &self.functions[number];
        symbols.contains(symbol) || name.rsplit("::").next() == Some(symbol)
    }
}

/// Where functions begin and end, in order.
struct Extents(Vec<(u32, u32)>);

impl Extents {
    /// Number of the function that an address is in.
    fn owner(&self, address: u32) -> Option<usize> {
        let number = self.0.partition_point(|extent| extent.0 <= address).checked_sub(1)?;
        (address < self.0[number].1).then_some(number)
    }

    /// Number of the function whose address a word could be; the lowest bit says that it is Thumb code.
    fn named(&self, word: u32) -> Option<usize> {
        let begin = word.checked_sub(1).filter(|begin| begin % 2 == 0)?;
        self.0.binary_search_by_key(&begin, |extent| extent.0).ok()
    }
}

/// Extent and name of each function, by address. One without a size reaches to the next.
fn functions(file: &object::File) -> (Extents, Vec<Function>) {
    let mut symbols = BTreeMap::<u32, (u32, BTreeSet<String>)>::new();
    for symbol in file.symbols().filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.is_definition()) {
        let Ok(name) = symbol.name() else { continue };
        // Mapping symbols.
        if name.starts_with('$') {
            continue;
        }
        let (size, names) = symbols.entry(symbol.address() as u32 & !1).or_default();
        *size = symbol.size().max(u64::from(*size)) as u32;
        names.insert(name.to_owned());
    }
    let starts: Vec<u32> = symbols.keys().copied().collect();
    let ends = starts.iter().skip(1).copied().chain([u32::MAX]);
    let (extents, functions) = symbols
        .into_iter()
        .zip(ends)
        .map(|((start, (size, symbols)), next)| {
            let end = if size == 0 { next } else { start + size };
            let name = symbols.first().map_or_else(String::new, |name| format!("{:#}", rustc_demangle::demangle(name)));
            let fast = super::FAST.contains(&start.into());
            let thunk = name.starts_with(THUNK);
            ((start, end), Function { name, symbols, fast, thunk, ..Function::default() })
        })
        .unzip();
    (Extents(extents), functions)
}

/// The stretches of a section: address, bytes, and whether they are code. Mapping symbols separate code (`$t`) from data (`$d`);
/// what is before the first is data.
fn stretches<'d>(file: &object::File, start: u32, bytes: &'d [u8]) -> Vec<(u32, &'d [u8], bool)> {
    let end = start + bytes.len() as u32;
    let mut marks: Vec<(u32, bool)> = file
        .symbols()
        .filter_map(|symbol| {
            let kind = symbol.name().ok()?.split('.').next()?;
            matches!(kind, "$t" | "$d").then_some((symbol.address() as u32, kind == "$t"))
        })
        .filter(|mark| (start..end).contains(&mark.0))
        .chain([(start, false)])
        .collect();
    marks.sort_unstable();
    let ends = marks.iter().skip(1).map(|mark| mark.0).chain([end]);
    let part = |from: u32, to: u32| &bytes[(from - start) as usize..(to - start) as usize];
    marks.iter().zip(ends).map(|(&(from, code), to)| (from, part(from, to), code)).collect()
}

/// The words of data.
fn words(bytes: &[u8]) -> impl Iterator<Item = u32> {
    bytes.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word))
}

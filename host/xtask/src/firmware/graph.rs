//! Who calls whom, from the machine code of an image.
//!
//! A function is what a symbol says is one. Each branch that leaves it is a call: `bl`, a jump at its end, a conditional one,
//! and falling out of its end. Arms of a jump table lie within their function and are read with it. A *taken* function is one
//! whose address is anywhere but in the vector table: in data, in a literal pool, or in the two halves of `movw` and `movt`.
//! Only such a function can be called by an address that a register holds.

use super::thumb::{Branch, Effect, effects};
use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};
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
}

/// All functions of an image.
#[derive(Debug)]
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

/// The vector table's section.
const VECTOR_TABLE: &str = ".vector_table";

impl Graph {
    /// Reads an image.
    ///
    /// # Errors
    /// When a branch or a vector leads to what is no function.
    pub fn read(file: &object::File) -> Result<Self, String> {
        let (extents, mut functions) = functions(file);
        let owner = |address: u32| -> Option<usize> {
            let number = extents.partition_point(|extent| extent.0 <= address).checked_sub(1)?;
            (address < extents[number].1).then_some(number)
        };
        // A word that could be the address of a function says with its lowest bit that it is Thumb code.
        let named =
            |word: u32| extents.binary_search_by_key(&(word & !1), |extent| extent.0).ok().filter(|_| word & 1 == 1);

        let mut taken = BTreeSet::new();
        let mut masks = 0;
        let mut vectors = Vec::new();
        for section in file.sections().filter(super::allocated) {
            let bytes = section.data().map_err(|e| e.to_string())?;
            let stretches = stretches(file, section.address() as u32, bytes);
            for stretch in stretches {
                if !stretch.code {
                    let words = words(&stretch);
                    if section.name() == Ok(VECTOR_TABLE) {
                        vectors.extend(words.skip(1).filter(|word| *word != 0));
                    } else {
                        taken.extend(words.filter_map(named));
                    }
                    continue;
                }
                let mut low = BTreeMap::new();
                // The function that goes on behind the instruction before.
                let mut open: Option<usize> = None;
                for (at, effect) in effects(stretch.address, stretch.bytes) {
                    // Padding between functions belongs to none.
                    let Some(number) = owner(at) else { continue };
                    if let Some(before) = open.filter(|before| *before != number) {
                        functions[before].calls.push((at, number));
                    }
                    let function = &mut functions[number];
                    let mut ends = false;
                    match effect {
                        Effect::Branch { to, kind } => {
                            // A call at the very end is one that never comes back.
                            ends = kind != Branch::Maybe;
                            let callee = owner(to).ok_or_else(|| {
                                format!("{} goes to {to:#010x}, which is in no function, at {at:#010x}", function.name)
                            })?;
                            if callee != number || kind == Branch::Call {
                                function.calls.push((at, callee));
                            }
                        }
                        Effect::Indirect => {
                            ends = true;
                            function.indirect.push(at);
                        }
                        Effect::End => ends = true,
                        Effect::Takes(bytes) => function.frame += bytes,
                        Effect::StackPointer => function.dynamic.push(at),
                        Effect::Low { register, half } => {
                            low.insert(register, half);
                        }
                        Effect::High { register, half } => {
                            taken.extend(low.get(&register).and_then(|low| named(half << 16 | low)));
                        }
                        Effect::Masks => masks += 1,
                        Effect::None => {}
                    }
                    open = (!ends).then_some(number);
                }
            }
        }
        let mut vectors = vectors
            .into_iter()
            .map(|word| named(word).ok_or_else(|| format!("the vector {word:#010x} is no function")));
        let reset = vectors.next().ok_or("no vector table")??;
        let vectors = vectors.collect::<Result<_, _>>()?;
        Ok(Self { functions, vectors, reset, taken, masks })
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

/// Extent and name of each function, by address. One without a size reaches to the next.
fn functions(file: &object::File) -> (Vec<(u32, u32)>, Vec<Function>) {
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
    symbols
        .into_iter()
        .zip(ends)
        .map(|((start, (size, symbols)), next)| {
            let end = if size == 0 { next } else { start + size };
            let name = symbols.first().map_or_else(String::new, |name| format!("{:#}", rustc_demangle::demangle(name)));
            let function = Function { name, symbols, ..Function::default() };
            ((start, end), function)
        })
        .unzip()
}

/// A stretch of a section.
struct Stretch<'d> {
    address: u32,
    bytes: &'d [u8],
    code: bool,
}

/// The stretches of a section. Mapping symbols tell code (`$t`) from data (`$d`); what is before the first is data.
fn stretches<'d>(file: &object::File, start: u32, bytes: &'d [u8]) -> Vec<Stretch<'d>> {
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
    marks
        .iter()
        .zip(ends)
        .map(|(&(address, code), to)| Stretch {
            address,
            bytes: &bytes[(address - start) as usize..(to - start) as usize],
            code,
        })
        .collect()
}

/// The aligned words of a stretch.
fn words(stretch: &Stretch) -> impl Iterator<Item = u32> {
    let skip = (stretch.address.next_multiple_of(4) - stretch.address) as usize;
    let words = stretch.bytes.get(skip..).unwrap_or_default().as_chunks::<4>().0;
    words.iter().map(|word| u32::from_le_bytes(*word))
}

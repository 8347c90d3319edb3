//! Why the chip started, and what the run before it was doing: kept in RAM that no start-up code touches.

use super::hal::signature::Uid;
use super::pac;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Marks a record as written by this layout.
const MAGIC: u32 = 0x45_44_4D_31;
const WORDS: usize = 7;

/// Not initialised at start-up: it holds what the run before left, or noise after power-up.
#[unsafe(link_section = ".uninit.boot")]
static RECORD: MaybeUninit<[AtomicU32; WORDS]> = MaybeUninit::uninit();

fn record() -> &'static [AtomicU32; WORDS] {
    // SAFETY: any bits are a valid atomic integer, and only atomics ever write there.
    unsafe { RECORD.assume_init_ref() }
}

/// Words of the record.
#[derive(Clone, Copy)]
enum Word {
    Magic,
    Build,
    Starts,
    Death,
    Detail,
    Place,
    Check,
}

fn get(word: Word) -> u32 {
    record()[word as usize].load(Relaxed)
}

fn set(word: Word, value: u32) {
    record()[word as usize].store(value, Relaxed);
    let sum = record()[..Word::Check as usize].iter().fold(!0, |sum: u32, w| sum.rotate_left(5) ^ w.load(Relaxed));
    record()[Word::Check as usize].store(sum, Relaxed);
}

fn sound() -> bool {
    let sum = record()[..Word::Check as usize].iter().fold(!0, |sum: u32, w| sum.rotate_left(5) ^ w.load(Relaxed));
    get(Word::Magic) == MAGIC && get(Word::Check) == sum
}

/// A number for this chip, from its unique device ID (RM0090 39.1): place on the wafer, wafer and lot, mixed.
pub fn serial_number() -> u32 {
    let uid = Uid::get();
    let place = u32::from(uid.x()) << 16 | u32::from(uid.y());
    uid.lot_num()
        .bytes()
        .fold(place ^ u32::from(uid.waf_num()) << 8, |number, byte| number.rotate_left(5) ^ u32::from(byte))
}

/// What reset the chip (RM0090 7.3.21).
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub enum Cause {
    /// Power came, or dipped.
    Power,
    /// The reset pin alone.
    Pin,
    /// The program asked for it.
    Software,
    /// The independent watchdog.
    Watchdog,
    /// Another watchdog or low-power entry.
    Other,
}

/// How a run ended, when it knew: object 2009h:4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
#[repr(u32)]
pub enum Death {
    /// It did not know: power, pin, or a hang.
    None,
    /// A panic; place: line.
    Panic,
    /// A hard fault; place: program counter, detail: fault status.
    HardFault,
    /// An interrupt without a handler, or the crystal's failure (NMI); detail: its number.
    Unexpected,
    /// The task watchdog missed a task; detail: which.
    Silent,
    /// The stack has reached its guard; detail: fault status. Place: program counter, unless no frame could be stored
    /// (MSTKERR).
    Stack,
}

/// What is known at start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub struct Boot {
    /// What reset the chip.
    pub cause: Cause,
    /// Starts since power-up, this one included.
    pub starts: u32,
    /// Build of the run before, when there was one.
    pub build_before: Option<u32>,
    /// How that run ended.
    pub death: Death,
    /// More about it.
    pub detail: u32,
    /// Where it was.
    pub place: u32,
}

/// Reads cause and record and begins a new one for `build`. Once, at start.
pub fn begin(rcc: &pac::RCC, build: u32) -> Boot {
    let csr = rcc.csr().read().bits();
    let has = |bit: u32| csr >> bit & 1 == 1;
    let cause = if has(27) || has(25) {
        Cause::Power
    } else if has(29) {
        Cause::Watchdog
    } else if has(28) {
        Cause::Software
    } else if has(30) || has(31) {
        Cause::Other
    } else {
        Cause::Pin
    };
    // Clears the flags for the next time.
    super::change!(rcc.csr(), clear 0, set 1 << 24);
    let kept = cause != Cause::Power && sound();
    let death = match get(Word::Death) {
        1 => Death::Panic,
        2 => Death::HardFault,
        3 => Death::Unexpected,
        4 => Death::Silent,
        5 => Death::Stack,
        _ => Death::None,
    };
    let boot = Boot {
        cause,
        starts: if kept { get(Word::Starts).wrapping_add(1) } else { 1 },
        build_before: kept.then(|| get(Word::Build)),
        death: if kept { death } else { Death::None },
        detail: if kept { get(Word::Detail) } else { 0 },
        place: if kept { get(Word::Place) } else { 0 },
    };
    set(Word::Magic, MAGIC);
    set(Word::Build, build);
    set(Word::Starts, boot.starts);
    died(Death::None, 0, 0);
    boot
}

/// Notes how this run ends. The last word counts.
pub fn died(death: Death, detail: u32, place: u32) {
    set(Word::Detail, detail);
    set(Word::Place, place);
    set(Word::Death, death as u32);
}

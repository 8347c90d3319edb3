//! What the engine's hooks share: the peripherals, the clock of the processor, decoded code, statistics.

use super::half;
use crate::decode::{Class, Instruction, REFILL, decode};
use crate::meter::Meter;
use edm_soc::{Exception, Masks, Soc, World};

/// Half words of flash, and the upper bits of its addresses. Behind them those of SRAM1, as it appears at address 0.
const FLASH_WORDS: usize = 0x8_0000;
const FLASH: u32 = 0x080;
const SRAM1: u32 = 0x1_c000;
const HALF_WORDS: usize = FLASH_WORDS + SRAM1 as usize / 2;

/// Place of an address among what was decoded; `None` where code never runs from, or not for long.
#[inline]
fn slot(address: u32) -> Option<usize> {
    if address >> 20 == FLASH {
        return Some((address as usize / 2) % FLASH_WORDS);
    }
    (address < SRAM1).then_some(FLASH_WORDS + address as usize / 2)
}

/// Why the hook stopped the engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// Something has to happen before the instruction at this address.
    Poll(u32),
    /// WFI; the address of the next instruction.
    Sleep(u32),
    /// An FPU instruction at this address while the FPU is off.
    NoFpu(u32),
    /// WFE or SEV at this address.
    Event(u32),
    /// The engine raised exception number ...
    Raised(u32),
}

/// Counts since power-up.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Instructions, those skipped in IT blocks included.
    pub instructions: u64,
    /// Half ticks spent asleep.
    pub asleep: u64,
    /// Entries by exception number.
    pub entries: Vec<u64>,
    /// Entries that were tail-chained.
    pub tail_chained: u64,
    /// Deepest nesting of exceptions.
    pub nesting: usize,
    /// Resets after power-up.
    pub resets: u64,
}

/// A straight piece of code that the engine runs without asking: what it costs and what it needs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Block {
    /// Bytes; zero: not known yet.
    size: u16,
    cycles: u16,
    instructions: u16,
    /// Uses the FPU.
    pub float: bool,
    /// Waits for an interrupt or an event.
    pub waits: bool,
    /// May change PRIMASK, FAULTMASK or BASEPRI.
    pub masks: bool,
}

/// One run of an exception, times in half ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Its number.
    pub exception: Exception,
    /// First instruction of the handler.
    pub entered: u64,
    /// End of its return, or of the chaining to the next; `None` while it runs.
    pub left: Option<u64>,
}

/// Changes what the firmware writes: address, size, value.
pub type Alter = Box<dyn FnMut(u32, u8, u32) -> u32>;

/// State of the processor other than its registers.
#[derive(Clone)]
pub struct Moment {
    half: u64,
    half_per_cycle: u64,
    stretch: u64,
    thread: bool,
    rest: u64,
    masked: bool,
    masks_changed: bool,
    last: u32,
    next: u32,
    sleeping: bool,
    flash_write: Option<FlashWrite>,
    fpca: bool,
    lazy: Option<u32>,
    stats: Stats,
    open: Vec<usize>,
}

/// A write into flash that the engine has done and the flash interface has not checked yet.
#[derive(Clone)]
struct FlashWrite {
    address: u32,
    size: u8,
    value: u32,
    old: u32,
}

pub struct Chip<W> {
    pub soc: Soc<W>,
    /// Time of the processor, half ticks.
    pub half: u64,
    /// Time at which the peripherals must be advanced.
    pub limit: u64,
    until: u64,
    half_per_cycle: u64,
    /// Factor on the time of thread mode, and whether thread mode is running.
    pub stretch: u64,
    pub thread: bool,
    /// Time that the last code of thread mode still takes, half ticks: an event came within it.
    rest: u64,
    /// Interrupts are masked, as of the last look; the masks may have changed since.
    masked: bool,
    pub masks_changed: bool,
    /// The masks when they were read last; `None` when something else has written them since.
    pub masks: Option<Masks>,
    code: Box<[Instruction; HALF_WORDS]>,
    /// Blocks in the order in which they were met, and which of them begins at each address: side by side they stay in the cache.
    /// The first is that of addresses at which none is known.
    blocks: Vec<Block>,
    begins: Box<[u16; HALF_WORDS]>,
    /// Last instruction, and where it ends.
    pub last: u32,
    next: u32,
    pub stop: Option<Stop>,
    pub sleeping: bool,
    pub bad_address: u32,
    flash_write: Option<FlashWrite>,
    /// Code was fetched from RAM.
    pub code_in_ram: bool,
    /// The engine has SRAM1 at address 0.
    sram_at_zero: bool,
    /// Writes to the MPU that the engine follows.
    pub guards: u32,
    /// The engine may write flash, because it just had to.
    pub flash_open: bool,
    /// CONTROL.FPCA: the running code has an FPU context.
    pub fpca: bool,
    /// Address of FPU registers reserved on the stack and not saved yet (FPCCR.LSPACT).
    pub lazy: Option<u32>,
    pub stats: Stats,
    /// Cycle accounting, if requested.
    pub meter: Option<Box<Meter>>,
    /// Runs of exceptions, when they are recorded, and those that have not ended.
    pub spans: Option<Vec<Span>>,
    open: Vec<usize>,
    /// A fault of the firmware, put in on its way to the registers.
    pub alter: Option<Alter>,
}

impl<W: World> Chip<W> {
    pub fn new(soc: Soc<W>) -> Self {
        Self {
            soc,
            half: 0,
            limit: 0,
            until: 0,
            half_per_cycle: 0,
            stretch: 1,
            thread: true,
            rest: 0,
            masked: false,
            masks_changed: false,
            masks: None,
            code: Box::new([Instruction::default(); HALF_WORDS]),
            blocks: vec![Block::default()],
            begins: Box::new([0; HALF_WORDS]),
            last: 0,
            next: 0,
            stop: None,
            sleeping: false,
            bad_address: 0,
            flash_write: None,
            code_in_ram: false,
            sram_at_zero: false,
            guards: 0,
            flash_open: false,
            fpca: false,
            lazy: None,
            stats: Stats { entries: vec![0; 98], ..Stats::default() },
            meter: None,
            spans: None,
            open: Vec::new(),
            alter: None,
        }
    }

    /// Now.
    pub fn moment(&self) -> Moment {
        Moment {
            half: self.half,
            half_per_cycle: self.half_per_cycle,
            stretch: self.stretch,
            thread: self.thread,
            rest: self.rest,
            masked: self.masked,
            masks_changed: self.masks_changed,
            last: self.last,
            next: self.next,
            sleeping: self.sleeping,
            flash_write: self.flash_write.clone(),
            fpca: self.fpca,
            lazy: self.lazy,
            stats: self.stats.clone(),
            open: self.open.clone(),
        }
    }

    /// Goes back to a moment; what has been decoded, metered and recorded stays.
    pub fn go_on_from(&mut self, moment: &Moment) {
        let Moment { half, half_per_cycle, stretch, thread, rest, masked, masks_changed, last, next, .. } = *moment;
        (self.half, self.half_per_cycle, self.stretch) = (half, half_per_cycle, stretch);
        (self.thread, self.rest, self.masked, self.masks_changed) = (thread, rest, masked, masks_changed);
        (self.last, self.next, self.sleeping) = (last, next, moment.sleeping);
        (self.fpca, self.lazy) = (moment.fpca, moment.lazy);
        self.flash_write.clone_from(&moment.flash_write);
        self.stats.clone_from(&moment.stats);
        self.open.clone_from(&moment.open);
        (self.stop, self.limit, self.masks) = (None, 0, None);
    }

    /// Whether the engine has to have SRAM1 at address 0, if it has something else there.
    pub fn remap(&self) -> Option<bool> {
        let wanted = self.soc.sram_at_zero();
        (wanted != self.sram_at_zero).then_some(wanted)
    }

    /// The engine has it there now, or not. What was decoded there is something else.
    pub fn remapped(&mut self, sram_at_zero: bool) {
        self.sram_at_zero = sram_at_zero;
        self.code[FLASH_WORDS..].fill(Instruction::default());
        self.begins[FLASH_WORDS..].fill(0);
        self.limit = 0;
    }

    /// Forgets what was decoded: there may be another program.
    pub fn forget_code(&mut self) {
        self.code.fill(Instruction::default());
        self.begins.fill(0);
        self.blocks.truncate(1);
    }

    /// Processor state after reset.
    pub fn restart(&mut self) {
        (self.sleeping, self.fpca, self.lazy, self.limit) = (false, false, None, 0);
        self.open.clear();
        (self.thread, self.rest, self.masked, self.masks_changed) = (true, 0, false, false);
        self.masks = None;
    }

    pub fn set_until(&mut self, until: u64) {
        self.until = half(until);
        self.limit = 0;
    }

    pub fn time_is_up(&self) -> bool {
        self.half >= self.until
    }

    /// The way of almost all instructions: decoded, in sequence, of no special class, nothing due. Returns whether it was
    /// taken.
    #[inline]
    pub fn fast(&mut self, address: u32) -> bool {
        let Some(known) = slot(address).map(|index| self.code[index]) else { return false };
        let plain = known.size != 0 && known.class == Class::Plain;
        let float = known.class == Class::Float && known.size != 0 && self.fpca;
        if address != self.next || self.half >= self.limit || !(plain || float) || self.meter.is_some() {
            return false;
        }
        self.charge(address, known);
        true
    }

    /// The way of almost all blocks: known, nothing due, no FPU context to make. Returns whether it was taken.
    #[inline]
    pub fn fast_block(&mut self, address: u32, size: u32) -> bool {
        let Some(known) = slot(address).map(|index| self.known_block(index)) else { return false };
        let plain = u32::from(known.size) == size && !(known.waits || known.masks);
        if !plain || self.half >= self.limit || (known.float && !self.fpca) {
            return false;
        }
        self.charge_block(address, known);
        true
    }

    /// The block of `size` bytes at `address`, decoded once.
    pub fn block(&mut self, address: u32, size: u32) -> Block {
        let index = slot(address);
        if let Some(known) = index.map(|index| self.known_block(index))
            && u32::from(known.size) == size
        {
            return known;
        }
        let mut block = Block { size: size as u16, ..Block::default() };
        let mut at = address;
        while at < address.wrapping_add(size) {
            let instruction = self.instruction(at);
            block.cycles += u16::from(instruction.cycles);
            block.instructions += 1;
            block.float |= instruction.class == Class::Float;
            block.waits |= matches!(instruction.class, Class::Wait | Class::Event);
            block.masks |= instruction.class == Class::Masks;
            at += u32::from(instruction.size);
        }
        if let Some(index) = index {
            self.remember(index, block);
        }
        block
    }

    #[inline]
    fn known_block(&self, index: usize) -> Block {
        self.blocks[usize::from(self.begins[index])]
    }

    fn remember(&mut self, index: usize, block: Block) {
        let known = usize::from(self.begins[index]);
        if known > 0 {
            self.blocks[known] = block;
        } else if let Ok(next) = u16::try_from(self.blocks.len()) {
            self.begins[index] = next;
            self.blocks.push(block);
        }
    }

    /// Counts a whole block, and the branch that led to it.
    #[inline]
    pub fn charge_block(&mut self, address: u32, block: Block) {
        let refill = if address == self.next { 0 } else { u64::from(REFILL) };
        self.stats.instructions += u64::from(block.instructions);
        self.pass(refill + u64::from(block.cycles));
        self.last = address;
        self.next = address.wrapping_add(block.size.into());
    }

    /// The instruction at `address`, decoded once.
    pub fn instruction(&mut self, address: u32) -> Instruction {
        let known = slot(address).map(|index| self.code[index]).filter(|known| known.size != 0);
        known.unwrap_or_else(|| self.decode(address))
    }

    fn decode(&mut self, address: u32) -> Instruction {
        let (memory, zero) = (&self.soc.memory, if self.soc.sram_at_zero() { 0x2000_0000 } else { 0x0800_0000 });
        let half_word = |a: u32| {
            let a = a | if a >> 20 == 0 { zero } else { 0 };
            memory.flash.load(a, 2).or_else(|| memory.sram.load(a, 2)).unwrap_or(0) as u16
        };
        let decoded = decode(half_word(address), half_word(address + 2));
        let Some(index) = slot(address) else { return decoded };
        let instruction = Instruction { in_it: self.code[index].in_it, ..decoded };
        self.code[index] = instruction;
        // Mark the members of the block an IT opens, so that they are known when they are met.
        let mut at = address + 2;
        for _ in 0..instruction.opens {
            if let Some(member) = slot(at) {
                self.code[member].in_it = true;
                self.code[member].size = 0;
            }
            at += u32::from(decode(half_word(at), 0).size);
        }
        instruction
    }

    /// Charges what lies between the last instruction and `address`: the penalty of a taken branch, or members of an IT
    /// block whose condition failed, for which the engine calls no hook.
    pub fn close_gap(&mut self, address: u32) {
        if address == self.next {
            return;
        }
        let mut at = self.next;
        let mut skipped = 0;
        while at < address && self.instruction(at).in_it {
            at += u32::from(self.instruction(at).size);
            skipped += 1;
        }
        self.next = address;
        if at == address {
            self.stats.instructions += skipped;
            self.half += skipped * self.half_per_cycle;
            return;
        }
        self.half += u64::from(REFILL) * self.half_per_cycle;
    }

    /// Counts the instruction at `address`.
    #[inline]
    pub fn charge(&mut self, address: u32, instruction: Instruction) {
        self.stats.instructions += 1;
        self.pass(instruction.cycles.into());
        self.last = address;
        self.next = address.wrapping_add(instruction.size.into());
    }

    /// Lets the cycles of executed code pass.
    #[inline]
    fn pass(&mut self, cycles: u64) {
        let least = self.half + cycles * self.half_per_cycle;
        if self.thread && self.stretch > 1 && !self.masked {
            // Slower, but an event within that time happens at its own: what interrupts see stays as it was.
            let slow = self.half + cycles * self.half_per_cycle * self.stretch;
            self.half = slow.min(self.limit).max(least);
            self.rest = slow - self.half;
        } else {
            self.half = least;
        }
    }

    /// Lets more of the stretched time pass, up to the next event at most. Returns whether that is due now.
    pub fn pass_rest(&mut self) -> bool {
        let step = self.rest.min(self.limit.saturating_sub(self.half));
        self.half += step;
        self.rest -= step;
        step > 0 && self.half >= self.limit
    }

    /// Interrupts are masked, or not, from here on. What was left of stretched time is not for a masked section to wait out.
    pub fn mask(&mut self, masked: bool) {
        self.masked = masked;
        if masked {
            self.rest = 0;
        }
    }

    /// Lets `cycles` pass.
    pub fn spend(&mut self, cycles: u64) {
        self.half += cycles * self.half_per_cycle;
    }

    /// Lets the `cycles` pass that saving or restoring the FPU registers takes.
    pub fn spend_float(&mut self, cycles: u64) {
        self.spend(cycles);
        if let Some(meter) = &mut self.meter {
            meter.spend(cycles);
        }
    }

    /// Exception `e` is entered.
    pub fn record_entry(&mut self, e: Exception) {
        if let Some(meter) = &mut self.meter {
            meter.enter(e);
        }
        if let Some(spans) = &mut self.spans {
            self.open.push(spans.len());
            spans.push(Span { exception: e, entered: self.half, left: None });
        }
    }

    /// The running exception has returned.
    pub fn record_exit(&mut self) {
        if let Some(meter) = &mut self.meter {
            meter.leave();
        }
        if let (Some(spans), Some(index)) = (&mut self.spans, self.open.pop())
            && let Some(span) = spans.get_mut(index)
        {
            span.left = Some(self.half);
        }
    }

    /// Execution continues at `address` after an exception entry or return: no branch penalty beyond theirs.
    pub fn jump(&mut self, address: u32) {
        self.next = address & !1;
        (self.limit, self.rest) = (0, 0);
    }

    /// Advances the peripherals to the processor's time. Returns whether the run loop has to look at them.
    pub fn catch_up(&mut self) -> bool {
        self.settle();
        // Code is fetched from the flash that is busy.
        if half(self.soc.stalled_until()) > self.half {
            self.half = half(self.soc.stalled_until()).min(self.until.max(self.half));
            self.soc.advance(self.half / 2);
        }
        self.half_per_cycle = self.soc.half_ticks_per_cycle();
        self.limit = half(self.soc.next_event()).min(self.until);
        self.flash_open
            || self.remap().is_some()
            || self.guards != self.soc.core().guards
            || self.soc.error().is_some()
            || self.soc.reset_request().is_some()
            || self.time_is_up()
    }

    /// Brings the peripherals to the processor's time.
    fn settle(&mut self) {
        self.soc.advance(self.half / 2);
        if let Some(w) = self.flash_write.take() {
            // The engine has stored the value as if flash were RAM: put the old one back and let the interface decide.
            self.soc.memory.flash.store(w.address, w.size.into(), w.old);
            self.soc.program(w.address, w.size, w.value);
        }
    }

    /// The exception to enter now.
    pub fn due_exception(&mut self, masks: Masks) -> Option<Exception> {
        self.catch_up();
        self.soc.preempting(masks)
    }

    /// Sleeps until an exception wakes the processor. Returns whether time is up instead.
    pub fn sleep_until_woken(&mut self, masks: Masks) -> bool {
        while self.sleeping {
            if self.catch_up() {
                return self.time_is_up();
            }
            if self.soc.nvic().wakes(masks) {
                self.sleeping = false;
                break;
            }
            let to = self.limit.max(self.half + 1);
            self.stats.asleep += to - self.half;
            self.soc.core().slept(to / 2 - self.half / 2);
            self.half = to;
        }
        false
    }

    /// The processor is halted until tick `to`; everything else continues.
    pub fn halt(&mut self, to: u64) {
        self.settle();
        let ticks = to.saturating_sub(self.soc.now());
        self.soc.halt(ticks);
        self.half += 2 * ticks;
        self.limit = 0;
    }

    pub fn read(&mut self, address: u32, size: u8) -> u32 {
        self.settle();
        // A refused access is kept by the model; the next instruction does not run.
        let value = self.soc.read(address, size);
        // Most registers stay as they are when they are read: nothing is due that was not.
        let same = value.is_ok() && self.half_per_cycle == self.soc.half_ticks_per_cycle();
        self.limit = if same { self.limit.min(half(self.soc.next_event())) } else { 0 };
        if let Some(meter) = &mut self.meter {
            meter.load_register(address);
        }
        value.unwrap_or(0)
    }

    pub fn write(&mut self, address: u32, size: u8, value: u32) {
        self.settle();
        self.limit = 0;
        let value = self.alter.as_mut().map_or(value, |alter| alter(address, size, value));
        let _ = self.soc.write(address, size, value);
        if let Some(meter) = &mut self.meter {
            meter.store_register(address);
        }
    }

    pub fn flash_write(&mut self, address: u32, size: u8, value: u32) {
        let old = self.soc.memory.flash.load(address, size.into()).unwrap_or(0);
        self.flash_write = Some(FlashWrite { address, size, value, old });
        self.flash_open = true;
        self.limit = 0;
    }
}

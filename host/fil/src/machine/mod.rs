//! Processor and chip together: the run loop.

mod chip;
mod exceptions;
#[cfg(all(target_os = "linux", target_env = "gnu"))]
mod near;
mod snapshot;

pub use chip::{Alter, Span, Stats};
use chip::{Chip, Stop};
pub use snapshot::Snapshot;

use crate::decode::Class;
use crate::image::Image;
use crate::meter::{Buses, Marks, Meter};
use anyhow::{Result, anyhow, bail};
use edm_soc::{Masks, NEVER, Region, Reset, Soc, World, exception};
use std::ops::Range;
use unicorn_engine::{
    Arch, ArmCpuModel, HookType, MemType, Mode, Prot, RegisterARM as R, TlbEntry, TlbType, UcHookId, Unicorn, uc_error,
};

/// Flash, where code runs from.
const FLASH: Range<u64> = 0x0800_0000..0x0810_0000;

/// SRAM1 at address 0, as far as code lies there, and what flash fills there.
const AT_ZERO: [u64; 2] = [0x1_c000, 0x10_0000];

/// Bits of xPSR that hold the place in an IT block (ARMv7-M B1.4.2).
const IT: u64 = 0x0600_fc00;

/// CCM, SRAM and what lies between them.
const RAM: Range<u64> = 0x1000_0000..0x2002_0000;

/// What is not RAM: first and last address of each stretch between the two. A hook on RAM would slow down each store into
/// it; there is nothing to refuse there.
const NOT_RAM: [(u64, u64); 3] = [(0, 0x0fff_ffff), (0x1001_0000, 0x1fff_ffff), (0x2002_0000, 0xffff_ffff)];

/// Refused accesses of the engine, for a hook.
const REFUSALS: HookType = HookType(HookType::MEM_UNMAPPED.0 | HookType::MEM_PROT.0);

/// Windows of the address space that are peripherals: base and length, multiples of 4 KiB.
const PERIPHERALS: [(u64, u64); 6] = [
    (0x1fff_7000, 0x1000),
    (0x2200_0000, 0x40_0000),
    (0x4000_0000, 0x8_0000),
    (0x4200_0000, 0x100_0000),
    (0x5000_0000, 0x6_1000),
    (0xe000_0000, 0x10_0000),
];

/// A chip that runs a firmware.
pub struct Machine<W: World + 'static> {
    uc: Unicorn<'static, Chip<W>>,
    /// The hook by which time passes.
    pace: UcHookId,
    /// What the MPU keeps from the engine at present, and the hook by which its address is known.
    guarded: Option<(Range<u32>, UcHookId)>,
}

/// Turns an engine error into one with words.
fn engine(what: &str) -> impl FnOnce(uc_error) -> anyhow::Error + '_ {
    move |e| anyhow!("engine: {what}: {e:?}")
}

impl<W: World + 'static> Machine<W> {
    /// A chip at power-up, `image` in its flash, `world` around it, a crystal of `hse_hz`, the brown-out level that bring-up
    /// has set.
    ///
    /// # Errors
    /// When the image does not fit or the engine cannot be set up.
    pub fn new(image: &Image, world: W, hse_hz: u64) -> Result<Self> {
        let mut soc = Soc::new(world, hse_hz);
        soc.set_brown_out(3);
        image.load(&soc.memory)?;
        let mut uc =
            Unicorn::new_with_data(Arch::ARM, Mode::THUMB | Mode::MCLASS, Chip::new(soc)).map_err(engine("create"))?;
        uc.ctl_set_cpu_model(ArmCpuModel::CORTEX_M4 as i32).map_err(engine("processor model"))?;
        #[cfg(all(target_os = "linux", target_env = "gnu"))]
        near::limit(&uc)?;
        let pace = code_hook(&mut uc)?;
        let mut machine = Self { uc, pace, guarded: None };
        machine.map_memories()?;
        machine.map_peripherals()?;
        machine.add_hooks()?;
        machine.translate()?;
        // None: with one the engine looks for what it has translated there each time it stops.
        machine.uc.ctl_exits_enable().map_err(engine("exits"))?;
        machine.start()?;
        Ok(machine)
    }

    fn map_memories(&mut self) -> Result<()> {
        let memory = &self.uc.get_data().soc.memory;
        let place = |r: &Region| (u64::from(r.base()), 4 * r.words().len() as u64, r.words().as_ptr() as usize);
        let (flash, sram, ccm) = (place(&memory.flash), place(&memory.sram), place(&memory.ccm));
        // Code runs from flash, also at its boot alias 0. CCM is data only (RM0090 section 2.3.1).
        let data = Prot::READ | Prot::WRITE;
        let maps = [
            (flash, flash.0, Prot::READ | Prot::EXEC),
            (flash, 0, Prot::READ | Prot::EXEC),
            (sram, sram.0, Prot::ALL),
            (ccm, ccm.0, data),
        ];
        for ((_, len, store), address, prot) in maps {
            // SAFETY: the store is an allocation of `len` bytes of atomics that lives in the engine's own data, is never
            // moved or freed before the engine, and is accessed by both only from this thread.
            unsafe { self.uc.mem_map_ptr(address, len, prot, store as *mut _) }.map_err(engine("map memory"))?;
        }
        Ok(())
    }

    fn map_peripherals(&mut self) -> Result<()> {
        for (base, len) in PERIPHERALS {
            let address = move |offset: u64| (base + offset) as u32;
            let read = move |uc: &mut Unicorn<'_, Chip<W>>, offset: u64, size: usize| {
                u64::from(uc.get_data_mut().read(address(offset), size as u8))
            };
            let write = move |uc: &mut Unicorn<'_, Chip<W>>, offset: u64, size: usize, value: u64| {
                uc.get_data_mut().write(address(offset), size as u8, value as u32);
            };
            self.uc.mmio_map(base, len, Some(read), Some(write)).map_err(engine("map peripherals"))?;
        }
        Ok(())
    }

    fn add_hooks(&mut self) -> Result<()> {
        let interrupt = |uc: &mut Unicorn<Chip<W>>, number: u32| {
            uc.get_data_mut().stop = Some(Stop::Raised(number));
            // The engine is between instructions here; stopping is safe.
            let _ = uc.emu_stop();
        };
        self.uc.add_intr_hook(interrupt).map_err(engine("interrupt hook"))?;
        for (from, to) in NOT_RAM {
            self.uc.add_mem_hook(REFUSALS, from, to, refused).map_err(engine("memory hook"))?;
        }
        Ok(())
    }

    /// Keeps from the engine what the MPU keeps from the processor now, and nothing else.
    fn follow_mpu(&mut self) -> Result<()> {
        let chip = self.uc.get_data_mut();
        chip.guards = chip.soc.core().guards;
        let wanted = chip.soc.core().forbidden();
        if self.guarded.as_ref().map(|(range, _)| range) == wanted.as_ref() {
            return Ok(());
        }
        let code_in_ram = self.uc.get_data().code_in_ram;
        if let Some((Range { start, end }, hook)) = self.guarded.take() {
            self.uc.remove_hook(hook).map_err(engine("remove a memory hook"))?;
            self.uc.mem_protect(start.into(), (end - start).into(), Prot::ALL).map_err(engine("protect RAM"))?;
        }
        if let Some(Range { start, end }) = wanted {
            if !RAM.contains(&start.into()) || !RAM.contains(&(end - 1).into()) {
                bail!("a region of the MPU outside of the RAM, at {start:#010x}, is not modelled");
            }
            let (from, to) = (u64::from(start), u64::from(end));
            self.uc.mem_protect(from, to - from, Prot::NONE).map_err(engine("protect RAM"))?;
            let hook = self.uc.add_mem_hook(REFUSALS, from, to - 1, refused).map_err(engine("memory hook"))?;
            self.guarded = Some((start..end, hook));
        }
        // Where it cuts the RAM in pieces the engine looks for code, at their begin. Nobody has run that, and no page is to
        // stay executable for it.
        self.uc.get_data_mut().code_in_ram = code_in_ram;
        self.uc.ctl_flush_tlb().map_err(engine("flush"))
    }

    /// Lets the engine find at address 0 what the chip has there now. Data that is written there is not modelled: the MPU refuses it.
    fn follow_remap(&mut self) -> Result<()> {
        let Some(wanted) = self.uc.get_data().remap() else { return Ok(()) };
        let memory = &self.uc.get_data().soc.memory;
        let store = if wanted { &memory.sram } else { &memory.flash }.words().as_ptr() as usize;
        self.uc.mem_unmap(0, AT_ZERO[usize::from(wanted)]).map_err(engine("unmap memory"))?;
        // SAFETY: as in `map_memories`.
        unsafe { self.uc.mem_map_ptr(0, AT_ZERO[usize::from(!wanted)], Prot::READ | Prot::EXEC, store as *mut _) }
            .map_err(engine("map memory"))?;
        self.uc.get_data_mut().remapped(wanted);
        self.uc.ctl_flush_tb().map_err(engine("flush"))?;
        self.uc.ctl_flush_tlb().map_err(engine("flush"))
    }

    /// Whether the MPU refuses some of these bytes.
    fn refuses(&mut self, from: u32, bytes: u32) -> bool {
        let forbidden = self.uc.get_data_mut().soc.core().forbidden();
        forbidden.is_some_and(|range| from < range.end && from.saturating_add(bytes) > range.start)
    }

    /// Whether it refuses to write there.
    fn refuses_writes(&mut self, at: u32) -> bool {
        self.uc.get_data_mut().soc.core().read_only().is_some_and(|range| range.contains(&at))
    }

    /// Lets the engine take addresses as they are. Its own view of the processor would have every page executable, and it
    /// searches what it has translated at each store into such a page. Here RAM is so only once code was fetched from it.
    /// What may not be done at an address is for the map of the memories and its hooks to say.
    fn translate(&mut self) -> Result<()> {
        self.uc.ctl_set_tlb_type(TlbType::VIRTUAL).map_err(engine("translation"))?;
        let identity = |uc: &mut Unicorn<Chip<W>>, address: u64, kind: MemType| {
            if kind != MemType::FETCH {
                leave_it_alone(uc);
            }
            let chip = uc.get_data_mut();
            chip.code_in_ram |= kind == MemType::FETCH && RAM.contains(&address);
            let data = RAM.contains(&address) && !chip.code_in_ram;
            Some(TlbEntry { paddr: address, perms: if data { Prot::READ | Prot::WRITE } else { Prot::ALL } })
        };
        self.uc.add_tlb_hook(1, 0, identity).map_err(engine("translation hook"))?;
        Ok(())
    }

    /// Takes stack pointer and start address from the vector table (ARMv7-M B1.5.5).
    fn start(&mut self) -> Result<()> {
        for r in [R::R0, R::R1, R::R2, R::R3, R::R4, R::R5, R::R6, R::R7, R::R8, R::R9, R::R10, R::R11, R::R12] {
            self.set(r, 0)?;
        }
        self.set(R::CONTROL, 0)?;
        for r in [R::PRIMASK, R::BASEPRI, R::FAULTMASK] {
            self.set(r, 0)?;
        }
        self.set(R::XPSR, 1 << 24)?;
        self.set(R::IPSR, 0)?;
        let (sp, pc) = (self.load(0x0800_0000)?, self.load(0x0800_0004)?);
        if pc & 1 == 0 {
            bail!("the reset vector {pc:#010x} is no Thumb address");
        }
        self.set(R::SP, sp & !3)?;
        self.set(R::LR, u32::MAX)?;
        self.set(R::PC, pc)?;
        self.uc.get_data_mut().restart();
        Ok(())
    }

    fn get(&self, register: R) -> Result<u32> {
        self.uc.reg_read(register).map(|v| v as u32).map_err(engine("read a register"))
    }

    fn set(&mut self, register: R, value: u32) -> Result<()> {
        self.uc.reg_write(register, value.into()).map_err(engine("write a register"))
    }

    fn float(&self, i: i32) -> Result<u32> {
        self.uc.reg_read(R::S0 as i32 + i).map(|v| v as u32).map_err(engine("read an FPU register"))
    }

    fn set_float(&mut self, i: i32, value: u32) -> Result<()> {
        self.uc.reg_write(R::S0 as i32 + i, value.into()).map_err(engine("write an FPU register"))
    }

    /// Lets the processor go on at `address` with the first arguments of a function there, as a debugger would.
    ///
    /// # Errors
    /// When the engine refuses.
    pub fn call(&mut self, address: u32, arguments: &[u32]) -> Result<()> {
        for (register, value) in [R::R0, R::R1, R::R2, R::R3].into_iter().zip(arguments) {
            self.set(register, *value)?;
        }
        let xpsr = self.get(R::XPSR)?;
        self.set(R::XPSR, xpsr & !(IT as u32))?;
        self.set(R::PC, address | 1)?;
        self.uc.get_data_mut().jump(address);
        Ok(())
    }

    /// Moves the stack pointer, as a program does that calls deeper and deeper; the newest of what lies on the stack goes
    /// along.
    ///
    /// # Errors
    /// When the engine refuses.
    pub fn set_stack(&mut self, address: u32) -> Result<()> {
        const NEWEST: u32 = 1024;
        let from = self.get(R::SP)?;
        let sram = &self.uc.get_data().soc.memory.sram;
        let newest: Vec<_> = (0..NEWEST).step_by(4).map_while(|at| Some((at, sram.load(from + at, 4)?))).collect();
        for (at, word) in newest {
            sram.store(address + at, 4, word);
        }
        self.set(R::SP, address)
    }

    /// The word at `address`, as a debugger would read it.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn load(&self, address: u32) -> Result<u32> {
        let m = &self.uc.get_data().soc.memory;
        let value = m.flash.load(address, 4).or_else(|| m.sram.load(address, 4)).or_else(|| m.ccm.load(address, 4));
        // VTOR is 0 after reset: the boot alias of flash.
        let value = value.or_else(|| m.flash.load(address.wrapping_add(0x0800_0000), 4));
        value.ok_or_else(|| anyhow!("no memory at {address:#010x}"))
    }

    /// The chip's peripherals and memories, and through them the world.
    pub fn soc(&mut self) -> &mut Soc<W> {
        let chip = self.uc.get_data_mut();
        chip.limit = 0;
        &mut chip.soc
    }

    /// What surrounds the chip.
    pub fn world(&self) -> &W {
        &self.uc.get_data().soc.world
    }

    /// Charges instructions of thread mode `factor` times their cycles, but never past the next interrupt: an idle loop that
    /// polls takes that much less work, interrupts keep their times. Code that masks interrupts is charged as it is. 1 is exact
    /// and the default.
    pub fn stretch_idle(&mut self, factor: u64) {
        self.uc.get_data_mut().stretch = factor.max(1);
    }

    /// From now on time passes by blocks of code instead of instructions, which is several times faster. An interrupt then
    /// comes up to a block late (a few dozen cycles), and what an instruction reads is as old as its block is long. WFI
    /// and WFE are refused, and nothing is metered.
    ///
    /// # Errors
    /// When the engine refuses.
    pub fn step_by_blocks(&mut self) -> Result<()> {
        self.uc.remove_hook(self.pace).map_err(engine("remove the code hook"))?;
        let hook = |uc: &mut Unicorn<Chip<W>>, address: u64, size: u32| before_block(uc, address as u32, size);
        self.pace = self.uc.add_block_hook(1, 0, hook).map_err(engine("block hook"))?;
        // What was translated calls the old hook.
        self.uc.ctl_flush_tb().map_err(engine("flush"))
    }

    /// From now on time passes by instructions again, as at power-up.
    ///
    /// # Errors
    /// When the engine refuses.
    pub fn step_by_instructions(&mut self) -> Result<()> {
        self.uc.remove_hook(self.pace).map_err(engine("remove the block hook"))?;
        self.pace = code_hook(&mut self.uc)?;
        self.uc.ctl_flush_tb().map_err(engine("flush"))
    }

    /// Starts cycle accounting, with marks at some addresses. It takes several times the host time.
    ///
    /// # Errors
    /// When the disassembler or a hook cannot be set up.
    pub fn start_meter(&mut self, marks: Marks) -> Result<()> {
        let read = |uc: &mut Unicorn<Chip<W>>, _: MemType, address: u64, _: usize, _: i64| {
            leave_it_alone(uc);
            if let Some(meter) = &mut uc.get_data_mut().meter {
                meter.read(address as u32);
            }
            true
        };
        self.uc.add_mem_hook(HookType::MEM_READ, 0x0800_0000, 0x080f_ffff, read).map_err(engine("read hook"))?;
        let shared = |uc: &mut Unicorn<Chip<W>>, _: MemType, _: u64, _: usize, _: i64| {
            leave_it_alone(uc);
            if let Some(meter) = &mut uc.get_data_mut().meter {
                meter.share();
            }
            true
        };
        let access = HookType(HookType::MEM_READ.0 | HookType::MEM_WRITE.0);
        for from in [0, 0x2000_0000] {
            self.uc.add_mem_hook(access, from, from + AT_ZERO[0] - 1, shared).map_err(engine("hook on RAM"))?;
        }
        // What was translated before does not call them.
        self.uc.ctl_flush_tb().map_err(engine("flush"))?;
        self.uc.ctl_flush_tlb().map_err(engine("flush"))?;
        let chip = self.uc.get_data_mut();
        let (core, apb1, apb2) = chip.soc.clocks();
        chip.meter = Some(Box::new(Meter::new(Buses::new(core / apb1, core / apb2), marks)?));
        Ok(())
    }

    /// Records each run of an exception from now on.
    pub fn record_spans(&mut self) {
        self.uc.get_data_mut().spans = Some(Vec::new());
    }

    /// The runs recorded so far, by time of entry.
    pub fn spans(&self) -> &[Span] {
        self.uc.get_data().spans.as_deref().unwrap_or(&[])
    }

    /// Lets `alter` change what the firmware writes into registers: to put a fault in and see that it is noticed.
    pub fn alter_writes(&mut self, alter: Alter) {
        self.uc.get_data_mut().alter = Some(alter);
    }

    /// The cycle accounting, once started.
    pub fn meter(&mut self) -> Option<&mut Meter> {
        self.uc.get_data_mut().meter.as_deref_mut()
    }

    /// What has been counted since power-up.
    pub fn stats(&self) -> &Stats {
        &self.uc.get_data().stats
    }

    /// A debugger halts the processor before its next instruction, until tick `until`: pins keep their levels, timers,
    /// converters and DMA go on.
    pub fn halt_until(&mut self, until: u64) {
        self.uc.get_data_mut().halt(until);
    }

    /// Runs until tick `until` (to the end of the instruction that passes it).
    ///
    /// # Errors
    /// What the model refuses, a processor lock-up, or a failure of the engine. All end the run for good.
    pub fn run_until(&mut self, until: u64) -> Result<()> {
        self.uc.get_data_mut().set_until(until);
        loop {
            if let Some(reset) = self.uc.get_data().soc.reset_request() {
                self.reset(reset)?;
            }
            if std::mem::take(&mut self.uc.get_data_mut().flash_open) {
                let len = FLASH.end - FLASH.start;
                self.uc.mem_protect(FLASH.start, len, Prot::READ | Prot::EXEC).map_err(engine("protect flash"))?;
            }
            let masks = self.masks()?;
            if self.uc.get_data_mut().sleep_until_woken(masks) {
                return Ok(());
            }
            if let Some(e) = self.uc.get_data().soc.error() {
                return Err(anyhow!(e).context(format!("at {:#010x}", self.get(R::PC)?)));
            }
            if let Some(e) = self.uc.get_data_mut().due_exception(masks) {
                self.enter(e)?;
            }
            if self.uc.get_data().time_is_up() {
                return Ok(());
            }
            self.follow_mpu()?;
            self.follow_remap()?;
            self.execute()?;
        }
    }

    /// Lets the engine run until something stops it, and deals with that.
    fn execute(&mut self) -> Result<()> {
        let pc = self.get(R::PC)?;
        let result = self.uc.emu_start((pc | 1).into(), 0, 0, 0);
        let at = self.uc.get_data().last;
        match (self.uc.get_data_mut().stop.take(), result) {
            (Some(Stop::Poll(address)), _) => {
                let pc = self.get(R::PC)?;
                if pc & !1 != address {
                    bail!("engine: stopped at {pc:#010x} instead of before {address:#010x}");
                }
                Ok(())
            }
            (Some(Stop::Sleep(next)), _) => {
                self.uc.get_data_mut().sleeping = true;
                self.set(R::PC, next | 1)
            }
            (Some(Stop::NoFpu(address)), _) => {
                self.set(R::PC, address | 1)?;
                self.fault(exception::USAGE_FAULT, 1 << 19, None)
            }
            (Some(Stop::Event(address)), _) => {
                bail!("WFE, SEV, or WFI inside a block, at {address:#010x}: not modelled")
            }
            (Some(Stop::Raised(8)), _) => self.leave(),
            (Some(Stop::Raised(2)), _) => {
                self.uc.get_data_mut().soc.nvic().pend(exception::SV_CALL);
                Ok(())
            }
            // A breakpoint without a debugger is a HardFault (ARMv7-M C1.3).
            (Some(Stop::Raised(7)), _) => {
                self.set(R::PC, at | 1)?;
                self.uc.get_data_mut().soc.core().hfsr |= 1 << 31;
                self.enter_fault(exception::HARD_FAULT)
            }
            (Some(Stop::Raised(n)), _) => bail!("engine: unexpected exception {n} at {at:#010x}"),
            (None, Err(uc_error::INSN_INVALID)) => {
                self.set(R::PC, at | 1)?;
                self.fault(exception::USAGE_FAULT, 1 << 16, None)
            }
            (None, Err(uc_error::FETCH_UNMAPPED | uc_error::FETCH_PROT)) => match self.get(R::PC)? >> 29 {
                // Peripherals, external devices and the system never hold code (ARMv7-M B3.1).
                _ if self.refuses(self.get(R::PC)?, 2) => self.fault(exception::MEM_MANAGE, 1 << 0, None),
                2 | 5.. => self.fault(exception::MEM_MANAGE, 1 << 0, None),
                _ => self.fault(exception::BUS_FAULT, 1 << 8, None),
            },
            (
                None,
                Err(uc_error::READ_UNMAPPED | uc_error::WRITE_UNMAPPED | uc_error::READ_PROT | uc_error::WRITE_PROT),
            ) => {
                let address = self.uc.get_data().bad_address;
                self.set(R::PC, at | 1)?;
                let written = matches!(result, Err(uc_error::WRITE_UNMAPPED | uc_error::WRITE_PROT));
                if self.refuses(address, 4) || written && self.refuses_writes(address) {
                    return self.fault(exception::MEM_MANAGE, 1 << 1 | 1 << 7, Some(address));
                }
                self.fault(exception::BUS_FAULT, 1 << 9 | 1 << 15, Some(address))
            }
            (None, Err(e)) => bail!("engine: {e:?} at {at:#010x}"),
            // An exception return may also end the engine's run without a hook.
            (None, Ok(())) if self.get(R::PC)? >> 8 == 0x00ff_ffff => self.leave(),
            (None, Ok(())) => bail!("engine: stopped at {at:#010x} without a reason"),
        }
    }

    fn reset(&mut self, cause: Reset) -> Result<()> {
        self.uc.get_data_mut().soc.reset(cause);
        self.uc.get_data_mut().stats.resets += 1;
        // A boot loader may have written another program.
        self.uc.get_data_mut().forget_code();
        self.uc.ctl_flush_tb().map_err(engine("flush"))?;
        self.start()
    }

    fn masks(&mut self) -> Result<Masks> {
        masks(&mut self.uc).map_err(engine("read a register"))
    }
}

/// The engine may not do an access. A hook on ordinary accesses would slow down all of them: flash is read-only to the engine,
/// so that a store into it comes here.
fn refused<W: World>(uc: &mut Unicorn<Chip<W>>, kind: MemType, address: u64, size: usize, value: i64) -> bool {
    if kind == MemType::WRITE_PROT && FLASH.contains(&address) {
        leave_it_alone(uc);
        uc.get_data_mut().flash_write(address as u32, size as u8, value as u32);
        return uc.mem_protect(FLASH.start, FLASH.end - FLASH.start, Prot::ALL).is_ok();
    }
    uc.get_data_mut().bad_address = address as u32;
    false
}

/// The mask registers; read again only after code that may have written them.
fn masks<W: World>(uc: &mut Unicorn<Chip<W>>) -> Result<Masks, uc_error> {
    let chip = uc.get_data();
    if let Some(known) = chip.masks.filter(|_| !chip.masks_changed) {
        return Ok(known);
    }
    let masks = Masks {
        primask: uc.reg_read(R::PRIMASK)? & 1 == 1,
        faultmask: uc.reg_read(R::FAULTMASK)? & 1 == 1,
        basepri: uc.reg_read(R::BASEPRI)? as u8,
    };
    uc.get_data_mut().masks = Some(masks);
    Ok(masks)
}

/// Before the engine calls a hook about an access it puts the place of the instruction into the processor's state, also that
/// in an IT block. When the access is made all the same, the translated code continues; it keeps that place to itself, and would
/// leave it for the code behind it, which would be skipped.
fn leave_it_alone<W>(uc: &mut Unicorn<Chip<W>>) {
    if let Ok(xpsr) = uc.reg_read(R::XPSR)
        && xpsr & IT != 0
    {
        let _ = uc.reg_write(R::XPSR, xpsr & !IT);
    }
}

fn code_hook<W: World + 'static>(uc: &mut Unicorn<'static, Chip<W>>) -> Result<UcHookId> {
    uc.add_code_hook(1, 0, |uc, address, _| before(uc, address as u32)).map_err(engine("code hook"))
}

/// Runs before each instruction: lets time pass, stops the engine when something has to happen first.
fn before<W: World>(uc: &mut Unicorn<Chip<W>>, address: u32) {
    let chip = uc.get_data_mut();
    if !chip.fast(address) {
        slow(uc, address);
    }
}

#[inline(never)]
fn slow<W: World>(uc: &mut Unicorn<Chip<W>>, address: u32) {
    let chip = uc.get_data_mut();
    let instruction = chip.instruction(address);
    chip.close_gap(address);
    // Inside an IT block the engine forgets a request to stop: what is due waits for the first instruction behind it.
    if !instruction.in_it && chip.half >= chip.limit && has_to_stop(uc) {
        uc.get_data_mut().stop = Some(Stop::Poll(address));
        let _ = uc.emu_stop();
        return;
    }
    if instruction.class != Class::Plain && special(uc, address, instruction.class) {
        let _ = uc.emu_stop();
        return;
    }
    if uc.get_data().meter.is_some() {
        measure(uc, address);
    }
    uc.get_data_mut().charge(address, instruction);
}

/// Runs before each block instead.
fn before_block<W: World>(uc: &mut Unicorn<Chip<W>>, address: u32, size: u32) {
    if !uc.get_data_mut().fast_block(address, size) {
        slow_block(uc, address, size);
    }
}

#[inline(never)]
fn slow_block<W: World>(uc: &mut Unicorn<Chip<W>>, address: u32, size: u32) {
    let chip = uc.get_data_mut();
    let block = chip.block(address, size);
    if chip.half >= chip.limit && has_to_stop(uc) {
        uc.get_data_mut().stop = Some(Stop::Poll(address));
        let _ = uc.emu_stop();
        return;
    }
    if block.waits {
        uc.get_data_mut().stop = Some(Stop::Event(address));
        let _ = uc.emu_stop();
        return;
    }
    if block.float && special(uc, address, Class::Float) {
        let _ = uc.emu_stop();
        return;
    }
    let chip = uc.get_data_mut();
    chip.charge_block(address, block);
    if block.masks {
        (chip.masks_changed, chip.limit) = (true, 0);
    }
}

fn measure<W: World>(uc: &mut Unicorn<Chip<W>>, address: u32) {
    let Some(mut meter) = uc.get_data_mut().meter.take() else { return };
    let register = |n: u8| uc.reg_read(R::R0 as i32 + i32::from(n)).unwrap_or(0) as u32;
    let memory = &uc.get_data().soc.memory;
    let code =
        |a: u32| if a < FLASH.start as u32 { memory.sram.load(a | 0x2000_0000, 1) } else { memory.flash.load(a, 1) };
    meter.step(address, code, register);
    uc.get_data_mut().meter = Some(meter);
}

/// Lets what is due happen, to the end of the code that has run. Returns whether the engine has to stop.
fn has_to_stop<W: World>(uc: &mut Unicorn<Chip<W>>) -> bool {
    loop {
        if poll(uc) {
            return true;
        }
        if !uc.get_data_mut().pass_rest() {
            return false;
        }
    }
}

/// Advances the chip to now. Returns whether the engine has to stop.
fn poll<W: World>(uc: &mut Unicorn<Chip<W>>) -> bool {
    let chip = uc.get_data_mut();
    if chip.catch_up() {
        return true;
    }
    if chip.masks_changed {
        let Ok(masks) = masks(uc) else { return true };
        let chip = uc.get_data_mut();
        chip.masks_changed = false;
        chip.mask(masks.primask || masks.faultmask || masks.basepri != 0);
    }
    let chip = uc.get_data_mut();
    if chip.soc.preempting(Masks::default()).is_none() {
        return false;
    }
    let Ok(masks) = masks(uc) else { return true };
    uc.get_data_mut().soc.preempting(masks).is_some()
}

/// Instructions the engine does not do by itself. Returns whether it has to stop.
fn special<W: World>(uc: &mut Unicorn<Chip<W>>, address: u32, class: Class) -> bool {
    let chip = uc.get_data_mut();
    match class {
        Class::Plain => false,
        Class::Masks => {
            chip.masks_changed = true;
            chip.limit = 0;
            false
        }
        Class::Wait => {
            let instruction = chip.instruction(address);
            chip.charge(address, instruction);
            chip.stop = Some(Stop::Sleep(address + u32::from(instruction.size)));
            true
        }
        Class::Event => {
            chip.stop = Some(Stop::Event(address));
            true
        }
        Class::Float if !chip.soc.core().fpu_on() => {
            chip.stop = Some(Stop::NoFpu(address));
            true
        }
        Class::Float => {
            if !chip.fpca {
                exceptions::new_float_context(uc);
            }
            false
        }
    }
}

/// Half ticks of a tick; a tick that never comes stays so.
fn half(tick: u64) -> u64 {
    if tick == NEVER { NEVER } else { 2 * tick }
}

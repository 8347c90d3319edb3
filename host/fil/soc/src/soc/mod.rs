//! The chip put together: time, event queue, reset. Registers are reached in [`bus`], signals run in [`wires`], what needs no event
//! of its own is in [`routine`].

mod bus;
mod routine;
#[cfg(test)]
pub(crate) mod tests;
mod wires;

use crate::adc::Adc;
use crate::backup::Backup;
use crate::can::Can;
use crate::core_regs::CoreRegs;
use crate::crc::Crc;
use crate::dac::Dac;
use crate::dma::Dma;
use crate::exti::Exti;
use crate::flash::Flash;
use crate::gpio::Gpio;
use crate::info::Dbgmcu;
use crate::iwdg::Iwdg;
use crate::memory::Memory;
use crate::nvic::{Exception, Masks, Nvic};
use crate::pins::Signal;
use crate::rcc::{Rcc, flag};
use crate::timer::{Event, KINDS, Timer};
use crate::world::{Change, Drive, Pin, World};
use crate::{Error, Fault, NEVER, TICK_HZ};

/// Why the chip was reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// Power came up.
    Power,
    /// The processor requested it (AIRCR).
    Software,
    /// The independent watchdog.
    Watchdog,
}

const PORTS: usize = 9;
/// Its registers, for errors.
const RCC: u32 = 0x4002_3800;

/// Places in the queue of events. Simultaneous events happen in this order.
mod slot {
    pub const WORLD: usize = 0;
    pub const TIMER: usize = 1;
    pub const ADC: usize = TIMER + 14;
    pub const CAN: usize = ADC + 3;
    pub const CORE: usize = CAN + 1;
    pub const WATCHDOG: usize = CORE + 1;
    pub const COUNT: usize = WATCHDOG + 1;
}

/// An STM32F405 and its surroundings. A clone continues by itself, with a halted processor, unless an engine runs one for
/// it: its memories are its own.
#[derive(Clone)]
pub struct Soc<W> {
    /// What surrounds the chip. After changing it from outside, call [`Soc::world_changed`].
    pub world: W,
    /// Memories.
    pub memory: Memory,
    now: u64,
    due: [u64; slot::COUNT],
    /// Earliest of them, or earlier: it is looked for again before anything is fired.
    next: u64,
    error: Option<Error>,
    reset: Option<Reset>,
    hse_hz: u64,
    core: CoreRegs,
    rcc: Rcc,
    flash: Flash,
    dbgmcu: Dbgmcu,
    exti: Exti,
    gpio: [Gpio; PORTS],
    levels: [u16; PORTS],
    drives: [[Drive; 16]; PORTS],
    routes: [[Option<Signal>; 16]; PORTS],
    /// Pins each timer's channels lead to: port, pin, channel index.
    timer_pins: [Vec<(u8, u8, u8)>; 14],
    timers: [Timer; 14],
    adcs: [Adc; 3],
    adc_common: u32,
    backup: Backup,
    /// The power is cut, and whether the backup SRAM keeps its words.
    cut: Option<bool>,
    dma: [Dma; 2],
    can: Can,
    crc: Crc,
    dac: Dac,
    dac_out: [u16; 2],
    iwdg: Iwdg,
    /// HCLK, PCLK1, PCLK2 that the peripherals use.
    clocks: (u64, u64, u64),
    half_ticks: u64,
    spare: Vec<Vec<Event>>,
    /// Conversions that are made without events.
    routine: Option<routine::Conversions>,
}

impl<W: World> Soc<W> {
    /// A chip at power-up with a crystal (or clock) of `hse_hz` on its oscillator pins.
    pub fn new(world: W, hse_hz: u64) -> Self {
        let mut soc = Self {
            world,
            memory: Memory::new(),
            now: 0,
            due: [NEVER; slot::COUNT],
            next: NEVER,
            error: None,
            reset: None,
            hse_hz,
            core: CoreRegs::new(),
            rcc: Rcc::new(hse_hz, flag::POWER | flag::PIN),
            flash: Flash::new(),
            dbgmcu: Dbgmcu::default(),
            exti: Exti::default(),
            gpio: core::array::from_fn(Gpio::new),
            levels: [0; PORTS],
            drives: [[Drive::Released; 16]; PORTS],
            routes: [[None; 16]; PORTS],
            timer_pins: Default::default(),
            timers: KINDS.map(Timer::new),
            adcs: [1, 2, 3].map(Adc::new),
            adc_common: 0,
            backup: Backup::new(),
            cut: None,
            dma: [Dma::new(), Dma::new()],
            can: Can::new(),
            crc: Crc::new(),
            dac: Dac::default(),
            dac_out: [0; 2],
            iwdg: Iwdg::new(),
            clocks: (0, 0, 0),
            half_ticks: 0,
            spare: Vec::new(),
            routine: None,
        };
        soc.start();
        soc
    }

    /// Brings wires and clocks to their state after reset.
    fn start(&mut self) {
        for port in 0..PORTS {
            self.levels[port] = self.gpio[port].levels();
        }
        self.world_changed();
        // The reset clock is valid: HSI without wait states.
        let _ = self.follow_clocks();
    }

    /// Resets everything but memory, the levels from outside and time. After a cut of the power memory is noise.
    pub fn reset(&mut self, cause: Reset) {
        if let Some(kept) = self.cut.take() {
            self.memory.scramble(self.now);
            self.rcc.keep_backup(kept);
            self.backup.power_is_back(kept, self.now);
        }
        let flags = flag::PIN
            | match cause {
                Reset::Power => flag::POWER,
                Reset::Software => flag::SOFTWARE,
                Reset::Watchdog => flag::WATCHDOG,
            };
        let kept = self.rcc.read(0x74, self.now).unwrap_or(0) & 0xfe00_0000;
        let kept = if cause == Reset::Power { 0 } else { kept };
        self.routine = None;
        let (supply, regulator) = (self.rcc.supply(), self.rcc.backup_kept());
        self.rcc = Rcc::new(self.hse_hz, flags | kept);
        self.rcc.keep_backup(regulator);
        self.rcc.set_supply(supply);
        self.core = CoreRegs::new();
        self.flash.reset();
        self.exti = Exti::default();
        self.timers = KINDS.map(Timer::new);
        self.adcs = [1, 2, 3].map(Adc::new);
        self.adc_common = 0;
        self.dma = [Dma::new(), Dma::new()];
        self.can = Can::new();
        self.crc = Crc::new();
        self.dac = Dac::default();
        self.iwdg = Iwdg::new();
        (self.clocks, self.half_ticks, self.reset) = ((0, 0, 0), 0, None);
        self.due = [NEVER; slot::COUNT];
        self.next = NEVER;
        for port in 0..PORTS {
            self.gpio[port].reset(port);
            self.refresh_port(port);
        }
        self.report_dac();
        self.start();
    }

    /// Now, in ticks.
    pub fn now(&self) -> u64 {
        self.now
    }

    /// Tick of the next event, or an earlier one; nothing changes by itself before, but codes of conversions that nothing takes note
    /// of (`routine`), which are in memory once time has passed.
    pub fn next_event(&self) -> u64 {
        self.next
    }

    /// Half ticks of a processor cycle: 2 at 168 MHz, 21 at reset.
    pub fn half_ticks_per_cycle(&self) -> u64 {
        self.half_ticks
    }

    /// Frequencies of processor, APB1 and APB2, Hz.
    pub fn clocks(&self) -> (u64, u64, u64) {
        self.clocks
    }

    /// Whether SRAM1 appears at address 0; else flash does.
    pub fn sram_at_zero(&self) -> bool {
        self.exti.remapped
    }

    /// Wait states of the flash, and whether it reads ahead and keeps instructions and data.
    pub fn flash_access(&self) -> (u32, bool) {
        (self.flash.latency(), self.flash.accelerated())
    }

    /// Tick until which the processor is stalled by a flash operation.
    pub fn stalled_until(&self) -> u64 {
        self.flash.busy_until
    }

    /// Erases and programmed words of the flash so far.
    pub fn flash_operations(&self) -> u64 {
        self.flash.operations
    }

    /// Lets the power fail in one of them, by its number, and come back at once.
    pub fn cut_in(&mut self, operation: Option<u64>) {
        self.flash.cut = operation;
    }

    /// Erases of each flash sector since power-up.
    pub fn erases(&self) -> [u32; 12] {
        self.flash.erases
    }

    /// The supply is `mv` from now on, mV. The voltage detector sees it; there is no reset below any of them.
    pub fn set_supply(&mut self, mv: u32) {
        self.rcc.set_supply(mv);
        self.refresh_supply();
    }

    /// The power is cut and comes back before the next instruction. RAM is noise then; the backup SRAM too, unless VBAT has a `cell` and
    /// its regulator was on (§5.1.2).
    pub fn cut_power(&mut self, cell: bool) {
        self.cut = Some(cell && self.rcc.backup_kept());
        self.reset = Some(Reset::Power);
    }

    /// The power is cut so many writes into the backup SRAM from now on.
    pub fn cut_at_backup_write(&mut self, writes: u32) {
        self.backup.cut_after(writes);
    }

    /// Sets the brown-out level of the option bytes, 0 (off, as on a new chip) to 3.
    pub fn set_brown_out(&mut self, level: u32) {
        self.flash.set_brown_out(level);
    }

    /// The first thing the model could not follow, if there is one. It stays.
    pub fn error(&self) -> Option<Error> {
        self.error
    }

    /// A reset that was requested and not yet done with [`Soc::reset`].
    pub fn reset_request(&self) -> Option<Reset> {
        self.reset
    }

    /// The chip is to be reset, before its next instruction.
    pub fn ask_reset(&mut self, cause: Reset) {
        self.reset = Some(cause);
    }

    /// The crystal stops. Without the clock security system the processor would stand, which ends in an error.
    pub fn lose_crystal(&mut self) {
        self.hse_hz = 0;
        if self.rcc.lose_crystal() {
            self.core.nvic.pend(crate::nvic::exception::NMI);
        }
        if let Err(fault) = self.follow_clocks() {
            self.fail(RCC, fault);
        }
    }

    /// Another crystal, from the next reset on.
    pub fn set_crystal(&mut self, hse_hz: u64) {
        self.hse_hz = hse_hz;
    }

    /// A converter, 1 to 3, stops for good.
    pub fn stop_converter(&mut self, number: usize) {
        self.end_routine();
        if let Some(adc) = self.adcs.get_mut(number.wrapping_sub(1)) {
            adc.stop();
        }
    }

    /// The watchdog's oscillator stops.
    pub fn stop_watchdog(&mut self) {
        self.iwdg.due = NEVER;
        self.set_due(slot::WATCHDOG, NEVER);
    }

    /// Exceptions of the processor.
    pub fn nvic(&mut self) -> &mut Nvic {
        &mut self.core.nvic
    }

    /// System registers of the processor.
    pub fn core(&mut self) -> &mut CoreRegs {
        &mut self.core
    }

    /// The exception that preempts now under `masks`.
    pub fn preempting(&self, masks: Masks) -> Option<Exception> {
        self.core.nvic.preempting(masks)
    }

    /// Whether the independent watchdog runs.
    pub fn watchdog_running(&self) -> bool {
        self.iwdg.due != NEVER
    }

    /// Bit time, ticks, and sample point, thousandths, of CAN1.
    pub fn can_timing(&self) -> (u64, u32) {
        (self.can.bit(), self.can.sample_point())
    }

    /// What the chip drives `pin` with.
    pub fn drive(&self, pin: Pin) -> Drive {
        self.drives[usize::from(pin.port)][usize::from(pin.number)]
    }

    /// The world was changed from outside: ask again when its next change is.
    pub fn world_changed(&mut self) {
        self.set_due(slot::WORLD, self.world.next_change());
    }

    /// A debugger halts the processor for `ticks`, from now on. What DBGMCU stops with it stops.
    pub fn halt(&mut self, ticks: u64) {
        // The cycle counter stands in debug state (ARMv7-M C1.8.3).
        self.core.slept(ticks);
        if self.dbgmcu.freezes_watchdog() && self.iwdg.due != NEVER {
            self.iwdg.due += ticks;
            self.set_due(slot::WATCHDOG, self.iwdg.due);
        }
        self.advance(self.now + ticks);
    }

    /// Lets time pass until tick `to`.
    pub fn advance(&mut self, to: u64) {
        while self.next <= to {
            // The first of those that are due at once.
            let first = self.due.iter().copied().enumerate().min_by_key(|(_, at)| *at);
            let (slot, at) = first.unwrap_or((0, NEVER));
            self.next = at;
            if at > to {
                break;
            }
            self.make_conversions(at, slot);
            // Due in the past: an output made the world answer at once.
            self.now = self.now.max(at);
            self.fire(slot);
        }
        self.make_conversions(to, slot::COUNT);
        self.now = self.now.max(to);
    }

    fn set_due(&mut self, slot: usize, at: u64) {
        self.due[slot] = at;
        self.next = self.next.min(at);
    }

    fn fire(&mut self, slot: usize) {
        match slot {
            slot::WORLD => self.take_changes(),
            slot::TIMER..slot::ADC => self.with_timer(slot - slot::TIMER, |t, now, out| t.fire(now, out)),
            slot::ADC..slot::CAN => self.fire_adc(slot - slot::ADC),
            slot::CAN => {
                self.can.fire(self.now, &mut self.world);
                self.refresh_can();
                self.world_changed();
            }
            slot::CORE => {
                self.core.settle(self.now);
                self.set_due(slot::CORE, self.core.due());
            }
            _ => {
                self.reset = Some(Reset::Watchdog);
                self.set_due(slot::WATCHDOG, NEVER);
            }
        }
    }

    fn take_changes(&mut self) {
        while let Some(change) = self.world.take_change(self.now) {
            match change {
                Change::Level(pin, level) => {
                    self.gpio[usize::from(pin.port)].set_outside(pin.number, level);
                    self.refresh_level(pin.port.into(), pin.number);
                }
                Change::Can(frame) => {
                    self.can.bus_frame(frame);
                    self.refresh_can();
                }
            }
        }
        let next = self.world.next_change();
        debug_assert!(next > self.now, "the world has a change due that it does not hand over");
        self.set_due(slot::WORLD, next);
    }

    /// Gives the peripherals the frequencies of the clock tree when they have changed.
    fn follow_clocks(&mut self) -> Result<(), Fault> {
        let now = self.now;
        let hclk = self.rcc.hclk(now);
        let (p1, p2) = self.rcc.pclk(now);
        let needed = crate::rcc::wait_states(hclk);
        if self.flash.latency() < needed {
            return Err(Fault::Unsupported("flash wait states are too few for this clock (table 10)"));
        }
        if hclk > 168_000_000 || p1 > 42_000_000 || p2 > 84_000_000 {
            return Err(Fault::Unsupported("clock above its limit: 168 MHz HCLK, 42 MHz APB1, 84 MHz APB2"));
        }
        if hclk > 144_000_000 && !self.rcc.full_voltage() {
            return Err(Fault::Unsupported("voltage scale 2 allows 144 MHz only"));
        }
        if (hclk, p1, p2) == self.clocks {
            return Ok(());
        }
        if !(2 * TICK_HZ).is_multiple_of(hclk) {
            return Err(Fault::Unsupported("processor clock does not divide 336 MHz"));
        }
        self.clocks = (hclk, p1, p2);
        self.half_ticks = 2 * TICK_HZ / hclk;
        self.core.set_cycle(self.half_ticks, now);
        self.set_due(slot::CORE, self.core.due());
        let (t1, t2) = self.rcc.timer_clocks(now);
        for (n, kind) in KINDS.iter().enumerate() {
            let hz = if matches!(kind.number, 1 | 8 | 9 | 10 | 11) { t2 } else { t1 };
            let ticks = (TICK_HZ.is_multiple_of(hz)).then(|| TICK_HZ / hz);
            self.with_timer(n, |t, now, out| t.set_clock(ticks, now, out));
        }
        self.can.clock = if TICK_HZ.is_multiple_of(p1) { TICK_HZ / p1 } else { 0 };
        self.follow_adc_clock();
        Ok(())
    }

    /// Converter clock: APB2 by 2, 4, 6, 8, at most 36 MHz (RM0090 §13.13.16, DS8626 §5.3.21).
    fn follow_adc_clock(&mut self) {
        let divider = 2 * (u64::from(self.adc_common >> 16 & 3) + 1);
        let p2 = self.clocks.2;
        let ticks = if TICK_HZ.is_multiple_of(p2) && p2 / divider <= 36_000_000 { TICK_HZ / p2 * divider } else { 0 };
        self.end_routine();
        for adc in &mut self.adcs {
            adc.clock = ticks;
        }
    }
}

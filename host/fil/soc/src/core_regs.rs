//! Registers of the processor's private peripherals: NVIC, SCB, SysTick, FPU, DWT cycle counter, debug control
//! (ARMv7-M B3.2..B3.4, B4, C1).

use crate::NEVER;
use crate::error::Fault;
use crate::mpu::Mpu;
use crate::nvic::{Nvic, exception};
use std::ops::Range;

mod csr {
    pub const ENABLE: u32 = 1;
    pub const TICKINT: u32 = 2;
    pub const CLKSOURCE: u32 = 4;
    pub const COUNTFLAG: u32 = 1 << 16;
}

/// What a write requests beyond the register itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Request {
    /// Nothing.
    None,
    /// System reset (AIRCR.SYSRESETREQ).
    Reset,
}

/// The system control space.
#[derive(Clone)]
pub struct CoreRegs {
    /// Exceptions.
    pub nvic: Nvic,
    /// Vector table offset.
    pub vtor: u32,
    /// Coprocessor access: the FPU is on when bits 20..=23 are all set.
    pub cpacr: u32,
    /// Configurable fault status.
    pub cfsr: u32,
    /// HardFault status.
    pub hfsr: u32,
    /// Faulting data address.
    pub bfar: u32,
    /// FPU context control.
    pub fpccr: u32,
    /// Address of the lazily saved FPU context.
    pub fpcar: u32,
    /// Default FPSCR of a new context.
    pub fpdscr: u32,
    /// Configuration and control.
    pub ccr: u32,
    /// Sleep control.
    pub scr: u32,
    /// Data address that the MPU has refused.
    pub mmfar: u32,
    mpu: Mpu,
    /// Writes to the MPU, wrapping: who keeps to what it forbids looks again when this changes.
    pub guards: u32,
    actlr: u32,
    demcr: u32,
    dwt_ctrl: u32,
    /// Half ticks of a processor cycle.
    half_ticks: u64,
    cycles: u32,
    cycles_at: u64,
    systick: SysTick,
}

/// SysTick counts down from RVR to 0 and reloads (B3.3).
#[derive(Clone)]
struct SysTick {
    csr: u32,
    reload: u32,
    /// Value at `base`.
    value: u32,
    base: u64,
}

impl CoreRegs {
    pub(crate) fn new() -> Self {
        Self {
            nvic: Nvic::new(),
            vtor: 0,
            cpacr: 0,
            cfsr: 0,
            hfsr: 0,
            bfar: 0,
            fpccr: 0xc000_0000,
            fpcar: 0,
            fpdscr: 0,
            ccr: 0x200,
            scr: 0,
            mmfar: 0,
            mpu: Mpu::default(),
            guards: 0,
            actlr: 0,
            demcr: 0,
            dwt_ctrl: 0x4000_0000,
            half_ticks: 21,
            cycles: 0,
            cycles_at: 0,
            systick: SysTick { csr: 0, reload: 0, value: 0, base: 0 },
        }
    }

    /// Whether FPU instructions are allowed (B3.2.20, CPACR).
    pub fn fpu_on(&self) -> bool {
        self.cpacr >> 20 & 15 == 15
    }

    /// Addresses that the processor may not touch: not in HardFault and NMI, for which the MPU is off (B3.5.5).
    pub fn forbidden(&self) -> Option<Range<u32>> {
        let faults = [exception::NMI, exception::HARD_FAULT];
        self.mpu.forbidden().filter(|_| !self.nvic.nesting().iter().any(|running| faults.contains(running)))
    }

    /// Addresses that the processor may not write; as [`Self::forbidden`].
    pub fn read_only(&self) -> Option<Range<u32>> {
        let faults = [exception::NMI, exception::HARD_FAULT];
        self.mpu.read_only().filter(|_| !self.nvic.nesting().iter().any(|running| faults.contains(running)))
    }

    /// The processor's clock changes: `half_ticks` of a cycle.
    pub(crate) fn set_cycle(&mut self, half_ticks: u64, now: u64) {
        self.settle(now);
        self.cycles = self.cycle_count(now);
        self.cycles_at = now;
        self.half_ticks = half_ticks;
    }

    /// DWT_CYCCNT.
    pub fn cycle_count(&self, now: u64) -> u32 {
        let on = self.demcr >> 24 & 1 == 1 && self.dwt_ctrl & 1 == 1;
        let passed = if on { now.saturating_sub(self.cycles_at) * 2 / self.half_ticks } else { 0 };
        self.cycles.wrapping_add(passed as u32)
    }

    /// The processor has slept for `ticks`: its clock stood still, and with it the cycle counter (RM0090 §5.3.3).
    pub fn slept(&mut self, ticks: u64) {
        self.cycles_at += ticks;
    }

    /// Half ticks of one SysTick count: a processor cycle, or eight (RM0090 §12.1.2).
    fn systick_half_ticks(&self) -> u64 {
        if self.systick.csr & csr::CLKSOURCE != 0 { self.half_ticks } else { 8 * self.half_ticks }
    }

    /// Tick at which SysTick next reaches zero.
    pub(crate) fn due(&self) -> u64 {
        let s = &self.systick;
        if s.csr & csr::ENABLE == 0 || (s.reload == 0 && s.value == 0) {
            return NEVER;
        }
        // From zero the next count loads the reload value.
        let counts = if s.value == 0 { u64::from(s.reload) + 1 } else { s.value.into() };
        s.base + (counts * self.systick_half_ticks()).div_ceil(2)
    }

    /// Brings SysTick up to `now`.
    pub(crate) fn settle(&mut self, now: u64) {
        while self.due() <= now {
            self.systick.base = self.due();
            self.systick.value = 0;
            self.systick.csr |= csr::COUNTFLAG;
            if self.systick.csr & csr::TICKINT != 0 {
                self.nvic.pend(exception::SYS_TICK);
            }
        }
    }

    fn systick_value(&self, now: u64) -> u32 {
        let s = &self.systick;
        if s.csr & csr::ENABLE == 0 {
            return s.value;
        }
        let passed = (now - s.base) * 2 / self.systick_half_ticks();
        match (s.value, passed) {
            (v, 0) => v,
            (0, n) => (u64::from(s.reload) + 1).saturating_sub(n) as u32,
            (v, n) => u64::from(v).saturating_sub(n) as u32,
        }
    }

    /// Reads the word at `address`.
    pub(crate) fn read(&mut self, address: u32, now: u64) -> Result<u32, Fault> {
        self.settle(now);
        let word = |base: u32| (address - base) / 4 * 32 + 16;
        let bits = |map: u128, from: u32| (map >> from) as u32;
        Ok(match address {
            0xe000_1000 => self.dwt_ctrl,
            0xe000_1004 => self.cycle_count(now),
            0xe000_e004 => 2, // ICTR: up to 96 interrupt lines
            0xe000_e008 => self.actlr,
            0xe000_e010 => {
                let v = self.systick.csr;
                self.systick.csr &= !csr::COUNTFLAG;
                v
            }
            0xe000_e014 => self.systick.reload,
            0xe000_e018 => self.systick_value(now),
            0xe000_e01c => 0x4000_493e, // CALIB of STM32F4: 18750, inexact (RM0090 §12.1.2)
            0xe000_e100..=0xe000_e108 => bits(self.nvic.enabled, word(0xe000_e100)),
            0xe000_e180..=0xe000_e188 => bits(self.nvic.enabled, word(0xe000_e180)),
            0xe000_e200..=0xe000_e208 => bits(self.nvic.pending(), word(0xe000_e200)),
            0xe000_e280..=0xe000_e288 => bits(self.nvic.pending(), word(0xe000_e280)),
            0xe000_e300..=0xe000_e308 => bits(self.nvic.active(), word(0xe000_e300)),
            0xe000_e400..=0xe000_e450 => self.priorities(16 + (address - 0xe000_e400) as u8),
            0xe000_ed00 => 0x410f_c241,
            0xe000_ed04 => self.icsr(),
            0xe000_ed08 => self.vtor,
            0xe000_ed0c => 0xfa05_0000 | self.nvic.group << 8,
            0xe000_ed10 => self.scr,
            0xe000_ed14 => self.ccr,
            0xe000_ed18..=0xe000_ed20 => self.priorities(4 + (address - 0xe000_ed18) as u8),
            0xe000_ed24 => self.shcsr(),
            0xe000_ed28 => self.cfsr,
            0xe000_ed2c => self.hfsr,
            0xe000_ed30 => 0,
            0xe000_ed34 => self.mmfar,
            0xe000_ed38 => self.bfar,
            0xe000_ed88 => self.cpacr,
            0xe000_ed90..=0xe000_eda0 => self.mpu.read(address)?,
            0xe000_edf0 => 0, // DHCSR: no debugger attached
            0xe000_edfc => self.demcr,
            0xe000_ef34 => self.fpccr,
            0xe000_ef38 => self.fpcar,
            0xe000_ef3c => self.fpdscr,
            0xe000_ef40 => 0x1011_0021,
            0xe000_ef44 => 0x1100_0011,
            _ => return Err(Fault::Unmodelled),
        })
    }

    fn priorities(&self, first: u8) -> u32 {
        u32::from_le_bytes([0, 1, 2, 3].map(|i| self.nvic.priority(first + i)))
    }

    fn icsr(&self) -> u32 {
        let active = self.nvic.active();
        let interrupt_pending = u32::from(self.nvic.pending() >> 16 != 0) << 22;
        let pending = u32::from(self.nvic.candidate().unwrap_or(0)) << 12;
        let return_to_base = u32::from(active.count_ones() < 2) << 11;
        let set = |e: u8, bit: u32| ((self.nvic.pending() >> e & 1) as u32) << bit;
        let running = u32::from(self.nvic.nesting().last().copied().unwrap_or(0));
        running
            | interrupt_pending
            | pending
            | return_to_base
            | set(exception::PEND_SV, 28)
            | set(exception::SYS_TICK, 26)
    }

    fn shcsr(&self) -> u32 {
        let map = [(exception::MEM_MANAGE, 16), (exception::BUS_FAULT, 17), (exception::USAGE_FAULT, 18)];
        map.iter().fold(0, |v, (e, bit)| v | ((self.nvic.enabled >> e & 1) as u32) << bit)
    }

    /// Writes the word at `address`; priorities may be written by byte or half word (`size`).
    pub(crate) fn write(&mut self, address: u32, size: u8, value: u32, now: u64) -> Result<Request, Fault> {
        self.settle(now);
        if let 0xe000_e400..=0xe000_e451 = address {
            self.set_priorities(16 + (address - 0xe000_e400) as u8, size, value);
            return Ok(Request::None);
        }
        if let 0xe000_ed18..=0xe000_ed23 = address {
            self.set_priorities(4 + (address - 0xe000_ed18) as u8, size, value);
            return Ok(Request::None);
        }
        let mask = |base: u32| u128::from(value) << ((address - base) / 4 * 32 + 16);
        match address {
            0xe000_1000 => {
                if value & 0x01ff_f01e & !0x1 != 0 {
                    return Err(Fault::Unsupported("only the cycle counter of the DWT is modelled"));
                }
                self.freeze_cycles(now);
                self.dwt_ctrl = 0x4000_0000 | value & 1;
            }
            0xe000_1004 => (self.cycles, self.cycles_at) = (value, now),
            0xe000_1fb0 => (), // LAR: the Cortex-M4 has no lock, code for other cores writes it
            0xe000_e008 => self.actlr = value,
            0xe000_e010 => {
                self.systick.value = self.systick_value(now);
                self.systick.base = now;
                self.systick.csr = self.systick.csr & csr::COUNTFLAG | value & 7;
            }
            0xe000_e014 => self.systick.reload = value & 0xff_ffff,
            // Any write clears value and flag (B3.3.5).
            0xe000_e018 => {
                (self.systick.value, self.systick.base) = (0, now);
                self.systick.csr &= !csr::COUNTFLAG;
            }
            0xe000_e100..=0xe000_e108 => self.nvic.enable(mask(0xe000_e100), true),
            0xe000_e180..=0xe000_e188 => self.nvic.enable(mask(0xe000_e180), false),
            0xe000_e200..=0xe000_e208 => {
                let mut left = mask(0xe000_e200);
                while left != 0 {
                    self.nvic.pend(left.trailing_zeros() as u8);
                    left &= left - 1;
                }
            }
            0xe000_e280..=0xe000_e288 => self.nvic.unpend(mask(0xe000_e280)),
            0xe000_ed04 => self.write_icsr(value),
            0xe000_ed08 => self.vtor = value & 0xffff_ff80,
            0xe000_ed0c if value >> 16 == 0x05fa => {
                self.nvic.group = value >> 8 & 7;
                if value & 4 != 0 {
                    return Ok(Request::Reset);
                }
            }
            0xe000_ed0c => (),
            0xe000_ed10 if value & 4 != 0 => return Err(Fault::Unsupported("deep sleep is not modelled")),
            0xe000_ed10 => self.scr = value & 0x12,
            0xe000_ed14 => self.ccr = value & 0x31b,
            0xe000_ed24 => {
                for (e, bit) in [(exception::MEM_MANAGE, 16), (exception::BUS_FAULT, 17), (exception::USAGE_FAULT, 18)]
                {
                    self.nvic.enable(1 << e, value >> bit & 1 == 1);
                }
            }
            0xe000_ed28 => self.cfsr &= !value,
            0xe000_ed2c => self.hfsr &= !value,
            0xe000_ed30 => (),
            0xe000_ed94..=0xe000_eda0 => {
                self.guards = self.guards.wrapping_add(1);
                self.mpu.write(address, value)?;
            }
            0xe000_ed88 => self.cpacr = value & 0x00f0_0000,
            0xe000_edfc => {
                self.freeze_cycles(now);
                self.demcr = value & 0x0100_07f1;
            }
            // Software trigger: NVIC_STIR.
            0xe000_ef00 if value & 0x1ff < crate::nvic::INTERRUPTS as u32 => self.nvic.pend(16 + (value & 0xff) as u8),
            0xe000_ef34 => self.fpccr = value & 0xc000_0000 | self.fpccr & 1,
            0xe000_ef38 => self.fpcar = value & !7,
            0xe000_ef3c => self.fpdscr = value & 0x07c0_0000,
            _ => return Err(Fault::Unmodelled),
        }
        Ok(Request::None)
    }

    fn freeze_cycles(&mut self, now: u64) {
        self.cycles = self.cycle_count(now);
        self.cycles_at = now;
    }

    fn set_priorities(&mut self, first: u8, size: u8, value: u32) {
        for (i, p) in value.to_le_bytes().into_iter().take(size.into()).enumerate() {
            self.nvic.set_priority(first + i as u8, p);
        }
    }

    fn write_icsr(&mut self, value: u32) {
        for (bit, e, set) in [
            (28, exception::PEND_SV, true),
            (27, exception::PEND_SV, false),
            (26, exception::SYS_TICK, true),
            (25, exception::SYS_TICK, false),
            (31, exception::NMI, true),
        ] {
            if value >> bit & 1 == 1 {
                if set { self.nvic.pend(e) } else { self.nvic.unpend(1 << e) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Full speed: one cycle is one tick.
    fn core() -> CoreRegs {
        let mut c = CoreRegs::new();
        c.set_cycle(2, 0);
        c
    }

    #[test]
    fn systick_pends_every_reload_plus_one_cycles() {
        let mut c = core();
        c.write(0xe000_e014, 4, 99, 0).unwrap();
        c.write(0xe000_e018, 4, 0, 0).unwrap();
        c.write(0xe000_e010, 4, 7, 0).unwrap();
        assert_eq!(c.due(), 100);
        c.settle(99);
        assert_eq!(c.nvic.candidate(), None);
        c.settle(100);
        assert_eq!(c.nvic.candidate(), Some(15));
        assert_eq!(c.due(), 200);
        assert_eq!(c.read(0xe000_e018, 101), Ok(99));
        assert_eq!(c.read(0xe000_e010, 101), Ok(7 | 1 << 16));
        assert_eq!(c.read(0xe000_e010, 101), Ok(7));
    }

    #[test]
    fn the_cycle_counter_needs_both_of_its_enables() {
        let mut c = core();
        c.write(0xe000_1000, 4, 1, 0).unwrap();
        assert_eq!(c.read(0xe000_1004, 500), Ok(0));
        c.write(0xe000_edfc, 4, 1 << 24, 500).unwrap();
        assert_eq!(c.read(0xe000_1004, 700), Ok(200));
        c.write(0xe000_1004, 4, u32::MAX, 700).unwrap();
        assert_eq!(c.read(0xe000_1004, 702), Ok(1));
    }

    #[test]
    fn the_cycle_counter_stands_still_in_sleep() {
        let mut c = core();
        c.write(0xe000_edfc, 4, 1 << 24, 0).unwrap();
        c.write(0xe000_1000, 4, 1, 0).unwrap();
        c.slept(300);
        assert_eq!(c.read(0xe000_1004, 500), Ok(200));
    }

    #[test]
    fn the_fpu_is_off_after_reset_and_needs_all_four_bits() {
        let mut c = core();
        assert!(!c.fpu_on());
        c.write(0xe000_ed88, 4, 0x0050_0000, 0).unwrap();
        assert!(!c.fpu_on());
        c.write(0xe000_ed88, 4, 0x00f0_0000, 0).unwrap();
        assert!(c.fpu_on());
    }

    #[test]
    fn reset_request_needs_the_key() {
        let mut c = core();
        assert_eq!(c.write(0xe000_ed0c, 4, 4, 0), Ok(Request::None));
        assert_eq!(c.write(0xe000_ed0c, 4, 0x05fa_0004, 0), Ok(Request::Reset));
    }

    #[test]
    fn priorities_are_byte_accessible() {
        let mut c = core();
        c.write(0xe000_e41c, 1, 0x30, 0).unwrap(); // interrupt 28
        c.write(0xe000_ed23, 1, 0xf0, 0).unwrap(); // SysTick
        assert_eq!((c.nvic.priority(44), c.nvic.priority(15)), (0x30, 0xf0));
        assert_eq!(c.read(0xe000_ed20, 0), Ok(0xf000_0000));
    }

    #[test]
    fn an_unmodelled_system_register_is_refused() {
        assert_eq!(core().read(0xe000_ed3c, 0), Err(Fault::Unmodelled));
        assert_eq!(core().write(0xe000_0000, 4, 0, 0), Err(Fault::Unmodelled));
    }
}

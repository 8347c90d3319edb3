//! The address map: which peripheral answers where, and whether it is clocked (RM0090 §2.3, table 1).

use super::{Reset, Soc, slot};
use crate::core_regs::Request;
use crate::error::{Access, Error, Fault};
use crate::info;
use crate::rcc::Gate;
use crate::timer::Event;
use crate::world::World;

/// A modelled peripheral.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Block {
    Timer(usize),
    Adc,
    Backup(usize),
    Can,
    Crc,
    Dac,
    Dma(usize),
    Exti,
    Flash,
    Gpio(usize),
    Iwdg,
    Pwr,
    Rcc,
    Syscfg,
}

struct Entry(u32, &'static str, Gate, Block);

/// Base, name, clock gate (§7.3.10..14) and kind of each modelled peripheral; 1 KiB each.
const MAP: [Entry; 39] = {
    use Block::{Adc, Backup, Can, Crc, Dac, Dma, Exti, Flash, Gpio, Iwdg, Pwr, Rcc, Syscfg, Timer};
    use Gate::{Ahb1, Always, Apb1, Apb2};
    [
        Entry(0x4000_0000, "TIM2", Apb1(0), Timer(1)),
        Entry(0x4000_0400, "TIM3", Apb1(1), Timer(2)),
        Entry(0x4000_0800, "TIM4", Apb1(2), Timer(3)),
        Entry(0x4000_0c00, "TIM5", Apb1(3), Timer(4)),
        Entry(0x4000_1000, "TIM6", Apb1(4), Timer(5)),
        Entry(0x4000_1400, "TIM7", Apb1(5), Timer(6)),
        Entry(0x4000_1800, "TIM12", Apb1(6), Timer(11)),
        Entry(0x4000_1c00, "TIM13", Apb1(7), Timer(12)),
        Entry(0x4000_2000, "TIM14", Apb1(8), Timer(13)),
        Entry(0x4000_3000, "IWDG", Always, Iwdg),
        Entry(0x4000_6400, "CAN1", Apb1(25), Can),
        Entry(0x4000_7000, "PWR", Apb1(28), Pwr),
        Entry(0x4000_7400, "DAC", Apb1(29), Dac),
        Entry(0x4001_0000, "TIM1", Apb2(0), Timer(0)),
        Entry(0x4001_0400, "TIM8", Apb2(1), Timer(7)),
        Entry(0x4001_2000, "ADC", Always, Adc),
        Entry(0x4001_3800, "SYSCFG", Apb2(14), Syscfg),
        Entry(0x4001_3c00, "EXTI", Always, Exti),
        Entry(0x4001_4000, "TIM9", Apb2(16), Timer(8)),
        Entry(0x4001_4400, "TIM10", Apb2(17), Timer(9)),
        Entry(0x4001_4800, "TIM11", Apb2(18), Timer(10)),
        Entry(0x4002_0000, "GPIOA", Ahb1(0), Gpio(0)),
        Entry(0x4002_0400, "GPIOB", Ahb1(1), Gpio(1)),
        Entry(0x4002_0800, "GPIOC", Ahb1(2), Gpio(2)),
        Entry(0x4002_0c00, "GPIOD", Ahb1(3), Gpio(3)),
        Entry(0x4002_1000, "GPIOE", Ahb1(4), Gpio(4)),
        Entry(0x4002_1400, "GPIOF", Ahb1(5), Gpio(5)),
        Entry(0x4002_1800, "GPIOG", Ahb1(6), Gpio(6)),
        Entry(0x4002_1c00, "GPIOH", Ahb1(7), Gpio(7)),
        Entry(0x4002_2000, "GPIOI", Ahb1(8), Gpio(8)),
        Entry(0x4002_3000, "CRC", Ahb1(12), Crc),
        Entry(0x4002_3800, "RCC", Always, Rcc),
        Entry(0x4002_3c00, "FLASH", Always, Flash),
        Entry(0x4002_4000, "BKPSRAM", Ahb1(18), Backup(0)),
        Entry(0x4002_4400, "BKPSRAM", Ahb1(18), Backup(1)),
        Entry(0x4002_4800, "BKPSRAM", Ahb1(18), Backup(2)),
        Entry(0x4002_4c00, "BKPSRAM", Ahb1(18), Backup(3)),
        Entry(0x4002_6000, "DMA1", Ahb1(21), Dma(0)),
        Entry(0x4002_6400, "DMA2", Ahb1(22), Dma(1)),
    ]
};

/// Peripherals of the chip that are not modelled, so that an error can name them.
const OTHERS: [(u32, &str); 25] = [
    (0x4000_2800, "RTC"),
    (0x4000_2c00, "WWDG"),
    (0x4000_3400, "I2S2ext"),
    (0x4000_3800, "SPI2"),
    (0x4000_3c00, "SPI3"),
    (0x4000_4000, "I2S3ext"),
    (0x4000_4400, "USART2"),
    (0x4000_4800, "USART3"),
    (0x4000_4c00, "UART4"),
    (0x4000_5000, "UART5"),
    (0x4000_5400, "I2C1"),
    (0x4000_5800, "I2C2"),
    (0x4000_5c00, "I2C3"),
    (0x4000_6800, "CAN2"),
    (0x4001_1000, "USART1"),
    (0x4001_1400, "USART6"),
    (0x4001_2c00, "SDIO"),
    (0x4001_3000, "SPI1"),
    (0x4002_8000, "ETH"),
    (0x4004_0000, "OTG_HS"),
    (0x5000_0000, "OTG_FS"),
    (0x5005_0000, "DCMI"),
    (0x5006_0000, "CRYP"),
    (0x5006_0800, "RNG"),
    (0xe000_0000, "ITM"),
];

/// Where the peripherals begin.
const FIRST: u32 = 0x4000_0000;

/// Place in [`MAP`] of what answers in each KiB of theirs.
const PLACES: [Option<u8>; 0x9a] = {
    let mut places = [None; 0x9a];
    let mut i = 0;
    while i < MAP.len() {
        places[((MAP[i].0 - FIRST) >> 10) as usize] = Some(i as u8);
        i += 1;
    }
    places
};

fn find(address: u32) -> Option<&'static Entry> {
    let place = PLACES.get((address.checked_sub(FIRST)? >> 10) as usize)?;
    MAP.get(usize::from((*place)?))
}

/// Registers that may be written by half word at a word address: their upper half is reserved.
fn narrow(block: Block, offset: u32) -> bool {
    matches!(block, Block::Timer(_) | Block::Iwdg) || matches!(block, Block::Gpio(_)) && offset == 0x18
}

impl<W: World> Soc<W> {
    fn describe(&self, address: u32, access: Option<Access>, fault: Fault) -> Error {
        let (peripheral, base) = match find(address) {
            Some(e) => (e.1, e.0),
            None if address >= 0xe000_1000 => ("system register", 0),
            None => OTHERS
                .iter()
                .rev()
                .find(|o| o.0 <= address && address - o.0 < 0x1_0000)
                .map_or(("reserved address", 0), |o| (o.1, o.0)),
        };
        Error { peripheral, offset: address - base, access, fault, at: self.now }
    }

    fn record<T>(&mut self, address: u32, access: Access, result: Result<T, Fault>) -> Result<T, Error> {
        result.map_err(|fault| {
            let error = self.describe(address, Some(access), fault);
            self.error.get_or_insert(error);
            error
        })
    }

    /// An event, not an access, led to `fault`.
    pub(super) fn fail(&mut self, address: u32, fault: Fault) {
        let error = self.describe(address, None, fault);
        self.error.get_or_insert(error);
    }

    /// The processor (or DMA) reads `size` bytes at `address`, outside of memories.
    ///
    /// # Errors
    /// What is not modelled; also kept in [`Soc::error`].
    pub fn read(&mut self, address: u32, size: u8) -> Result<u32, Error> {
        let result = match address {
            0x2200_0000..0x2400_0000 | 0x4200_0000..0x4400_0000 => return self.read_bit(address),
            0x1fff_7a00..0x1fff_7c00 => info::system_memory(address).ok_or(Fault::Unmodelled),
            0xe004_2000..0xe004_2400 => self.dbgmcu.read(address & 0x3fc).ok_or(Fault::Unmodelled),
            0xe000_0000.. => {
                let now = self.now;
                self.core.read(address & !3, now)
            }
            _ => self.read_word(address & !3),
        };
        let word = self.record(address, Access::Read(size), result)?;
        Ok(word >> (8 * (address & 3)) & (u64::MAX >> (64 - 8 * u32::from(size))) as u32)
    }

    /// The processor writes `size` bytes at `address`, outside of memories.
    ///
    /// # Errors
    /// What is not modelled; also kept in [`Soc::error`].
    pub fn write(&mut self, address: u32, size: u8, value: u32) -> Result<(), Error> {
        let result = match address {
            0x2200_0000..0x2400_0000 | 0x4200_0000..0x4400_0000 => return self.write_bit(address, value & 1 == 1),
            0xe004_2000..0xe004_2400 => self.dbgmcu.write(address & 0x3fc, value).ok_or(Fault::Unmodelled),
            0xe000_0000.. => self.write_core(address, size, value),
            _ => self.write_peripheral(address, size, value),
        };
        self.record(address, Access::Write(size, value), result)
    }

    fn write_core(&mut self, address: u32, size: u8, value: u32) -> Result<(), Fault> {
        if self.core.write(address, size, value, self.now)? == Request::Reset {
            self.reset = Some(Reset::Software);
        }
        self.set_due(slot::CORE, self.core.due());
        Ok(())
    }

    fn write_peripheral(&mut self, address: u32, size: u8, value: u32) -> Result<(), Fault> {
        let Some(&Entry(base, _, gate, block)) = find(address) else { return Err(Fault::Unmodelled) };
        if !self.rcc.enabled(gate) {
            return Err(Fault::ClockOff);
        }
        let offset = address - base;
        match size {
            4 if offset & 3 == 0 => self.write_word(block, offset, value),
            2 if offset & 3 == 0 && narrow(block, offset) => self.write_word(block, offset, value),
            2 if matches!(block, Block::Gpio(_)) && offset == 0x1a => self.write_word(block, 0x18, value << 16),
            _ => Err(Fault::Unsupported("byte and half-word writes are not modelled here")),
        }
    }

    /// Aliased bit: byte (alias - base) / 32, bit (alias % 32) / 4 (§2.3.3).
    fn bit_band(address: u32) -> (u32, u32) {
        let region = address & 0xf000_0000;
        let offset = address & 0x01ff_ffff;
        (region + ((offset / 32) & !3), offset / 4 % 32)
    }

    fn read_bit(&mut self, address: u32) -> Result<u32, Error> {
        let (word, bit) = Self::bit_band(address);
        let value = match self.memory.sram.load(word, 4) {
            Some(v) => v,
            None => self.read(word, 4)?,
        };
        Ok(value >> bit & 1)
    }

    fn write_bit(&mut self, address: u32, on: bool) -> Result<(), Error> {
        let (word, bit) = Self::bit_band(address);
        let set = |v: u32| v & !(1 << bit) | u32::from(on) << bit;
        if let Some(v) = self.memory.sram.load(word, 4) {
            self.memory.sram.store(word, 4, set(v));
            return Ok(());
        }
        let v = self.read(word, 4)?;
        self.write(word, 4, set(v))
    }

    pub(super) fn read_word(&mut self, address: u32) -> Result<u32, Fault> {
        let Some(&Entry(base, _, gate, block)) = find(address) else { return Err(Fault::Unmodelled) };
        if !self.rcc.enabled(gate) {
            return Err(Fault::ClockOff);
        }
        let (offset, now) = (address - base, self.now);
        match block {
            Block::Timer(n) => self.with_timer(n, |t, now, out| t.read(offset, now, out)),
            Block::Adc => self.read_adc(offset),
            Block::Backup(n) => Ok(self.backup.words[n << 8 | offset as usize >> 2]),
            Block::Can => self.can.read(offset, now),
            Block::Crc => self.crc.read(offset),
            Block::Dac => self.dac.read(offset),
            Block::Dma(n) => self.dma[n].read(offset),
            Block::Exti => self.exti.read(offset),
            Block::Flash => self.flash.read(offset, now),
            Block::Gpio(n) => self.gpio[n].read(offset),
            Block::Iwdg => self.iwdg.read(offset),
            Block::Pwr => self.rcc.read_power(offset),
            Block::Rcc => {
                let value = self.rcc.read(offset, now)?;
                self.follow_clocks()?;
                Ok(value)
            }
            Block::Syscfg => self.exti.read_syscfg(offset),
        }
    }

    fn write_word(&mut self, block: Block, offset: u32, value: u32) -> Result<(), Fault> {
        let now = self.now;
        match block {
            Block::Timer(n) => {
                self.with_timer(n, |t, now, out: &mut Vec<Event>| t.write(offset, value, now, out))?;
                match offset {
                    0x08 => self.end_shared_routine(),
                    0x44 => self.refresh_break(n),
                    _ => (),
                }
            }
            Block::Adc => self.write_adc(offset, value)?,
            // §5.1.2: protected after a reset. The chip ignores such a write; a program that does one is wrong.
            Block::Backup(_) if !self.rcc.backup_open() => {
                return Err(Fault::Unsupported("a write to the protected backup domain (DBP) has no effect"));
            }
            Block::Backup(n) => {
                if self.backup.write(n << 8 | offset as usize >> 2, value) {
                    self.cut_power(true);
                }
            }
            Block::Can => {
                self.can.write(offset, value, now)?;
                self.refresh_can();
            }
            Block::Crc => self.crc.write(offset, value)?,
            Block::Dac => {
                self.dac.write(offset, value)?;
                self.report_dac();
            }
            Block::Dma(n) => {
                self.end_routine_by(n, offset);
                self.dma[n].write(offset, value)?;
                self.refresh_dma(n);
            }
            Block::Exti => {
                self.exti.write(offset, value)?;
                self.refresh_exti();
            }
            Block::Flash => {
                self.flash.write(offset, value, now, &self.memory.flash)?;
                self.fail_with_flash();
                self.follow_clocks()?;
            }
            Block::Gpio(n) => {
                let pins = self.gpio[n].write(offset, value)?;
                self.refresh_pins(n, pins);
            }
            Block::Iwdg => {
                if self.iwdg.write(offset, value, now)? {
                    self.rcc.force_lsi(now);
                }
                self.set_due(slot::WATCHDOG, self.iwdg.due);
            }
            Block::Pwr => {
                self.rcc.write_power(offset, value)?;
                self.refresh_supply();
            }
            Block::Rcc => {
                self.end_routine();
                self.rcc.write(offset, value, now)?;
                if let 0x10..=0x24 = offset {
                    self.reset_blocks();
                }
                self.follow_clocks()?;
            }
            Block::Syscfg => {
                self.exti.write_syscfg(offset, value)?;
            }
        }
        Ok(())
    }

    /// A write of the processor into the flash array: programming.
    pub fn program(&mut self, address: u32, size: u8, value: u32) {
        self.flash.program(address, size.into(), value, self.now, &self.memory.flash);
        self.fail_with_flash();
    }

    fn fail_with_flash(&mut self) {
        if std::mem::take(&mut self.flash.failed) {
            self.ask_reset(Reset::Power);
        }
    }

    /// Resets the peripherals whose reset bit is set.
    fn reset_blocks(&mut self) {
        for Entry(_, _, gate, block) in &MAP {
            if self.rcc.in_reset(*gate) {
                self.reset_block(*block);
            }
        }
        // All three converters share one reset bit, ADC1's.
        if self.rcc.in_reset(Gate::Apb2(8)) {
            self.reset_block(Block::Adc);
        }
    }

    fn adc_gate(number: usize) -> Gate {
        Gate::Apb2(8 + number as u8)
    }

    fn read_adc(&mut self, offset: u32) -> Result<u32, Fault> {
        let n = (offset >> 8) as usize;
        self.end_routine_of(n);
        if n < 3 {
            if !self.rcc.enabled(Self::adc_gate(n)) {
                return Err(Fault::ClockOff);
            }
            let value = self.adcs[n].read(offset & 0xff)?;
            self.refresh_adc(n);
            return Ok(value);
        }
        match offset {
            0x300 => Ok((0..3).fold(0, |v, n| v | self.adcs[n].flags() << (8 * n))),
            0x304 => Ok(self.adc_common),
            _ => Err(Fault::Unmodelled),
        }
    }

    fn write_adc(&mut self, offset: u32, value: u32) -> Result<(), Fault> {
        let n = (offset >> 8) as usize;
        self.end_routine_of(n);
        if n < 3 {
            if !self.rcc.enabled(Self::adc_gate(n)) {
                return Err(Fault::ClockOff);
            }
            self.adcs[n].write(offset & 0xff, value, self.now)?;
            self.refresh_adc(n);
            self.end_shared_routine();
            return Ok(());
        }
        match offset {
            0x304 if value & 0xef1f != 0 => Err(Fault::Unsupported("multi-converter modes are not modelled")),
            0x304 => {
                self.adc_common = value & 0x00c3_0000;
                self.follow_adc_clock();
                Ok(())
            }
            _ => Err(Fault::Unmodelled),
        }
    }
}

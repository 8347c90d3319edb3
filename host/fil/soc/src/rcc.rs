//! Reset and clock control, and the power controller's voltage scale (RM0090 §7, §5).
//!
//! Oscillators and PLL become ready after the typical times of the data sheet (DS8626 §5.3.8..10); a clock switch waits
//! for its source, as §7.2.6 says.

use crate::error::Fault;
use crate::{NEVER, TICK_HZ};

const HSI_HZ: u64 = 16_000_000;
/// Start-up times, ticks: HSI 2.2 us, HSE 2 ms, LSI 15 us, PLL lock 100 us, voltage scale 10 us.
const HSI_START: u64 = 370;
const HSE_START: u64 = TICK_HZ / 500;
const LSI_START: u64 = 2520;
const PLL_LOCK: u64 = TICK_HZ / 10_000;

/// Thresholds of the voltage detector by PLS, falling and rising, typical, mV (DS8626, embedded reset and power control block).
const PVD: [(u32, u32); 8] =
    [(2040, 2140), (2190, 2300), (2350, 2450), (2510, 2600), (2660, 2760), (2820, 2930), (2930, 3030), (3030, 3140)];

/// Reset flags of RCC_CSR (§7.3.21).
pub mod flag {
    pub const PIN: u32 = 1 << 26;
    pub const POWER: u32 = 1 << 27 | 1 << 25;
    pub const SOFTWARE: u32 = 1 << 28;
    pub const WATCHDOG: u32 = 1 << 29;
}

/// The register that gates a peripheral's clock, as an index into the bank of enable registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gate {
    /// RCC_AHB1ENR bit.
    Ahb1(u8),
    /// RCC_APB1ENR bit.
    Apb1(u8),
    /// RCC_APB2ENR bit.
    Apb2(u8),
    /// No gate: always clocked.
    Always,
}

/// One source: switched on or off, ready some time after.
#[derive(Clone, Copy)]
struct Source(u64);

impl Source {
    fn switch(&mut self, on: bool, now: u64, start: u64) {
        match (on, self.0) {
            (false, _) => self.0 = NEVER,
            (true, NEVER) => self.0 = now + start,
            _ => (),
        }
    }
    fn ready(self, now: u64) -> bool {
        self.0 <= now
    }
}

#[derive(Clone)]
pub struct Rcc {
    hse_hz: u64,
    cr: u32,
    pllcfgr: u32,
    cfgr: u32,
    /// RSTR, ENR and LPENR of AHB1..3, APB1, APB2 at 0x10..=0x64, by word.
    bank: [u32; 22],
    csr: u32,
    hsi: Source,
    hse: Source,
    pll: Source,
    lsi: Source,
    /// Source in use, as SWS reads.
    sws: u32,
    power: u32,
    /// The regulator of the backup SRAM, BRE: no reset changes it.
    backup: bool,
    /// Supply, mV, and whether the detector finds it low.
    supply: u32,
    low: bool,
}

/// Offsets of the bank that exist (§7.3.5..19).
const BANK: [u32; 15] = [0x10, 0x14, 0x18, 0x20, 0x24, 0x30, 0x34, 0x38, 0x40, 0x44, 0x50, 0x54, 0x58, 0x60, 0x64];

impl Rcc {
    pub fn new(hse_hz: u64, reset_flags: u32) -> Self {
        let mut bank = [0; 22];
        for (offset, value) in [
            (0x30, 0x0010_0000),
            (0x50, 0x7e67_91ff),
            (0x54, 0xf1),
            (0x58, 1),
            (0x60, 0x36fe_c9ff),
            (0x64, 0x0007_5f33),
        ] {
            bank[(offset - 0x10) / 4] = value;
        }
        Self {
            hse_hz,
            cr: 0x81,
            pllcfgr: 0x2400_3010,
            cfgr: 0,
            bank,
            csr: reset_flags,
            hsi: Source(0),
            hse: Source(NEVER),
            pll: Source(NEVER),
            lsi: Source(NEVER),
            sws: 0,
            power: 0x4000,
            backup: false,
            supply: 3300,
            low: false,
        }
    }

    pub fn read(&mut self, offset: u32, now: u64) -> Result<u32, Fault> {
        self.settle(now);
        let bit = |ready: Source, n: u32| u32::from(ready.ready(now)) << n;
        Ok(match offset {
            0x00 => self.cr | bit(self.hsi, 1) | bit(self.hse, 17) | bit(self.pll, 25),
            0x04 => self.pllcfgr,
            0x08 => self.cfgr & !0xc | self.sws << 2,
            0x74 => self.csr | bit(self.lsi, 1),
            _ if BANK.contains(&offset) => self.bank[(offset as usize - 0x10) / 4],
            _ => return Err(Fault::Unmodelled),
        })
    }

    pub fn write(&mut self, offset: u32, value: u32, now: u64) -> Result<(), Fault> {
        self.settle(now);
        match offset {
            0x00 => {
                if value & 1 << 26 != 0 {
                    return Err(Fault::Unsupported("PLLI2S is not modelled"));
                }
                self.cr = value & 0x010d_00f9;
                self.hsi.switch(value & 1 != 0, now, HSI_START);
                self.hse.switch(value & 1 << 16 != 0 && self.hse_hz > 0, now, HSE_START);
                self.pll.switch(value & 1 << 24 != 0, now, PLL_LOCK);
            }
            // §7.3.2: the configuration can be written only while the PLL is off.
            0x04 if self.cr & 1 << 24 != 0 => return Err(Fault::Unsupported("PLLCFGR written while the PLL is on")),
            0x04 => self.pllcfgr = value,
            0x08 => {
                if value & 3 == 3 {
                    return Err(Fault::Unsupported("system clock source 3 does not exist"));
                }
                self.cfgr = value & !0xc;
            }
            0x74 => {
                self.lsi.switch(value & 1 != 0, now, LSI_START);
                self.csr = self.csr & !1 | value & 1;
                if value & 1 << 24 != 0 {
                    self.csr &= 1;
                }
            }
            _ if BANK.contains(&offset) => self.bank[(offset as usize - 0x10) / 4] = value,
            _ => return Err(Fault::Unmodelled),
        }
        self.settle(now);
        Ok(())
    }

    /// PWR_CR and PWR_CSR (§5.4): voltage scale and backup write protection.
    pub fn read_power(&self, offset: u32) -> Result<u32, Fault> {
        match offset {
            0 => Ok(self.power),
            // VOSRDY; the wait for the regulator is part of the PLL's lock time. PVDO, BRE and BRR.
            4 => Ok(1 << 14 | u32::from(self.low) << 2 | u32::from(self.backup) << 9 | u32::from(self.backup) << 3),
            _ => Err(Fault::Unmodelled),
        }
    }

    pub fn write_power(&mut self, offset: u32, value: u32) -> Result<(), Fault> {
        match offset {
            0 if value & 0x3 != 0 => Err(Fault::Unsupported("low-power modes are not modelled")),
            0 => {
                self.power = value & 0x43f0;
                Ok(())
            }
            4 if !self.backup_open() => {
                Err(Fault::Unsupported("a write to the protected backup domain (DBP) has no effect"))
            }
            4 => {
                self.backup = value & 1 << 9 != 0;
                Ok(())
            }
            _ => Err(Fault::Unmodelled),
        }
    }

    /// Writes to the backup domain are allowed: DBP.
    pub fn backup_open(&self) -> bool {
        self.power & 1 << 8 != 0
    }

    /// VBAT supplies the backup SRAM.
    pub fn backup_kept(&self) -> bool {
        self.backup
    }

    pub fn keep_backup(&mut self, on: bool) {
        self.backup = on;
    }

    /// The supply in mV, also after a reset.
    pub fn supply(&self) -> u32 {
        self.supply
    }

    pub fn set_supply(&mut self, mv: u32) {
        self.supply = mv;
    }

    /// Checks the supply. Returns the detector's output, if it has changed.
    pub fn detect(&mut self) -> Option<bool> {
        let (falling, rising) = PVD[(self.power >> 5 & 7) as usize];
        let threshold = if self.low { rising } else { falling };
        let low = self.power >> 4 & 1 == 1 && self.supply < threshold;
        (core::mem::replace(&mut self.low, low) != low).then_some(low)
    }

    /// The crystal stops, or does not start any more. Whether the clock security system reports it (§7.2.7): then HSE and
    /// PLL are off and the internal oscillator is the system clock. That TIM1 and TIM8 see a break is not modelled.
    pub fn lose_crystal(&mut self) -> bool {
        self.hse_hz = 0;
        self.hse = Source(NEVER);
        let reported = self.cr >> 19 & 1 == 1;
        if reported {
            self.cr = self.cr & !(1 << 16 | 1 << 24) | 1;
            (self.hsi, self.pll, self.sws) = (Source(0), Source(NEVER), 0);
            self.cfgr &= !3;
        }
        reported
    }

    fn settle(&mut self, now: u64) {
        let wanted = self.cfgr & 3;
        if [self.hsi, self.hse, self.pll][wanted as usize].ready(now) {
            self.sws = wanted;
        }
    }

    /// Turns the watchdog's oscillator on, as starting the watchdog does (§21.3).
    pub fn force_lsi(&mut self, now: u64) {
        self.csr |= 1;
        self.lsi.switch(true, now, LSI_START);
    }

    fn pll_hz(&self) -> u64 {
        let field = |shift: u32, mask: u32| u64::from(self.pllcfgr >> shift & mask);
        let input = if self.pllcfgr & 1 << 22 != 0 { self.hse_hz } else { HSI_HZ };
        input * field(6, 0x1ff) / field(0, 0x3f).max(1) / (2 * (field(16, 3) + 1))
    }

    /// Frequency of the processor and the AHB, Hz.
    pub fn hclk(&mut self, now: u64) -> u64 {
        self.settle(now);
        let sysclk = [HSI_HZ, self.hse_hz, self.pll_hz()][self.sws as usize];
        let hpre = self.cfgr >> 4 & 15;
        // §7.3.3: 0xxx not divided, then 2, 4, 8, 16, 64, 128, 256, 512.
        let shift = if hpre < 8 { 0 } else { (hpre - 7) + u32::from(hpre > 11) };
        sysclk >> shift
    }

    fn ppre(&self, shift: u32) -> u64 {
        let field = self.cfgr >> shift & 7;
        if field < 4 { 1 } else { 2 << (field - 4) }
    }

    /// Peripheral clocks (APB1, APB2), Hz.
    pub fn pclk(&mut self, now: u64) -> (u64, u64) {
        let hclk = self.hclk(now);
        (hclk / self.ppre(10), hclk / self.ppre(13))
    }

    /// Timer clocks (APB1, APB2), Hz: twice the bus clock unless that is not divided (§7.2, figure of the clock tree).
    pub fn timer_clocks(&mut self, now: u64) -> (u64, u64) {
        let (p1, p2) = self.pclk(now);
        (if self.ppre(10) == 1 { p1 } else { 2 * p1 }, if self.ppre(13) == 1 { p2 } else { 2 * p2 })
    }

    /// Whether the peripheral behind `gate` is clocked and not in reset.
    pub fn enabled(&self, gate: Gate) -> bool {
        gate == Gate::Always || self.gate_bit(0x30, gate) && !self.in_reset(gate)
    }

    /// Whether the peripheral behind `gate` is held in reset.
    pub fn in_reset(&self, gate: Gate) -> bool {
        self.gate_bit(0x10, gate)
    }

    /// Bit of `gate` in the bank that starts at `base`: resets at 0x10, enables at 0x30.
    fn gate_bit(&self, base: usize, gate: Gate) -> bool {
        let (offset, bit) = match gate {
            Gate::Always => return false,
            Gate::Ahb1(b) => (0, b),
            Gate::Apb1(b) => (0x10, b),
            Gate::Apb2(b) => (0x14, b),
        };
        self.bank[(base + offset - 0x10) / 4] >> bit & 1 == 1
    }

    /// Scale mode 2 allows 144 MHz only (§5.4.1).
    pub fn full_voltage(&self) -> bool {
        self.power & 0x4000 != 0
    }
}

/// Wait states that `hclk` needs at 2.7..3.6 V (§3.5.1, table 10).
pub fn wait_states(hclk: u64) -> u32 {
    (hclk.saturating_sub(1) / 30_000_000) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = TICK_HZ / 1000;

    fn pll_168(r: &mut Rcc, at: u64) {
        r.write(0x00, 1 | 1 << 16, at).unwrap();
        // HSE 8 MHz / 8 * 336 / 2, Q = 7.
        r.write(0x04, 8 | 336 << 6 | 1 << 22 | 7 << 24, at).unwrap();
        r.write(0x00, 1 | 1 << 16 | 1 << 24, at + 3 * MS).unwrap();
    }

    #[test]
    fn after_reset_the_chip_runs_from_hsi_at_16_mhz() {
        let mut r = Rcc::new(8_000_000, flag::POWER | flag::PIN);
        assert_eq!(r.read(0, 0).unwrap() & 3, 3);
        assert_eq!(
            (r.hclk(0), r.pclk(0), r.timer_clocks(0)),
            (16_000_000, (16_000_000, 16_000_000), (16_000_000, 16_000_000))
        );
        assert_eq!(r.read(0x74, 0).unwrap(), 0x0e00_0000);
    }

    #[test]
    fn hse_and_pll_are_not_ready_at_once() {
        let mut r = Rcc::new(8_000_000, 0);
        r.write(0, 1 | 1 << 16, 0).unwrap();
        assert_eq!(r.read(0, MS).unwrap() >> 17 & 1, 0);
        assert_eq!(r.read(0, 2 * MS).unwrap() >> 17 & 1, 1);
        pll_168(&mut r, 2 * MS);
        assert_eq!(r.read(0, 5 * MS).unwrap() >> 25 & 1, 0);
        assert_eq!(r.read(0, 5 * MS + PLL_LOCK).unwrap() >> 25 & 1, 1);
    }

    #[test]
    fn the_clock_switches_when_its_source_is_ready_and_not_before() {
        let mut r = Rcc::new(8_000_000, 0);
        pll_168(&mut r, 0);
        // AHB / 1, APB1 / 4, APB2 / 2.
        r.write(8, 2 | 5 << 10 | 4 << 13, 3 * MS).unwrap();
        assert_eq!(r.read(8, 3 * MS).unwrap() >> 2 & 3, 0);
        let later = 3 * MS + PLL_LOCK;
        assert_eq!(r.read(8, later).unwrap() >> 2 & 3, 2);
        assert_eq!(r.hclk(later), 168_000_000);
        assert_eq!(r.pclk(later), (42_000_000, 84_000_000));
        assert_eq!(r.timer_clocks(later), (84_000_000, 168_000_000));
    }

    #[test]
    fn ahb_prescaler_skips_32() {
        let mut r = Rcc::new(8_000_000, 0);
        for (code, divisor) in [(7, 1), (8, 2), (11, 16), (12, 64), (15, 512)] {
            r.write(8, code << 4, 0).unwrap();
            assert_eq!(r.hclk(0), 16_000_000 / divisor);
        }
    }

    #[test]
    fn wait_states_step_every_30_mhz() {
        let at = |mhz: u64| wait_states(mhz * 1_000_000);
        assert_eq!([at(16), at(30), at(31), at(60), at(150), at(151), at(168)], [0, 0, 1, 1, 4, 5, 5]);
    }

    #[test]
    fn the_voltage_detector_has_a_threshold_and_some_hysteresis() {
        let mut r = Rcc::new(8_000_000, 0);
        r.set_supply(2000);
        assert_eq!(r.detect(), None);
        r.set_supply(2940);
        r.write_power(0, 0x4000 | 6 << 5 | 1 << 4).unwrap();
        assert_eq!((r.detect(), r.read_power(4)), (None, Ok(1 << 14)));
        for (mv, change) in [(2929, Some(true)), (2950, None), (3029, None), (3031, Some(false)), (2935, None)] {
            r.set_supply(mv);
            assert_eq!(r.detect(), change, "{mv}");
        }
        r.set_supply(2900);
        assert_eq!((r.detect(), r.read_power(4)), (Some(true), Ok(1 << 14 | 1 << 2)));
    }

    #[test]
    fn reset_flags_stay_until_they_are_removed() {
        let mut r = Rcc::new(8_000_000, flag::WATCHDOG | flag::PIN);
        r.write(0x74, 1, 0).unwrap();
        assert_eq!(r.read(0x74, 0).unwrap() >> 29 & 1, 1);
        r.write(0x74, 1 | 1 << 24, 0).unwrap();
        assert_eq!(r.read(0x74, 0).unwrap(), 1);
    }

    #[test]
    fn a_crystal_that_stops_leaves_the_internal_oscillator_and_does_not_come_back() {
        let mut r = Rcc::new(8_000_000, 0);
        pll_168(&mut r, 0);
        r.write(8, 2 | 5 << 10 | 4 << 13, 4 * MS).unwrap();
        assert_eq!(r.hclk(4 * MS), 168_000_000);
        // Nobody is told without the clock security system.
        assert!(!r.clone().lose_crystal());
        r.write(0, 1 | 1 << 16 | 1 << 24 | 1 << 19, 4 * MS).unwrap();
        assert!(r.lose_crystal());
        assert_eq!((r.hclk(4 * MS), r.read(0, 4 * MS).unwrap() & 0x0303_0000), (16_000_000, 0));
        r.write(0, 1 | 1 << 16 | 1 << 19, 4 * MS).unwrap();
        assert_eq!(r.read(0, 40 * MS).unwrap() >> 17 & 1, 0);
    }
}

//! Clock tree: crystal -> PLL -> 168 MHz core, 84 MHz APB2, 42 MHz APB1 (RM0090 7.2, flash 3.5.1).
//!
//! Not the library's: it waits for crystal and PLL without a time-out. A head without a crystal reports that.
//!
//! The clock security system is on: when the crystal stops, the chip falls back to its internal oscillator and raises NMI,
//! which ends in [`super::dying`].

use super::pac;
use super::start::{StartError, within};
use super::{change, put};
use crate::board::{BUS_PRESCALERS, Board, FLASH_WAITS, Pll};

/// Wait states, prefetch, instruction and data cache.
const FLASH_ACR: u32 = FLASH_WAITS | 1 << 8 | 1 << 9 | 1 << 10;
/// A crystal takes a few ms; a poll takes at least four cycles of 16 MHz.
const CRYSTAL_POLLS: u32 = 400_000;
/// The PLL takes at most 300 us.
const PLL_POLLS: u32 = 20_000;

/// Starts the crystal and the PLL and runs the core from it. On an error the internal oscillator stays.
pub fn start(rcc: &pac::RCC, flash: &pac::FLASH) -> Result<(), StartError> {
    rcc.cr().modify(|_, w| w.hseon().set_bit());
    within(CRYSTAL_POLLS, || rcc.cr().read().hserdy().bit_is_set(), StartError::Crystal)?;

    // P = 0 divides the oscillator by two; the source is the crystal.
    let Pll { m, n, q } = const { Board::TABLE.pll };
    let pll = u32::from(m) | u32::from(n) << 6 | 1 << 22 | u32::from(q) << 24;
    put!(rcc.pllcfgr(), pll);
    rcc.cr().modify(|_, w| w.pllon().set_bit());
    within(PLL_POLLS, || rcc.cr().read().pllrdy().bit_is_set(), StartError::Pll)?;

    // Wait states before speed; AHB undivided and both buses divided before the switch.
    put!(flash.acr(), FLASH_ACR);
    within(100, || flash.acr().read().bits() & 0x7 == FLASH_ACR & 0x7, StartError::ClockSwitch)?;
    change!(rcc.cfgr(), clear 0x0000_FCF0, set BUS_PRESCALERS);
    change!(rcc.cfgr(), clear 0b11, set 0b10);
    within(1000, || rcc.cfgr().read().bits() >> 2 & 0b11 == 0b10, StartError::ClockSwitch)?;
    rcc.cr().modify(|_, w| w.csson().set_bit());
    Ok(())
}

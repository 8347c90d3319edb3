//! The independent watchdog: its own oscillator, and no way to stop it.
//!
//! Not the library's: it reloads at once, when the new time-out may not have arrived yet, and an erase that begins then ends
//! in a reset; and it counts in steps of 8 ms.
//!
//! Halting the core in a debugger therefore resets it, on purpose: a halted core does not hold an axis. What a debugger has set
//! to prevent that (DBGMCU), or to halt the core before a fault's handler has written the pins (DEMCR), is taken back each time
//! the watchdog is fed. It may still catch a reset, which programming needs.

use super::start::{StartError, within};
use super::{change, pac, panic_handler, put};
use crate::watchdog::{self, Stuck, Watchdog as _};
use cortex_m::peripheral::DCB;

/// Frequency of its oscillator at the slowest; 32 kHz typically, 47 kHz at the fastest (data sheet).
const SLOWEST_HZ: u32 = 17_000;

/// Time-out in normal operation, at the most: how long a dead core can leave the bridge driving.
const NORMAL_MS: u32 = 30;
/// Time-out while flash is erased, at the least, with the fastest oscillator: an erase of 128 KiB takes 2 s at most.
const ERASE_MS: u32 = 2500;
const FASTEST_HZ: u32 = 47_000;

/// Prescaler / 4 and / 64 as codes of IWDG_PR, and their reloads.
const NORMAL: (u16, u32) = (0, NORMAL_MS * SLOWEST_HZ / 4 / 1000);
const ERASE: (u16, u32) = (4, ERASE_MS * FASTEST_HZ / 64 / 1000 + 1);
const _: () = assert!(NORMAL.1 < 4096 && ERASE.1 < 4096);

/// The watchdog.
pub struct Watchdog(pac::IWDG);

impl Watchdog {
    /// Starts it: from here on a hang is a reset, even before there are clocks.
    pub fn start(iwdg: pac::IWDG) -> Result<Self, StartError> {
        put!(iwdg.kr(), 0xCCCC);
        let mut watchdog = Watchdog(iwdg);
        watchdog.set(ERASE)?;
        Ok(watchdog)
    }

    fn set(&mut self, (prescaler, reload): (u16, u32)) -> Result<(), StartError> {
        put!(self.0.kr(), 0x5555);
        put!(self.0.pr(), prescaler);
        put!(self.0.rlr(), reload as u16);
        // Five cycles of the slow oscillator.
        within(100_000, || self.0.sr().read().bits() & 0b11 == 0, StartError::Watchdog)?;
        self.feed();
        Ok(())
    }
}

/// Stops the independent watchdog while the core is halted: DBGMCU_APB1_FZ (RM0090 38.16.4).
const FREEZES: u32 = 1 << 12;
/// Halt the core at a fault: VC_HARDERR to VC_MMERR of DEMCR (ARMv7-M C1.6.5), without VC_CORERESET.
const CATCHES: u32 = 0x7F0;

/// Takes back what a debugger must not do to a head.
fn undo_debugger() {
    // SAFETY: the register blocks are always there, and a debugger alone writes these bits.
    let (frozen, demcr) = unsafe { (&(*pac::DBGMCU::ptr()), &(*DCB::PTR).demcr) };
    if frozen.apb1_fz().read().bits() & FREEZES != 0 {
        change!(frozen.apb1_fz(), clear FREEZES, set 0);
    }
    if demcr.read() & CATCHES != 0 {
        // SAFETY: clears what halts the core at a fault, and nothing else.
        unsafe { demcr.modify(|demcr| demcr & !CATCHES) };
    }
}

impl watchdog::Watchdog for Watchdog {
    #[inline]
    fn feed(&mut self) {
        put!(self.0.kr(), 0xAAAA);
        undo_debugger();
    }

    fn erase(&mut self) -> Result<(), Stuck> {
        self.set(ERASE).map_err(|_| Stuck)
    }

    fn normal(&mut self) -> Result<(), Stuck> {
        self.set(NORMAL).map_err(|_| Stuck)
    }

    fn silent(&mut self, task: usize) {
        panic_handler::silent(task)
    }
}

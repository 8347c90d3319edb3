//! The last words: pins first, then the record, then the log, then a reset.
//!
//! From the first instruction on every interrupt is masked, by PRIMASK: nobody is left whom it could delay.

use super::boot::{Death, died};
use super::lines;
use super::stack;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering::SeqCst};
use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};

static DYING: AtomicBool = AtomicBool::new(false);

/// Notes, logs unless logging itself is what failed, and resets. The pins are written already.
fn end(death: Death, detail: u32, place: u32, log: impl FnOnce()) -> ! {
    if !DYING.swap(true, SeqCst) {
        died(death, detail, place);
        log();
    }
    SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    lines::kill();
    let (file, line) = info.location().map_or(("?", 0), |at| (at.file(), at.line()));
    end(Death::Panic, 0, line, || defmt::error!("panic at {=str}:{=u32}", file, line))
}

// SAFETY: called by the hardware alone; it never returns, and touches only registers, atomics and the log.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    lines::kill();
    // SAFETY: the register block is always there; reading the fault status changes nothing.
    let (status, address) = unsafe { ((*SCB::PTR).cfsr.read(), (*SCB::PTR).mmfar.read()) };
    let at = frame.pc();
    let death = if stack::refused(status, address) { Death::Stack } else { Death::HardFault };
    end(death, status, at, || defmt::error!("hard fault at {=u32:#010x}, status {=u32:#010x}", at, status))
}

// SAFETY: as above.
#[exception]
unsafe fn DefaultHandler(number: i16) -> ! {
    lines::kill();
    end(Death::Unexpected, number as u32, 0, || defmt::error!("interrupt {=i16} has no handler", number))
}

/// A task has fallen silent: pins off, and the watchdog is fed no more.
pub fn silent(task: usize) -> ! {
    lines::kill();
    end(Death::Silent, task as u32, 0, || defmt::error!("task {=usize} has fallen silent", task))
}

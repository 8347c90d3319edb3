//! The boot loader of a head: what `edm_boot` says, on the chip as it comes out of reset.
//!
//! Every pin is an input then, and the pulls of the board keep bridge and pulses off; none is touched here. Nothing is
//! interrupted, no watchdog runs, and the core has its internal oscillator of 16 MHz. Without a program the core stops, with
//! the pins as they are: a probe can load one.
#![cfg_attr(target_arch = "arm", no_std, no_main)]

#[cfg(not(target_arch = "arm"))]
fn main() {
    println!("Boot loader of the EDM servo head. `cargo firmware` puts it into the image of a board.");
}

#[cfg(target_arch = "arm")]
mod arm {
    use core::arch::asm;
    use edm_boot::{Flash, PROGRAM, chip::Chip, prepare};

    /// Where the vector table is (ARMv7-M B3.2.5).
    const VTOR: *mut u32 = 0xE000_ED08 as *mut u32;

    /// What the processor takes from the vector table behind the stack pointer: reset, then NMI and the faults.
    #[unsafe(link_section = ".vectors")]
    #[used]
    static VECTORS: [extern "C" fn() -> !; 6] = [reset, stop, stop, stop, stop, stop];

    #[unsafe(no_mangle)]
    extern "C" fn reset() -> ! {
        // SAFETY: nobody else runs, and this program lies before what may be written.
        let mut chip = unsafe { Chip::new(PROGRAM) };
        if !prepare(&mut chip) {
            stop();
        }
        let (stack, start) = (chip.word(PROGRAM), chip.word(PROGRAM + 4));
        // SAFETY: the program has its vector table there; nothing of this one is used any more.
        unsafe {
            VTOR.write_volatile(PROGRAM);
            asm!("dsb", "isb", "msr msp, {stack}", "bx {start}", stack = in(reg) stack, start = in(reg) start, options(noreturn));
        }
    }

    /// For good, or until a reset; not asleep, so that a probe finds it as it was.
    extern "C" fn stop() -> ! {
        loop {
            core::hint::spin_loop();
        }
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        stop()
    }
}

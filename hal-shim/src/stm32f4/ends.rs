//! EXTI and TIM6: the end of a pulse, and of the pause after it.
//!
//! The falling gate interrupts, but only while there is any pause ([`watch`]). What the pulse was, and what may switch the line on again,
//! [`pause`] says. TIM6 counts a pause once and interrupts at its end.
//!
//! A gate that rings would interrupt without end, above every control task. After [`MOST`] ends in a block none is served until a block has
//! fewer ([`calm`]); the blocks until then are counted ([`rung`]).

use super::exti::exti;
use super::hal::gpio::ExtiPin;
use super::hal::syscfg::SysCfg;
use super::lines::{self, Allow};
use super::{Board, blocks, change, gate, gated, pac, put, reset};
use crate::edges::Seen;
use crate::pause::{self, Look, PRESCALER, Pauses, Watch};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use cortex_m::peripheral::NVIC;

/// Interrupt line of the gate.
const GATE: u32 = 1 << Board::TABLE.pin("gate").number;
// One vector serves lines 5 to 9, and nothing else here.
const _: () = assert!(GATE & !0x3E0 == 0);
/// Its interrupt. It is enabled and disabled, so that [`super::registers`] leaves it alone.
pub(super) const INTERRUPT: pac::Interrupt = pac::Interrupt::EXTI9_5;
/// Ends of pulses that are served in a block: 140 000 a second, where the fastest generator makes 100 000. Of ten, with a pause as short as a
/// microsecond after each, a servo tick came so late in some images that the clock seemed lost.
const MOST: u32 = 7;
/// Ends since the newest block began to be worked on.
static ENDS: AtomicU32 = AtomicU32::new(0);
/// There were more than are served, and no block with fewer since.
static RINGS: AtomicBool = AtomicBool::new(false);
/// Blocks of which that is true.
static RUNG: AtomicU32 = AtomicU32::new(0);
/// Ends of pulses are to interrupt.
static WATCHES: AtomicBool = AtomicBool::new(false);
/// One pulse, enabled; an update interrupts only by the counter.
const ONCE: u32 = 1 << 3 | 1 << 2 | 1;

/// The front end, at the end of a pulse.
struct FrontEnd;

impl Look for FrontEnd {
    #[inline(always)]
    fn newest(&self) -> u32 {
        blocks::newest()
    }

    #[inline(always)]
    fn code_before(&self, place: u32) -> u16 {
        blocks::code_before(place)
    }

    #[inline(always)]
    fn gate_and_high(&self) -> [bool; 2] {
        lines::gate_and_high()
    }

    #[inline(always)]
    fn shorts(&self) -> u32 {
        gated::shorts()
    }

    #[inline(always)]
    fn highs(&self) -> u32 {
        gate::high_edges()
    }

    #[inline(always)]
    fn high_at(&self, highs: u32) -> u32 {
        gate::high_at(highs)
    }

    #[inline(always)]
    fn gates(&self) -> u32 {
        gate::gate_edges()
    }

    #[inline(always)]
    fn opened(&self, gates: u32) -> u32 {
        gate::gate_before(gates)
    }

    #[inline(always)]
    fn seen(&self) -> Seen {
        gate::seen()
    }

    #[inline(always)]
    fn now(&self) -> u32 {
        gate::now()
    }
}

/// Ends of pulses. Owned by their task.
pub struct Ends {
    tim: pac::TIM6,
    watch: Watch,
    pauses: &'static Pauses,
}

/// Ends of pauses. Owned by their task, which never interrupts that of the pulses, nor is interrupted by it.
pub struct Over(());

impl Ends {
    /// Configures the timer, and connects the gate's pin to its interrupt line.
    pub fn new(
        gate: &mut impl ExtiPin,
        tim: pac::TIM6,
        pauses: &'static Pauses,
        syscfg: &mut SysCfg,
        rcc: &mut pac::RCC,
    ) -> (Ends, Over) {
        gate.make_interrupt_source(syscfg);
        change!(exti().ftsr(), clear 0, set GATE);
        change!(exti().imr(), clear 0, set GATE);
        reset::<pac::TIM6>(rcc);
        put!(tim.psc(), PRESCALER);
        put!(tim.egr(), 1);
        put!(tim.sr(), 0);
        put!(tim.dier(), 1);
        (Ends { tim, watch: Watch::new(), pauses }, Over(()))
    }

    /// The interrupt: a gate has closed.
    #[inline(always)]
    pub fn pulse(&mut self) {
        put!(exti().pr(), GATE);
        let ends = ENDS.load(Relaxed).wrapping_add(1);
        ENDS.store(ends, Relaxed);
        if ends > MOST {
            return rings();
        }
        let Some(class) = self.watch.end(self.pauses, &FrontEnd) else { return };
        let reload = self.pauses.reload(class);
        if reload == 0 {
            return;
        }
        if pause::hold(&Allow) {
            self.again();
        }
        put!(self.tim.arr(), reload);
        put!(self.tim.cr1(), ONCE);
    }

    /// A pause lasts that has not been counted: it ends nothing.
    #[cold]
    fn again(&mut self) {
        put!(self.tim.cr1(), 0);
        put!(self.tim.cnt(), 0);
        put!(self.tim.sr(), 0);
        NVIC::unpend(pac::Interrupt::TIM6_DAC);
    }
}

/// Too many ends: no more of them until the gate rests.
#[cold]
fn rings() {
    NVIC::mask(INTERRUPT);
    RINGS.store(true, Relaxed);
}

impl Over {
    /// The interrupt: the count is over.
    #[inline(always)]
    pub fn pause(&mut self) {
        // SAFETY: the register block is always there; only the flag is used, and by one task at a time.
        let tim = unsafe { &*pac::TIM6::ptr() };
        put!(tim.sr(), 0);
        pause::release(&Allow);
    }
}

/// Pauses that have begun so far, modulo 2^31.
pub(super) fn begun() -> u32 {
    pause::begun(&Allow)
}

/// Ends of pulses interrupt, or not. For a slower task.
pub(super) fn watch(on: bool) {
    // Before it is masked: the gap task, which comes between, must not unmask it afterwards.
    WATCHES.store(on, Relaxed);
    if on {
        // SAFETY: a critical section here is one by BASEPRI; and what the interrupt's task works on was there before.
        unsafe { NVIC::unmask(INTERRUPT) };
    } else {
        NVIC::mask(INTERRUPT);
    }
}

/// A block with so many edges of the gate has come: ends of pulses are served again, where there were too many, and are not any more.
#[inline(always)]
pub(super) fn calm(edges: u32) {
    // First the count: whoever masks in between is found by the next block.
    ENDS.store(0, Relaxed);
    if RINGS.load(Relaxed) {
        serve(edges);
    }
}

#[cold]
fn serve(edges: u32) {
    RUNG.store(RUNG.load(Relaxed).wrapping_add(1), Relaxed);
    if edges <= 2 * MOST {
        RINGS.store(false, Relaxed);
        if WATCHES.load(Relaxed) {
            watch(true);
        }
    }
}

/// Blocks so far in which the gate closed more often than is served.
pub(super) fn rung() -> u32 {
    RUNG.load(Relaxed)
}

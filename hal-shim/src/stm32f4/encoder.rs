//! The encoder twice on the same pins: edge interrupts, and TIM5 counting in hardware.
//!
//! *Storm*: more edges in one tick than the interrupt can serve and leave time for the loops. The interrupt then masks
//! itself; the timer goes on counting, and the servo task opens the lines again with its next tick.

use super::exti::exti;
use super::hal::gpio::alt::tim5::{Ch1, Ch2};
use super::hal::gpio::{ExtiPin, Input, PushPull};
use super::hal::syscfg::SysCfg;
use super::{Board, change, pac, put, reset};
use crate::board::gpio::gpioa::{PA0, PA1, PA2};
use crate::encoder::{Edge, EdgeGuard, EdgeLines, EncoderTimer, Levels, Line, QuadratureLines};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

const A: u32 = Board::TABLE.pin("encoder_a").number as u32;
const B: u32 = Board::TABLE.pin("encoder_b").number as u32;
const INDEX: u32 = Board::TABLE.pin("encoder_index").number as u32;
const LINES: u32 = 1 << A | 1 << B | 1 << INDEX;

// The three lines are read in one load of port A and have a vector each.
const _: () = assert!(A == 0 && B == 1 && INDEX == 2);

/// Edges a tick that the interrupt serves: 800 kcount/s, at which it takes 40 % of the core.
pub const MOST_EDGES: u32 = 40;

/// Edges that the interrupt still serves in this tick before the last one.
static LEFT: AtomicU32 = AtomicU32::new(0);
/// The next edge does not follow the one before: the lines were masked in between. Nothing is left then.
static UNSERVED: AtomicBool = AtomicBool::new(true);

/// The lines, as the edge interrupts see them.
pub struct Lines(());

/// TIM5 in encoder mode: four counts a line, up toward the work, 32 bits.
pub struct Timer(pac::TIM5);

/// Configures pins, interrupt lines and timer. Until the first [`EdgeGuard::serve`] the lines are masked, as after a
/// storm.
pub fn new(
    tim: pac::TIM5,
    a: PA0,
    b: PA1,
    index: PA2,
    syscfg: &mut SysCfg,
    rcc: &mut pac::RCC,
) -> (Lines, Guard, Timer) {
    reset::<pac::TIM5>(rcc);
    let (mut a, mut b): (Ch1<PushPull>, Ch2<PushPull>) = (a.into(), b.into());
    let mut index: PA2<Input> = index.into_floating_input();
    a.make_interrupt_source(syscfg);
    b.make_interrupt_source(syscfg);
    index.make_interrupt_source(syscfg);
    // Both channels from their own pins, filtered over 4 samples (48 ns; an edge at 5 Mcount/s lasts 400 ns).
    put!(tim.ccmr1_input(), 0b0010 << 4 | 0b01 | 0b0010 << 12 | 0b01 << 8);
    put!(tim.arr(), u32::MAX);
    // Encoder mode 3: counts on every edge of both.
    put!(tim.smcr(), 0b011);
    put!(tim.cr1(), 1);
    change!(exti().rtsr(), clear 0, set LINES);
    change!(exti().ftsr(), clear 0, set LINES);
    (Lines(()), Guard(()), Timer(tim))
}

impl QuadratureLines for Lines {
    #[inline(always)]
    fn levels(&self) -> Levels {
        // SAFETY: the register block is always there; reading the inputs changes nothing.
        let levels = unsafe { &*pac::GPIOA::ptr() }.idr().read().bits();
        Levels { a: levels >> A & 1 == 1, b: levels >> B & 1 == 1, index: levels >> INDEX & 1 == 1 }
    }
}

impl EdgeLines for Lines {
    #[inline(always)]
    fn acknowledge(&mut self, line: Line) {
        put!(exti().pr(), 1 << line as u32);
    }

    #[inline(always)]
    fn follows(&mut self) -> bool {
        let left = LEFT.load(Relaxed).checked_sub(1);
        if let Some(left) = left {
            LEFT.store(left, Relaxed);
        }
        left.is_some()
    }

    fn unusual(&mut self) -> Edge {
        if UNSERVED.load(Relaxed) {
            UNSERVED.store(false, Relaxed);
            LEFT.store(MOST_EDGES - 1, Relaxed);
            return Edge::AfterStorm;
        }
        change!(exti().imr(), clear LINES, set 0);
        Edge::Last
    }
}

// A line's number is that of its pin.
const _: () = assert!(Line::A as u32 == A && Line::B as u32 == B && Line::Index as u32 == INDEX);

/// The lines, as slower tasks see them.
#[derive(Clone)]
pub struct Guard(());

impl EdgeGuard for Guard {
    #[inline(always)]
    fn serve(&mut self) -> bool {
        let storm = exti().imr().read().bits() & LINES != LINES;
        if storm {
            serve_again();
        } else {
            LEFT.store(MOST_EDGES - 1, Relaxed);
        }
        storm
    }

    /// Masks the lines as a storm does.
    fn missed(&mut self) {
        // Encoder and servo task change the same lines in the same register. Whichever comes in between, the lines end up
        // masked here, and that is what the next tick looks at.
        change!(exti().imr(), clear LINES, set 0);
    }
}

#[cold]
fn serve_again() {
    // No encoder interrupt can come in between: they are masked. Stop's lines are never masked.
    LEFT.store(0, Relaxed);
    UNSERVED.store(true, Relaxed);
    put!(exti().pr(), LINES);
    change!(exti().imr(), clear 0, set LINES);
    // An edge of its own making: the decoder takes the levels now. Otherwise the next real edge would show it that the storm is
    // over and not be counted, perhaps long after both counters were found to agree.
    put!(exti().swier(), 1 << A);
}

impl EncoderTimer for Timer {
    const BITS: u32 = 32;

    #[inline]
    fn counter(&self) -> u32 {
        self.0.cnt().read().bits()
    }
}

//! The lines that stop everything, written without asking anyone.
//!
//! [`stop`] and [`retract`] write registers that any priority may write at any moment: a port's set-reset register changes
//! only the named pins in one store, and the PWM's mode register is theirs and the servo task's. What they did is counted;
//! the servo task reads the count when its tick begins, and after it has written its own outputs it looks again: when the
//! count has changed in between, it repeats what was forced ([`ServoLines`](super::servo_lines::ServoLines)). So no lock is needed and a decision that
//! was made before the short can never outlive it.

use super::pins::{high, is_high, levels, low};
use super::{Board, change, pac, put};
use crate::board::Pin;
use crate::pause::{self, Word};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed, Ordering::SeqCst, compiler_fence};

const ALLOW: Pin = Board::TABLE.pin("allow_pulses");
const FORWARD: Pin = Board::TABLE.pin("forward");
const REVERSE: Pin = Board::TABLE.pin("reverse");
const GATE: Pin = Board::TABLE.pin("gate");
const HIGH: Pin = Board::TABLE.pin("comparator_high");
const LOW: Pin = Board::TABLE.pin("comparator_low");
const BRIDGE_FAULT: Pin = Board::TABLE.pin("bridge_fault");
const LED: Pin = Board::TABLE.pin("led");
const CARRY: Pin = Board::TABLE.pin("carry");
const STEP_READY: Pin = Board::TABLE.pin("step_ready");

/// Modes of TIM1's channel 1 with its compare register preloaded (RM0090 17.4.7).
pub(super) const PWM_MODE: u32 = 0b110 << 4 | PRELOAD;
const FORCE_ON: u32 = 0b101 << 4 | PRELOAD;
pub(super) const FORCE_OFF: u32 = 0b100 << 4;
const PRELOAD: u32 = 1 << 3;

/// A count that tasks of different priorities share with register accesses in a certain order. One core keeps it for its own
/// interrupts by itself; only the compiler needs a fence, and a barrier instruction would cost four cycles.
struct Ordered(AtomicU32);

impl Ordered {
    #[inline(always)]
    fn load(&self) -> u32 {
        compiler_fence(SeqCst);
        let loaded = self.0.load(Relaxed);
        compiler_fence(SeqCst);
        loaded
    }

    #[inline(always)]
    fn store(&self, count: u32) {
        compiler_fence(SeqCst);
        self.0.store(count, Relaxed);
        compiler_fence(SeqCst);
    }
}
/// Clock gates of GPIOA to GPIOE (RM0090 7.3.10).
const PORTS: u32 = 0b1_1111;
/// Clock gate of TIM1 (RM0090 7.3.14).
const TIM1: u32 = 1;

/// How often the bridge was forced; the lowest bit says what it was last: 0 off, 1 retract.
static FORCED: Ordered = Ordered(AtomicU32::new(0));
/// A positive duty moves away from the work.
static REVERSED: AtomicBool = AtomicBool::new(false);
/// How often a pulse was killed.
static KILLED: Ordered = Ordered(AtomicU32::new(0));
/// The words of [`pause`]: permission, what had been forced then, number of the newest pause.
static PERMITTED: Ordered = Ordered(AtomicU32::new(0));
static BRIDGE_THEN: Ordered = Ordered(AtomicU32::new(0));
static PULSES_THEN: Ordered = Ordered(AtomicU32::new(0));
static PAUSE: Ordered = Ordered(AtomicU32::new(0));

/// The line that allows pulses, for servo task and pauses.
pub(super) struct Allow;

impl pause::Line for Allow {
    #[inline(always)]
    fn forced(&self) -> [u32; 2] {
        [FORCED.load(), KILLED.load()]
    }

    #[inline(always)]
    fn allow(&self) {
        high(ALLOW);
    }

    #[inline(always)]
    fn inhibit(&self) {
        low(ALLOW);
    }

    #[inline(always)]
    fn load(&self, word: Word) -> u32 {
        shared(word).load()
    }

    #[inline(always)]
    fn store(&self, word: Word, value: u32) {
        shared(word).store(value);
    }
}

#[inline(always)]
fn shared(word: Word) -> &'static Ordered {
    match word {
        Word::Permitted => &PERMITTED,
        Word::Bridge => &BRIDGE_THEN,
        Word::Pulses => &PULSES_THEN,
        Word::Pause => &PAUSE,
    }
}

fn tim1() -> &'static pac::tim1::RegisterBlock {
    // SAFETY: the register block is always there. Only the mode of channel 1 is used through this reference; the module's
    // comment says why two writers of it agree.
    unsafe { &*pac::TIM1::ptr() }
}

/// Pulses off.
#[inline(always)]
pub fn inhibit() {
    low(ALLOW);
}

/// The generator's gate is open.
#[inline(always)]
pub fn gate_is_open() -> bool {
    is_high(GATE)
}

/// The generator's gate is open, and the gap voltage is above the high comparator's threshold.
#[inline(always)]
pub fn gate_and_high() -> [bool; 2] {
    // In one load.
    const _: () = assert!(GATE.port == HIGH.port);
    levels(GATE, HIGH)
}

/// The gap voltage is above the low comparator's threshold.
#[inline(always)]
pub fn is_above_low() -> bool {
    is_high(LOW)
}

/// The bridge's fault line; low is a fault.
pub(super) fn bridge_fault_is_high() -> bool {
    is_high(BRIDGE_FAULT)
}

#[inline(always)]
fn off() {
    put!(tim1().ccmr1_output(), FORCE_OFF);
    low(FORWARD);
    low(REVERSE);
}

#[inline(always)]
fn up() {
    put!(tim1().ccmr1_output(), FORCE_OFF);
    if REVERSED.load(Relaxed) {
        low(REVERSE);
        high(FORWARD);
    } else {
        low(FORWARD);
        high(REVERSE);
    }
    put!(tim1().ccmr1_output(), FORCE_ON);
}

/// Which way [`retract`] drives: for a motor that a positive duty moves away from the work. Only while nothing drives.
pub(super) fn set_reversed(reversed: bool) {
    REVERSED.store(reversed, Relaxed);
}

/// Pulses off and the bridge off, now. The servo task takes over with its next tick.
#[inline(always)]
pub fn stop() {
    inhibit();
    off();
    FORCED.store((FORCED.load() | 1).wrapping_add(1));
}

/// Pulses off and full force away from the work, now. The servo task takes over with its next tick.
///
/// Only for the reflex: the highest priority, so that nothing comes between.
#[inline(always)]
pub fn retract() {
    inhibit();
    up();
    FORCED.store((FORCED.load() | 1).wrapping_add(2));
}

/// Ends the pulse. Pulses stay off until the end of a servo tick that began later. Only for the reflex.
#[inline(always)]
pub fn kill_pulse() {
    inhibit();
    KILLED.store(KILLED.load().wrapping_add(1));
}

/// Pulses off and bridge off for good: for a panic, which never comes back to settle it.
///
/// Right at any moment after reset. Nothing runs afterwards that could switch them on again: a task that is not the panicking
/// one would. And ports and timer are clocked first, or a write before they were started would be lost.
// One place that masks: `cargo firmware` counts them.
#[cold]
#[inline(never)]
pub fn kill() {
    cortex_m::interrupt::disable();
    // SAFETY: the register block is always there, and nobody else runs any more.
    let rcc = unsafe { &*pac::RCC::ptr() };
    change!(rcc.ahb1enr(), clear 0, set PORTS);
    change!(rcc.apb2enr(), clear 0, set TIM1);
    // The clocks are there two cycles after the write; reading back takes longer (RM0090 7.3.10, 7.3.14).
    rcc.apb2enr().read();
    inhibit();
    off();
}

/// Lights or darkens the status LED.
pub fn led(lit: bool) {
    if lit { high(LED) } else { low(LED) }
}

/// Raises or lowers the line that asks for a move of the coarse axis.
pub fn ask(asks: bool) {
    if asks { high(CARRY) } else { low(CARRY) }
}

/// Raises or lowers the line that lets a host step.
pub fn takes_steps(takes: bool) {
    if takes { high(STEP_READY) } else { low(STEP_READY) }
}

/// What was forced so far, as one moment saw it.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Forced {
    bridge: u32,
    pulses: u32,
}

/// What was forced up to now.
#[inline(always)]
pub(super) fn forced() -> Forced {
    Forced { bridge: FORCED.load(), pulses: KILLED.load() }
}

impl Forced {
    /// Whether the bridge was forced between this moment and a later one.
    #[inline(always)]
    pub(super) fn bridge_differs(self, later: Forced) -> bool {
        self.bridge != later.bridge
    }
}

/// The servo task has written its outputs, decided without knowing of what was forced since `seen`.
#[inline(always)]
pub(super) fn settle(seen: Forced) {
    pause::decided(&Allow, [seen.bridge, seen.pulses]);
    if forced() != seen {
        repeat(seen);
    }
}

/// Forces again what was forced since `seen`, over what the servo task has written meanwhile.
#[cold]
fn repeat(seen: Forced) {
    let mut bridge = seen.bridge;
    // Twice at the most: reflex or stop may come again while the first is repeated.
    for _ in 0..2 {
        let now = FORCED.load();
        if now == bridge {
            break;
        }
        inhibit();
        if now & 1 == 1 {
            up()
        } else {
            off()
        }
        bridge = now;
    }
    if KILLED.load() != seen.pulses {
        inhibit();
    }
}

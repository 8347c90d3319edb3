//! Safety inputs: levels for the servo task, edges for the stop task.

use super::exti::exti;
use super::hal::gpio::ExtiPin;
use super::hal::syscfg::SysCfg;
use super::pins::Input;
use super::supply::{self, Supply};
use super::{Board, change, lines, put};
use crate::board::Pin as Place;
use crate::board::gpio::Pin;
use crate::safety::{Contact, Safety, SafetyInputs, SafetyPins};
use core::convert::Infallible;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use embedded_hal::digital::{ErrorType, InputPin};

const UPPER_PIN: Place = Board::TABLE.pin("upper_limit");
const LOWER_PIN: Place = Board::TABLE.pin("lower_limit");
const EMERGENCY_PIN: Place = Board::TABLE.pin("emergency_stop");
const DIELECTRIC_PIN: Place = Board::TABLE.pin("dielectric");
const UPPER: u32 = 1 << UPPER_PIN.number;
const LOWER: u32 = 1 << LOWER_PIN.number;
const EMERGENCY: u32 = 1 << EMERGENCY_PIN.number;
const DIELECTRIC: u32 = 1 << DIELECTRIC_PIN.number;
const LINES: u32 = UPPER | LOWER | EMERGENCY | DIELECTRIC;
/// Not a line: the bridge's fault comes through the timer's break.
const BRIDGE: u32 = 1 << 31;
/// Not a pin: the supply comes through a line of its own.
const SUPPLY: u32 = supply::LINE;

// One vector serves them all, and nothing else.
const _: () = assert!(LINES & !0xFC00 == 0);

/// Inputs of the ports that carry safety inputs, and which of their levels are unsafe.
const fn mask(port: char, safe_high: bool) -> u32 {
    let low = [UPPER_PIN, LOWER_PIN, EMERGENCY_PIN, DIELECTRIC_PIN];
    let high = [Board::TABLE.pin("bridge_fault")];
    let pins: &[Place] = if safe_high { &high } else { &low };
    let (mut mask, mut i) = (0, 0);
    while i < pins.len() {
        if pins[i].port == port {
            mask |= 1 << pins[i].number;
        }
        i += 1;
    }
    mask
}

/// The unsafe levels of a port's safety inputs, a bit each.
#[inline(always)]
fn open<const PORT: char>() -> u32 {
    let (low, high) = const { (mask(PORT, false), mask(PORT, true)) };
    if low | high == 0 {
        return 0;
    }
    // The ports lie 0x400 apart from port A on, input data at 0x10 (RM0090 2.3, 8.4.11).
    let input = (0x4002_0010 + 0x400 * (PORT as usize - 'A' as usize)) as *const u32;
    // SAFETY: the address of a register of every port of this chip; reading it changes nothing.
    let levels = unsafe { input.read_volatile() };
    (levels ^ high) & (low | high)
}

/// Conditions that were seen unsafe since the servo task last asked, in the bits of their lines.
static SEEN: AtomicU32 = AtomicU32::new(0);

/// The bridge's fault line, which belongs to the timer's break input but can be read.
pub struct FaultLine(());

impl ErrorType for FaultLine {
    type Error = Infallible;
}

impl InputPin for FaultLine {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(lines::bridge_fault_is_high())
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!lines::bridge_fault_is_high())
    }
}

type UpperLimit = Input<{ UPPER_PIN.port }, { UPPER_PIN.number }>;
type LowerLimit = Input<{ LOWER_PIN.port }, { LOWER_PIN.number }>;
type EmergencyStop = Input<{ EMERGENCY_PIN.port }, { EMERGENCY_PIN.number }>;
type Dielectric = Input<{ DIELECTRIC_PIN.port }, { DIELECTRIC_PIN.number }>;

/// The inputs of a board.
pub struct Inputs {
    pins: SafetyPins<UpperLimit, LowerLimit, EmergencyStop, Dielectric, FaultLine>,
    supply: Supply,
}

/// Connects a pin, which becomes an input, to its interrupt line.
pub fn contact<const P: char, const N: u8>(pin: Pin<P, N>, syscfg: &mut SysCfg) -> Input<P, N> {
    let mut input = pin.into_floating_input();
    input.make_interrupt_source(syscfg);
    input
}

impl Inputs {
    /// Takes connected inputs and opens their interrupt lines.
    pub fn new(
        upper_limit: UpperLimit,
        lower_limit: LowerLimit,
        emergency_stop: EmergencyStop,
        dielectric: Dielectric,
        supply: Supply,
    ) -> Self {
        // An open contact is a rising edge. A level that is open already is seen by the servo task before it may drive.
        change!(exti().rtsr(), clear 0, set LINES);
        change!(exti().imr(), clear 0, set LINES);
        let pins = SafetyPins {
            upper_limit: Contact::normally_closed(upper_limit),
            lower_limit: Contact::normally_closed(lower_limit),
            emergency_stop: Contact::normally_closed(emergency_stop),
            dielectric: Contact::normally_closed(dielectric),
            bridge_fault: Contact::safe_at_high(FaultLine(())),
        };
        Inputs { pins, supply }
    }
}

/// The stop task: the first edge stops. Atomics only.
#[inline(always)]
pub fn stop() {
    lines::stop();
    let pending = exti().pr().read().bits() & LINES;
    put!(exti().pr(), pending);
    SEEN.fetch_or(pending, Relaxed);
}

/// The bridge's fault task. The output is off already.
#[inline(always)]
pub fn bridge_fault() {
    lines::stop();
    super::pwm::clear_break();
    SEEN.fetch_or(BRIDGE, Relaxed);
}

/// The supply task. Atomics only.
#[inline(always)]
pub fn supply() {
    lines::stop();
    supply::acknowledge();
    SEEN.fetch_or(SUPPLY, Relaxed);
}

impl Safety for Inputs {
    /// Levels now, together with every condition that was unsafe for however short a time since the last call.
    #[inline]
    fn read(&mut self) -> SafetyInputs {
        if SEEN.load(Relaxed) == 0 { self.levels() } else { self.read_with_seen() }
    }

    /// In two loads.
    #[inline(always)]
    fn are_quiet(&mut self) -> bool {
        let open = open::<'A'>() | open::<'B'>() | open::<'C'>() | open::<'D'>() | open::<'E'>();
        SEEN.load(Relaxed) | open == 0
    }
}

impl Inputs {
    fn levels(&mut self) -> SafetyInputs {
        SafetyInputs { supply_low: self.supply.is_low(), ..self.pins.read() }
    }

    #[cold]
    fn read_with_seen(&mut self) -> SafetyInputs {
        let seen = SEEN.swap(0, Relaxed);
        let now = self.levels();
        SafetyInputs {
            upper_limit: now.upper_limit || seen & UPPER != 0,
            lower_limit: now.lower_limit || seen & LOWER != 0,
            emergency_stop: now.emergency_stop || seen & EMERGENCY != 0,
            dielectric: now.dielectric || seen & DIELECTRIC != 0,
            bridge_fault: now.bridge_fault || seen & BRIDGE != 0,
            supply_low: now.supply_low || seen & SUPPLY != 0,
        }
    }
}

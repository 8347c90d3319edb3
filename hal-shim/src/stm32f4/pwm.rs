//! TIM1: PWM of the bridge, and the servo tick.
//!
//! One period is one tick. A duty goes into the preload register and takes effect with the next update, exactly: the
//! jitter of the servo task does not reach the output. Off takes effect at once. The break input switches the output off
//! in hardware when the bridge reports a fault, and it stays off until [`ServoTimer::arm`].

use super::hal::gpio::PushPull;
use super::hal::gpio::alt::tim1::{Bkin, Ch1};
use super::lines::{FORCE_OFF, PWM_MODE};
use super::pins::Output;
use super::{Board, change, pac, put, reset};
use crate::board::gpio::Pin;
use crate::board::{Pin as Place, SERVO};
use crate::bridge::{BridgeFault, PwmBridge};
use crate::tick::ServoTimer;
use core::convert::Infallible;
use embedded_hal::pwm::{ErrorType, SetDutyCycle};

/// Main output enable.
const MOE: u32 = 1 << 15;
/// Break: enabled, active low, outputs driven to their idle level when off, no automatic return; and locked at level 2, with
/// polarities and idle levels, until the next reset. Level 3 would lock the mode of channel 1 as well, which is the short path
/// (RM0090 17.4.18).
const BDTR: u32 = 1 << 12 | 1 << 11 | 1 << 10 | 0b10 << 8;
/// Trigger output: counter enable (RM0090 17.4.2).
const MMS_ENABLE: u32 = 0b001 << 4;

/// PWM output of the bridge.
pub struct Pwm {
    tim: pac::TIM1,
    _pins: (Ch1<PushPull>, Bkin),
}

impl Pwm {
    /// Configures the timer with its output off, then connects the pins. It counts only when the time base starts it.
    pub fn new(tim: pac::TIM1, output: impl Into<Ch1<PushPull>>, fault: impl Into<Bkin>, rcc: &mut pac::RCC) -> Self {
        reset::<pac::TIM1>(rcc);
        put!(tim.psc(), u32::from(SERVO.prescaler));
        put!(tim.arr(), SERVO.reload);
        put!(tim.ccmr1_output(), FORCE_OFF);
        put!(tim.ccer(), 1);
        put!(tim.cr2(), MMS_ENABLE);
        put!(tim.bdtr(), BDTR);
        // Loads prescaler and reload; the update flag it leaves is cleared.
        put!(tim.egr(), 1);
        put!(tim.sr(), 0);
        // Update interrupt: the servo tick. Break interrupt: the bridge's fault.
        put!(tim.dier(), 1 | 1 << 7);
        let fault = fault.into();
        Pwm { tim, _pins: (output.into(), fault) }
    }
}

impl ErrorType for Pwm {
    type Error = Infallible;
}

impl SetDutyCycle for Pwm {
    fn max_duty_cycle(&self) -> u16 {
        SERVO.steps() as u16
    }

    #[inline]
    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        put!(self.tim.ccr1(), u32::from(duty));
        Ok(())
    }

    /// At once, and until a duty set afterwards takes effect with the next update.
    #[inline]
    fn set_duty_cycle_fully_off(&mut self) -> Result<(), Infallible> {
        // Forced low without preload, so that 0 reaches the compare register itself and the output stays low when the
        // mode returns.
        put!(self.tim.ccmr1_output(), FORCE_OFF);
        put!(self.tim.ccr1(), 0);
        put!(self.tim.ccmr1_output(), PWM_MODE);
        Ok(())
    }
}

fn tim1() -> &'static pac::tim1::RegisterBlock {
    // SAFETY: the register block is always there. Used through this reference: the flags, which are cleared by writing 0 to
    // one alone, and the main output enable, which only the servo task sets and only the hardware clears.
    unsafe { &*pac::TIM1::ptr() }
}

/// The servo tick, for its task.
pub struct Tick(pub(super) ());

impl ServoTimer for Tick {
    #[inline(always)]
    fn acknowledge(&mut self) {
        put!(tim1().sr(), !1);
    }

    #[inline(always)]
    fn since_due(&self) -> u32 {
        tim1().cnt().read().bits()
    }

    #[inline(always)]
    fn arm(&mut self) {
        if tim1().bdtr().read().bits() & MOE == 0 {
            change!(tim1().bdtr(), clear 0, set MOE);
        }
    }
}

/// Waits for the middle of a period, two periods at the most. A timer that does not run is found by the supervision of the tasks.
pub fn await_middle() {
    // A poll takes more than four cycles, and far less than 500.
    let _ = (0..5000).any(|_| tim1().cnt().read().bits().wrapping_sub(4500) < 500);
}

/// Acknowledges the break.
#[inline(always)]
pub fn clear_break() {
    put!(tim1().sr(), !(1 << 7));
}

const FORWARD: Place = Board::TABLE.pin("forward");
const REVERSE: Place = Board::TABLE.pin("reverse");
/// The bridge of a board: PWM and the two direction pins, coasting.
pub type Bridge =
    PwmBridge<Pwm, Output<{ FORWARD.port }, { FORWARD.number }>, Output<{ REVERSE.port }, { REVERSE.number }>>;

/// Makes the bridge. The direction pins are low before they become outputs.
pub fn bridge(
    pwm: Pwm,
    forward: Pin<{ FORWARD.port }, { FORWARD.number }>,
    reverse: Pin<{ REVERSE.port }, { REVERSE.number }>,
) -> Result<Bridge, BridgeFault> {
    PwmBridge::new(pwm, forward.into_push_pull_output(), reverse.into_push_pull_output())
}

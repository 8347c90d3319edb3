//! What drives the live signal, and what is known of the circuit behind it (`edm_hal_shim::live`).
//!
//! Edges come while every task reports. The circuit is *armed* when the head leaves its disabled state, never otherwise, and
//! holds on until it is disabled again. Each time before that, and at the start, the circuit is tried before it is
//! trusted again: without edges it must let go, and not take hold when it is armed; with edges it must not take hold by itself;
//! at the start it must take hold once when it is armed. What it is believed to be is compared with what is read back once a
//! millisecond.

use edm_hal_shim::board;
use edm_hal_shim::live::Live;
use edm_servo_head::head::{Fault, State};

/// Milliseconds without edges after which the latch has let go: the monostable runs for 0.8 ms at most.
const SILENT: u32 = 1;

/// How far the trial of the circuit, or its use, is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// No edges for so many whole milliseconds and a part of one.
    Silent(u32),
    /// No edges, and armed.
    Tried,
    /// Edges, and not armed.
    Edges,
    /// Armed with edges, for trial.
    Proof,
    /// It may be armed.
    Ready,
    /// It is.
    Armed,
    /// It is not to be trusted, or has let go, which has been said; until the head is disabled anew.
    Failed,
}

/// The live signal with what is known of its circuit. Owned by the servo task.
pub struct Watch<L> {
    live: L,
    step: Step,
    /// It has taken hold, since the start.
    proved: bool,
}

impl<L: Live> Watch<L> {
    /// Without edges.
    pub fn new(live: L) -> Self {
        Watch { live, step: Step::Silent(0), proved: false }
    }

    /// The end of a servo tick.
    #[inline(always)]
    pub fn toggle(&mut self) {
        self.live.toggle();
    }

    /// The head has another state, in which pulses and bridge are off, or allowed.
    pub fn enters(&mut self, state: State) {
        match state {
            State::Disabled => self.start(),
            State::Fault => {}
            _ if self.step == Step::Ready => self.arm(),
            // As soon as the trial is over.
            _ => {}
        }
    }

    /// A millisecond in a state; whether every task has reported. What is wrong, once.
    pub fn millisecond(&mut self, state: State, alive: bool) -> Option<Fault> {
        let read = self.live.armed();
        self.live.arm(false);
        let wanted = !matches!(state, State::Disabled | State::Fault);
        match self.step {
            Step::Failed => return None,
            Step::Armed if !alive => return self.fail(Fault::LiveLost),
            // The flash has been written, which only a head that is not armed may do.
            _ if !alive => self.start(),
            Step::Silent(ms) if ms < SILENT => self.step = Step::Silent(ms + 1),
            // Whatever lets it hold on without edges, or take hold unasked, does not let go of a dead head.
            Step::Silent(_) | Step::Tried | Step::Edges | Step::Ready if read => return self.fail(Fault::LiveStuck),
            Step::Silent(_) => {
                self.live.arm(true);
                self.step = Step::Tried;
            }
            Step::Tried => {
                self.live.run(true);
                self.step = Step::Edges;
            }
            Step::Edges if self.proved => self.step = Step::Ready,
            Step::Edges => {
                self.live.arm(true);
                self.step = Step::Proof;
            }
            Step::Proof | Step::Armed if !read => return self.fail(Fault::LiveLost),
            Step::Proof => {
                self.proved = true;
                self.start();
            }
            Step::Ready if wanted => self.arm(),
            Step::Ready | Step::Armed => {}
        }
        None
    }

    /// Without edges, from now on: the trial begins.
    fn start(&mut self) {
        self.live.run(false);
        self.step = Step::Silent(0);
    }

    fn arm(&mut self) {
        self.live.arm(true);
        self.step = Step::Armed;
    }

    fn fail(&mut self, fault: Fault) -> Option<Fault> {
        self.live.run(false);
        self.step = Step::Failed;
        Some(fault)
    }
}

/// The clock against the ticks of the servo, which another timer makes.
pub struct ClockCheck {
    /// Clock and number of the tick, when it was looked at last.
    last: Option<(u32, u32)>,
}

impl ClockCheck {
    /// Nothing has been seen.
    pub const fn new() -> Self {
        ClockCheck { last: None }
    }

    /// Looks again; how the clock has gone since the last time, and the ticks that are missing by it.
    pub fn look(&mut self, now: u32, tick: u32) -> (Pace, u32) {
        let Some((then, before)) = self.last.replace((now, tick)) else { return (Pace::Right, 0) };
        let ticks = tick.wrapping_sub(before);
        // 20 ticks, or 21: never so many that this overflows, and if it does it is wrong anyway.
        let (passed, due) = (now.wrapping_sub(then), ticks.saturating_mul(CYCLES));
        let missing = (passed.saturating_sub(due) + CYCLES / 2) / CYCLES;
        let pace = match passed {
            // Less than two ticks, where a tick may begin 6 us late, and one follows early when the core was halted before it.
            _ if passed < due - due / 10 => Pace::Slow,
            _ if passed > due + due / 10 => Pace::Fast,
            _ => Pace::Right,
        };
        (pace, missing)
    }
}

impl Default for ClockCheck {
    fn default() -> Self {
        ClockCheck::new()
    }
}

/// How the clock has gone against the ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// As it should.
    Right,
    /// It stands, or is slower by more than 10 %.
    Slow,
    /// More than one tick is missing, or it is faster by more than 10 %.
    Fast,
}

/// Clock cycles of a servo tick.
const CYCLES: u32 = board::CORE_HZ / board::TICK_HZ;

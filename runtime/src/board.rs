//! What a board has to offer: one implementation for each contract of hal-shim.

use crate::Note;
use core::borrow::Borrow;
use edm_hal_shim::backup::BackupMemory;
use edm_hal_shim::bridge::HBridge;
use edm_hal_shim::can::{Filters, Inboxes, Mailboxes, SyncInbox};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::{EdgeGuard, EdgeLines, EncoderTimer};
use edm_hal_shim::gap::GapFrontEnd;
use edm_hal_shim::generator::Generator;
use edm_hal_shim::live::Live;
use edm_hal_shim::reflex::{ForcedLines, Thresholds};
use edm_hal_shim::safety::{DriveSense, Safety};
use edm_hal_shim::self_test::Registers;
use edm_hal_shim::stage::Stage;
use edm_hal_shim::steps::StepInput;
use edm_hal_shim::store::Storage;
use edm_hal_shim::tick::{Period, ServoTimer};
use edm_hal_shim::watchdog::Watchdog;
use edm_servo_head::encoder::Shared as Published;
use edm_servo_head::gap::GapSource;
use edm_servo_head::gap::teach::Shown;
use edm_servo_head::gap::voltage;
use edm_servo_head::head::WritePermit;

/// What the reflex has seen of the pulses: for the log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Pulse {
    /// Short pulses so far, wrapping.
    pub shorts: u32,
    /// Converter codes of the newest pulse: gap current, gap voltage.
    pub codes: [u16; 2],
}

/// A gap source that other settings can be given under way.
pub trait Tunable: GapSource {
    /// Runs other settings from the next block on, without a bump.
    fn retune(&mut self, active: &voltage::Active);
    /// Pulses are permitted, or not.
    fn permit(&mut self, permitted: bool);
    /// Looks at a part of the settings: false once they have changed by themselves.
    fn is_intact(&mut self) -> bool;
    /// One of the [`voltage::SLOW`] words, in turn, and which it is.
    fn slow(&mut self) -> (usize, u32);
    /// Shows what the pulses that end were, from the next block on, or does so no longer.
    fn collect(&mut self, collects: bool);
    /// There is something to show.
    fn has_news(&self) -> bool;
    /// What is known of the levels of pulses ([`PulseStream::levels`](edm_servo_head::gap::pulses::PulseStream::levels)), and of the pulses that have ended, the newest.
    fn look(&mut self) -> (u32, Option<Shown>);
}

impl Tunable for voltage::Voltage {
    fn retune(&mut self, active: &voltage::Active) {
        voltage::Voltage::retune(self, *active);
    }

    #[inline(always)]
    fn permit(&mut self, permitted: bool) {
        voltage::Voltage::permit(self, permitted);
    }

    #[inline]
    fn is_intact(&mut self) -> bool {
        voltage::Voltage::is_intact(self)
    }

    #[inline]
    fn slow(&mut self) -> (usize, u32) {
        voltage::Voltage::slow(self)
    }

    fn collect(&mut self, collects: bool) {
        voltage::Voltage::collect(self, collects);
    }

    #[inline(always)]
    fn has_news(&self) -> bool {
        voltage::Voltage::has_news(self)
    }

    fn look(&mut self) -> (u32, Option<Shown>) {
        voltage::Voltage::look(self)
    }
}

/// A board, by the types of its parts. Each contract is that of the trait.
pub trait Board: 'static {
    /// Time, the same for all.
    type Clock: Clock + Copy;
    /// Where the encoder's count is published: a place that the compiler knows, where there is one.
    type Published: Borrow<Published>;
    /// Interrupt lines of the encoder, for its task.
    type Lines: EdgeLines;
    /// The same lines, for the servo task.
    type Guard: EdgeGuard;
    /// Second counter on them.
    type Timer: EncoderTimer;
    /// Converter of the gap voltage.
    type FrontEnd: GapFrontEnd;
    /// What makes readings of its blocks.
    type Source: Tunable;
    /// H-bridge.
    type Bridge: HBridge;
    /// Pulse generator.
    type Generator: Generator;
    /// Safety inputs.
    type Inputs: Safety;
    /// Motor current and bus voltage.
    type Drive: DriveSense;
    /// What reflex and stop force.
    type Forced: ForcedLines;
    /// Live signal.
    type Live: Live;
    /// Timer of the servo tick, which is that of the PWM.
    type Tick: ServoTimer;
    /// Timer of the supervision.
    type Millisecond: Period;
    /// Counter of a host's steps.
    type Steps: StepInput;
    /// Registers that are written once.
    type Registers: Registers;
    /// Thresholds of the reflex.
    type Thresholds: Thresholds;
    /// Frames that came.
    type Inboxes: Inboxes;
    /// The inbox of SYNC, for the servo task.
    type Sync: SyncInbox;
    /// Frames that go.
    type Mailboxes: Mailboxes;
    /// What the controller listens to.
    type Filters: Filters;
    /// Watchdog.
    type Watchdog: Watchdog;
    /// What is stored when the power is cut.
    type Storage: Storage<WritePermit>;
    /// Memory with a cell.
    type Backup: BackupMemory;
    /// Where the next program is staged.
    type Stage: Stage;
    /// Whoever calls the tasks.
    type Caller: Caller;
}

/// Calls the tasks, and takes what is to be logged. A task that is requested while it runs, runs once more.
pub trait Caller: Copy {
    /// The planner has an estimate to plan on.
    fn plan(&self);
    /// The protocol has something to do.
    fn protocol(&self);
    /// Frames wait to be sent.
    fn transmit(&self);
    /// The supervision has other limits to take.
    fn supervise(&self);
    /// For the log. Never called by the servo task or any above it.
    fn note(&self, note: &Note);
    /// Lights or darkens the status light.
    fn light(&self, lit: bool);
    /// Raises or lowers the line that asks for a move of the coarse axis.
    fn ask(&self, asks: bool);
    /// Raises or lowers the line that lets a host step.
    fn takes_steps(&self, takes: bool);
    /// What the reflex has seen so far.
    fn pulse(&self) -> Pulse;
}

//! What passes between the [`Drive`](super::Drive) and other tasks: orders and set points to the head, facts from the board.

use crate::canopen::{Group, Update};
use crate::head::{Command, Fault};
use crate::units::Nanometres;
use edm_hal_shim::self_test::SelfTest;

/// What the drive wants done, in the order of `Drive::take`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Order {
    /// A command to the head; its result goes to `Drive::answered`.
    Command(Command),
    /// Give head, gap source, supervision, reflex and generator what `Drive::active` says now. Then call
    /// `Drive::runs_configuration`, or `Drive::refused_configuration` if the head refuses; in both cases
    /// `Node::written`, because a host may wait for it.
    Configure,
    /// Raise this fault.
    Raise(Fault),
    /// Store: `StoredImage::keep`, under a `WritePermit`. Then `Drive::stored`.
    Store(Group),
    /// Forget what is stored, from the next reset on: `StoredImage::forget`. Then `Drive::stored`.
    Restore(Group),
    /// A part of an update of the program, under a `WritePermit`; then `Node::answer` with any group that has one.
    Update(Update),
    /// The host has reset the node: `Drive::restart` with what is stored, then `Drive::boot`.
    ResetNode,
    /// The host has reset communication: `Drive::boot`.
    ResetCommunication,
}

/// A set point of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SetPoint {
    /// Where.
    pub to: Nanometres,
    /// Servo ticks to reach it in.
    pub ticks: u32,
}

impl SetPoint {
    /// The command for the head.
    pub const fn command(self) -> Command {
        Command::Follow(self.to, self.ticks)
    }
}

/// What the drive cannot know by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// Cause of the last reset, as the chip names it: 2009h:1.
    pub reset_cause: u32,
    /// Build: 2009h:2.
    pub build: &'static str,
    /// What the board has found of itself: 2009h:3.
    pub self_test: SelfTest,
    /// How the run before ended, when it knew: 2009h:4.
    pub last_end: u8,
}

/// Tasks of `Drive::set_timers`: gap, servo, supervision, protocol, plan.
pub const TASKS: usize = 5;

/// Times of a task, for 200Ah.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TaskTimer {
    /// Newest run, ns.
    pub last: u32,
    /// Longest run, ns.
    pub most: u32,
    /// Load, 0.01 %.
    pub load: u16,
}

/// Which configuration each task runs; they count up from 0, that of the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Generations {
    /// The newest.
    pub newest: u32,
    /// That of the servo task, which was accepted or refused last.
    pub servo: u32,
    /// That of the gap task.
    pub gap: u32,
    /// That of the supervision.
    pub supervision: u32,
}

/// What was lost since power-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Lost {
    /// Frames that came faster than they were taken.
    pub frames: u32,
    /// Events between tasks that did.
    pub events: u32,
    /// Servo ticks that did not come while the head was enabled.
    pub ticks: u32,
    /// Blocks of conversions that did not come, or were not taken in time.
    pub blocks: u32,
    /// Pulses that the high comparator has not shown, and the low one, thousands.
    pub unseen: [u32; 2],
    /// Blocks in which the gate rang, and pauses were left out.
    pub rings: u32,
}

//! CAN: the frames of the embedded-can project, as they stand, and a controller with an inbox of its own for SYNC.

pub use embedded_can::{ExtendedId, Frame, Id, StandardId};

/// Where the controller keeps a frame that has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inbox {
    /// SYNC.
    Sync,
    /// Everything else.
    Others,
}

/// The controller had to drop frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overrun;

/// How the controller is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Trouble {
    /// It is error passive.
    pub passive: bool,
    /// It is off the bus.
    pub bus_off: bool,
}

/// Frames that have come.
pub trait Inboxes {
    /// A frame.
    type Frame: Frame;
    /// The next frame of an inbox; [`Overrun`] once when the controller had to drop some.
    fn next(&mut self, from: Inbox) -> Option<Result<Self::Frame, Overrun>>;
}

/// The inbox of SYNC, seen from the servo task.
pub trait SyncInbox: Clone {
    /// Length of the SYNC that has come and that nobody has taken yet.
    fn waits(&self) -> Option<u8>;
}

/// Frames that go.
pub trait Mailboxes {
    /// A frame.
    type Frame: Frame;
    /// Hands a frame to a free mailbox. `false` when none is free or a frame of the same identifier still waits; the interrupt
    /// of an empty mailbox says when to try again. Nothing that waits is ever displaced.
    fn send(&mut self, frame: &Self::Frame) -> bool;
    /// Acknowledges the interrupt of an empty mailbox.
    fn acknowledge(&mut self);
}

/// What the controller listens to.
pub trait Filters {
    /// Listens to data frames of these identifiers from now on, and to nothing else. No frame is lost over the change.
    fn listen(&mut self, sync: u16, others: &[u16]);
    /// How the controller is.
    fn trouble(&self) -> Trouble;
}

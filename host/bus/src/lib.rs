//! A CAN bus of a PC: virtual nodes and ordinary CAN programs on one hub.
//!
//! | room | responsible for |
//! | --- | --- |
//! | [`frame`] | frames, and the bits they take on a wire |
//! | [`hub`] | who gets what: every port all frames but its own; the bus is counted |
//! | [`mailbox`] | a port for a program of this process |
//! | [`slcan`], [`socketcand`] | the two text protocols, without input or output of their own |
//! | [`client`] | one conversation: a reader, a writer, what waits in between |
//! | [`tcp`], `pty` | clients by network and by serial port |
//! | `kernel` | an interface of the Linux kernel (SocketCAN) |
//! | [`way`] | the other side: onto a bus that an adapter or another program serves |
//! | [`filler`] | foreign traffic |
//!
//! The hub has no bit rate: a frame arrives as soon as it is sent, in the order of sending, and never fails. What a wire
//! would have carried is counted, so that a load can be stated and made.

pub mod client;
pub mod filler;
pub mod frame;
pub mod hub;
#[cfg(target_os = "linux")]
pub mod kernel;
pub mod mailbox;
#[cfg(unix)]
pub mod pty;
pub mod slcan;
pub mod socketcand;
pub mod tcp;
pub mod way;

pub use frame::Frame;
pub use hub::{Hub, Port, Traffic};
pub use way::Way;

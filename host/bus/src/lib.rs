//! A CAN bus on a PC. It serves the virtual heads of `cargo sim serve`, the desk, and any CAN program that connects to them:
//! all are ports of one hub.
//!
//! | room | responsible for |
//! | --- | --- |
//! | [`frame`] | frames, and the bits they take on a wire |
//! | [`hub`] | delivery: every port gets all frames but its own; traffic is counted |
//! | [`mailbox`] | a port for a program of this process |
//! | [`slcan`], [`socketcand`] | the two text protocols, without input or output of their own |
//! | [`client`] | one conversation: a reader, a writer, the queue in between |
//! | [`tcp`], `pty` | clients over the network and a serial port |
//! | `kernel` | an interface of the Linux kernel (SocketCAN) |
//! | [`connection`] | the client side: joins a bus of an adapter, another program or the kernel |
//! | [`filler`] | foreign traffic |
//!
//! The hub has no bit rate: a frame arrives as soon as it is sent, in the order of sending, and never fails. What a wire
//! would have carried is counted, so that a load can be stated and made.

pub mod client;
pub mod connection;
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

pub use connection::Connection;
pub use frame::Frame;
pub use hub::{Hub, Port, Traffic};

//! The drive: a head as a CiA 402 device (IEC 61800-7-201) with EDM objects behind a [`Node`].
//!
//! The drive keeps what the profile needs (state machine, modes, the values that a host writes) and nothing that the head
//! knows already: actual values come from the newest [`Status`], settings are a [`Settings`], and whatever is to happen is
//! an [`Order`]. It waits for nobody, so the same code runs in the protocol task of the chip, where orders and status go
//! through queues, and beside the head on a PC:
//!
//! ```text
//! every millisecond:
//!   drive.observe(status)                       newest status of the head; drive.changed(change) for each change of state
//!   node.receive(frame, at, &mut drive)         each frame that came
//!   node.synchronised(tick, &mut drive)         before the orders are taken: set points of the last SYNC
//!   node.poll(now, &mut drive)
//!   drive.poll(now, &mut node)                  state machine, emergencies
//!   while let Some(order) = drive.take() { .. } see [`Order`]
//!   while let Some(frame) = node.take() { .. }
//! ```
//!
//! [`Node`]: super::Node

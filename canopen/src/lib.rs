//! A CANopen node (CiA 301 version 4.2) without input or output of its own: frames and the time go in, frames come out.
//!
//! The device implements [`Dictionary`]: its objects, read and written by place. The [`Node`] answers for network
//! management, SDO, PDO, SYNC, emergencies and heartbeats, and for the objects 1000h to 1FFFh that configure them. It keeps
//! no statics: a process can run several. Of the device the node knows only what [`Device`] and [`Dictionary`] say.
//!
//! Terms are those of the standard: an *object* has an index and sub-indices; an *SDO* reads or writes one of them; a *PDO*
//! carries the values of several, as its *mapping* says, and is called RPDO toward the device and TPDO from it.
//!
//! It is written here because no available node has event and inhibit timers, a heartbeat consumer, writes that are checked
//! before they are taken, and no statics. What it does with each object is in `docs/canopen.md`.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

mod abort;
mod communication;
mod device;
mod dictionary;
mod emergency;
mod frame;
mod heartbeat;
mod lss;
mod node;
mod objects;
mod outbox;
mod parameters;
mod pdo;
mod sdo;
mod space;
mod stored;
mod sync;

pub use abort::Abort;
pub use communication::{DefaultValue, OwnObject, own_objects};
pub use device::{Device, ENTRIES, PDOS, PdoDefault, mapped};
pub use dictionary::{
    Access, DataType, Dictionary, Entry, Event, Group, LONGEST, Mapping, NmtState, ObjectHandle, Request, Update,
    Written,
};
pub use emergency::ERRORS;
pub use frame::{Frame, NodeId, Time};
pub use lss::{BitRate, BusSettings};
pub use node::{BootError, Controller, IDENTIFIERS, Node};
pub use objects::STORED;
pub use stored::{Listed, Record, Restored};

#[cfg(test)]
mod tests;

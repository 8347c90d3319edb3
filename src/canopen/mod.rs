//! A CANopen node (CiA 301 version 4.2) without input or output of its own: frames and the time go in, frames come out.
//!
//! The device implements [`Dictionary`]: its objects, read and written by place. The node answers for network management,
//! SDO, PDO, SYNC, emergencies and heartbeats, and for the objects 1000h to 1FFFh that configure them.

mod abort;
mod dictionary;

pub use abort::Abort;
pub use dictionary::{
    Access, DataType, DefaultValue, Description, Dictionary, Entry, Event, Group, LONGEST, Mapping, NmtState, Place,
    Request, Shape,
};

//! A master commands the head over CANopen: node, drive, head and process model together.

mod datum;
mod drive;
mod dump;
mod edges;
mod edm;
mod flood;
mod guided;
mod host_lost;
mod inching;
mod leftover;
mod live;
mod probe;
mod requests;
mod rig;
mod segments;
mod servo_objects;
mod settings;
mod shared;
mod steps;
mod sync_preview;
mod technology;
mod unconfigured;

//! A master commands the head over CANopen: node, drive, head and process model together.

mod drive;
mod dump;
mod edm;
mod flood;
mod foreseen;
mod rig;
mod settings;

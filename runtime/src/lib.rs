//! The tasks of a head, and all data that pass between them.
//!
//! A *task* is what one interrupt runs, at one priority; a file here is a task with everything it owns. It runs over a
//! [`Board`], which names one implementation for each trait of hal-shim: the chip's registers in the firmware, the process
//! model on a PC. So what is compiled for the chip and what a test runs is one source: control core, tasks, queues.
//!
//! A *crossing* is a value that passes from one priority to another. All of them are declared in [`crossings`], and there are
//! three kinds (`edm_crossing`):
//!
//! - *latest wins*: configuration and status; a write is never refused, and the writer sees which generation runs;
//! - *counted ring*: events; one that does not fit is counted, and the count is an object and an emergency;
//! - *atomics*: flags, counts, words.
//!
//! Who calls a task, and when, is not decided here. On the chip it is RTIC, by the priorities of `edm_hal_shim::board::TASKS`.
//! On a PC it is a scheduler, by the same table: before and after each operation of a crossing a test may let a task of higher
//! priority run.
#![no_std]
#![forbid(unsafe_code)]

pub mod assemble;
pub mod board;
pub mod can;
pub mod crossings;
pub mod encoder;
pub mod gap;
pub mod idle;
pub mod image_store;
pub mod live;
pub mod note;
pub mod plan;
pub mod protocol;
pub mod servo;
mod staging;
pub mod supervise;
pub mod timers;

pub use assemble::{HostEnds, Parts, Room, Tasks, assemble};
pub use board::Board;
pub use crossings::{Crossings, Signals, TickCrossings};
pub use note::Note;

//! What the firmware costs: instructions exactly, cycles of a Cortex-M4F by estimate.
//!
//! *Task*: an exception, named by the firmware's task table. *Run*: from its entry to its return, both included, without the
//! exceptions that interrupt it. *Function*: code that the debug information says belongs to it, inlined or not, without
//! what it calls.
//!
//! [`meter`](crate::meter) has the estimate and its limits.

pub mod bounds;
pub mod laws;
pub mod names;
pub mod page;
pub mod report;
mod scenes;

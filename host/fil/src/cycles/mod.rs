//! What the firmware costs: instructions exactly, cycles of a Cortex-M4F by estimate.
//!
//! *Task*: an exception, named by the firmware's task table. *Run*: from its entry to its return, both included, without the
//! exceptions that interrupt it. *Function*: code that the debug information says belongs to it, inlined or not, without
//! what it calls.
//!
//! The estimate is that of `timing` with what flash (`accelerator`) and peripherals (`buses`) let the processor wait.
//! *Warm* is without these waits, *cold* as if the flash accelerator held nothing when the run began.
//!
//! Limits. It is a model, not silicon: no contention between processor and DMA for RAM, no alignment of 32-bit instructions,
//! and what the three modules say they assume. The vector of an exception is fetched while its frame is stored, and the cache
//! does not see that.

mod accelerator;
pub mod bounds;
mod buses;
mod cost;
mod meter;
pub mod names;
pub mod page;
pub mod report;
mod scenes;
mod timing;

pub use accelerator::WAIT_STATES;
pub use buses::Buses;
pub use cost::Cost;
pub use meter::{Marks, Meter, Run, Task};

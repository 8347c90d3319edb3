//! What the firmware costs: instructions exactly, cycles of a Cortex-M4F by estimate.
//!
//! *Task*: an exception, named by the firmware's task table. *Run*: from its entry to its return, both included, without the
//! exceptions that interrupt it. *Function*: code that the debug information says belongs to it, inlined or not, without
//! what it calls. *Cold*: as if the flash accelerator held nothing when the run began.
//!
//! Limits. It is a model, not silicon: no contention between processor and DMA for RAM, no wait states of the peripheral
//! buses (an APB1 access waits for that bus's clock, 2 to 6 cycles), no prefetch, no alignment of 32-bit instructions.

mod cost;
mod meter;
pub mod names;
pub mod report;
mod timing;

pub use cost::{Cost, WAIT_STATES};
pub use meter::{Meter, Task};

//! The unmodified firmware on a modelled chip: an ELF runs on a Cortex-M4F, its peripherals are those of [`edm_soc`]. It
//! serves firmware developers without a board (`cargo fil`): it bores, injects faults, and measures cycles and latency.
//!
//! Unicorn runs the processor's instructions; what an emulator for application processors lacks is here: exception entry
//! and return, sleeping, lazy saving of the FPU context, faults, time.
//!
//! Time. Each instruction is hooked and charged the nominal cycles of [`decode`]; the model of the chip is advanced to that
//! time before the instruction that would see it. Nothing depends on the host's clock: identical inputs give identical runs.
//!
//! Unicorn is GPL-2.0 and so is a binary that contains it; this package is unpublished and outside the workspace's
//! default members.

pub mod bench;
pub mod command;
pub mod commission;
pub mod cycles;
pub mod decode;
pub mod exercise;
pub mod faults;
pub mod host;
pub mod image;
pub mod latency;
pub mod layout;
pub mod live;
pub mod machine;
pub mod meter;
pub mod rig;
pub mod rtt;
pub mod seen;
pub mod serve;
pub mod session;
pub mod still;
pub mod synthetic;
pub mod wires;

//! Process model and native closed loop.
pub mod process;

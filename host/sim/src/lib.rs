//! Process model and native closed loop.
pub mod machine;
pub mod process;

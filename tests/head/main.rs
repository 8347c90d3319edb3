//! The head on a bench: states, faults, the guided check.

mod any_input;
mod bench;
mod check;
mod faults;
mod leave;
mod positioning;
mod proof;
mod states;

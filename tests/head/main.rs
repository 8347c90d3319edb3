//! The head on a bench: states, faults, commissioning.

mod any_input;
mod bench;
mod beside;
mod cleared;
mod commissioning;
mod edges;
mod ends;
mod escape;
mod every_fault;
mod faults;
mod follower;
mod guiding;
mod hazards;
mod inching;
mod jumps;
mod orbits;
mod permit;
mod positioning;
mod press;
mod proof;
mod states;
mod supervision;
mod transitions;

//! Command line of the simulation.
fn main() {}

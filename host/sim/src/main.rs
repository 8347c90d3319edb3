//! Command line of the simulation.

use std::process::ExitCode;

fn main() -> ExitCode {
    edm_sim::cli::main(std::env::args_os(), edm_sim::commanded::bore)
}

//! Command line of the desk.

use std::process::ExitCode;

fn main() -> ExitCode {
    edm_desk::cli::main(std::env::args_os())
}

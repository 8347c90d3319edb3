//! Commands, and the checks that come before anything runs.
//!
//! Bad input ends with one line on stderr that names option or key, value and what is allowed, exit code
//! [`EXIT_BAD_INPUT`], and nothing written: the inputs are read, the values checked and the outputs claimed first. A run
//! that does not reach its depth, or an output that fails in the end, is [`EXIT_FAILED`].

mod bore;
mod describe;
mod replay;
mod tables;

pub use crate::terminal::{EXIT_BAD_INPUT, EXIT_FAILED, Failure};
pub use bore::Bore;
pub use replay::Replay;

use crate::bench::Bench;
use crate::compare::Compare;
use crate::faults::Faults;
use crate::observe::Run;
use crate::search::Search;
use crate::serve::Serve;
use crate::soak::Soak;
use crate::sweep::Sweep;
use crate::terminal::{one_line, say};
use clap::error::ErrorKind;
use clap::{Parser, Subcommand};
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

/// Simulated EDM servo head: the control core of the head bores holes in a process model
#[derive(Debug, Parser)]
#[command(name = "edm-sim", version, disable_help_subcommand = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Bore a blind hole
    #[command(
        after_help = "Exit code: 0 hole bored; 1 not bored, or an output failed; 2 bad input, nothing was written."
    )]
    Bore(Bore),
    /// Run virtual heads on a CAN bus in real time; CAN programs connect to it
    Serve(Serve),
    /// List the built-in scenarios
    Scenarios,
    /// List every setting with default, unit, range, meaning and source
    Settings,
    /// Write the CANopen description file (EDS)
    Eds {
        /// Write to a file instead of the standard output
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Write a DBC file of the frames of a node
    Dbc {
        /// Write to a file instead of the standard output
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Node-ID
        #[arg(long, value_name = "ID", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=127))]
        node_id: u8,
    },
    /// Measure speed (in processor time) and memory
    Bench(Bench),
    /// Run every combination of scenarios, values and seeds against the bounds
    Sweep(Sweep),
    /// Compare the feed laws with the same seeds (docs/feed-laws.md)
    #[command(
        after_help = "Exit code: 0 all runs done; 1 a run or an output failed; 2 bad input, nothing was written."
    )]
    Compare(Compare),
    /// Search the parameters of a feed law on holes that are not reported (docs/feed-laws.md)
    #[command(
        after_help = "Exit code: 0 searched; 1 the table could not be written; 2 bad input, nothing was written."
    )]
    Search(Search),
    /// Inject faults: every wire and every ordered pair of wires, while the head erodes (docs/robustness.md)
    Faults(Faults),
    /// Send random commands and events, and check the invariants in every tick (docs/robustness.md)
    Soak(Soak),
    /// Run a recording of a gap through the head's filters and classifier (docs/gap-sensing.md)
    #[command(after_help = "Exit code: 0 done; 1 an output failed; 2 bad input, nothing was written.")]
    Replay(Replay),
}

/// Runs a command line; gives the exit code.
pub fn main(arguments: impl Iterator<Item = OsString>, run: impl Run) -> ExitCode {
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(error) if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            say(&error.to_string());
            return ExitCode::SUCCESS;
        }
        Err(error) if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            return complain("a command is missing; see `edm-sim --help`", EXIT_BAD_INPUT);
        }
        Err(error) => return complain(&one_line("edm-sim", &error.to_string()), EXIT_BAD_INPUT),
    };
    let done = match cli.command {
        Command::Bore(bore) => bore.execute(run),
        Command::Serve(serve) => serve.execute().map(|()| true),
        Command::Sweep(sweep) => sweep.execute(),
        Command::Compare(compare) => compare.execute(),
        Command::Search(search) => search.execute(),
        Command::Faults(faults) => faults.execute(),
        Command::Soak(soak) => soak.execute(),
        Command::Replay(replay) => replay.execute().map(|()| true),
        Command::Bench(bench) => bench.execute(run),
        Command::Scenarios => tables::scenarios().map(|text| {
            say(&text);
            true
        }),
        Command::Eds { out } => describe::give(&describe::eds(), out.as_deref()).map(|()| true),
        Command::Dbc { out, node_id } => describe::give(&describe::dbc(node_id), out.as_deref()).map(|()| true),
        Command::Settings => {
            say(&tables::settings());
            Ok(true)
        }
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(EXIT_FAILED),
        Err(Failure::BadInput(message)) => complain(&message, EXIT_BAD_INPUT),
        Err(Failure::Failed(message)) => complain(&message, EXIT_FAILED),
    }
}

fn complain(message: &str, code: u8) -> ExitCode {
    eprintln!("edm-sim: {message}");
    ExitCode::from(code)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn what_the_parser_says_fits_one_line() {
        for arguments in
            [&["edm-sim"][..], &["edm-sim", "bor"], &["edm-sim", "bore", "--sed", "1"], &["edm-sim", "bore", "x"]]
        {
            let error = Cli::try_parse_from(arguments).unwrap_err();
            let line = one_line("edm-sim", &error.to_string());
            assert!(!line.contains('\n') && !line.contains("Usage"), "{line}");
        }
    }
}

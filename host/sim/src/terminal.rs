//! Exit codes and messages of a command.

use std::io::Write;

/// Exit code when the hole was not bored or an output could not be written.
pub const EXIT_FAILED: u8 = 1;
/// Exit code for bad input.
pub const EXIT_BAD_INPUT: u8 = 2;

/// Why a command ended early.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The person has to change something.
    BadInput(String),
    /// Something went wrong on the way.
    Failed(String),
}

/// Prints to stdout. A reader that has gone (`| head`) is no error.
pub fn say(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}

/// What the argument parser says, without usage and hints on further lines.
pub fn one_line(program: &str, text: &str) -> String {
    let body = text.split("\n\nUsage:").next().unwrap_or(text).split("\n\nFor more information").next().unwrap_or(text);
    let lines = body.lines().map(str::trim).filter(|line| !line.is_empty());
    let joined = lines.collect::<Vec<_>>().join(" ");
    let message = joined.strip_prefix("error: ").unwrap_or(&joined);
    format!("{}; see `{program} --help`", message.trim_end_matches('.'))
}

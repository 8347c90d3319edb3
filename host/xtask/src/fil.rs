//! `cargo fil`: the tools that the emulator is built with, the firmware, the emulator.

use crate::firmware;
use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};

/// What the emulator's build calls, and the package of Debian and Ubuntu that brings it.
const TOOLS: [(&str, &str); 3] = [("cmake", "cmake"), ("clang", "clang"), ("pkg-config", "pkg-config")];
/// The board that is modelled.
const BOARD: &str = "board-f405";

/// Builds what is not current and runs the emulator with `arguments`.
pub fn run(root: &Path, arguments: &[OsString]) -> ExitCode {
    let absent: Vec<_> = TOOLS.into_iter().filter(|(tool, _)| !runs(tool)).collect();
    if !absent.is_empty() {
        let tools: Vec<_> = absent.iter().map(|(tool, _)| *tool).collect();
        let packages: Vec<_> = absent.iter().map(|(_, package)| *package).collect();
        eprintln!(
            "the emulator is built with {}: apt-get install {} libclang-dev",
            tools.join(", "),
            packages.join(" ")
        );
        return ExitCode::FAILURE;
    }
    let elf = match firmware::build(root, BOARD) {
        Ok(elf) => elf,
        Err(message) => {
            eprintln!("{message}");
            return ExitCode::FAILURE;
        }
    };
    let status = firmware::cargo()
        .args(["run", "--release", "-p", "edm-fil", "--manifest-path"])
        .arg(root.join("Cargo.toml"))
        .arg("--")
        .args(["--elf".into(), elf.into_os_string()])
        .args(arguments)
        .status();
    match status {
        Ok(status) => status.code().and_then(|code| u8::try_from(code).ok()).map_or(ExitCode::FAILURE, ExitCode::from),
        Err(error) => {
            eprintln!("cargo: {error}");
            ExitCode::FAILURE
        }
    }
}

fn runs(tool: &str) -> bool {
    Command::new(tool).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
}

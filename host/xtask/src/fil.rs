//! `cargo fil`: build tools of the emulator, the firmware, the emulator.

use edm_seal::image::{build, cargo, target};
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
    let elf = match build(root, BOARD) {
        Ok(elf) => elf,
        Err(message) => {
            eprintln!("{message}");
            return ExitCode::FAILURE;
        }
    };
    // The whole workspace is chosen, so that what the tests have built is not built again with other features.
    let built = cargo().current_dir(root).args(["build", "--workspace", "--bin", "edm-fil"]).status();
    if !built.is_ok_and(|status| status.success()) {
        return ExitCode::FAILURE;
    }
    let program = target(root).join("debug/edm-fil");
    let status = Command::new(&program).args(["--elf".into(), elf.into_os_string()]).args(arguments).status();
    match status {
        Ok(status) => status.code().and_then(|code| u8::try_from(code).ok()).map_or(ExitCode::FAILURE, ExitCode::from),
        Err(error) => {
            eprintln!("{}: {error}", program.display());
            ExitCode::FAILURE
        }
    }
}

fn runs(tool: &str) -> bool {
    Command::new(tool).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
}

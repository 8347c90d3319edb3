//! Flash commands: every image is sealed first ([`edm_seal`]).

use edm_seal::image::{build, cargo, loader};
use edm_seal::{seal, seal_file};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// Builds and seals the image of a board, and has cargo-embed program it by a section of Embed.toml.
pub fn embed(root: &Path, feature: &str, section: &str, arguments: &[OsString]) -> Result<ExitCode, String> {
    let elf = build(root, feature)?;
    let mut command = cargo();
    command.current_dir(root).args(["embed", section, "--path"]).arg(elf).args(arguments);
    run(command, "cargo embed")
}

/// Runs a command on a sealed copy of the ELF file among its arguments: the first that is a file.
pub fn sealed(root: &Path, arguments: &[OsString]) -> Result<ExitCode, String> {
    let (program, arguments) = arguments.split_first().ok_or("no command that is to have the sealed image")?;
    let place = arguments.iter().position(|argument| Path::new(argument).is_file());
    let place = place.ok_or("none of the arguments is an ELF file")?;
    let mut arguments = arguments.to_vec();
    let elf = PathBuf::from(&arguments[place]);
    let copy = elf.with_extension("sealed");
    // What is wrong with it comes before a build.
    std::fs::read(&elf).map_err(|e| e.to_string()).and_then(seal).map_err(|e| format!("{}: {e}", elf.display()))?;
    seal_file(&elf, &loader(root)?, &copy)?;
    arguments[place] = copy.into_os_string();
    let mut command = Command::new(program);
    command.args(arguments);
    run(command, &program.to_string_lossy())
}

fn run(mut command: Command, name: &str) -> Result<ExitCode, String> {
    let status = command.status().map_err(|e| format!("{name}: {e}"))?;
    Ok(status.code().and_then(|code| u8::try_from(code).ok()).map_or(ExitCode::FAILURE, ExitCode::from))
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: &str = include_str!("../../../.cargo/config.toml");

    /// The line of a key in .cargo/config.toml.
    fn line(key: &str) -> &'static str {
        CONFIG.lines().find(|line| line.starts_with(key)).unwrap_or_else(|| panic!("no {key}"))
    }

    #[test]
    fn every_way_to_flash_seals() {
        assert!(line("flash-head").contains(" edm-xtask -- flash board-f405 default"));
        assert!(line("flash-disc").contains(" edm-xtask -- flash board-f407-disc disc"));
        assert!(line("runner").contains(" edm-xtask -- sealed probe-rs run "));
        let calls = CONFIG.lines().filter(|line| !line.starts_with('#'));
        assert_eq!(calls.filter(|line| line.contains("probe-rs") || line.contains("embed")).count(), 1);
    }

    #[test]
    fn a_command_gets_the_sealed_copy_in_the_place_of_the_image() {
        let error = |arguments: &[&str]| {
            let arguments: Vec<_> = arguments.iter().map(OsString::from).collect();
            sealed(Path::new("."), &arguments).expect_err("refused")
        };
        assert!(error(&[]).contains("no command"));
        assert!(error(&["true", "--chip", "no-file"]).contains("none of the arguments"));
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("image");
        std::fs::write(&file, "no ELF").unwrap();
        assert!(error(&["true", file.to_str().unwrap()]).contains("image: "));
    }
}

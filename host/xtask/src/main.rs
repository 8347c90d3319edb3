//! What a cargo alias cannot do: `cargo xtask docs` writes the files that are generated from declarations, and with
//! `--check` only tells whether they are current.

use clap::{Parser, Subcommand};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

mod settings_table;

#[derive(Parser)]
#[command(name = "cargo xtask", about = "Generated files of the EDM servo head")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Writes docs/settings.md from the settings' declarations.
    Docs {
        /// Write nothing; fail if a file is not current.
        #[arg(long)]
        check: bool,
    },
}

fn main() -> ExitCode {
    let Task::Docs { check } = Arguments::parse().task;
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..");
    match generate(&root.join("docs/settings.md"), &settings_table::render(), check) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

fn generate(path: &Path, text: &str, check: bool) -> Result<(), String> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if !check {
        return std::fs::write(path, text).map_err(|error| format!("{name}: {error}"));
    }
    match std::fs::read_to_string(path) {
        Ok(present) if present == text => Ok(()),
        _ => Err(format!("docs/{name} is not current: run `cargo xtask docs`")),
    }
}

//! Tasks of this repository that a cargo alias cannot do, for its developers. `cargo xtask docs` writes the generated files;
//! with `--check` it only checks them, the links between pages, and the list of released objects against its history.
//! `cargo xtask firmware` builds, checks and seals the firmware of both boards, `cargo flash-head` programs it, `cargo fil`
//! runs it on a modelled chip.

use clap::{Parser, Subcommand};
use edm_describe::{dbc, eds};
use edm_servo_head::canopen::NodeId;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

mod fil;
mod firmware;
mod flash;
mod links;
mod object_table;
mod pictures;
mod released;
mod settings_table;

#[derive(Parser)]
#[command(name = "cargo xtask", about = "Generated files and firmware image of the EDM servo head")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Writes the files generated from declarations: docs/settings.md, docs/objects.md, the EDS and DBC files, and the
    /// pictures of blocks, states and one millisecond in docs/pictures. Checks the links between the pages, and that
    /// docs/released-objects.csv keeps every released line.
    Docs {
        /// Write nothing; fail if a file is not up to date.
        #[arg(long)]
        check: bool,
    },
    /// Builds the firmware for every board, or for one, prints its sizes and checks that a chip would start it.
    Firmware {
        /// Feature of the board
        feature: Option<String>,
    },
    /// Links the firmware in an environment that sets RUSTFLAGS, and checks that a chip would start it.
    Link,
    /// Builds and seals the image of a board and has cargo-embed program it: `cargo flash-head`.
    Flash {
        /// Feature of the board
        feature: String,
        /// Section of Embed.toml
        section: String,
        /// Options of cargo-embed
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<OsString>,
    },
    /// Runs a command on a sealed copy of the ELF file among its arguments: the runner of `cargo run` for the chip.
    Sealed {
        /// Command, its options and the ELF file
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<OsString>,
    },
    /// Builds the firmware and runs a command of the modelled chip with it: `cargo fil`.
    #[command(disable_help_flag = true)]
    Fil {
        /// Command and options; `cargo fil --help` lists them.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<OsString>,
    },
}

fn main() -> ExitCode {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..");
    let done = |()| ExitCode::SUCCESS;
    let result = match Arguments::parse().task {
        Task::Docs { check } => documents()
            .and_then(|documents| {
                documents.iter().try_for_each(|(name, text)| generate(&root.join("docs"), name, text, check))
            })
            .and_then(|()| links::check(&root).map(|said| println!("{said}")))
            .and_then(|()| released::check(&root).map(|said| println!("{said}")))
            .map(done),
        Task::Firmware { feature } => firmware::run(&root, feature.as_deref()).map(done),
        Task::Link => firmware::link(&root).map(done),
        Task::Flash { feature, section, arguments } => flash::embed(&root, &feature, &section, &arguments),
        Task::Sealed { arguments } => flash::sealed(&root, &arguments),
        Task::Fil { arguments } => return fil::run(&root, &arguments),
    };
    match result {
        Ok(code) => code,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

/// The files in docs/ that are generated from declarations.
fn documents() -> Result<Vec<(&'static str, String)>, String> {
    let (mut sheet, mut frames) = (String::new(), String::new());
    // A string takes everything.
    let _ = eds::write(&mut sheet);
    if let Some(node) = NodeId::new(1) {
        let _ = dbc::write(&mut frames, node);
    }
    let mut documents = vec![
        ("settings.md", settings_table::render()),
        ("objects.md", object_table::render()),
        (eds::FILE, sheet),
        ("edm-servo-head.dbc", frames),
    ];
    documents.extend(pictures::render()?);
    Ok(documents)
}

fn generate(docs: &Path, name: &str, text: &str, check: bool) -> Result<(), String> {
    let path = docs.join(name);
    if !check {
        return std::fs::write(path, text).map_err(|error| format!("docs/{name}: {error}"));
    }
    match std::fs::read_to_string(path) {
        Ok(present) if present == text => Ok(()),
        _ => Err(format!("docs/{name} is not up to date: run `cargo xtask docs`")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    #[test]
    fn what_is_generated_is_committed() {
        let docs = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs");
        for (name, text) in documents().unwrap() {
            assert_eq!(generate(&docs, name, &text, true), Ok(()));
        }
    }

    /// rustfmt does not look for modules that a macro declares.
    #[test]
    fn the_feed_laws_are_formatted() {
        let laws = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../src/feed");
        let files = std::fs::read_dir(laws).unwrap().map(|entry| entry.unwrap().path());
        assert!(Command::new("rustfmt").args(["--edition", "2024", "--check"]).args(files).status().unwrap().success());
    }
}

//! Linker arguments of the firmware and the name of the build.
//!
//! The arguments are here and not in `.cargo/config.toml`, where an environment variable RUSTFLAGS would silently replace
//! them and yield an image whose entry is 0.

use std::path::PathBuf;
use std::process::Command;
use std::{env, fs};

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=../memory.x");
    if env::var("CARGO_CFG_TARGET_ARCH").as_deref() != Ok("arm") {
        return;
    }
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy("../memory.x", out.join("memory.x")).expect("OUT_DIR is writable");
    println!("cargo::rustc-link-search={}", out.display());
    // Where addresses are, for `cargo firmware`: a number may look like one.
    for argument in ["--nmagic", "--emit-relocs", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo::rustc-link-arg-bins={argument}");
    }

    // The commit, as a number that fits a register; 0 outside a repository.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo::rerun-if-changed={log}");
    }
    let commit = git(&["rev-parse", "--short=8", "HEAD"]).unwrap_or_default();
    println!("cargo::rustc-env=EDM_BUILD={}", commit.get(..8).unwrap_or("00000000"));
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    String::from_utf8(output.stdout).ok().map(|text| text.trim().to_owned())
}

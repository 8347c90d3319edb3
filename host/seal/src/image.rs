//! The image of a board, built in one way for `cargo firmware`, every flash command, the modelled chip and its tests.

use crate::seal_file;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The compiler's name of the chip's core.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// Where cargo builds.
pub fn target(root: &Path) -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from)
}

/// The cargo that runs this program.
pub fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// Builds and seals the firmware for a board, named by its feature, and says where it is.
///
/// # Errors
/// It does not build, or it cannot be sealed.
pub fn build(root: &Path, feature: &str) -> Result<PathBuf, String> {
    let status = cargo()
        .current_dir(root)
        .args(["build", "--profile", "firmware", "-p", "edm-firmware", "--bin", "edm-servo-head", "--target", TARGET])
        .args(["--no-default-features", "--features", feature])
        .args(["--config", &same_everywhere(&libraries()?)])
        .status()
        .map_err(|e| format!("cargo: {e}"))?;
    if !status.success() {
        return Err(format!("the firmware does not build with {feature}"));
    }
    let target = target(root);
    let folder = target.join("firmware");
    let elf = folder.join(format!("edm-servo-head-{feature}.elf"));
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    seal_file(&target.join(TARGET).join("firmware/edm-servo-head"), &elf)?;
    Ok(elf)
}

/// Where cargo keeps the sources of the libraries.
///
/// # Errors
/// The environment does not say.
pub fn libraries() -> Result<PathBuf, String> {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    home.or_else(|| Some(std::env::home_dir()?.join(".cargo")))
        .ok_or_else(|| "neither CARGO_HOME nor HOME is set".into())
}

/// The setting of cargo by which an image is the same wherever the libraries are. Their paths are in the messages of panics, and
/// decide on the order of the functions, and so on their cycles: a tenth of those of a function, as measured.
fn same_everywhere(libraries: &Path) -> String {
    format!("target.{TARGET}.rustflags = ['--remap-path-prefix={}=/cargo']", libraries.display())
}

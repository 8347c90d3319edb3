//! The image of a board, built in one way for `cargo firmware`, every flash command, the modelled chip and its tests.

use crate::{replace, seal_file, update};
use edm_hal_shim::board::BOARDS;
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

/// Builds and seals the firmware for a board, named by its feature, and says where it is. Beside it is the update of the same
/// image, with the ending `.update`.
///
/// # Errors
/// It does not build, or it cannot be sealed.
pub fn build(root: &Path, feature: &str) -> Result<PathBuf, String> {
    let program = ["-p", "edm-firmware", "--bin", "edm-servo-head", "--no-default-features", "--features", feature];
    let linked = compile(root, &program, "edm-servo-head")?;
    let folder = target(root).join("firmware");
    let elf = folder.join(format!("edm-servo-head-{feature}.elf"));
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    seal_file(&linked, &loader(root)?, &elf)?;
    let table = BOARDS.iter().find(|(name, _)| *name == feature).map(|(_, table)| table);
    let board = table.ok_or_else(|| format!("no board has the feature {feature}"))?.chip();
    let file = std::fs::read(&elf).map_err(|e| format!("{}: {e}", elf.display()))?;
    let update = update::make(&file, board, version(), commit(root))?;
    let path = elf.with_extension("update");
    replace(&path, &update)?;
    Ok(elf)
}

/// Builds the boot loader, the same for each board, and says where its ELF file is.
///
/// # Errors
/// It does not build.
pub fn loader(root: &Path) -> Result<PathBuf, String> {
    compile(root, &["-p", "edm-boot", "--bin", "edm-boot-loader"], "edm-boot-loader")
}

fn compile(root: &Path, arguments: &[&str], name: &str) -> Result<PathBuf, String> {
    let status = cargo()
        .current_dir(root)
        .args(["build", "--profile", "firmware", "--target", TARGET])
        .args(arguments)
        .args(["--config", &same_everywhere(&libraries()?)])
        // A linter in the compiler's place makes other code.
        .env_remove("RUSTC_WORKSPACE_WRAPPER")
        .status()
        .map_err(|e| format!("cargo: {e}"))?;
    if !status.success() {
        return Err(format!("{name} does not build: {}", arguments.join(" ")));
    }
    Ok(target(root).join(TARGET).join("firmware").join(name))
}

/// Version of this project: major in the high half, minor in the low half.
fn version() -> u32 {
    let part = |text: &str| text.parse::<u32>().unwrap_or(0);
    part(env!("CARGO_PKG_VERSION_MAJOR")) << 16 | part(env!("CARGO_PKG_VERSION_MINOR"))
}

/// The commit, as firmware/build.rs has it; 0: unknown.
fn commit(root: &Path) -> u32 {
    let output = Command::new("git").current_dir(root).args(["rev-parse", "--short=8", "HEAD"]).output();
    let text = output.ok().filter(|output| output.status.success()).map(|output| output.stdout).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    text.get(..8).and_then(|digits| u32::from_str_radix(digits, 16).ok()).unwrap_or(0)
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

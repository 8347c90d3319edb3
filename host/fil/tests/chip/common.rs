//! The firmware that the tests run.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Builds the firmware once and gives its ELF file.
pub fn firmware() -> &'static [u8] {
    static FILE: OnceLock<Vec<u8>> = OnceLock::new();
    FILE.get_or_init(|| {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let target = "thumbv7em-none-eabihf";
        let status = Command::new(env!("CARGO"))
            .current_dir(&root)
            .args([
                "build",
                "--quiet",
                "--profile",
                "firmware",
                "-p",
                "edm-firmware",
                "--bin",
                "edm-servo-head",
                "--target",
                target,
            ])
            .status()
            .expect("cargo runs");
        assert!(status.success(), "the firmware does not build");
        let directory = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from);
        std::fs::read(directory.join(target).join("firmware/edm-servo-head")).expect("the firmware was built")
    })
}

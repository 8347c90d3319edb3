//! The firmware that the tests run.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Builds and seals the firmware once and gives its ELF file.
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
        let file =
            std::fs::read(directory.join(target).join("firmware/edm-servo-head")).expect("the firmware was built");
        edm_seal::seal(file).expect("it is the firmware")
    })
}

/// File offset of what is loaded to `address`.
pub fn place(file: &[u8], address: u32) -> usize {
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
    let (table, count) = (word(28) as usize, word(44) & 0xffff);
    (0..count as usize)
        .map(|i| table + 32 * i)
        .find_map(|header| {
            let offset = address.checked_sub(word(header + 12))?;
            (word(header) == 1 && offset < word(header + 16)).then(|| (word(header + 4) + offset) as usize)
        })
        .expect("the address is loaded")
}

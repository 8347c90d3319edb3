//! Lets `machine::near` choose where the engine keeps what it has translated.

use std::env::var;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let target = ["CARGO_CFG_TARGET_OS", "CARGO_CFG_TARGET_ENV"].map(|name| var(name).unwrap_or_default());
    if target == ["linux", "gnu"] {
        println!("cargo:rustc-link-arg=-Wl,--wrap=mmap64");
    }
}

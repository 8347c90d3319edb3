//! Description files for masters and loggers: `edm-sim eds`, `edm-sim dbc`.

use crate::output::Output;
use crate::terminal::{Failure, say};
use edm_describe::{dbc, eds};
use edm_servo_head::canopen::NodeId;
use std::path::Path;

/// Writes a description to the file of `--out`, or to the standard output.
pub fn give(text: &str, out: Option<&Path>) -> Result<(), Failure> {
    let Some(path) = out else {
        say(text);
        return Ok(());
    };
    let output = Output::claim("--out", path).map_err(Failure::BadInput)?;
    output.write(|file| file.write_all(text.as_bytes())).map_err(Failure::Failed)
}

/// The data sheet (EDS).
pub fn eds() -> String {
    let mut text = String::new();
    // A string takes everything.
    let _ = eds::write(&mut text);
    text
}

/// The process data of a node, 1 to 127.
pub fn dbc(node: u8) -> String {
    let mut text = String::new();
    if let Some(node) = NodeId::new(node) {
        let _ = dbc::write(&mut text, node);
    }
    text
}

//! Description files for masters and loggers: `edm-sim eds`, `edm-sim dbc`.

use edm_servo_head::canopen::{NodeId, dbc, eds};

/// The data sheet.
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

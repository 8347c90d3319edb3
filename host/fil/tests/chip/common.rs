//! The firmware that the tests run, and how it begins to bore.

use edm_fil::rig::Emulated;
use edm_servo_head::head::Command;
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Rig as _;
use std::path::Path;
use std::sync::OnceLock;

/// Builds and seals the firmware once and gives its ELF file.
pub fn firmware() -> &'static [u8] {
    static FILE: OnceLock<Vec<u8>> = OnceLock::new();
    FILE.get_or_init(|| {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().expect("the project's folder");
        std::fs::read(edm_seal::image::build(&root, "board-f405").unwrap()).expect("the firmware was built")
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

/// Makes the present position home, enables the head and bores to a depth.
pub fn bore(rig: &mut Emulated, depth: Nanometres) {
    for command in [Command::SetHome(Nanometres(0)), Command::Enable, Command::MoveTo(depth), Command::Start] {
        rig.command(command).unwrap();
    }
}

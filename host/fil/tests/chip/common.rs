//! The firmware that the tests run, and how it begins to bore.

use edm_fil::host::{self, Bus as _};
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_servo_head::head::{Command, State};
use edm_servo_head::settings::{Declared as _, Settings, Value};
use edm_servo_head::units::Nanometres;
use edm_sim::bore::Setup;
use edm_sim::machine::Rig as _;
use std::path::Path;
use std::sync::OnceLock;

/// ELF file of the firmware: the one that EDM_FIRMWARE names, as when each test is a process; else built and sealed once.
pub fn firmware() -> &'static [u8] {
    static FILE: OnceLock<Vec<u8>> = OnceLock::new();
    FILE.get_or_init(|| {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().expect("the project's folder");
        let built = std::env::var_os("EDM_FIRMWARE").map(|file| root.join(file));
        let file = built.unwrap_or_else(|| edm_seal::image::build(&root, "board-f405").unwrap());
        std::fs::read(file).expect("the firmware was built")
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

/// A head on the default machine enabled and at rest so many um below its home, 9 mm above the work.
pub fn at_rest(um: u32, settings: impl FnOnce(Settings) -> Settings) -> Emulated {
    let setup = Setup::load("default").unwrap();
    let mut process = setup.process;
    process.set("workpiece.surface_mm", Value::Number(9.0)).unwrap();
    let settings = settings(Settings { commissioned: true, ..setup.head });
    let image = Image::parse(firmware().to_vec()).unwrap();
    let mut rig = Emulated::start(&image, process, &settings, 1, Witness::None).unwrap();
    host::begin(&mut rig).unwrap();
    for command in [Command::SetHome(Nanometres(0)), Command::Enable] {
        host::command(&mut rig, command).unwrap();
    }
    // At the velocity of the profile.
    for (index, sub, value, size) in
        [(0x6060, 0, 1, 1), (0x607A, 0, um, 4), (0x6081, 0, 20_000, 4), (0x6040, 0, 0x1F, 2)]
    {
        host::write(&mut rig, index, sub, value, size).unwrap();
    }
    for _ in 0..3000 {
        rig.pass().unwrap();
        if rig.status().position > i64::from(um) - 2 && rig.status().state == State::Ready {
            break;
        }
    }
    rig
}

/// Passes up to so many tenths of a second, until an object says that a measurement has finished or ended; what it says.
pub fn measured(rig: &mut Emulated, tenths: u32, index: u16, over: [u32; 2]) -> u32 {
    let mut step = 0;
    for _ in 0..tenths {
        (0..100).for_each(|_| rig.pass().unwrap());
        step = host::read(rig, index, 2).unwrap();
        if over.contains(&step) {
            break;
        }
    }
    step
}

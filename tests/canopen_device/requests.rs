//! Every request in every state and mode: what is answered ok is done or told as refused, what is aborted changes nothing, and no
//! bit says otherwise. The runs make docs/requests.md: `EDM_WRITE_DOCS=1 cargo test --test canopen_device requests`.

use crate::rig::{ID, Rig};
use edm_servo_head::head::{Fault, Guidance, Inch, State};
use std::collections::BTreeMap;
use std::fmt::Write;

/// What a machine is doing: how it gets there, in a mode that it can be done in.
type Situation = (&'static str, &'static [u8], fn(u8) -> Rig);

/// What a host asks, and whether it has been done.
struct Request {
    name: &'static str,
    ask: fn(&mut Rig) -> Result<(), u32>,
    done: fn(&Before, &mut Rig) -> bool,
}

/// What was before.
struct Before {
    position: i64,
    appended: u32,
}

/// What a run has come to.
#[derive(Clone, Debug, PartialEq)]
struct Outcome {
    state: State,
    fault: Option<Fault>,
    /// State machine of the drive.
    drive: u16,
    mode: u32,
    erode: u32,
    target: u32,
    velocity: u32,
}

const ALL: &[u8] = &[0, 1, 3, 6, 7, 8, 9];

/// Enabled 300 um above the work, home.
fn ready(mode: u8) -> Rig {
    let mut rig = Rig::new(|settings, plant| {
        settings.seek_settle_ms = 10.0;
        settings.jump_height = 200.0;
        (settings.touch_first, settings.touch_second) = (0.2, 0.2);
        plant.installation.surface = 0.9;
    });
    rig.send(0, &[1, ID]);
    rig.enable();
    rig.write(0x6060, 0, &[6]);
    rig.control(0x1F);
    rig.until(100, |rig| rig.status() & 0x3400 == 0x1400);
    rig.control(0x0F);
    rig.mode(1);
    let velocity = rig.read(0x6081, 0).cast_signed();
    rig.write32(0x6081, 0, 20_000);
    rig.move_to(600, 3000);
    rig.write32(0x6081, 0, velocity);
    rig.mode(mode);
    rig
}

/// The same, with a path to go.
fn queued(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.write32(0x2004, 1, 4000);
    rig
}

fn disabled(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.control(0);
    rig.run(20);
    rig
}

fn ready_to_switch_on(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.control(0x06);
    rig.run(20);
    rig
}

/// In the guided check.
fn commissioning(mode: u8) -> Rig {
    let mut rig = disabled(mode);
    rig.write(0x2001, 3, &[1]);
    rig.run(50);
    assert_eq!(rig.machine.status().state, State::Commissioning);
    rig
}

fn switched_on(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.control(0x07);
    rig.run(20);
    rig
}

fn halted(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.control(0x10F);
    rig.run(20);
    rig
}

fn quick_stopped(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.control(0x0B);
    rig.run(20);
    rig
}

/// Moves up, for a second at the least.
fn moving(mode: u8) -> Rig {
    let mut rig = ready(mode);
    match mode {
        1 => {
            rig.write32(0x6081, 0, 500);
            rig.write32(0x607A, 0, 50);
            rig.control(0x1F);
        }
        3 => rig.write32(0x60FF, 0, -500),
        8 => {
            rig.write(0x60C2, 1, &[100]);
            rig.write(0x60C2, 2, &[-2i8 as u8]);
            rig.write32(0x607A, 0, 50);
        }
        9 => {
            rig.write(0x60C2, 1, &[100]);
            rig.write(0x60C2, 2, &[-2i8 as u8]);
            rig.write32(0x60FF, 0, -500);
        }
        _ => {
            rig.write(0x60C2, 1, &[100]);
            rig.write(0x60C2, 2, &[-2i8 as u8]);
            rig.write32(0x60C1, 1, 50);
            rig.control(0x1F);
        }
    }
    rig.run(20);
    assert_eq!(rig.machine.status().state, State::Positioning);
    rig
}

fn homing(_: u8) -> Rig {
    let mut rig = ready(6);
    rig.write(0x6098, 0, &[17]);
    rig.write32(0x6099, 1, 200);
    rig.control(0x1F);
    rig.run(10);
    assert_eq!(rig.machine.status().state, State::Homing);
    rig
}

fn eroding(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.write32(0x2004, 1, 4000);
    rig.write(0x2001, 1, &[1]);
    rig.until(3000, |rig| rig.machine.status().state == State::Eroding);
    rig.run(20);
    rig
}

/// On its way to the work, pulses on.
fn seeking(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.write32(0x2004, 1, 4000);
    rig.write(0x2001, 1, &[1]);
    rig.until(200, |rig| rig.machine.status().state == State::Seeking);
    rig.run(20);
    rig
}

/// At the end of its path, which is above the work.
fn done(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.write32(0x2004, 1, 850);
    rig.write(0x2001, 1, &[1]);
    rig.until(3000, |rig| rig.machine.status().state == State::Done);
    rig.run(20);
    rig
}

/// Goes back from there, for half a second.
fn lifting(mode: u8) -> Rig {
    let mut rig = disabled(mode);
    rig.write(0x210F, 5, &200.0f32.to_le_bytes());
    rig.write(0x2105, 3, &400.0f32.to_le_bytes());
    rig.run(20);
    rig.enable();
    rig.write32(0x2004, 1, 850);
    rig.write(0x2001, 1, &[1]);
    rig.until(3000, |rig| rig.machine.status().state == State::Lifting);
    rig.run(20);
    rig
}

fn jumping(mode: u8) -> Rig {
    let mut rig = eroding(mode);
    rig.write(0x2001, 7, &[1]);
    rig.run(5);
    assert_eq!(rig.machine.status().state, State::Jumping);
    rig
}

/// Waits for a coarse axis.
fn inching(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.control(0);
    rig.run(20);
    for (sub, um) in [(1, 100.0f32), (2, 100.0), (3, 60.0), (4, 20.0)] {
        rig.write(0x2111, sub, &um.to_le_bytes());
    }
    rig.write(0x2106, 7, &900.0f32.to_le_bytes());
    rig.run(20);
    rig.enable();
    rig.write32(0x2004, 1, 4000);
    rig.write(0x2001, 1, &[1]);
    rig.until(3000, |rig| rig.machine.status().inch == Inch::Asks);
    rig.run(20);
    rig
}

fn touching(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.write(0x2011, 1, &[1]);
    rig.run(50);
    assert_eq!(rig.machine.status().state, State::Touching);
    rig
}

fn guided(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.write(0x2001, 1, &[2]);
    rig.run(20);
    assert_eq!(rig.machine.status().state, State::Guiding);
    rig
}

fn reacting(mode: u8) -> Rig {
    let mut rig = ready(mode);
    rig.machine.raise(Fault::HostSilent);
    rig.run(5);
    assert_eq!(rig.status() & 0x4F, 0x0F);
    rig
}

fn faulty(mode: u8) -> Rig {
    let mut rig = reacting(mode);
    rig.until(3000, |rig| rig.status() & 0x4F == 0x08);
    rig
}

const SITUATIONS: &[Situation] = &[
    ("switch on disabled", ALL, disabled),
    ("commissioning", ALL, commissioning),
    ("ready to switch on", ALL, ready_to_switch_on),
    ("switched on", ALL, switched_on),
    ("enabled, at rest", ALL, ready),
    ("enabled, a path waits", ALL, queued),
    ("halted", ALL, halted),
    ("quick stop active", ALL, quick_stopped),
    ("moving", &[1, 3, 7, 8, 9], moving),
    ("homing", &[6], homing),
    ("seeking", ALL, seeking),
    ("eroding", ALL, eroding),
    ("jumping", ALL, jumping),
    ("lifting", ALL, lifting),
    ("done", ALL, done),
    ("inching", ALL, inching),
    ("touching", &[0, 1, 6], touching),
    ("guided", &[1, 7, 8, 9], guided),
    ("fault reaction", ALL, reacting),
    ("fault", ALL, faulty),
];

fn mode(rig: &mut Rig, mode: u8) -> Result<(), u32> {
    rig.try_write(0x6060, 0, &[mode])
}

fn control(rig: &mut Rig, word: u16) -> Result<(), u32> {
    rig.try_write(0x6040, 0, &word.to_le_bytes())
}

fn seen(rig: &Rig, state: State) -> bool {
    rig.states.contains(&state) || rig.machine.status().state == state
}

fn drive(rig: &Rig) -> u16 {
    let status = rig.status();
    if status & 0x4F == 0x40 || status & 0x48 == 0x08 { status & 0x4F } else { status & 0x6F }
}

/// A fault is left by its reset alone.
fn faulted(rig: &Rig) -> bool {
    rig.status() & 0x48 == 0x08
}

/// Where it can only go on from a state further on.
fn stays(rig: &Rig, states: &[u16]) -> bool {
    states.contains(&drive(rig)) || faulted(rig)
}

/// It comes there within two seconds.
fn arrives(rig: &mut Rig, target: i64) -> bool {
    (0..2000).any(|_| {
        rig.step();
        (rig.position() - target).abs() <= 3
    })
}

/// Pulses are off, the coarse axis is not asked for any more, and whether it still moves only the host knows: the head waits for its word.
fn waits(rig: &Rig) -> bool {
    let status = rig.machine.status();
    status.state == State::Inching && status.inch == Inch::Late
}

fn enabled(rig: &Rig) -> bool {
    drive(rig) == 0x27
}

const REQUESTS: &[Request] = &[
    Request { name: "6060h = 0", ask: |rig| mode(rig, 0), done: |_, rig| rig.read(0x6061, 0) == 0 },
    Request { name: "6060h = 1", ask: |rig| mode(rig, 1), done: |_, rig| rig.read(0x6061, 0) == 1 },
    Request { name: "6060h = 2", ask: |rig| mode(rig, 2), done: |_, _| false },
    Request { name: "6060h = 3", ask: |rig| mode(rig, 3), done: |_, rig| rig.read(0x6061, 0) == 3 },
    Request { name: "6060h = 6", ask: |rig| mode(rig, 6), done: |_, rig| rig.read(0x6061, 0) == 6 },
    Request { name: "6060h = 7", ask: |rig| mode(rig, 7), done: |_, rig| rig.read(0x6061, 0) == 7 },
    Request { name: "6060h = 8", ask: |rig| mode(rig, 8), done: |_, rig| rig.read(0x6061, 0) == 8 },
    Request { name: "6060h = 9", ask: |rig| mode(rig, 9), done: |_, rig| rig.read(0x6061, 0) == 9 },
    Request { name: "disable voltage", ask: |rig| control(rig, 0x00), done: |_, rig| stays(rig, &[0x40]) },
    Request { name: "shutdown", ask: |rig| control(rig, 0x06), done: |_, rig| stays(rig, &[0x21, 0x07]) },
    Request { name: "switch on", ask: |rig| control(rig, 0x07), done: |_, rig| stays(rig, &[0x23, 0x40, 0x07]) },
    Request { name: "enable operation", ask: |rig| control(rig, 0x0F), done: |_, rig| stays(rig, &[0x27, 0x40]) },
    Request {
        name: "quick stop",
        ask: |rig| control(rig, 0x0B),
        done: |_, rig| stays(rig, &[0x40, 0x07]) && !rig.machine.status().state.works(),
    },
    Request {
        name: "halt",
        ask: |rig| control(rig, 0x10F),
        done: |_, rig| {
            let state = rig.machine.status().state;
            !enabled(rig) && stays(rig, &[0x40, 0x07]) || enabled(rig) && !state.works() && state != State::Positioning
        },
    },
    Request {
        name: "bit 4 rises (set point, homing start)",
        ask: |rig| {
            control(rig, 0x0F)?;
            rig.write32(0x607A, 0, 500);
            control(rig, 0x1F)
        },
        done: |before, rig| {
            let homed = rig.status() & 0x3000 == 0x1000 || seen(rig, State::Homing);
            match (rig.read(0x6061, 0), enabled(rig)) {
                (1, true) if rig.read(0x2001, 1) == 1 => rig.read(0x200E, 10) > before.appended,
                (1, true) => arrives(rig, 500),
                (6, true) => homed || rig.status() & 0x2000 != 0,
                (3, true) => rig.status() & 0x2000 == 0,
                _ => true,
            }
        },
    },
    Request {
        name: "fault reset",
        ask: |rig| control(rig, 0x80),
        done: |_, rig| stays(rig, &[0x40]) || drive(rig) == 0x0F,
    },
    Request {
        name: "2001h:1 = 0",
        ask: |rig| rig.try_write(0x2001, 1, &[0]),
        done: |_, rig| (!rig.machine.status().state.works() || waits(rig)) && rig.read(0x2001, 1) == 0,
    },
    Request {
        name: "2001h:1 = 1",
        ask: |rig| rig.try_write(0x2001, 1, &[1]),
        // A choice of what set points are; what waits is begun where something may move.
        done: |_, rig| {
            let waits = rig.machine.status().waiting > 0;
            rig.read(0x2001, 1) == 1 && (!waits || !enabled(rig) || rig.machine.status().state.works())
        },
    },
    Request {
        name: "2001h:1 = 2",
        ask: |rig| rig.try_write(0x2001, 1, &[2]),
        done: |_, rig| rig.machine.status().guidance != Guidance::No,
    },
    Request {
        name: "2001h:2 = 1 (hold)",
        ask: |rig| rig.try_write(0x2001, 2, &[1]),
        done: |_, rig| {
            let state = rig.machine.status().state;
            waits(rig) || !state.works() && !matches!(state, State::Positioning | State::Homing)
        },
    },
    Request {
        name: "2001h:3 = 1 (commissioning)",
        ask: |rig| rig.try_write(0x2001, 3, &[1]),
        done: |_, rig| seen(rig, State::Commissioning),
    },
    Request {
        name: "2001h:7 = 1 (jump)",
        ask: |rig| rig.try_write(0x2001, 7, &[1]),
        done: |_, rig| seen(rig, State::Jumping),
    },
    Request {
        name: "2011h:1 = 1 (find the surface)",
        ask: |rig| rig.try_write(0x2011, 1, &[1]),
        done: |_, rig| seen(rig, State::Touching),
    },
    Request {
        name: "60B8h (touch probe)",
        ask: |rig| rig.try_write(0x60B8, 0, &0x0011u16.to_le_bytes()),
        done: |_, rig| rig.read(0x60B9, 0) & 1 == 1,
    },
    Request {
        name: "2004h:1 (append to the path)",
        ask: |rig| rig.try_write(0x2004, 1, &4100i32.to_le_bytes()),
        done: |before, rig| rig.machine.status().waiting > 0 || rig.read(0x200E, 10) > before.appended,
    },
    Request {
        name: "2004h:3 = 1 (clear the path)",
        ask: |rig| rig.try_write(0x2004, 3, &[1]),
        done: |_, rig| rig.machine.status().waiting == 0,
    },
    Request {
        name: "607Ah",
        ask: |rig| rig.try_write(0x607A, 0, &520i32.to_le_bytes()),
        done: |_, rig| {
            let halts = rig.read(0x6040, 0) & 0x100 != 0;
            let follows = rig.read(0x6061, 0) == 8 && enabled(rig) && rig.read(0x2001, 1) != 1 && !halts;
            rig.read(0x607A, 0) == 520 && (!follows || arrives(rig, 520))
        },
    },
    Request {
        name: "60FFh",
        ask: |rig| rig.try_write(0x60FF, 0, &(-2000i32).to_le_bytes()),
        done: |before, rig| {
            let halts = rig.read(0x6040, 0) & 0x100 != 0;
            let runs = matches!(rig.read(0x6061, 0), 3 | 9) && enabled(rig) && !halts;
            let there = before.position - if rig.read(0x6061, 0) == 3 { 20 } else { 0 };
            rig.read(0x60FF, 0) as i32 == -2000 && (!runs || rig.position() < there || arrives(rig, there - 1))
        },
    },
    Request {
        name: "60B0h",
        ask: |rig| rig.try_write(0x60B0, 0, &(-30i32).to_le_bytes()),
        done: |_, rig| {
            let halts = rig.read(0x6040, 0) & 0x100 != 0;
            let follows = rig.read(0x6061, 0) == 8 && enabled(rig) && rig.read(0x2001, 1) != 1 && !halts;
            let target = i64::from(rig.read(0x607A, 0) as i32) - 30;
            rig.read(0x60B0, 0) as i32 == -30 && (!follows || arrives(rig, target))
        },
    },
    Request {
        name: "60B2h",
        ask: |rig| rig.try_write(0x60B2, 0, &(-50i16).to_le_bytes()),
        done: |_, rig| rig.read(0x60B2, 0) as i16 == -50,
    },
    Request {
        name: "2014h:4 (coarse axis)",
        ask: |rig| rig.try_write(0x2014, 4, &100i32.to_le_bytes()),
        done: |_, rig| rig.read(0x2014, 4) == 100,
    },
    Request {
        name: "2014h:5 = 1 (carried)",
        ask: |rig| rig.try_write(0x2014, 5, &[1]),
        done: |_, rig| rig.read(0x2014, 7) == 1,
    },
    Request {
        name: "2014h:5 = 2 (refused)",
        ask: |rig| rig.try_write(0x2014, 5, &[2]),
        done: |_, rig| rig.read(0x2014, 1) != 2,
    },
    Request {
        name: "60C1h:1",
        ask: |rig| rig.try_write(0x60C1, 1, &520i32.to_le_bytes()),
        done: |_, rig| {
            let waits = rig.read(0x60C4, 4) > 0 || rig.machine.status().waiting > 0;
            rig.read(0x6061, 0) != 7 || waits || (rig.position() - 520).abs() <= 3
        },
    },
    Request {
        name: "1010h (store)",
        ask: |rig| rig.try_write(0x1010, 1, b"save"),
        done: |_, rig| rig.machine.status().state == State::Disabled,
    },
    Request {
        name: "NMT pre-operational",
        ask: |rig| {
            rig.send(0, &[128, ID]);
            Ok(())
        },
        done: |_, rig| !rig.machine.status().state.follows(),
    },
    Request {
        name: "NMT stopped",
        ask: |rig| {
            rig.send(0, &[2, ID]);
            Ok(())
        },
        done: |_, rig| !rig.machine.status().state.follows(),
    },
    Request {
        name: "NMT reset communication",
        ask: |rig| {
            rig.send(0, &[130, ID]);
            Ok(())
        },
        done: |_, rig| !rig.machine.status().state.follows(),
    },
    Request {
        name: "NMT reset node",
        ask: |rig| {
            rig.send(0, &[129, ID]);
            Ok(())
        },
        done: |_, rig| !rig.machine.status().state.follows(),
    },
];

fn outcome(rig: &mut Rig) -> Outcome {
    let status = *rig.machine.status();
    Outcome {
        state: status.state,
        fault: status.fault,
        drive: drive(rig),
        mode: rig.read(0x6061, 0),
        erode: rig.read(0x2001, 1),
        target: rig.read(0x607A, 0),
        velocity: rig.read(0x60FF, 0),
    }
}

/// What the answers and bits of a drive say that its head does not do.
fn lies(rig: &mut Rig) -> Vec<String> {
    let mut lies = Vec::new();
    rig.run(2);
    let status = *rig.machine.status();
    if enabled(rig) != (status.state.follows() && drive(rig) != 0x07) {
        lies.push(format!("statusword {:#06x} while {}", rig.status(), status.state.name()));
    }
    if (rig.read(0x2001, 1) == 2) != (status.guidance != Guidance::No) {
        lies.push(format!("2001h:1 is {} while {:?}", rig.read(0x2001, 1), status.guidance));
    }
    let guidance = rig.read(0x2000, 8);
    if guidance != rig.machine.status().guidance as u32 && status.state == rig.machine.status().state {
        lies.push(format!("2000h:8 is {guidance} while {:?}", rig.machine.status().guidance));
    }
    // Who says that it follows does.
    if rig.read(0x6061, 0) == 8 && enabled(rig) && rig.status() & 0x1000 != 0 {
        rig.write(0x60C2, 1, &[1]);
        rig.write(0x60C2, 2, &[-3i8 as u8]);
        let there = rig.position() as i32 - 4;
        let offset = rig.read(0x60B0, 0) as i32;
        match rig.try_write(0x607A, 0, &(there - offset).to_le_bytes()) {
            Ok(()) => {
                rig.run(60);
                if (rig.position() as i32 - there).abs() > 3 {
                    lies.push(format!("bit 12, and {} is not {there}", rig.position()));
                }
            }
            Err(abort) => lies.push(format!("bit 12, and 607Ah is aborted with {abort:#x}")),
        }
    }
    lies
}

fn cell(answer: Result<(), u32>, refused: Option<u32>, before: &Outcome, after: &Outcome) -> String {
    match (answer, refused) {
        (Err(0x0800_0022), _) => "aborted".to_string(),
        (Err(code), _) => format!("aborted {code:08X}h"),
        (Ok(()), Some(code)) => format!("refused {code}"),
        (Ok(()), None) if after.drive == before.drive && after.state == before.state => "ok".to_string(),
        (Ok(()), None) => match (after.drive, after.fault) {
            (_, Some(fault)) => format!("fault {}", fault.name()),
            (0x40, _) => "switch on disabled".to_string(),
            (0x21, _) => "ready to switch on".to_string(),
            (0x23, _) => "switched on".to_string(),
            (0x07, _) => "quick stop active".to_string(),
            _ => after.state.name().replace('_', " "),
        },
    }
}

/// A run of every case of a situation: its cells, by request and mode, and what is wrong.
fn run((name, modes, begin): &Situation) -> (Vec<Vec<String>>, Vec<String>) {
    let mut wrong = Vec::new();
    let mut cells = vec![Vec::new(); REQUESTS.len()];
    for mode in *modes {
        // What comes of it when nobody asks for anything.
        let mut left_alone = begin(*mode);
        let start = outcome(&mut left_alone);
        left_alone.run(400);
        let undisturbed = outcome(&mut left_alone);
        for (request, cells) in REQUESTS.iter().zip(&mut cells) {
            let mut rig = begin(*mode);
            let case = format!("{name}, mode {mode}, {}", request.name);
            let before = Before { position: rig.position(), appended: rig.read(0x200E, 10) };
            let refusals = rig.read(0x2000, 7);
            rig.states.clear();
            rig.sent.clear();
            let answer = (request.ask)(&mut rig);
            rig.run(400);
            // Whoever is stopped or reset answers again.
            rig.send(0, &[1, ID]);
            rig.run(2);
            let refused = (rig.read(0x2000, 7) != refusals).then(|| rig.read(0x2000, 4));
            let after = outcome(&mut rig);
            match (answer, refused) {
                (Ok(()), None) if !(request.done)(&before, &mut rig) => {
                    wrong.push(format!("{case}: ok, and not done: {after:?}"));
                }
                (Ok(()), Some(_)) => {
                    let told = rig.sent.iter().any(|(_, frame)| {
                        frame.id() == 0x180 + u16::from(ID)
                            && frame.data().get(4).is_some_and(|n| u32::from(*n) != refusals)
                    });
                    if !told {
                        wrong.push(format!("{case}: refused, and TPDO 1 does not tell"));
                    }
                }
                (Err(_), _)
                    if (after.mode, after.erode, after.target)
                        != (undisturbed.mode, undisturbed.erode, undisturbed.target)
                        || after.drive != undisturbed.drive
                        || after.state.works() != undisturbed.state.works() =>
                {
                    wrong.push(format!("{case}: aborted, and {after:?} instead of {undisturbed:?}"));
                }
                _ => {}
            }
            wrong.extend(lies(&mut rig).into_iter().map(|lie| format!("{case}: {lie}")));
            cells.push(cell(answer, refused, &start, &after));
        }
    }
    (cells, wrong)
}

/// One text where all modes agree.
fn merged(modes: &[u8], cells: &[String]) -> String {
    let mut by_text: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for (mode, cell) in modes.iter().zip(cells) {
        by_text.entry(cell).or_default().push(mode.to_string());
    }
    match by_text.len() {
        1 => cells[0].clone(),
        _ => by_text.iter().map(|(text, modes)| format!("{}: {text}", modes.join(", "))).collect::<Vec<_>>().join("; "),
    }
}

#[test]
fn whatever_is_asked_in_whatever_state_is_done_or_told() {
    let runs: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = SITUATIONS.iter().map(|situation| scope.spawn(|| run(situation))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    let wrong: Vec<_> = runs.iter().flat_map(|(_, wrong)| wrong).collect();
    assert!(wrong.is_empty(), "{} cases: {wrong:#?}", wrong.len());
    let mut page = String::from(HEAD);
    let (mut rows, mut cases) = (Vec::new(), 0);
    for (n, request) in REQUESTS.iter().enumerate() {
        let mut row = format!("| {} |", request.name);
        for ((_, modes, _), (cells, _)) in SITUATIONS.iter().zip(&runs) {
            cases += modes.len();
            write!(row, " {} |", merged(modes, &cells[n])).unwrap();
        }
        rows.push(row);
    }
    writeln!(page, "{cases} cases.\n").unwrap();
    let names: Vec<_> = SITUATIONS.iter().map(|(name, ..)| *name).collect();
    writeln!(page, "| request | {} |\n|{}", names.join(" | "), " --- |".repeat(names.len() + 1)).unwrap();
    writeln!(page, "{}", rows.join("\n")).unwrap();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/requests.md");
    if std::env::var_os("EDM_WRITE_DOCS").is_some() {
        std::fs::write(path, page).unwrap();
    } else {
        assert!(std::fs::read_to_string(path).unwrap() == page, "docs/requests.md is not what is done: write it anew");
    }
}

const HEAD: &str = "\
# What a request does, in every state and mode

tests/canopen_device/requests.rs writes this page. It sends every request to a head on the process model, in every state and mode, and
checks the answer: *ok* is carried out, *aborted* changes nothing, and no status bit contradicts it. A cell shows the result after 0.4 s:

| cell | meaning |
| --- | --- |
| ok | carried out, or stored as a value, without a change of state |
| aborted | SDO abort 0800 0022h, or the code shown |
| refused | 2000h:4 has this number; TPDO 1 reports it |
| a state | the state that the request leads to |
| 1, 3: ... | result in these modes of operation (6061h), where modes differ |

6007h is 1.

";

#[test]
fn a_jump_for_which_there_is_no_room_is_a_reason_and_a_warning() {
    let mut rig = eroding(7);
    assert_eq!(rig.status() & 1 << 7, 0);
    for (sub, value) in [(2, 3000.0f32), (1, 300.0)] {
        rig.write(0x210E, sub, &value.to_le_bytes());
    }
    rig.until(3000, |rig| rig.machine.status().state == State::Jumping);
    rig.run(2);
    assert_eq!((rig.read(0x2000, 3), rig.status() & 1 << 7), (28, 1 << 7));
}

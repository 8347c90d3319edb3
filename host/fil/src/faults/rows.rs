//! Every fault of the campaign, with what is expected of the head.
//!
//! Expected times come from what finds the fault: contacts stop within the window of 50 us in which the bench opens them and
//! the next; what the live signal finds is off when the monostable has expired, in 0.4 ms; the supervision judges once a
//! millisecond, by the times of its settings.

use super::case::{Case, Expect};
use super::stage::{MS, PATH, Scene, Stage};
use super::{chip, constants};
use crate::host::{self, HOST, NODE};
use crate::wires::*;
use anyhow::Result;
use edm_hal_shim::double::live::Broken;
use edm_hal_shim::safety::SafetyInputs;
use edm_servo_head::head::{Command, State};
use edm_sim::process::FaultInputs;
use edm_soc::{CanReply, Frame, Pin};

use Expect::{Doubted, Harmless, Named, Obeyed};
use Scene::{Disabled, Eroding, Positioning};

/// Pulses off at once, by contact or break: the window of the event and the next, us.
const CONTACT_US: f64 = 110.0;
/// The live signal: the monostable of 0.4 ms, and up to a millisecond until a task counts as silent.
pub const LIVE_US: f64 = 1_600.0;
/// Monitored by the supervision within a few milliseconds: its own period, limits of 10 ms.
pub const JUDGED_US: f64 = 15_000.0;
/// The same of a hand with 30 N against the 22 N that the motor has: 7 ms until it has the head `supervise.following_um` away.
const HAND_US: f64 = JUDGED_US + 7_000.0;
/// `supervise.gap_ms`, and what its average takes.
const GAP_US: f64 = 45_000.0;
/// Nine of ten looks at pulses find an arc, and 120 of 200 are too many for 50 ms: 134 + 50 ms, and chance; 314 ms where the looks
/// fall in step with the pulses, and half of them find one.
const ARC_US: f64 = 350_000.0;
/// A host is silent after the 400 ms of its 1016h.
const HOST_US: f64 = 520_000.0;
/// An encoder that stands is found when the head has to move: at the pace of erosion that takes a while.
pub const STANDS_US: f64 = 1_000_000.0;
/// A short that backing off does not clear: two retreats along the path.
const SHORT_US: f64 = 3_000_000.0;
/// Pulses go on.
pub const ON: f64 = f64::INFINITY;

/// A seek measures the open-circuit voltage before it feeds.
const SEEK_US: f64 = 200_000.0;

/// What is said of an encoder, whichever supervision finds it first: the lift is the same.
pub const ENCODER: &[&str] = &["encoder lost", "following error"];
/// What is said of a gap signal that is not one.
const SIGNAL: &[&str] = &["gap signal invalid", "gate missing"];
const REFLEX: &[&str] = &["reflex lost"];
const LIVE: &[&str] = &["live signal lost"];

/// Every case, in the order of the page.
pub fn all() -> Vec<Case> {
    let mut cases = Vec::new();
    table(&mut cases);
    pins(&mut cases);
    chip::stopped(&mut cases);
    chip::silent(&mut cases);
    chip::clocks(&mut cases);
    chip::deaths(&mut cases);
    bus(&mut cases);
    chip::stored(&mut cases);
    chip::flips(&mut cases);
    constants::wrong(&mut cases);
    cases
}

/// Changes the wires of the machine.
fn wired(change: impl Fn(&mut FaultInputs) + 'static) -> impl Fn(&mut Stage) -> Result<()> {
    move |stage| {
        change(stage.wires());
        Ok(())
    }
}

fn contact(change: impl Fn(&mut SafetyInputs) + 'static) -> impl Fn(&mut Stage) -> Result<()> {
    wired(move |wires| change(&mut wires.safety))
}

/// Breaks the circuit of the live signal.
fn circuit(broken: Broken) -> impl Fn(&mut Stage) -> Result<()> {
    move |stage| {
        stage.rig.machine_mut().soc().world.latch.circuit.broken = broken;
        Ok(())
    }
}

/// Disables the head and enables it again, which tries the circuit of the live signal.
fn anew(stage: &mut Stage) -> Result<()> {
    for word in [0, 6, 7, 0xF] {
        host::write(stage, 0x6040, 0, word, 2)?;
        stage.rest(10)?;
    }
    Ok(())
}

/// Every row of the fault table, from what causes it. Plan late, live signal and clock
/// are further down.
fn table(cases: &mut Vec<Case>) {
    let mut add = |case: Case| cases.push(case);
    add(Case::new("wire across the gap", Eroding, Named(&["persistent short"], SHORT_US), wired(|w| w.short = true))
        .watched(3500));
    add(Case::new(
        "converter of the gap voltage at its end",
        Eroding,
        Named(SIGNAL, GAP_US),
        wired(|w| w.stuck_code = Some(4095)),
    ));
    // 30 V the wrong way: 300 codes of 0.1 V below the code of no voltage.
    add(Case::new(
        "gap leads swapped",
        Eroding,
        Named(&["gap leads swapped"], GAP_US),
        wired(|w| w.stuck_code = Some(110)),
    ));
    // 50 V, where the head expects 70 V at least; counted from the start, so that it includes the way of the seek until it is measured.
    add(Case::new("generator of 50 V", Disabled, Named(&["open-circuit voltage low"], SEEK_US), |stage| {
        stage.wires().stuck_code = Some(410 + 500);
        for command in [Command::Enable, Command::MoveTo(PATH), Command::Start] {
            stage.command(command)?;
        }
        stage.mark();
        Ok(())
    }));
    add(Case::new("pulses that arc", Eroding, Named(&["persistent arc"], ARC_US), wired(|w| w.arcs = 0.9)));
    add(Case::new(
        "generator without pulses",
        Eroding,
        Named(&["gate missing"], GAP_US),
        wired(|w| w.generator_dead = true),
    )
    .short());
    add(Case::new("wire of the gate cut", Eroding, Named(&["gate missing"], GAP_US), wired(|w| w.gate_lost = true)));
    add(Case::new(
        "dielectric contact open",
        Eroding,
        Named(&["dielectric not OK"], CONTACT_US),
        contact(|s| s.dielectric = true),
    ));
    add(Case::new("host silent", Eroding, Named(&["host silent"], HOST_US), |stage| {
        stage.rig.host_alive = false;
        Ok(())
    })
    .short());
    for scene in [Eroding, Positioning] {
        add(Case::new(
            "lower limit open",
            scene,
            Named(&["lower limit"], CONTACT_US),
            contact(|s| s.lower_limit = true),
        ));
        add(Case::new(
            "upper limit open",
            scene,
            Named(&["upper limit"], CONTACT_US),
            contact(|s| s.upper_limit = true),
        ));
        let both = contact(|s| (s.upper_limit, s.lower_limit) = (true, true));
        add(Case::new("both limits open", scene, Named(&["both limits open"], CONTACT_US), both));
        add(Case::new(
            "emergency stop",
            scene,
            Named(&["emergency stop"], CONTACT_US),
            contact(|s| s.emergency_stop = true),
        ));
        add(Case::new("bridge fault", scene, Named(&["bridge fault"], CONTACT_US), contact(|s| s.bridge_fault = true)));
        add(Case::new(
            "a hand lifts the head with 30 N for 100 ms",
            scene,
            Named(&["following error"], HAND_US),
            wired(|w| w.hand_n = -30.0),
        )
        .meanwhile(|stage| {
            if stage.since_ms() >= 100 {
                stage.wires().hand_n = 0.0;
            }
            Ok(())
        }));
        add(Case::new("encoder cut", scene, Named(ENCODER, STANDS_US), wired(|w| w.encoder_dead = true)));
        add(Case::new(
            "bus voltage 30 V",
            scene,
            Named(&["bus voltage sag"], JUDGED_US),
            wired(|w| w.bus_v = Some(30.0)),
        ));
        add(Case::new(
            "bus voltage 10 V",
            scene,
            Named(&["bus voltage sag"], JUDGED_US),
            wired(|w| w.bus_v = Some(10.0)),
        ));
        for (name, amperes) in
            [("motor current 4 A toward the work", 4.0), ("motor current 4 A away from the work", -4.0)]
        {
            let code = (2048.0 + amperes / 0.00269) as u16;
            let inject = move |stage: &mut Stage| converter(stage, (3, MOTOR_CURRENT), code);
            add(Case::new(name, scene, Named(&["over-current"], JUDGED_US), inject));
        }
    }
    let disobeys = wired(|w| w.disobeys = true);
    add(Case::new("generator does not obey", Positioning, Named(&["pulses without permission"], ON), disobeys));
    add(Case::new("work 1.5 mm nearer", Positioning, Named(&["contact"], ON), wired(|w| w.raised_mm = -1.7)));
    // Swapped when it was serviced: the first motion would go the wrong way, but for the upper stop.
    let names = &["following error", "encoder lost", "polarity wrong"];
    add(Case::new("motor leads swapped", Disabled, Named(names, ON), |stage| {
        stage.rig.machine_mut().soc().world.swapped = true;
        // It does not get there.
        let _ = stage.position();
        Ok(())
    }));
    // A runaway shows as a following error before, unless that is allowed, and there is room for it: no work in reach.
    add(Case::new(
        "runaway over no work, any following error allowed",
        Disabled,
        Named(&["polarity wrong"], ON),
        |stage| {
            host::write(stage, 0x210A, 1, 100_000f32.to_bits(), 4)?;
            // Soon, or it rests at its lower stop, where the switch keeps the fault.
            host::write(stage, 0x210A, 2, 1, 4)?;
            stage.position()?;
            stage.wires().raised_mm = -20.0;
            stage.rig.machine_mut().soc().world.swapped = true;
            stage.mark();
            Ok(())
        },
    ));
    for (name, broken) in circuits() {
        let lost = broken.live
            || broken.monostable == Some(false)
            || broken.latch == Some(false)
            || broken.read == Some(false);
        let expect =
            if lost { Named(LIVE, LIVE_US) } else { Harmless(Some((Box::new(anew), &["live circuit stuck"], ON))) };
        if !broken.arm {
            add(Case::new(name, Eroding, expect, circuit(broken)));
        }
        let names: &[&str] = if lost || broken.arm { LIVE } else { &["live circuit stuck"] };
        add(Case::new(name, Disabled, Named(names, ON), move |stage| {
            circuit(broken)(stage)?;
            stage.power();
            Ok(())
        })
        .powered());
    }
}

/// What may be wrong with the circuit of the live signal.
fn circuits() -> [(&'static str, Broken); 8] {
    let sound = Broken::default();
    [
        ("line of the live signal stuck", Broken { live: true, ..sound }),
        ("line that arms the latch stuck", Broken { arm: true, ..sound }),
        ("monostable at rest", Broken { monostable: Some(false), ..sound }),
        ("monostable running for ever", Broken { monostable: Some(true), ..sound }),
        ("latch off", Broken { latch: Some(false), ..sound }),
        ("latch on", Broken { latch: Some(true), ..sound }),
        ("latch read as off", Broken { read: Some(false), ..sound }),
        ("latch read as on", Broken { read: Some(true), ..sound }),
    ]
}

/// Holds what a converter gives.
fn converter(stage: &mut Stage, channel: (u8, u8), code: u16) -> Result<()> {
    stage.rig.machine_mut().soc().world.codes.push((channel, code));
    Ok(())
}

/// How a line is broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Line {
    Low,
    High,
    /// A digital line then has the level of the pull at the chip, if there is one, and reads low without; a converter keeps the
    /// charge of its last conversion.
    Open,
}

const LINES: [(Line, &str); 3] = [(Line::Low, "stuck low"), (Line::High, "stuck high"), (Line::Open, "open")];

/// What is expected of a digital line at a level, low or high.
type Levels = fn(bool) -> Expect;

/// Every input that the firmware reads, by signal of the board's table. Reserved inputs are not configured.
fn pins(cases: &mut Vec<Case>) {
    let encoder: Levels = |_| Named(ENCODER, STANDS_US);
    // At the level of a sound machine it is as if nothing ever opened.
    macro_rules! contact {
        ($name:literal) => {
            (|high| if high { Named(&[$name], CONTACT_US) } else { Harmless(None) }) as Levels
        };
    }
    let digital: [(&str, Pin, Option<bool>, Levels); 13] = [
        ("encoder A", ENCODER_PINS[0], None, encoder),
        ("encoder B", ENCODER_PINS[1], None, encoder),
        ("encoder index", ENCODER_PINS[2], None, |high| {
            // Two marks, the second where none should be if the axis has moved between.
            if high { Doubted(ENCODER) } else { Harmless(None) }
        }),
        ("gate", GATE[0], None, |_| Named(SIGNAL, GAP_US)),
        ("gate at the blanking timer", GATE[1], None, |_| Named(REFLEX, GAP_US)),
        // For the log alone: the head goes on, and tells.
        ("high comparator", COMPARATORS[0], None, |_| Named(&["200Dh:5 high comparator"], ON)),
        ("low comparator", COMPARATORS[1], None, |_| Named(&["200Dh:6 low comparator"], ON)),
        ("upper limit", CONTACTS[0], Some(true), contact!("upper limit")),
        ("lower limit", CONTACTS[1], Some(true), contact!("lower limit")),
        ("emergency stop", CONTACTS[2], Some(true), contact!("emergency stop")),
        ("dielectric", CONTACTS[3], Some(true), contact!("dielectric not OK")),
        ("bridge fault", BRIDGE_FAULT, Some(false), |high| {
            if high { Harmless(None) } else { Named(&["bridge fault"], CONTACT_US) }
        }),
        ("latch read back", ARMED, Some(false), |high| {
            if high { Harmless(Some((Box::new(anew), &["live circuit stuck"], ON))) } else { Named(LIVE, LIVE_US) }
        }),
    ];
    for (name, pin, pull, levels) in digital {
        for (line, how) in LINES {
            let level = match line {
                Line::Low => Some(false),
                Line::High => Some(true),
                Line::Open => pull,
            };
            let inject = move |stage: &mut Stage| {
                stage.rig.machine_mut().soc().world.stick(pin, level);
                Ok(())
            };
            let title = format!("pin {name} {how}");
            // A mark is a mark where the head moves on.
            let scenes: &[Scene] = match ENCODER_PINS.iter().position(|of| *of == pin) {
                Some(2) => &[Positioning],
                Some(_) => &[Eroding, Positioning],
                None => &[Eroding],
            };
            for scene in scenes {
                cases.push(Case::new(&title, *scene, levels(level == Some(true)), inject));
            }
        }
    }
    type Codes = fn(Line) -> Expect;
    let analogue: [(&str, (u8, u8), Codes); 5] = [
        ("gap voltage", (1, GAP), |line| match line {
            // What it keeps may be the voltage of a short.
            Line::Open => Named(&["gap signal invalid", "contact", "persistent short", "reflex lost"], STANDS_US),
            _ => Named(&["gap signal invalid", "contact"], GAP_US),
        }),
        ("gap voltage in the pulse", (2, GATED), |_| Named(REFLEX, STANDS_US)),
        ("gap current", (2, GAP_CURRENT), |_| Named(REFLEX, STANDS_US)),
        ("motor current", (3, MOTOR_CURRENT), |line| match line {
            // Whichever of the two shows first: the current does not follow the duty, nor the back-EMF the encoder.
            Line::Open => Named(&["drive signal lost", "encoder lost", "following error"], ON),
            _ => Named(&["over-current"], JUDGED_US),
        }),
        ("bus voltage", (3, BUS_VOLTAGE), |line| match line {
            Line::Low => Named(&["bus voltage sag"], JUDGED_US),
            Line::High => Named(&["drive signal lost"], JUDGED_US),
            Line::Open => Harmless(None),
        }),
    ];
    for (name, (adc, channel), expect) in analogue {
        for (line, how) in LINES {
            for scene in [Eroding, Positioning] {
                if adc == 2 && scene == Positioning {
                    continue;
                }
                let inject = move |stage: &mut Stage| {
                    let now = stage.now();
                    let code = match line {
                        Line::Low => 0,
                        Line::High => 4095,
                        Line::Open => stage.rig.machine_mut().soc().world.code(adc, channel, now),
                    };
                    converter(stage, (adc, channel), code)
                };
                cases.push(Case::new(format!("pin {name} {how}"), scene, expect(line), inject));
            }
        }
    }
    for (_, how) in LINES {
        let names = &["host silent", "2000h:2 host silent", "bus-off"];
        cases.push(Case::new(format!("pin CAN receive {how}"), Eroding, Named(names, HOST_US), |stage| {
            stage.rig.machine_mut().soc().world.deaf = true;
            Ok(())
        }));
    }
}

/// Encoder lines A, B and index.
const ENCODER_PINS: [Pin; 3] = crate::wires::ENCODER;

/// Frames that the head listens to, of this length on the wire: controlword and set points as they are, a request, SYNC, NMT,
/// a heartbeat.
fn of_length(length: u8) -> Vec<Frame> {
    let frames: [(u16, &[u8]); 7] = [
        (0x200 + NODE, &[0xF]),
        (0x300 + NODE, &[]),
        (0x400 + NODE, &[]),
        (0x600 + NODE, &[0x40, 0, 0x10]),
        (0x080, &[]),
        (0x000, &[1, NODE as u8]),
        (0x700 + HOST, &[5]),
    ];
    frames.into_iter().map(|(id, data)| Frame { length, ..Frame::new(id, data) }).collect()
}

/// Frames in a millisecond that fill a bus of 1 Mbit/s.
const FULL: usize = 7;

fn bus(cases: &mut Vec<Case>) {
    for length in 0..=15 {
        let names: &[&str] = if length < 4 { &["PDO too short"] } else { &["PDO too long"] };
        let case = Case::new(format!("frames of length {length}"), Eroding, Named(names, ON), move |stage| {
            for frame in of_length(length) {
                stage.rig.send_at(0, frame);
            }
            Ok(())
        });
        cases.push(case.watched(300));
    }
    for (name, reply) in
        [("bus shorted: bit errors", CanReply::BitError), ("bus cut: nobody acknowledges", CanReply::NoAcknowledge)]
    {
        cases.push(Case::new(name, Eroding, Named(&["host silent", "2000h:2 host silent"], HOST_US), move |stage| {
            stage.rig.host_alive = false;
            stage.rig.machine_mut().soc().world.reply = reply;
            Ok(())
        }));
    }
    let babble = |id: u16, data: &'static [u8]| {
        move |stage: &mut Stage| {
            for _ in 0..FULL {
                stage.rig.send_at(0, Frame::new(id, data));
            }
            Ok(())
        }
    };
    let silent = |stage: &mut Stage| {
        stage.rig.host_alive = false;
        Ok(())
    };
    let fine = |_: &mut Stage| Ok(());
    cases.push(
        Case::new("babbling neighbour above everybody", Eroding, Named(&["host silent"], HOST_US), silent)
            .meanwhile(babble(0x001, &[0xAA; 8])),
    );
    cases.push(
        Case::new("babbling neighbour with a foreign identifier", Eroding, Harmless(None), fine)
            .meanwhile(babble(0x7FF, &[0xAA; 8])),
    );
    cases.push(
        Case::new("babbling neighbour with SYNC", Eroding, Named(&["SYNC of a wrong length", "frames lost"], ON), fine)
            .meanwhile(babble(0x080, &[0; 8])),
    );
    cases.push(
        Case::new("babbling neighbour with set points", Eroding, Named(&["PDO too long"], ON), fine)
            .meanwhile(babble(0x301, &[0; 8])),
    );
    // A second master.
    cases.push(Case::new("two masters: the other disables", Eroding, Obeyed(&[State::Disabled], 5_000.0), |stage| {
        stage.rig.send_at(0, Frame::new(0x200 + NODE, &[0, 0]));
        Ok(())
    }));
    cases.push(Case::new("two masters: the other asks all the time", Eroding, Harmless(None), fine).meanwhile(
        |stage| {
            stage.rig.send_at(0, Frame::new(0x600 + NODE, &[0x40, 0x41, 0x60, 0, 0, 0, 0, 0]));
            Ok(())
        },
    ));
    cases.push(Case::new("two masters: the other widens the supervision", Eroding, Harmless(None), |stage| {
        // 2107h:7, the lowest bus voltage, to 3 V.
        let [a, b, c, d] = 3f32.to_le_bytes();
        stage.rig.send_at(0, Frame::new(0x600 + NODE, &[0x23, 0x07, 0x21, 7, a, b, c, d]));
        Ok(())
    }));
    cases.push(Case::new(
        "two masters: the other stops the node",
        Eroding,
        Named(&["host silent", "log: host silent"], HOST_US),
        |stage| {
            stage.rig.send_at(0, Frame::new(0, &[2, NODE as u8]));
            Ok(())
        },
    ));
    cases.push(Case::new("two masters: the other resets the node", Eroding, Named(&["boot-up"], HOST_US), |stage| {
        stage.rig.send_at(0, Frame::new(0, &[0x81, NODE as u8]));
        Ok(())
    }));
    // Whose turn it is at the end decides.
    const EITHER: &[State] = &[State::Ready, State::Positioning];
    cases.push(Case::new("two masters: set points of both in turn", Positioning, Obeyed(EITHER, 0.0), fine).meanwhile(
        |stage| {
            for target in [4000i32, 200] {
                stage.rig.send_at(0, Frame::new(0x300 + NODE, &target.to_le_bytes()));
                stage.rig.send_at(0, Frame::new(0x200 + NODE, &[0x2F, 0]));
                stage.rig.send_at(0, Frame::new(0x200 + NODE, &[0x3F, 0]));
            }
            Ok(())
        },
    ));
}

/// The core stands for two milliseconds.
pub fn halt(stage: &mut Stage) -> Result<()> {
    let now = stage.now();
    stage.rig.machine_mut().halt_until(now + 2 * MS);
    Ok(())
}

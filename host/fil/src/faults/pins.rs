//! Faults of the pins: each input of the firmware stuck or open.

use super::case::{Case, Expect, WATCHED_MS};
use super::limits::{
    CONTACT_US, ENCODER, GAP_US, HOST_US, LIVE, LIVE_US, ON, REFLEX, SIGNAL, STANDS_US, SUPERVISED_US,
};
use super::rows::{anew, converter};
use super::stage::{Scene, Stage};
use crate::host;
use crate::wires::*;
use edm_sim::process::steps::Move;
use edm_soc::Pin;
use std::cell::Cell;

use Expect::{Doubted, Harmless, Named};
use Scene::{Eroding, Positioning};

/// Encoder lines A, B and index.
const ENCODER_PINS: [Pin; 3] = crate::wires::ENCODER;

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
pub fn pins(cases: &mut Vec<Case>) {
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
        // For the log alone: the head continues, and reports.
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
            _ => Named(&["over-current"], SUPERVISED_US),
        }),
        ("bus voltage", (3, BUS_VOLTAGE), |line| match line {
            Line::Low => Named(&["bus voltage sag"], SUPERVISED_US),
            Line::High => Named(&["drive signal lost"], SUPERVISED_US),
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
    steps(cases);
    for (_, how) in LINES {
        let names = &["host silent", "2000h:2 host silent", "bus-off"];
        cases.push(Case::new(format!("pin CAN receive {how}"), Eroding, Named(names, HOST_US), |stage| {
            stage.rig.machine_mut().soc().world.deaf = true;
            Ok(())
        }));
    }
}

/// A host that sends steps faster than the axis may go, until it gives up the mode that follows them.
fn steps(cases: &mut Vec<Case>) {
    const MODE: u16 = 0x6060;
    const FOLLOWS: u32 = 0xFF;
    let inject = |stage: &mut Stage| {
        host::write(stage, MODE, 0, FOLLOWS, 1)?;
        stage.rest(20)?;
        stage.rig.process_mut().steps.send(Move::Steps(100_000, 400_000.0));
        Ok(())
    };
    let left = Cell::new(WATCHED_MS / 2);
    let case = Case::new("steps at 400 kHz", Positioning, Named(&["steps not followed"], ON), inject);
    cases.push(case.meanwhile(move |stage| {
        left.set(left.get().saturating_sub(1));
        if left.get() == 1 { host::write(stage, MODE, 0, 0, 1) } else { Ok(()) }
    }));
}

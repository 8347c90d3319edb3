//! Faults of the chip itself: peripherals, tasks, clocks, program ends, memories.

use super::case::{Case, Expect};
use super::limits::{LIVE_US, ON, STANDS_US, SUPERVISED_US};
use super::stage::{MS, Scene, Stage, US};
use crate::commission::{BASE, LENGTH};
use crate::host;
use anyhow::{Context, Result, ensure};
use edm_hal_shim::board::{FAST, RAM_END, STACK};
use edm_hal_shim::seal::PROGRAM;
use edm_soc::{Exception, TICK_HZ};

use Expect::{Harmless, Named};
use Scene::{Disabled, Eroding};

/// The same with a stopped processor: the monostable alone, nominally 400 us.
const MONOSTABLE_US: f64 = 460.0;
/// The supervision is missed later: it may be late by milliseconds.
const SUPERVISION_US: f64 = 6_000.0;
/// Every register that is written once has been checked: a change after its check is found in the next round.
const REGISTER_US: f64 = 180_000.0;
/// Code in RAM is compared within 0.52 s (hal-shim/src/stm32f4/fast.rs).
const COMPARED_US: f64 = 560_000.0;

/// A task that does not come any more: it is missed by its own watchdog at last, and by the live signal first.
const SILENT: &[&str] = &["live signal lost", "log: task silent", "2009h:1 reset by the program", "2009h:1 watchdog"];
/// What is said of a peripheral or an interrupt that was switched off, if nothing that it was there for is missed before. One
/// that sends no frames any more has only the log.
const CHANGED: &[&str] = &[
    "settings damaged",
    "log: settings damaged",
    "encoder lost",
    "following error",
    "gap signal invalid",
    "gate missing",
    "reflex lost",
];

/// Registers (RM0090 2.3 and the register maps).
const TIM1: u32 = 0x4001_0000;
const TIM3: u32 = 0x4000_0400;
const TIM4: u32 = 0x4000_0800;
const TIM5: u32 = 0x4000_0c00;
const TIM7: u32 = 0x4000_1400;
const TIM8: u32 = 0x4001_0400;
const SMCR: u32 = 0x08;
const ADC_CR2: [u32; 3] = [0x4001_2008, 0x4001_2108, 0x4001_2208];
const EXTI_IMR: u32 = 0x4001_3c00;
const CAN_MCR: u32 = 0x4000_6400;
const DAC_CR: u32 = 0x4000_7400;
const ICER: u32 = 0xe000_e180;
const DEMCR: u32 = 0xe000_edfc;
const DWT_CTRL: u32 = 0xe000_1000;

fn stream(n: u32) -> u32 {
    0x4002_6410 + 0x18 * n
}

/// Clears bits of a register.
fn cleared(register: u32, bits: u32) -> impl Fn(&mut Stage) -> Result<()> {
    move |stage| {
        let soc = stage.rig.machine_mut().soc();
        let value = soc.read(register, 4)?;
        Ok(soc.write(register, 4, value & !bits)?)
    }
}

/// The core is halted for two milliseconds.
fn halt(stage: &mut Stage) -> Result<()> {
    let now = stage.now();
    stage.rig.machine_mut().halt_until(now + 2 * MS);
    Ok(())
}

/// Peripherals that stop.
pub fn stopped(cases: &mut Vec<Case>) {
    let mut add = |name: &str, expect, register, bits| {
        cases.push(Case::new(format!("{name} stopped"), Eroding, expect, cleared(register, bits)).powered());
    };
    add("TIM1, servo tick and PWM,", Named(SILENT, LIVE_US), TIM1, 1);
    add("TIM3, trigger of the gap conversions,", Named(SILENT, LIVE_US), TIM3, 1);
    add("TIM4, blanking,", Named(CHANGED, REGISTER_US), TIM4 + SMCR, 7);
    add("TIM5, encoder timer,", Named(CHANGED, REGISTER_US), TIM5, 1);
    add("TIM7, supervision,", Named(SILENT, SUPERVISION_US), TIM7, 1);
    add("TIM8, edge stamps,", Named(CHANGED, REGISTER_US), TIM8, 1);
    add("ADC1, gap voltage,", Named(SILENT, LIVE_US), ADC_CR2[0], 1);
    add("ADC2, voltage and current in the pulse,", Named(CHANGED, REGISTER_US), ADC_CR2[1], 1);
    // The servo tick starts it, and switches it on, each time.
    add("ADC3 for a tick, motor current and bus voltage,", Harmless(None), ADC_CR2[2], 1);
    add("DMA2 stream 0, gap voltage,", Named(SILENT, LIVE_US), stream(0), 1);
    add("DMA2 stream 2, edges of the gate,", Named(CHANGED, REGISTER_US), stream(2), 1);
    add("DMA2 stream 3, voltage and current in the pulse,", Named(CHANGED, REGISTER_US), stream(3), 1);
    add("DMA2 stream 4, high comparator,", Named(CHANGED, REGISTER_US), stream(4), 1);
    add("DMA2 stream 7, low comparator,", Named(CHANGED, REGISTER_US), stream(7), 1);
    add("EXTI, edges of encoder and contacts,", Named(CHANGED, REGISTER_US), EXTI_IMR, u32::MAX);
    add("DAC, off-time,", Named(CHANGED, REGISTER_US), DAC_CR, 1);
    cases.push(
        Case::new("CAN1 stopped", Eroding, Named(&["log: host silent", "2000h:2 host silent"], 520_000.0), |stage| {
            let soc = stage.rig.machine_mut().soc();
            let value = soc.read(CAN_MCR, 4)?;
            Ok(soc.write(CAN_MCR, 4, value | 1)?)
        })
        .powered(),
    );
    cases.push(
        Case::new(
            "ADC3, motor current and bus voltage, stopped",
            Eroding,
            Named(&["drive signal lost"], SUPERVISED_US),
            |stage| {
                stage.rig.machine_mut().soc().stop_converter(3);
                Ok(())
            },
        )
        .powered(),
    );
    let proof = Some((Box::new(halt) as super::case::Act, &["live signal lost"] as &[&str], 3_000.0));
    cases.push(
        Case::new("IWDG stopped", Eroding, Harmless(proof), |stage| {
            stage.rig.machine_mut().soc().stop_watchdog();
            Ok(())
        })
        .powered(),
    );
}

/// Tasks and their interrupts (RM0090 table 62), and what is expected when that does not come any more.
fn tasks() -> [(&'static str, u32, Expect); 14] {
    [
        ("reflex", 18, Named(CHANGED, REGISTER_US)),
        ("stop", 40, Named(CHANGED, REGISTER_US)),
        ("bridge_fault", 24, Named(CHANGED, REGISTER_US)),
        ("encoder_a", 6, Named(CHANGED, REGISTER_US)),
        ("encoder_b", 7, Named(CHANGED, REGISTER_US)),
        ("encoder_index", 8, Named(CHANGED, REGISTER_US)),
        ("gap", 56, Named(SILENT, LIVE_US)),
        ("servo", 25, Named(SILENT, LIVE_US)),
        ("plan", 36, Named(&["plan late", "log: task silent"], LIVE_US)),
        ("supervise", 55, Named(SILENT, SUPERVISION_US)),
        ("can_receive", 20, Named(CHANGED, REGISTER_US)),
        ("can_sync", 21, Named(CHANGED, REGISTER_US)),
        ("can_transmit", 19, Named(CHANGED, REGISTER_US)),
        ("protocol", 51, Named(SILENT, 520_000.0)),
    ]
}

/// Tasks whose interrupt stays masked.
pub fn silent(cases: &mut Vec<Case>) {
    for (name, interrupt, expect) in tasks() {
        let inject = move |stage: &mut Stage| {
            let soc = stage.rig.machine_mut().soc();
            Ok(soc.write(ICER + interrupt / 32 * 4, 4, 1 << (interrupt % 32))?)
        };
        cases.push(Case::new(format!("task {name} masked"), Eroding, expect, inject).powered());
    }
}

/// Stopped clocks and a stopped processor.
pub fn clocks(cases: &mut Vec<Case>) {
    for (name, register, bits) in [("trace unit off", DEMCR, 1 << 24), ("counter off", DWT_CTRL, 1)] {
        let case = Case::new(
            format!("CYCCNT frozen: {name}"),
            Eroding,
            Named(&["clock lost"], 3_000.0),
            cleared(register, bits),
        );
        cases.push(case.short());
    }
    cases.push(
        Case::new("supply falls to 2.5 V", Eroding, Named(&["supply low"], 100.0), |stage| {
            stage.rig.machine_mut().soc().set_supply(2500);
            Ok(())
        })
        .powered(),
    );
    cases.push(Case::new("core halted for 2 ms", Eroding, Named(&["live signal lost"], MONOSTABLE_US), halt));
    cases.push(
        Case::new(
            "core halted for 60 ms: watchdog reset",
            Eroding,
            Named(&["2009h:1 watchdog"], MONOSTABLE_US),
            |stage| {
                let now = stage.now();
                stage.rig.machine_mut().halt_until(now + 60 * MS);
                Ok(())
            },
        )
        .short(),
    );
    cases.push(Case::new(
        "endless loop under masked interrupts",
        Eroding,
        Named(&["2009h:1 watchdog"], MONOSTABLE_US),
        |stage| {
            within(stage, Some(16 + 25))?;
            stage.instruction(ENDLESS)
        },
    ));
    cases.push(
        Case::new("crystal stops", Eroding, Named(&["log: no crystal"], 100.0), |stage| {
            stage.rig.machine_mut().soc().lose_crystal();
            Ok(())
        })
        .powered(),
    );
    cases.push(
        Case::new("crystal does not start", Disabled, Named(&["log: no crystal"], ON), |stage| {
            stage.rig.machine_mut().soc().set_crystal(0);
            stage.power();
            Ok(())
        })
        .powered(),
    );
}

/// Exceptions of the tasks; idle has none.
const TASKS: [(&str, Option<Exception>); 15] = [
    ("reflex", Some(16 + 18)),
    ("stop", Some(16 + 40)),
    ("bridge_fault", Some(16 + 24)),
    ("encoder_a", Some(16 + 6)),
    ("encoder_b", Some(16 + 7)),
    ("encoder_index", Some(16 + 8)),
    ("gap", Some(16 + 56)),
    ("servo", Some(16 + 25)),
    ("plan", Some(16 + 36)),
    ("supervise", Some(16 + 55)),
    ("can_receive", Some(16 + 20)),
    ("can_sync", Some(16 + 21)),
    ("can_transmit", Some(16 + 19)),
    ("protocol", Some(16 + 51)),
    ("idle", None),
];

/// Runs until the task of an exception, or thread mode, is what the processor is at; its interrupt is pended so that it comes.
fn within(stage: &mut Stage, task: Option<Exception>) -> Result<()> {
    let begun = stage.now();
    if let Some(task) = task {
        stage.rig.machine_mut().soc().nvic().pend(task);
    }
    let reached = stage.rig.until(|machine| machine.soc().nvic().nesting().last().copied() == task, 2 * MS)?;
    ensure!(reached, "the task does not come");
    stage.mark();
    stage.count_from(begun);
    Ok(())
}

/// An instruction that jumps to itself, and one that is none (ARMv7-M A7.7.12, A7.7.194).
const ENDLESS: u16 = 0xe7fe;
const UNDEFINED: u16 = 0xdefe;

/// What ends a program from inside, in each task.
pub fn deaths(cases: &mut Vec<Case>) {
    for (name, task) in TASKS {
        let panic = move |stage: &mut Stage| {
            within(stage, task)?;
            stage.panic()
        };
        let case =
            Case::new(format!("panic in {name}"), Eroding, Named(&["2009h:1 reset by the program"], 100.0), panic);
        cases.push(if name == "servo" { case.short() } else { case });
    }
    for (name, task) in [("servo", Some(16 + 25)), ("idle", None)] {
        cases.push(Case::new(
            format!("undefined instruction in {name}"),
            Eroding,
            Named(&["log: hard fault"], 100.0),
            move |stage| {
                within(stage, task)?;
                stage.instruction(UNDEFINED)
            },
        ));
    }
    for (name, task) in [("servo", Some(16 + 25)), ("protocol", Some(16 + 51)), ("idle", None)] {
        let names = &["log: hard fault", "2009h:1 reset by the program"];
        cases.push(
            Case::new(format!("stack at its end in {name}"), Eroding, Named(names, 2_000.0), move |stage| {
                within(stage, task)?;
                stage.rig.machine_mut().set_stack(RAM_END - STACK + 64)
            })
            .powered(),
        );
    }
}

/// Has the head store its settings: until it has written `enough` bytes. Where they are.
fn store(stage: &mut Stage, enough: usize) -> Result<Vec<u32>> {
    let before = stage.flash();
    // "save" in 1010h:1.
    stage.rig.send_at(0, edm_soc::Frame::new(0x600 + host::NODE, &[0x23, 0x10, 0x10, 1, 0x73, 0x61, 0x76, 0x65]));
    let mut written = Vec::new();
    for _ in 0..STORED_MS {
        stage.rest(1)?;
        let after = stage.flash();
        written =
            (BASE..).zip(before.iter().zip(&after)).filter(|(_, (old, new))| old != new).map(|(at, _)| at).collect();
        if written.len() >= enough {
            break;
        }
    }
    Ok(written)
}

/// Storing takes at most, ms.
const STORED_MS: u32 = 100;

/// What is stored, at power-up.
pub fn stored(cases: &mut Vec<Case>) {
    const LOST: &[&str] = &["stored settings lost"];
    cases.push(
        Case::new("stored settings: a bit flipped", Disabled, Named(LOST, ON), |stage| {
            let used = stage.flash().iter().rposition(|byte| *byte != 0xff).context("nothing is stored")?;
            stage.spoil(BASE + used as u32 / 2)?;
            stage.power();
            Ok(())
        })
        .powered()
        .short(),
    );
    cases.push(
        Case::new("stored settings: the newest of two damaged, the older runs", Disabled, Named(LOST, ON), |stage| {
            let new = store(stage, usize::MAX)?;
            let at = *new.get(new.len() / 2).context("nothing was stored")?;
            stage.spoil(at)?;
            stage.mark();
            stage.power();
            Ok(())
        })
        .powered(),
    );
    cases.push(
        Case::new("stored settings: power cut while they are written", Disabled, Named(LOST, ON), |stage| {
            ensure!(!store(stage, 1)?.is_empty(), "nothing is being stored");
            stage.mark();
            stage.power();
            Ok(())
        })
        .powered(),
    );
    cases.push(
        Case::new("image: a bit flipped", Disabled, Named(&["self-test failed"], ON), |stage| {
            stage.spoil(PROGRAM + 0x1000)?;
            stage.power();
            Ok(())
        })
        .powered(),
    );
    cases.push(
        Case::new("stored settings: erased", Disabled, Named(&["200Bh:1 nothing stored"], ON), |stage| {
            stage.rig.machine_mut().soc().memory.flash.fill(BASE, &[0xff; LENGTH]).context("no flash")?;
            stage.power();
            Ok(())
        })
        .powered(),
    );
}

/// Bits that flip in the settings that tasks run: number, as a share of all, and bit. One of a small mantissa bit, of a large
/// one, of the exponent and the sign, spread over the numbers.
const FLIPS: [(f32, u32); 4] = [(0.1, 30), (0.35, 22), (0.6, 31), (0.85, 12)];

/// Bits of the settings and of the code in RAM.
pub fn flips(cases: &mut Vec<Case>) {
    cases.push(
        Case::new("code in RAM: a bit flipped", Eroding, Named(&["settings damaged"], COMPARED_US), |stage| {
            // In front of the first function, where nobody runs.
            let (at, sram) = (0x2000_0000 + FAST + 8, &stage.rig.machine_mut().soc().memory.sram);
            let word = sram.load(at, 4).context("no memory")?;
            sram.store(at, 4, word ^ 1 << 5).context("no memory")
        })
        .powered()
        .short(),
    );
    for (i, name) in ["servo tick", "planner", "supervision", "gap task"].into_iter().enumerate() {
        for (share, bit) in FLIPS {
            let title = format!("settings of the {name} in RAM: bit {bit} of the number at {:.0} %", 100.0 * share);
            cases.push(
                Case::new(title, Eroding, Named(&["settings damaged"], STANDS_US), move |stage| {
                    let areas = stage.rig.settings_in_use()?;
                    let (_, numbers) = areas.get(i).context("no such settings")?;
                    let at = *numbers.get((numbers.len() as f32 * share) as usize).context("no such number")?;
                    let ram = stage.rig.machine_mut().soc().memory.ram(at);
                    let word = ram.load(at, 4).context("no memory")?;
                    ram.store(at, 4, word ^ 1 << bit).context("no memory")
                })
                .powered(),
            );
        }
    }
}

// Times of the bench and of the expectations are in the same unit.
const _: () = assert!(TICK_HZ == 1_000_000 * US);

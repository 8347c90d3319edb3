//! The rows of the fault table, each from what causes it.

use super::case::{Case, Expect};
use super::limits::{
    ARC_US, CONTACT_US, ENCODER, GAP_US, HAND_US, HOST_US, LIVE, LIVE_US, ON, SEEK_US, SHORT_US, SIGNAL, STANDS_US,
    SUPERVISED_US,
};
use super::stage::{PATH, Scene, Stage};
use crate::host;
use crate::wires::MOTOR_CURRENT;
use anyhow::Result;
use edm_hal_shim::double::live::Broken;
use edm_hal_shim::safety::SafetyInputs;
use edm_servo_head::head::Command;
use edm_sim::process::{Cable, FaultInputs};

use Expect::{Harmless, Named};
use Scene::{Disabled, Eroding, Positioning};

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
pub fn anew(stage: &mut Stage) -> Result<()> {
    for word in [0, 6, 7, 0xF] {
        host::write(stage, 0x6040, 0, word, 2)?;
        stage.rest(10)?;
    }
    Ok(())
}

/// The cases. Plan late, live signal and clock are in `chip`.
pub fn table(cases: &mut Vec<Case>) {
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
    // Of 100 V; counted from the start as well.
    let names = &["burning not told from open circuit"];
    add(Case::new("sparks that burn at 65 V", Disabled, Named(names, 2.0 * SEEK_US), |stage| {
        stage.set_burn(65.0);
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
        add(Case::new("encoder cut", scene, Named(ENCODER, STANDS_US), wired(|w| w.encoder = Cable::CUT)));
        add(Case::new(
            "bus voltage 30 V",
            scene,
            Named(&["bus voltage sag"], SUPERVISED_US),
            wired(|w| w.bus_v = Some(30.0)),
        ));
        add(Case::new(
            "bus voltage 10 V",
            scene,
            Named(&["bus voltage sag"], SUPERVISED_US),
            wired(|w| w.bus_v = Some(10.0)),
        ));
        for (name, amperes) in
            [("motor current 4 A toward the work", 4.0), ("motor current 4 A away from the work", -4.0)]
        {
            let code = (2048.0 + amperes / 0.00269) as u16;
            let inject = move |stage: &mut Stage| converter(stage, (3, MOTOR_CURRENT), code);
            add(Case::new(name, scene, Named(&["over-current"], SUPERVISED_US), inject));
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
        ("monostable never expires", Broken { monostable: Some(true), ..sound }),
        ("latch off", Broken { latch: Some(false), ..sound }),
        ("latch on", Broken { latch: Some(true), ..sound }),
        ("latch read as off", Broken { read: Some(false), ..sound }),
        ("latch read as on", Broken { read: Some(true), ..sound }),
    ]
}

/// Holds what a converter gives.
pub fn converter(stage: &mut Stage, channel: (u8, u8), code: u16) -> Result<()> {
    stage.rig.machine_mut().soc().world.codes.push((channel, code));
    Ok(())
}

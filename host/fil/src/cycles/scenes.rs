//! What the firmware is measured at.
//!
//! *Rest*: eroding, the axis at rest, 25 000 pulses a second.
//!
//! *Moving*: eroding on an axis that moves back and forth at 100 000 counts a second, 25 000 pulses a second of which 10 000
//! meet a short; the host sends SYNC at 1 kHz with two RPDOs, the head answers each with four TPDOs, and the host's requests
//! follow each other without a pause: readings, a setting, a command. (The head never sends SYNC itself.) In the end the
//! emergency stop opens.
//!
//! *Pulses-100khz*: as *rest*, with 100 000 pulses a second, half of the time on.
//!
//! *Marks*: after that, an index mark at every eighth count, and then edges faster than the interrupt serves.

use super::names::Debug;
use crate::host;
use crate::image::Image;
use crate::meter::{Task, WAIT_STATES};
use crate::session::{MS, Session};
use crate::synthetic::{Behaviour, Traffic};
use crate::wires::CONTACTS;
use anyhow::{Result, anyhow, bail, ensure};
use edm_servo_head::head::State;
use edm_soc::{Exception, Frame, TICK_HZ};
use std::collections::BTreeMap;
use std::rc::Rc;

/// Time that a scene is measured for.
pub const LENGTH: u64 = 200 * MS;
/// Time in the scene of the marks, each of the two halves.
const MARKS: u64 = 5 * MS;
/// Edges a second, moving, and when they are too many.
const MOVING: u64 = 100_000;
const TOO_MANY: u64 = 1_500_000;
const US: u64 = TICK_HZ / 1_000_000;
/// An axis at rest.
const STILL: Behaviour = Behaviour { edges_per_s: 0, pulse: (40 * US, 20 * US), shorts: (0, 1) };
/// A frame of eight bytes at 1 Mbit/s, stuffed at worst.
const FRAME: u64 = 135 * US;

/// Identifier of the head's answers.
const ANSWER: u32 = 0x580 + host::NODE as u32;

/// Marks of a run: it came by an index mark or an illegal transition; it found too many edges.
pub const INDEX: u8 = 1;
/// As [`INDEX`].
pub const OVERLOAD: u8 = 2;
/// Ends of the names of the functions that give them.
const MARKED: [(&str, u8); 2] = [("quadrature::Quadrature<S>::unusual", INDEX), ("EdgeLines>::unusual", OVERLOAD)];

/// What each exception has cost.
pub type Tasks = BTreeMap<Exception, Task>;

/// What was measured in the scenes.
pub struct Scenes {
    /// At rest.
    pub rest: Tasks,
    /// Moving, with the stop.
    pub moving: Tasks,
    /// At rest, with 100 000 pulses a second.
    pub fast: Tasks,
    /// Share of the processor of each task without the stop, in each, 0..=1.
    pub load: [BTreeMap<Exception, f64>; 3],
    /// Index marks and too many edges.
    pub marks: Tasks,
}

/// Runs the firmware through the scenes.
///
/// # Errors
/// When it does not erode, or runs without the accelerator that the estimate is made for.
pub fn run(image: &Image, debug: &Rc<Debug>) -> Result<Scenes> {
    let mut session = still(image, debug)?;
    session.idle(LENGTH)?;
    let rest = take(&mut session)?;
    let at_rest = load(&rest);

    // No whole number of conversions: or every pulse would see the same phase of them, and one in which none lies well within.
    let mut session = ready(image, Behaviour { pulse: (10 * US + 7, 5 * US + 3), ..STILL }, debug)?;
    session.idle(LENGTH)?;
    let fast = take(&mut session)?;

    let mut session = ready(image, Behaviour { edges_per_s: MOVING, shorts: (2, 5), ..STILL }, debug)?;
    connect(&mut session)?;
    let start = session.now();
    let world = &mut session.machine.soc().world;
    world.disturb();
    world.busy(start + MS, traffic());
    session.idle(20 * MS)?;
    clear(&mut session);
    session.idle(LENGTH)?;
    let state = reported_state(&session);
    ensure!(state == Some(State::Eroding as u8), "the head does not stay eroding on the moving axis: state {state:?}");
    let load = [at_rest, load(&take(&mut session)?), load(&fast)];
    let now = session.now();
    session.machine.soc().world.level(now + 1, CONTACTS[2], true);
    session.machine.soc().world_changed();
    session.idle(5 * MS)?;
    let moving = take(&mut session)?;

    clear(&mut session);
    let world = &mut session.machine.soc().world;
    world.mark = Some(world.count());
    session.idle(MARKS)?;
    let world = &mut session.machine.soc().world;
    world.mark = None;
    world.vibrate(TOO_MANY);
    session.idle(MARKS)?;
    let marks = take(&mut session)?;
    Ok(Scenes { rest, moving, fast, load, marks })
}

/// The firmware at rest, eroding and metered.
fn still(image: &Image, debug: &Rc<Debug>) -> Result<Session> {
    ready(image, STILL, debug)
}

/// The firmware, eroding and metered.
fn ready(image: &Image, behaviour: Behaviour, debug: &Rc<Debug>) -> Result<Session> {
    let mut session = Session::ready(image, behaviour)?;
    session.erode()?;
    let access = session.machine.soc().flash_access();
    ensure!(
        access == (WAIT_STATES as u32, true),
        "the estimate is for five wait states with prefetch and both caches on; the image has set {access:?}"
    );
    let debug = Rc::clone(debug);
    session.machine.start_meter(Box::new(move |address| {
        let names = debug.functions(address);
        let given = MARKED.iter().filter(|(end, _)| names.iter().any(|name| name.ends_with(end)));
        given.fold(0, |marks, (_, mark)| marks | mark)
    }))?;
    Ok(session)
}

/// State of the head in its newest answer to the request for it.
fn reported_state(session: &Session) -> Option<u8> {
    let answers = session.machine.world().frames.iter().rev().map(|f| f.1);
    let mut states = answers.filter(|f| f.id == ANSWER && f.data[1..4] == [0x00, 0x20, 1]);
    states.next().map(|f| f.data[4])
}

/// Measures anew from here on.
fn clear(session: &mut Session) {
    if let Some(meter) = session.machine.meter() {
        meter.clear();
    }
}

fn take(session: &mut Session) -> Result<Tasks> {
    let Some(meter) = session.machine.meter() else { bail!("no meter") };
    let mut tasks = meter.tasks().map_err(|e| anyhow!("{e:#}"))?.clone();
    // Thread mode has no runs.
    tasks.remove(&0);
    Ok(tasks)
}

fn load(tasks: &Tasks) -> BTreeMap<Exception, f64> {
    let share = |task: &Task| task.runs.iter().map(|r| r.cost.estimate()).sum::<u64>() as f64 / LENGTH as f64;
    tasks.iter().map(|(e, task)| (*e, share(task))).collect()
}

/// Four TPDOs with every SYNC; the last two with the position as well.
fn connect(session: &mut Session) -> Result<()> {
    for (n, identifier) in [(0, 0x181), (1, 0x281), (2, 0x381), (3, 0x481)] {
        let (parameter, mapping) = (0x1800 + n, 0x1A00 + n);
        host::write(session, parameter, 1, 1 << 31 | identifier, 4)?;
        host::write(session, parameter, 2, 1, 1)?;
        if n > 1 {
            // Position and velocity actual value.
            host::write(session, mapping, 0, 0, 1)?;
            host::write(session, mapping, 1, 0x6064_0020, 4)?;
            host::write(session, mapping, 2, 0x606C_0020, 4)?;
            host::write(session, mapping, 0, 2, 1)?;
        }
        host::write(session, parameter, 1, 1 << 30 | identifier, 4)?;
    }
    Ok(())
}

fn traffic() -> Traffic {
    let request = |first: u8, index: u16, sub: u8, value: u32| {
        let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), value.to_le_bytes());
        Frame::new(0x600 + host::NODE, &[first, low, high, sub, a, b, c, d])
    };
    let read = |index, sub| request(0x40, index, sub, 0);
    Traffic {
        before_sync: 2 * FRAME,
        period: MS,
        // Controlword: operation enabled; target position.
        objects: vec![Frame::new(0x200 + host::NODE, &[0xF, 0]), Frame::new(0x300 + host::NODE, &[0; 4])],
        sync: Some(Frame::new(0x80, &[])),
        requests: vec![
            read(0x2000, 1),
            read(0x6041, 0),
            read(0x6064, 0),
            // Bandwidth of the velocity loop: but for the first time what it is already. A host that changes it so often is none.
            request(0x23, 0x2109, 1, 160f32.to_bits()),
            read(0x2005, 2),
            // Target of the path.
            request(0x23, 0x2004, 1, 1000),
        ],
        answer: (ANSWER, FRAME),
    }
}

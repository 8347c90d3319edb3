//! Persistent arcs on the running head: when it reports them, and whether it does so without any.
//!
//! The reference is a count in the process: arcs were more than `supervise.arc_percent` of all pulses of the last 200 ms
//! for `supervise.arc_ms`. The head samples one pulse a millisecond.

use edm_servo_head::head::{Command, Fault, Refused, State};
use edm_servo_head::settings::{Settings, Value};
use edm_servo_head::units::{Nanometres, TICK_HZ};
use edm_sim::machine::Machine;
use edm_sim::process::Pulses;
use edm_sim::run::Setup;
use std::collections::VecDeque;

/// Time in which the head must report persistent arcs, ms.
pub const NAMED_MS: u64 = 200;
/// From when there are arcs, and how long a run is, ms of erosion.
pub const ARCS_FROM_MS: u64 = 300;
const RUN_MS: u64 = 2000;
/// Window of the shares, ms.
const WINDOW_MS: usize = 200;
/// Pulses in a window that are a share of anything.
const LEAST: u64 = 50;

/// What the process knows of its arcs.
#[derive(Default)]
struct Truth {
    counts: VecDeque<Pulses>,
    /// Milliseconds in a row for which arcs have had more than their share.
    above: u64,
}

impl Truth {
    /// One more millisecond; whether arcs are persistent.
    fn look(&mut self, now: Pulses, settings: &Settings) -> bool {
        self.counts.push_back(now);
        if self.counts.len() <= WINDOW_MS {
            return false;
        }
        let Some(then) = self.counts.pop_front() else { return false };
        let since = now.since(&then);
        let share = 100.0 * since.arc as f64 / since.total().max(LEAST) as f64;
        self.above = if share > f64::from(settings.arc_share) { self.above + 1 } else { 0 };
        self.above > u64::from(settings.arc_ms)
    }
}

/// A head that has begun to erode.
fn eroding(name: &str, seed: u64) -> Result<(Machine, Settings), String> {
    let setup = Setup::load(name)?;
    let settings = Settings { commissioned: true, ..setup.head };
    let mut machine = Machine::new(setup.process, &settings, seed).map_err(|error| error.to_string())?;
    let millimetre = Command::MoveBy(Nanometres(2_000_000));
    (0..200).for_each(|_| machine.tick());
    for command in [Command::SetHome(Nanometres(0)), Command::Enable, millimetre, Command::Start] {
        machine.command(command).map_err(|refused: Refused| refused.to_string())?;
    }
    for _ in 0..20 * TICK_HZ {
        machine.tick();
        match machine.status().state {
            State::Eroding => return Ok((machine, settings)),
            State::Fault => break,
            _ => {}
        }
    }
    Err(format!("{name} {seed}: {:?} instead of eroding", machine.status().fault))
}

fn millisecond(machine: &mut Machine) {
    (0..TICK_HZ / 1000).for_each(|_| machine.tick());
}

/// A head that got arcs.
#[derive(Clone, Copy, Debug)]
pub struct Named {
    /// The fault that it ended with.
    pub fault: Option<Fault>,
    /// When it was there, ms of erosion.
    at: Option<u64>,
    /// Since when arcs were persistent, by the process.
    since: Option<u64>,
    /// The earliest that it may be named, ms of erosion.
    earliest: u64,
}

impl Named {
    /// Named as arcs, and not before they could have had their time.
    pub fn rightly(&self) -> bool {
        self.fault == Some(Fault::PersistentArc) && self.at.is_some_and(|at| at > self.earliest)
    }

    /// How long after the first injected arc, ms; the whole run when never.
    pub fn after_ms(&self) -> u64 {
        self.at.unwrap_or(RUN_MS).saturating_sub(ARCS_FROM_MS)
    }

    /// How long after arcs became persistent, ms; the whole run when never.
    pub fn late_ms(&self) -> u64 {
        match (self.at, self.since) {
            (Some(at), Some(since)) => at.saturating_sub(since),
            (Some(_), None) => 0,
            (None, _) => RUN_MS,
        }
    }
}

/// Gives a head in a scenario so many percent of arcs, until it names them.
///
/// # Errors
/// When the scenario cannot be loaded, or the head does not begin to erode.
pub fn with_arcs(name: &str, percent: f64, seed: u64) -> Result<Named, String> {
    let (mut machine, settings) = eroding(name, seed)?;
    let mut truth = Truth::default();
    let mut named = Named { fault: None, at: None, since: None, earliest: ARCS_FROM_MS + u64::from(settings.arc_ms) };
    for ms in 0..RUN_MS {
        if ms == ARCS_FROM_MS {
            let event = machine.process.happen("gap.arcs_percent", Value::Number(percent));
            event.map_err(|error| format!("gap.arcs_percent {percent}: {error:?}"))?;
        }
        millisecond(&mut machine);
        if truth.look(machine.process.truth().pulses, &settings) {
            named.since.get_or_insert(ms);
        }
        if machine.status().state == State::Fault {
            (named.fault, named.at) = (machine.status().fault, Some(ms));
            break;
        }
    }
    Ok(named)
}

/// A head on which no arcs were brought.
#[derive(Clone, Copy, Debug)]
pub struct Without {
    /// It reported persistent arcs although the process had none until then.
    pub falsely: bool,
}

/// Lets a head erode.
///
/// # Errors
/// When the scenario cannot be loaded, or the head does not begin to erode.
pub fn without_arcs(name: &str, seed: u64) -> Result<Without, String> {
    let (mut machine, settings) = eroding(name, seed)?;
    let (mut truth, mut stay, mut falsely) = (Truth::default(), false, false);
    for _ in 0..RUN_MS {
        millisecond(&mut machine);
        stay |= truth.look(machine.process.truth().pulses, &settings);
        falsely |= !stay && machine.status().fault == Some(Fault::PersistentArc);
    }
    Ok(Without { falsely })
}

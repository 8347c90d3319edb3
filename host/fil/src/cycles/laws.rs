//! What each feed law costs: estimated cycles in its file, with what it calls from there, at every plan of a head that erodes in
//! the process model.

use super::names::{self, Debug};
use super::report::rounded;
use crate::host;
use crate::image::Image;
use crate::meter::PART;
use crate::rig::{Emulated, Witness};
use anyhow::{Result, anyhow, ensure};
use edm_servo_head::feed::LawName;
use edm_servo_head::head::Command;
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Rig as _;
use edm_sim::run::Setup;
use serde::Serialize;
use std::fmt::Write;
use std::rc::Rc;

/// Servo ticks with pulses before the measurement, and of the measurement: about three of the longest periods are eroded.
const SETTLE: u32 = 2000;
const LENGTH: u32 = 10_000;
/// Servo ticks in which there have to be so many.
const PATIENCE: u32 = 80_000;
/// Targets: most cycles of a call, mean; of the call in which minimum variance identifies its model, which is its longest.
const MEAN: f64 = 150.0;
const IDENTIFIES: u64 = 400;

/// The cost of a law, estimated cycles.
#[derive(Clone, Debug, Serialize)]
pub struct Law {
    /// Its name.
    pub law: &'static str,
    /// Calls.
    pub calls: usize,
    /// Mean.
    pub mean: f64,
    /// Half of the calls are shorter: of a law with a period, a call within it.
    pub median: u64,
    /// Longest: of a law with a period, a call in which it acts.
    pub worst: u64,
    /// Whether it keeps its target.
    pub met: bool,
}

/// Erodes with one law after the other: the sinker of the default scenario; minimum variance on silicon, where its charging curve holds.
///
/// # Errors
/// When the firmware does not erode with one of them.
pub fn measure(image: &Image) -> Result<Vec<Law>> {
    let debug = Rc::new(Debug::new(image)?);
    let laws = LawName::ALL.iter().zip(LawName::NAMES);
    laws.map(|(law, name)| of_law(image, &debug, *law, name)).collect()
}

fn of_law(image: &Image, debug: &Rc<Debug>, law: LawName, name: &'static str) -> Result<Law> {
    let scenario = if law == LawName::MinimumVariance { "silicon" } else { "default" };
    let mut setup = Setup::load(scenario).map_err(|e| anyhow!(e))?;
    for assignment in ["workpiece.surface_mm=0.3", &format!("feed.law={name}")] {
        setup.set(assignment).map_err(|e| anyhow!(e))?;
    }
    setup.head.commissioned = true;
    let mut rig = Emulated::start(image, setup.process, &setup.head, 1, Witness::None)?;
    host::begin(&mut rig)?;
    for command in
        [Command::SetHome(Nanometres(0)), Command::Enable, Command::MoveTo(Nanometres(1_000_000)), Command::Start]
    {
        rig.command(command).map_err(|e| anyhow!(e))?;
    }
    erode(&mut rig, SETTLE, name)?;
    let (debug, part) = (Rc::clone(debug), format!("feed::{name}::"));
    let machine = rig.machine_mut();
    machine.step_by_instructions()?;
    machine.start_meter(Box::new(move |address| {
        PART * u8::from(debug.functions(address).iter().any(|function| function.contains(&part)))
    }))?;
    erode(&mut rig, LENGTH, name)?;
    let meter = rig.machine_mut().meter().ok_or_else(|| anyhow!("no meter"))?;
    let tasks = meter.tasks().map_err(|e| anyhow!("{e:#}"))?;
    let plan = tasks.iter().find(|(exception, _)| names::task(image, **exception) == "plan");
    let runs = plan.map_or(&[][..], |(_, plan)| &plan.runs);
    let mut calls: Vec<u64> = runs.iter().map(|run| run.part.estimate()).filter(|cycles| *cycles > 0).collect();
    ensure!(calls.len() > (LENGTH / 5 / 2) as usize, "{name}: called in {} of {} plans", calls.len(), runs.len());
    calls.sort_unstable();
    let mean = rounded(calls.iter().sum::<u64>() as f64 / calls.len() as f64);
    let worst = calls.last().copied().unwrap_or_default();
    let met = if law == LawName::MinimumVariance { worst <= IDENTIFIES } else { mean <= MEAN };
    Ok(Law { law: name, calls: calls.len(), mean, median: calls[calls.len() / 2], worst, met })
}

/// Lets so many servo ticks pass with pulses: the seek, and then the erosion.
fn erode(rig: &mut Emulated, ticks: u32, name: &str) -> Result<()> {
    let mut eroded = 0;
    for _ in 0..PATIENCE {
        rig.tick().map_err(|e| anyhow!("{name}: {e}"))?;
        eroded += u32::from(rig.status().state.pulses());
        if eroded >= ticks {
            return Ok(());
        }
    }
    Err(anyhow!("{name}: the head does not erode: {:?}", rig.status()))
}

/// As a table.
pub fn table(laws: &[Law]) -> String {
    let mut text =
        String::from("| law | calls | mean | median | worst | at most |\n| --- | --- | --- | --- | --- | --- |\n");
    for Law { law, calls, mean, median, worst, met } in laws {
        let bound = if *law == "minimum_variance" { format!("{IDENTIFIES} worst") } else { format!("{MEAN} mean") };
        let kept = if *met { "met" } else { "not met" };
        let _ = writeln!(text, "| {law} | {calls} | {mean:.1} | {median} | {worst} | {bound}: {kept} |");
    }
    text
}

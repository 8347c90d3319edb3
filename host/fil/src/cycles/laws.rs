//! What each feed law costs: estimated cycles inside its file, plan by plan.

use super::names::{self, Debug};
use super::scenes;
use crate::host;
use crate::image::Image;
use crate::session::{MS, Session};
use anyhow::{Result, ensure};
use edm_servo_head::feed::LawName;
use edm_servo_head::head::State;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::rc::Rc;

/// Time from one plan to the next.
const PLAN: u64 = MS / 4;
/// Plans that each law is measured for: four of the longest periods by default.
const PLANS: usize = 1600;
/// Time for a change of law to fade, and for estimators to fill.
const SETTLE: u64 = 50 * MS;
/// Most cycles of a call in which a law acts; of one that identifies its model.
const MOST: f64 = 150.0;
const IDENTIFIES: f64 = 400.0;

/// The cost of a law.
#[derive(Clone, Debug)]
pub struct Law {
    /// Its name.
    pub name: &'static str,
    /// Mean cycles of a call.
    pub mean: f64,
    /// Worst.
    pub worst: f64,
    /// Calls that took more than twice the median: those in which it acts, if its period is longer than a plan.
    pub acts: usize,
    /// Most of `worst`.
    pub bound: f64,
}

/// Erodes with one law after the other.
///
/// # Errors
/// When the firmware does not erode with one of them.
pub fn measure(image: &Image) -> Result<Vec<Law>> {
    let debug = Rc::new(Debug::new(image)?);
    let mut laws = Vec::new();
    for (law, name) in LawName::ALL.iter().zip(LawName::NAMES) {
        // The order test feeds nothing, and ends.
        if *law == LawName::OrderTest {
            continue;
        }
        let mut session = scenes::still(image, &debug)?;
        host::write(&mut session, 0x2102, 2, *law as u32, 1)?;
        session.idle(SETTLE)?;
        let mut inside = Inside { image, debug: &debug, part: format!("feed::{name}::"), known: BTreeMap::new() };
        // From between two plans on.
        scenes::clear(&mut session);
        while inside.of_plan(&mut session)?.is_none() {
            session.idle(PLAN / 25)?;
        }
        session.idle(PLAN / 10)?;
        let mut calls = Vec::new();
        let start = session.now();
        for n in 1..=PLANS as u64 {
            scenes::clear(&mut session);
            // Each step ends a few instructions late.
            session.idle((start + n * PLAN).saturating_sub(session.now()))?;
            calls.extend(inside.of_plan(&mut session)?);
        }
        ensure!(session.state()? == State::Eroding as u32, "{name}: the head does not stay eroding");
        ensure!(calls.len() > PLANS / 2, "{name}: called in {} of {PLANS} plans", calls.len());
        calls.sort_by(f64::total_cmp);
        let median = calls.get(calls.len() / 2).copied().unwrap_or(0.0);
        laws.push(Law {
            name,
            mean: calls.iter().sum::<f64>() / calls.len() as f64,
            worst: calls.last().copied().unwrap_or(0.0),
            acts: calls.iter().filter(|cycles| **cycles > 2.0 * median).count(),
            bound: if *law == LawName::MinimumVariance { IDENTIFIES } else { MOST },
        });
    }
    Ok(laws)
}

/// Which addresses belong to a law.
struct Inside<'a> {
    image: &'a Image,
    debug: &'a Debug,
    part: String,
    known: BTreeMap<u32, bool>,
}

impl Inside<'_> {
    /// Cycles spent there in the newest plan; `None` without one.
    fn of_plan(&mut self, session: &mut Session) -> Result<Option<f64>> {
        let tasks = scenes::metered(session)?;
        let Some((_, plan)) = tasks.iter().find(|(exception, _)| names::task(self.image, **exception) == "plan") else {
            return Ok(None);
        };
        let mut cycles = 0;
        for (address, cost) in &plan.places {
            let (debug, part) = (self.debug, &self.part);
            let is_inside = || debug.functions(*address).iter().any(|name| name.contains(part));
            if *self.known.entry(*address).or_insert_with(is_inside) {
                cycles += cost.estimate();
            }
        }
        Ok((plan.runs.len() == 1).then_some(cycles as f64))
    }
}

/// As a table.
pub fn table(laws: &[Law]) -> String {
    let mut text = String::from(
        "| law | cycles of a call, mean | worst | at most | calls in which it acts |\n| --- | --- | --- | --- | --- |\n",
    );
    for law in laws {
        let _ = writeln!(
            text,
            "| {} | {:.0} | {:.0} | {:.0} | {} of {PLANS} |",
            law.name, law.mean, law.worst, law.bound, law.acts
        );
    }
    text
}

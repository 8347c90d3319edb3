//! The table of costs: measured, written as JSON or into the documentation, compared with what was committed.

use super::names::{self, Debug};
use super::{Cost, Task};
use crate::image::Image;
use crate::session::{MS, Session};
use crate::synthetic::Behaviour;
use anyhow::{Result, bail};
use edm_soc::{Exception, TICK_HZ};
use serde::Serialize;
use std::collections::BTreeMap;

/// Growth over the committed table that is a regression, percent.
const TOLERANCE: u64 = 5;
/// Time measured in each of the two scenes.
const SCENE: u64 = 200 * MS;
/// Functions with a row of their own: task that runs them, name of the row, end of their name in the debug information. A row
/// is the sum of those that have its name.
const FUNCTIONS: &[(&str, &str, &str)] = &[
    ("gap", "gap filter, LP4 and notch", "dsp::chain::State::tick"),
    ("gap", "gap filter, LP4 and notch", "stm32f4::gap_filter::tick"),
    ("gap", "gate mask", "edges::gate_mask"),
    ("gap", "tally of a block", "decimate::Tally::of"),
    ("encoder_a", "quadrature decoder", "quadrature::Quadrature<S>::take"),
    ("servo", "measure", "head::machine::Head::measure"),
    ("servo", "velocity", "encoder::velocity::Velocity::tick"),
    ("servo", "decide", "head::machine::Head::decide"),
    ("servo", "carry out", "head::machine::Head::carry_out"),
    ("servo", "feed limiter", "head::machine::Head::limited"),
    ("servo", "path step", "path::register::Register"),
    ("servo", "PID", "servo::pid::Pid::update"),
    ("servo", "back-EMF", "servo::emf::BackEmf::update"),
];
/// Rows that have a budget, estimated cycles.
const BUDGETS: &[(&str, u64)] =
    &[("gap filter, LP4 and notch", 80), ("encoder_a", 65), ("encoder_b", 65), ("servo", 450)];
/// Share of the processor at 20 kHz with 500 kS/s, percent.
const LOAD: f64 = 35.0;

/// One row.
#[derive(Clone, Debug, Serialize, PartialEq, Eq)]
pub struct Row {
    /// Task, or function in a run of its task.
    pub name: String,
    /// Instructions of a typical run: the median by estimated cycles.
    pub instructions: u64,
    /// Fewest cycles of that run.
    pub cycles_low: u64,
    /// Estimate.
    pub cycles_est: u64,
    /// Most cycles with flash warm.
    pub cycles_high: u64,
    /// Bound with flash cold.
    pub cycles_cold: u64,
    /// Estimate of the longest run met.
    pub cycles_worst: u64,
}

/// What was measured.
pub struct Measured {
    /// Rows: tasks, then functions.
    pub rows: Vec<Row>,
    /// Share of the processor in percent by task, eroding, from estimated cycles.
    pub load: Vec<(String, f64)>,
    /// Where a run of a task spends its estimated cycles: function and cycles a run, most first.
    pub hot: BTreeMap<String, Vec<(String, f64)>>,
}

impl Row {
    fn new(name: String, cost: Cost, worst: u64) -> Self {
        Self {
            name,
            instructions: cost.instructions,
            cycles_low: cost.low,
            cycles_est: cost.estimate,
            cycles_high: cost.high,
            cycles_cold: cost.cold(),
            cycles_worst: worst,
        }
    }
}

/// Runs the firmware twice: eroding at rest, and eroding on a vibrating axis, which gives edges.
///
/// # Errors
/// When the firmware does not erode.
pub fn measure(image: &Image) -> Result<Measured> {
    let still =
        Behaviour { edges_per_s: 0, pulse: (40 * TICK_HZ / 1_000_000, 20 * TICK_HZ / 1_000_000), shorts: false };
    let mut tasks = BTreeMap::new();
    let mut load = Vec::new();
    for vibrating in [false, true] {
        let behaviour = Behaviour { edges_per_s: if vibrating { 100_000 } else { 0 }, shorts: vibrating, ..still };
        let mut session = Session::ready(image, behaviour)?;
        session.erode()?;
        session.machine.start_meter()?;
        if vibrating {
            session.machine.soc().world.disturb();
        }
        session.idle(SCENE)?;
        let Some(meter) = session.machine.meter() else { bail!("no meter") };
        let measured = match meter.tasks() {
            Ok(tasks) => tasks,
            Err(e) => bail!("{e:#}"),
        };
        for (e, task) in measured.iter().filter(|t| *t.0 != 0) {
            if !vibrating {
                let cycles: u64 = task.runs.iter().map(|r| r.estimate).sum();
                load.push((names::task(image, *e), 100.0 * cycles as f64 / SCENE as f64));
            }
            // Each task in the scene that does not add to it: edges and shorts only where they belong.
            tasks.entry(*e).or_insert_with(|| Task { runs: task.runs.clone(), places: task.places.clone() });
        }
    }
    Ok(table(image, &tasks, load, &Debug::new(image)?))
}

fn table(image: &Image, tasks: &BTreeMap<Exception, Task>, load: Vec<(String, f64)>, debug: &Debug) -> Measured {
    let mut rows = Vec::new();
    let mut functions: BTreeMap<&str, Row> = BTreeMap::new();
    let mut hot = BTreeMap::new();
    for (e, task) in tasks {
        let name = names::task(image, *e);
        let mut runs = task.runs.clone();
        runs.sort_by_key(|r| r.estimate);
        let (Some(median), Some(worst)) = (runs.get(runs.len() / 2), runs.last()) else { continue };
        rows.push(Row::new(name.clone(), *median, worst.estimate));
        let mut spent: BTreeMap<String, u64> = BTreeMap::new();
        let mut sums: BTreeMap<&str, Cost> = BTreeMap::new();
        for (address, cost) in &task.places {
            let inside = debug.functions(*address);
            if let Some(first) = inside.first() {
                *spent.entry(first.clone()).or_default() += cost.estimate;
            }
            for (_, row, end) in FUNCTIONS.iter().filter(|f| f.0 == name) {
                if inside.iter().any(|f| f.contains(end)) {
                    *sums.entry(row).or_default() += *cost;
                }
            }
        }
        let n = runs.len() as u64;
        for (row, c) in sums {
            let mean = |v: u64| (v + n / 2) / n;
            let cost = Cost {
                instructions: mean(c.instructions),
                low: mean(c.low),
                estimate: mean(c.estimate),
                high: mean(c.high),
                lines: mean(c.lines),
            };
            functions.insert(row, Row::new(row.to_owned(), cost, cost.estimate));
        }
        let mut list: Vec<_> = spent.into_iter().map(|(f, c)| (f, c as f64 / n as f64)).collect();
        list.sort_by(|a, b| b.1.total_cmp(&a.1));
        hot.insert(name, list);
    }
    rows.extend(FUNCTIONS.iter().filter_map(|f| functions.remove(f.1)));
    Measured { rows, load, hot }
}

impl Measured {
    /// Share of the processor of all tasks, percent.
    pub fn total_load(&self) -> f64 {
        self.load.iter().map(|l| l.1).sum()
    }

    /// The section as Markdown.
    pub fn markdown(&self) -> String {
        let mut page = String::from(
            "Cycles of a Cortex-M4F at 168 MHz, from the release image on the modelled chip: instructions are exact, cycles an\n\
             estimate (a model, not silicon). A task's row is its median run, entry and return included, interruptions not; a\n\
             function's row is its share of a run of its task. *Low* and *high* bound the estimate with warm flash; *cold*\n\
             adds five wait states for every line of flash that the run touches. *Worst*: the longest run met, estimated.\n\n\
             | name | instructions | low | estimate | high | cold | worst | budget |\n| --- | --- | --- | --- | --- | --- | --- | --- |\n",
        );
        for r in &self.rows {
            let budget = BUDGETS.iter().find(|b| b.0 == r.name).map_or_else(String::new, |b| b.1.to_string());
            page += &format!(
                "| {} | {} | {} | {} | {} | {} | {} | {budget} |\n",
                r.name, r.instructions, r.cycles_low, r.cycles_est, r.cycles_high, r.cycles_cold, r.cycles_worst
            );
        }
        page += &format!(
            "\nLoad while eroding at rest, 25 000 pulses a second, 20 kHz, 500 kS/s: {:.1} % of the processor (budget {LOAD} %).\n\n\
             | task | load % |\n| --- | --- |\n",
            self.total_load()
        );
        for (name, share) in &self.load {
            page += &format!("| {name} | {share:.2} |\n");
        }
        page
    }

    /// What is over its budget.
    pub fn over_budget(&self) -> Vec<String> {
        let mut list = Vec::new();
        for (name, budget) in BUDGETS {
            match self.rows.iter().find(|r| r.name == *name) {
                Some(r) if r.cycles_est > *budget => list.push(format!("{name}: {} of {budget} cycles", r.cycles_est)),
                Some(_) => {}
                None => list.push(format!("{name}: not met")),
            }
        }
        if self.total_load() > LOAD {
            list.push(format!("load: {:.1} of {LOAD} %", self.total_load()));
        }
        list
    }

    /// Rows that have grown against the committed page, or are gone from either.
    pub fn regressions(&self, committed: &str) -> Vec<String> {
        let mut list = Vec::new();
        let old: BTreeMap<&str, u64> = committed
            .lines()
            .filter_map(|line| {
                let cells: Vec<_> = line.split('|').map(str::trim).collect();
                (cells.len() == 10).then(|| Some((cells[1], cells[4].parse().ok()?))).flatten()
            })
            .collect();
        for row in &self.rows {
            match old.get(row.name.as_str()) {
                None => list.push(format!("{}: not in the committed table", row.name)),
                Some(old) if row.cycles_est * 100 > old * (100 + TOLERANCE) => {
                    list.push(format!("{}: {} cycles, {old} committed", row.name, row.cycles_est));
                }
                Some(_) => {}
            }
        }
        let gone = old.keys().filter(|name| !self.rows.iter().any(|r| r.name == **name));
        list.extend(gone.map(|name| format!("{name}: committed, but not measured")));
        list
    }
}

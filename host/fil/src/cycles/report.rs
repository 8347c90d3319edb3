//! The figures of tasks and functions in the scenes.

use super::names::{self, Debug};
use super::scenes::{self, INDEX, OVERLOAD, Tasks};
use crate::image::Image;
use crate::meter::{Cost, Run};
use anyhow::Result;
use edm_soc::Exception;
use serde::Serialize;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Functions with a figure of their own: task that runs them, name, part of their name in the debug information.
const FUNCTIONS: &[(&str, &str, &str)] = &[
    ("gap", "gap filter", "dsp::chain::State::tick"),
    ("gap", "gap filter", "stm32f4::gap_filter::tick"),
    ("gap", "gate mask", "edges::gate_mask"),
    ("gap", "edges of a block", "gate::Edges::fill"),
    ("gap", "classes of pulses", "pulses::stream::PulseStream::block"),
    ("gap", "conversions of a pulse", "pulses::samples::Evidence::samples"),
    ("gap", "tally of a block", "decimate::Tally::of"),
    ("encoder_a", "quadrature decoder", "quadrature::Quadrature<S>::take"),
    ("servo", "velocity", "encoder::velocity::Velocity::tick"),
    ("plan", "path step", "path::register::Register"),
    ("servo", "PID", "servo::pid::Pid::update"),
    ("supervise", "back-EMF", "servo::emf::BackEmf::update"),
];
/// Encoder interrupts, and what a run of theirs is called by its marks.
const ENCODER: [&str; 3] = ["encoder_a", "encoder_b", "encoder_index"];
const PATHS: [(&str, u8); 3] = [("encoder edge", 0), ("encoder index", INDEX), ("encoder overload", OVERLOAD)];

/// Estimated cycles of a task's runs.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Figures {
    /// Mean.
    pub mean: f64,
    /// Half of them are shorter.
    pub median: u64,
    /// Longest.
    pub worst: u64,
    /// Runs.
    #[serde(skip)]
    pub runs: usize,
    /// The median run in full.
    #[serde(skip)]
    pub typical: Cost,
}

impl Figures {
    fn of(runs: &[Run]) -> Option<Self> {
        let mut costs: Vec<Cost> = runs.iter().map(|r| r.cost).collect();
        costs.sort_by_key(Cost::estimate);
        let (typical, worst) = (*costs.get(costs.len() / 2)?, costs.last()?.estimate());
        let sum: u64 = costs.iter().map(Cost::estimate).sum();
        Some(Self {
            mean: sum as f64 / costs.len() as f64,
            median: typical.estimate(),
            worst,
            runs: costs.len(),
            typical,
        })
    }
}

/// A scene.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Scene {
    /// Share of the processor of all tasks.
    pub load_percent: f64,
    /// By task.
    pub tasks: BTreeMap<String, Figures>,
    /// Share of the processor by task, percent.
    #[serde(skip)]
    pub load: BTreeMap<String, f64>,
}

/// The scenes.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Pair {
    /// Eroding at rest.
    pub rest: Scene,
    /// Eroding on a moving axis, with a busy host.
    pub moving: Scene,
    /// Eroding at rest, with 100 000 pulses a second.
    pub fast: Scene,
}

/// What was measured.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Measured {
    /// Tasks.
    pub scenes: Pair,
    /// Functions and paths of a task: mean of a run, in the scene where that is greater.
    pub functions: BTreeMap<String, f64>,
}

/// Runs the firmware through the scenes.
///
/// # Errors
/// When the firmware does not erode.
pub fn measure(image: &Image) -> Result<Measured> {
    let debug = Rc::new(Debug::new(image)?);
    let scenes = scenes::run(image, &debug)?;
    let [rest, moving, fast] = &scenes.load;
    let mut functions = BTreeMap::new();
    for tasks in [&scenes.rest, &scenes.moving, &scenes.fast] {
        for (name, cycles) in shares(image, tasks, &debug) {
            let most = functions.entry(name).or_insert(cycles);
            *most = cycles.max(*most);
        }
    }
    for (name, marks) in PATHS {
        let tasks = if marks == 0 { &scenes.moving } else { &scenes.marks };
        let encoder = tasks.iter().filter(|t| ENCODER.contains(&names::task(image, *t.0).as_str()));
        let runs: Vec<Run> = encoder.flat_map(|t| &t.1.runs).filter(|r| r.marks == marks).copied().collect();
        if let Some(figures) = Figures::of(&runs) {
            functions.insert(name.to_owned(), rounded(figures.mean));
        }
    }
    let scenes = Pair {
        rest: scene(image, &scenes.rest, rest),
        moving: scene(image, &scenes.moving, moving),
        fast: scene(image, &scenes.fast, fast),
    };
    Ok(Measured { scenes, functions })
}

/// To a tenth: what is printed is what is compared.
pub(super) fn rounded(value: f64) -> f64 {
    (value * 10.0).round() / 10.0
}

/// Means of the functions in a run of their task.
fn shares(image: &Image, tasks: &Tasks, debug: &Debug) -> BTreeMap<String, f64> {
    let mut sums = BTreeMap::new();
    for (e, task) in tasks {
        let name = names::task(image, *e);
        let wanted: Vec<_> = FUNCTIONS.iter().filter(|f| f.0 == name).collect();
        for (address, cost) in task.places.iter().filter(|_| !wanted.is_empty()) {
            let inside = debug.functions(*address);
            for (_, row, _) in wanted.iter().filter(|f| inside.iter().any(|i| i.contains(f.2))) {
                *sums.entry((*row).to_owned()).or_insert(0.0) += cost.estimate() as f64 / task.runs.len() as f64;
            }
        }
    }
    sums.into_iter().map(|(name, cycles)| (name, rounded(cycles))).collect()
}

/// Instead of the name of a task: every one, by function of the image.
const ALL: &str = "all";

/// What each function of the image takes of the processor and how much of that it waits for flash and peripherals, with its bytes: by
/// this memory.x says what lies in RAM.
fn functions(image: &Image, tasks: &Tasks) -> String {
    let starts: BTreeMap<u32, &str> =
        image.symbols().filter(|(name, _)| !name.starts_with('$')).map(|(name, at)| (at & !1, name)).collect();
    let mut sums: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
    for (address, cost) in tasks.values().flat_map(|task| &task.places) {
        let Some((start, _)) = starts.range(..=*address).next_back() else { continue };
        let sum = sums.entry(*start).or_default();
        sum.0 += 100.0 * cost.estimate() as f64 / scenes::LENGTH as f64;
        sum.1 += 100.0 * cost.waits as f64 / scenes::LENGTH as f64;
    }
    let mut sums: Vec<_> = sums.into_iter().collect();
    sums.sort_by(|a, b| b.1.1.total_cmp(&a.1.1));
    let mut text = String::from("moving: percent of the processor, of that waiting, bytes, function\n");
    for (start, (share, waits)) in sums {
        let end = starts.range(start + 1..).next().map_or(start, |(end, _)| *end);
        text += &format!("{share:6.2} {waits:6.2} {:6}  {}\n", end - start, starts.get(&start).unwrap_or(&"?"));
    }
    text
}

/// Where a task spends its cycles in a scene: functions that are not inlined into others, and what is inlined into them, cycles a run.
///
/// # Errors
/// When the firmware does not erode.
pub fn profile(image: &Image, wanted: &str) -> Result<String> {
    let debug = Rc::new(Debug::new(image)?);
    let scenes = scenes::run(image, &debug)?;
    if wanted == ALL {
        return Ok(functions(image, &scenes.moving));
    }
    let mut text = String::new();
    for (scene, tasks) in [("rest", &scenes.rest), ("fast", &scenes.fast), ("moving", &scenes.moving)] {
        let Some((_, task)) = tasks.iter().find(|(e, _)| names::task(image, **e) == wanted) else { continue };
        let mut sums: BTreeMap<String, (f64, f64)> = BTreeMap::new();
        let runs = task.runs.len() as f64;
        for (address, cost) in &task.places {
            let inside = debug.functions(*address);
            let chain: Vec<&str> = inside.iter().rev().map(|name| name.rsplit("::").next().unwrap_or(name)).collect();
            let sum = sums.entry(chain.join(" > ")).or_default();
            sum.0 += cost.estimate() as f64 / runs;
            sum.1 += cost.instructions as f64 / runs;
        }
        let mut sums: Vec<_> = sums.into_iter().collect();
        sums.sort_by(|a, b| b.1.0.total_cmp(&a.1.0));
        let all: f64 = sums.iter().map(|sum| sum.1.0).sum();
        text += &format!("{scene}: {wanted}, {all:.1} cycles a run\n");
        for (chain, (cycles, instructions)) in sums.iter().take_while(|sum| sum.1.0 >= 1.0) {
            text += &format!("{cycles:8.1} {instructions:8.1}  {chain}\n");
        }
    }
    Ok(text)
}

fn scene(image: &Image, tasks: &Tasks, load: &BTreeMap<Exception, f64>) -> Scene {
    let mut scene = Scene::default();
    for (e, task) in tasks {
        let name = names::task(image, *e);
        let Some(mut figures) = Figures::of(&task.runs) else { continue };
        figures.mean = rounded(figures.mean);
        scene.tasks.insert(name, figures);
    }
    scene.load = load.iter().map(|(e, share)| (names::task(image, *e), 100.0 * share)).collect();
    scene.load_percent = rounded(scene.load.values().sum());
    scene
}

impl Measured {
    /// Names of the scenes, and the scenes.
    pub fn scenes(&self) -> [(&'static str, &Scene); 3] {
        [("rest", &self.scenes.rest), ("moving", &self.scenes.moving), ("pulses-100khz", &self.scenes.fast)]
    }
}

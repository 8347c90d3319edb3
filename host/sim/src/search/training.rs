//! The holes that are bored in a search, and the score of parameters.
//!
//! None of them is reported: other depths of the same machines, and numbers of the process model that are off by up to 20 % at random,
//! by seeds that no comparison uses. The reference is the head's default law with the scenario's gain, in the same hole.

use super::space::Law;
use super::table::Tried;
use crate::bore;
use crate::observe::Recorder;
use crate::pool;
use crate::report::Report;
use crate::run::{Job, Setup};
use clap::ValueEnum;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Law of the reference.
const REFERENCE: &str = "feed.law=increment_by_error";
/// Share by which unpublished numbers of the model are off.
const PERTURBED: f64 = 0.2;
/// Seeds, far from those of comparisons.
const SEEDS: [u64; 2] = [7_001, 7_002];
/// What a hole that is not finished counts: the time of so many references.
const UNFINISHED: f64 = 4.0;
/// What a percent more arcs than the reference, and a percent more wear beyond two, costs: as much as a percent of time, five and one
/// times (chosen before the first search).
const ARCS: f64 = 0.05;
const WEAR: f64 = 1.0;
const WEAR_FREE: f64 = 1.02;

/// Machines for which there are training holes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Machine {
    /// \[G\]'s, 0.2 mm at 100 kHz, both settings of the veil
    Micro,
    /// \[R\]'s, 3 mm at 5 kHz
    Sinker,
}

impl Machine {
    pub fn name(self) -> &'static str {
        match self {
            Machine::Micro => "micro",
            Machine::Sinker => "sinker",
        }
    }

    /// Scenario, what is different, and the depth to bore, mm.
    fn holes(self) -> &'static [(&'static str, &'static [&'static str], f64)] {
        match self {
            Machine::Micro => {
                &[("micro-blind", &["model.depth_um=300"], 0.03), ("micro-blind-clear", &["model.depth_um=600"], 0.03)]
            }
            Machine::Sinker => &[("sinker", &["model.depth_um=300"], 0.05), ("sinker", &["model.depth_um=1000"], 0.05)],
        }
    }
}

/// The holes.
pub struct Training {
    jobs: Vec<Job>,
    fingerprint: String,
}

/// What is scored of a hole; `None`: not finished.
#[derive(Clone, Copy, Debug)]
pub struct Figures(Option<[f64; 3]>);

impl Training {
    /// The holes of a machine.
    pub fn new(machine: Machine, depth_mm: Option<f64>) -> Result<Training, String> {
        let mut jobs = Vec::new();
        for (name, different, own_mm) in machine.holes() {
            let mut setup = Setup::load(name)?;
            different.iter().chain(&[REFERENCE]).try_for_each(|assignment| setup.set(assignment))?;
            let depth_mm = depth_mm.unwrap_or(*own_mm);
            let range = bore::depth_range_mm(&setup);
            if !range.contains(&depth_mm) {
                return Err(format!("--depth-mm {depth_mm}: must be from {} to {} mm", range.start(), range.end()));
            }
            for seed in SEEDS {
                let mut setup = setup.clone();
                setup.process.perturb(PERTURBED, seed);
                jobs.push(Job {
                    setup,
                    depth_mm,
                    path: None,
                    table: None,
                    seed,
                    surrogate: false,
                    coarse_error_um: 0.0,
                });
            }
        }
        let depth_mm = jobs.first().map_or(0.0, |job| job.depth_mm);
        let fingerprint = format!("{}-holes-of-{depth_mm}-mm-{}", jobs.len(), env!("CARGO_PKG_VERSION"));
        Ok(Training { jobs, fingerprint })
    }

    /// Names these holes.
    pub fn fingerprint(&self) -> &str {
        &self.fingerprint
    }

    /// Whether a law is one for this machine.
    pub fn fits(&self, law: &Law) -> bool {
        let middle = law.values(&vec![0.5; law.dimensions.len()]);
        self.jobs.iter().all(|job| (law.settings)(&job.setup, &middle).is_some())
    }

    /// Figures of the default law.
    pub fn references(&self, workers: usize) -> Result<Vec<Figures>, String> {
        let references = bore_all(&self.jobs, workers)?;
        if references.iter().any(|figures| figures.0.is_none()) {
            return Err("the reference does not finish a training hole".into());
        }
        Ok(references)
    }

    /// Score of a law's values: the mean logarithm of its time over the reference's, and what arcs and wear cost.
    pub fn try_it(&self, law: &Law, values: &[f64], references: &[Figures], workers: usize) -> Result<Tried, String> {
        let mut settings = Vec::new();
        let mut jobs = Vec::new();
        for job in &self.jobs {
            let mut job = job.clone();
            settings = (law.settings)(&job.setup, values).ok_or("no law for this machine")?;
            settings.iter().try_for_each(|assignment| job.setup.set(assignment))?;
            jobs.push(job);
        }
        let figures = bore_all(&jobs, workers)?;
        let n = figures.len() as f64;
        let mut tried = Tried { settings: settings.join(" "), ..Tried::default() };
        for (figures, reference) in figures.iter().zip(references) {
            let [time_0, arcs_0, wear_0] = reference.0.unwrap_or([1.0; 3]);
            let (time, arcs, wear) = match figures.0 {
                Some([time, arcs, wear]) => (time / time_0, arcs, wear / wear_0),
                None => (UNFINISHED, arcs_0, 1.0),
            };
            tried.unfinished += u32::from(figures.0.is_none());
            tried.score += (time.ln() + ARCS * (arcs - arcs_0).max(0.0) + WEAR * (wear - WEAR_FREE).max(0.0)) / n;
            tried.time_ratio += time.ln() / n;
            tried.arc_percent += arcs / n;
            tried.reference_arc_percent += arcs_0 / n;
            tried.wear_ratio += wear / n;
        }
        tried.time_ratio = tried.time_ratio.exp();
        Ok(tried)
    }
}

/// Bores them all, in their order.
fn bore_all(jobs: &[Job], workers: usize) -> Result<Vec<Figures>, String> {
    let mut all = vec![Figures(None); jobs.len()];
    let numbers: Vec<usize> = (0..jobs.len()).collect();
    let one = |number: &usize| (*number, bore_one(&jobs[*number]));
    pool::run_all(&numbers, workers, one, |(number, figures)| {
        all[number] = figures;
        Ok(())
    })?;
    Ok(all)
}

/// A hole. Whatever goes wrong, it is not finished.
fn bore_one(job: &Job) -> Figures {
    let made = catch_unwind(AssertUnwindSafe(|| {
        bore::check(&job.setup).ok()?;
        let mut recorder = Recorder::new(None, false).ok()?;
        let outcome = bore::bore(job, &mut recorder, &mut |_| {}).ok()?;
        let report = Report::new(job, &outcome, &recorder.statistics.figures(), 0.0);
        let done = report.completed.then_some([
            report.machining_time_s.max(1e-3),
            100.0 * report.arc_ratio?,
            report.wear_mm?.max(1e-6),
        ])?;
        Some(done)
    }));
    Figures(made.ok().flatten())
}

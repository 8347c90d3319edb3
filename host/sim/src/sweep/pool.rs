//! Runs on every core.

use super::grid::{Grid, Run};
use crate::bore;
use crate::observe::Recorder;
use crate::report::Report;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::channel;
use std::thread;

/// What came of a run.
pub type Done = Result<Report, String>;

/// Makes these runs with so many workers and hands over each as it finishes, in the thread of the caller. One that fails,
/// however it does, is handed over as well.
///
/// # Errors
/// That of `finished`; runs that have begun still end, no further ones begin.
pub fn run_all(
    grid: &Grid,
    numbers: &[usize],
    workers: usize,
    mut finished: impl FnMut(&Run<'_>, Done) -> Result<(), String>,
) -> Result<(), String> {
    let next = AtomicUsize::new(0);
    thread::scope(|scope| {
        let (sender, receiver) = channel();
        for _ in 0..workers.min(numbers.len()) {
            let (sender, next) = (sender.clone(), &next);
            scope.spawn(move || {
                while let Some(run) = numbers.get(next.fetch_add(1, Ordering::Relaxed)).and_then(|n| grid.run(*n)) {
                    let done = make(&run);
                    if sender.send((run, done)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        // An error drops the receiver, which stops the workers.
        receiver.into_iter().try_for_each(|(run, done)| finished(&run, done))
    })
}

fn make(run: &Run<'_>) -> Done {
    if let Some(refusal) = run.refusal {
        return Err(refusal.into());
    }
    let made = catch_unwind(AssertUnwindSafe(|| {
        let mut recorder = Recorder::new(None, false)?;
        let outcome = bore::bore(&run.job, &mut recorder, &mut |_| {})?;
        // The time it took is that of a computer with other things to do, and no figure of the run.
        Ok(Report::new(&run.job, &outcome, &recorder.statistics.figures(), 0.0))
    }));
    made.unwrap_or_else(|_| Err("the simulation broke off; see the message on stderr".into()))
}

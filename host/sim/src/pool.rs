//! Runs work on every core.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::channel;
use std::thread;

/// Runs the work with this number of workers; passes each result as it is ready, in the thread of the caller.
///
/// # Errors
/// That of `finished`; pieces that have begun still end, no further ones begin.
pub fn run_all<W: Sync, D: Send>(
    work: &[W],
    workers: usize,
    make: impl Fn(&W) -> D + Sync,
    mut finished: impl FnMut(D) -> Result<(), String>,
) -> Result<(), String> {
    let next = AtomicUsize::new(0);
    thread::scope(|scope| {
        let (sender, receiver) = channel();
        for _ in 0..workers.min(work.len()) {
            let (sender, next, make) = (sender.clone(), &next, &make);
            scope.spawn(move || {
                while let Some(piece) = work.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if sender.send(make(piece)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        // An error drops the receiver, which stops the workers.
        receiver.into_iter().try_for_each(&mut finished)
    })
}

/// The requested number of workers, or one per core.
pub fn workers(jobs: Option<u16>) -> usize {
    jobs.map_or_else(|| thread::available_parallelism().map_or(1, usize::from), usize::from)
}

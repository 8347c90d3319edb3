//! Runs by seed, and their means.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;

/// A mean and its standard error.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mean {
    /// Mean.
    pub of: f64,
    /// Standard error.
    pub error: f64,
}

impl From<Mean> for (f64, f64) {
    fn from(mean: Mean) -> (f64, f64) {
        (mean.of, mean.error)
    }
}

impl Mean {
    /// Of these.
    pub fn new(all: &[f64]) -> Mean {
        let n = all.len().max(1) as f64;
        let of = all.iter().sum::<f64>() / n;
        let squares = all.iter().map(|x| (x - of) * (x - of)).sum::<f64>();
        Mean { of, error: (squares / (n - 1.0).max(1.0) / n).sqrt() }
    }

    /// Share by which another is less, in percent, with its error.
    pub fn gain(&self, other: &Mean) -> Mean {
        let ratio = other.of / self.of;
        let (a, b) = (other.error / other.of, self.error / self.of);
        Mean { of: 100.0 * (1.0 - ratio), error: 100.0 * ratio * (a * a + b * b).sqrt() }
    }
}

/// The largest; not a number when one of them is not, so that nothing passes that was not found.
pub fn largest(of: impl IntoIterator<Item = f64>) -> f64 {
    of.into_iter().fold(f64::NEG_INFINITY, |most, x| if most.is_nan() || most > x { most } else { x })
}

/// What `run` gives for each of these, in their order, on all processors.
pub fn each<T: Sync, R: Send>(of: &[T], run: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::with_capacity(of.len()));
    let threads = thread::available_parallelism().map_or(1, usize::from);
    thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while let Some((k, item)) = {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    of.get(k).map(|item| (k, item))
                } {
                    let result = run(item);
                    results.lock().unwrap_or_else(PoisonError::into_inner).push((k, result));
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(k, _)| *k);
    results.into_iter().map(|(_, result)| result).collect()
}

//! How often each class was seen of late.

use super::class::{CLASSES, Class};

/// Most looks that are remembered: one a millisecond.
pub const WINDOW: usize = BUCKETS * LOOKS as usize;
/// They are forgotten so many at a time: a look each would take four times the memory.
const LOOKS: u8 = 25;
const BUCKETS: usize = 8;

/// Classes of the last 176 to 200 looks.
#[derive(Clone, Debug, Default)]
pub struct Shares {
    /// Looks of each class, by number of the class.
    buckets: [[u8; CLASSES]; BUCKETS],
    /// Their sums.
    sums: [u8; CLASSES],
    /// Which is filled, and how many looks it has.
    newest: u8,
    filled: u8,
}

impl Shares {
    /// One more look.
    pub fn add(&mut self, class: Class) {
        if self.filled == LOOKS {
            self.filled = 0;
            self.newest = if usize::from(self.newest) + 1 < BUCKETS { self.newest + 1 } else { 0 };
            if let Some(bucket) = self.buckets.get_mut(usize::from(self.newest)) {
                for (sum, forgotten) in self.sums.iter_mut().zip(core::mem::take(bucket)) {
                    *sum = sum.saturating_sub(forgotten);
                }
            }
        }
        self.filled += 1;
        let bucket = self.buckets.get_mut(usize::from(self.newest));
        let count = bucket.and_then(|bucket| bucket.get_mut(class as usize));
        if let (Some(count), Some(sum)) = (count, self.sums.get_mut(class as usize)) {
            (*count, *sum) = (count.saturating_add(1), sum.saturating_add(1));
        }
    }

    /// Looks of each class, in the order of [`Class`]: open, spark, arc, short, no pulse, uncertain.
    pub fn counts(&self) -> [u8; CLASSES] {
        self.sums
    }
}

const _: () = assert!(WINDOW <= u8::MAX as usize);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_counts_are_those_of_the_last_looks() {
        let all = [Class::Open, Class::Spark, Class::Arc, Class::Short, Class::NoPulse, Class::Uncertain];
        let mut shares = Shares::default();
        let mut added = Vec::new();
        for n in 0..1000usize {
            let class = all[(n * n / 7 + n) % CLASSES];
            shares.add(class);
            added.push(class);
            let remembered = shares.counts().iter().map(|count| usize::from(*count)).sum::<usize>();
            assert!(
                remembered <= WINDOW && (remembered > WINDOW - usize::from(LOOKS) || remembered == n + 1),
                "{remembered}"
            );
            for class in all {
                let of = added.iter().rev().take(remembered).filter(|other| **other == class).count();
                assert_eq!(usize::from(shares.counts()[class as usize]), of, "{class:?} after {n}");
            }
        }
    }
}

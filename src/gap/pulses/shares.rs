//! How often each class was seen of late.

use super::class::{CLASSES, Class};

/// Most milliseconds that are remembered.
pub const WINDOW: usize = BUCKETS * MILLISECONDS as usize;
/// They are forgotten so many at a time.
const MILLISECONDS: u8 = 25;
const BUCKETS: usize = 8;

/// Classes of the last 176 to 200 ms.
#[derive(Clone, Debug, Default)]
pub struct Shares {
    /// Pulses of each class, by number of the class.
    buckets: [[u16; CLASSES]; BUCKETS],
    /// Their sums.
    sums: [u16; CLASSES],
    /// Which is filled, and how many milliseconds it has.
    newest: u8,
    filled: u8,
}

impl Shares {
    /// One more millisecond: pulses of each class, in the order of [`Class`](super::Class). 65 535 of a class in the window are
    /// counted, three times what 100 kHz make.
    pub fn add(&mut self, pulses: &[u16; CLASSES]) {
        if self.filled == MILLISECONDS {
            self.filled = 0;
            self.newest = if usize::from(self.newest) + 1 < BUCKETS { self.newest + 1 } else { 0 };
            if let Some(bucket) = self.buckets.get_mut(usize::from(self.newest)) {
                for (sum, forgotten) in self.sums.iter_mut().zip(core::mem::take(bucket)) {
                    *sum = sum.saturating_sub(forgotten);
                }
            }
        }
        self.filled += 1;
        let Some(bucket) = self.buckets.get_mut(usize::from(self.newest)) else { return };
        for ((count, sum), more) in bucket.iter_mut().zip(&mut self.sums).zip(pulses) {
            // What the sum has no room for is not in the bucket either, or it would be taken off again.
            let fits = (*more).min(u16::MAX - *sum);
            *sum += fits;
            *count += fits;
        }
    }

    /// Share of each class in the pulses, half percents, rounded; of no pulse: in the milliseconds.
    pub fn half_percents(&self) -> [u8; CLASSES] {
        let none = Class::NoPulse as usize;
        let counts = self.sums.map(u32::from);
        let pulses =
            counts.iter().enumerate().filter(|(class, _)| *class != none).fold(0, |sum, (_, count)| sum + count);
        let mut class = 0;
        counts.map(|count| {
            let all = if class == none { WINDOW as u32 } else { pulses };
            class += 1;
            (200 * count + all / 2).checked_div(all).unwrap_or(0).min(200) as u8
        })
    }

    /// Pulses of each class: open, spark, arc, short, no pulse, uncertain.
    pub fn counts(&self) -> [u16; CLASSES] {
        self.sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_counts_are_those_of_the_last_milliseconds() {
        let mut shares = Shares::default();
        let mut added: Vec<[u16; CLASSES]> = Vec::new();
        for n in 0..1000usize {
            let ms = core::array::from_fn(|class| ((n * n / 7 + 3 * n * class) % 97) as u16);
            shares.add(&ms);
            added.push(ms);
            // What is forgotten is forgotten 25 at a time.
            let remembered = if n < WINDOW { n + 1 } else { WINDOW - 24 + n % 25 };
            for (class, count) in shares.counts().into_iter().enumerate() {
                let of: u16 = added.iter().rev().take(remembered).map(|ms| ms[class]).sum();
                assert_eq!(count, of, "{class} after {n}");
            }
        }
    }

    #[test]
    fn shares_are_those_of_all_pulses_and_no_pulse_is_one_of_the_milliseconds() {
        let mut shares = Shares::default();
        assert_eq!(shares.half_percents(), [0; CLASSES]);
        (0..150).for_each(|_| shares.add(&[3, 90, 0, 7, 0, 0]));
        (0..50).for_each(|_| shares.add(&[0, 0, 0, 0, 1, 0]));
        assert_eq!(shares.half_percents(), [6, 180, 0, 14, 50, 0]);
    }

    #[test]
    fn more_than_can_be_counted_is_forgotten_as_it_came() {
        let mut shares = Shares::default();
        for _ in 0..30 {
            shares.add(&[u16::MAX, 1, 0, 0, 0, 0]);
        }
        assert_eq!(shares.counts(), [u16::MAX, 30, 0, 0, 0, 0]);
        for _ in 0..WINDOW {
            shares.add(&[0, 1, 0, 0, 0, 0]);
        }
        assert_eq!(shares.counts()[0], 0);
    }
}

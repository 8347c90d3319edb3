//! The newest reading on its way from the gap task to the servo task, without a lock.
//!
//! One core; the writer may pre-empt the reader at any instruction and always finishes before the reader goes on. The writer
//! numbers its readings: a number that has not moved says that nothing is new, one that moves while the values are read
//! says that they do not belong together. The writer comes once a tick, so the second attempt succeeds.

use super::{GapReading, Quality};
use crate::units::{Volts, rare};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed, Ordering::SeqCst, compiler_fence};

/// A reading that one task writes and a slower one reads.
#[derive(Debug, Default)]
pub struct Latest {
    number: AtomicU32,
    filtered: AtomicU32,
    block: AtomicU32,
    quality: AtomicU32,
    short_ticks: AtomicU32,
}

impl Latest {
    /// For a `static`; no reading yet.
    pub const fn new() -> Self {
        Latest {
            number: AtomicU32::new(0),
            filtered: AtomicU32::new(0),
            block: AtomicU32::new(0),
            quality: AtomicU32::new(0),
            short_ticks: AtomicU32::new(0),
        }
    }

    /// Writes a reading. For the one writer.
    #[inline]
    pub fn write(&self, reading: &GapReading) {
        self.filtered.store(reading.filtered.0.to_bits(), Relaxed);
        self.block.store(reading.block.0.to_bits(), Relaxed);
        self.quality.store(reading.quality as u32, Relaxed);
        self.short_ticks.store(reading.short_ticks, Relaxed);
        self.number.store(self.number.load(Relaxed).wrapping_add(1), Relaxed);
    }

    /// Reads the newest reading into `reading`, whose quality becomes [`Quality::Missing`] when there is none since the call
    /// that left `seen` as it is; that was 0 at the start.
    #[inline]
    pub fn read(&self, seen: &mut u32, reading: &mut GapReading) {
        self.read_interrupted(seen, reading, || {});
    }

    #[inline(always)]
    fn read_interrupted(&self, seen: &mut u32, reading: &mut GapReading, mut interrupt: impl FnMut()) {
        let mut load = |value: &AtomicU32| {
            // The hardware keeps the order of loads for its own interrupts; the compiler has to be told.
            compiler_fence(SeqCst);
            let loaded = value.load(Relaxed);
            interrupt();
            compiler_fence(SeqCst);
            loaded
        };
        let mut number = load(&self.number);
        if number == *seen {
            rare();
            reading.quality = Quality::Missing;
            return;
        }
        for _ in 0..2 {
            let [filtered, block, grade, short_ticks] =
                [&self.filtered, &self.block, &self.quality, &self.short_ticks].map(&mut load);
            let after = load(&self.number);
            *reading = GapReading {
                filtered: Volts(f32::from_bits(filtered)),
                block: Volts(f32::from_bits(block)),
                quality: quality(grade),
                short_ticks,
            };
            *seen = number;
            if after == number {
                break;
            }
            rare();
            number = after;
        }
    }
}

/// The quality of a number.
#[inline]
fn quality(number: u32) -> Quality {
    match number {
        1 => Quality::Valid,
        2 => Quality::NoGate,
        3 => Quality::Saturated,
        4 => Quality::Reversed,
        _ => Quality::Missing,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(n: u32) -> GapReading {
        GapReading {
            filtered: Volts(n as f32),
            block: Volts(n as f32 + 0.5),
            quality: quality(1 + n % 4),
            short_ticks: n,
        }
    }

    #[test]
    fn every_quality_arrives_as_it_left() {
        for quality in [Quality::Missing, Quality::Valid, Quality::NoGate, Quality::Saturated, Quality::Reversed] {
            let (latest, mut seen, mut there) = (Latest::new(), 0, GapReading::default());
            let here = GapReading { quality, ..reading(3) };
            latest.write(&here);
            latest.read(&mut seen, &mut there);
            assert_eq!(there, here);
        }
    }

    #[test]
    fn nothing_new_is_the_old_reading_marked_as_missing() {
        let (latest, mut seen, mut there) = (Latest::new(), 0, GapReading::default());
        latest.read(&mut seen, &mut there);
        assert_eq!(there, GapReading::default());
        latest.write(&reading(1));
        latest.write(&reading(2));
        latest.read(&mut seen, &mut there);
        assert_eq!(there, reading(2));
        latest.read(&mut seen, &mut there);
        assert_eq!(there, GapReading { quality: Quality::Missing, ..reading(2) });
    }

    #[test]
    fn a_reading_is_of_one_piece_wherever_the_writer_comes() {
        for at in 0..6 {
            let (latest, mut seen, mut there) = (Latest::new(), 0, GapReading::default());
            latest.write(&reading(1));
            let mut loads = 0;
            latest.read_interrupted(&mut seen, &mut there, || {
                if loads == at {
                    latest.write(&reading(2));
                }
                loads += 1;
            });
            let newest = at < 5;
            assert_eq!(there, reading(if newest { 2 } else { 1 }), "written at load {at}");
            // What was read is not new a second time; what came too late is.
            latest.read(&mut seen, &mut there);
            assert_eq!(there.quality == Quality::Missing, newest);
        }
    }
}

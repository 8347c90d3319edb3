//! Foreign traffic: frames of nobody's concern, as many as fill a share of a wire.

use crate::Frame;
use crate::hub::{Detached, Hub, Sink};
use embedded_can::{ExtendedId, Frame as _, StandardId};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Frames of 11-bit identifiers that CiA 301 leaves to nobody, and of 29-bit ones, with varying data of all lengths; the
/// same ones every time.
#[derive(Clone, Debug)]
pub struct Frames(u64);

impl Default for Frames {
    fn default() -> Frames {
        Frames(1)
    }
}

impl Iterator for Frames {
    type Item = Frame;

    fn next(&mut self) -> Option<Frame> {
        // A congruential generator (Knuth, MMIX) is random enough to look foreign.
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let random = self.0 >> 8;
        let data = random.to_le_bytes();
        let data = &data[..(random >> 32) as usize % 9];
        if random.is_multiple_of(4) {
            Frame::new(ExtendedId::new((random >> 16) as u32 & 0x1FFF_FFFF)?, data)
        } else {
            Frame::new(StandardId::new(0x680 + (random >> 16) as u16 % 0x60)?, data)
        }
    }
}

/// Fills the bus until it is dropped.
pub struct Filler(Arc<AtomicBool>);

/// Hears nothing.
struct Deaf;

impl Sink for Deaf {
    fn deliver(&self, _: &Frame) -> Result<(), Detached> {
        Ok(())
    }
}

impl Filler {
    /// Fills a share of a wire of `bit_rate` bit/s, besides what the others send.
    pub fn new(hub: &Hub, share: f64, bit_rate: u32) -> Filler {
        let stop = Arc::new(AtomicBool::new(false));
        let filler = Filler(stop.clone());
        let port = hub.attach(Arc::new(Deaf));
        thread::spawn(move || {
            let (start, mut sent) = (Instant::now(), 0.0);
            for frame in Frames::default() {
                while sent > start.elapsed().as_secs_f64() * share * f64::from(bit_rate) {
                    thread::sleep(Duration::from_micros(100));
                    if stop.load(Ordering::Relaxed) {
                        return;
                    }
                }
                sent += f64::from(frame.bits());
                port.send(&frame);
            }
        });
        filler
    }
}

impl Drop for Filler {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_frames_are_of_both_kinds_all_lengths_and_no_business_of_canopen() {
        let frames: Vec<Frame> = Frames::default().take(10_000).collect();
        for length in 0..=8 {
            assert!(frames.iter().any(|frame| frame.dlc() == length), "{length}");
        }
        let long = frames.iter().filter(|frame| frame.is_extended()).count();
        assert!((2000..3000).contains(&long), "{long}");
        for frame in &frames {
            let embedded_can::Id::Standard(id) = frame.id() else { continue };
            assert!((0x680..0x6E0).contains(&id.as_raw()), "{frame:?}");
        }
    }

    #[test]
    fn a_load_that_is_asked_for_is_made() {
        let hub = Hub::default();
        let _filler = Filler::new(&hub, 0.95, 1_000_000);
        let (before, start) = (hub.traffic(), Instant::now());
        thread::sleep(Duration::from_millis(500));
        let share = hub.traffic().occupancy(before, start.elapsed().as_secs_f64(), 1_000_000);
        assert!((0.90..1.0).contains(&share), "{share}");
    }
}

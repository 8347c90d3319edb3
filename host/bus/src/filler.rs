//! Foreign traffic: frames that no node uses, as many as fill a share of a bus.

use crate::Frame;
use crate::hub::{Detached, Hub, Sink};
use embedded_can::{ExtendedId, Frame as _, StandardId};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Frames of 11-bit identifiers that CiA 301 does not assign, and of 29-bit ones, with varying data of all lengths; the
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

/// Receives nothing.
struct Deaf;

impl Sink for Deaf {
    fn deliver(&self, _: &Frame) -> Result<(), Detached> {
        Ok(())
    }
}

impl Filler {
    /// Fills a share of a bus of `bit_rate` bit/s, in addition to other traffic.
    pub fn new(hub: &Hub, share: f64, bit_rate: u32) -> Filler {
        let stop = Arc::new(AtomicBool::new(false));
        let filler = Filler(stop.clone());
        let port = hub.attach(Arc::new(Deaf));
        thread::spawn(move || {
            let (start, mut pace) = (Instant::now(), Pace { share, bit_rate, sent: 0.0 });
            for frame in Frames::default() {
                while !pace.is_due(start.elapsed()) {
                    thread::sleep(Duration::from_micros(100));
                    if stop.load(Ordering::Relaxed) {
                        return;
                    }
                }
                pace.sent(&frame);
                port.send(&frame);
            }
        });
        filler
    }
}

/// When the next frame is due, so that a share of a wire is filled.
struct Pace {
    share: f64,
    bit_rate: u32,
    /// Bits so far.
    sent: f64,
}

impl Pace {
    fn is_due(&self, elapsed: Duration) -> bool {
        self.sent <= elapsed.as_secs_f64() * self.share * f64::from(self.bit_rate)
    }

    fn sent(&mut self, frame: &Frame) {
        self.sent += f64::from(frame.bits());
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
    fn a_load_that_is_asked_for_is_made_however_late_the_thread_comes() {
        for step_us in [100, 3_000, 40_000] {
            let hub = Hub::default();
            let (before, port) = (hub.traffic(), hub.attach(Arc::new(Deaf)));
            let (mut pace, mut frames) = (Pace { share: 0.95, bit_rate: 1_000_000, sent: 0.0 }, Frames::default());
            for elapsed in (0..=500_000).step_by(step_us).map(Duration::from_micros) {
                while pace.is_due(elapsed) {
                    let frame = frames.next().unwrap();
                    pace.sent(&frame);
                    port.send(&frame);
                }
            }
            let last_s = (500_000 / step_us * step_us) as f64 * 1e-6;
            let share = hub.traffic().occupancy(before, last_s, 1_000_000);
            assert!((0.95..0.951).contains(&share), "{step_us} us: {share}");
        }
    }

    #[test]
    fn a_filler_sends_until_it_is_dropped() {
        let hub = Hub::default();
        let filler = Filler::new(&hub, 0.95, 1_000_000);
        while hub.traffic().frames < 100 {
            thread::yield_now();
        }
        drop(filler);
        while hub.ports() > 0 {
            thread::yield_now();
        }
    }
}

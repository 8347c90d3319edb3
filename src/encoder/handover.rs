//! From the edge decoder to the timer and back, without losing a count.
//!
//! The decoder times its edges, so it leads; above its rated speed the edge interrupt masks itself (a *storm*) and the timer
//! leads. Both are read in the timer's frame: the decoder's count plus an offset. After a storm the decoder has missed
//! counts; it leads again when two readings in a row agree on the new offset, so that an edge between the readings of the
//! two counters cannot become a permanent error.

use super::{Mark, Snapshot};
use edm_hal_shim::encoder::RawCount;

/// Which counter leads.
#[derive(Clone, Copy, Debug, Default)]
pub struct Handover {
    /// What the decoder's count lacks to the timer's.
    offset: u32,
    timer_leads: bool,
    /// Offset at the reading before, while the timer leads.
    candidate: Option<u32>,
}

impl Handover {
    /// The decoder leads; both counters stand at the same count.
    pub const fn new() -> Self {
        Handover { offset: 0, timer_leads: false, candidate: None }
    }

    /// Whether the timer is needed for the reading that the loops use.
    #[inline]
    pub fn timer_leads(&self) -> bool {
        self.timer_leads
    }

    /// The reading that the loops use while the decoder leads.
    #[inline]
    pub fn count(&self, decoder: RawCount) -> RawCount {
        RawCount { count: decoder.count.wrapping_add(self.offset), ..decoder }
    }

    /// A mark of the decoder in the frame of the readings.
    #[inline]
    pub fn mark(&self, mark: Mark) -> Mark {
        Mark { count: mark.count.wrapping_add(self.offset), ..mark }
    }

    /// The reading that the loops use, from one reading of each counter; `storm` when the edge interrupt masked itself
    /// since the last one.
    pub fn read(&mut self, decoder: Snapshot, timer: RawCount, storm: bool) -> Snapshot {
        let offset = timer.count.wrapping_sub(decoder.raw.count);
        if storm {
            self.timer_leads = true;
            self.candidate = None;
        } else if self.timer_leads {
            if self.candidate == Some(offset) {
                self.offset = offset;
                self.timer_leads = false;
            }
            self.candidate = Some(offset);
        }
        let mut snapshot = decoder;
        snapshot.mark = self.mark(snapshot.mark);
        if self.timer_leads {
            snapshot.raw = timer;
        } else {
            snapshot.raw.count = snapshot.raw.count.wrapping_add(self.offset);
        }
        snapshot
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoder(count: u32) -> Snapshot {
        Snapshot { raw: RawCount { count, last_edge: 7, ..RawCount::default() }, ..Snapshot::default() }
    }

    fn timer(count: u32) -> RawCount {
        RawCount { count, last_edge: 9, ..RawCount::default() }
    }

    #[test]
    fn the_decoder_leads_until_a_storm() {
        let mut handover = Handover::new();
        let reading = handover.read(decoder(100), timer(101), false);
        assert_eq!((reading.raw.count, reading.raw.last_edge), (100, 7));
        let reading = handover.read(decoder(140), timer(350), true);
        assert_eq!((reading.raw.count, reading.raw.last_edge), (350, 9));
    }

    #[test]
    fn after_a_storm_the_decoder_leads_again_on_the_timers_count() {
        let mut handover = Handover::new();
        handover.read(decoder(140), timer(350), true);
        assert_eq!(handover.read(decoder(150), timer(370), false).raw, timer(370));
        // The second reading with the same offset.
        let reading = handover.read(decoder(155), timer(375), false);
        assert_eq!((reading.raw.count, reading.raw.last_edge), (375, 7));
        assert_eq!(handover.read(decoder(160), timer(380), false).raw.count, 380);
        assert!(!handover.timer_leads());
        assert_eq!(handover.count(decoder(165).raw).count, 385);
    }

    #[test]
    fn an_edge_between_the_two_readings_does_not_become_an_error() {
        let mut handover = Handover::new();
        handover.read(decoder(140), timer(350), true);
        // The timer was read one edge late, then right, then right again.
        handover.read(decoder(150), timer(371), false);
        assert_eq!(handover.read(decoder(155), timer(375), false).raw.last_edge, 9);
        let reading = handover.read(decoder(160), timer(380), false);
        assert_eq!((reading.raw.count, reading.raw.last_edge), (380, 7));
    }

    #[test]
    fn a_thousand_storms_across_the_wrap_lose_nothing() {
        let mut handover = Handover::new();
        let (mut truth, mut seen) = (u32::MAX - 50_000, u32::MAX - 50_000);
        handover.offset = 0;
        for storm in 0..1000 {
            truth = truth.wrapping_add(250);
            seen = seen.wrapping_add(40 + storm % 3);
            assert_eq!(handover.read(decoder(seen), timer(truth), true).raw.count, truth);
            for _ in 0..3 {
                truth = truth.wrapping_add(5);
                seen = seen.wrapping_add(5);
                assert_eq!(handover.read(decoder(seen), timer(truth), false).raw.count, truth);
            }
        }
    }

    #[test]
    fn a_mark_is_in_the_frame_of_the_count() {
        let mut handover = Handover::new();
        handover.read(decoder(0), timer(200), true);
        handover.read(decoder(0), timer(200), false);
        let mut marked = decoder(10);
        marked.mark.count = 6;
        let reading = handover.read(marked, timer(210), false);
        assert_eq!((reading.raw.count, reading.mark.count), (210, 206));
    }
}

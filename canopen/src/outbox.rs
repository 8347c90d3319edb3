//! Frames that wait to be sent, in the order in which the bus would choose.

use super::Frame;
use core::mem::swap;
use heapless::Vec;

/// Frames that can wait.
const LENGTH: usize = 16;

/// Frames by rising identifier, equal ones in the order of their making.
///
/// What repeats or can wait asks for room first and keeps its frame while there is none, so that a jammed bus costs
/// samples, never answers.
#[derive(Clone, Debug, Default)]
pub(super) struct Outbox(Vec<Frame, LENGTH>);

impl Outbox {
    /// Where frames of this and higher identifiers begin.
    fn from(&self, id: u16) -> usize {
        self.0.iter().take_while(|queued| queued.id() < id).count()
    }

    fn first(&mut self, id: u16) -> Option<&mut Frame> {
        let at = self.from(id);
        self.0.get_mut(at).filter(|queued| queued.id() == id)
    }

    /// Queues a frame; false when there is no room.
    #[inline(never)]
    pub fn put(&mut self, frame: Frame) -> bool {
        let at = self.from(frame.id().wrapping_add(1));
        let free = self.0.push(Frame::default()).is_ok();
        let mut moved = frame;
        if let (Some(tail), true) = (self.0.get_mut(at..), free) {
            tail.iter_mut().for_each(|place| swap(place, &mut moved));
        }
        free
    }

    /// Queues a frame in place of one of the same identifier that has not left yet: a fresh sample for a stale one.
    pub fn refresh(&mut self, frame: Frame) -> bool {
        match self.first(frame.id()) {
            Some(queued) => {
                *queued = frame;
                true
            }
            None => self.put(frame),
        }
    }

    fn remove(&mut self, at: usize) -> Option<Frame> {
        let mut moved = self.0.pop()?;
        let tail = self.0.get_mut(at..).unwrap_or(&mut []);
        tail.iter_mut().rev().for_each(|place| swap(place, &mut moved));
        Some(moved)
    }

    /// Takes the frame that goes first.
    pub fn take(&mut self) -> Option<Frame> {
        self.remove(0)
    }

    /// Whether a frame of this identifier waits.
    pub fn holds(&mut self, id: u16) -> bool {
        self.first(id).is_some()
    }

    /// Drops the frames of an identifier.
    pub fn discard(&mut self, id: u16) {
        while self.holds(id) {
            self.remove(self.from(id));
        }
    }

    /// Frames that still fit.
    pub fn room(&self) -> usize {
        LENGTH.saturating_sub(self.0.len())
    }

    /// Drops all.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(id: u16, content: u8) -> Frame {
        Frame::new(id, &[content]).unwrap()
    }

    #[test]
    fn the_lowest_identifier_leaves_first_and_equal_ones_in_order() {
        let mut out = Outbox::default();
        for (id, content) in [(0x581, 1), (0x181, 2), (0x701, 3), (0x581, 4), (0x81, 5)] {
            assert!(out.put(frame(id, content)));
        }
        let order: std::vec::Vec<_> = std::iter::from_fn(|| out.take()).map(|f| (f.id(), f.data()[0])).collect();
        assert_eq!(order, [(0x81, 5), (0x181, 2), (0x581, 1), (0x581, 4), (0x701, 3)]);
    }

    #[test]
    fn a_full_outbox_refuses_but_still_refreshes() {
        let mut out = Outbox::default();
        for id in 0..LENGTH as u16 {
            assert!(out.put(frame(id, 0)));
        }
        assert_eq!(out.room(), 0);
        assert!(!out.put(frame(3, 1)));
        assert!(!out.refresh(frame(0x700, 1)));
        assert!(out.refresh(frame(3, 9)));
        out.discard(0);
        assert_eq!(out.room(), 1);
        let contents: std::vec::Vec<_> = std::iter::from_fn(|| out.take()).map(|f| f.data()[0]).collect();
        assert_eq!(contents[..4], [0, 0, 9, 0]);
    }
}

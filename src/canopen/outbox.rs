//! Frames that wait to be sent, in the order in which the bus would choose.

use super::Frame;
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
    /// Queues a frame; false when there is no room.
    pub fn put(&mut self, frame: Frame) -> bool {
        let at = self.0.iter().position(|queued| queued.id() > frame.id()).unwrap_or(self.0.len());
        if self.0.push(frame).is_err() {
            return false;
        }
        if let Some(tail) = self.0.get_mut(at..) {
            tail.rotate_right(1);
        }
        true
    }

    /// Queues a frame in place of one of the same identifier that has not left yet: a fresh sample for a stale one.
    pub fn refresh(&mut self, frame: Frame) -> bool {
        match self.0.iter_mut().find(|queued| queued.id() == frame.id()) {
            Some(queued) => {
                *queued = frame;
                true
            }
            None => self.put(frame),
        }
    }

    /// Takes the frame that goes first.
    pub fn take(&mut self) -> Option<Frame> {
        let any = !self.0.is_empty();
        self.0.rotate_left(usize::from(any));
        self.0.pop()
    }

    /// Whether a frame of this identifier waits.
    pub fn holds(&self, id: u16) -> bool {
        self.0.iter().any(|queued| queued.id() == id)
    }

    /// Frames that still fit.
    pub fn room(&self) -> usize {
        LENGTH.saturating_sub(self.0.len())
    }

    /// Drops the frames of an identifier.
    pub fn discard(&mut self, id: u16) {
        self.0.retain(|queued| queued.id() != id);
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

//! A port for a program of this process: frames wait until it takes them, and wake it.

use crate::Frame;
use crate::hub::{Detached, Sink};
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Frames that can wait: half a second of a full bus of 1 Mbit/s.
pub const ROOM: usize = 4096;

/// Frames that wait. As in a controller, those that find no room are lost, and counted.
#[derive(Debug, Default)]
pub struct Mailbox {
    inner: Mutex<Inner>,
    bell: Condvar,
}

#[derive(Debug, Default)]
struct Inner {
    frames: VecDeque<Frame>,
    lost: u64,
    rung: bool,
}

impl Mailbox {
    /// Moves the waiting frames to the end of `frames`.
    pub fn take(&self, frames: &mut Vec<Frame>) {
        frames.extend(self.inner().frames.drain(..));
    }

    /// Waits until a frame is there, the mailbox is rung, or the time has come.
    pub fn wait(&self, until: Instant) {
        let mut inner = self.inner();
        while inner.frames.is_empty() && !inner.rung {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            inner = self.bell.wait_timeout(inner, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        inner.rung = false;
    }

    /// Ends the next or present [`Mailbox::wait`].
    pub fn ring(&self) {
        self.inner().rung = true;
        self.bell.notify_all();
    }

    /// Frames lost so far.
    pub fn lost(&self) -> u64 {
        self.inner().lost
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Sink for Mailbox {
    fn deliver(&self, frame: &Frame) -> Result<(), Detached> {
        let mut inner = self.inner();
        if inner.frames.len() < ROOM {
            inner.frames.push_back(*frame);
        } else {
            inner.lost += 1;
        }
        drop(inner);
        self.bell.notify_all();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Hub;
    use crate::hub::tests::{Memory, frame};
    use std::sync::Arc;
    use std::time::Duration;

    const DAY: Duration = Duration::from_secs(86_400);

    #[test]
    fn a_frame_wakes_whoever_waits() {
        let hub = Hub::default();
        let mailbox = Arc::new(Mailbox::default());
        let _port = hub.attach(mailbox.clone());
        let sender = hub.attach(Arc::new(Memory::default()));
        std::thread::spawn(move || sender.send(&frame(1)));
        // Would it not end the waiting, this would last for a day.
        mailbox.wait(Instant::now() + DAY);
        let mut frames = Vec::new();
        mailbox.take(&mut frames);
        assert_eq!(frames, [frame(1)]);
    }

    #[test]
    fn nothing_is_waited_for_beyond_the_time_and_a_ring_is_not_forgotten() {
        let mailbox = Mailbox::default();
        let start = Instant::now();
        mailbox.wait(start + Duration::from_millis(20));
        assert!(start.elapsed() >= Duration::from_millis(20));
        mailbox.ring();
        mailbox.wait(start + DAY);
    }

    #[test]
    fn what_finds_no_room_is_lost_and_counted() {
        let mailbox = Mailbox::default();
        for _ in 0..ROOM + 3 {
            mailbox.deliver(&frame(1)).unwrap();
        }
        let mut frames = Vec::new();
        mailbox.take(&mut frames);
        assert_eq!((frames.len(), mailbox.lost()), (ROOM, 3));
    }
}

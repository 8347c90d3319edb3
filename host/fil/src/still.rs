//! A world in which nothing happens by itself: constant voltages, levels set by tests, a CAN bus with one silent listener.

use edm_soc::{CanReply, Change, Drive, Frame, NEVER, Pin, World};
use std::collections::VecDeque;

/// The world.
#[derive(Clone, Debug)]
pub struct Still {
    /// Code of every conversion, by channel.
    pub codes: [u16; 19],
    /// Changes to come, oldest first.
    pub changes: VecDeque<(u64, Change)>,
    /// Frames the chip has sent, and when they ended.
    pub frames: Vec<(u64, Frame)>,
    /// What the chip has driven its pins with, and from when.
    pub drives: Vec<(u64, Pin, Drive)>,
}

impl Default for Still {
    fn default() -> Self {
        let mut codes = [0; 19];
        // The chip's own sources, at 3.3 V and 25 degrees: temperature, reference, half the battery.
        (codes[16], codes[17], codes[18]) = (930, 1502, 2048);
        Self { codes, changes: VecDeque::new(), frames: Vec::new(), drives: Vec::new() }
    }
}

impl World for Still {
    fn sample(&mut self, _: u8, channel: u8, _: u64) -> u16 {
        self.codes.get(usize::from(channel)).copied().unwrap_or(0)
    }
    fn next_change(&self) -> u64 {
        self.changes.front().map_or(NEVER, |c| c.0)
    }
    fn take_change(&mut self, at: u64) -> Option<Change> {
        self.changes.pop_front_if(|c| c.0 <= at).map(|c| c.1)
    }
    fn drive(&mut self, at: u64, pin: Pin, drive: Drive) {
        self.drives.push((at, pin, drive));
    }
    fn can_sent(&mut self, at: u64, frame: Frame) -> CanReply {
        self.frames.push((at, frame));
        CanReply::Acknowledged
    }
    fn dac(&mut self, _: u64, _: u8, _: u16) {}
}

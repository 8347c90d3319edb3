//! Tuning, 201Bh: the points of the response that the head measures, one frequency after the other.

use super::Drive;
use crate::canopen::objects::Item;
use crate::canopen::{Abort, Written};
use crate::head::{Change, Command, POINT_WORDS, POINTS, Point, Reason, State, TuneStep};

/// 201Bh:2 behind the steps of the head.
const FINISHED: i64 = 4;
const ENDED: i64 = 5;

/// 201Bh:3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Why {
    #[default]
    None,
    Held,
    Fault,
    Nothing,
}

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Tuned {
    /// One has begun since the start, and has not ended.
    begun: bool,
    runs: bool,
    /// The newest has come to its end, with every point.
    whole: bool,
    why: Why,
    count: u8,
    points: [[f32; POINT_WORDS]; POINTS],
}

impl Tuned {
    pub const NONE: Tuned = Tuned {
        begun: false,
        runs: false,
        whole: false,
        why: Why::None,
        count: 0,
        points: [[0.0; POINT_WORDS]; POINTS],
    };

    /// What an object reads; `step` is that of the head.
    pub fn number(&self, item: Item, step: TuneStep) -> i64 {
        match item {
            Item::TuneStep => match step {
                TuneStep::None if self.whole => FINISHED,
                TuneStep::None if self.begun => ENDED,
                step => step as i64,
            },
            Item::TuneWhy => self.why as i64,
            _ => self.count.into(),
        }
    }

    /// Length of 201Bh:5, bytes.
    pub fn length(&self) -> u32 {
        u32::from(self.count).wrapping_mul(size_of::<[f32; POINT_WORDS]>() as u32)
    }

    /// Its bytes.
    pub fn copy(&self, offset: u32, out: &mut [u8]) {
        for (byte, at) in out.iter_mut().zip(offset as usize..) {
            let word = self.points.as_flattened().get(at / size_of::<f32>());
            let bytes = word.copied().unwrap_or(0.0).to_bits().to_le_bytes();
            *byte = bytes.get(at % size_of::<f32>()).copied().unwrap_or(0);
        }
    }
}

impl Drive {
    /// Takes the response at a frequency.
    pub(super) fn tuned_at(&mut self, point: &Point) {
        if let Some(slot) = self.tuned.points.get_mut(usize::from(self.tuned.count)) {
            *slot = point.words();
            self.tuned.count = self.tuned.count.saturating_add(1);
        }
    }

    /// What a change of state means for it.
    pub(super) fn watch_tuning(&mut self, change: &Change) {
        let tuned = &mut self.tuned;
        if change.reason == Reason::TuningStarted {
            (tuned.begun, tuned.runs, tuned.whole) = (true, true, false);
            (tuned.why, tuned.count) = (Why::None, 0);
        } else if tuned.runs && change.from == State::Identifying {
            tuned.runs = false;
            tuned.whole = change.reason == Reason::Tuned && u32::from(tuned.count) >= self.active.head.tune.points;
            tuned.why = match change.reason {
                _ if tuned.whole => Why::None,
                Reason::Held => Why::Held,
                Reason::Tuned => Why::Nothing,
                _ => Why::Fault,
            };
        }
    }

    /// 201Bh:1.
    pub(super) fn tune(&mut self, value: i64) -> Result<Written, Abort> {
        let ordered = match value {
            0 => !self.tuned.runs || self.command(Command::Hold),
            _ => self.acts() && !self.is_positioned() && self.command(Command::Tune),
        };
        if ordered { Ok(Written::Now) } else { Err(Abort::DeviceState) }
    }
}

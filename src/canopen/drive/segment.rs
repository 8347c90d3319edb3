//! A segment of path as a host writes it: value by value into 200Eh, then one commit.
//!
//! A segment is appended whole or not at all. One that is refused would leave a path with a piece missing if those behind it were
//! taken, so all are refused from then on, until the host has taken note.

use super::{Drive, codes};
use crate::canopen::objects::Item;
use crate::head::{Command, Refused};
use crate::path::{Piece, Shape};

/// Reasons of 200Eh:9 in addition to those of the head.
const BEGUN_ANEW: u8 = 252;
const UNANSWERED: u8 = 253;
const NOT_ENABLED: u8 = 254;
const HALF_WRITTEN: u8 = 255;

/// What of the segment has come.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Segment {
    /// Sub-indices 1 to 7 written since the last commit, by bits.
    fresh: u8,
    /// One of them has come twice: it may be of another segment, whose commit was lost.
    twice: bool,
    /// A commit has no answer yet.
    pending: bool,
    /// The path has some.
    taken: bool,
    /// 200Eh:9.
    pub refused: u8,
}

/// Values that every segment has to have, and those of an arc.
const LINE: u8 = 0b110_0111;
const ARC: u8 = 0b111_1111;

impl Segment {
    /// A value has come.
    pub fn written(&mut self, item: Item) {
        let bit = match item {
            Item::SegmentDown => 0,
            Item::SegmentX => 1,
            Item::SegmentY => 2,
            Item::SegmentCentre1 => 3,
            Item::SegmentCentre2 => 4,
            Item::SegmentShape => 5,
            Item::SegmentOptions => 6,
            _ => return,
        };
        self.twice |= self.fresh & 1 << bit != 0;
        self.fresh |= 1 << bit;
    }

    /// The head has dropped its path: what comes next would lead there in a straight cut.
    pub fn begun_anew(&mut self) {
        (self.fresh, self.twice) = (0, false);
        if core::mem::take(&mut self.taken) {
            self.refused = BEGUN_ANEW;
        }
    }

    /// The host has taken note of what was refused, and begins anew.
    pub fn forget(&mut self) {
        (self.fresh, self.twice, self.refused) = (0, false, 0);
    }

    /// The head has taken a segment, or not.
    pub fn answered(&mut self, result: Result<(), Refused>) {
        self.pending = false;
        match result {
            Ok(()) => self.taken = true,
            Err(refused) => self.refused = codes::refused(refused),
        }
    }
}

impl Drive {
    /// Hands the segment to the head. False where it is refused.
    pub(super) fn commit_segment(&mut self) -> bool {
        let shape = Shape::from_number(self.value(Item::SegmentShape) as u8).unwrap_or(Shape::Line);
        let needed = if shape == Shape::Line { LINE } else { ARC };
        let fresh = core::mem::take(&mut self.segment.fresh);
        let twice = core::mem::take(&mut self.segment.twice);
        let refused = match self.segment {
            Segment { refused: before @ 1.., .. } => before,
            Segment { pending: true, .. } => UNANSWERED,
            _ if twice || fresh & needed != needed => HALF_WRITTEN,
            _ if !self.acts() => NOT_ENABLED,
            _ => 0,
        };
        self.segment.refused = refused;
        if refused != 0 {
            return false;
        }
        let value = |item| self.value(item);
        let options = value(Item::SegmentOptions);
        let from = if options & 1 != 0 { 0 } else { self.datum_nm() };
        let piece = Piece {
            shape,
            to: [
                i64::from(value(Item::SegmentDown)).saturating_add(from),
                value(Item::SegmentX).into(),
                value(Item::SegmentY).into(),
            ],
            centre: [value(Item::SegmentCentre1), value(Item::SegmentCentre2)],
            mark: options & 2 != 0,
            stop: options & 4 != 0,
        };
        let command = if options & 1 != 0 { Command::AppendBy(piece) } else { Command::AppendTo(piece) };
        self.segment.pending = self.command(command);
        if !self.segment.pending {
            self.segment.refused = UNANSWERED;
        }
        self.segment.pending
    }
}

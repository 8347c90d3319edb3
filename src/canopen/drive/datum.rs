//! Where the positions of a host begin, and what the electrode has lost.
//!
//! The head counts from its home, always: path, limits, marks and homing know nothing else. What a host writes and reads as a
//! position is less by the *datum*, which it sets by a surface that was touched. Only this drive knows of it, so that nothing
//! inside the head can be at odds with it; 6063h and 60FCh are the head's own counts.
//!
//! An electrode that has touched the *reference*, a place that is not eroded, and touches it again after the work, goes deeper
//! by its *wear*. A hole is as deep as the electrode has travelled since the gap was first the one to keep, less the wear since
//! then: that gap is there at both ends of the way, and does not show.
//!
//! A touch in a hole that was begun finds its bottom, not the surface of the work. The host that bores keeps the surface here, with
//! the coordinates that it means something in, so that it outlives the host.

use super::{Drive, Mode, clamp32};
use crate::backup;
use crate::canopen::objects::Item;
use crate::head::{Guidance, Search, State, Status};
use crate::units::Nanometres;

/// No surface is kept.
const NO_SURFACE: i32 = i32::MIN;

/// See the [module](self). Positions in counts of the head.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Datum {
    /// The head's position of a host's 0.
    offset: i64,
    /// What the counts mean, nm.
    nm_per_count: i64,
    /// The surface that was found last, unless the work has changed since; and whether another one is looked for.
    surface: Option<i64>,
    searches: bool,
    homed: bool,
    reference: Option<i64>,
    /// How much deeper the reference is touched than at first.
    wear: i64,
    /// What of it the datum takes into account; none where that is not known.
    included: Option<i64>,
    /// The electrode has eroded since it touched the reference.
    worn: bool,
    hole: Hole,
    /// Where a host has said that the surface of the hole under the electrode is.
    kept: Option<i64>,
}

/// The newest hole.
#[derive(Clone, Copy, Debug, Default)]
struct Hole {
    /// Path that it is on.
    path: u32,
    /// Where the gap was first the one to keep, and the farthest that the electrode has been at.
    top: i64,
    bottom: i64,
    /// Wear before it.
    wear: i64,
}

impl Datum {
    /// The head has counts of another length, or other coordinates: nothing is known any more.
    pub fn forget(&mut self) {
        *self = Datum { nm_per_count: self.nm_per_count, ..Datum::default() };
    }

    /// Looks at the head, once a millisecond.
    pub fn observe(&mut self, status: &Status, nm_per_count: i64) {
        if nm_per_count != self.nm_per_count {
            self.nm_per_count = nm_per_count;
            self.forget();
        }
        // Where the home is lost, nobody knows by how much the counts have shifted.
        if core::mem::replace(&mut self.homed, status.homed) && !status.homed {
            (self.surface, self.reference, self.included, self.kept) = (None, None, None, None);
        }
        match (self.searches, status.search) {
            (_, Search::Runs) => (self.searches, self.surface) = (true, None),
            (true, Search::Found) => (self.searches, self.surface) = (false, Some(status.touched)),
            _ => self.searches = false,
        }
        if !status.state.works() || status.state == State::Seeking {
            return;
        }
        (self.surface, self.worn) = (None, true);
        if status.paths != self.hole.path {
            let here = status.position;
            self.hole = Hole { path: status.paths, top: here, bottom: here, wear: self.wear };
        }
        // A host that guides the head is at its work from the beginning.
        if status.guidance == Guidance::No {
            self.hole.top = status.found;
        }
        self.hole.bottom = self.hole.bottom.max(status.position);
    }

    /// Where the surface of the hole under the electrode is.
    pub fn kept(&self) -> Option<i64> {
        self.kept
    }

    /// The surface that was found last.
    pub fn surface(&self) -> Option<i64> {
        self.surface
    }

    /// The reference, and how much deeper it was touched last.
    pub fn reference(&self) -> (Option<i64>, i64) {
        (self.reference, self.wear)
    }

    /// The head's position of a host's 0.
    pub fn offset(&self) -> i64 {
        self.offset
    }

    /// What is known of a hole that is gone on with.
    pub fn recall(&mut self, hole: &backup::Hole) {
        (self.kept, self.reference, self.wear) = (Some(hole.surface), hole.reference, hole.wear);
        // What a datum takes into account nobody knows any more.
        self.included = None;
    }

    /// What was touched is the work, and has this position.
    fn set(&mut self, surface: i64, position: i32) {
        self.offset = surface.saturating_sub(position.into());
        // What the electrode has lost since the reference was touched nobody knows, but the datum has it.
        self.included = (!self.worn).then_some(self.wear);
    }

    /// What was touched is the reference, by a new electrode.
    fn refer(&mut self, surface: i64) {
        (self.reference, self.wear, self.worn) = (Some(surface), 0, false);
        (self.included, self.hole.wear) = (Some(0), 0);
    }

    /// What was touched is the reference again.
    fn wear(&mut self, surface: i64, reference: i64) {
        (self.wear, self.worn) = (surface.saturating_sub(reference), false);
    }

    /// Positions are again those of the electrode's face.
    fn compensate(&mut self, included: i64) {
        let more = self.wear.saturating_sub(included);
        self.offset = self.offset.saturating_add(more);
        // The worn face meets it as much deeper.
        self.kept = self.kept.map(|kept| kept.saturating_add(more));
        self.included = Some(self.wear);
    }
}

impl Drive {
    /// Position to a host, counts; saturates.
    pub(super) fn host_position(&self, counts: i64) -> i32 {
        clamp32(counts.saturating_sub(self.datum.offset))
    }

    /// A host's position.
    #[inline(never)]
    pub(super) fn place(&self, counts: i32) -> Nanometres {
        let counts = i64::from(counts).saturating_add(self.datum.offset);
        Nanometres(counts.saturating_mul(self.active.head.axis.nm_per_count))
    }

    /// The head's position of a host's 0, nm.
    pub(super) fn datum_nm(&self) -> i64 {
        self.datum.offset.saturating_mul(self.active.head.axis.nm_per_count)
    }

    /// What an object of the datum reads.
    pub(super) fn datum_number(&self, item: Item) -> i64 {
        let Datum { offset, wear, hole, kept, .. } = &self.datum;
        let travel = hole.bottom.saturating_sub(hole.top);
        let number = match item {
            Item::DatumOffset => *offset,
            Item::Wear => *wear,
            Item::Travel => travel,
            Item::KeptSurface => kept.map_or(NO_SURFACE.into(), |kept| self.host_position(kept).into()),
            _ => travel.saturating_sub(wear.saturating_sub(hole.wear)),
        };
        clamp32(number).into()
    }

    /// The hole under the electrode is measured from this position of a host, or from none.
    pub(super) fn keep_surface(&mut self, position: i32) {
        let place = i64::from(position).saturating_add(self.datum.offset);
        let kept = (position != NO_SURFACE).then_some(place);
        // A hole that is gone on with is no new one.
        if kept != self.datum.kept {
            let scale = self.scale();
            self.resume.surface(kept, scale);
        }
        self.datum.kept = kept;
    }

    /// Whether nothing moves, and no set points come by themselves: they would mean something else from one to the next.
    pub(super) fn may_shift(&self) -> bool {
        let waits = matches!(self.mode, Mode::None | Mode::ProfilePosition | Mode::Homing) || !self.acts();
        // A loop that has just arrived trembles by a count, and its set point stands all the same.
        let rests = match self.status.state {
            State::Ready | State::HoldingPosition | State::Done => true,
            State::Disabled | State::Fault => self.standing(),
            _ => false,
        };
        waits && rests && self.fresh && !self.status.reacting
    }

    /// Whether the head waits for the coarse axis.
    pub(super) fn is_inching(&self) -> bool {
        self.status.state == State::Inching
    }

    /// Whether a host may say where the coarse axis is: in answer, or where positions may change their meaning.
    pub(super) fn may_carry(&self) -> bool {
        self.is_inching() || self.may_shift()
    }

    /// Whether a surface may be looked for, as far as the drive knows.
    pub(super) fn may_search(&self) -> bool {
        let mode = matches!(self.mode, Mode::None | Mode::ProfilePosition | Mode::Homing);
        let rests = matches!(self.status.state, State::Ready | State::HoldingPosition | State::Done);
        self.moves() && mode && self.value(Item::ErodeEnable) == 0 && (rests || !self.fresh)
    }

    /// Says what the surface is that was touched last: 1 the work, 2 the reference to a new electrode, 3 the reference again, 4
    /// the same, and positions follow the electrode's face. False where that cannot be.
    pub(super) fn take_surface(&mut self, as_what: i64) -> bool {
        let position = self.value(Item::SurfacePosition);
        let shifts = self.may_shift();
        let Some(surface) = self.datum.surface else { return false };
        match (as_what, self.datum.reference, self.datum.included) {
            (1, ..) if shifts => self.datum.set(surface, position),
            (2, ..) => self.datum.refer(surface),
            (3, Some(reference), _) => self.datum.wear(surface, reference),
            (4, Some(reference), Some(included)) if shifts => {
                self.datum.wear(surface, reference);
                self.datum.compensate(included);
            }
            _ => return false,
        }
        if matches!(as_what, 1 | 4) {
            // They were of the positions before.
            self.set_points.forget();
            self.set_points.clear_target();
        }
        true
    }
}

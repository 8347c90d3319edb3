//! Orders to the head: the queue, the newest set point of a stream, and what becomes of a command.

use super::{Drive, Order, SetPoint, codes};
use crate::canopen::Node;
use crate::canopen::objects::Item;
use crate::head::{Command, Refused};

/// Orders that can wait.
pub(super) const ORDERS: usize = 16;

impl Drive {
    /// Takes the next order.
    pub fn take(&mut self) -> Option<Order> {
        let order = self.orders.pop_front();
        if let Some(Order::Command(_)) = order {
            self.in_flight = self.in_flight.saturating_add(1);
        }
        order.or_else(|| self.follow.take().map(|point| Order::Command(point.command())))
    }

    /// For a head that receives a SYNC before this drive does: whether the set point that it is to follow from then on,
    /// [`sync_preview`](Self::sync_preview), has changed. Called when orders have been taken; each SYNC then needs a call of
    /// [`synchronised`](Self::synchronised).
    pub fn preview_sync(&mut self, node: &Node) -> bool {
        let next = self.set_point_at_sync(node);
        core::mem::replace(&mut self.sync_preview, next) != next
    }

    /// The set point that the next SYNC is to release, in the cyclic mode and if the SYNC changes nothing else.
    pub fn sync_preview(&self) -> Option<SetPoint> {
        self.sync_preview
    }

    /// Synchronous RPDOs were applied, after the SYNC has released what was sync_preview: it is not ordered once more.
    pub fn synchronised(&mut self) {
        let done = self.sync_preview.take();
        self.follow.take_if(|point| done == Some(*point));
    }

    /// Result of a command.
    pub fn answered(&mut self, command: Command, result: Result<(), Refused>) {
        if !matches!(command, Command::Follow(..)) {
            self.in_flight = self.in_flight.saturating_sub(1);
        }
        if matches!(command, Command::AppendTo(_) | Command::AppendBy(_)) {
            self.segment.answered(result);
        }
        match (command, result) {
            (Command::MoveTo(_) | Command::MoveBy(_) | Command::AppendTo(_) | Command::AppendBy(_), Ok(())) => {
                self.appended = self.appended.wrapping_add(1)
            }
            // The head erodes already, or nothing is queued yet: the drive asks whenever it may be so.
            (Command::Start, Err(Refused::State(_) | Refused::NoPath)) | (_, Ok(())) => {}
            (command, Err(refused)) => {
                self.refuses(codes::refused(refused));
                self.enabling &= command != Command::Enable;
                if matches!(command, Command::Home(_)) {
                    self.set_points.refused_homing();
                }
            }
        }
    }

    #[inline(never)]
    pub(super) fn order(&mut self, order: Order) -> bool {
        self.fresh = false;
        let stops = match order {
            Order::Command(command) => {
                matches!(command, Command::Disable | Command::Hold | Command::Brake(_))
            }
            _ => true,
        };
        if stops && self.orders.is_full() {
            // What was to be done before is not to be done any more.
            for _ in 0..ORDERS {
                match self.orders.pop_front() {
                    Some(Order::Command(_)) => self.refuses(codes::WAIT),
                    Some(other) => self.orders.push_back(other).unwrap_or_default(),
                    None => break,
                }
            }
        }
        let taken = self.orders.push_back(order).is_ok();
        if !taken {
            self.refuses(codes::WAIT);
        }
        taken
    }

    pub(super) fn command(&mut self, command: Command) -> bool {
        self.order(Order::Command(command))
    }

    /// Something is not done: 2000h:4, and an event.
    pub(super) fn refuses(&mut self, why: u8) {
        self.refusal = why;
        self.refusals = self.refusals.wrapping_add(1);
    }

    /// Pulses off, position held; set points are no longer eroded.
    pub(super) fn hold(&mut self) {
        self.set(Item::ErodeEnable, 0);
        if self.status.state.works() || !self.fresh {
            self.command(Command::Hold);
        }
    }

    /// The same, and the pending set points are dropped.
    pub(super) fn hold_all(&mut self) {
        self.set(Item::ErodeEnable, 0);
        self.end_commissioning();
        if self.status.state.follows() || !self.fresh {
            self.set_points.forget();
            self.follow = None;
            self.command(Command::Hold);
        }
    }
}

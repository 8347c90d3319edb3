//! A CAN bus with two nodes: mailboxes, arbitration, receive queues, bus-off.
//!
//! Modelled on the bxCAN controller: three transmit mailboxes and a receive queue of three frames for each node. Nothing
//! moves until the test lets a frame pass with [`Bus::carry`].

use embedded_can::{Error, ErrorKind, Frame, Id, nb::Can};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

/// Transmit mailboxes of a node, and depth of its receive queue.
pub const DEPTH: usize = 3;

/// A classic CAN frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TestFrame {
    id: Id,
    remote: bool,
    dlc: usize,
    data: [u8; 8],
}

impl Frame for TestFrame {
    fn new(id: impl Into<Id>, data: &[u8]) -> Option<Self> {
        let mut bytes = [0; 8];
        bytes.get_mut(..data.len())?.copy_from_slice(data);
        Some(TestFrame { id: id.into(), remote: false, dlc: data.len(), data: bytes })
    }
    fn new_remote(id: impl Into<Id>, dlc: usize) -> Option<Self> {
        (dlc <= 8).then(|| TestFrame { id: id.into(), remote: true, dlc, data: [0; 8] })
    }
    fn is_extended(&self) -> bool {
        matches!(self.id, Id::Extended(_))
    }
    fn is_remote_frame(&self) -> bool {
        self.remote
    }
    fn id(&self) -> Id {
        self.id
    }
    fn dlc(&self) -> usize {
        self.dlc
    }
    fn data(&self) -> &[u8] {
        if self.remote { &[] } else { &self.data[..self.dlc] }
    }
}

/// What goes wrong on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CanFault {
    /// The node is off the bus after too many errors.
    BusOff,
    /// The receive queue was full and a frame was lost.
    Overrun,
}

impl Error for CanFault {
    fn kind(&self) -> ErrorKind {
        match self {
            CanFault::BusOff => ErrorKind::Other,
            CanFault::Overrun => ErrorKind::Overrun,
        }
    }
}

#[derive(Default)]
struct Controller {
    mailboxes: Vec<TestFrame>,
    received: VecDeque<TestFrame>,
    overrun: bool,
    bus_off: bool,
}

/// The wire between two nodes.
#[derive(Clone)]
pub struct Bus(Rc<[RefCell<Controller>; 2]>);

impl Bus {
    /// A bus and its two nodes, 0 and 1.
    pub fn new() -> (Bus, [Node; 2]) {
        let bus = Bus(Rc::new([RefCell::default(), RefCell::default()]));
        let nodes = [0, 1].map(|at| Node { bus: bus.clone(), at });
        (bus, nodes)
    }

    /// Lets the pending frame with the most dominant identifier pass, and returns whether there was one. A frame stays
    /// pending while the other node is off the bus: nobody acknowledges it.
    pub fn carry(&self) -> bool {
        if self.0.iter().any(|node| node.borrow().bus_off) {
            return false;
        }
        let pending = |from: usize| self.0[from].borrow().mailboxes.iter().map(|f| f.id).min();
        let from = match (pending(0), pending(1)) {
            (None, None) => return false,
            (Some(a), Some(b)) => usize::from(b < a),
            (a, _) => usize::from(a.is_none()),
        };
        let mut sender = self.0[from].borrow_mut();
        let first = (0..sender.mailboxes.len()).min_by_key(|&i| sender.mailboxes[i].id).unwrap_or(0);
        let frame = sender.mailboxes.remove(first);
        let mut receiver = self.0[1 - from].borrow_mut();
        if receiver.received.len() < DEPTH {
            receiver.received.push_back(frame);
        } else {
            receiver.overrun = true;
        }
        true
    }

    /// Takes a node off the bus or lets it back on. Its mailboxes are emptied, as after a reset of the controller.
    pub fn set_bus_off(&self, node: usize, off: bool) {
        let mut controller = self.0[node].borrow_mut();
        controller.bus_off = off;
        controller.mailboxes.clear();
    }
}

/// One node's controller.
pub struct Node {
    bus: Bus,
    at: usize,
}

impl Can for Node {
    type Frame = TestFrame;
    type Error = CanFault;

    fn transmit(&mut self, frame: &TestFrame) -> nb::Result<Option<TestFrame>, CanFault> {
        let mut controller = self.bus.0[self.at].borrow_mut();
        if controller.bus_off {
            return Err(nb::Error::Other(CanFault::BusOff));
        }
        let mut replaced = None;
        if controller.mailboxes.len() == DEPTH {
            let last = (0..DEPTH).max_by_key(|&i| controller.mailboxes[i].id).unwrap_or(0);
            if controller.mailboxes[last].id <= frame.id {
                return Err(nb::Error::WouldBlock);
            }
            replaced = Some(controller.mailboxes.remove(last));
        }
        controller.mailboxes.push(*frame);
        Ok(replaced)
    }

    fn receive(&mut self) -> nb::Result<TestFrame, CanFault> {
        let mut controller = self.bus.0[self.at].borrow_mut();
        if std::mem::take(&mut controller.overrun) {
            return Err(nb::Error::Other(CanFault::Overrun));
        }
        if let Some(frame) = controller.received.pop_front() {
            return Ok(frame);
        }
        Err(if controller.bus_off { nb::Error::Other(CanFault::BusOff) } else { nb::Error::WouldBlock })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_can::{ExtendedId, StandardId};

    fn frame(id: u16, data: &[u8]) -> TestFrame {
        TestFrame::new(StandardId::new(id).unwrap(), data).unwrap()
    }

    #[test]
    fn frames_keep_what_they_were_made_with() {
        let f = frame(0x181, &[1, 2, 3]);
        assert_eq!((f.id(), f.dlc(), f.data()), (StandardId::new(0x181).unwrap().into(), 3, &[1, 2, 3][..]));
        assert!(f.is_standard() && f.is_data_frame());
        let r = TestFrame::new_remote(ExtendedId::MAX, 8).unwrap();
        assert!(r.is_extended() && r.is_remote_frame() && r.data().is_empty() && r.dlc() == 8);
        assert!(TestFrame::new(StandardId::MAX, &[0; 9]).is_none());
        assert!(TestFrame::new_remote(StandardId::MAX, 9).is_none());
    }

    #[test]
    fn the_most_dominant_identifier_goes_first_whoever_sends_it() {
        let (bus, [mut a, mut b]) = Bus::new();
        a.transmit(&frame(0x300, &[1])).unwrap();
        b.transmit(&frame(0x200, &[2])).unwrap();
        a.transmit(&frame(0x100, &[3])).unwrap();
        a.transmit(&frame(0x100, &[4])).unwrap();
        assert_eq!(b.receive(), Err(nb::Error::WouldBlock));
        while bus.carry() {}
        // Equal identifiers keep their order.
        assert_eq!([b.receive(), b.receive(), b.receive()].map(|f| f.unwrap().data()[0]), [3, 4, 1]);
        assert_eq!(a.receive().unwrap().data(), [2]);
        assert_eq!(a.receive(), Err(nb::Error::WouldBlock));
    }

    #[test]
    fn full_mailboxes_block_or_give_up_a_lower_priority() {
        let (_, [mut a, _b]) = Bus::new();
        for id in [0x100, 0x200, 0x300] {
            assert_eq!(a.transmit(&frame(id, &[])), Ok(None));
        }
        assert_eq!(a.transmit(&frame(0x300, &[])), Err(nb::Error::WouldBlock));
        assert_eq!(a.transmit(&frame(0x2FF, &[])), Ok(Some(frame(0x300, &[]))));
    }

    #[test]
    fn a_full_receive_queue_loses_the_newest_and_says_so_once() {
        let (bus, [mut a, mut b]) = Bus::new();
        for id in 0..=DEPTH as u16 {
            a.transmit(&frame(id, &[])).unwrap();
            assert!(bus.carry());
        }
        assert_eq!(b.receive(), Err(nb::Error::Other(CanFault::Overrun)));
        for id in 0..DEPTH as u16 {
            assert_eq!(b.receive(), Ok(frame(id, &[])));
        }
        assert_eq!(b.receive(), Err(nb::Error::WouldBlock));
    }

    #[test]
    fn off_the_bus_nothing_moves() {
        let (bus, [mut a, mut b]) = Bus::new();
        b.transmit(&frame(1, &[])).unwrap();
        bus.set_bus_off(0, true);
        assert!(!bus.carry());
        assert_eq!(a.transmit(&frame(1, &[])), Err(nb::Error::Other(CanFault::BusOff)));
        assert_eq!(a.receive(), Err(nb::Error::Other(CanFault::BusOff)));
        bus.set_bus_off(0, false);
        assert!(bus.carry());
        assert_eq!(a.receive(), Ok(frame(1, &[])));
    }
}

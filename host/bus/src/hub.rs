//! The hub: every port gets all frames but its own.
//!
//! A node that receives its own frames takes its process data for another's; so nothing is ever echoed. A frame that is sent has
//! been delivered to every port when [`Port::send`] returns, and all ports see all frames in the same order.
//!
//! Delivery never waits. A port that cannot take a frame says so and is detached: one slow program does not stall a bus.

use crate::Frame;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Where a port's frames go. Called while the hub is locked: it must neither wait nor call the hub.
pub trait Sink: Send + Sync {
    /// Takes a frame of another port.
    ///
    /// # Errors
    /// [`Detached`]: the port is to be detached, and gets nothing more.
    fn deliver(&self, frame: &Frame) -> Result<(), Detached>;
}

/// A port cannot take frames any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Detached;

/// Frames that have passed, and the bits that a wire would have carried for them. Both wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Frames.
    pub frames: u64,
    /// Bits, with stuff bits and the pause between frames.
    pub bits: u64,
}

impl Traffic {
    /// Share of a wire of `bit_rate` bit/s that was in use since `before`, `seconds` ago; 1 is all of it, and a hub can
    /// carry more.
    pub fn occupancy(self, before: Traffic, seconds: f64, bit_rate: u32) -> f64 {
        self.bits.wrapping_sub(before.bits) as f64 / (seconds * f64::from(bit_rate))
    }
}

#[derive(Default)]
struct Inner {
    ports: Vec<(u64, Arc<dyn Sink>)>,
    next: u64,
    traffic: Traffic,
}

/// The bus. Clones are the same bus.
#[derive(Clone, Default)]
pub struct Hub(Arc<Mutex<Inner>>);

impl Hub {
    /// Attaches a sink; dropping the port detaches it.
    pub fn attach(&self, sink: Arc<dyn Sink>) -> Port {
        let mut inner = self.lock();
        let id = inner.next;
        inner.next += 1;
        inner.ports.push((id, sink));
        Port { hub: self.clone(), id }
    }

    /// What has passed so far.
    pub fn traffic(&self) -> Traffic {
        self.lock().traffic
    }

    /// Ports attached.
    pub fn ports(&self) -> usize {
        self.lock().ports.len()
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // No sink panics halfway; and a bus that goes on is the better answer to one that does.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A place on the bus.
pub struct Port {
    hub: Hub,
    id: u64,
}

impl Port {
    /// Sends a frame to every other port.
    pub fn send(&self, frame: &Frame) {
        let mut inner = self.hub.lock();
        inner.traffic.frames = inner.traffic.frames.wrapping_add(1);
        inner.traffic.bits = inner.traffic.bits.wrapping_add(frame.bits().into());
        inner.ports.retain(|(id, sink)| *id == self.id || sink.deliver(frame).is_ok());
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        self.hub.lock().ports.retain(|(id, _)| *id != self.id);
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use embedded_can::{Frame as _, StandardId};

    /// Remembers what it gets, up to so many frames.
    #[derive(Default)]
    pub struct Memory {
        pub frames: Mutex<Vec<Frame>>,
        pub room: Option<usize>,
    }

    impl Sink for Memory {
        fn deliver(&self, frame: &Frame) -> Result<(), Detached> {
            let mut frames = self.frames.lock().unwrap();
            if self.room.is_some_and(|room| frames.len() >= room) {
                return Err(Detached);
            }
            frames.push(*frame);
            Ok(())
        }
    }

    pub fn frame(id: u16) -> Frame {
        Frame::new(StandardId::new(id).unwrap(), &[id as u8]).unwrap()
    }

    fn attach(hub: &Hub) -> (Arc<Memory>, Port) {
        let sink = Arc::new(Memory::default());
        (sink.clone(), hub.attach(sink))
    }

    #[test]
    fn a_frame_reaches_every_port_but_the_one_that_sent_it() {
        let hub = Hub::default();
        let ((a, port_a), (b, port_b), (c, _port_c)) = (attach(&hub), attach(&hub), attach(&hub));
        port_a.send(&frame(1));
        port_b.send(&frame(2));
        assert_eq!(*a.frames.lock().unwrap(), [frame(2)]);
        assert_eq!(*b.frames.lock().unwrap(), [frame(1)]);
        assert_eq!(*c.frames.lock().unwrap(), [frame(1), frame(2)]);
    }

    #[test]
    fn a_port_that_is_dropped_or_full_gets_nothing_more_and_the_others_go_on() {
        let hub = Hub::default();
        let (a, port_a) = attach(&hub);
        let full = Arc::new(Memory { room: Some(2), ..Memory::default() });
        let _port_full = hub.attach(full.clone());
        let (b, port_b) = attach(&hub);
        (0..5).for_each(|id| port_a.send(&frame(id)));
        assert_eq!((full.frames.lock().unwrap().len(), b.frames.lock().unwrap().len(), hub.ports()), (2, 5, 2));
        drop(port_b);
        port_a.send(&frame(5));
        assert_eq!((b.frames.lock().unwrap().len(), a.frames.lock().unwrap().len(), hub.ports()), (5, 0, 1));
    }

    #[test]
    fn what_a_wire_would_have_carried_is_counted() {
        let hub = Hub::default();
        let (_, port) = attach(&hub);
        let before = hub.traffic();
        (0..100).for_each(|_| port.send(&frame(0x2AA)));
        let bits = u64::from(frame(0x2AA).bits()) * 100;
        assert_eq!(hub.traffic(), Traffic { frames: 100, bits });
        let share = hub.traffic().occupancy(before, 0.1, 125_000);
        assert!((share - bits as f64 / 12_500.0).abs() < 1e-9, "{share}");
    }

    #[test]
    fn all_ports_see_all_frames_in_the_same_order() {
        let hub = Hub::default();
        let ((a, _port_a), (b, _port_b)) = (attach(&hub), attach(&hub));
        std::thread::scope(|scope| {
            for id in 1..4 {
                let port = attach(&hub).1;
                scope.spawn(move || (0..500).for_each(|_| port.send(&frame(id))));
            }
        });
        assert_eq!(*a.frames.lock().unwrap(), *b.frames.lock().unwrap());
        assert_eq!(a.frames.lock().unwrap().len(), 1500);
    }
}

//! An interface of the Linux kernel (SocketCAN): `can0` of an adapter, or the virtual `vcan0`.

use crate::Frame;
use crate::client::Report;
use crate::hub::{Detached, Hub, Port, Sink};
use crate::pty::ready;
use embedded_can::Frame as _;
use rustix::event::PollFlags;
use socketcan::{CanFrame, CanSocket, Socket, SocketOptions};
use std::io::ErrorKind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;

/// An interface of the kernel on the hub. Dropping it takes it off.
pub struct Interface(Arc<Shared>);

struct Shared {
    socket: CanSocket,
    lost: AtomicU64,
    stop: AtomicBool,
    left: AtomicBool,
}

impl Interface {
    /// Joins the interface `name` to the hub.
    ///
    /// # Errors
    /// What is missing, and the commands that help.
    pub fn new(hub: &Hub, name: &str, report: Report) -> Result<Interface, String> {
        let socket = CanSocket::open(name).map_err(|error| advice(name, &error))?;
        let set = || {
            // The kernel never gives a socket its own frames back; errors on the wire are not frames.
            socket.set_recv_own_msgs(false)?;
            socket.set_error_filter_drop_all()?;
            socket.set_nonblocking(true)
        };
        set().map_err(|error| format!("{name}: cannot be set up: {error}"))?;
        let shared = Arc::new(Shared {
            socket,
            lost: AtomicU64::new(0),
            stop: AtomicBool::default(),
            left: AtomicBool::default(),
        });
        let port = hub.attach(shared.clone());
        let (reader, name) = (shared.clone(), name.to_owned());
        thread::spawn(move || reader.read(&port, &name, &report));
        Ok(Interface(shared))
    }

    /// Frames that the kernel did not take, because its queue was full or the interface down.
    pub fn lost(&self) -> u64 {
        self.0.lost.load(Ordering::Relaxed)
    }

    /// The interface is gone or down.
    pub fn has_left(&self) -> bool {
        self.0.left.load(Ordering::Relaxed)
    }
}

impl Drop for Interface {
    fn drop(&mut self) {
        self.0.stop.store(true, Ordering::Relaxed);
    }
}

impl Shared {
    fn read(&self, port: &Port, name: &str, report: &Report) {
        while !self.stop.load(Ordering::Relaxed) {
            match ready(&self.socket, PollFlags::IN).map_err(Into::into).and_then(|()| self.socket.read_frame()) {
                Ok(frame) => {
                    if let Some(frame) = from_kernel(&frame) {
                        port.send(&frame);
                    }
                }
                Err(error)
                    if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {
                }
                Err(error) => {
                    self.left.store(true, Ordering::Relaxed);
                    return report(&format!("{name}: left the bus: {error}"));
                }
            }
        }
    }
}

impl Sink for Shared {
    fn deliver(&self, frame: &Frame) -> Result<(), Detached> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(Detached);
        }
        // A controller that cannot send loses frames; the bus does not wait for it.
        if to_kernel(frame).is_none_or(|frame| self.socket.write_frame(&frame).is_err()) {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
        Ok(())
    }
}

fn to_kernel(frame: &Frame) -> Option<CanFrame> {
    if frame.is_remote_frame() {
        CanFrame::new_remote(frame.id(), frame.dlc())
    } else {
        CanFrame::new(frame.id(), frame.data())
    }
}

fn from_kernel(frame: &CanFrame) -> Option<Frame> {
    match frame {
        CanFrame::Data(frame) => Frame::new(frame.id(), frame.data()),
        CanFrame::Remote(frame) => Frame::new_remote(frame.id(), frame.dlc()),
        CanFrame::Error(_) => None,
    }
}

/// Remedy for an interface that does not open.
fn advice(name: &str, error: &std::io::Error) -> String {
    // AF_CAN is not known to this kernel, or to this container.
    const NO_FAMILY: i32 = 97;
    const NO_DEVICE: i32 = 19;
    match error.raw_os_error() {
        Some(NO_FAMILY) => format!(
            "{name}: this kernel has no CAN; load it (`sudo modprobe can_raw vcan`), or use slcan or socketcand, which need no kernel"
        ),
        Some(NO_DEVICE) => format!(
            "{name}: no such interface; make one (`sudo ip link add {name} type vcan && sudo ip link set {name} up`) or plug the adapter in"
        ),
        _ => format!("{name}: cannot be opened: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_can::{ExtendedId, StandardId};

    #[test]
    fn frames_cross_the_border_to_the_kernel_unchanged() {
        for frame in [
            Frame::new(StandardId::MAX, &[1, 2, 3]).unwrap(),
            Frame::new(ExtendedId::new(5).unwrap(), &[]).unwrap(),
            Frame::new_remote(ExtendedId::MAX, 8).unwrap(),
            Frame::new_remote(StandardId::ZERO, 0).unwrap(),
        ] {
            assert_eq!(to_kernel(&frame).and_then(|kernel| from_kernel(&kernel)), Some(frame));
        }
    }

    #[test]
    fn an_interface_that_is_not_there_says_what_to_do() {
        let Err(error) = Interface::new(&Hub::default(), "nocan7", Arc::new(|_| ())) else { panic!("it is there") };
        assert!(
            error.starts_with("nocan7: ") && (error.contains("modprobe") || error.contains("ip link add")),
            "{error}"
        );
    }
}

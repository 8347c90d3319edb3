//! Programs that connect, talk nonsense, stop reading and vanish: the bus goes on.

use edm_bus::client::WAITING;
use edm_bus::hub::{Detached, Sink};
use edm_bus::slcan::Slcan;
use edm_bus::socketcand::Socketcand;
use edm_bus::tcp::{CLIENTS, Listener};
use edm_bus::{Frame, Hub, Port};
use embedded_can::{Frame as _, StandardId};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::{Duration, Instant};

fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::new(StandardId::new(id).unwrap(), data).unwrap()
}

/// A node in this process.
#[derive(Default)]
struct Node(Mutex<Vec<Frame>>);

impl Sink for Node {
    fn deliver(&self, frame: &Frame) -> Result<(), Detached> {
        self.0.lock().unwrap().push(*frame);
        Ok(())
    }
}

struct Bus {
    hub: Hub,
    node: Arc<Node>,
    port: Port,
    said: Arc<Mutex<Vec<String>>>,
}

impl Bus {
    fn new() -> Bus {
        let (hub, node) = (Hub::default(), Arc::new(Node::default()));
        Bus { port: hub.attach(node.clone()), hub, node, said: Arc::default() }
    }

    fn report(&self) -> edm_bus::client::Report {
        let said = self.said.clone();
        Arc::new(move |text| said.lock().unwrap().push(text.into()))
    }

    fn slcan(&self) -> Listener {
        Listener::new(&self.hub, "127.0.0.1:0", || Box::new(Slcan::default()), self.report()).unwrap()
    }

    fn socketcand(&self) -> Listener {
        Listener::new(&self.hub, "127.0.0.1:0", || Box::new(Socketcand::default()), self.report()).unwrap()
    }

    fn heard(&self) -> Vec<Frame> {
        self.node.0.lock().unwrap().clone()
    }
}

/// Time after which a test hangs.
const HANGS: Duration = Duration::from_secs(300);

fn eventually(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < HANGS, "never: {what}");
        sleep(Duration::from_millis(1));
    }
}

fn read(stream: &mut impl Read, length: usize) -> Vec<u8> {
    let mut bytes = vec![0; length];
    stream.read_exact(&mut bytes).unwrap();
    bytes
}

fn connect(listener: &Listener) -> TcpStream {
    let stream = TcpStream::connect(listener.address()).unwrap();
    stream.set_read_timeout(Some(HANGS)).unwrap();
    stream
}

#[test]
fn two_slcan_clients_hear_each_other_and_the_node_and_never_themselves() {
    let bus = Bus::new();
    let listener = bus.slcan();
    let (mut a, mut b) = (connect(&listener), connect(&listener));
    for client in [&mut a, &mut b] {
        client.write_all(b"O\r").unwrap();
        assert_eq!(read(client, 1), b"\r");
    }
    a.write_all(b"t12321122\r").unwrap();
    assert_eq!(read(&mut b, 10), b"t12321122\r");
    bus.port.send(&frame(0x701, &[5]));
    // Its own frame would have come between the answer and this one.
    assert_eq!(read(&mut a, 10), b"z\rt701105\r");
    assert_eq!(bus.heard(), [frame(0x123, &[0x11, 0x22])]);
}

#[test]
fn no_frame_comes_within_20_ms_of_raw_mode_and_none_is_lost() {
    let bus = Bus::new();
    let listener = bus.socketcand();
    let mut client = connect(&listener);
    assert_eq!(read(&mut client, 6), b"< hi >");
    client.write_all(b"< open can0 >").unwrap();
    assert_eq!(read(&mut client, 6), b"< ok >");
    let asked = Instant::now();
    client.write_all(b"< rawmode >").unwrap();
    assert_eq!(read(&mut client, 6), b"< ok >");
    bus.port.send(&frame(0x701, &[0]));
    assert_eq!(read(&mut client, 12), b"< frame 701 ");
    assert!(asked.elapsed() >= Duration::from_millis(20));
}

#[test]
fn a_client_that_stops_reading_is_cut_off_and_the_others_lose_nothing() {
    let bus = Bus::new();
    let listener = bus.slcan();
    let (mut good, mut stuck) = (connect(&listener), connect(&listener));
    for client in [&mut good, &mut stuck] {
        client.write_all(b"O\r").unwrap();
        assert_eq!(read(client, 1), b"\r");
    }
    const FRAMES: usize = 400_000;
    /// Frames that the good client may be behind: half of what may wait for it.
    const BEHIND: usize = WAITING / 22 / 2;
    let lines = Arc::new(AtomicUsize::new(0));
    let reader = std::thread::spawn({
        let lines = lines.clone();
        move || {
            let mut bytes = [0; 65536];
            while lines.load(Ordering::Relaxed) < FRAMES {
                let length = good.read(&mut bytes).unwrap();
                assert!(length > 0, "cut off after {lines:?}");
                lines.fetch_add(bytes[..length].iter().filter(|byte| **byte == b'\r').count(), Ordering::Relaxed);
            }
            good
        }
    });
    // Were a frame to wait for the stuck client, it would wait for ever.
    for count in 0..FRAMES {
        while count > lines.load(Ordering::Relaxed) + BEHIND && !reader.is_finished() {
            std::thread::yield_now();
        }
        bus.port.send(&frame(0x181, &[0; 8]));
    }
    let _good = reader.join().unwrap();
    eventually("the stuck client is off", || bus.hub.ports() == 2);
    let said = bus.said.lock().unwrap();
    assert!(said.len() == 1 && said[0].ends_with(": disconnected, it does not read fast enough"), "{said:?}");
}

#[test]
fn a_flood_of_nonsense_neither_reaches_the_bus_nor_stops_it() {
    let bus = Bus::new();
    for listener in [bus.slcan(), bus.socketcand()] {
        let mut client = connect(&listener);
        let mut reads = client.try_clone().unwrap();
        std::thread::spawn(move || while reads.read(&mut [0; 4096]).is_ok_and(|length| length > 0) {});
        let mut noise = edm_bus::filler::Frames::default();
        for _ in 0..2000 {
            let text: Vec<u8> = noise.by_ref().take(50).flat_map(|frame| frame.data().to_vec()).collect();
            client.write_all(&text).unwrap();
        }
        client.write_all(b"\rO\rt1230\r> < open x > < rawmode > < send 123 0 >").unwrap();
        eventually("the client is understood after all", || bus.heard().contains(&frame(0x123, &[])));
        bus.node.0.lock().unwrap().clear();
    }
}

#[test]
fn clients_leave_without_a_trace_and_one_too_many_takes_the_place_of_the_longest_idle() {
    let bus = Bus::new();
    let listener = bus.slcan();
    for _ in 0..3 {
        let mut clients: Vec<TcpStream> = (0..CLIENTS).map(|_| connect(&listener)).collect();
        eventually("all are on", || bus.hub.ports() == 1 + CLIENTS);
        // All but the fourth say something.
        for (_, client) in clients.iter_mut().enumerate().filter(|(at, _)| *at != 3) {
            client.write_all(b"V\r").unwrap();
            read(client, 6);
        }
        let mut newcomer = connect(&listener);
        assert_eq!(clients[3].read(&mut [0; 1]).unwrap(), 0, "it is disconnected");
        newcomer.write_all(b"V\r").unwrap();
        read(&mut newcomer, 6);
        eventually("the others are still on", || bus.hub.ports() == 1 + CLIENTS);
        drop((clients, newcomer));
        eventually("all are off", || bus.hub.ports() == 1);
    }
    let mut client = connect(&listener);
    eventually("it is on", || bus.hub.ports() == 2);
    assert!(bus.said.lock().unwrap().iter().all(|said| said.contains("disconnected, 16 newer clients are connected")));
    drop(listener);
    assert_eq!(client.read(&mut [0; 1]).unwrap(), 0, "the conversation is over");
    eventually("it is off", || bus.hub.ports() == 1);
}

#[test]
fn reconnects_in_quick_succession_beside_15_that_say_nothing_are_all_served() {
    let bus = Bus::new();
    let listener = bus.slcan();
    let idle: Vec<TcpStream> = (0..CLIENTS - 1).map(|_| connect(&listener)).collect();
    for _ in 0..100 {
        let mut client = connect(&listener);
        client.write_all(b"V\r").unwrap();
        read(&mut client, 6);
    }
    eventually("the last one has left", || bus.hub.ports() == CLIENTS);
    assert_eq!(*bus.said.lock().unwrap(), Vec::<String>::new(), "nobody had to go");
    drop(idle);
}

#[cfg(unix)]
mod serial {
    use super::*;
    use edm_bus::pty::SerialPort;
    use rustix::io::ioctl_fionread;
    use std::fs::{self, File};
    use std::path::PathBuf;

    fn open(bus: &Bus) -> (tempfile::TempDir, PathBuf, SerialPort) {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("can");
        let port = SerialPort::new(&bus.hub, &link, bus.report()).unwrap();
        (folder, link, port)
    }

    fn client(link: &PathBuf) -> File {
        File::options().read(true).write(true).open(link).unwrap()
    }

    #[test]
    fn a_serial_port_is_raw_and_outlives_its_clients() {
        let bus = Bus::new();
        let (_folder, link, port) = open(&bus);
        for round in 0..3 {
            let mut client = client(&link);
            // Bytes that a line of text would swallow or turn into signals.
            client.write_all(b"\x03\x04\x11\x13\x1A\r\nC\rO\r").unwrap();
            assert_eq!(read(&mut client, 3), b"\x07\r\r", "{round}");
            client.write_all(b"t0430D0A11\r").unwrap();
            assert_eq!(read(&mut client, 1), b"\x07");
            client.write_all(b"t04330D0A11\r").unwrap();
            assert_eq!(read(&mut client, 2), b"z\r");
            bus.port.send(&frame(0x181, &[0x0D]));
            assert_eq!(read(&mut client, 8), b"t18110D\r");
            client.write_all(b"C\r").unwrap();
            assert_eq!(read(&mut client, 1), b"\r");
        }
        assert_eq!(bus.heard(), [frame(0x43, &[0x0D, 0x0A, 0x11]); 3]);
        drop(port);
        assert!(!link.exists() && fs::read_link(&link).is_err(), "the link is gone");
    }

    #[test]
    fn a_client_that_vanishes_leaves_nothing_to_the_next() {
        let bus = Bus::new();
        let (_folder, link, _port) = open(&bus);
        let mut gone = client(&link);
        gone.write_all(b"O\r").unwrap();
        assert_eq!(read(&mut gone, 1), b"\r");
        drop(gone);
        for _ in 0..WAITING / 30 / 2 {
            bus.port.send(&frame(0x181, &[0; 8]));
        }
        let mut next = client(&link);
        eventually("the terminal holds what nobody read", || ioctl_fionread(&next).unwrap() > 2);
        next.write_all(b"C\rO\r").unwrap();
        eventually("nothing but the two answers is left", || ioctl_fionread(&next).unwrap() == 2);
        assert_eq!(read(&mut next, 2), b"\r\r");
        bus.port.send(&frame(0x182, &[]));
        assert_eq!(read(&mut next, 6), b"t1820\r");
        drop(next);
        // Before what waits exceeds its bound, the writer may have taken as much, and what the terminal holds besides.
        for _ in 0..4 * WAITING / 22 {
            bus.port.send(&frame(0x181, &[0; 8]));
        }
        assert_eq!(*bus.said.lock().unwrap(), [format!("{}: closed, the client does not read", link.display())]);
    }

    #[test]
    fn what_is_in_the_way_is_not_replaced() {
        let bus = Bus::new();
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("can");
        fs::write(&link, "mine").unwrap();
        assert!(SerialPort::new(&bus.hub, &link, bus.report()).is_err());
        assert_eq!(fs::read_to_string(&link).unwrap(), "mine");
        fs::remove_file(&link).unwrap();
        std::os::unix::fs::symlink("/dev/pts/99999", &link).unwrap();
        assert!(SerialPort::new(&bus.hub, &link, bus.report()).is_ok(), "a left-over link is");
    }
}

//! Clients over the network.

use crate::client::{Client, Protocol, Report, TooSlow};
use crate::hub::Hub;
use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, Ipv6Addr, Shutdown, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Clients at the same time on one address. One more replaces the one that has been silent for longest.
pub const CLIENTS: usize = 16;
/// How long a server may take to accept a connection.
const ANSWERS: Duration = Duration::from_secs(3);
/// A report a second at the most, whatever clients do.
const QUIET: Duration = Duration::from_secs(1);

/// Makes the conversation of a new client.
pub type Make = fn() -> Box<dyn Protocol>;

/// A client's place. Both are gone when its threads have returned.
struct Place {
    client: Weak<Client>,
    stream: Weak<TcpStream>,
}

impl Place {
    /// Whether the client needs it. Its threads may not have noticed its end yet: the socket knows first.
    fn taken(&self) -> bool {
        self.stream.upgrade().is_some_and(|stream| !closed(&stream))
            && self.client.upgrade().is_some_and(|client| !client.ended())
    }
}

/// Whether the other side has closed a connection, or its half of it, whatever of its bytes still waits to be read.
#[cfg(target_os = "linux")]
fn closed(stream: &TcpStream) -> bool {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    // Unasked it tells a reset as well.
    let mut asked = [PollFd::new(stream, PollFlags::RDHUP)];
    poll(&mut asked, Some(&Timespec::default())).is_ok_and(|events| events > 0)
}

/// Elsewhere its reader has to notice.
#[cfg(not(target_os = "linux"))]
fn closed(_: &TcpStream) -> bool {
    false
}

/// An address that clients connect to. Dropping it ends their conversations and closes the address.
pub struct Listener {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    /// It owns the socket; `None` once it is ended.
    accepts: Option<JoinHandle<()>>,
    places: Arc<Mutex<Vec<Place>>>,
}

impl Listener {
    /// Listens at `address`; port 0 takes a free one.
    ///
    /// # Errors
    /// When the address cannot be listened at.
    pub fn new(hub: &Hub, address: impl ToSocketAddrs, make: Make, report: Report) -> io::Result<Listener> {
        let socket = TcpListener::bind(address)?;
        let mut listener =
            Listener { address: socket.local_addr()?, stop: Arc::default(), accepts: None, places: Arc::default() };
        let (hub, stop, places) = (hub.clone(), listener.stop.clone(), listener.places.clone());
        listener.accepts = Some(thread::spawn(move || {
            let mut log = Log { report: report.clone(), said: None, kept_back: 0 };
            for stream in socket.incoming() {
                if stop.load(Ordering::Relaxed) {
                    return;
                }
                match stream.and_then(|stream| admit(&hub, stream, make, &report, &places)) {
                    Ok(None) => {}
                    Ok(Some(evicted)) => {
                        log.say(&format!("{evicted}: disconnected, {CLIENTS} newer clients are connected"))
                    }
                    Err(error) => log.say(&format!("a client could not be served: {error}")),
                }
            }
        }));
        Ok(listener)
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // The thread waits for a client: this one only wakes it.
        let mut wake = self.address;
        if wake.ip().is_unspecified() {
            wake.set_ip(if wake.is_ipv4() { Ipv4Addr::LOCALHOST.into() } else { Ipv6Addr::LOCALHOST.into() });
        }
        if TcpStream::connect(wake).is_ok()
            && let Some(accepts) = self.accepts.take()
        {
            let _ = accepts.join();
        }
        let places = self.places.lock().unwrap_or_else(PoisonError::into_inner);
        places.iter().filter_map(|place| place.client.upgrade()).for_each(|client| client.end());
    }
}

/// Reports, no more than one in [`QUIET`].
struct Log {
    report: Report,
    said: Option<Instant>,
    kept_back: u32,
}

impl Log {
    fn say(&mut self, what: &str) {
        if self.said.is_some_and(|said| said.elapsed() < QUIET) {
            self.kept_back += 1;
            return;
        }
        match std::mem::take(&mut self.kept_back) {
            0 => (self.report)(what),
            more => (self.report)(&format!("{what}; and {more} similar events before")),
        }
        self.said = Some(Instant::now());
    }
}

/// Serves a client by two threads; gives the client that it replaced, if any.
fn admit(
    hub: &Hub,
    stream: TcpStream,
    make: Make,
    report: &Report,
    places: &Mutex<Vec<Place>>,
) -> io::Result<Option<String>> {
    let mut places = places.lock().unwrap_or_else(PoisonError::into_inner);
    places.retain(Place::taken);
    let mut evicted = None;
    if places.len() >= CLIENTS
        && let Some(idle) = places.iter().filter_map(|place| place.client.upgrade()).min_by_key(|client| client.heard())
    {
        idle.end();
        evicted = Some(idle.name().to_owned());
        places.retain(Place::taken);
    }
    let name = format!("client {}", stream.peer_addr()?);
    let stream = Arc::new(stream);
    let client = converse(hub, stream.clone(), name, make(), report)?;
    places.push(Place { client: Arc::downgrade(&client), stream: Arc::downgrade(&stream) });
    Ok(evicted)
}

/// Leads a conversation by two threads, until either side ends it.
fn converse(
    hub: &Hub,
    stream: Arc<TcpStream>,
    name: String,
    protocol: Box<dyn Protocol>,
    report: &Report,
) -> io::Result<Arc<Client>> {
    stream.set_nodelay(true)?;
    let (reads, writes, cuts) = (stream.clone(), stream.clone(), stream);
    // The other side may have cut it already.
    let cut = Box::new(move || _ = cuts.shutdown(Shutdown::Both));
    let client = Arc::new(Client::new(name, protocol, TooSlow::Cut(cut), report.clone()));
    let port = hub.attach(client.clone());
    let (writer, reader) = (client.clone(), client.clone());
    thread::spawn(move || writer.write_to(|chunk| (&*writes).write_all(chunk.bytes)));
    thread::spawn(move || {
        let mut bytes = [0; 4096];
        while let Ok(length @ 1..) = (&*reads).read(&mut bytes) {
            reader.receive(&bytes[..length], &port);
        }
        reader.end();
    });
    Ok(client)
}

/// Joins a bus that another program serves at `address`; the protocol is that of the calling side.
///
/// # Errors
/// When no program listens there.
pub(crate) fn connect(
    hub: &Hub,
    address: &str,
    protocol: Box<dyn Protocol>,
    report: &Report,
) -> io::Result<Arc<Client>> {
    let mut failed = io::Error::from(io::ErrorKind::AddrNotAvailable);
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, ANSWERS) {
            Ok(stream) => return converse(hub, stream.into(), address.to_string(), protocol, report),
            Err(error) => failed = error,
        }
    }
    Err(failed)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use crate::slcan::Slcan;

    /// A client whose threads never run, and its other side.
    fn client(socket: &TcpListener, count: usize) -> (TcpStream, Arc<TcpStream>, Arc<Client>) {
        let far = TcpStream::connect(socket.local_addr().unwrap()).unwrap();
        let near = Arc::new(socket.accept().unwrap().0);
        let name = format!("client {count}");
        let end = TooSlow::Cut(Box::new(|| ()));
        (far, near, Arc::new(Client::new(name, Box::new(Slcan::default()), end, Arc::new(|_: &str| ()))))
    }

    #[test]
    fn a_newcomer_takes_the_place_of_one_that_has_left_before_any_thread_notices_and_else_of_the_longest_silent() {
        let socket = TcpListener::bind("127.0.0.1:0").unwrap();
        let clients: Vec<_> = (0..CLIENTS).map(|count| client(&socket, count)).collect();
        let place = |(_, near, client): &(TcpStream, Arc<TcpStream>, Arc<Client>)| Place {
            client: Arc::downgrade(client),
            stream: Arc::downgrade(near),
        };
        let places = Mutex::new(clients.iter().map(place).collect());
        let hub = Hub::default();
        let mut newcomers = Vec::new();
        let mut admit_one = || {
            newcomers.push(TcpStream::connect(socket.local_addr().unwrap()).unwrap());
            let stream = socket.accept().unwrap().0;
            admit(&hub, stream, || Box::new(Slcan::default()), &(Arc::new(|_: &str| ()) as Report), &places).unwrap()
        };
        // The newest and the one before, which has said something that nobody has read, leave.
        let leaving = &clients[CLIENTS - 2..];
        (&leaving[0].0).write_all(b"V\r").unwrap();
        for (far, near, _) in leaving {
            far.shutdown(Shutdown::Both).unwrap();
            while !closed(near) {
                thread::yield_now();
            }
        }
        assert_eq!([admit_one(), admit_one()], [None, None]);
        assert!(clients.iter().all(|(_, _, client)| !client.ended()), "none had to go");
        assert_eq!(admit_one().as_deref(), Some("client 0"));
        assert_eq!(places.lock().unwrap().len(), CLIENTS);
    }
}

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
/// How long a client that has just hung up may take to leave its place.
const LEAVES: Duration = Duration::from_millis(100);
/// How long a server may take to accept a connection.
const ANSWERS: Duration = Duration::from_secs(3);
/// A report a second at the most, whatever clients do.
const QUIET: Duration = Duration::from_secs(1);

/// Makes the conversation of a new client.
pub type Make = fn() -> Box<dyn Protocol>;

/// An address that clients connect to. Dropping it ends their conversations and closes the address.
pub struct Listener {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    /// It owns the socket; `None` once it is ended.
    accepts: Option<JoinHandle<()>>,
    clients: Arc<Mutex<Vec<Weak<Client>>>>,
}

impl Listener {
    /// Listens at `address`; port 0 takes a free one.
    ///
    /// # Errors
    /// When the address cannot be listened at.
    pub fn new(hub: &Hub, address: impl ToSocketAddrs, make: Make, report: Report) -> io::Result<Listener> {
        let socket = TcpListener::bind(address)?;
        let mut listener =
            Listener { address: socket.local_addr()?, stop: Arc::default(), accepts: None, clients: Arc::default() };
        let (hub, stop, clients) = (hub.clone(), listener.stop.clone(), listener.clients.clone());
        listener.accepts = Some(thread::spawn(move || {
            let mut log = Log { report: report.clone(), said: None, kept_back: 0 };
            for stream in socket.incoming() {
                if stop.load(Ordering::Relaxed) {
                    return;
                }
                match stream.and_then(|stream| admit(&hub, stream, make, &report, &clients)) {
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
        let clients = self.clients.lock().unwrap_or_else(PoisonError::into_inner);
        clients.iter().filter_map(Weak::upgrade).for_each(|client| client.end());
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
    clients: &Mutex<Vec<Weak<Client>>>,
) -> io::Result<Option<String>> {
    let mut clients = clients.lock().unwrap_or_else(PoisonError::into_inner);
    let came = Instant::now();
    let mut evicted = None;
    loop {
        clients.retain(|client| client.upgrade().is_some_and(|client| !client.ended()));
        if clients.len() < CLIENTS {
            break;
        }
        if came.elapsed() < LEAVES {
            thread::sleep(LEAVES / 20);
        } else if let Some(idle) = clients.iter().filter_map(Weak::upgrade).min_by_key(|client| client.heard()) {
            idle.end();
            evicted = Some(idle.name().to_owned());
        }
    }
    let name = format!("client {}", stream.peer_addr()?);
    let client = converse(hub, stream, name, make(), report)?;
    clients.push(Arc::downgrade(&client));
    Ok(evicted)
}

/// Leads a conversation by two threads, until either side ends it.
fn converse(
    hub: &Hub,
    stream: TcpStream,
    name: String,
    protocol: Box<dyn Protocol>,
    report: &Report,
) -> io::Result<Arc<Client>> {
    stream.set_nodelay(true)?;
    let (mut reads, mut writes, cuts) = (stream.try_clone()?, stream.try_clone()?, stream);
    // The other side may have cut it already.
    let cut = Box::new(move || _ = cuts.shutdown(Shutdown::Both));
    let client = Arc::new(Client::new(name, protocol, TooSlow::Cut(cut), report.clone()));
    let port = hub.attach(client.clone());
    let (writer, reader) = (client.clone(), client.clone());
    thread::spawn(move || writer.write_to(|chunk| writes.write_all(chunk.bytes)));
    thread::spawn(move || {
        let mut bytes = [0; 4096];
        while let Ok(length @ 1..) = reads.read(&mut bytes) {
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
            Ok(stream) => return converse(hub, stream, address.to_string(), protocol, report),
            Err(error) => failed = error,
        }
    }
    Err(failed)
}

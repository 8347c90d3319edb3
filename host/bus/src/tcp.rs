//! Clients by network.

use crate::client::{Client, Protocol, Report, TooSlow};
use crate::hub::Hub;
use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, Ipv6Addr, Shutdown, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread;

/// Clients at the same time on one address.
pub const CLIENTS: usize = 16;

/// Makes the conversation of a new client.
pub type Make = fn() -> Box<dyn Protocol>;

/// An address that clients connect to. Dropping it ends their conversations.
pub struct Listener {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    clients: Arc<Mutex<Vec<Weak<Client>>>>,
}

impl Listener {
    /// Listens at `address`; port 0 takes a free one.
    ///
    /// # Errors
    /// When the address cannot be listened at.
    pub fn new(hub: &Hub, address: impl ToSocketAddrs, make: Make, report: Report) -> io::Result<Listener> {
        let socket = TcpListener::bind(address)?;
        let listener = Listener { address: socket.local_addr()?, stop: Arc::default(), clients: Arc::default() };
        let (hub, stop, clients) = (hub.clone(), listener.stop.clone(), listener.clients.clone());
        thread::spawn(move || {
            for stream in socket.incoming() {
                if stop.load(Ordering::Relaxed) {
                    return;
                }
                match stream.and_then(|stream| admit(&hub, stream, make, &report, &clients)) {
                    Ok(()) => {}
                    Err(error) => report(&format!("a client could not be served: {error}")),
                }
            }
        });
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
        let _ = TcpStream::connect(wake);
        let clients = self.clients.lock().unwrap_or_else(PoisonError::into_inner);
        clients.iter().filter_map(Weak::upgrade).for_each(|client| client.end());
    }
}

/// Serves a client by two threads, unless there are too many.
fn admit(
    hub: &Hub,
    stream: TcpStream,
    make: Make,
    report: &Report,
    clients: &Mutex<Vec<Weak<Client>>>,
) -> io::Result<()> {
    let mut clients = clients.lock().unwrap_or_else(PoisonError::into_inner);
    clients.retain(|client| client.strong_count() > 0);
    if clients.len() >= CLIENTS {
        return Err(io::Error::other(format!("there are {CLIENTS} already")));
    }
    stream.set_nodelay(true)?;
    let (mut reads, mut writes, cuts) = (stream.try_clone()?, stream.try_clone()?, stream);
    let name = format!("client {}", cuts.peer_addr()?);
    // The other side may have cut it already.
    let cut = Box::new(move || _ = cuts.shutdown(Shutdown::Both));
    let client = Arc::new(Client::new(name, make(), TooSlow::Cut(cut), report.clone()));
    clients.push(Arc::downgrade(&client));
    let port = hub.attach(client.clone());
    let writer = client.clone();
    thread::spawn(move || writer.write_to(|chunk| writes.write_all(chunk.bytes)));
    thread::spawn(move || {
        let mut bytes = [0; 4096];
        while let Ok(length @ 1..) = reads.read(&mut bytes) {
            client.receive(&bytes[..length], &port);
        }
        client.end();
    });
    Ok(())
}

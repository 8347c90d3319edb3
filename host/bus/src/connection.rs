//! The client side: joins a bus that an adapter, another program or the kernel serves.

use crate::client::{Client, Protocol, Report};
use crate::{Hub, slcan, socketcand, tcp};
use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

/// Where a bus is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Connection {
    /// slcan by network, `socket://HOST:PORT`.
    Network(String),
    /// slcan at a serial port: an adapter on USB.
    Serial(PathBuf),
    /// A server of socketcand and its name of the bus, `socketcand://HOST:PORT/BUS`.
    Socketcand(String, String),
    /// An interface of the Linux kernel.
    Interface(String),
}

impl FromStr for Connection {
    type Err = String;

    fn from_str(text: &str) -> Result<Connection, String> {
        let connection = if let Some(address) = text.strip_prefix("socket://") {
            Connection::Network(address.into())
        } else if let Some(rest) = text.strip_prefix("socketcand://") {
            let (address, bus) = rest.split_once('/').unwrap_or((rest, "can0"));
            Connection::Socketcand(address.into(), bus.into())
        } else if text.contains('/') && !text.contains("://") {
            Connection::Serial(text.into())
        } else {
            Connection::Interface(text.into())
        };
        let fits = match &connection {
            Connection::Network(address) => address.contains(':'),
            Connection::Socketcand(address, bus) => {
                address.contains(':') && !bus.is_empty() && bus.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
            }
            Connection::Serial(_) => true,
            Connection::Interface(name) => (1..16).contains(&name.len()) && !name.contains([':', ' ']),
        };
        let allowed = "must be socket://HOST:PORT (slcan), a serial port such as /dev/ttyACM0 (slcan), socketcand://HOST:PORT/can0, or an interface such as can0";
        if fits { Ok(connection) } else { Err(allowed.into()) }
    }
}

impl Display for Connection {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Connection::Network(address) => write!(f, "socket://{address}"),
            Connection::Serial(path) => write!(f, "{}", path.display()),
            Connection::Socketcand(address, bus) => write!(f, "socketcand://{address}/{bus}"),
            Connection::Interface(name) => f.write_str(name),
        }
    }
}

/// A hub that has joined a bus. Dropping it leaves.
pub struct Joined(Line);

enum Line {
    Client(Arc<Client>),
    #[cfg(target_os = "linux")]
    Interface(crate::kernel::Interface),
}

impl Connection {
    /// Joins this bus to a hub. `bit_rate`, bit/s, is for an adapter behind slcan; elsewhere it is set already.
    ///
    /// # Errors
    /// The connection, its error, and the remedy.
    pub fn join(&self, hub: &Hub, bit_rate: u32, report: &Report) -> Result<Joined, String> {
        let slcan = || -> Result<Box<dyn Protocol>, String> {
            let caller =
                slcan::Caller::new(bit_rate).ok_or("the bit rate must be 125000, 250000, 500000 or 1000000")?;
            Ok(Box::new(caller))
        };
        let nobody = |error: std::io::Error| {
            format!("{self}: no bus there: {error}; `cargo sim serve` makes a virtual one at socket://127.0.0.1:3333")
        };
        let client = match self {
            Connection::Network(address) => tcp::connect(hub, address, slcan()?, report).map_err(nobody)?,
            Connection::Socketcand(address, bus) => {
                tcp::connect(hub, address, Box::new(socketcand::Caller::new(bus)), report).map_err(nobody)?
            }
            #[cfg(unix)]
            Connection::Serial(path) => crate::pty::connect(hub, path, slcan()?, report)
                .map_err(|error| format!("{self}: no adapter there: {error}; `dmesg` shows where it was plugged in"))?,
            #[cfg(not(unix))]
            Connection::Serial(_) => return Err(format!("{self}: serial ports only on Unix; use slcan by network")),
            #[cfg(target_os = "linux")]
            Connection::Interface(name) => {
                return crate::kernel::Interface::new(hub, name, report.clone()).map(|on| Joined(Line::Interface(on)));
            }
            #[cfg(not(target_os = "linux"))]
            Connection::Interface(_) => return Err(format!("{self}: kernel interfaces only on Linux; use slcan")),
        };
        Ok(Joined(Line::Client(client)))
    }
}

impl Joined {
    /// No frames pass any more: the other side has disconnected, or the adapter is gone.
    pub fn lost(&self) -> bool {
        match &self.0 {
            Line::Client(client) => client.ended(),
            #[cfg(target_os = "linux")]
            Line::Interface(interface) => interface.has_left(),
        }
    }
}

impl Drop for Joined {
    fn drop(&mut self) {
        match &self.0 {
            Line::Client(client) => client.end(),
            #[cfg(target_os = "linux")]
            Line::Interface(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hub::tests::frame;
    use crate::mailbox::Mailbox;
    use std::time::{Duration, Instant};

    #[test]
    fn a_way_is_told_by_its_shape_and_says_itself() {
        for (text, connection) in [
            ("socket://127.0.0.1:3333", Connection::Network("127.0.0.1:3333".into())),
            ("/dev/ttyACM0", Connection::Serial("/dev/ttyACM0".into())),
            ("socketcand://localhost:29536/vcan0", Connection::Socketcand("localhost:29536".into(), "vcan0".into())),
            ("can0", Connection::Interface("can0".into())),
        ] {
            assert_eq!((text.parse(), connection.to_string()), (Ok(connection), text.into()));
        }
        for text in ["", "socket://", "slcan://127.0.0.1:1", "socketcand://host", "socketcand://h:1/<x>", "can 0"] {
            assert!(text.parse::<Connection>().is_err(), "{text}");
        }
    }

    /// Time after which a test hangs.
    const HANGS: Duration = Duration::from_secs(300);

    /// The next frame, unless it hangs.
    fn next(mailbox: &Mailbox) -> Option<crate::Frame> {
        let mut frames = Vec::new();
        let end = Instant::now() + HANGS;
        while frames.is_empty() && Instant::now() < end {
            mailbox.wait(end);
            mailbox.take(&mut frames);
        }
        frames.first().copied()
    }

    #[test]
    fn two_hubs_are_one_bus_by_network_and_by_serial_port_and_an_end_is_noticed() {
        let report: Report = Arc::new(|_| ());
        let served = Hub::default();
        let slcan: tcp::Make = || Box::new(slcan::Slcan::default());
        let socketcand: tcp::Make = || Box::new(socketcand::Socketcand::default());
        let listeners =
            [slcan, socketcand].map(|make| tcp::Listener::new(&served, "127.0.0.1:0", make, report.clone()).unwrap());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tty");
        let serial = crate::pty::SerialPort::new(&served, &path, report.clone()).unwrap();
        let ways = [
            Connection::Network(listeners[0].address().to_string()),
            Connection::Socketcand(listeners[1].address().to_string(), "can0".into()),
            Connection::Serial(path),
        ];
        let near = Arc::new(Mailbox::default());
        let port = served.attach(near.clone());
        let joined: Vec<Joined> = (1..)
            .zip(&ways)
            .map(|(id, connection)| {
                let hub = Hub::default();
                let far = Arc::new(Mailbox::default());
                let joined = connection.join(&hub, 1_000_000, &report).unwrap();
                let sender = hub.attach(far.clone());
                // What arrives has passed the greeting of its connection: the answer finds the other side open.
                sender.send(&frame(id));
                assert_eq!(next(&near), Some(frame(id)), "{connection}");
                port.send(&frame(100 + id));
                assert_eq!(next(&far), Some(frame(100 + id)), "{connection}");
                joined
            })
            .collect();
        assert!(joined.iter().all(|connection| !connection.lost()));
        drop((listeners, serial));
        let end = Instant::now() + HANGS;
        while !joined[..2].iter().all(Joined::lost) && Instant::now() < end {
            std::thread::yield_now();
        }
        assert!(joined[0].lost() && joined[1].lost());
        // Nobody listens there any more.
        assert!(ways[0].join(&Hub::default(), 1_000_000, &report).is_err());
    }

    #[test]
    fn an_adapter_that_is_not_there_is_named() {
        let connection = Connection::Serial("/dev/no/adapter".into());
        let Err(error) = connection.join(&Hub::default(), 1_000_000, &(Arc::new(|_: &str| ()) as Report)) else {
            panic!("it is there")
        };
        assert!(error.starts_with("/dev/no/adapter: no adapter there: "), "{error}");
    }
}

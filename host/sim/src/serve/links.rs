//! Connections of CAN programs to the bus.

use crate::terminal::Failure;
use clap::Args;
use edm_bus::Hub;
use edm_bus::client::Report;
use edm_bus::filler::Filler;
use edm_bus::slcan::Slcan;
use edm_bus::socketcand::Socketcand;
use edm_bus::tcp::{Listener, Make};
use std::path::PathBuf;

/// Bit rate that loads are stated against, bit/s.
pub const BIT_RATE: u32 = 1_000_000;
/// Where slcan listens by default.
const DEFAULT: &str = "127.0.0.1:3333";

/// Options for the connections to the bus.
#[derive(Clone, Debug, Default, Args)]
pub struct Links {
    /// Listen for slcan over TCP; port 0 takes a free one [default: 127.0.0.1:3333, unless another connection is given]
    #[arg(long, value_name = "HOST:PORT")]
    pub slcan_tcp: Option<String>,
    /// Create a pseudo-terminal for slcan with this link
    #[arg(long, value_name = "PATH")]
    pub slcan_pty: Option<PathBuf>,
    /// Listen for socketcand clients; port 0 takes a free one
    #[arg(long, value_name = "HOST:PORT")]
    pub socketcand: Option<String>,
    /// Join a CAN interface of the Linux kernel (SocketCAN), real or virtual
    #[arg(long, value_name = "IFACE")]
    pub socketcan: Option<String>,
    /// Load the bus with foreign frames, percent of 1 Mbit/s
    #[arg(long, value_name = "PERCENT", value_parser = load)]
    pub load: Option<f64>,
}

/// Open connections; dropping them closes them.
pub struct Open {
    _listeners: Vec<Listener>,
    #[cfg(unix)]
    _serial: Option<edm_bus::pty::SerialPort>,
    #[cfg(target_os = "linux")]
    _interface: Option<edm_bus::kernel::Interface>,
    _filler: Option<Filler>,
    /// One line per connection, for the user.
    pub lines: Vec<String>,
}

impl Links {
    /// Opens the requested connections.
    ///
    /// # Errors
    /// The option whose connection cannot be opened, and why.
    pub fn open(&self, hub: &Hub, report: &Report) -> Result<Open, Failure> {
        let (mut listeners, mut lines) = (Vec::new(), Vec::new());
        let none = self.slcan_pty.is_none() && self.socketcand.is_none() && self.socketcan.is_none();
        let slcan_tcp = self.slcan_tcp.as_deref().or(none.then_some(DEFAULT));
        let slcan: Make = || Box::new(Slcan::default());
        let socketcand: Make = || Box::new(Socketcand::default());
        for (option, address, make) in
            [("slcan-tcp", slcan_tcp, slcan), ("socketcand", self.socketcand.as_deref(), socketcand)]
        {
            let Some(address) = address else { continue };
            let listener = Listener::new(hub, address, make, report.clone()).map_err(|error| {
                Failure::BadInput(format!("--{option} {address}: must be a free HOST:PORT: {error}"))
            })?;
            let at = listener.address();
            lines.push(match option {
                "slcan-tcp" => format!("slcan       socket://{at}"),
                _ => format!("socketcand  {at}"),
            });
            listeners.push(listener);
        }
        #[cfg(unix)]
        let serial = match &self.slcan_pty {
            None => None,
            Some(path) => {
                let serial = edm_bus::pty::SerialPort::new(hub, path, report.clone()).map_err(|error| {
                    Failure::BadInput(format!("--slcan-pty {}: cannot be made: {error}", path.display()))
                })?;
                lines.push(format!("slcan       {} (is {})", path.display(), serial.device().display()));
                Some(serial)
            }
        };
        #[cfg(not(unix))]
        if let Some(path) = &self.slcan_pty {
            return Err(Failure::BadInput(format!("--slcan-pty {}: only on Unix; use --slcan-tcp", path.display())));
        }
        #[cfg(target_os = "linux")]
        let interface = match &self.socketcan {
            None => None,
            Some(name) => {
                let interface = edm_bus::kernel::Interface::new(hub, name, report.clone())
                    .map_err(|error| Failure::BadInput(format!("--socketcan {error}")))?;
                lines.push(format!("SocketCAN   {name}"));
                Some(interface)
            }
        };
        #[cfg(not(target_os = "linux"))]
        if let Some(name) = &self.socketcan {
            return Err(Failure::BadInput(format!("--socketcan {name}: only on Linux; use --slcan-tcp")));
        }
        let filler = self.load.map(|percent| {
            lines.push(format!("load        {percent} % of 1 Mbit/s"));
            Filler::new(hub, percent / 100.0, BIT_RATE)
        });
        Ok(Open {
            _listeners: listeners,
            #[cfg(unix)]
            _serial: serial,
            #[cfg(target_os = "linux")]
            _interface: interface,
            _filler: filler,
            lines,
        })
    }
}

fn load(text: &str) -> Result<f64, String> {
    let percent = text.parse().ok().filter(|percent| (0.0..=100.0).contains(percent));
    percent.ok_or_else(|| "must be a number from 0 to 100".into())
}

//! Options of every command: the bus, the head, the form of the output.

use crate::Failure;
use crate::bus::Bus;
use crate::deed::Deed;
use crate::head::Head;
use crate::sheet::Sheet;
use clap::Args;
use edm_bus::Connection;
use serde::Serialize;
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

/// The head that is meant when none is named.
const NODE: u8 = 1;

#[derive(Clone, Debug, Args)]
pub(crate) struct Common {
    /// The bus: socket://HOST:PORT (slcan), a serial port (slcan), socketcand://HOST:PORT/can0, or an interface such as can0
    #[arg(long, global = true, value_name = "BUS", default_value = "socket://127.0.0.1:3333")]
    pub bus: Connection,
    /// Bit rate of a slcan adapter
    #[arg(long, global = true, value_name = "BIT/S", default_value_t = 1_000_000, value_parser = bit_rate)]
    pub bit_rate: u32,
    /// Node-ID of the head: default 1; `heads` lists all
    #[arg(long, global = true, value_name = "ID", value_parser = clap::value_parser!(u8).range(1..=127))]
    pub node: Option<u8>,
    /// Node-ID of this program's heartbeat
    #[arg(long, global = true, value_name = "ID", default_value_t = 127, value_parser = clap::value_parser!(u8).range(1..=127))]
    pub host_id: u8,
    /// Description file of the head, when its firmware is not from this tree
    #[arg(long, global = true, value_name = "FILE")]
    pub eds: Option<PathBuf>,
    /// JSON instead of text: one object, or one per line for `watch`, `gap`, `log` and `bore`; an error is an object as well
    #[arg(long, global = true)]
    pub json: bool,
}

impl Common {
    pub(crate) fn sheet(&self) -> Result<Arc<Sheet>, Failure> {
        let Some(path) = &self.eds else { return Ok(Arc::new(Sheet::own().map_err(Failure::Failed)?)) };
        let named = |why: String| Failure::BadInput(format!("--eds {}: {why}", path.display()));
        let bytes = std::fs::read(path).map_err(|error| named(error.to_string()))?;
        Ok(Arc::new(Sheet::parse(&String::from_utf8_lossy(&bytes)).map_err(named)?))
    }

    pub(crate) fn join(&self) -> Result<Bus, Failure> {
        Bus::join(&self.bus, self.bit_rate, self.host_id, &(Arc::new(|text: &str| eprintln!("{text}")) as _))
    }

    /// The head that is meant, for a command that does this to it.
    pub(crate) fn head(&self, sheet: &Arc<Sheet>, deed: Deed) -> Result<Head, Failure> {
        let head = Head::open(&self.join()?, self.node(), sheet)?;
        head.may(deed)?;
        Ok(head)
    }

    /// Node-ID of the head that is meant.
    pub(crate) fn node(&self) -> u8 {
        self.node.unwrap_or(NODE)
    }

    pub(crate) fn say(&self, value: &impl Serialize, text: impl FnOnce() -> String) {
        if self.json {
            // None of the types that are said can fail: their keys are strings.
            say(&(serde_json::to_string(value).unwrap_or_default() + "\n"));
        } else {
            say(&text());
        }
    }
}

fn bit_rate(text: &str) -> Result<u32, String> {
    let rate = text.parse().ok().filter(|rate| matches!(rate, 125_000 | 250_000 | 500_000 | 1_000_000));
    rate.ok_or_else(|| "must be 125000, 250000, 500000 or 1000000".into())
}

/// Prints to stdout. A reader that has gone (`| head`) is no error.
pub(crate) fn say(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}

//! Another program for a head, over the bus (CiA 302-3): docs/canopen.md, "Firmware update".

use crate::Failure;
use crate::bus::Bus;
use crate::sdo::{Address, Sdo, SdoError};
use crate::words;
use edm_boot::{Header, Wrong, file};
use serde::Serialize;
use std::path::Path;
use std::time::{Duration, Instant};

const PRODUCT: Address = Address(0x1018, 2);
const DATA: Address = Address(0x1F50, 1);
const CONTROL: Address = Address(0x1F51, 1);
const ID: Address = Address(0x1F56, 1);
const STATUS: Address = Address(0x1F57, 1);

/// Orders by [`CONTROL`].
const STOP: u8 = 0;
const START: u8 = 1;
const CLEAR: u8 = 3;

/// A head that erases a sector answers when that is done, 2 s at most.
const STALLED: Duration = Duration::from_secs(4);
/// Making room takes four such sectors.
const ROOM: Duration = Duration::from_secs(20);
/// The boot loader copies for up to 8 s.
const COPY: Duration = Duration::from_secs(30);
/// Polling period of a wait.
const LOOK: Duration = Duration::from_millis(100);

/// Codes that have a reason of their own here.
mod refusal {
    pub const CRC: u32 = 0x0504_0004;
    pub const NO_OBJECT: u32 = 0x0602_0000;
    pub const INCOMPATIBLE: u32 = 0x0604_0043;
    pub const HARDWARE: u32 = 0x0606_0000;
    pub const TOO_OFTEN: u32 = 0x0800_0021;
    pub const DEVICE_STATE: u32 = 0x0800_0022;
}

/// An update that may be sent.
pub struct Update {
    header: Header,
    bytes: Vec<u8>,
}

impl Update {
    /// Reads a file.
    ///
    /// # Errors
    /// What is wrong with it, and what to do.
    pub fn read(path: &Path) -> Result<Update, Failure> {
        let named = |why: &str| Failure::BadInput(format!("{}: {why}", path.display()));
        let bytes = std::fs::read(path).map_err(|error| named(&error.to_string()))?;
        let header = file::read(&bytes).map_err(|wrong| {
            named(match wrong {
                Wrong::Format => {
                    "not an update of a head: `cargo firmware` writes one for each board, \
                     target/firmware/edm-servo-head-BOARD.update"
                }
                Wrong::Length => "not whole: copy or build it again",
                Wrong::Product => "an update of another product",
                Wrong::Sum => "damaged: copy or build it again",
            })
        })?;
        Ok(Update { header, bytes })
    }
}

/// How it went.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// The node.
    pub node: u8,
    /// By which the program is known, 1F56h:1.
    pub id: String,
    /// Version of the program.
    pub version: String,
    /// Commit that it was built from.
    pub build: String,
    /// Nothing was to be done.
    pub already: bool,
    /// Time it took.
    pub seconds: f64,
}

impl Outcome {
    /// In a line.
    pub fn text(&self) -> String {
        let Outcome { node, id, version, build, .. } = self;
        if self.already {
            format!("node {node} runs this program already: version {version}, build {build}, sum {id}\n")
        } else {
            let s = self.seconds;
            format!("node {node} runs the new program: version {version}, build {build}, sum {id}; {s:.0} s\n")
        }
    }
}

/// What is being done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doing {
    /// The flash is being erased.
    Room,
    /// So many percent have been sent.
    Sending(usize),
    /// The boot loader copies, and the head starts.
    Starting,
}

/// Sends an update to a head and waits until it runs.
///
/// # Errors
/// What did not work, and what to do. Until the last step the head has the program that it had.
pub fn update(bus: &Bus, node: u8, update: &Update, mut on: impl FnMut(Doing)) -> Result<Outcome, Failure> {
    let Update { header, bytes } = update;
    let sdo = Sdo::new(bus, node);
    let began = Instant::now();
    let outcome = |already, began: Instant| Outcome {
        node,
        id: format!("{:08X}h", header.id),
        version: format!("{}.{}", header.version >> 16, header.version & 0xFFFF),
        build: format!("{:08x}", header.build),
        already,
        seconds: began.elapsed().as_secs_f64(),
    };
    let product = number(&sdo.read(PRODUCT)?);
    if product != header.product {
        return Err(Failure::BadInput(format!(
            "node {node}: product {product:X}h, the update is for product {:X}h: another device",
            header.product
        )));
    }
    let before = match sdo.read(ID) {
        Ok(id) => number(&id),
        Err(SdoError::Refused(_, refusal::NO_OBJECT)) => {
            return Err(Failure::BadInput(format!(
                "node {node}: its program takes no updates over the bus: program it once by a debug probe (docs/bring-up.md)"
            )));
        }
        Err(error) => return Err(error.into()),
    };
    if before == header.id {
        return Ok(outcome(true, began));
    }
    let refused = |error: SdoError| Failure::Failed(why(node, header, error));
    sdo.write(CONTROL, &[STOP]).map_err(refused)?;
    on(Doing::Room);
    sdo.write(CONTROL, &[CLEAR]).map_err(refused)?;
    let end = Instant::now() + ROOM;
    loop {
        let status = number(&sdo.probe(STATUS, STALLED)?);
        match status {
            0 => break,
            1 if Instant::now() < end => std::thread::sleep(LOOK),
            _ => {
                return Err(Failure::Failed(format!(
                    "node {node}: the flash cannot be erased (1F57h:1 is {status}): try again; if it fails again, the chip is worn"
                )));
            }
        }
    }
    sdo.write_block_with(DATA, bytes, &mut |sent| on(Doing::Sending(100 * sent / bytes.len()))).map_err(refused)?;
    let heard = bus.listen();
    on(Doing::Starting);
    sdo.write(CONTROL, &[START]).map_err(refused)?;
    let end = Instant::now() + COPY;
    let boot_up = 0x700 + u16::from(node);
    let mut booted = false;
    while Instant::now() < end {
        let Ok(frame) = heard.recv_timeout(LOOK) else {
            if bus.lost() {
                return Err(SdoError::Lost(bus.connection()).into());
            }
            continue;
        };
        booted |= frame.id == boot_up && frame.data() == [0];
        if booted {
            break;
        }
    }
    if !booted {
        return Err(Failure::Failed(format!(
            "node {node}: no boot-up within {} s: switch the head off and on; the boot loader then copies again",
            COPY.as_secs()
        )));
    }
    let now = number(&sdo.read(ID)?);
    if now != header.id {
        return Err(Failure::Failed(format!(
            "node {node}: it started with program {now:08X}h, not {:08X}h: the update was not copied; send it again",
            header.id
        )));
    }
    Ok(outcome(false, began))
}

/// Why a head does not take it, and what to do.
fn why(node: u8, header: &Header, error: SdoError) -> String {
    let SdoError::Refused(_, code) = error else {
        return format!("{error}; the head has the program that it had: send the update again");
    };
    let text = match code {
        refusal::DEVICE_STATE => {
            "only a disabled head takes an update: `edm-desk stop` disables it, `reset` ends a fault"
        }
        refusal::INCOMPATIBLE => {
            return format!(
                "node {node}: the update is for a board with STM32F{}, and the head has another: take the file of its board",
                header.board
            );
        }
        refusal::CRC => "the update did not arrive as it was sent: send it again",
        refusal::HARDWARE => "the flash failed: send it again; if it fails again, the chip is worn",
        refusal::TOO_OFTEN => "too many updates or saves in a row, which wear the flash: wait a minute",
        _ => return format!("node {node}: {}; the head has the program that it had", words::abort(code)),
    };
    format!("node {node}: {text}")
}

fn number(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
}

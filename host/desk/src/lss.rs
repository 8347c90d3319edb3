//! Node-IDs for heads that wait for one: layer setting services (CiA 305), fast scan.
//!
//! A head without a node-ID does not boot and answers these services only. The scan finds one of them by its 128 bits of identity: a slave
//! answers while the bits asked so far are its own, and the one that is left is configured and stores its node-ID itself.

use crate::Failure;
use crate::bus::{Bus, Heard};
use crate::head::scan;
use serde::Serialize;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

/// Identifier of the master's requests, and of the answers.
const REQUESTS: u16 = 0x7E5;
const ANSWERS: u16 = 0x7E4;
/// Services (CiA 305 table 1).
const SWITCH: u8 = 0x04;
const NODE_ID: u8 = 0x11;
const STORE: u8 = 0x17;
const FAST_SCAN: u8 = 0x51;
const IDENTIFIED: u8 = 0x4F;
/// State of a slave that waits.
const WAITING: u8 = 0;
/// Bit number that resets a scan.
const ALL: u8 = 0x80;
/// How long a slave may take to say that it is there.
const THERE: Duration = Duration::from_millis(300);
/// How long one may take for a bit. A late answer is taken for another bit, and the identity is then nobody's: the scan is done again,
/// with more patience.
const BIT: [Duration; 3] = [Duration::from_millis(30), Duration::from_millis(100), Duration::from_millis(300)];
/// How long one may take to store.
const STORED: Duration = Duration::from_secs(3);
/// How long a head may take to boot with its new node-ID.
const BOOTS: Duration = Duration::from_secs(3);

/// A head that has a node-ID now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Named {
    /// Node-ID.
    pub node: u8,
    /// Serial number.
    pub serial: u32,
}

/// Gives every waiting head the next free node-ID from `first` on, and has it store that.
///
/// # Errors
/// When a head refuses, or no node-ID is free. What was named before that stays named.
pub fn name_all(bus: &Bus, first: u8, mut on_named: impl FnMut(Named)) -> Result<(), Failure> {
    let heard = bus.listen();
    let taken: Vec<u8> = scan(bus).into_keys().collect();
    let mut free = (first..=127).filter(|node| !taken.contains(node));
    let send = |data: [u8; 8]| bus.send(REQUESTS, &data);
    send([SWITCH, WAITING, 0, 0, 0, 0, 0, 0]);
    while let Some(identity) = fast_scan(bus, &heard)? {
        let serial = identity[3];
        let Some(node) = free.next() else {
            return Err(Failure::Failed(format!(
                "serial number {serial} waits, and no node-ID from {first} to 127 is free"
            )));
        };
        for (service, what) in [([NODE_ID, node], "does not take node-ID"), ([STORE, 0], "does not store node-ID")] {
            drain(&heard);
            send([service[0], service[1], 0, 0, 0, 0, 0, 0]);
            match answer(&heard, STORED, service[0]) {
                Some([_, 0, ..]) => {}
                Some([_, error, more, ..]) => {
                    return Err(Failure::Failed(format!(
                        "serial number {serial} {what} {node}: error {error}, {more}"
                    )));
                }
                None => return Err(Failure::Failed(format!("serial number {serial} {what} {node}: no answer"))),
            }
        }
        // It boots with that, and is not found by the next scan.
        drain(&heard);
        send([SWITCH, WAITING, 0, 0, 0, 0, 0, 0]);
        let booted = 0x700 + u16::from(node);
        let end = Instant::now() + BOOTS;
        while !heard.recv_timeout(end.saturating_duration_since(Instant::now())).is_ok_and(|frame| frame.id == booted) {
            if Instant::now() >= end {
                return Err(Failure::Failed(format!("serial number {serial} has not booted as node {node}")));
            }
        }
        on_named(Named { node, serial });
    }
    Ok(())
}

/// The identity of one slave without a node-ID, which is configured from now on: vendor, product, revision, serial number. Nothing where
/// none waits.
fn fast_scan(bus: &Bus, heard: &Receiver<Heard>) -> Result<Option<[u32; 4]>, Failure> {
    for patience in BIT {
        if !asks(bus, heard, 0, [ALL, 0, 0], THERE) {
            return Ok(None);
        }
        if let Some(identity) = identify(bus, heard, patience) {
            return Ok(Some(identity));
        }
    }
    Err(Failure::Failed("a head waits for a node-ID, and its identity is not found: is the bus disturbed?".into()))
}

/// Whether a slave that is left has these bits: the last that counts, of which part, and the part that is next.
fn asks(bus: &Bus, heard: &Receiver<Heard>, id: u32, [bit, part, next]: [u8; 3], patience: Duration) -> bool {
    drain(heard);
    let [a, b, c, d] = id.to_le_bytes();
    bus.send(REQUESTS, &[FAST_SCAN, a, b, c, d, bit, part, next]);
    answer(heard, patience, IDENTIFIED).is_some()
}

fn identify(bus: &Bus, heard: &Receiver<Heard>, patience: Duration) -> Option<[u32; 4]> {
    let mut identity = [0; 4];
    for (part, id) in (0..).zip(identity.iter_mut()) {
        for bit in (0..32).rev() {
            // Nobody who is left has a 0 there.
            if !asks(bus, heard, *id, [bit, part, part], patience) {
                *id |= 1 << bit;
            }
        }
        if !asks(bus, heard, *id, [0, part, (part + 1) % 4], patience.max(THERE)) {
            return None;
        }
    }
    Some(identity)
}

fn drain(heard: &Receiver<Heard>) {
    while heard.try_recv().is_ok() {}
}

/// The answer to a service, as soon as it is there.
fn answer(heard: &Receiver<Heard>, patience: Duration, service: u8) -> Option<[u8; 8]> {
    let end = Instant::now() + patience;
    loop {
        let frame = heard.recv_timeout(end.saturating_duration_since(Instant::now())).ok()?;
        if let (ANSWERS, Ok(data)) = (frame.id, <[u8; 8]>::try_from(frame.data()))
            && data[0] == service
        {
            return Some(data);
        }
    }
}

//! STOP: pulses off and disabled, every head on the bus, whoever commands it.

use crate::bus::Bus;
use crate::head::{Head, Identity, scan, unsigned};
use crate::sdo::{Address, Sdo, SdoError};
use crate::sheet::Sheet;
use serde::Serialize;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

/// Scans for heads at the least: one may be too busy to answer the first.
const SCANS: u32 = 3;
/// The longest that an answer to STOP is waited for; a head that has not answered by then is named so, and goes on being told.
const PATIENCE: Duration = Duration::from_secs(4);
/// CiA 402, in the low half of a device type.
const DRIVE: u32 = 402;

/// What a head is after a STOP.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Stopped {
    /// Node-ID.
    pub node: u8,
    /// State that was read back, or what is wrong, in words.
    pub now: String,
    /// The head has said that it is disabled or in a fault.
    pub stopped: bool,
}

impl Stopped {
    /// One line.
    pub fn text(&self) -> String {
        format!("node {}: {}", self.node, self.now)
    }
}

/// What the threads of a STOP say.
enum Said {
    /// A scan has found a drive.
    Found(u8),
    /// A node has answered; none: it is no head.
    Answer(u8, Option<Stopped>),
    /// A scan is over.
    Scanned,
}

/// Stops every head on the bus: those that are `known` at once, others as scans find them. `said` is called with each answer as it
/// comes; the list has all of them by node, a known head that does not answer among them.
pub fn stop(bus: &Bus, sheet: &Arc<Sheet>, known: &BTreeSet<u8>, mut said: impl FnMut(&Stopped)) -> Vec<Stopped> {
    let (end, (sender, answers)) = (Instant::now() + PATIENCE, channel());
    known.iter().for_each(|node| tell(bus, sheet, *node, true, &sender));
    let (scans, found) = (bus.clone(), sender.clone());
    thread::spawn(move || {
        while Instant::now() < end {
            // What did not say what it is may be a head that is talking to another program.
            let drives = scan(&scans).into_iter().filter(|(_, kind)| matches!(kind & 0xFFFF, 0 | DRIVE));
            drives.for_each(|(node, _)| _ = found.send(Said::Found(node)));
            if found.send(Said::Scanned).is_err() {
                return;
            }
        }
    });
    let (mut told, mut waits, mut stopped, mut scanned) = (known.clone(), known.clone(), Vec::new(), 0);
    // Where no head was found yet, it goes on looking.
    while scanned < SCANS || !waits.is_empty() || told.is_empty() {
        match answers.recv_timeout(end.saturating_duration_since(Instant::now())) {
            Ok(Said::Found(node)) if told.insert(node) => {
                waits.insert(node);
                tell(bus, sheet, node, false, &sender);
            }
            Ok(Said::Found(_)) => {}
            Ok(Said::Answer(node, answer)) => {
                waits.remove(&node);
                answer.iter().for_each(&mut said);
                stopped.extend(answer);
            }
            Ok(Said::Scanned) => scanned += 1,
            Err(_) => break,
        }
    }
    for node in waits {
        let now = "does not answer: it may still be enabled, switch it off at the machine".into();
        let silent = Stopped { node, now, stopped: false };
        said(&silent);
        stopped.push(silent);
    }
    stopped.sort_by_key(|one| one.node);
    stopped
}

/// Tells a node to stop, beside the others; what is no head is left alone.
fn tell(bus: &Bus, sheet: &Arc<Sheet>, node: u8, is_head: bool, answers: &Sender<Said>) {
    let (bus, sheet, answers) = (bus.clone(), sheet.clone(), answers.clone());
    thread::spawn(move || {
        let sdo = Sdo::new(&bus, node);
        let part = |sub| Ok::<_, SdoError>(unsigned(&sdo.read(Address(0x1018, sub))?));
        // Whatever revision its objects have: those that stop it never move.
        let ours = (sheet.device_id.vendor, sheet.device_id.product);
        let answer = match if is_head { Ok(ours) } else { part(1).and_then(|vendor| Ok((vendor, part(2)?))) } {
            Ok(identity) if identity == ours => {
                let head = Head { bus: bus.clone(), sdo: sdo.clone(), node, sheet, identity: Identity::unread(node) };
                let ended = head.stop();
                let stopped = ended.is_ok();
                Some(Stopped { node, now: ended.unwrap_or_else(|why| why.to_string()), stopped })
            }
            // A head says who it is.
            Ok(_) | Err(SdoError::Refused(..)) => None,
            Err(why) => Some(Stopped { node, now: why.to_string(), stopped: false }),
        };
        // Whoever asked may have given up.
        let _ = answers.send(Said::Answer(node, answer));
    });
}

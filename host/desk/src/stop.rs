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

/// Start of the scan for heads that are not known, in which the known ones have the bus for themselves.
const FIRST: Duration = Duration::from_millis(300);
/// The longest that an answer to STOP is waited for; a head that has not answered by then is named so, and goes on being told.
const PATIENCE: Duration = Duration::from_secs(4);

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

/// Stops every head on the bus: those that are `known` at once, others as a scan finds them. `said` is called with each answer as it
/// comes; the list has all of them by node, a known head that does not answer among them.
pub fn stop(bus: &Bus, sheet: &Arc<Sheet>, known: &BTreeSet<u8>, mut said: impl FnMut(&Stopped)) -> Vec<Stopped> {
    let (begun, (sender, answers)) = (Instant::now(), channel());
    let mut waits = known.clone();
    known.iter().for_each(|node| tell(bus, sheet, *node, true, &sender));
    let (mut told, mut stopped, mut scans) = (known.clone(), Vec::new(), 0);
    loop {
        // A head may be too busy to answer the first scan.
        let until = if scans < 2 { begun + FIRST } else { begun + PATIENCE };
        let all = waits.is_empty() || Instant::now() >= until;
        if all && scans < 2 {
            scans += 1;
            for node in scan(bus).into_iter().filter(|node| told.insert(*node)) {
                waits.insert(node);
                tell(bus, sheet, node, false, &sender);
            }
            continue;
        }
        if all {
            break;
        }
        if let Ok((node, answer)) = answers.recv_timeout(until.saturating_duration_since(Instant::now())) {
            waits.remove(&node);
            if let Some(answer) = answer {
                said(&answer);
                stopped.push(answer);
            }
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
fn tell(bus: &Bus, sheet: &Arc<Sheet>, node: u8, is_head: bool, answers: &Sender<(u8, Option<Stopped>)>) {
    let (bus, sheet, answers) = (bus.clone(), sheet.clone(), answers.clone());
    thread::spawn(move || {
        let sdo = Sdo::new(&bus, node);
        let part = |sub| Ok::<_, SdoError>(unsigned(&sdo.read(Address(0x1018, sub))?));
        // Whatever revision its objects have: those that stop it never move.
        let made_here = || Ok::<_, SdoError>((part(1)?, part(2)?) == (sheet.device_id.vendor, sheet.device_id.product));
        let answer = match if is_head { Ok(true) } else { made_here() } {
            Ok(true) => {
                let head = Head { bus: bus.clone(), sdo: sdo.clone(), node, sheet, identity: Identity::unread(node) };
                let ended = head.stop();
                let stopped = ended.is_ok();
                Some(Stopped { node, now: ended.unwrap_or_else(|why| why.to_string()), stopped })
            }
            Ok(false) => None,
            Err(why) => Some(Stopped { node, now: why.to_string(), stopped: false }),
        };
        // Whoever asked may have given up.
        let _ = answers.send((node, answer));
    });
}

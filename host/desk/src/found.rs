//! The heads on a bus.

use crate::Failure;
use crate::bus::Bus;
use crate::head::{Head, Identity, scan};
use crate::live::{Live, Sample};
use crate::sheet::Sheet;
use serde::Serialize;
use std::sync::Arc;

/// A node that answers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Found {
    /// Node-ID.
    pub node: u8,
    /// Who it is, if it is a head.
    pub identity: Option<Identity>,
    /// What it does.
    pub now: Option<Sample>,
    /// Why this program does not use it.
    pub why_not: Option<String>,
}

/// Looks for heads.
pub fn find(bus: &Bus, sheet: &Arc<Sheet>) -> Vec<Found> {
    let look = |node| {
        let head = Head::open(bus, node, sheet)?;
        let now = Live::new(&head)?.sample()?;
        Ok::<_, Failure>((head.identity, now))
    };
    let found = |node| match look(node) {
        Ok((identity, now)) => Found { node, identity: Some(identity), now: Some(now), why_not: None },
        Err(why) => Found { node, identity: None, now: None, why_not: Some(why.to_string()) },
    };
    scan(bus).into_keys().map(found).collect()
}

impl Found {
    /// In two lines.
    pub fn text(&self) -> String {
        let (Some(identity), Some(now)) = (&self.identity, &self.now) else {
            return format!("{}\n", self.why_not.as_deref().unwrap_or_default());
        };
        let fault = if now.fault_number == 0 { String::new() } else { format!("\n  fault   {}", now.fault) };
        format!(
            "node {}: {}, hardware {}, software {}, serial number {}\n  state   {}, {}{fault}\n",
            identity.node,
            identity.name,
            identity.hardware,
            identity.software,
            identity.serial,
            now.state,
            if now.homed { format!("at {:.3} mm", now.position_mm) } else { "not homed".into() },
        )
    }
}

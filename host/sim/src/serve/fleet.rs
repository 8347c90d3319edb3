//! The heads on the bus.

use super::Plant;
use super::head::Head;
use super::store::Store;
use crate::bore::Setup;
use crate::events::{EventError, Wires};
use crate::scenario::{from_word, hint};
use edm_bus::Frame;
use edm_servo_head::canopen::NodeId;
use edm_servo_head::settings::Declared;
use std::path::Path;

/// Heads with rising node-IDs.
pub struct Fleet {
    heads: Vec<(NodeId, Head)>,
    /// What the heads sent in the last tick, and which of them.
    sent: Vec<(usize, Frame)>,
    sending: Vec<Frame>,
}

impl Fleet {
    /// Heads that have just been switched on: `count` of them from node-ID `first` on, each with the next seed.
    ///
    /// # Errors
    /// When the values do not fit together, or the folder of their stores cannot be made.
    pub fn new(setup: &Setup, first: u8, count: u8, seed: u64, store: Option<&Path>) -> Result<Fleet, String> {
        let ids = (first..).take(count.into()).filter_map(NodeId::new);
        let head = |(id, seed): (NodeId, u64)| Ok((id, Head::new(setup, id, seed, Store::new(store, id.get())?)?));
        let heads = ids.zip((0..).map(|index| seed.wrapping_add(index))).map(head).collect::<Result<_, String>>()?;
        Ok(Fleet { heads, sent: Vec::new(), sending: Vec::new() })
    }
}

impl Plant for Fleet {
    fn tick(&mut self, came: &[Frame], sent: &mut Vec<Frame>) -> Result<(), String> {
        let before = std::mem::take(&mut self.sent);
        for (at, (_, head)) in self.heads.iter_mut().enumerate() {
            let others = before.iter().filter(|(sender, _)| *sender != at).map(|(_, frame)| frame);
            head.tick(came.iter().chain(others), &mut self.sending);
            self.sent.extend(self.sending.iter().map(|frame| (at, *frame)));
            sent.append(&mut self.sending);
        }
        Ok(())
    }

    fn line(&mut self, line: &str) -> Result<(), String> {
        let (node, rest) = match line.split_once(' ') {
            Some((word, rest)) if word.bytes().all(|byte| byte.is_ascii_digit()) => (Some(word), rest.trim()),
            _ => (None, line),
        };
        let Some((key, word)) = rest.split_once('=').map(|(key, word)| (key.trim(), word.trim())) else {
            return if line.is_empty() { Ok(()) } else { Err(format!("{line}: must be [NODE] SIGNAL=VALUE")) };
        };
        let meant = |id: NodeId| node.is_none_or(|node| node.parse() == Ok(id.get()));
        if let (Some(node), false) = (node, self.heads.iter().any(|(id, _)| meant(*id))) {
            return Err(format!("{node}: no such node"));
        }
        let keys: Vec<&str> = Wires::FIELDS.iter().map(|field| field.key).collect();
        let unknown = || format!("{key}: no such signal{}; `edm-sim settings` lists all", hint(key, &keys));
        let field = Wires::FIELDS.iter().find(|field| field.key == key).ok_or_else(unknown)?;
        let refused = || format!("{key} = {word}: must be {}", field.allowed());
        let value = from_word(field, word).ok_or_else(refused)?;
        for (_, head) in self.heads.iter_mut().filter(|(id, _)| meant(*id)) {
            head.machine().process.happen(key, value).map_err(|error| match error {
                EventError::Signal => unknown(),
                EventError::Time | EventError::Value(_) => refused(),
            })?;
        }
        Ok(())
    }
}

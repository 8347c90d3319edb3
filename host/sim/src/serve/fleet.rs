//! The heads on the bus.

use super::Plant;
use crate::bore::Setup;
use crate::events::{EventError, Wires};
use crate::machine::Machine;
use crate::scenario::{from_word, hint};
use edm_bus::Frame;
use edm_servo_head::settings::{Declared, Settings};

/// Heads with rising node-IDs, each with a machine of its own.
pub struct Fleet {
    first: u8,
    heads: Vec<Machine>,
}

impl Fleet {
    /// Heads at rest at their upper stops.
    ///
    /// # Errors
    /// When the values do not fit together.
    pub fn new(setup: &Setup, first: u8, count: u8, seed: u64) -> Result<Fleet, String> {
        // The virtual head's guided check counts as passed: it needs an axis without a workpiece.
        let settings = Settings { commissioned: true, ..setup.head };
        let head = |seed| {
            let mut machine = Machine::new(&setup.process, &settings, seed).map_err(|error| setup.refusal(error))?;
            machine.process.schedule(&setup.events);
            Ok(machine)
        };
        let heads = (0..count).map(|index| head(seed.wrapping_add(index.into()))).collect::<Result<_, String>>()?;
        Ok(Fleet { first, heads })
    }
}

impl Plant for Fleet {
    fn tick(&mut self, _came: &[Frame], _sent: &mut Vec<Frame>) -> Result<(), String> {
        for head in &mut self.heads {
            head.tick();
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
        let index = match node {
            None => None,
            Some(node) => {
                let index = node.parse::<u8>().ok().and_then(|node| node.checked_sub(self.first)).map(usize::from);
                Some(index.filter(|index| *index < self.heads.len()).ok_or(format!("{node}: no such node"))?)
            }
        };
        let keys: Vec<&str> = Wires::FIELDS.iter().map(|field| field.key).collect();
        let unknown = || format!("{key}: no such signal{}; `edm-sim settings` lists all", hint(key, &keys));
        let field = Wires::FIELDS.iter().find(|field| field.key == key).ok_or_else(unknown)?;
        let refused = || format!("{key} = {word}: must be {}", field.allowed());
        let value = from_word(field, word).ok_or_else(refused)?;
        for (_, head) in self.heads.iter_mut().enumerate().filter(|(at, _)| index.is_none_or(|index| index == *at)) {
            head.process.happen(key, value).map_err(|error| match error {
                EventError::Signal => unknown(),
                EventError::Time | EventError::Value(_) => refused(),
            })?;
        }
        Ok(())
    }
}

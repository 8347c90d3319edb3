//! A case: what a host sends and what happens to the wires, as lines of text that can be read, edited and replayed.
//!
//! ```text
//! seed 17
//! +10 can 000#0105
//! +2 enabled 605#2311210540000000
//! +300 wire encoder.cut=true
//! ```
//!
//! Each line waits so many servo ticks of 50 us, then a frame is sent (`can`), or only if the head is enabled (`enabled`), or a
//! wire breaks or is repaired. Behind `#` at the beginning of a line is a comment.

use crate::events::{Event, Wires};
use crate::scenario::from_word;
use edm_servo_head::settings::{Declared, Value};
use std::fmt;

/// What is done.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// A frame is sent: identifier and data.
    Frame(u16, Vec<u8>),
    /// The same, if the head is enabled: settings that only a disabled head accepts are none of a host at work.
    Enabled(u16, Vec<u8>),
    /// A wire has this value from now on.
    Wire(&'static str, Value<'static>),
}

/// A step of a case.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Servo ticks since the step before.
    pub after: u64,
    /// What is done then.
    pub action: Action,
}

/// The life of a head.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Case {
    /// Seed of the process.
    pub seed: u64,
    /// What is done, in order.
    pub steps: Vec<Step>,
}

impl Case {
    /// Reads a case; `name` is what messages call it.
    ///
    /// # Errors
    /// The line that is none, and why.
    pub fn parse(name: &str, text: &str) -> Result<Case, String> {
        let mut seed = None;
        let mut steps = Vec::new();
        for (number, line) in (1..).zip(text.lines()) {
            let line = line.trim();
            let refused = |what: &str| format!("{name}:{number}: {line}: {what}");
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            if let Some(word) = line.strip_prefix("seed ") {
                seed = Some(word.parse().map_err(|_| refused("the seed must be a whole number"))?);
                continue;
            }
            let step = step(line).ok_or_else(|| {
                refused(
                    "must be +TICKS can ID#HEX, +TICKS enabled ID#HEX or +TICKS wire SIGNAL=VALUE (`edm-sim settings`)",
                )
            })?;
            steps.push(step);
        }
        let seed = seed.ok_or_else(|| format!("{name}: has no line `seed N`"))?;
        Ok(Case { seed, steps })
    }
}

fn step(line: &str) -> Option<Step> {
    let mut words = line.split_whitespace();
    let after = words.next()?.strip_prefix('+')?.parse().ok()?;
    let (kind, what) = (words.next()?, words.next()?);
    let action = match kind {
        "can" | "enabled" => {
            let (id, hex) = what.split_once('#')?;
            let id = u16::from_str_radix(id, 16).ok().filter(|id| *id < 0x800)?;
            let bytes = (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(hex.get(at..at + 2)?, 16).ok());
            let data = bytes.collect::<Option<Vec<u8>>>().filter(|data| data.len() <= 8)?;
            if kind == "can" { Action::Frame(id, data) } else { Action::Enabled(id, data) }
        }
        "wire" => {
            let (signal, word) = what.split_once('=')?;
            let field = Wires::FIELDS.iter().find(|field| field.key == signal)?;
            let value = from_word(field, word)?;
            Event::new(0.0, signal, value).ok()?;
            Action::Wire(
                field.key,
                match value {
                    Value::Flag(flag) => Value::Flag(flag),
                    Value::Number(number) => Value::Number(number),
                    _ => return None,
                },
            )
        }
        _ => return None,
    };
    words.next().is_none().then_some(Step { after, action })
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "seed {}", self.seed)?;
        for Step { after, action } in &self.steps {
            write!(f, "+{after} ")?;
            match action {
                Action::Frame(id, data) | Action::Enabled(id, data) => {
                    let kind = if matches!(action, Action::Frame(..)) { "can" } else { "enabled" };
                    write!(f, "{kind} {id:03X}#")?;
                    data.iter().try_for_each(|byte| write!(f, "{byte:02X}"))?;
                    writeln!(f)?;
                }
                Action::Wire(signal, Value::Number(number)) => writeln!(f, "wire {signal}={number}")?,
                Action::Wire(signal, value) => writeln!(f, "wire {signal}={}", *value == Value::Flag(true))?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case_reads_as_it_was_written() {
        let case = Case {
            seed: 17,
            steps: vec![
                Step { after: 10, action: Action::Frame(0x000, vec![1, 5]) },
                Step { after: 0, action: Action::Frame(0x080, vec![]) },
                Step { after: 2, action: Action::Enabled(0x605, vec![0x2F, 0, 0x21, 5, 1, 0, 0, 0]) },
                Step { after: 300, action: Action::Wire("encoder.cut", Value::Flag(true)) },
                Step { after: 1, action: Action::Wire("bus.sag_v", Value::Number(12.5)) },
            ],
        };
        let text = case.to_string();
        assert_eq!(Case::parse("x", &format!("# found\n\n{text}")).unwrap(), case, "{text}");
    }

    #[test]
    fn what_is_no_step_is_named_by_its_line() {
        for line in [
            "10 can 000#01",
            "+1 can 800#01",
            "+1 can 000#1",
            "+1 can 000#010203040506070809",
            "+1 wire encoder.cu=true",
            "+1 wire bus.sag_v=61",
            "+1 wire encoder.cut=true now",
            "+1 sleep",
        ] {
            let error = Case::parse("x", &format!("seed 1\n{line}\n")).unwrap_err();
            assert!(error.starts_with(&format!("x:2: {line}: must be")), "{error}");
        }
        assert!(Case::parse("x", "+1 can 000#01\n").unwrap_err().contains("seed"));
        assert!(Case::parse("x", "seed -1\n").unwrap_err().starts_with("x:1"));
    }
}

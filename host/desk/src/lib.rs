//! The desk: finds heads on a bus, keeps their settings, watches and bores.
//!
//! | room | responsible for |
//! | --- | --- |
//! | [`bus`] | the place on a bus: who waits for which frame, the heartbeat |
//! | [`sdo`] | values from and to a node's dictionary |
//! | [`sheet`] | the description file (EDS): names, types, units, ranges |
//! | [`words`] | states, faults, refusals and aborts in words, and what to do |
//! | [`head`] | one head: who it is, its values by name, its state machine |
//! | [`settings`] | list, file, comparison, a staged write |
//! | [`live`] | what a head does now, and what has happened to it |
//! | [`bore`] | a hole, from power-off to power-off |
//! | [`gap`] | the gap now |
//! | [`guide`] | what docs/bring-up.md says |
//! | [`bring_up`] | its steps that a host can see, the guided check, a report |
//! | [`scope`] | a record of the head's own scope |
//! | [`page`] | the same in a browser: one session commands, others watch |
//! | [`cli`] | the commands |

pub mod bore;
pub mod bring_up;
pub mod bus;
pub mod cli;
pub mod gap;
pub mod guide;
pub mod head;
pub mod live;
pub mod page;
pub mod scope;
pub mod sdo;
pub mod settings;
pub mod sheet;
pub mod words;

use std::fmt::{self, Display, Formatter};

/// Why a command ended early, in one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The person has to change something; nothing was done.
    BadInput(String),
    /// Something went wrong on the way.
    Failed(String),
    /// The person has to say what is under the electrode; nothing was done.
    Undecided {
        /// What is known of it.
        why: String,
        /// A hole may be continued there.
        begun: bool,
    },
}

impl Display for Failure {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Failure::BadInput(why) | Failure::Failed(why) | Failure::Undecided { why, .. } => f.write_str(why),
        }
    }
}

impl From<sdo::SdoError> for Failure {
    fn from(error: sdo::SdoError) -> Failure {
        Failure::Failed(error.to_string())
    }
}

//! The desk serves the person at the machine, in a browser or on the command line (`cargo desk`): it finds heads on a bus,
//! brings them up, keeps their settings, shows the gap, and bores.
//!
//! | room | responsible for |
//! | --- | --- |
//! | [`bus`] | connection to a bus: distribution of frames, the heartbeat |
//! | [`sdo`] | reads and writes the dictionary of a node |
//! | [`sheet`] | the description file (EDS): names, types, units, ranges |
//! | [`words`] | states, faults, refusals and aborts in words, and advice |
//! | [`head`] | one head: identity, values by name, state machine |
//! | [`deed`] | what a program may do to a head that another one moves |
//! | [`stop`] | STOP, of every head on the bus |
//! | [`settings`] | list, file, comparison, a staged write |
//! | [`live`] | present state of a head, and its events |
//! | [`bore`] | a hole, from disabled to disabled |
//! | [`track`] | a G-code program on its way into the head |
//! | [`gap`] | the gap now |
//! | [`found`] | the heads on a bus |
//! | [`guide`] | texts and limits of docs/bring-up.md |
//! | [`bring_up`] | its steps that a host can see, the guided check, a report |
//! | [`fast`] | a record of the servo tick, the snapshot of a fault |
//! | [`scope`] | a record of any objects, once a millisecond |
//! | [`identify`] | the head measures motor, mass and friction |
//! | [`tune`] | the response of the loop, margins, gains |
//! | `common` | options of every command |
//! | [`update`] | another program for a head |
//! | [`page`] | the same in a browser: one session commands, others watch |
//! | [`cli`] | the commands |

pub mod bore;
pub mod bring_up;
pub mod bus;
pub mod cli;
mod common;
pub mod deed;
pub mod fast;
pub mod found;
pub mod gap;
pub mod guide;
pub mod head;
pub mod identify;
pub mod jog;
pub mod live;
pub mod lss;
pub mod page;
pub mod record;
pub mod scope;
pub mod sdo;
pub mod settings;
pub mod sheet;
pub mod stop;
pub mod table;
pub mod trace;
pub mod track;
pub mod tune;
pub mod update;
pub mod words;

use std::fmt::{self, Display, Formatter};

/// Why a command ended early, in one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// Bad input; nothing was done.
    BadInput(String),
    /// The command failed.
    Failed(String),
    /// The user must say what is under the electrode; nothing was done.
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

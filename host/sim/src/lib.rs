//! The simulator: the head's control core in a closed loop with the process model, on a PC. It serves people who set or change
//! a head without a machine (`cargo sim`), hosts that need a head on a bus (`cargo sim serve`), and the tests.
//!
//! | room | responsible for |
//! | --- | --- |
//! | [`process`] | machine and process at the other end of the head's wires |
//! | [`machine`] | the closed loop, tick by tick |
//! | [`lockstep`] | the native core with the inputs of the chip, live or from a recording |
//! | [`bore`](mod@bore) | a hole, from rest to depth or to a stop |
//! | [`commanded`] | the same on a head that is commanded over its bus, by a technology table |
//! | [`run`] | data between the command line and the machine |
//! | [`events`] | faults of the machine, and when they happen |
//! | [`faults`] | fault campaigns: faults injected, and the reactions of the head |
//! | [`scenario`] | named sets of values for process and head |
//! | [`millisecond`] | samples gathered into milliseconds |
//! | [`observe`] | one sample per tick for figures, trace and plot |
//! | [`statistics`] | the figures by which control is evaluated |
//! | [`report`] | the run in JSON and in words |
//! | [`trace`], [`plot`] | the run as a table and as a picture |
//! | [`pool`] | work on every core |
//! | [`output`] | files that appear complete or not at all |
//! | [`replay`] | recordings of a gap through the head's filters and classifier |
//! | [`page`] | a page of the project with a section that a command writes |
//! | [`store`] | stored settings of a virtual head |
//! | `schedule` | a virtual head whose tasks preempt each other by a seed |
//! | [`serve`] | virtual heads on a CAN bus, in real time |
//! | [`soak`] | random commands and events, with invariants checked in every tick |
//! | [`inputs`] | options of a run, checked |
//! | [`terminal`] | exit codes and messages |
//! | [`cli`] | commands |
//! | [`sweep`] | every combination of a grid, against the bounds |
//! | [`board`] | the process model behind the hardware traits of the tasks |
//! | [`bench`](mod@bench) | speed, in processor time, and memory |
//!
//! Imports between rooms form no circle: `tests/imports.rs` reads the sources.

pub mod battery;
pub mod bench;
pub mod board;
pub mod bore;
pub mod cli;
pub mod coarse;
pub mod commanded;
pub mod compare;
pub mod contact;
pub mod events;
pub mod faults;
pub mod inputs;
pub mod kinds;
pub mod lockstep;
pub mod machine;
pub mod millisecond;
pub mod observe;
pub mod output;
pub mod page;
pub mod plot;
pub mod pool;
pub mod process;
pub mod progress;
pub mod replay;
pub mod report;
pub mod run;
pub mod scenario;
pub mod schedule;
pub mod search;
pub mod serve;
pub mod soak;
pub mod stage;
pub mod statistics;
pub mod store;
pub mod sweep;
pub mod terminal;
pub mod trace;

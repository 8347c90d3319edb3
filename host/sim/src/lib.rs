//! Process model and native closed loop: the control core bores a hole on a PC.
//!
//! | room | responsible for |
//! | --- | --- |
//! | [`process`] | machine and process: what the head's wires are connected to |
//! | [`machine`] | the closed loop, tick by tick |
//! | [`lockstep`] | the native core fed what the chip saw, live or from a recording |
//! | [`bore`](mod@bore) | a hole, from rest to depth or to the reason why not |
//! | [`run`] | what passes between the command line and the machine |
//! | [`events`] | what goes wrong with the machine, and when |
//! | [`faults`] | fault campaigns: what is injected, and what the head made of it |
//! | [`scenario`] | named sets of values for process and head |
//! | [`millisecond`] | samples gathered into milliseconds |
//! | [`observe`] | one sample a tick, fanned out to figures, trace and plot |
//! | [`statistics`] | the figures by which control is judged |
//! | [`report`] | the run in JSON and in words |
//! | [`trace`], [`plot`] | the run as a table and as a picture |
//! | [`pool`] | work on every core |
//! | [`output`] | files that appear complete or not at all |
//! | [`path_report`] | how exactly a path is gone along and back |
//! | [`gap_report`] | what the estimators of the gap can tell |
//! | [`replay`] | recordings of a gap through the head's own chain |
//! | [`page`] | a page of the project with a section that a command writes |
//! | [`store`] | what a virtual head keeps when its power is cut |
//! | `schedule` | a virtual head whose tasks preempt each other as a seed wants it |
//! | [`serve`] | virtual heads on a CAN bus, in real time |
//! | [`soak`] | random commands and events, with what must hold checked in every tick |
//! | [`inputs`] | the options that say what is run, checked |
//! | [`terminal`] | how a command ends, and what it says |
//! | [`cli`] | commands |
//! | [`sweep`] | every combination of a grid, against the bounds |
//! | [`board`] | the process model on the traits that the tasks of a head are written over |
//! | [`bench`](mod@bench) | speed, in time of the processor, and memory |
//!
//! A room uses rooms beside it, never in a circle: `tests/imports.rs` reads the sources.

pub mod bench;
pub mod board;
pub mod bore;
pub mod cli;
pub mod compare;
pub mod contact;
pub mod events;
pub mod faults;
pub mod gap_report;
pub mod gcode;
pub mod inputs;
pub mod lockstep;
pub mod machine;
pub mod millisecond;
pub mod observe;
pub mod output;
pub mod page;
pub mod path_report;
pub mod plot;
pub mod pool;
pub mod process;
pub mod progress;
pub mod replay;
pub mod report;
pub mod run;
pub mod scenario;
pub mod schedule;
pub mod serve;
pub mod soak;
pub mod statistics;
pub mod store;
pub mod sweep;
pub mod terminal;
pub mod trace;
